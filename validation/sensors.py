"""Recordings of simulated gyroscopes that depart from gmwm's default family, each with its truth; no gmwm in here.

`KINDS` names the departures. `KINDS[kind](rng)` draws a sensor and a recording of it; all parameters are drawn anew, so
no two recordings have the same truth. Units are SI: rad/s, seconds, and spectral densities by the convention of IEEE
Std 952: the Allan variance of the sensor without departures is

    σ²(τ) = N²/τ + K²τ/3 + (2 ln 2/π) B² + Σ σ²_GM g(τ/T_c),  g(u) = (2/u²)(u − 3/2 + 2e^{−u} − e^{−2u}/2).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal, special

from validation import filter_truth

Array = NDArray[np.float64]
Rng = np.random.Generator

DEG_PER_ROOT_HOUR = math.radians(1) / 60
"""1 deg/√h in rad/s/√Hz."""
DEG_PER_HOUR = math.radians(1) / 3600
BIAS = 2 * math.log(2) / math.pi
"""Allan variance of flicker noise of B = 1 rad/s."""
MOST_SAMPLES = 720_000
WARM = 4000
"""Samples that a filter runs before the recording begins; the narrowest filter here forgets within 200."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What a recording was made of; None where a number has no meaning.

    N is the density at low frequency of everything with a memory far below 1 s, after the sensor's filter. `filter_N`
    and `filter_K` are the numbers of the filter that predicts the output over 1 s best. `lowest` is
    the minimum of the true Allan deviation over √(2 ln 2/π), which is what B means without flicker noise. `structure`
    is the model as gmwm writes it, if it is one of gmwm's slow family. `facts` are the parameters of the departure.
    """

    N: float
    filter_N: float
    filter_K: float
    K: float | None = 0.0
    R: float | None = None
    B: float | None = None
    lowest: float | None = None
    gm: tuple[tuple[float, float], ...] = ()
    structure: str | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Samples (rad/s or m/s²) at `rate` Hz, and what they were made of."""

    samples: Array
    rate: float
    truth: Truth
    axis: str = "gyro_x"

    @property
    def unit(self) -> str:
        return "rad/s" if self.axis.startswith("gyro") else "m/s²"


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """A sensor: white noise N, Gauss-Markov terms (σ², T_c), random walk K, flicker noise B, angle quantization Q.

    `duration` is how long it is recorded (s).
    """

    N: float
    rate: float
    duration: float
    gm: tuple[tuple[float, float], ...] = ()
    K: float = 0.0
    B: float = 0.0
    Q: float = 0.0
    axis: str = "gyro_x"

    @property
    def count(self) -> int:
        return round(self.duration * self.rate)

    @property
    def sigma(self) -> float:
        """Standard deviation of the white noise of one sample."""
        return self.N * math.sqrt(self.rate)

    @property
    def structure(self) -> str:
        many = f"{len(self.gm)}*GM" if len(self.gm) > 1 else "GM" if self.gm else ""
        flags = (many, "WN" if self.N else "", "QN" if self.Q else "", "RW" if self.K else "", "FN" if self.B else "")
        return " + ".join(filter(None, flags))

    def allan_variance(self, tau: Array) -> Array:
        """Of the noise, at averaging times far above the sampling interval."""
        total = self.N**2 / tau + self.K**2 * tau / 3 + BIAS * self.B**2 + 3 * self.Q**2 / tau**2
        for variance, time in self.gm:
            u = tau / time
            # The closed form cancels at small u, where g(u) = 2u/3 to first order.
            exact = 2 / u**2 * (u - 1.5 + 2 * np.exp(-u) - np.exp(-2 * u) / 2)
            total = total + variance * np.where(u < 1e-3, 2 * u / 3, exact)
        return total

    def lowest(self) -> float:
        """Minimum of the Allan deviation, up to the largest averaging time that wavelets reach, over √(2 ln 2/π)."""
        last = 2 ** (self.count.bit_length() - 2) / self.rate
        tau = np.geomspace(1 / self.rate, last, 4000)
        return math.sqrt(self.allan_variance(tau).min() / BIAS)

    def density(self, theta: Array) -> Array:
        """Two-sided density of the samples, without a departure."""
        z = np.exp(-1j * theta)
        step = np.abs(1 - z)
        total = np.full(theta.shape, self.sigma**2)
        for variance, time in self.gm:
            phi = math.exp(-1 / (time * self.rate))
            total += variance * (1 - phi**2) / np.abs(1 - phi * z) ** 2
        total += (self.K**2 / self.rate) / step**2 + self.B**2 / step + (self.Q * self.rate * step) ** 2
        return total

    def truth(
        self, shape: filter_truth.Density | None = None, lines: Sequence[tuple[float, float]] = (), slope: float = 0.0,
        **other: Any,
    ) -> Truth:  # fmt: skip
        """The truth without a departure, with `other` in its place.

        `shape` is the density of the white noise over its value at zero, `lines` are sinusoids (Hz, amplitude), and
        `slope` is the root mean square of the derivative of a trend.
        """

        def density(theta: Array) -> Array:
            changed = 0.0 if shape is None else self.sigma**2 * (shape(theta) / shape(np.zeros(1)) - 1)
            return self.density(theta) + changed

        N, K = filter_truth.numbers(density, self.rate, lines=lines, slope=slope)
        plain = Truth(
            N=self.N, filter_N=N, filter_K=K, K=self.K, B=self.B or None, lowest=self.lowest(), gm=self.gm,
            structure=self.structure,
        )  # fmt: skip
        return replace(plain, **other)

    def white(self, rng: Rng, extra: int = 0) -> Array:
        return self.sigma * rng.normal(size=self.count + extra)

    def slow(self, rng: Rng) -> Array:
        """All but the white noise, and a constant rate."""
        x = np.full(self.count, rng.uniform(-20, 20) * self.N)
        for variance, time in self.gm:
            phi = math.exp(-1 / (time * self.rate))
            shocks = math.sqrt(variance * (1 - phi**2)) * rng.normal(size=self.count)
            shocks[0] = math.sqrt(variance) * rng.normal()
            x += signal.lfilter([1.0], [1.0, -phi], shocks)
        if self.K:
            x += np.cumsum(self.K / math.sqrt(self.rate) * rng.normal(size=self.count))
        if self.Q:
            x += self.Q * self.rate * np.diff(rng.uniform(-1, 1, size=self.count + 1) * math.sqrt(3))
        if self.B:
            x += self.B * flicker(self.count, rng)
        return x

    def recorded(self, white: Array, rng: Rng, **other: Any) -> Recording:
        """The recording with this in place of the white noise."""
        return Recording(samples=white + self.slow(rng), rate=self.rate, truth=self.truth(**other), axis=self.axis)


