"""Recordings with a known spectrum, made with NumPy alone."""

from collections.abc import Callable
from functools import cache

import numpy as np

RATE = 100.0
Noise = Callable[[np.random.Generator, int], np.ndarray]


def recursive(rng: np.random.Generator, n: int, forward: tuple[float, ...], back: tuple[float, ...]) -> np.ndarray:
    """White noise through a filter of at most two poles, without its transient."""
    driven = np.convolve(rng.normal(size=n + 2000), forward)[: n + 2000]
    # The impulse response is short beside the recording, so the filter is a convolution by FFT.
    size = 1 << (n + 4000).bit_length()
    return np.fft.irfft(np.fft.rfft(driven, size) * np.fft.rfft(impulse_response(back), size), size)[2000 : n + 2000]


@cache
def impulse_response(back: tuple[float, ...]) -> np.ndarray:
    response = np.zeros(2000)
    for k in range(response.size):
        recent = [response[k - j] for j in range(1, len(back)) if k >= j]
        response[k] = (k == 0) - sum(a * y for a, y in zip(back[1:], recent, strict=False))
    return response


def resonance(frequency: float, quality: float) -> Noise:
    """A pair of poles: AR(2)."""
    radius, angle = np.exp(-np.pi * frequency / quality / RATE), 2 * np.pi * frequency / RATE
    return lambda rng, n: recursive(rng, n, (1.0,), (1.0, -2 * radius * np.cos(angle), radius**2))


def butterworth(order: int, corner: float) -> Noise:
    """Low-pass by the bilinear transform; `corner` in Hz."""
    w = np.tan(np.pi * corner / RATE)
    if order == 1:
        forward, back = (w / (1 + w), w / (1 + w)), (1.0, (w - 1) / (1 + w))
    else:
        a0 = 1 + np.sqrt(2) * w + w**2
        forward = (w**2 / a0, 2 * w**2 / a0, w**2 / a0)
        back = (1.0, 2 * (w**2 - 1) / a0, (1 - np.sqrt(2) * w + w**2) / a0)
    return lambda rng, n: recursive(rng, n, forward, back)


def flicker(rng: np.random.Generator, n: int) -> np.ndarray:
    f = np.arange(n + 1) / (2 * n)
    f[0] = 1.0
    parts = (rng.normal(size=n + 1) + 1j * rng.normal(size=n + 1)) / np.sqrt(f)
    parts[0] = 0
    x = np.fft.irfft(parts)[:n]
    return x / x.std() + 0.3 * rng.normal(size=n)


def slow(rng: np.random.Generator, n: int) -> np.ndarray:
    """White noise, a Gauss-Markov process of 20 s in 60 s, and a random walk."""
    markov = 0.02 * recursive(rng, n, (1.0,), (1.0, -np.exp(-1 / 100)))
    return rng.normal(size=n) + markov + np.cumsum(2e-3 * rng.normal(size=n))


def spiked(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.normal(size=n) + 20 * rng.normal(size=n) * (rng.random(n) < 0.001)


SMOOTH: dict[str, Noise] = {
    "white": lambda rng, n: rng.normal(size=n),
    "slow": slow,
    "random walk": lambda rng, n: np.cumsum(rng.normal(size=n)),
    "low-pass 1": butterworth(1, 10.0),
    "low-pass 2": butterworth(2, 30.0),
    "low-pass 2, low": butterworth(2, 10.0),
    "flicker": flicker,
    "t5": lambda rng, n: rng.standard_t(5, size=n),
    "quantised": lambda rng, n: np.round(rng.normal(size=n)),
    "quantised, coarse": lambda rng, n: 3 * np.round(rng.normal(size=n) / 3),
    "quantisation": lambda rng, n: np.diff(rng.normal(size=n + 1)),
    "spikes": spiked,
}
"""Noise without a line or a bump."""
RESONANCES = {
    (frequency, quality): resonance(frequency, quality) for quality in (2, 5, 10, 30) for frequency in (12, 25)
}


def line(amplitude: float, frequency: float, n: int, rng: np.random.Generator) -> np.ndarray:
    return amplitude * np.sin(2 * np.pi * (frequency * np.arange(n) / RATE + rng.random()))
