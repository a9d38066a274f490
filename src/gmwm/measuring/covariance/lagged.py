"""Covariance of wavelet variances and of the moments at lags, summed over all lags of the coefficients.

With the generalised covariance A and the half-scale h of level j, C_j(u) = Cov(W_{1,t}, W_{j,t+u}) = [2A(u + 1 − h) −
A(u + 1) − A(u + 1 − 2h)] / (4h). The moment of a lag l is the mean square of Z_t = (W_{1,t} + W_{1,t−l})/√2. Its
covariance with ν̂_j² is 2 Σ_u n(u) Cov(Z_t, W_{j,t+u})² / (M_l M_j), with n(u) pairs of coefficients."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.errors import MissingTheoryError
from gmwm.base.threads import check_stop
from gmwm.measuring.covariance.design import Design
from gmwm.theory.processes.model import Model

NEGLIGIBLE = 1e-7
"""Share of the largest covariance below which lags are left out without a drift; 1e6 of them change V by 1e-8."""


def covariance(model: Model, design: Design, wavelet: Matrix) -> Matrix:
    """Compute V (L + J, L + J), in u⁴, from the covariance V = `wavelet` (J, J) of the wavelet variances."""
    present = [process for process in model.processes if process.scale > 0]
    for process in present:
        if process.line(design.rate) is not None:
            raise MissingTheoryError(
                f"the covariance of moments at lags is not known for a model with {process.name}",
                process=process.name, advice="Fit the wavelet variances alone, with {--moments=haar}.",
            )  # fmt: skip
    lags = int(np.count_nonzero(design.levels < 0))
    v = np.zeros((design.levels.size,) * 2)
    v[lags:, lags:] = wavelet
    if present:
        sums = _Sums(Model(tuple(present)), design)
        for a in range(lags):
            check_stop()
            for b in range(a, design.levels.size):
                v[a, b] = v[b, a] = sums.entry(a, b)
    return v


class _Sums:
    """Sums over the lags u between the coefficients of two moments, of which the first has a lag."""

    def __init__(self, model: Model, design: Design) -> None:
        self.design = design
        self.widths = design.filter.widths(design.levels)
        lags = np.arange(2 * design.samples + 2)
        half = np.sum([p.generalised_covariance(lags, design.rate) for p in model.processes], axis=0)
        both = np.concatenate([half[:0:-1], half])
        levels = {1, *design.levels[design.levels > 0].tolist()}
        self.slope = sum(float(process.mean(1.0) - process.mean(0.0)) for process in model.processes)
        least = 0.0 if self.slope else NEGLIGIBLE
        self.against = {level: _against(both, design.samples, 1 << (level - 1), least) for level in levels}
        self.cumulant = sum(process.error_cumulant for process in model.processes)

    def entry(self, a: int, b: int) -> float:
        """Compute the covariance of the moments with the indices a, which has a lag, and b."""
        lag, other = -int(self.design.levels[a]), int(self.design.levels[b])
        # Z_t has the coefficients W_{1,t} and W_{1,t−l}, each with the weight 1/√2; a wavelet variance has one.
        first, values = self.against[max(other, 1)]
        shifts = (0, lag) if other > 0 else (0, lag, other, lag + other)
        low, high = min(shifts), max(shifts)
        total = np.zeros(values.size + high - low)
        for shift in shifts:
            total[high - shift : high - shift + values.size] += values
        total /= np.sqrt(2.0) if other > 0 else 2.0
        pairs = self._pairs(a, b, np.arange(total.size) + (first - high))
        # A sum of NumPy, because a product of BLAS starts threads for such lengths, which is slower.
        result = 2.0 * float(np.einsum("u,u,u", pairs, total, total))
        if self.slope:
            means = 0.5 * self.slope**2 * (2.0 if other < 0 else np.sqrt(2.0) * 2.0 ** (other - 1)) / 2.0
            result += 4.0 * means * float(np.einsum("u,u", pairs, total))
        if self.cumulant:
            # For x_t = e_t − e_{t−1}, pairs of squared taps that belong to the same error e.
            (places, taps), (others, weights) = (_taps(int(self.design.levels[k])) for k in (a, b))
            shared = self._pairs(a, b, others[None, :] - places[:, None])
            result += self.cumulant * float(taps**2 @ shared @ weights**2)
        return result / float(self.design.counts[a]) / float(self.design.counts[b])

    def _pairs(self, a: int, b: int, u: Integers) -> Vector:
        """Return the number n(u) of pairs of coefficients at the lags u."""
        last = self.design.samples - 1 - np.maximum(u, 0)
        first = np.maximum(self.widths[a] - 1, self.widths[b] - 1 - u)
        return np.asarray(np.maximum(last - first + 1, 0), dtype=np.float64)


def _against(known: Vector, samples: int, half: int, least: float) -> tuple[int, Vector]:
    """Return the first lag and the C_j(u) between those above `least` of the largest, from A(m) at all lags."""
    u, middle = np.arange(1 - samples, samples), known.size // 2
    start = middle + int(u[0]) + 1
    here, before, after = (known[start - shift : start - shift + u.size] for shift in (half, 2 * half, 0))
    values = ((here - before) - (after - here)) / (4.0 * half)
    seen = np.flatnonzero(np.abs(values) > least * np.abs(values).max(initial=0.0))
    if not seen.size:
        return 0, np.zeros(1)
    return int(u[seen[0]]), values[seen[0] : seen[-1] + 1]


def _taps(level: int) -> tuple[Integers, Vector]:
    """Return the offsets and the weights of the errors e_t in a coefficient of a signal x_t = e_t − e_{t−1}."""
    if level > 0:
        return np.array([0, 1, 2]) << (level - 1), np.array([1.0, -2.0, 1.0]) / 2.0**level
    taps = np.zeros(3 - level)
    taps[:3] += [1.0, -2.0, 1.0]
    taps[-level:] += [1.0, -2.0, 1.0]
    return np.flatnonzero(taps), taps[np.flatnonzero(taps)] / np.sqrt(8.0)
