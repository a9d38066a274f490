"""Prepare the covariates of a recording (block means, scales that are used) and compute the columns of a regression:
powers, splines and rates of change of covariates, and functions of time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.errors import DataError, OptionError
from gmwm.base.lazy import scipy
from gmwm.base.time_base import times_of
from gmwm.measuring.regression.against import OFFSETS, SEASON, STEP, TEMPERATURE, TIME, WARM_UP, CovariateTerm
from gmwm.measuring.regression.blocks import BlockClock
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.recording.resolution import lsb
from gmwm.recording.signals import Signal

LEAST_COVARIATE_RATIO = 10.0
"""A scale is used if the wavelet variance of the covariate is at least this number times that of its reading error. The
error makes a coefficient from all used scales too small by less than 1 % (docs/validation/regression.md)."""


@dataclass(frozen=True, eq=False)
class Covariates:
    """The covariates of a regression on the blocks (`clock`) of a recording; time in hours.

    `means` are interpolated where a block is empty. The effect comes from `smooth`, without quantization steps, and
    `exact` samples. At level `lowest` and above, reading errors are small; they are averaged over `block` samples."""

    basis: Basis
    clock: BlockClock
    means: Mapping[str, Vector]
    smooth: Mapping[str, Vector]
    exact: Mapping[str, Vector]
    ranges: Mapping[str, tuple[float, float]]
    lowest: int
    block: int

    @classmethod
    def of(cls, terms: Sequence[CovariateTerm], arrays: Mapping[str, Vector], signal: Signal) -> Covariates:
        """Prepare covariates at the times of `signal`; raise DataError for a missing, constant or inaccurate one."""
        usual = 1 if any(term.exact and term.is_measured for term in terms) else None
        clock = BlockClock.of(signal.rate, signal.segments, signal.starts, length=usual)
        terms = [term.within(signal.start, clock.end / clock.rate, clock.rate) for term in terms]
        # The mean over 1/64 of a season has an amplitude that is smaller by 0.04 %.
        longest = min((term.seconds * clock.rate / 64 for term in terms if term.kind == SEASON), default=np.inf)
        while clock.length > max(longest, 1):
            clock = replace(clock, length=clock.length // 2)
        block, lowest, values_by_name, smooth = clock.length, 1, dict(arrays), dict(arrays)
        for term in terms:
            if term.is_measured:
                values = _require_usable(term, values_by_name, signal)
                if not term.exact:
                    level, step = as_known(term.name, values, signal)
                    # The mean over a block has a smaller reading error, but not if the error is a rounding error.
                    least = 1 << max(level - (4 if step else 1), 0)
                    if step or least > clock.length:
                        lowest = max(lowest, level if step else level + 1)
                    block = max(block, least)
                    smooth[term.name] = without_steps(values, step) if step else values
        coarse = replace(clock, length=block)
        names = [term.name for term in terms if term.is_measured]
        means = {name: coarse.onto(coarse.means(values_by_name[name]), clock) for name in names}
        covariates = cls.on(clock, terms, means, values_by_name, lowest=lowest, block=block)
        return replace(covariates, smooth={name: coarse.onto(coarse.means(smooth[name]), clock) for name in names})

    @classmethod
    def slow(cls, term: CovariateTerm, values: Vector, signal: Signal) -> Covariates:
        """Prepare one slow covariate from block means, even if it is exact; errors are as for `of`."""
        if not term.exact:
            return cls.of([term], {term.name: values}, signal)
        _require_usable(term, {term.name: values}, signal)
        clock = BlockClock.of(signal.rate, signal.segments, signal.starts)
        # An empty block gets an interpolated value.
        means = {term.name: clock.onto(clock.means(values), clock)}
        return cls.on(clock, [replace(term, exact=False)], means, {}, lowest=1, block=clock.length)

    @classmethod
    def on(
        cls, clock: BlockClock, terms: Sequence[CovariateTerm], means: Mapping[str, Vector],
        arrays: Mapping[str, Vector], *, lowest: int, block: int,
    ) -> Covariates:  # fmt: skip
        """Prepare covariates from their block means. The attributes of the class describe `lowest` and `block`."""
        # Smallest number of blocks for a regression. They contain five scales.
        fewest_blocks = 32
        present = clock.present()
        if np.count_nonzero(present) < fewest_blocks:
            raise DataError(
                f"a regression needs at least {fewest_blocks} blocks of {clock.length / clock.rate:g} s; the recording "
                f"has {int(np.count_nonzero(present))}",
                argument="against",
                advice="Record for longer, or use {--against=none}.",
            )
        at = clock.times
        references, ranges = {}, {}
        for term in terms:
            if term.kind in (OFFSETS, SEASON, STEP):
                continue
            covariate = means.get(term.name, at / term.seconds if term.name == TIME else at)
            low, high = float(np.min(covariate[present])), float(np.max(covariate[present]))
            # The reference is rounded to three digits of the range, so that it is a short number in reports.
            digits = 2 - int(np.floor(np.log10(high - low))) if high > low else 3
            references[term.name] = 0.0 if term.name == WARM_UP else round(float(np.mean(covariate[present])), digits)
            ranges[term.name] = (low, high)
        exact = {term.name: arrays[term.name] for term in terms if term.exact and term.is_measured}
        bare = cls(
            basis=Basis((), references, {}), clock=clock,
            means={name: freeze(covariate) for name, covariate in means.items()}, smooth=dict(means),
            exact=exact, ranges=ranges, lowest=lowest, block=block,
        )  # fmt: skip
        return bare.having(tuple(terms))

    @property
    def unknown_levels(self) -> int:
        """Number of finest levels of the block means that are not used because of reading errors of the covariates."""
        return max(self.lowest - self.clock.length.bit_length(), 0)

    @property
    def own_offsets(self) -> bool:
        """Whether every part of the recording without a gap has an offset of its own."""
        return any(term.name == OFFSETS for term in self.basis.terms)

    def having(self, terms: tuple[CovariateTerm, ...]) -> Covariates:
        """Return the same covariates with other terms (forms of their effects)."""
        knots = {
            term.name: tuple(np.linspace(*self.ranges[term.name], term.knots + 2).tolist())
            for term in terms
            if term.knots
        }
        return replace(self, basis=Basis(terms, self.basis.references, knots))

    def matrix(self, tau: float | None = None, *, smooth: bool = False) -> Matrix:
        """Return the columns (n, p) at the blocks; `tau` (s) of a warm-up, `smooth` for the subtracted effect."""
        width = self.clock.length / self.clock.rate if self.clock.length > 1 else 0.0
        return self.basis.matrix(self.smooth if smooth else self.means, self.clock.times, tau, width)

    def effect(self, coefficients: Vector, tau: float | None, first: int, last: int) -> Vector:
        """Return the effect X β of coefficients β with the columns X at the samples first … last − 1."""
        if not any(term.exact for term in self.basis.terms):
            return self.clock.interpolate(self.matrix(tau, smooth=True) @ coefficients, first, last)
        clock = self.clock
        starts = [place / clock.rate for place in clock.offsets]
        times = times_of(np.arange(first, last), clock.rate, clock.segments, starts)
        values = {
            name: self.exact[name][first:last] if name in self.exact else clock.interpolate(covariate, first, last)
            for name, covariate in self.smooth.items()
        }
        return np.asarray(self.basis.matrix(values, times, tau) @ coefficients)


def _require_usable(term: CovariateTerm, arrays: Mapping[str, Vector], signal: Signal) -> Vector:
    values = arrays.get(term.name)
    if values is None:
        names = ", ".join([*arrays, TIME, WARM_UP, f"{SEASON}1y", f"{STEP}2000d"])
        raise OptionError(
            f"against: there is no {term.name!r} beside {signal.axis or 'the signal'}; known are {names}",
            argument="against",
            got=term.name,
            advice="In Python, pass its samples: `against={{{name}: values}}`." if term.name != TEMPERATURE else
            "Name the column of the temperature with {--columns=temperature:…}, or use {--against=warmup}.",
            name=repr(term.name),
        )  # fmt: skip
    if values.size != len(signal):
        raise DataError(
            f"{term.name} has {values.size} values for {len(signal)} samples", argument="against", got=values
        )
    bad = int(np.count_nonzero(~np.isfinite(values)))
    if bad:
        raise DataError(
            f"{term.name} has {bad} values that are not finite, the first at index "
            f"{int(np.argmax(~np.isfinite(values)))}",
            argument="against",
            advice="Interpolate them, or leave these times out with {--skip}.",
        )
    if not np.ptp(values) > 0:
        raise DataError(f"{term.name} is constant, so that nothing can follow it", argument="against")
    return values


def as_known(name: str, values: Vector, signal: Signal) -> tuple[int, float]:
    """Return the finest level with a small reading error, and the quantization step, 0 if noise dithers readings (means
    are then accurate). DataError without such a level, or with too few blocks of its scale."""
    step = lsb(values)
    step = 0.0 if step is None or _is_dithered(values) else step
    level = known_level(values, signal, step)
    # Smallest number of blocks of the shortest scale that is used. Two scales are then used.
    if level is None or len(signal) >> (level - 1) < 8:
        raise DataError(
            f"the covariate {name} changes by no more than its reading error at the scales of this recording",
            argument="against",
            advice="Use {--against=none}, or record over a larger range. If its values are exact, such as set points, "
            "write `{name}:exact`.",
            name=name,
        )
    return level, step


def known_level(values: Vector, signal: Signal, step: float) -> int | None:
    """Return the finest level with `LEAST_COVARIATE_RATIO` times the variance of a covariate's reading error. Beyond
    held readings, the error is white, so its variance falls with the scale until the covariate dominates. Without
    noise, quantization steps q have q²/12, used at every scale."""
    curve = wavelet_variance(replace(signal, values=values, unit="", axis="")).variance
    run = values.size / max(int(np.count_nonzero(values[1:] != values[:-1])), 1)  # samples with the same reading
    valley = 0 if step else min(max(int(np.ceil(np.log2(run))), 0), curve.size - 1)
    while valley + 1 < curve.size and curve[valley + 1] < curve[valley]:
        valley += 1
    # A covariate with quantization step q must have a wavelet variance of at least this number times q² at some scale.
    # If it changes by four steps in all, a coefficient is too small by 4 % (docs/validation/regression.md).
    if np.max(curve) < 2.5 * step**2:
        return None
    at = np.arange(curve.size)
    error = np.maximum(1 / 12 * step**2, curve[valley] * 2.0 ** (valley - at))
    passed = (curve >= LEAST_COVARIATE_RATIO * error) & (at > valley)
    return int(np.argmax(passed)) + 1 if np.any(passed) else None


def without_steps(values: Vector, step: float) -> Vector:
    """Smooth a quantized series by a spline through its changes, within half a step; not if it often jumps back."""
    at = np.flatnonzero(values[1:] != values[:-1])
    middle = (values[at] + values[at + 1]) / 2
    if at.size < 4 or np.count_nonzero(middle[1:] == middle[:-1]) > 0.3 * at.size:
        return values
    places = np.clip(np.arange(values.size, dtype=np.float64), at[0] + 0.5, at[-1] + 0.5)
    return np.clip(scipy.interpolate.CubicSpline(at + 0.5, middle)(places), values - step / 2, values + step / 2)


def _is_dithered(values: Vector) -> bool:
    """Return whether a quantized reading jumps up and down in nearly all windows, so that its mean is not quantized."""
    # Number of windows; a quantized covariate that moves up and down in nearly all of them is dithered.
    count = 256
    changes = np.flatnonzero(values[1:] != values[:-1])
    rises = values[changes + 1] > values[changes]
    turns = changes[1:][rises[1:] != rises[:-1]]
    windows = np.unique(turns * count // values.size)
    return windows.size >= 0.9 * count


_SIGNS = {2: "²", 3: "³", 4: "⁴", 5: "⁵"}


@dataclass(frozen=True)
class Column:
    """One column of a covariate, such as "temperature^2", "temperature lag" or "warmup tau", and its unit."""

    name: str
    term: str
    power: str = ""


@dataclass(frozen=True)
class Basis:
    """The terms of a regression, the values of covariates (time in hours) without effect, and all knots of splines."""

    terms: tuple[CovariateTerm, ...]
    references: Mapping[str, float]
    knots: Mapping[str, tuple[float, ...]]

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns, in the order of the terms."""
        return tuple(column for term in self.terms for column in _columns(term))

    def matrix(self, values: Mapping[str, Vector], times: Vector, tau: float | None, width: float = 0.0) -> Matrix:
        """Return the columns (n, p) at times (s), with the time constant (s); a step is averaged over `width` (s)."""
        arrays = [values.get(term.name, times) for term in self.terms]
        pairs = zip(self.terms, arrays, strict=True)
        return np.hstack([self._of_term(term, array, times, tau, width=width) for term, array in pairs])

    def along(self, name: str, points: Vector) -> Matrix:
        """Return the columns (m, p) for values of one covariate, with zero for others and rates of change."""
        parts = []
        for term in self.terms:
            if term.name == name:
                points_or_times = points * term.seconds if name == TIME else points
                parts.append(self._of_term(replace(term, lag=False), points_or_times, points, None, width=0.0))
                parts += [np.zeros((points.size, 1))] * term.lag
            else:
                parts.append(np.zeros((points.size, len(_columns(term)))))
        return np.hstack(parts)

    def _of_term(self, term: CovariateTerm, values: Vector, times: Vector, tau: float | None, width: float) -> Matrix:
        if term.name == OFFSETS:
            return np.empty((times.size, 0))
        if term.name == WARM_UP:
            assert tau is not None
            decay = np.exp(-times / tau)
            return np.column_stack([decay, times / tau * decay])
        if term.kind == SEASON:
            turn = 2 * np.pi / term.seconds * times
            return np.column_stack([np.cos(turn), np.sin(turn)])
        if term.kind == STEP:
            after = times[:, None] - term.seconds
            return np.clip(after / width + 0.5, 0.0, 1.0) if width else (after >= 0).astype(np.float64)
        covariate = values / term.seconds if term.name == TIME else values
        offsets = covariate - self.references[term.name]
        columns = [offsets**power for power in range(1, term.degree + 1)]
        if term.knots:
            at_reference = _spline(np.array([self.references[term.name]]), self.knots[term.name])
            curved = _spline(covariate, self.knots[term.name])
            columns += [curve - zero for curve, zero in zip(curved, at_reference, strict=True)]
        if term.lag:
            columns.append(np.gradient(values, times))
        return np.column_stack(columns)


