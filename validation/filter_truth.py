"""White noise N and random walk K of the filter that predicts a true noise best; no gmwm in here.

The filter b_k = b_{k−1} + g (x_k − b_{k−1}) predicts the mean of the next n samples (1 s) of a noise with the two-sided
density S(θ) of its samples. The mean square of its error is

    J(g) = (1/π) ∫_0^π |G(θ) − H(θ)|² S(θ) dθ,  G = (1/n) Σ_{m=1}^{n} e^{imθ},  H = g / (1 − (1 − g) e^{−iθ}).

The best g is that of the steady-state Kalman filter of white noise (σ²) and a random walk (q²σ²) with g² = q² (1 − g).
N² = σ² Δt follows from σ² (1/n + g + q² (n + 1)(2n + 1)/(6n)) = J, and K = q σ/√Δt.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

Array = NDArray[np.float64]
Density = Callable[[Array], Array]

LINES = (0.1, 3.0)
"""Periods of a sinusoid, over the horizon, between which it is part of the error: gmwm states N by this rule."""


def numbers(
    density: Density, rate: float, *, lines: Sequence[tuple[float, float]] = (), slope: float = 0.0
) -> tuple[float, float]:
    """N and K for a horizon of 1 s.

    `lines` are frequencies (Hz) and amplitudes of sinusoids, and `slope` is the root mean square of the derivative of a
    trend (per second), which the filter follows with a delay.
    """
    n = round(rate)
    theta, weights = _grid(n)
    mass = density(theta) * weights / math.pi
    near = [(f, a) for f, a in lines if LINES[0] <= 1 / f <= LINES[1]]
    theta = np.concatenate([theta, [2 * math.pi * f / rate for f, _ in near]])
    mass = np.concatenate([mass, [a**2 / 2 for _, a in near]])
    back = np.exp(-1j * theta)
    future = np.exp(1j * theta) * np.expm1(1j * n * theta) / (n * np.expm1(1j * theta))

    def error(u: float) -> float:
        g = _gain(math.exp(u))
        past = g / (1 - (1 - g) * back)
        delay = (n + 1) / 2 + (1 - g) / g
        return float(np.abs(future - past) ** 2 @ mass) + (slope / rate * delay) ** 2

    places = np.linspace(math.log(1e-8), 0.0, 40)
    best = int(np.argmin([error(u) for u in places]))
    around = places[max(best - 1, 0)], places[min(best + 1, places.size - 1)]
    u = float(optimize.minimize_scalar(error, bounds=around, method="bounded", options={"xatol": 1e-6}).x)
    q = math.exp(u)
    claim = 1 / n + _gain(q) + q**2 * (n + 1) * (2 * n + 1) / (6 * n)
    white = math.sqrt(error(u) / claim / rate)
    return white, white * q * rate


def _gain(q: float) -> float:
    """g of the steady-state filter with g² = q² (1 − g)."""
    return 2 * q / (q + math.sqrt(q**2 + 4))


def _grid(n: int) -> tuple[Array, Array]:
    """Frequencies and weights of the trapezoidal rule: logarithmic below 2/n, then 100 in each period of G."""
    slow = np.geomspace(1e-10, 2 / n, 1500)
    theta = np.concatenate([slow[:-1], np.linspace(2 / n, math.pi, 50 * n)])
    return theta, np.gradient(theta)
