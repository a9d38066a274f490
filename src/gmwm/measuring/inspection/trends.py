"""Find trends of the mean of an axis: smooth functions, such as a warm-up, and periodic changes of few periods in the
recording, as from air conditioning."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.threads import computed_once
from gmwm.measuring.inspection.knocks import level_length
from gmwm.measuring.inspection.time_grid import Extent
from gmwm.measuring.inspection.wander import CoursePairs, CourseProfile, Likelihood, grid_of, transformed, waves_of
from gmwm.measuring.spectrum.line import Line
from gmwm.recording.batches import BATCH_SAMPLES

Kind = Literal["exponential", "linear", "quadratic"]

FEWEST = 48
"""Smallest number of blocks for the test (tests/test_inspection_trends.py: false alarms at 70 and 256 blocks)."""
_SIZE = 0.01  # significance level of the test (docs/validation/trends.md)
_TAIL = (8.5, 0.4)
"""The statistic exceeds t with probability 0.1·exp(−0.4 (t − 8.5)) for a random walk of moderate size, the noise that
is most often mistaken for a trend (docs/validation/trends.md)."""
_LEFT = 0.95
"""Share of the random walk that is left without a warm-up, from which on the warm-up is small: it then moves K by at
most a quarter of its 95 % interval, which is about ± 20 % for a recording of hours (docs/validation/filter.md)."""
EXTRA = 2.0  # improvement of −2 log L that is subtracted for a second parameter, as in Akaike's criterion


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A smooth course of the mean of an axis: "exponential" (a e^{−t/τ}), "linear" or "quadratic".

    `size` is a, or first minus last; `tau` is τ (s), and `until` the time (s) from which an exponential is below one
    standard error. `walk`, `walk_limit` and `walk_with_trend` are the random walk besides the trend (unit/√s), its 95 %
    upper limit if a Gauss-Markov process can replace it, and the walk with the trend as noise. `pvalue` is that of
    noise without a trend."""

    axis: str
    kind: Kind
    size: float
    tau: float | None
    pvalue: float
    until: float | None
    walk: float
    walk_limit: float
    walk_with_trend: float

    @property
    def settles(self) -> bool:
        """Whether the trend is a warm-up: an exponential that falls by at least a factor e in the recording."""
        return self.until is not None

    @property
    def is_small(self) -> bool:
        """Whether the trend hardly raises the random walk."""
        return self.share >= _LEFT

    @property
    def share(self) -> float:
        """Share of the random walk that is left if the trend is no noise."""
        return min(self.walk / self.walk_with_trend, 1.0) if self.walk_with_trend else 1.0


def trend_of(axis: str, means: Sequence[tuple[int, Vector]], extent: Extent) -> Trend | None:
    """Find the trend of an axis; None if there is none.

    Noise alone (white, walk, Gauss-Markov, by maximum likelihood) is compared with noise and a trend, for about 256
    block means, so that a sensor's drift is no trend. The reduction of −2 log L has a simulated distribution
    (docs/validation/trends.md; Davies 1987, Biometrika 74, 33-43). The level is 1 %, and a jump must not describe the
    means better.

    >>> import numpy as np
    >>> means = 5 * np.exp(-np.arange(256) / 50) + np.random.default_rng(0).normal(size=256)
    >>> found = trend_of("gyro_x", [(0, means)], Extent(100.0, ((0, 25_600),), (0.0,)))
    >>> found.kind, round(found.tau)
    ('exponential', 61)
    """
    length = level_length(extent.samples)
    samples, y = longest_means(means, extent, length)
    if y.size < FEWEST or not np.any(np.diff(y)):
        return None
    test = BlockMeans(y).trend
    if test.kind is None or test.pvalue > _SIZE:
        return None
    step, start = length / extent.rate, float(extent.times(samples[:1])[0]) - extent.starts[0]
    scale = 1 / math.sqrt(step)
    walk, limit, walk_with_trend = test.walks()
    until = test.until()
    return Trend(
        axis=axis, kind=test.kind, size=test.size(), tau=None if test.kind != "exponential" else test.tau * step,
        pvalue=test.pvalue, until=None if until is None else start + until * step, walk=math.sqrt(walk) * scale,
        walk_limit=math.sqrt(limit) * scale, walk_with_trend=math.sqrt(walk_with_trend) * scale,
    )  # fmt: skip


