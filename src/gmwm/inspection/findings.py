"""Remarks on a recording, from the results of its inspection."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from gmwm.remarks import Quantity, Remark
from gmwm.time_base import TimeBase
from gmwm.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from gmwm.inspection.knocks import Knock, Step
    from gmwm.inspection.result import AxisInspection
    from gmwm.inspection.warm_up import WarmUp

MOVED = 1.0
"""Turn of gravity (degrees) that means motion: an accelerometer bias of 17 mg has the same effect."""

_NOISY = 0.1
"""Noise density (deg/s/√Hz) at the upper end of low-cost gyroscopes (docs/howto/units.md)."""
_OFF = 0.02
"""Relative error of gravity beyond the bias of a good accelerometer (tests/test_inspection.py)."""
_WRONG = 0.05
"""Relative error of gravity that no bias explains, so that the unit is doubtful (tests/test_inspection.py)."""
_JITTER = 0.1
"""Jitter of the time stamps, as a share of the sampling interval, above which there is a remark
(tests/test_inspection.py)."""
_COARSE = 0.5
"""Noise in quantization steps below which the rounding error is not white (docs/howto/contaminated.md)."""


def of_time(segments: int, base: TimeBase) -> Iterator[Remark]:
    """Remarks on gaps and time stamps."""
    if segments > 1:
        missing = sum(duration - 1 / base.rate for _, duration in base.gaps)
        yield Remark.of("gaps", segments=segments, missing=Quantity(float(missing), "s"))
    if base.duplicates:
        yield Remark.of("stamps-repeated", count=base.duplicates)
    if base.backward:
        yield Remark.of("stamps-backward", count=base.backward)
    if base.jitter * base.rate > _JITTER:
        yield Remark.of("stamps-jitter", share=float(base.jitter * base.rate))


def of_motion(
    restless: Mapping[str, tuple[float, float]], tilt: float | None, knocks: tuple[Knock, ...]
) -> Iterator[Remark]:
    """Remarks on motion and knocks.

    Parameters
    ----------
    restless : mapping of axis to (time, ratio)
        Time (s) and factor by which the standard deviation exceeded its usual value, for axes where it did.
    tilt : float or None
        Turn of gravity that the noise does not explain (degrees).
    knocks : tuple of Knock
        Bursts of outliers.
    """
    if restless:
        axis = max(restless, key=lambda name: restless[name][1])
        time, ratio = restless[axis]
        yield Remark.of("recording-moved", axis, time=Quantity(time, "s"), ratio=ratio)
    if tilt is not None:
        yield Remark.of("recording-tilted" if tilt > MOVED else "recording-settles", angle=Quantity(tilt, "°"))
    if knocks:
        yield Remark.of("knocks", count=len(knocks), first=Quantity(knocks[0].time, "s"), handled="no")


def of_steps(steps: tuple[Step, ...]) -> Iterator[Remark]:
    """Remarks on lasting jumps of the mean, one for each axis."""
    for axis in dict.fromkeys(step.axis for step in steps):
        own = [step for step in steps if step.axis == axis]
        yield Remark.of("level-steps", axis, count=len(own), first=Quantity(own[0].time, "s"))


def of_warm_up(warm_ups: tuple[WarmUp, ...], cut: bool) -> Iterator[Remark]:
    """Remarks on warm-up, one for each axis.

    Parameters
    ----------
    warm_ups : tuple of WarmUp
        The warm-ups.
    cut : bool
        Whether the beginning of the file is already left out, so that times count from a later sample.
    """
    if not warm_ups:
        return
    longest = max(found.duration for found in warm_ups)
    first = Quantity(round_up(longest), "s")
    for found in warm_ups:
        yield Remark.of("warm-up", found.axis, duration=Quantity(longest, "s"), first=first, cut="yes" if cut else "no")


def round_up(seconds: float) -> float:
    """Round a length of time (s) up to a multiple of 1 s, 10 s, 1 min, 5 min, 30 min or 1 h, at most 20 of them.

    >>> [round_up(x) for x in (0.3, 47.0, 233.0, 1500.0, 9000.0)]
    [1.0, 50.0, 240.0, 1500.0, 9000.0]
    """
    step = next((step for step in (1.0, 10.0, 60.0, 300.0, 1800.0) if seconds <= 20 * step), 3600.0)
    return math.ceil(seconds / step) * step


def of_values(axes: Mapping[str, AxisInspection], gravity: float | None) -> Iterator[Remark]:
    """Remarks on the size of gravity and on quantization."""
    error = 0.0 if gravity is None else gravity / STANDARD_GRAVITY - 1
    if gravity is not None and abs(error) > _OFF:
        norm, expected = Quantity(gravity, "m/s²"), Quantity(STANDARD_GRAVITY, "m/s²")
        if abs(error) > _WRONG:
            yield Remark.of("gravity-wrong", norm=norm, expected=expected)
        else:
            yield Remark.of("gravity-off", norm=norm, expected=expected, share=100 * error)
    for name, axis in axes.items():
        if axis.lsb is not None and axis.noise < _COARSE * axis.lsb:
            yield Remark.of("coarse-output", name)


def of_units(densities: Mapping[str, float]) -> Iterator[Remark]:
    """Remarks on gyroscopes whose noise makes the unit doubtful: deg/s read as rad/s is 57 times the noise.

    Parameters
    ----------
    densities : mapping of axis to float
        Noise densities (rad/s/√Hz).
    """
    found = {axis: degrees for axis, density in densities.items() if (degrees := math.degrees(density)) > _NOISY}
    limit = Quantity(_NOISY, "deg/s/√Hz")
    for axis in found:
        yield Remark.of("gyro-too-noisy", axis, density=Quantity(max(found.values()), "deg/s/√Hz"), limit=limit)
