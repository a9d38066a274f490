"""Recordings of a simulated gyroscope with one fault each, and clean ones; NumPy alone, no gmwm in here."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Rng = np.random.Generator

RATE = 100.0
WHITE = 1e-3
"""Standard deviation of the white noise (rad/s)."""
WALK = 3e-7
"""Standard deviation of the steps of the random walk (rad/s)."""


def base(n: int, rng: Rng) -> Array:
    """White noise and a random walk about an offset."""
    return 0.01 * rng.normal() + WHITE * rng.normal(size=n) + np.cumsum(WALK * rng.normal(size=n))


# --- clean ----------------------------------------------------------------------------------------------


def white(n: int, rng: Rng) -> Array:
    return 0.01 * rng.normal() + WHITE * rng.normal(size=n)


def markov(n: int, rng: Rng) -> Array:
    """White noise, a Gauss-Markov process of 20 s, and a random walk."""
    return base(n, rng) + low_pass(rng.normal(size=n), 1 / (20 * RATE)) * np.sqrt(2 * 20 * RATE) * 1e-4


def flicker(n: int, rng: Rng) -> Array:
    """White noise and flicker noise by Kasdin's filter."""
    size = 2 * n
    k = np.arange(1, size)
    h = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    spectrum = np.fft.rfft(h, 2 * size) * np.fft.rfft(rng.normal(size=size), 2 * size)
    return white(n, rng) + 3e-5 * np.fft.irfft(spectrum)[n:size]


def quantized(n: int, rng: Rng) -> Array:
    """An output of 16 bits with a step of a half to one and a half standard deviations."""
    step = WHITE * rng.uniform(0.5, 1.5)
    return np.round(base(n, rng) / step) * step


def filtered(n: int, rng: Rng) -> Array:
    """White noise through a low-pass at 10 to 40 Hz, with a random walk, with a fine step."""
    noise = low_pass(rng.normal(size=n), 1 - np.exp(-2 * np.pi * rng.uniform(10, 40) / RATE))
    x = WHITE * noise + np.cumsum(WALK * rng.normal(size=n))
    return np.round(x / 1e-4) * 1e-4


def filtered_coarse(n: int, rng: Rng) -> Array:
    """The same with a coarse step, so that many values repeat."""
    noise = low_pass(rng.normal(size=n), 1 - np.exp(-2 * np.pi * rng.uniform(3, 20) / RATE))
    return np.round(WHITE * noise / np.std(noise) / 8e-4) * 8e-4


def averaged_tails(n: int, rng: Rng) -> Array:
    """Noise of Student's t with three degrees of freedom behind an average of five samples."""
    noise = np.convolve(rng.standard_t(3.0, size=n + 4) / np.sqrt(3), np.ones(5) / 5, "valid")
    return WHITE * noise + np.cumsum(WALK * rng.normal(size=n))


def two_lines(n: int, rng: Rng) -> Array:
    """White noise, a walk, and two vibrations."""
    time = np.arange(n) / RATE
    lines = [rng.uniform(0.3, 2) * np.sin(2 * np.pi * rng.uniform(5, 45) * time + rng.uniform(0, 6)) for _ in range(2)]
    return base(n, rng) + WHITE * (lines[0] + lines[1])


CLEAN: dict[str, Callable[[int, Rng], Array]] = {
    "white": white, "base": base, "markov": markov, "flicker": flicker, "quantized": quantized, "filtered": filtered,
    "filtered_coarse": filtered_coarse, "averaged_tails": averaged_tails, "two_lines": two_lines,
}  # fmt: skip

# --- faults ---------------------------------------------------------------------------------------------


def low_pass(x: Array, share: float) -> Array:
    """First-order low-pass y_i = y_{i-1} + share (x_i - y_{i-1}), by blocks of its impulse response."""
    length = int(min(np.ceil(40 / share), x.size))
    h = share * (1 - share) ** np.arange(length)
    size = 1 << int(np.ceil(np.log2(2 * x.size)))
    return np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(h, size))[: x.size]


def clipped(n: int, rng: Rng) -> Array:
    """Clipping at 1.2 to 2.5 standard deviations."""
    x = base(n, rng)
    limit = np.median(x) + rng.uniform(1.2, 2.5) * WHITE
    return np.minimum(x, limit)


