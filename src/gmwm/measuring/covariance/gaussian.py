"""Covariance of the Haar wavelet variance of a model, summed over all lags, exact to rounding.

The coefficients are second differences of a running sum, whose covariances are closed forms, smooth in the lag between
a few kinks. For a classical estimate and sums of exponentials, as FN nearly is, white noise, walks and tables, sums
over lags are closed forms too; robust estimates of an oscillation add higher powers by `cpp/src/hermite_sums.cpp`.
Otherwise a Gauss rule for sums over integers is used between kinks, and every lag near them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Booleans, Integers, Matrix, Vector, freeze
from gmwm.base.threads import computed_once
from gmwm.measuring.covariance import nodes
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.filtered import LONGEST_SAMPLES
from gmwm.measuring.covariance.robust import hermite_weights
from gmwm.measuring.covariance.segments import EXACT_LENGTHS
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum, lag_sums, lag_table
from gmwm.theory.processes.haar_covariance import LagGrid
from gmwm.theory.processes.model import Model


def knows(model: Model, design: Design) -> bool:
    """Return whether this module has the covariance: overlapping Haar, processes of closed form or short memory."""
    return has_closed_form(model, design) or (
        design.running_sum and all(p.memory(design.rate) is not None for p in model.processes if p.scale > 0)
    )


def has_closed_form(model: Model, design: Design) -> bool:
    """Return whether the covariance is a closed form, so that its time does not depend on the memory of the model."""
    present = [process for process in model.processes if process.scale > 0]
    return design.running_sum and _split(present, design) is not None


def covariance(model: Model, design: Design) -> Matrix:
    """Compute the covariance V (J, J), in u⁴."""
    size, pairs = design.levels.size, _Pairs.of(design, diagonal=False)
    v = np.empty((size, size))
    v[pairs.finer, pairs.coarser] = v[pairs.coarser, pairs.finer] = _entries(model, design, diagonal=False)
    return v


def variances(model: Model, design: Design) -> Vector:
    """Compute the diagonal (J,) of V, in u⁴."""
    return _entries(model, design, diagonal=True)


def ratio_variances(model: Model, design: Design) -> Vector:
    """Compute Var log(ν̂_j²/ν̃_j²) (J,) = Σ_{q = 4, 6, …} c_q Σ_u n(u) ρ_j(u)^q / M_j²; see `api.ratio_variances`."""
    present = [process for process in model.processes if process.scale > 0]
    if (split := _split(present, design)) is not None:
        _, powers = split.powers(design, diagonal=True)
    else:
        at, weight, starts = nodes.lags(present, design, diagonal=True)
        known, pairs = nodes.coefficient_covariance(present, at, design.rate), _Pairs.of(design, diagonal=True)
        _, powers = _powers(present, pairs, design, covariance=known, weight=weight, starts=starts)
    return np.asarray(2.0 * powers / design.counts.astype(np.float64) ** 2)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Indices of the finer and the coarser level of each pair, with half-scales h and numbers M of coefficients."""

    finer: NDArray[np.int64]
    coarser: NDArray[np.int64]
    half: Vector
    counts: Vector

    @staticmethod
    @lru_cache(maxsize=8 * EXACT_LENGTHS)
    def of(design: Design, *, diagonal: bool) -> _Pairs:
        """Return all pairs of levels, or each level with itself if `diagonal`."""
        size = design.levels.size
        coarser, finer = np.diag_indices(size) if diagonal else np.tril_indices(size)
        return _Pairs(finer, coarser, np.ldexp(1.0, design.levels - 1), design.counts.astype(np.float64))

    @cached_property
    def areas(self) -> Vector:
        """Products h_j h_k of the half-scales of each pair."""
        return self.outer(self.half)

    @cached_property
    def sizes(self) -> Vector:
        """Products M_j M_k of the numbers of coefficients of each pair."""
        return self.outer(self.counts)

    def outer(self, values: Vector) -> Vector:
        """Return the product x_j x_k for each pair of levels, where x are `values` of the levels."""
        return np.asarray(values[self.finer] * values[self.coarser])


