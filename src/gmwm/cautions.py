"""What the look of a recording means for the answer, in plain words: one sentence for each thing to beware of."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from gmwm._text import OVERRULED, counted, moment
from gmwm.time_base import TimeBase
from gmwm.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from gmwm.inspection import AxisInspection
    from gmwm.inspection.knocks import Knock, Step
    from gmwm.inspection.warm_up import WarmUp

MOVED = 1.0
"""Degrees of the direction of gravity that mean motion: a bias of 17 mg would do the same."""

_NOISY = 0.1  # deg/s/√Hz: noise density of a gyroscope beyond which its unit is in doubt
_WITHOUT = "leave that stretch out (skip=), or record again"
_BESIDE = "take what comes before or after it (stop=, start=), or record again"
OR_ROBUST = ", or leave that to the robust curve, which calibrate takes by itself where it matters"
"""The third way with knocks, for who has not estimated yet."""
LONGEST = "imu.longest() takes the longest of them"
"""The way with gaps, for who has the recording in hand."""
ALONE = "the longest of them can be taken alone"
"""The same, for who reads of it later."""

_OFF, _WRONG = 0.02, 0.05
"""Relative errors of the specific force: beyond the bias of a good accelerometer, and beyond that of any."""

_RIGHT = "is the unit right"
_REMOVED = "was gravity removed?"
_RANGE = "is more than inertial gyroscopes at rest have"
_DECLARED = "the unit was declared against the file"
_LEVEL = "long scales take for a random walk"


def about_time(segments: int, base: TimeBase) -> list[str]:
    """What the time base, and the number of stretches without a gap, mean for the answer."""
    said = []
    if segments > 1:
        lost = sum(duration - 1 / base.rate for _, duration in base.gaps)
        said.append(
            f"{segments} segments with {span(lost)} missing between them: wavelet variances take the "
            f"coefficients of all together, none across a gap; {LONGEST}"
        )
    if base.duplicates:
        said.append(f"time stamps that repeat the one before: {base.duplicates}")
    if base.backward:
        said.append(f"time stamps that step backward: {base.backward}")
    if base.jitter * base.rate > 0.1:
        said.append(
            f"the time stamps jitter by {100 * base.jitter * base.rate:.0f} % of the interval: if the samples do, "
            "short scales are blurred; if only the stamps do, nothing is lost"
        )
    return said


def about_motion(
    restless: Mapping[str, tuple[float, float]], tilt: float | None, knocks: tuple[Knock, ...]
) -> list[str]:
    """What motion means for the answer."""
    said = []
    if restless:
        axis = max(restless, key=lambda name: restless[name][1])
        when, times = restless[axis]
        said.append(
            f"not static: around {moment(when)} the spread of {axis} is {times:.1f} times its usual one; {_WITHOUT}"
        )
    if tilt is not None and tilt > MOVED:
        said.append(f"not static: the specific force turns by {tilt:.3g}°; {_BESIDE}")
    elif tilt is not None:
        said.append(
            f"the specific force turns by {tilt:.2g}°, more than its noise explains: the mount settles, or the "
            "accelerometers' biases wander (with temperature?)"
        )
    if knocks:
        what = f"{counted(len(knocks), 'knock')} (the first at {moment(knocks[0].time)}), which "
        what += "raises the curve" if len(knocks) == 1 else "raise the curve"
        them = "it" if len(knocks) == 1 else "them"
        said.append(f"{what}: cut {them} out (skip=), or record again{OR_ROBUST}")
    return said


def about_steps(steps: tuple[Step, ...]) -> list[str]:
    """What steps of level mean for the answer."""
    if not steps:
        return []
    axes = ", ".join(dict.fromkeys(step.axis for step in steps))
    what = f"{counted(len(steps), 'step')} of level in {axes} (the first at {moment(steps[0].time)})"
    return [f"{what}, which {_LEVEL}; {_BESIDE}"]


def about_warm_up(warm_ups: tuple[WarmUp, ...], cut: bool) -> list[str]:
    """What a level that settles in the beginning means for the answer.

    Parameters
    ----------
    warm_ups : tuple of WarmUp
    cut : bool
        Whether something is cut off already: then start counts from elsewhere.
    """
    if not warm_ups:
        return []
    axes = ", ".join(found.axis for found in warm_ups)
    longest = max(found.duration for found in warm_ups)
    first = round_up(longest)
    way = f"leave the first {span(first)} out (start={first:g})"
    if cut:
        way = f"leave another {span(first)} out at the beginning"
    return [f"{axes}: the level settles over the first {span(longest)}, as that of a sensor that warms up, which "
            f"{_LEVEL}; {way}"]  # fmt: skip


def round_up(seconds: float) -> float:
    """The next length of time that people would type: up to 20 of a step.

    >>> [round_up(x) for x in (0.3, 47.0, 233.0, 1500.0, 9000.0)]
    [1.0, 50.0, 240.0, 1500.0, 9000.0]
    """
    step = next((step for step in (1.0, 10.0, 60.0, 300.0, 1800.0) if seconds <= 20 * step), 3600.0)
    return math.ceil(seconds / step) * step


def about_values(axes: Mapping[str, AxisInspection], gravity: float | None) -> list[str]:
    """What the numbers themselves say."""
    said = []
    error = 0.0 if gravity is None else gravity / STANDARD_GRAVITY - 1
    if abs(error) > _OFF:
        said.append(
            f"the specific force is {gravity:.4g} m/s², not {STANDARD_GRAVITY:.4g}: {_RIGHT}, "
            + (_REMOVED if abs(error) > _WRONG else f"or is this {100 * error:+.1f} % a bias or scale?")
        )
    coarse = [name for name, axis in axes.items() if axis.lsb is not None and axis.noise < 0.5 * axis.lsb]
    if coarse:
        said.append(
            f"{', '.join(coarse)}: the noise is below half a quantisation step, so short scales show the step, "
            "not the sensor"
        )
    return said


def about_units(densities: Mapping[str, float]) -> list[str]:
    """Gyroscopes so noisy that their unit is in doubt: deg/s taken for rad/s makes 57 times the noise.

    Parameters
    ----------
    densities : mapping of axis to float
        Their noise density (rad/s/√Hz).
    """
    found = {axis: degrees for axis, density in densities.items() if (degrees := math.degrees(density)) > _NOISY}
    if not found:
        return []
    return [
        f"{', '.join(found)}: a noise of {max(found.values()):.3g} deg/s/√Hz {_RANGE} "
        f"(0.002 to {_NOISY:g}): {_RIGHT}? If the numbers of the file are in deg/s, say "
        'units={"gyro": "deg/s"}'
    ]


def about_declared(notes: Sequence[str]) -> list[str]:
    """Units that were declared against what the file itself says."""
    return [
        f"{_DECLARED}: {note}. If the file is right, every number is wrong by their ratio"
        for note in notes
        if OVERRULED in note
    ]


def doubts(cautions: Sequence[str]) -> dict[str, bool]:
    """Those that say that the numbers may be wrong by a factor, and whether nothing but that explains what was seen.

    >>> doubts(["the specific force is 19.61 m/s², not 9.807: is the unit right, was gravity removed?", "2 knocks"])
    {'the specific force is 19.61 m/s², not 9.807: is the unit right, was gravity removed?': True}
    """
    found = [text for text in cautions if _RIGHT in text or _DECLARED in text]
    return {text: _REMOVED in text or _RANGE in text for text in found}


def shifts(cautions: Sequence[str]) -> tuple[str, ...]:
    """Those that say that the level of an axis changed for good."""
    return tuple(text for text in cautions if _LEVEL in text)


def span(seconds: float) -> str:
    """A length of time for people."""
    for unit, length in (("d", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * length:
            return f"{seconds / length:.3g} {unit}"
    return f"{seconds:.3g} s"
