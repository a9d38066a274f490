"""Find periodic changes of the mean of which a recording shows only a few periods, as from air conditioning."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.inspection.knocks import level_length
from gmwm.measuring.inspection.time_grid import Extent
from gmwm.measuring.inspection.trends import FEWEST, longest_means
from gmwm.measuring.inspection.wander import Likelihood
from gmwm.measuring.spectrum.line import Line

_PERIODS = np.arange(2.0, 16.01, 0.5)
"""Numbers of periods in the recording that are tested. A faster change is a line in the spectrum."""
_GAIN = 20.0
"""Reduction of −2 log L by a sinusoid above which it is not chance (validation/study_faults.py, as the next one)."""
_MATTERS = 1.1
"""Smallest ratio of K, as if the swing were noise, to the upper 95 % limit of K without it."""


DAY_S = 86400.0
"""Period (s) of the change from day to night."""
_DAYS, _HARMONICS = 3.0, 3
"""Smallest number of days in which a daily cycle differs from a random walk, and number of harmonics to try."""


@dataclass(frozen=True, kw_only=True)
class Swing:
    """A periodic change of the mean of an axis. `period` (s) is its period, `periods` their number in the recording,
    and `amplitude` half of the change, in the unit of the axis. A change from day to night has the amplitudes of its
    `harmonics`, the first included."""

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
    """The best sinusoid in block means: the reduction of −2 log L, the number of periods, its transformed courses, and
    the index of the noise model."""

    gain: float
    periods: float
    courses: Matrix
    model: int


def best_swing(likelihood: Likelihood) -> SwingFit:
    """Return the sinusoid that describes block means best, in addition to noise."""
    size = likelihood.z.size + 1
    at = 2 * np.pi * (np.arange(size) + 0.5) / size
    base = float(np.min(likelihood.without().values))
    fits = []
    for periods in _PERIODS.tolist():
        courses = likelihood.transform(np.vstack([np.cos(periods * at), np.sin(periods * at)]))
        values = likelihood.with_two(courses[0], courses[1]).values
        fits.append(SwingFit(base - float(np.min(values)), periods, courses, int(np.argmin(values))))
    return max(fits, key=lambda fit: fit.gain)


def swing_of(axis: str, means: Sequence[tuple[int, Vector]], extent: Extent) -> Swing | None:
    """Find a periodic change of the mean of an axis; None if there is none, or if it is part of its noise.

    The test is that of `trend_of`, with a sinusoid of 2 to 16 periods. A swing must also raise K beyond what the noise
    shows without it. In a recording of three days or more, a day with its harmonics is tried first.
    """
    length = level_length(extent.samples)
    _, y = longest_means(means, extent, length)
    if y.size < FEWEST or not np.any(np.diff(y)):
        return None
    likelihood = Likelihood(y)
    periods = y.size * length / extent.rate / DAY_S
    fit, harmonics = best_swing(likelihood), 1
    if periods >= _DAYS:
        day = _fit_of(likelihood, periods * np.arange(1.0, _HARMONICS + 1))
        if day.gain > fit.gain - _GAIN:
            fit, harmonics = day, _HARMONICS
    if fit.gain < _GAIN * (1 if harmonics == 1 else 1.5):
        return None
    with_swing, _ = likelihood.walk(fit.courses[:0], alone=True)
    _, limit = likelihood.walk(fit.courses, alone=True)
    if with_swing <= _MATTERS**2 * limit:
        return None
    root = np.sqrt(likelihood.grid.weights[fit.model])
    coefficients = np.linalg.lstsq((fit.courses * root).T, likelihood.z * root, rcond=None)[0]
    amplitudes = np.hypot(*coefficients.reshape(2, harmonics)).tolist()
    return Swing(
        axis=axis, period=y.size * length / extent.rate / fit.periods, periods=fit.periods, amplitude=amplitudes[0],
        harmonics=tuple(amplitudes) if harmonics > 1 else (),
    )  # fmt: skip


def _fit_of(likelihood: Likelihood, periods: Vector) -> SwingFit:
    """Return the fit of sinusoids of these numbers of periods together."""
    size = likelihood.z.size + 1
    at = 2 * np.pi * np.outer(periods, np.arange(size) + 0.5) / size
    courses = likelihood.transform(np.vstack([np.cos(at), np.sin(at)]))
    without = likelihood.without().values
    gain = float(np.min(without)) - likelihood.with_all(courses)
    return SwingFit(gain, float(periods[0]), courses, int(np.argmin(without)))