def longest_means(means: Sequence[tuple[int, Vector]], extent: Extent, length: int) -> tuple[NDArray[np.int64], Vector]:
    """Return the first samples and the means of the blocks of the longest part whose gaps are shorter than a block."""
    parts: list[list[tuple[int, Vector]]] = []
    ends = -math.inf
    last_of = dict(extent.unbroken)
    for first, block_means in means:
        start, end = extent.times([first, last_of[first] - 1])
        if start - ends > length / extent.rate:
            parts.append([])
        parts[-1].append((first, block_means))
        ends = end + 1 / extent.rate
    if not parts:
        return np.empty(0, dtype=np.int64), np.empty(0)
    most = max(parts, key=lambda part: sum(block_means.size for _, block_means in part))
    samples = [first + length * np.arange(block_means.size) for first, block_means in most]
    return np.concatenate(samples), np.concatenate([block_means for _, block_means in most])


class TrendTest:
    """Test for a trend in block means, times in blocks. `statistic` is the reduction of −2 log L, minus `EXTRA` for a
    second parameter; `kind` is None if a jump describes the means better."""

    def __init__(self, likelihood: Likelihood) -> None:
        self._likelihood, self._means = likelihood, likelihood.means
        n = self._means.size
        self._none = likelihood.without()
        times = np.geomspace(1.0, 1.5 * n, 18)
        decays, courses = self._decays(times)
        j = _best(decays)
        ratio = times[1] / times[0]
        finer = times[j] * np.geomspace(1 / ratio, ratio, 9)
        decays, courses = self._decays(finer[finer <= times[-1]])
        j = _best(decays)
        self.tau = float(finer[j])
        self._decay = courses[j]
        self._exponential = CourseProfile(decays.values[:, [j]], decays.squares[:, [j]])
        lines = _lines_of(n)
        self._line, self._lines = likelihood.with_one(lines.first, lines.squares[0]), np.vstack(lines[:2])
        self._parabola = likelihood.with_pairs(lines)
        base = np.min(self._none.values)
        gains: dict[Kind, float] = {
            "exponential": float(base - np.min(self._exponential.values)) - EXTRA,
            "linear": float(base - np.min(self._line.values)),
            "quadratic": float(base - np.min(self._parabola.values)) - EXTRA,
        }
        self.statistic = max(gains.values())
        # Of about equally good shapes, a line is preferred, then an exponential, which has a physical cause.
        near = [kind for kind, gain in gains.items() if gain >= self.statistic - EXTRA]
        self.kind: Kind | None = "linear" if "linear" in near else near[0]
        models = np.array([int(np.argmin(p.values)) for p in (self._none, self._profile())])
        # A jump in the first three blocks is treated as a warm-up.
        if base - np.min(likelihood.with_steps(models, 4, n - 1)) - EXTRA > self.statistic:
            self.kind = None
        self.pvalue = min(1.0, 0.1 * math.exp(-_TAIL[1] * (self.statistic - _TAIL[0])))

    def size(self) -> float:
        """Return the coefficient of the exponential, or the first value of the line or parabola minus the last one."""
        course = self.course()
        return float(course[0] - course[-1]) if self.kind != "exponential" else self._size

    def walks(self) -> tuple[float, float, float]:
        """Return γ² of the walk per block beside a trend, its 95 % limit, and γ² with the trend as noise."""
        likelihood, at = self._likelihood, np.arange(self._means.size) + 0.5
        courses = self._lines if self.kind == "quadratic" else self._lines[:1]
        if self.kind == "exponential":
            decay = np.exp(-at / self.tau)
            courses = transformed(np.vstack([decay, at / self.tau * decay]))
        walk, with_trend = (likelihood.walk(of, alone=True)[0] for of in (courses, courses[:0]))
        return walk, likelihood.walk(courses)[1], with_trend

    def until(self) -> float | None:
        """Return the time (blocks) after which the rest of a warm-up is below one standard error of the noise."""
        n, profile = self._means.size, self._profile()
        if self.kind != "exponential" or self.tau > n:
            return None
        model = int(np.argmin(profile.values))
        weights = self._likelihood.grid.weights[model] * (n - 1) / profile.squares[model, 0]
        # The transform of the rest of the trend after block s is a sum over its differences from s on.
        parts = self._likelihood.grid.transform * np.diff(self.course())
        rests = np.cumsum(parts[:, ::-1], axis=1)[:, ::-1]
        visible = np.flatnonzero(weights @ rests**2 > 1.0)
        return float(visible[-1] + 1) if visible.size else 0.0

    def _profile(self) -> CourseProfile:
        return {"exponential": self._exponential, "linear": self._line}.get(self.kind or "", self._parabola)

    @property
    def _size(self) -> float:
        return self._likelihood.coefficient(int(np.argmin(self._exponential.values)), self._decay)

    def course(self) -> Vector:
        """Return the value of the trend in each block, up to a constant."""
        n, likelihood = self._means.size, self._likelihood
        at = np.arange(n) + 0.5
        if self.kind == "exponential":
            return np.asarray(self._size * np.exp(-at / self.tau))
        model = int(np.argmin(self._profile().values))
        if self.kind == "linear":
            return np.asarray(likelihood.coefficient(model, self._lines[0]) * at / n)
        root = np.sqrt(likelihood.grid.weights[model])
        line, curve = np.linalg.lstsq((self._lines * root).T, likelihood.z * root, rcond=None)[0]
        return np.asarray(line * at / n + curve * (at / n) ** 2)

    def _decays(self, times: Vector) -> tuple[CourseProfile, Matrix]:
        """Return the profile likelihoods with an exponential of each time constant, and the exponentials."""
        courses, squares = _decays_of(self._means.size, tuple(times.tolist()))
        return self._likelihood.with_one(courses, squares), courses