def _columns(term: CovariateTerm) -> list[Column]:
    name, unit = term.name, term.unit
    if name == OFFSETS:
        return []
    if term.kind == SEASON:
        return [Column(f"{name} cos", name), Column(f"{name} sin", name)]
    if name == WARM_UP:
        return [Column(name, name), Column(f"{name} tau", name)]
    columns = [Column(name, name, unit)]
    columns += [Column(f"{name}^{k}", name, unit and unit + _SIGNS[k]) for k in range(2, term.degree + 1)]
    columns += [Column(f"{name} knot {k}", name, unit) for k in range(1, term.knots + 1)]
    if term.lag:
        columns.append(Column(f"{name} lag", name, unit and f"{unit}/s"))
    return columns


def _spline(values: Vector, knots: tuple[float, ...]) -> list[Vector]:
    """Return the nonlinear columns of a natural cubic spline (Hastie, Tibshirani and Friedman 2009, eq. 5.4)."""
    at, last = np.array(knots), knots[-1]
    width = last - at[0]

    def part(k: int) -> Vector:
        cubes = np.maximum(values - at[k], 0.0) ** 3 - np.maximum(values - last, 0.0) ** 3
        return np.asarray(cubes / (last - at[k]) / width)

    end = part(len(knots) - 2)
    return [part(k) - end for k in range(len(knots) - 2)]
