"""The covariance of the wavelet variance by its definition: every lag, nine terms, 40 digits; and as arrays."""

from collections.abc import Callable, Sequence
from functools import cache

import mpmath as mp
import numpy as np

Covariance = Callable[[int], mp.mpf]


def markov(phi: mp.mpf, variance: float) -> Covariance:
    """K(m) of an AR(1) process of this marginal variance."""
    a, b = (1 + phi) / (1 - phi), 2 * phi / (1 - phi) ** 2
    return lambda m: -mp.mpf(variance) / 2 * (abs(m) * a - b * (1 - phi ** abs(m)))


def white(variance: float) -> Covariance:
    return lambda m: -mp.mpf(variance) * abs(m) / 2


def walk(variance: float) -> Covariance:
    return lambda m: mp.mpf(variance) * (mp.mpf(abs(m)) ** 3 - abs(m)) / 12


def quantization(variance: float) -> Covariance:
    return lambda m: mp.mpf(variance) * (m == 0)


def recursion(phi: Sequence[float], theta: Sequence[float], lags: int, digits: int = 40) -> list[mp.mpf]:
    """Autocovariances at lags 0 … of an ARMA process of innovation variance 1, as sums over its weights ψ_k."""
    with mp.workdps(digits):
        psi = [mp.mpf(1)]
        while len(psi) <= len(phi) + len(theta) or max(map(abs, psi[-max(len(phi), 1) :])) > mp.mpf(10) ** (
            -digits / 2
        ):
            k = len(psi)
            driven = mp.mpf(theta[k - 1]) if k <= len(theta) else mp.mpf(0)
            psi.append(driven + mp.fsum(mp.mpf(a) * psi[k - i] for i, a in enumerate(phi, 1) if i <= k))
        return [mp.fsum(a * b for a, b in zip(psi, psi[k:], strict=False)) for k in range(lags)]


def running(autocovariance: Sequence[mp.mpf]) -> Covariance:
    """K(m) = −½ Σ_{|k| < m} (m − |k|) r(k) from the autocovariances at all lags below m."""

    def at(m: int) -> mp.mpf:
        m = abs(m)
        return -(m * autocovariance[0] / 2 + mp.fsum((m - k) * autocovariance[k] for k in range(1, m)))

    return at


def haar(level: int) -> np.ndarray:
    """The wavelet filter of one level, W_t = Σ_l h_l X_{t−l}."""
    half = 2 ** (level - 1)
    return np.repeat([1.0, -1.0], half) / 2**level


def autocovariances(kind: str, variance: float, decay: float, samples: int) -> np.ndarray:
    """Covariance of the signal at lags 1 − N … N − 1, up to a constant."""
    m = np.abs(np.arange(1 - samples, samples))
    shape = {
        "white": 1.0 * (m == 0),
        "rounding": 2.0 * (m == 0) - 1.0 * (m == 1),
        "walk": -m / 2.0,
        "markov": np.expm1(-decay * m),
        "alternating": np.exp(-decay * m) * (-1.0) ** m,
    }
    return variance * shape[kind]


def lagged(covariance: np.ndarray, j: int, k: int, samples: int) -> tuple[np.ndarray, np.ndarray]:
    """Cov(W_{j,t}, W_{k,t+u}) at every lag u at which the record has pairs, and the number of these."""
    fine, coarse = haar(j), haar(k)
    # Lags 1 − N … N − 1 less what the filters take from either end: 2^k − N … N − 2^j.
    values = np.convolve(np.convolve(covariance, fine[::-1], "valid"), coarse, "valid")
    u = np.arange(coarse.size - samples, samples - fine.size + 1)
    pairs = np.minimum(samples - 1, samples - 1 - u) - np.maximum(fine.size - 1, coarse.size - 1 - u) + 1
    return values, pairs


def shared_errors(levels: int, samples: int) -> np.ndarray:
    """Excess of V per fourth cumulant of the errors e of X_t = e_t − e_{t−1}: all coefficients as sums of errors."""
    squares = []
    for level in range(1, levels + 1):
        taps = np.convolve(haar(level), [1.0, -1.0])
        rows = np.zeros((samples - 2**level + 1, samples + 1))
        for t, row in enumerate(rows):
            row[t : t + taps.size] = taps[::-1]
        squares.append((rows**2).sum(axis=0) / len(rows))
    return np.array([[a @ b for b in squares] for a in squares])


def wavelet_covariance(
    parts: Sequence[Covariance], levels: int, samples: int, slope: float = 0.0, cumulant: float = 0.0
) -> np.ndarray:
    """V of a sum with a drift of `slope` per sample, Gaussian but for the errors of one that are `cumulant` from it."""

    @cache
    def running(m: int) -> mp.mpf:
        return mp.fsum(part(m) for part in parts)

    @cache
    def coarser(m: int, coarse: int) -> mp.mpf:
        """Σ_s b_s K(m − s coarse), with b = (1, −2, 1)."""
        return running(abs(m)) - 2 * running(abs(m - coarse)) + running(abs(m - 2 * coarse))

    result = np.zeros((levels, levels))
    with mp.workdps(40):
        for j in range(1, levels + 1):
            for k in range(j, levels + 1):
                fine, coarse = 2 ** (j - 1), 2 ** (k - 1)
                total = mp.mpf(0)
                for u in range(2 * coarse - samples, samples - 2 * fine + 1):
                    pairs = min(samples - 1, samples - 1 - u) - max(2 * fine - 1, 2 * coarse - 1 - u) + 1
                    if pairs <= 0:
                        continue
                    first, middle, last = (coarser(u + r * fine, coarse) for r in range(3))
                    covariance = (first - 2 * middle + last) / (4 * fine * coarse)
                    mean = mp.mpf(slope) ** 2 * fine * coarse / 4
                    total += pairs * (2 * covariance**2 + 4 * mean * covariance)
                count = (samples - 2 * fine + 1) * (samples - 2 * coarse + 1)
                result[j - 1, k - 1] = result[k - 1, j - 1] = float(total / count)
    return result + cumulant * shared_errors(levels, samples)