def shape_of(b: Array, a: Array | None = None) -> filter_truth.Density:
    """Squared gain of a digital filter by angular frequency."""
    return lambda theta: np.abs(signal.freqz(b, np.ones(1) if a is None else a, worN=theta)[1]) ** 2


def flicker(count: int, rng: Rng) -> Array:
    """1/f noise of B = 1: fractionally integrated white noise with d = 1/2 (Kasdin 1995), exact in its differences.

    The differences have d = −1/2, whose autocovariance (Hosking 1981) is drawn exactly by circulant embedding.
    """
    k = np.arange(1, count + 1)
    r = 4 / math.pi * np.concatenate([[1.0], np.cumprod((k - 1.5) / (k + 0.5))])
    around = np.concatenate([r, r[-2:0:-1]])
    power = np.fft.rfft(around).real
    if power.min() < 0:
        raise ArithmeticError("the circulant embedding of flicker noise is not positive")
    white = np.fft.rfft(rng.normal(size=around.size))
    differences = np.fft.irfft(np.sqrt(power) * white, around.size)[:count]
    return np.cumsum(differences)


def log_uniform(rng: Rng, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def ordinary(rng: Rng, slow: bool = True) -> Sensor:
    """A sensor of WN + GM + RW from consumer to tactical grade (N from 0.01 to 0.6 deg/√h), 0.5 to 3 h of it.

    At low frequency the Gauss-Markov term has 3 to 30 times the density of the white noise, and the random walk crosses
    the sum of both between a hundredth and a fifteenth of the recording. Without `slow` there is white noise alone.
    """
    rate = float(rng.choice([50, 100, 125, 200, 400]))
    duration = min(rng.uniform(1800, 10_800), MOST_SAMPLES / rate)
    N = log_uniform(rng, 0.01, 0.6) * DEG_PER_ROOT_HOUR
    if not slow:
        return Sensor(N=N, rate=rate, duration=duration)
    return _with_slow(Sensor(N=N, rate=rate, duration=duration), rng, time=log_uniform(rng, 1.0, duration / 200))


def _with_slow(
    sensor: Sensor, rng: Rng, *, time: float, above: float = 3.0, crossing: tuple[float, float] = (100.0, 15.0)
) -> Sensor:
    """The sensor with a Gauss-Markov term of this correlation time, and a random walk.

    At low frequency the term has `above` to ten times `above` the density of the white noise. The random walk crosses
    both together at a share of the recording between the inverses of `crossing`, but above three correlation times.
    """
    ratio = log_uniform(rng, above, 10 * above)
    at = max(sensor.duration * log_uniform(rng, 1 / crossing[0], 1 / crossing[1]), 3 * time)
    K = sensor.N * math.sqrt(3 * (1 + ratio)) / at
    return replace(sensor, gm=((ratio * sensor.N**2 / (2 * time), time),), K=K)


# --- the family itself ------------------------------------------------------------------------------------------------


def base(rng: Rng) -> Recording:
    sensor = ordinary(rng)
    return sensor.recorded(sensor.white(rng), rng)


def gm_20s(rng: Rng) -> Recording:
    """GM of about 20 s + WN + weak RW, 1 h at 100 Hz."""
    sensor = Sensor(N=log_uniform(rng, 0.05, 0.5) * DEG_PER_ROOT_HOUR, rate=100.0, duration=3600.0)
    sensor = _with_slow(sensor, rng, time=log_uniform(rng, 15, 30), above=10, crossing=(30.0, 10.0))
    return sensor.recorded(sensor.white(rng), rng)


def gm_300s(rng: Rng) -> Recording:
    """GM of about 300 s + WN + weak RW, 2 h at 50 Hz."""
    sensor = Sensor(N=log_uniform(rng, 0.05, 0.5) * DEG_PER_ROOT_HOUR, rate=50.0, duration=7200.0)
    sensor = _with_slow(sensor, rng, time=log_uniform(rng, 200, 400), above=30, crossing=(8.0, 4.0))
    return sensor.recorded(sensor.white(rng), rng)


UNIT = {
    "gyro_x": (2.5e-7, 6e-7, ((2e-8, 0.2),), 0.0),
    "gyro_y": (0.0, 4e-7, ((3e-8, 4.0),), 2e-11),
    "gyro_z": (0.0, 5e-7, ((5e-8, 8.0), (1e-8, 0.2)), 0.0),
    "accel_x": (0.0, 3e-5, ((2e-6, 6.0),), 2.5e-10),
    "accel_y": (0.0, 2.5e-5, ((3e-6, 8.0), (4e-7, 0.2)), 0.0),
    "accel_z": (1e-5, 2e-5, (), 5e-11),
}
"""The unit of `gmwm demo`, which the README shows: Q², σ²_WN, (σ²_GM, β in 1/s) and γ² of each axis, at 100 Hz."""


def reference(rng: Rng) -> Recording:
    """Two hours of an axis of the README's unit."""
    axis = str(rng.choice(list(UNIT)))
    q2, sigma2, gm, gamma2 = UNIT[axis]
    sensor = Sensor(
        N=math.sqrt(sigma2 / 100), rate=100.0, duration=7200.0, gm=tuple((s2, 1 / beta) for s2, beta in gm),
        K=math.sqrt(gamma2 * 100), Q=math.sqrt(q2) / 100, axis=axis,
    )  # fmt: skip
    return sensor.recorded(sensor.white(rng), rng, facts={"axis": axis})


# --- the sensor's filter ----------------------------------------------------------------------------------------------


def _butterworth(order: int, rng: Rng) -> Recording:
    sensor, cut = ordinary(rng), rng.uniform(0.05, 0.3)
    sos = signal.butter(order, 2 * cut, output="sos")
    white = signal.sosfilt(sos, sensor.white(rng, WARM))[WARM:]
    shape = shape_of(*signal.butter(order, 2 * cut))
    return sensor.recorded(white, rng, shape=shape, structure=None, facts={"cut": cut})


def lowpass_1(rng: Rng) -> Recording:
    """Digital Butterworth of order 1, cut off at 0.05 to 0.3 of the rate."""
    return _butterworth(1, rng)


def lowpass_2(rng: Rng) -> Recording:
    """Digital Butterworth of order 2."""
    return _butterworth(2, rng)


def average(rng: Rng) -> Recording:
    """Mean of the last 2 to 8 samples."""
    sensor, width = ordinary(rng), int(rng.integers(2, 9))
    mean = np.full(width, 1 / width)
    white = np.convolve(sensor.white(rng, width - 1), mean, "valid")
    return sensor.recorded(white, rng, shape=shape_of(mean), structure=None, facts={"width": width})


def fir(rng: Rng) -> Recording:
    """Windowed sinc of 5 to 31 taps, cut off at 0.1 to 0.4 of the rate."""
    sensor, taps, cut = ordinary(rng), 2 * int(rng.integers(2, 16)) + 1, rng.uniform(0.1, 0.4)
    h = signal.firwin(taps, 2 * cut)
    white = np.convolve(sensor.white(rng, taps - 1), h, "valid")
    return sensor.recorded(white, rng, shape=shape_of(h), structure=None, facts={"taps": taps, "cut": cut})


def decimated(rng: Rng) -> Recording:
    """Low-pass at 3 to 8 times the rate, of which every third to eighth sample is kept.

    The filter is a Butterworth of order 1 or 2, or a mean over one and a half to three output intervals. What it leaves
    above half the output rate folds back, so N is the folded density at zero.
    """
    sensor, times = ordinary(rng), int(rng.integers(3, 9))
    kind = str(rng.choice(["order 1", "order 2", "mean"]))
    if kind == "mean":
        width = int(rng.integers(math.ceil(1.5 * times), 3 * times + 1))
        b, a, cut = np.full(width, 1 / width), np.ones(1), 1 / width
    else:
        cut = rng.uniform(0.15, 0.45) / times
        b, a = signal.butter(int(kind[-1]), 2 * cut)
    # White noise of density N at the internal rate has σ² = N² · rate · times.
    inside = sensor.sigma * math.sqrt(times) * rng.normal(size=(sensor.count + WARM) * times)
    white = signal.lfilter(b, a, inside)[WARM * times :: times]
    before = shape_of(b, a)

    def folded(theta: Array) -> Array:
        return sum((before((theta + 2 * np.pi * k) / times) for k in range(times)), np.zeros(theta.shape))

    N = sensor.N * math.sqrt(float(folded(np.zeros(1))[0]))
    facts = {"filter": kind, "times": times, "cut_of_output_rate": cut * times}
    return replace(sensor, N=N).recorded(white, rng, shape=folded, structure=None, facts=facts)


# --- the spectrum -----------------------------------------------------------------------------------------------------


def resonance(rng: Rng) -> Recording:
    """AR(2) of Q 2 to 10 beside white noise, at 5 Hz to 0.45 of the rate, its peak 3 to 30 times the white noise."""
    sensor, q = ordinary(rng), rng.uniform(2, 10)
    at, peak = rng.uniform(5, 0.45 * sensor.rate), log_uniform(rng, 3, 30)
    radius, angle = math.exp(-math.pi * at / (q * sensor.rate)), 2 * math.pi * at / sensor.rate
    a = np.array([1.0, -2 * radius * math.cos(angle), radius**2])
    gain = np.abs(signal.freqz([1.0], a, worN=[0.0, angle])[1]) ** 2
    size = sensor.sigma * math.sqrt(peak / gain[1])
    ringing = signal.lfilter([size], a, rng.normal(size=sensor.count + WARM))[WARM:]
    N = sensor.N * math.sqrt(1 + peak * gain[0] / gain[1])
    facts = {"frequency": at, "Q": q, "peak": peak, "share": at / sensor.rate}
    ring = shape_of(np.array([size / sensor.sigma]), a)
    return replace(sensor, N=N).recorded(
        sensor.white(rng) + ringing, rng, shape=lambda theta: 1 + ring(theta), structure=None, facts=facts
    )


def lines(rng: Rng) -> Recording:
    """One to three sinusoids of 0.03 to 0.5 of the white noise, some with harmonics, half with a wandering phase."""
    sensor = ordinary(rng)
    t, x, found, waves = np.arange(sensor.count) / sensor.rate, sensor.white(rng), [], []
    for _ in range(int(rng.integers(1, 4))):
        at, size = log_uniform(rng, 0.2, 0.45 * sensor.rate), sensor.sigma * log_uniform(rng, 0.03, 0.5)
        width = float(rng.choice([0.0, log_uniform(rng, 1e-4, 1e-2)]))
        phase = 2 * np.pi * at * t + rng.uniform(0, 2 * np.pi)
        # A phase that walks by a variance of 2π·width·t gives a Lorentzian of this full width (Hz) at half maximum.
        phase += np.cumsum(rng.normal(size=t.size) * math.sqrt(2 * math.pi * width / sensor.rate))
        overtones = (1.0, 0.5, 0.3) if rng.random() < 1 / 3 else (1.0,)
        for k, share in enumerate(overtones, start=1):
            if k * at < sensor.rate / 2:
                x += share * size * np.sin(k * phase)
                waves.append((k * at, share * size))
        found.append({"frequency": at, "amplitude": size, "width": width, "harmonics": len(overtones) - 1})
    return sensor.recorded(x, rng, lines=waves, structure=None, facts={"lines": found})


# --- tails and outliers -----------------------------------------------------------------------------------------------


def _student(freedom: int, rng: Rng) -> Recording:
    sensor = ordinary(rng)
    white = sensor.sigma * math.sqrt((freedom - 2) / freedom) * rng.standard_t(freedom, size=sensor.count)
    return sensor.recorded(white, rng)


def tails_t20(rng: Rng) -> Recording:
    """White noise from Student's t with 20 degrees of freedom."""
    return _student(20, rng)


def tails_t10(rng: Rng) -> Recording:
    return _student(10, rng)


def tails_t5(rng: Rng) -> Recording:
    return _student(5, rng)


def tails_laplace(rng: Rng) -> Recording:
    """White noise from Laplace's distribution."""
    sensor = ordinary(rng)
    return sensor.recorded(rng.laplace(scale=sensor.sigma / math.sqrt(2), size=sensor.count), rng)


def varying(rng: Rng) -> Recording:
    """White noise whose standard deviation goes up and down by 10 to 40 % once to six times; N is its mean density."""
    sensor, depth, cycles = ordinary(rng), rng.uniform(0.1, 0.4), rng.uniform(1, 6)
    size = 1 + depth * np.sin(2 * np.pi * (cycles * np.arange(sensor.count) / sensor.count + rng.random()))
    N = sensor.N * math.sqrt(float(np.mean(size**2)))
    facts = {"depth": depth, "cycles": cycles}
    return replace(sensor, N=N).recorded(size * sensor.white(rng), rng, facts=facts)


def spikes(rng: Rng) -> Recording:
    """Isolated wrong samples: 0.1 to 5 % of them, off by 5 to 50 standard deviations; N is that without them."""
    sensor, share, size = ordinary(rng), log_uniform(rng, 0.001, 0.05), log_uniform(rng, 5, 50)
    white = sensor.white(rng)
    places = np.flatnonzero(rng.random(sensor.count) < share)
    # At least three samples apart.
    places = places[np.concatenate([[True], np.diff(places) > 2])]
    white[places] += sensor.sigma * size * rng.choice([-1.0, 1.0], places.size) * rng.uniform(0.8, 1.2, places.size)
    present = math.sqrt(float(np.var(white)) / sensor.rate)
    facts = {"share": places.size / sensor.count, "size": size, "N_present": present}
    return sensor.recorded(white, rng, facts=facts)


def knocks(rng: Rng) -> Recording:
    """3 to 20 knocks that ring for 0.1 to 1 s with 20 to 200 standard deviations; N is that without them."""
    sensor, count, size = ordinary(rng), int(rng.integers(3, 21)), log_uniform(rng, 20, 200)
    x = sensor.white(rng)
    for begin in rng.integers(0, sensor.count, count):
        time, at = log_uniform(rng, 0.1, 1.0), rng.uniform(2, 0.3 * sensor.rate)
        t = np.arange(min(round(8 * time * sensor.rate), sensor.count - begin)) / sensor.rate
        x[begin : begin + t.size] += sensor.sigma * size * np.exp(-t / time) * np.sin(2 * np.pi * at * t)
    return sensor.recorded(x, rng, facts={"count": count, "size": size})


# --- the output -------------------------------------------------------------------------------------------------------


def _quantized(low: float, high: float, rng: Rng) -> Recording:
    """Rounded to a step between `low` and `high` white standard deviations.

    Given the slow part s, the rounded samples are independent with the mean m(s) and the variance v(s), both known. So
    N² is the mean of v over the recording, by the rate: about σ² + step²/12 for steps below 2 standard deviations. The
    slow terms become m(s), which is s up to 0.3 % of the step for those steps, and a staircase for coarser ones.
    """
    sensor, steps = ordinary(rng), rng.uniform(low, high)
    step, slow = steps * sensor.sigma, sensor.slow(rng)
    places = np.linspace(-0.5, 0.5, 401)
    variances = step**2 * np.interp(slow / step - np.rint(slow / step), places, _rounded_variance(places, 1 / steps))
    output = replace(sensor, N=math.sqrt(float(np.mean(variances)) / sensor.rate))
    lowest = output.lowest() if steps <= 2 else None
    truth = output.truth(lowest=lowest, facts={"steps": steps, "sensor_N": sensor.N})
    samples = step * np.rint((slow + sensor.white(rng)) / step)
    return Recording(samples=samples, rate=sensor.rate, truth=truth, axis=sensor.axis)


def _rounded_variance(mean: Array, sigma: float) -> Array:
    """Variance of a Gaussian of these means and this standard deviation, rounded to whole numbers."""
    k = np.arange(-math.ceil(8 * sigma) - 2, math.ceil(8 * sigma) + 3)
    below = special.ndtr((k + 0.5 - mean[:, None]) / sigma)
    share = np.diff(below, axis=1, prepend=0.0)
    variance: Array = share @ k**2 - (share @ k) ** 2
    return variance


def quantized_fine(rng: Rng) -> Recording:
    """Rounded to 0.3 to 2 standard deviations of the white noise."""
    return _quantized(0.3, 2.0, rng)


def quantized_coarse(rng: Rng) -> Recording:
    """Rounded to 2 to 4 standard deviations of the white noise."""
    return _quantized(2.0, 4.0, rng)


def _flickering(low: float, high: float, rng: Rng) -> Recording:
    """White and flicker noise of the same density at a frequency between `low` and `high` (Hz)."""
    sensor, corner = ordinary(rng, slow=False), log_uniform(rng, low, high)
    # One-sided densities: 2N² and B²/(πf).
    sensor = replace(sensor, B=sensor.N * math.sqrt(2 * math.pi * corner))
    return sensor.recorded(sensor.white(rng), rng, facts={"corner": corner})


def flicker_weak(rng: Rng) -> Recording:
    """Flicker noise with its corner at 1 to 10 mHz."""
    return _flickering(1e-3, 1e-2, rng)


def flicker_medium(rng: Rng) -> Recording:
    """Flicker noise with its corner at 10 to 300 mHz."""
    return _flickering(1e-2, 0.3, rng)


def flicker_strong(rng: Rng) -> Recording:
    """Flicker noise with its corner at 0.3 to 5 Hz."""
    return _flickering(0.3, 5, rng)


def warm_up(rng: Rng) -> Recording:
    """Exponential of 15 to 150 times the Allan deviation at its time constant, 0.05 to 0.4 of the recording."""
    sensor = ordinary(rng)
    time, times = sensor.duration * log_uniform(rng, 0.05, 0.4), log_uniform(rng, 15, 150)
    size = times * math.sqrt(float(sensor.allan_variance(np.array([time]))[0])) * float(rng.choice([-1, 1]))
    plain = sensor.recorded(sensor.white(rng), rng, facts={"size": size, "time": time, "times": times})
    t = np.arange(sensor.count) / sensor.rate
    return replace(plain, samples=plain.samples + size * np.exp(-t / time))


def drift(rng: Rng) -> Recording:
    """Polynomial of degree 1 to 3 that moves by 15 to 150 times the Allan deviation at a quarter of the recording."""
    sensor, degree, times = ordinary(rng), int(rng.integers(1, 4)), log_uniform(rng, 15, 150)
    size = times * math.sqrt(float(sensor.allan_variance(np.array([sensor.duration / 4]))[0]))
    trend = np.polynomial.legendre.legval(
        np.linspace(-1, 1, sensor.count), [0.0, *rng.normal(size=degree - 1), float(rng.choice([-1, 1]))]
    )
    trend *= size / np.ptp(trend)
    ramp = (trend[-1] - trend[0]) / sensor.duration if degree == 1 else None
    facts = {"degree": degree, "times": times, "size": size}
    structure = f"{sensor.structure} + DR" if degree == 1 else None
    slope = float(np.sqrt(np.mean(np.diff(trend) ** 2))) * sensor.rate
    plain = sensor.recorded(sensor.white(rng), rng, slope=slope, R=ramp, lowest=None, structure=structure, facts=facts)
    return replace(plain, samples=plain.samples + trend)


KINDS: dict[str, Callable[[Rng], Recording]] = {
    f.__name__.replace("_", "-"): f
    for f in (
        base, gm_20s, gm_300s, reference, lowpass_1, lowpass_2, average, fir, decimated, resonance, lines, tails_t20,
        tails_t10, tails_t5, tails_laplace, varying, spikes, knocks, quantized_fine, quantized_coarse, flicker_weak,
        flicker_medium, flicker_strong, warm_up, drift,
    )
}  # fmt: skip
"""Every departure by its name."""

PAIRS = {"agree-20s": 20.0, "agree-1min": 60.0, "agree-5min": 300.0, "agree-1h": 3600.0}
"""Length (s) of two recordings of one sensor, by name."""


def pair(duration: float, rng: Rng) -> tuple[Recording, Recording]:
    """Two recordings of the same sensor, which has not changed; it is drawn as for an hour, whatever is recorded."""
    sensor = Sensor(N=log_uniform(rng, 0.02, 0.5) * DEG_PER_ROOT_HOUR, rate=100.0, duration=3600.0)
    sensor = replace(_with_slow(sensor, rng, time=log_uniform(rng, 0.5, 20)), duration=duration)
    first, second = (sensor.recorded(sensor.white(rng), rng) for _ in range(2))
    return first, second