def _entries(model: Model, design: Design, *, diagonal: bool) -> Vector:
    """Compute V_jk for all pairs of levels, or V_jj for all levels if `diagonal`."""
    pairs = _Pairs.of(design, diagonal=diagonal)
    present = [process for process in model.processes if process.scale > 0]
    split = _split(present, design)
    if split is None:
        out = _over_lags(model, design, pairs, *nodes.lags(present, design, diagonal=diagonal))
    else:
        first, second = split.sums(design, design.few, diagonal=diagonal)
        out = _of_sums(model, design, pairs, first=first, second=second)
    for place, stride in enumerate(design.strides):
        if stride > 1:
            mine = (pairs.finer == place) & (pairs.coarser == place if diagonal else True)
            out[mine] = _strided(model, design, place, stride)[: np.count_nonzero(mine)]
    return out


def _strided(model: Model, design: Design, place: int, stride: int) -> Vector:
    """Compute V_jk for k ≥ j if level j uses every s-th coefficient (s = `stride`): sums over lags in steps of s, as of
    N/s samples. With a level without strides, all lags are equally frequent, so strides have no effect."""
    levels = design.levels[place:]
    within = replace(
        design, levels=levels - int(np.log2(stride)), samples=design.samples // stride,
        rate=design.rate / stride, strides=(), segments=(),
    )  # fmt: skip
    coarser, finer = np.tril_indices(levels.size)
    first = np.flatnonzero(finer == 0)
    counts = design.counts.astype(np.float64)
    counts[place:] = within.counts
    pairs = _Pairs(finer[first] + place, coarser[first] + place, np.ldexp(1.0, design.levels - 1), counts)
    present = [process for process in model.processes if process.scale > 0]
    split = _split(present, design)
    if split is not None:
        sums = split.strided(stride, design).sums(within, design.few[place:], diagonal=False)
        return _of_sums(model, design, pairs, first=sums[0][first], second=sums[1][first], stride=stride)
    at, weight, starts = nodes.lags(present, within, diagonal=False, decays_of=design.rate, stride=stride)
    ends = np.append(starts[1:], weight.size)
    kept = np.concatenate([np.arange(starts[k], ends[k]) for k in first])
    sizes = (ends - starts)[first]
    # At multiples of an even number of samples, an alternating covariance does not alternate.
    odd = np.zeros(kept.size, dtype=np.uint8) if nodes.alternates(present, design.rate) else None
    grid = LagGrid(stride * at.fine[kept], stride * at.coarse[kept], stride * at.lag[kept], odd)
    begins = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    return _over_lags(model, design, pairs=pairs, at=grid, weight=weight[kept], starts=begins, stride=stride)


@dataclass(frozen=True, eq=False)
class _Split:
    """Processes of a model: the sum of exponentials `terms`, and the others (`smooth`), approximately such a sum."""

    terms: ExponentialSum
    smooth: list[Process]
    known: dict[bool, tuple[Integers, Vector, Vector]] = field(default_factory=dict)  # levels and sums, by `diagonal`

    def sums(self, design: Design, few: Booleans, *, diagonal: bool) -> tuple[Vector, Vector]:
        """Compute Σ n Cov and Σ n Cov², or what replaces it in a robust estimate of levels that are not `few`, for all
        pairs of levels, or for all levels if `diagonal`. Smooth ones are approximated. The last classical sums are
        kept: those of the first levels are the first ones, and a test of a model asks for both."""
        levels, first, second = self.known.get(diagonal, (np.empty(0, np.int64), np.empty(0), np.empty(0)))
        size = design.levels.size
        if design.efficiency is None and np.array_equal(design.levels, levels[:size]):
            size = size if diagonal else size * (size + 1) // 2
            return first[:size], second[:size]
        shapes = [(_shape(process, design, diagonal), process) for process in self.smooth]
        tables = [(shape.table, process.scale) for shape, process in shapes]
        first, second = lag_sums(design.levels, design.samples, self.terms, tables, diagonal=diagonal)
        for k, (shape, process) in enumerate(shapes, 1):
            sums = process.scale * shape.first, process.scale**2 * shape.second
            if k < len(shapes):
                mixture = shape.mixture.scaled(process.scale)
                sums = lag_sums(design.levels, design.samples, mixture, tables[k:], diagonal=diagonal)
            first, second = first + sums[0][: first.size], second + sums[1][: first.size]
        if design.efficiency is not None:
            variance, powers = self.powers(design, diagonal=diagonal)
            second = second + _Pairs.of(design, diagonal=diagonal).outer(np.where(few, 0.0, variance)) * powers
        else:
            self.known[diagonal] = design.levels, first, second
        return first, second

    def powers(self, design: Design, *, diagonal: bool) -> tuple[Vector, Vector]:
        """Compute the variances 2^(2j) Var(W_j) (J,), and ½ Σ_{q = 4, 6, …} c_q Σ n ρ^q for the pairs of `sums`."""
        assert design.efficiency is not None
        weights = hermite_weights(design.efficiency)[1:] / 2
        return _core.hermite_sums(design.levels, design.samples, diagonal, self._joined(design).kernel, weights)

    def strided(self, stride: int, design: Design) -> _Split:
        """Return the processes with lags in steps of `stride` samples."""
        return _Split(self._joined(design).strided(stride), [])

    def _joined(self, design: Design) -> ExponentialSum:
        """Return all processes as one sum, with approximations of the smooth ones."""
        sums = [process.exponential_mixture(design.rate, design.samples) for process in self.smooth]
        return ExponentialSum.joined([self.terms, *(mixture for mixture in sums if mixture)])


