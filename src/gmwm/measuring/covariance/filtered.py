"""Covariance of the wavelet variance of a Gaussian signal, for any wavelet filter and both transforms.

With the generalised covariance A of the signal, filters h_{j,l} and D_j(v) = Σ_l h_{j,l} A(v − l), C_jk(u) =
Cov(W_{j,t}, W_{k,t+u}) = Σ_l h_{k,l} D_j(l − u). The pyramid algorithm computes both. The filters sum to zero, so a
constant in A cancels, and no difference of large numbers occurs.

C_jk hardly changes over a small part of 2^j lags (j is finer). The scaling coefficients at every 2^i-th sample have the
covariance A_i(m) = Σ_n r_g(n) A_{i−1}(2m − n), with the autocorrelation r_g of the scaling filter. C_jk at every 2^i-th
lag is their C_{j−i,k−i}, which reduces the cost of coarse levels. Lags with negligible D_j are left out."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.errors import MissingTheoryError
from gmwm.base.threads import check_stop
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.robust import hermite_weights
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes import filtered
from gmwm.theory.processes.model import Model

LONGEST_SAMPLES = 2**26
"""Length (samples) of the longest recording, for which each of a few arrays takes half a gigabyte."""
# tests/covariance/test_filtered.py compares the results with sums over all lags, and pins the constants below.
OVERSAMPLED = 4
"""The lags of a pair of levels are 2^(j − OVERSAMPLED) apart (j is finer), or closer if V_jj changes by `_ALIKE`."""
LEAST_LAGS = 2**15  # smallest number of positive lags in a sum, unless the recording is shorter
_ALIKE = 2e-5  # largest relative change of V_jj with twice as many lags for which a spacing of lags is accepted


def covariance(model: Model, design: Design) -> Matrix:
    """Compute V (J, J), in u⁴: exact for N < 32768 and if decimated, otherwise within 2e-5 of the diagonal."""
    lags = Lags(model, design)
    v = np.zeros((design.levels.size, design.levels.size))
    for a in range(design.levels.size):
        v[a, a:] = v[a:, a] = lags.row(a, lags.stage(a), design.levels.size)
    return v


def variances(model: Model, design: Design) -> Vector:
    """Compute the diagonal (J,) of V, in u⁴."""
    lags = Lags(model, design)
    return np.array([lags.row(a, lags.stage(a), a + 1)[0] for a in range(design.levels.size)])


def ratio_variances(model: Model, design: Design) -> Vector:
    """Compute Var log(ν̂_j²/ν̃_j²) (J,), the difference of V_jj/ν_j⁴ of the robust and the classical estimate."""
    lags = Lags(model, design, beyond=True)
    excess = np.array([lags.row(a, lags.stage(a), a + 1)[0] for a in range(design.levels.size)])
    return np.asarray(excess / np.where(lags.own > 0, lags.own, 1.0) ** 2)


class Lags:
    """Sums over lags that give V; with `beyond`, only the terms of the robust expansion after the first."""

    def __init__(self, model: Model, design: Design, *, beyond: bool = False) -> None:
        self.design, self.beyond, self.few = design, beyond, design.few
        self.known = [_signal_covariance(model, design)]
        self.smooth: dict[int, tuple[int, int, Vector]] = {}
        self.cross: dict[tuple[int, int], tuple[int, Vector]] = {}
        self.mean = means(model, design)
        # A classical estimate needs no variances of the coefficients.
        self.own = np.ones(design.levels.size)
        if design.efficiency is not None:
            self.own = filtered.autocovariance_variance(self.known[0], design.filter, design.levels)
        # The cumulant of uniform errors hardly changes a robust estimate and is left out.
        present = [] if design.efficiency is not None else [p for p in model.processes if p.scale > 0]
        self.cumulant = sum(process.error_cumulant for process in present)
        deepest = int(design.levels[-1]) if self.cumulant else 0
        # Longer filters make sums of uniform errors nearly Gaussian, without a fourth cumulant.
        self.error_filters = filtered.error_filters(design.filter, deepest, 256)

    def stage(self, a: int) -> int:
        """Return the largest `stage` with which lags 2^stage apart are accurate for V_jj, and so for V_jk."""
        level = int(self.design.levels[a])
        if self.design.transform == "dwt":
            return level - 1
        stage = max(0, min(level - OVERSAMPLED, (self.design.samples // LEAST_LAGS).bit_length() - 1))
        value = self.row(a, stage, a + 1)[0] if stage else 0.0
        while stage > 0:
            finer = self.row(a, stage - 1, a + 1)[0]
            if abs(value - finer) <= _ALIKE * finer:
                break
            stage, value = stage - 1, finer
        return stage

    def row(self, a: int, stage: int, end: int) -> Vector:
        """Compute V_jk for the levels at indices a and a … `end` − 1, from lags 2^stage apart."""
        design = self.design
        sums = [
            weighed(self._terms(values, a, b), first, stage=stage, design=design, a=a, b=b)
            for b, first, values in self.covariances(a, stage, end)
        ]
        total = np.array(sums) + self._excess(a, end)
        return np.asarray(total / design.counts[a] / design.counts[a:end])

    def covariances(self, a: int, stage: int, end: int) -> Iterator[tuple[int, int, Vector]]:
        """Yield, for each level k, its index, the first lag over 2^stage, and Cov(W_{j,t}, W_{k,t+u}) at these lags."""
        while len(self.known) <= stage:
            # A_i at all lags of the recording from A_{i−1}.
            reach, g = self.design.filter.length - 1, self.design.filter.scaling / np.sqrt(2.0)
            both = np.concatenate([self.known[-1][reach:0:-1], self.known[-1]])
            self.known.append(np.convolve(both, np.correlate(g, g, "full"), "valid")[::2].copy())
        below = (self.design.levels[a:end] - stage).tolist()
        pairs = _against(self._with_signal(stage, below[0]), self.known[stage].size, self.design.filter, below)
        for b, (first, values) in enumerate(pairs, a):
            check_stop()
            yield b, first, values

    def _with_signal(self, stage: int, level: int) -> tuple[int, Vector]:
        """Return Cov(W_{j,t}, X_{t+u}), as the first lag and values at all lags with a pair that are not negligible. X
        are the scaling coefficients of level `stage`, and `level` is the level j minus `stage`."""
        filter, known, far = self.design.filter, self.known[stage], self.known[stage].size - 1
        done, first, smooth = self.smooth.get(stage, (0, -far, known))
        if not done:
            # Beyond its memory, a stationary process has no covariance, so the lags there need no sums.
            size = np.abs(known - known[-1])
            memory = int(np.flatnonzero(size > np.finfo(float).eps * size.max()).max(initial=0)) + 1
            part = known[:memory] - known[-1] if memory < known.size // 2 else known
            first, smooth = 1 - part.size, np.concatenate([part[:0:-1], part])
        while done < level:
            check_stop()
            done += 1
            step = (filter.length - 1) << (done - 1)
            front, behind = (min(step, room) for room in (first + far, far + 1 - first - smooth.size))
            padded = np.zeros(front + smooth.size + behind)
            padded[front : front + smooth.size] = smooth
            smooth, detail = (values[front:] for values in _step(padded, filter, done))
            # Values that need lags beyond the recording are left out; the result is D_j(−u).
            begin = max(0, filter.width(done) - 1 - far - first)
            self.cross[stage, done] = _cropped(detail[begin:][::-1], 1 - first - detail.size)
        self.smooth[stage] = done, first, smooth
        return self.cross[stage, level]

    def _terms(self, values: Vector, a: int, b: int) -> Vector:
        """Compute the covariance of squared (or robust) coefficients from that of the coefficients."""
        terms = values * values
        if self.design.efficiency is None or self.few[a] or self.few[b]:
            terms *= 2.0
        else:
            terms = _robust(terms, float(self.own[a] * self.own[b]), self.design.efficiency)
        if self.beyond:
            return np.asarray(terms - 2.0 * values * values)
        if self.mean[a] * self.mean[b] != 0:
            terms += 4.0 * self.mean[a] * self.mean[b] * values
        return terms

    def _excess(self, a: int, end: int) -> Vector:
        """Compute the contribution κ₄ Σ_l Σ_m d_{j,l}² d_{k,m}² n(m − l) of non-Gaussian errors e_t, W_{j,t} = Σ_l
        d_{j,l} e_{t−l}; j and k are as for `row`."""
        total = np.zeros(end - a)
        fine, filters = int(self.design.levels[a]), self.error_filters
        for b in range(a, end):
            coarse = int(self.design.levels[b])
            if coarse > len(filters):
                break
            (early, first), (late, second) = filters[fine - 1], filters[coarse - 1]
            pairs = _pairs(self.design, a, b, late - early[:, None])
            total[b - a] = self.cumulant * float(first**2 @ pairs @ second**2)
        return total


def _pairs(design: Design, a: int, b: int, lags: Integers) -> Matrix:
    """Return the number n(u) of pairs of coefficients at the lags u, for the levels at indices a and b."""
    if design.transform == "dwt":
        apart = 1 << int(design.levels[a])
        return np.where(lags % apart == 0, _decimated_pairs(design, a, b, lags // apart), 0.0)
    fine, coarse = (design.filter.width(int(design.levels[place])) for place in (a, b))
    size = design.samples
    n = np.minimum(np.minimum(lags - (coarse - size - 1), (size - fine + 1) - lags), size - coarse + 1)
    return np.asarray(np.maximum(n, 0), dtype=np.float64)


def _robust(squares: Vector, size: float, efficiency: float) -> Vector:
    """Compute ν_j² ν_k² Σ_q c_q ρ^q from the squared covariances `squares` and ν_j² ν_k² = `size`."""
    weights = hermite_weights(efficiency)
    terms = np.asarray(weights[0] * squares)
    # ρ² below which the robust expansion has only its first term; the next is in ρ⁴.
    felt = np.flatnonzero(squares > 1e-6 * size)
    rho2 = squares[felt] / size
    terms[felt] = size * rho2 * np.polyval(weights[::-1], rho2)
    return terms


def _signal_covariance(model: Model, design: Design) -> Vector:
    """Compute A(m) of the signal at all lags 0 … N − 1, up to a constant."""
    if design.samples > LONGEST_SAMPLES:
        present = [p for p in model.processes if p.scale > 0]
        # With filters other than Haar, this limit holds for every process.
        slow = next((p for p in present if p.memory(design.rate) is None), present[0])
        raise MissingTheoryError(
            f"the covariance of {slow.name} is a sum over all lags, which allows at most {LONGEST_SAMPLES} samples; "
            f"got {design.samples}",
            advice="Use a shorter part of the recording.",
        )
    lags = np.arange(design.samples)
    total = np.zeros(design.samples)
    for process in model.processes:
        if process.scale > 0:
            check_stop()
            total += process.generalised_covariance(lags, design.rate)
    return total


def _against(
    cross: tuple[int, Vector], n: int, filter: WaveletFilter, levels: list[int]
) -> Iterator[tuple[int, Vector]]:
    """Yield Cov(W_{j,t}, W_{k,t+u}) for each level k, as first lag and values, from `cross`, that with the signal."""
    first, smooth = cross
    last = n - filter.width(levels[0])
    for level in range(1, levels[-1] + 1):
        check_stop()
        reach = (filter.length - 1) << (level - 1)
        # Zeros are added in front, because the step is circular, and at the back, up to the end of the recording.
        behind = min(reach, last + 1 - first - smooth.size)
        padded = np.zeros(reach + smooth.size + behind)
        padded[reach : reach + smooth.size] = smooth
        smooth, detail = (values[reach:] for values in _step(padded, filter, level))
        if level in levels:
            begin = max(0, filter.width(level) - n - first)
            yield first + begin, detail[begin:]


def _cropped(values: Vector, first: int) -> tuple[int, Vector]:
    """Remove negligible values at both ends, and return the lag of the first remaining value and these values."""
    size = np.abs(values)
    # Relative covariance with the signal below which far lags are left out.
    there = np.flatnonzero(size > 1e-9 * size.max())
    begin, end = (there[0], there[-1] + 1) if there.size else (0, 1)
    return first + int(begin), values[begin:end].copy()


def _step(values: Vector, filter: WaveletFilter, level: int) -> tuple[Vector, Vector]:
    """Compute the scaling and wavelet coefficients of a level. The step is circular, so the first ones are invalid."""
    root = np.sqrt(2.0)
    return _core.pyramid_step(values, filter.scaling / root, filter.wavelet / root, 1 << (level - 1))


def means(model: Model, design: Design) -> Vector:
    """Return the means (J,) of the coefficients, which are 0 unless the model has a drift that the filter preserves."""
    if design.filter.vanishing_moments > 1:
        return np.zeros(design.levels.size)
    slope = sum(float(process.mean(1.0) - process.mean(0.0)) for process in model.processes)
    return slope * np.sqrt(filtered.drift_shape(design.filter, design.levels))


def weighed(terms: Vector, first: int, stage: int, design: Design, a: int, b: int) -> float:
    """Compute Σ_u n(u) f(u) from f at the lags 2^stage (first, first + 1, …), with n(u) pairs of levels a and b."""
    if design.transform == "dwt":
        ahead = first % 2
        terms = terms[ahead::2]
        return float(_decimated_pairs(design, a, b, (first + ahead) // 2 + np.arange(terms.size)) @ terms)
    step, size = 1 << stage, design.samples
    fine, coarse = (design.filter.width(int(design.levels[place])) for place in (a, b))
    # n(u) rises from 0 at the first bend to the last number of pairs, stays, and falls to 0 at the last bend.
    rise, fall = coarse - size - 1, size - fine + 1
    start, end = (min(max(place - first, 0), terms.size) for place in (0, (coarse - fine) // step + 1))
    up, level, down = terms[:start], terms[start:end], terms[end:][::-1]
    total = (size - coarse + 1) * float(level.sum())
    for part, nearest in ((up, step * first - rise), (down, fall - step * (first + terms.size - 1))):
        total += step * float(np.arange(part.size) @ part) + nearest * float(part.sum())
    total *= step
    if step > 1:
        # Correction at kinks of n(u): the difference of Euler-Maclaurin formulas for these lags and for all.
        lags = float(step) * np.arange(first, first + terms.size)
        for bend, turn in ((rise, 1), (0, -1), (coarse - fine, -1), (fall, 1)):
            beyond = (bend / step) % 1.0
            here = float(np.interp(bend, lags, terms))
            total += turn * here * (step * step * (beyond * beyond - beyond + 1 / 6) / 2 - 1 / 12)
    return total


def _decimated_pairs(design: Design, a: int, b: int, lags: Integers) -> Vector:
    """Return the number of pairs of inner decimated coefficients whose last samples are 2^j `lags` apart; j is the
    finer level. Coefficient n of level j ends at sample 2^j (n + 1) − 1. Those of the coarser level with n + 1 from
    `low` to `high` have a partner in the finer level at this lag."""
    fine, coarse = int(design.levels[a]), int(design.levels[b])
    ratio, ends = 1 << (coarse - fine), (design.samples >> fine, design.samples >> coarse)
    starts = ends[0] - int(design.counts[a]), ends[1] - int(design.counts[b])
    low = np.maximum(-(-(starts[0] + 1 + lags) // ratio), starts[1] + 1)
    high = np.minimum((ends[0] + lags) // ratio, ends[1])
    return np.asarray(np.maximum(high - low + 1, 0), dtype=np.float64)
