"""The covariance of the wavelet variance by its definition: every lag, nine terms, 40 digits."""

from collections.abc import Callable, Sequence

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


def wavelet_covariance(parts: Sequence[Covariance], levels: int, samples: int, slope: float = 0.0) -> np.ndarray:
    """V of a Gaussian sum with a drift of `slope` per sample."""
    known: dict[int, mp.mpf] = {}

    def running(m: int) -> mp.mpf:
        m = abs(m)
        if m not in known:
            known[m] = mp.fsum(part(m) for part in parts)
        return known[m]

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
                    covariance = mp.fsum(
                        a * b * running(u - s * coarse + r * fine)
                        for r, a in enumerate((1, -2, 1))
                        for s, b in enumerate((1, -2, 1))
                    ) / mp.mpf(4 * fine * coarse)
                    mean = mp.mpf(slope) ** 2 * fine * coarse / 4
                    total += pairs * (2 * covariance**2 + 4 * mean * covariance)
                count = (samples - 2 * fine + 1) * (samples - 2 * coarse + 1)
                result[j - 1, k - 1] = result[k - 1, j - 1] = float(total / count)
    return result