def _split(present: list[Process], design: Design) -> _Split | None:
    """Return the processes as a sum of exponentials and smooth processes; None if a process has another form, or no
    covariance oscillates and the estimate is robust or a smooth shape is free: a Gauss rule then needs few nodes."""
    split = _split_of(tuple(present), design.rate, design.samples)
    if design.efficiency is None or split is None:
        return split
    # A robust estimate sums lags until oscillations are below 1e-9; more than 2²⁶ of them would take minutes.
    lasting = split.terms.decays[split.terms.decays.imag > 0]
    few = min(design.samples, 21.0 / max(lasting.real.min(initial=np.inf), 1e-300)) <= LONGEST_SAMPLES
    return split if few and np.any(lasting.imag % np.pi) else None


@lru_cache(maxsize=2 * EXACT_LENGTHS)
def _split_of(present: tuple[Process, ...], rate: float, samples: int) -> _Split | None:
    terms, smooth = _terms_of(present, rate)
    if not terms.oscillates and not all(p.shape_is_fixed for p in smooth) and all(p.memory(rate) == 0 for p in present):
        return None
    return _Split(terms, smooth) if all(process.exponential_mixture(rate, samples) for process in smooth) else None


@lru_cache(maxsize=4)
def _terms_of(present: tuple[Process, ...], rate: float) -> tuple[ExponentialSum, list[Process]]:
    """Return the sum of the processes that are a sum of exponentials, and the others."""
    sums = [nodes.exponential_sum(process, rate) for process in present]
    smooth = [process for process, term in zip(present, sums, strict=True) if term is None]
    return ExponentialSum.joined([term for term in sums if term is not None]), smooth


@dataclass(frozen=True, eq=False)
class _Shape:
    """A smooth process with scale 1 as a sum of exponentials, its table for `lag_sums`, and its own sums."""

    mixture: ExponentialSum
    table: _core.LagTable
    first: Vector
    second: Vector


def _shape(process: Process, design: Design, diagonal: bool) -> _Shape:
    """Return the sums of a smooth process. Those of all levels begin with those of the first ones."""
    levels, possible = tuple(design.levels.tolist()), tuple(range(1, design.samples.bit_length()))
    if possible[: len(levels)] == levels:
        levels = possible
    values = tuple(process.nonlinear.tolist())
    shape_of = _shape_of if values or design.pooled is None else _shape_of_segment
    return shape_of(type(process), values, rate=design.rate, levels=levels, samples=design.samples, diagonal=diagonal)


def _compute_shape(
    kind: type[Process], values: tuple[float, ...], *, rate: float, levels: tuple[int, ...], samples: int,
    diagonal: bool,
) -> _Shape:  # fmt: skip
    mixture, j = kind.standard(np.array(values)).exponential_mixture(rate, samples), np.array(levels)
    assert mixture is not None
    table = lag_table(j, samples, mixture, diagonal=diagonal)
    return _Shape(mixture, table, *lag_sums(j, samples, mixture, diagonal=diagonal))


