"""The exact Gaussian likelihood of a Gauss-Markov process in white noise, and the least errors that it allows.

Sampled, the sum is an ARMA(1, 1). Its likelihood is that of the innovations of a Kalman filter with one state, whose
gain is followed until it stands still to rounding; from there on the filter is a linear one. It serves as the
yardstick of the wavelet moments, and shares no code with them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from scipy.signal import lfilter

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


def concentrated(x: Vector, decay: float, ratio: float) -> tuple[float, float]:
    """−2 log L / N less log 2π + 1, at the white noise σ² that makes it smallest; and this σ².

    Parameters
    ----------
    x : (N,) array
        The record, of mean zero.
    decay, ratio : float
        λ = βΔt, and s²/σ² of the Gauss-Markov process to the white noise.
    """
    phi, drive = math.exp(-decay), -ratio * math.expm1(-2 * decay)
    state, variance = 0.0, ratio  # of x_t given the past, in units of σ²: stationary at first
    squares = logs = 0.0
    done = len(x)
    for t, value in enumerate(x.tolist()):
        total = variance + 1.0
        gain = variance / total
        error = value - state
        squares += error * error / total
        logs += math.log(total)
        state = phi * (state + gain * error)
        before, variance = variance, phi * phi * variance / total + drive
        if abs(variance - before) <= 4e-16 * variance:
            done = t + 1
            break
    rest = x[done:]
    if rest.size:
        total = variance + 1.0
        slope = phi / total  # a_{t+1} = φ(1 − K) a_t + φ K x_t
        push = phi * variance / total
        following, _ = lfilter([push], [1.0, -slope], rest, zi=[slope * state])
        errors = rest - np.concatenate(([state], following[:-1]))
        squares += float(errors @ errors) / total
        logs += rest.size * math.log(total)
    scale = squares / len(x)
    return math.log(scale) + logs / len(x), scale


def most_likely(x: Vector, rate: float, start: tuple[float, float, float]) -> tuple[float, float, float]:
    """β, σ²_GM and σ² of the largest likelihood, sought from `start`.

    Raises
    ------
    RuntimeError
        If the search does not end.
    """
    beta, marginal, noise = start
    origin = np.log([beta / rate, marginal / noise])

    def criterion(at: Vector) -> float:
        return len(x) * concentrated(x, math.exp(at[0]), math.exp(at[1]))[0]

    simplex = origin + 0.2 * np.array([[0, 0], [1, 0], [0, 1]])
    options = {"initial_simplex": simplex, "xatol": 1e-5, "fatol": 1e-7, "maxiter": 1000}
    found = minimize(criterion, origin, method="Nelder-Mead", options=options)
    if not found.success:
        raise RuntimeError(f"the search for the largest likelihood did not end: {found.message}")
    decay, ratio = np.exp(found.x).tolist()
    _, scale = concentrated(x, decay, ratio)
    return decay * rate, ratio * scale, scale


def spectrum(decay: float, marginal: float, noise: float, frequencies: Vector) -> tuple[Vector, Matrix]:
    """Spectral density S (F,) at `frequencies` in cycles per sample, and ∂ log S / ∂ log (β, σ²_GM, σ²) (3, F)."""
    phi = math.exp(-decay)
    square = np.sin(np.pi * frequencies) ** 2
    distance = math.expm1(-decay) ** 2 + 4 * phi * square
    markov = -marginal * math.expm1(-2 * decay) / distance
    total = markov + noise
    bend = -2 * phi * phi / math.expm1(-2 * decay) + phi * (2 * math.expm1(-decay) + 4 * square) / distance
    return total, np.array([decay * bend * markov, markov, np.full_like(markov, noise)]) / total


def midpoints(count: int = 1 << 17) -> Vector:
    """Frequencies from 0 to ½ cycles per sample whose mean is an integral, to rounding for smooth spectra."""
    return np.asarray((np.arange(count) + 0.5) / (2 * count))


def fisher_errors(decay: float, marginal: float, noise: float, samples: int) -> Vector:
    """Cramér-Rao bound: least relative standard errors of β, σ²_GM and σ², for a long record (Whittle)

    I = (N/2) ∫ (∂ log S/∂θ)(∂ log S/∂θ)ᵀ df over a period.
    """
    _, scores = spectrum(decay, marginal, noise, midpoints())
    information = samples / 2 * (scores @ scores.T) / scores.shape[1]
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(information))))


def moment_errors(decay: float, marginal: float, noise: float, samples: int, gains: Matrix) -> Vector:
    """Least relative standard errors from the variances of filtered records alone, for a long record.

    The filters have the squared gains |H_j|² (J, F) at `midpoints(F)`. With optimal weights the information is
    DᵀV⁻¹D, D = ∫ |H_j|² ∂S/∂θ df, V_jk = (2/N) ∫ |H_j|²|H_k|² S² df.
    """
    density, scores = spectrum(decay, marginal, noise, midpoints(gains.shape[1]))
    powers = gains * density
    slopes = powers @ scores.T / density.size
    covariance = 2 / samples * (powers @ powers.T) / density.size
    scale = np.sqrt(np.diag(covariance))
    share, axes = np.linalg.eigh(covariance / np.outer(scale, scale))
    # Scales that lie close together are nearly collinear: what rounding has of them is left out.
    kept = share > 1e-12 * share[-1]
    along = axes[:, kept].T @ (slopes / scale[:, None])
    return np.asarray(np.sqrt(np.diag(np.linalg.inv(along.T @ (along / share[kept, None])))))


def octave_gains(levels: int, count: int = 1 << 17) -> Matrix:
    """Ideal filters: level j passes the octave from 2^(−j−1) to 2^(−j) and nothing else (J, F)."""
    octave = np.floor(-np.log2(midpoints(count)))
    return np.array([octave == j for j in range(1, levels + 1)], dtype=np.float64)


def haar_gains(halves: NDArray[np.int64], count: int = 1 << 17) -> Matrix:
    """|H|² = sin⁴(πfh) / (h² sin²(πf)): differences of the means of neighbouring blocks of h samples, halved (J, F)."""
    f = midpoints(count)
    tops = np.array([np.sin(np.pi * f * h) ** 4 for h in halves])
    return np.asarray(tops / np.sin(np.pi * f) ** 2 / halves[:, None] ** 2)
