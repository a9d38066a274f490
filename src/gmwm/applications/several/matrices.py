"""Covariance matrices of wavelet coefficients of synchronous signals, as moments with their exact covariance.

X = Σ_p L_p u_p, with wavelet variances κ_pj of u_p and Σ_p = L_p L_pᵀ, has Γ_j = Σ_p κ_pj Σ_p, whose estimates have

    Cov(γ̂_ab,j, γ̂_cd,k) = Σ_p Σ_q (Σp_ac Σq_bd + Σp_ad Σq_bc) G_pq,jk,   G_pq,jk = Σ_u n(u) κ_p(u) κ_q(u) / (M_j M_k),

with κ_p(u) = Cov(W_j,t, W_k,t+u), and n(u) pairs of the M_j and M_k coefficients at lag u."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations
from typing import Any, TypeVar

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector, as_rate, as_vector
from gmwm.base.errors import DataError, OptionError
from gmwm.base.units import AXES, SI_UNIT, axis_quantity
from gmwm.measuring.covariance import gaussian, nodes
from gmwm.measuring.covariance.api import covariance
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.segments import pooled
from gmwm.measuring.variance.api import variances_alone, wavelet_variance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.gaps import fill_gaps
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.filters import HAAR
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model


def synchronous_signals(x: Any, rate: float | None, *, fill: bool = True) -> dict[str, Signal]:
    """Return the signals by name, after a check that they are synchronous. With `fill`, short gaps are filled."""
    x = x.signals if isinstance(x, Imu) else x
    if not isinstance(x, Mapping):
        raise DataError(argument="x", expected="a recording, or a mapping of names to signals", got=x)
    signals: dict[str, Signal] = {}
    for name, item in x.items():
        if not isinstance(item, Signal):
            # As in `Imu.from_arrays`, arrays of the axes of an IMU are in SI units. "gyro_x[2]" is an axis of unit 2.
            axis = name.partition("[")[0].strip()
            unit = SI_UNIT[axis_quantity(axis)] if axis in AXES else ""
            item = Signal(as_vector(item, name), as_rate(rate), unit, name)
        elif rate is not None and as_rate(rate) != item.rate:
            raise DataError(f"rate={rate:g} contradicts the rate of {name}, {item.rate:g} Hz", argument="rate")
        signals[name] = item
    if len(signals) < 2:
        raise DataError(argument="x", expected="at least two signals", got=list(signals))
    first, *others = signals
    reference = signals[first]
    for name in others:
        other = signals[name]
        for what, same in (
            ("rate", other.rate == reference.rate),
            ("length", other.values.size == reference.values.size),
            ("gaps", other.segments == reference.segments),
        ):
            if not same:
                raise DataError(
                    f"{first} and {name} differ in their {what}", argument="x",
                    advice="Pass signals that were sampled together.",
                )  # fmt: skip
    return fill_gaps(signals) if fill else signals


def chosen_names(names: Sequence[str], axes: str | Sequence[str] | None) -> list[str]:
    """Return the names of the signals that `axes` selects by name or by sensor; all by default."""
    if axes is None:
        return list(names)
    selection = [axes] if isinstance(axes, str) else list(axes)
    chosen = [name for name in names if any(name == choice or name.startswith(f"{choice}_") for choice in selection)]
    missing = [
        choice for choice in selection if not any(name == choice or name.startswith(f"{choice}_") for name in chosen)
    ]
    if missing or len(chosen) < 2:
        raise OptionError(argument="axes", expected=f"two or more of {', '.join(names)}", got=axes)
    return chosen


T = TypeVar("T")


class AxisPairs(dict[tuple[str, str], T]):
    """Values of pairs of axes. The order of the two names of a pair does not matter.

    >>> pairs = AxisPairs({("gyro_x", "gyro_y"): 0.1})
    >>> pairs["gyro_y", "gyro_x"]
    0.1
    """

    def __missing__(self, pair: Any) -> T:
        if pair in self:
            return self[pair[::-1]]
        axes = sorted({axis for key in self for axis in key})
        raise DataError(argument="pair", expected=f"two different names of {', '.join(axes)}", got=pair)

    def get(self, pair: tuple[str, str], default: Any = None) -> Any:
        """Return the value of a pair, or `default` if there is none."""
        return super().get(pair, super().get(pair[::-1], default))

    def __contains__(self, pair: object) -> bool:
        return super().__contains__(pair) or (isinstance(pair, tuple) and super().__contains__(pair[::-1]))


def pairs_of(axes: Sequence[str]) -> list[tuple[str, str]]:
    """Return all pairs of different axes, in the order of the axes."""
    return list(combinations(axes, 2))


@dataclass(frozen=True, kw_only=True, eq=False)
class WaveletMatrices:
    """Estimated covariance matrices Γ̂_j of the wavelet coefficients of d signals."""

    names: tuple[str, ...]  # names of the d signals
    values: Matrix  # (J, d, d) Γ̂_j, in the squared unit of the signals
    design: Design  # levels, sampling rate and length, which are the same for all signals

    @property
    def tau(self) -> Vector:
        """Scales τ_j (J,), in seconds."""
        return np.asarray(np.exp2(self.design.levels.astype(np.float64)) / self.design.rate)


def wavelet_matrices(signals: Mapping[str, Signal]) -> WaveletMatrices:
    """Estimate the covariance matrices of synchronous signals, in one pass over each signal and pair."""
    curves = {name: measure(signal, False, 0.6) for name, signal in signals.items()}
    unit = units_of(curves)
    names = list(signals)
    first = curves[names[0]]
    values = np.empty((len(first), len(names), len(names)))
    for k, name in enumerate(names):
        values[:, k, k] = curves[name].variance
    for a, b in pairs_of(names):
        j, k = names.index(a), names.index(b)
        values[:, j, k] = values[:, k, j] = product_moment(signals, curves, unit, pair=(a, b))
    return WaveletMatrices(names=tuple(names), values=values, design=replace(Design.of(first), excess=None))


def units_of(curves: Mapping[str, WaveletVariance]) -> dict[str, float]:
    """Return factors that scale each wavelet variance to the geometric mean 1, so that differences are accurate."""
    short = next((name for name, wv in curves.items() if not np.all(wv.variance > 0)), None)
    if short is not None:
        raise DataError(
            f"{short} has no noise at some scales: its wavelet variance is 0", argument="x",
            advice=f"Leave {short} out.",
        )  # fmt: skip
    return {name: math.exp(-0.5 * float(np.mean(np.log(wv.variance)))) for name, wv in curves.items()}


def measure(signal: Signal, robust: bool, efficiency: float) -> WaveletVariance:
    """Return the wavelet variance of a signal whose short gaps are already filled."""
    return wavelet_variance(signal, robust=robust, efficiency=efficiency, fill_gaps=False)


def product_moment(
    signals: Mapping[str, Signal], singles: Mapping[str, WaveletVariance], unit: Mapping[str, float], *,
    pair: tuple[str, str],
) -> Vector:  # fmt: skip
    """Return the cross-covariance γ̂_j (J,) of a pair of signals, from the variance of their sum and difference."""
    a, b = pair
    curves = []
    for sign in (1.0, -1.0) if singles[a].robust else (1.0,):
        values = unit[a] * signals[a].values + sign * unit[b] * signals[b].values
        segments = [values[first:last] for first, last in signals[a].segments]
        curves.append(
            variances_alone(segments, HAAR, "modwt", levels=len(singles[a]), efficiency=singles[a].efficiency)
        )
    return moment_of(curves, singles, unit, pair=pair)


def moment_of(
    curves: Sequence[Vector], singles: Mapping[str, WaveletVariance], unit: Mapping[str, float], *,
    pair: tuple[str, str],
) -> Vector:  # fmt: skip
    """Return γ̂_j (J,) from the variances of the sum of the scaled signals and, if measured, of their difference."""
    a, b = pair
    if len(curves) == 2:
        gamma = (curves[0] - curves[1]) / 4
    else:
        # The variance of the difference follows from the variances of the signals: ν²₊ + ν²₋ = 2 (ν_a² + ν_b²).
        gamma = (curves[0] - unit[a] ** 2 * singles[a].variance - unit[b] ** 2 * singles[b].variance) / 2
    return np.asarray(gamma / (unit[a] * unit[b]))


@lru_cache(maxsize=32)
def entries(d: int) -> tuple[Integers, Integers]:
    """Return the rows a and columns b of the d(d + 1)/2 entries with a ≤ b of a symmetric matrix."""
    rows, columns = np.triu_indices(d)
    return rows.astype(np.int64), columns.astype(np.int64)


def stack(matrices: Matrix) -> Vector:
    """Return matrices Γ (J, d, d) as a vector of moments: all levels of entry (0, 0), then of (0, 1), and so on."""
    rows, columns = entries(matrices.shape[-1])
    return np.ascontiguousarray(matrices[:, rows, columns].T).ravel()


def symmetric(values: Matrix, d: int) -> Matrix:
    """Return symmetric matrices (…, d, d) with the given entries (…, d(d + 1)/2)."""
    rows, columns = entries(d)
    out = np.empty((*values.shape[:-1], d, d))
    out[..., rows, columns] = values
    out[..., columns, rows] = values
    return out


def lag_products(processes: Sequence[Process], design: Design) -> Matrix:
    """Return G (P, P, J, J) of processes at unit scale."""
    if design.filled:
        raise NotImplementedError("a design without filled samples is expected")
    count, size = len(processes), design.levels.size
    if design.segments:
        out = np.zeros((count, count, size, size))
        for p in range(count):
            for q in range(p + 1):
                pair = (processes[p], processes[q])
                product = pooled(design, lambda segment, pair=pair: lag_products(pair, segment)[0, 1])  # type: ignore[misc]
                out[p, q] = out[q, p] = product
        return out
    if not all(gaussian.knows(Model((process,)), design) for process in processes):
        return _by_polarisation(processes, design)
    return _over_lags(processes, design)


def _over_lags(processes: Sequence[Process], design: Design) -> Matrix:
    """Return G as a sum over the same lags that the covariance of the wavelet variance of one signal uses."""
    at, weight, starts = nodes.lags(list(processes), design, diagonal=False)
    coarser, finer = np.tril_indices(design.levels.size)
    half, counts = np.ldexp(1.0, design.levels - 1), design.counts.astype(np.float64)
    scale = (4 * half[finer] * half[coarser]) ** 2 * counts[finer] * counts[coarser]
    shapes = [process.coefficient_covariance(at, design.rate) for process in processes]
    count, size = len(processes), design.levels.size
    out = np.empty((count, count, size, size))
    for p, shape in enumerate(shapes):
        weighted = weight * shape
        for q in range(p + 1):
            products = np.add.reduceat(weighted * shapes[q], starts) / scale
            for r, s in ((p, q), (q, p)):
                out[r, s, finer, coarser] = out[r, s, coarser, finer] = products
    return out


def _by_polarisation(processes: Sequence[Process], design: Design) -> Matrix:
    """Return G from covariances V of wavelet variances: V_{p+q} = V_p + V_q + 4 G_pq, and V_p = 2 G_pp."""
    singles = [covariance(Model((process,)), design) for process in processes]
    count, size = len(processes), design.levels.size
    out = np.empty((count, count, size, size))
    for p, process in enumerate(processes):
        out[p, p] = singles[p] / 2
        for q in range(p):
            both = covariance(Model((process, processes[q])), design)
            out[p, q] = out[q, p] = (both - singles[p] - singles[q]) / 4
    return out


def moment_covariance(sigmas: Matrix, products: Matrix) -> Matrix:
    """Return the covariance V (n, n) of the stacked moments for matrices Σ (P, d, d) and products G (P, P, J, J)."""
    d, size = sigmas.shape[-1], products.shape[-1]
    rows, columns = entries(d)
    count = rows.size
    out = np.empty((count, size, count, size))
    flat = products.reshape(len(sigmas) ** 2, size * size)
    for k in range(count):
        a, b = rows[k], columns[k]
        c, e = rows[: k + 1], columns[: k + 1]
        pairs = sigmas[:, None, a, c] * sigmas[None, :, b, e] + sigmas[:, None, a, e] * sigmas[None, :, b, c]
        block = (pairs.reshape(len(flat), -1).T @ flat).reshape(-1, size, size)
        out[k, :, : k + 1] = block.transpose(1, 0, 2)
        out[: k + 1, :, k] = block.transpose(0, 2, 1)
    return out.reshape(count * size, count * size)