@computed_once(20)
def _decays_of(blocks: int, times: tuple[float, ...]) -> tuple[Matrix, Matrix]:
    """Return transformed exponentials of these time constants, the same for all axes, and Σ c²/λ of each."""
    courses = transformed(np.exp(-(np.arange(blocks) + 0.5) / np.array(times)[:, None]))
    return courses, grid_of(blocks).weights @ (courses**2).T


@computed_once(2)
def _lines_of(blocks: int) -> CoursePairs:
    """Return a transformed line and parabola, from 0 to 1."""
    at = (np.arange(blocks) + 0.5) / blocks
    lines = transformed(np.vstack([at, at**2]))
    return CoursePairs.of(grid_of(blocks).weights, lines[:1], lines[1:])


def _best(profile: CourseProfile) -> int:
    """Return the index of the time constant with the largest likelihood."""
    return int(np.argmin(np.min(profile.values, axis=0)))


_PERIODS = np.arange(2.0, 16.01, 0.5)
"""Numbers of periods in the recording that are tested. A faster change is a line in the spectrum."""
_GAIN = 20.0
"""Reduction of −2 log L by a sinusoid above which it is not chance (validation/study_faults.py, as the next one)."""
_MATTERS = 1.1  # smallest ratio of K, as if the swing were noise, to the upper 95 % limit of K without it


_DAYS, _HARMONICS = 3.0, 3
"""Smallest number of days in which a daily cycle differs from a random walk, and number of harmonics to try. Of other
periods, three times as many are tried too: beside fewer, K contains the steps of a switch. Each counts as half of
`_GAIN`, which chance does not reach (tests/test_inspection_faults.py)."""


@dataclass(frozen=True, kw_only=True)
class Swing:
    """A periodic change of the mean: period (s), number of periods, and amplitude (half of the change). A change from
    day to night has the amplitudes of its `harmonics`, the first included."""

    axis: str
    period: float
    periods: float
    amplitude: float
    harmonics: tuple[float, ...] = ()

    def lines(self) -> tuple[Line, ...]:
        """Return the harmonics of a day as lines of a spectrum."""
        return tuple(
            Line(frequency=k / self.period, frequency_error=0.0, amplitude=amplitude, amplitude_error=0.0, width=0.0,
                 height=1.0, p_value=0.0)
            for k, amplitude in enumerate(self.harmonics, start=1)
        )  # fmt: skip


class SwingFit(NamedTuple):
    """Best sinusoid: reduction of −2 log L, number of periods, transformed courses, index of the noise model."""

    gain: float
    periods: float
    courses: Matrix
    model: int


class BlockMeans(Likelihood):
    """Block means with their trend and their best sinusoid, each computed once."""

    @cached_property
    def trend(self) -> TrendTest:
        """The test for a trend."""
        return TrendTest(self)

    @cached_property
    def swing(self) -> SwingFit:
        """The sinusoid that describes the means best, in addition to noise."""
        waves = waves_of(self.size, tuple(_PERIODS.tolist()))
        values = self.with_pairs(waves).values
        model, k = np.unravel_index(np.argmin(values), values.shape)
        gain = float(np.min(self.without().values) - values[model, k])
        return SwingFit(gain, float(_PERIODS[k]), np.vstack([waves.first[k], waves.second[k]]), int(model))