_shape_of = computed_once(6)(_compute_shape)
_shape_of_segment = computed_once(2 * EXACT_LENGTHS)(_compute_shape)  # of each length, up to 3 MB


def _over_lags(
    model: Model, design: Design, pairs: _Pairs, at: LagGrid, weight: Vector, starts: NDArray[np.int64],
    stride: int = 1,
) -> Vector:  # fmt: skip
    """Compute V_jk from covariances at the nodes `at`, from `starts` on for each pair, `stride` samples apart."""
    present = [process for process in model.processes if process.scale > 0]
    if design.efficiency is None:
        first, second = nodes.product_sums(present, at, weight, starts, rate=design.rate)
    else:
        shapes, scales = nodes.shapes_at(present, at, design.rate)
        first, second = _core.node_sums(shapes, np.array(scales, dtype=np.float64), weight, starts)
        known = nodes.total_at(shapes, scales, at)
        own, powers = _powers(present, pairs, design, covariance=known, weight=weight, starts=starts)
        second = second + pairs.outer(np.where(design.few, 0.0, own)) * powers
    return _of_sums(model, design, pairs, first=first, second=second, stride=stride)


def _of_sums(model: Model, design: Design, pairs: _Pairs, *, first: Vector, second: Vector, stride: int = 1) -> Vector:
    """Compute V_jk for pairs of levels from `first` = Σ n Cov and `second` = Σ n Cov² over lags with n pairs."""
    scale = 4 * pairs.areas
    total = 2 / scale**2 * second
    # Change of the mean of the model per sample.
    if slope := sum(float(process.mean(1.0) - process.mean(0.0)) for process in model.processes):
        total += slope**2 * pairs.areas / scale * first
    present = [process for process in model.processes if process.scale > 0]
    if design.efficiency is None and (cumulant := sum(process.error_cumulant for process in present)):
        # Not for robust estimates: a smaller variance and a larger mean nearly cancel in the relative variance.
        halves = (pairs.half[levels].tobytes() for levels in (pairs.finer, pairs.coarser))
        total += cumulant * _excess(*halves, design.samples) / stride / scale**2
    return np.asarray(total / pairs.sizes)


def _powers(
    present: list[Process], pairs: _Pairs, design: Design, covariance: Vector, weight: Vector,
    starts: NDArray[np.int64],
) -> tuple[Vector, Vector]:  # fmt: skip
    """Compute the same as `_Split.powers` from the covariances at nodes."""
    assert design.efficiency is not None
    half = pairs.half
    own = nodes.coefficient_covariance(present, LagGrid(half, half, np.zeros_like(half)), design.rate)
    size = pairs.outer(own)
    # If all processes are zero, the correlation is not defined and the covariance is zero.
    squares = covariance**2 / np.repeat(np.where(size > 0, size, 1.0), np.diff(starts, append=covariance.size))
    terms = weight * squares**2 * np.polyval(hermite_weights(design.efficiency)[:0:-1] / 2, squares)
    return own, np.asarray(np.add.reduceat(terms, starts))


@lru_cache(maxsize=2 * EXACT_LENGTHS)
def _excess(finer: bytes, coarser: bytes, samples: int) -> Vector:
    """Compute the factor Σ_a Σ_b c_a² c_b² n(b − a) of κ₄, c = (1, −2, 1) at 0, h and 2h, for pairs of half-scales."""
    fine, coarse = np.frombuffer(finer), np.frombuffer(coarser)
    total = np.zeros(fine.size)
    for a, weight_a in ((0, 1.0), (1, 4.0), (2, 1.0)):
        for b, weight_b in ((0, 1.0), (1, 4.0), (2, 1.0)):
            lag = b * coarse - a * fine
            first = np.maximum(2 * fine - 1, 2 * coarse - 1 - lag)
            last = samples - 1 - np.maximum(lag, 0.0)
            total += weight_a * weight_b * np.maximum(last - first + 1, 0.0)
    return freeze(total)