def clipped_both(n: int, rng: Rng) -> Array:
    x = base(n, rng)
    limit = rng.uniform(1.2, 2.5) * WHITE
    return np.clip(x, np.median(x) - limit, np.median(x) + limit)


def full_scale(n: int, rng: Rng) -> Array:
    """The mean is near full scale: 42 % of the samples are at it; with a step."""
    x = np.round(base(n, rng) / 1e-4) * 1e-4
    return np.minimum(x, np.quantile(x, 0.58))


def held(k: int) -> Callable[[int, Rng], Array]:
    def of(n: int, rng: Rng) -> Array:
        return np.repeat(base(n // k + 1, rng), k)[rng.integers(k) :][:n]

    return of


def held_coarse(n: int, rng: Rng) -> Array:
    k = int(rng.integers(2, 11))
    return np.repeat(np.round(base(n // k + 1, rng) / 8e-4) * 8e-4, k)[:n]


def polled(n: int, rng: Rng) -> Array:
    """A log at 100 Hz of a sensor at 62.5 Hz."""
    x = base(n, rng)
    return x[(np.arange(n) * 0.625 + rng.uniform()).astype(int)]


def lost(n: int, rng: Rng) -> Array:
    """3 % of the samples repeat the one before."""
    x = base(n, rng)
    take = np.where(rng.random(n) < 0.03, 0, np.arange(n))
    return x[np.maximum.accumulate(take)]


def asleep(n: int, rng: Rng) -> Array:
    """The output is frozen for 1 s each minute."""
    x, at = base(n, rng), np.arange(n)
    frozen = at % 6000 < 100
    return x[np.maximum.accumulate(np.where(frozen, 0, at))]


def dead_start(n: int, rng: Rng) -> Array:
    x = base(n, rng)
    x[: n // 20] = 0.0
    return x


def jump(n: int, rng: Rng) -> Array:
    """One jump of the bias, of 1.5 to 10 times the standard deviation of the walk over the recording."""
    size = rng.uniform(1.5, 10) * WALK * np.sqrt(n) * rng.choice([-1, 1])
    return base(n, rng) + size * (np.arange(n) > n * rng.uniform(0.1, 0.9))


def jump_white(n: int, rng: Rng) -> Array:
    """One jump in white noise: K is 0."""
    size = 1.2e-4 * rng.choice([-1, 1])
    return white(n, rng) + size * (np.arange(n) > n * rng.uniform(0.1, 0.9))


def five_places(n: int, rng: Rng) -> Array:
    """Five jumps of 1, (5, n)."""
    return (np.arange(n) > np.sort(rng.integers(n, size=5))[:, None]).astype(float)


def jumps(n: int, rng: Rng) -> Array:
    """Five jumps in white noise."""
    courses = five_places(n, rng)
    return white(n, rng) + 1e-4 * rng.normal(size=5) @ courses


def jumps_in_walk(n: int, rng: Rng) -> Array:
    """Two to four jumps beside a random walk, each of 0.7 to 1.4 of its standard deviation at the end."""
    at = rng.integers(n // 20, n - n // 20, size=int(rng.integers(2, 5)))
    sizes = 3 * WALK * np.sqrt(n) * rng.uniform(0.7, 1.4, size=at.size) * rng.choice([-1, 1], size=at.size)
    walk = np.cumsum(3 * WALK * rng.normal(size=n))
    return white(n, rng) + walk + sizes @ (np.arange(n) > at[:, None])


def counter(n: int, rng: Rng) -> Array:
    """Difference of a rounded angle, divided by the interval: steps of the angle are 2 to 10 times the noise."""
    step = WHITE / RATE * rng.uniform(2, 10)
    angle = np.cumsum(base(n + 1, rng)) / RATE
    return np.diff(np.round(angle / step) * step) * RATE


def counter_exact(n: int, rng: Rng) -> Array:
    step = WHITE / RATE * rng.uniform(2, 10)
    angle = np.cumsum(base(n + 1, rng)) / RATE
    return np.diff(np.round(angle / step)) * (step * RATE)


def wrapped(n: int, rng: Rng) -> Array:
    """A 16-bit word near its end wraps around."""
    lsb = 1e-4
    x = np.round((WHITE * rng.normal(size=n) + np.cumsum(WALK * rng.normal(size=n))) / lsb).astype(int)
    x += 32767 + int(2 * WHITE / lsb)
    return ((x + 32768) % 65536 - 32768) * lsb


def wrapped_rare(n: int, rng: Rng) -> Array:
    lsb = 1e-4
    x = np.round((WHITE * rng.normal(size=n) + np.cumsum(WALK * rng.normal(size=n))) / lsb).astype(int)
    x += 32767 - int(3 * WHITE / lsb)
    return ((x + 32768) % 65536 - 32768) * lsb


def interpolated(n: int, rng: Rng) -> Array:
    """Gaps of 5 to 50 samples, 60 of them, filled by straight lines."""
    x = base(n, rng)
    for a in rng.integers(100, n - 100, size=60):
        b = a + int(rng.integers(5, 50))
        x[a:b] = np.interp(np.arange(a, b), [a - 1, b], [x[a - 1], x[b]])
    return x


def resampled(n: int, rng: Rng) -> Array:
    """A log at 62.5 Hz that was interpolated to 100 Hz."""
    return np.interp(np.arange(n) * 0.625, np.arange(n), base(n, rng))


def low_passed(n: int, rng: Rng) -> Array:
    """White noise through a low-pass at 0.5 to 5 % of the rate."""
    noise = low_pass(
        WHITE * rng.normal(size=n), 1 - np.exp(-2 * np.pi * np.exp(rng.uniform(np.log(0.005), np.log(0.05))))
    )
    return noise + np.cumsum(WALK * rng.normal(size=n))


def cic(n: int, rng: Rng) -> Array:
    """White noise through three averages of 32 samples."""
    x = WHITE * rng.normal(size=n + 96)
    for _ in range(3):
        x = np.convolve(x, np.ones(32) / 32, "valid")
    return x[:n] + np.cumsum(WALK * rng.normal(size=n))


def cic_coarse(n: int, rng: Rng) -> Array:
    """The same with averages of 20 to 50 samples, and a step of 0.05 to 0.5 standard deviations."""
    length, x = int(rng.integers(20, 51)), WHITE * rng.normal(size=n + 150)
    for _ in range(3):
        x = np.convolve(x, np.ones(length) / length, "valid")
    step = np.std(x) * np.exp(rng.uniform(np.log(0.05), np.log(0.5)))
    return np.round((x[:n] + np.cumsum(WALK * rng.normal(size=n))) / step) * step


def periodic(n: int, rng: Rng) -> Array:
    """White noise with a temperature that swings three to five times."""
    return white(n, rng) + 6e-5 * np.sin(2 * np.pi * rng.uniform(3, 5) * np.arange(n) / n + rng.uniform(0, 6.28))


def student(freedom: float) -> Callable[[int, Rng], Array]:
    def of(n: int, rng: Rng) -> Array:
        scale = WHITE / np.sqrt(freedom / (freedom - 2))
        return scale * rng.standard_t(freedom, size=n) + np.cumsum(WALK * rng.normal(size=n))

    return of


def cauchy(n: int, rng: Rng) -> Array:
    x = base(n, rng)
    at = rng.random(n) < 0.01
    x[at] += WHITE * rng.standard_cauchy(np.count_nonzero(at))
    return x


def outliers_in_quantization(n: int, rng: Rng) -> Array:
    """Quantization noise of an angle beside white noise, and outliers of 5 to 100 standard deviations."""
    x = base(n, rng) + 3 * WHITE * np.diff(rng.uniform(-0.5, 0.5, size=n + 1)) * np.sqrt(12)
    at = rng.random(n) < np.exp(rng.uniform(np.log(0.001), np.log(0.03)))
    x[at] += rng.normal(size=np.count_nonzero(at)) * np.exp(rng.uniform(np.log(5), np.log(100))) * WHITE * 3
    return x


def telegraph(n: int, rng: Rng) -> Array:
    """Pulses of two levels, 5 % of the time, of 2 s on average."""
    out, at, state = np.zeros(n), 0, False
    while at < n:
        length = int(rng.exponential(200 if state else 3800)) + 1
        out[at : at + length] = state
        at, state = at + length, not state
    return base(n, rng) + 2 * WHITE * out


def moved_end(n: int, rng: Rng) -> Array:
    """Somebody handles the unit in the last 1 to 5 %."""
    x, m = base(n, rng), int(n * rng.uniform(0.01, 0.05))
    x[-m:] += low_pass(rng.normal(size=m), 0.05) * WHITE * rng.uniform(3, 300)
    return x


def dithered(n: int, rng: Rng) -> Array:
    """A strong line of a dither motion."""
    return base(n, rng) + 1000 * WHITE * np.sin(2 * np.pi * rng.uniform(0.3, 0.48) * np.arange(n) + 1)


def pulses(shortest: int, longest: int, least: float, most: float, period: int) -> Callable[[int, Rng], Array]:
    """Pulses of equal size and either sign, one in each period (samples)."""

    def of(n: int, rng: Rng) -> Array:
        x, size = base(n, rng), rng.uniform(least, most) * WHITE
        for first in np.arange(0, n - period, period) + rng.integers(0, period - longest, size=n // period - 1):
            x[first : first + int(rng.integers(shortest, longest + 1))] += size * rng.choice([-1, 1])
        return x

    return of


def one_decay(n: int, rng: Rng) -> Array:
    """A jump of 1 that decays, (1, n)."""
    since = np.arange(n) - n * rng.uniform(0.2, 0.7)
    return np.where(since > 0, np.exp(-np.maximum(since, 0) / (RATE * rng.uniform(30, 200))), 0.0)[None]


def second_warm_up(n: int, rng: Rng) -> Array:
    """The mean jumps and decays, as after a power cycle."""
    (decay,) = one_decay(n, rng)
    return base(n, rng) + rng.uniform(0.1, 0.5) * WHITE * rng.choice([-1, 1]) * decay


COURSES: dict[str, Callable[[int, Rng], Array]] = {"jumps": five_places, "second_warm_up": one_decay}
"""Courses of the faults that a random walk can hide."""


def visibility(x: Array, courses: Array) -> float:
    """Reduction of −2 log L of white noise and a random walk by some of the courses (p, n) at their true times, less
    2 ln 256 for each time that a search has to find. The likelihood is that of 256 block means."""
    blocks, length = 256, x.size // 256
    k = np.arange(1, blocks)
    transform = np.sqrt(2 / blocks) * np.sin(np.pi * np.outer(k, k) / blocks)
    means = np.vstack([x, courses])[:, : blocks * length].reshape(-1, blocks, length).mean(axis=2)
    z, *columns = np.diff(means) @ transform
    theta = np.pi * k / blocks
    walks = np.append(0.0, np.geomspace(1e-6, 1e4, 100))[:, None]
    variances = 2 - 2 * np.cos(theta) + walks * (2 + np.cos(theta)) / 3

    def minus2(chosen: list[Array]) -> float:
        rest = []
        for variance in variances:
            design, y = np.array(chosen).reshape(-1, k.size).T / np.sqrt(variance)[:, None], z / np.sqrt(variance)
            left = y - design @ np.linalg.lstsq(design, y)[0] if chosen else y
            rest.append(k.size * np.log(left @ left) + np.sum(np.log(variance)))
        return float(min(rest))

    subsets = [chosen for p in range(1, len(columns) + 1) for chosen in combinations(columns, p)]
    return minus2([]) - min(minus2(list(chosen)) + 2 * np.log(blocks) * len(chosen) for chosen in subsets)


FAULTS: dict[str, Callable[[int, Rng], Array]] = {
    "clipped": clipped, "clipped_both": clipped_both, "full_scale": full_scale, "held_2": held(2), "held_4": held(4),
    "held_10": held(10), "held_coarse": held_coarse, "polled": polled, "lost": lost, "asleep": asleep,
    "dead_start": dead_start, "jump": jump, "jump_white": jump_white, "jumps": jumps, "jumps_in_walk": jumps_in_walk,
    "counter": counter, "counter_exact": counter_exact, "wrapped": wrapped, "wrapped_rare": wrapped_rare,
    "interpolated": interpolated, "resampled": resampled, "low_passed": low_passed, "cic": cic,
    "cic_coarse": cic_coarse, "periodic": periodic, "student_3": student(3.0), "student_2.5": student(2.5),
    "cauchy": cauchy, "outliers_in_quantization": outliers_in_quantization, "telegraph": telegraph,
    "moved_end": moved_end, "dithered": dithered, "pulses": pulses(4, 10, 5, 10, 4000),
    "states": pulses(20, 50, 3, 8, 1000), "second_warm_up": second_warm_up, "none": base,
}  # fmt: skip