def swing_of(
    axis: str, means: Sequence[tuple[int, Vector]], extent: Extent, values: Callable[[int, int], Vector]
) -> Swing | None:
    """Find a periodic change of the mean of an axis; None if there is none, or if it is part of its noise. As
    `trend_of`, with 2 to 16 periods, and harmonics if clear, or first a day with harmonics from 3 days on. A
    swing must raise K too. Otherwise, the period is that of a peak of the spectrum, as of a thermostat, whose periods
    differ."""
    length = level_length(extent.samples)
    samples, y = longest_means(means, extent, length)
    if y.size < FEWEST or not np.any(np.diff(y)):
        return None
    likelihood = BlockMeans(y)
    days = y.size * length / extent.rate / 86400.0
    fit, is_day = likelihood.swing, False
    if days >= _DAYS and (day := _with_harmonics(likelihood, np.array([days]), _HARMONICS)).gain > fit.gain - _GAIN:
        fit, is_day = day, True
    else:
        wave = _with_harmonics(likelihood, fit.periods + np.linspace(-0.25, 0.25, 11), _HARMONICS)
        waves = [fit, wave]
        if wave.gain > fit.gain + _GAIN / 2:
            waves.append(_with_harmonics(likelihood, np.array([wave.periods]), 3 * _HARMONICS))
        fit = max(waves, key=lambda wave: wave.gain - _GAIN / 4 * len(wave.courses))
    harmonics = len(fit.courses) // 2
    if fit.gain < _GAIN * (harmonics + 3) / 4:
        return _cycle_of(axis, likelihood, values, first=int(samples[0]), rate=extent.rate, length=length)
    with_swing, _ = likelihood.walk(fit.courses[:0], alone=True)
    _, limit = likelihood.walk(fit.courses, alone=True)
    if with_swing <= _MATTERS**2 * limit:
        return None
    root = np.sqrt(likelihood.grid.weights[fit.model])
    coefficients = np.linalg.lstsq((fit.courses * root).T, likelihood.z * root, rcond=None)[0]
    amplitudes = np.hypot(*coefficients.reshape(2, harmonics)).tolist()
    return Swing(
        axis=axis, period=y.size * length / extent.rate / fit.periods, periods=fit.periods, amplitude=amplitudes[0],
        harmonics=tuple(amplitudes) if is_day else (),
    )  # fmt: skip


def _cycle_of(
    axis: str, likelihood: Likelihood, values: Callable[[int, int], Vector], *, first: int, rate: float, length: int
) -> Swing | None:
    """Return the swing that a peak of the spectrum of block means shows; None if there is none, or if it is the alias
    of a fast oscillation, which shorter blocks have at another frequency."""
    gain, band = likelihood.best_band(int(2 * _PERIODS[0]))
    if gain < _GAIN:
        return None
    size = likelihood.size
    periods, reach = (band.start + band.stop + 1) / 4, (band.stop - band.start) / 4 + 1
    at = np.pi * periods / size
    power = float(np.sum(likelihood.z[band] ** 2)) / size / (2 * np.sin(at) * np.sinc(at / np.pi)) ** 2
    if size * length <= BATCH_SAMPLES:  # of longer blocks, fast oscillations have less power than noise
        short = length // 8 + 1
        fine = values(first, first + size * length)
        fine = fine[: fine.size // short * short].reshape(-1, short).mean(axis=1)
        window = np.hanning(fine.size)
        density = np.abs(np.fft.rfft((fine - np.mean(fine)) * window)) ** 2 * 2 / (fine.size * float(window @ window))
        near = np.abs(np.arange(density.size) * (size * length / (fine.size * short)) - periods) <= reach
        if float(np.sum(density[near])) < power / 2:
            return None
    return Swing(
        axis=axis, period=size * length / rate / periods, periods=float(round(periods)), amplitude=math.sqrt(2 * power)
    )


def _with_harmonics(likelihood: Likelihood, periods: Vector, count: int) -> SwingFit:
    """Return the fit of a sinusoid and its harmonics with the best of these numbers of periods beside a walk. A
    harmonic of less than two blocks is none."""
    at, waves = 2 * np.pi * (np.arange(likelihood.size) + 0.5) / likelihood.size, []
    for number in periods.tolist():
        harmonics = np.arange(1.0, min(count, (likelihood.size - 1) // (2 * number)) + 1)
        phases = number * np.outer(harmonics, at)
        waves.append((number, transformed(np.vstack([np.cos(phases), np.sin(phases)]))))
    number, courses = min(waves, key=lambda wave: likelihood.with_all(wave[1], alone=True))
    without = likelihood.without().values
    gain = float(np.min(without)) - likelihood.with_all(courses)
    return SwingFit(gain, number, courses, int(np.argmin(without)))
