"""The verdict on a calibration in plain language: a headline, and one sentence for each thing that was looked at."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from gmwm.calibration.misfit import Misfit, undescribed
from gmwm.calibration.summary_text import rejected
from gmwm.calibration.tables import SENSORS, in_order
from gmwm.cautions import doubts, shifts
from gmwm.datasheets.entry import Entry, significant
from gmwm.inference.planning import SEEN, length_text
from gmwm.signals import by_sensor

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

State = Literal["good", "look", "bad"]
"""Nothing to do; read what is said; do not use before it is mended."""

_HEADLINES: Mapping[State, str] = {
    "good": "The calibration can be used as it stands.",
    "look": "The calibration can be used, with the cautions below.",
    "bad": "Look at what is wrong before using the calibration.",
}
_OTHERS: Mapping[State, str] = {
    "good": "the others can be used as they stand.",
    "look": "the others can be used, with the cautions below.",
    "bad": "look at what else is wrong before using the others.",
}
_ORDER: tuple[State, ...] = ("good", "look", "bad")


def verdict(calibration: Calibration) -> dict[str, Any]:
    """`{"state": …, "headline": …, "points": [{"state": …, "text": …}, …]}`, the worst state of the points on top."""
    useless = undescribed({axis: calibration.axes[axis] for axis in rejected(calibration)})
    points = [
        _about_axes(calibration), *_about_sensors(calibration, useless), *_about_fit(calibration, useless),
        _about_outliers(calibration), *_about_recording(calibration), *_about_units(calibration),
        *_about_errors(calibration), *_about_proof(calibration),
    ]  # fmt: skip
    state = max((point["state"] for point in points), key=_ORDER.index)
    if not useless:
        return {"state": state, "headline": _HEADLINES[state], "points": points}
    lost = _point("bad", _about_useless(useless))
    return {"state": "bad", "headline": _without(calibration, useless, state), "points": [lost, *points]}


def _without(calibration: Calibration, useless: Mapping[str, Misfit], state: State) -> str:
    """The headline where some axes cannot be used; `state` is that of all else."""
    count = len(calibration.axes)
    if len(useless) == count:
        return "The calibration cannot be used." if count == 1 else f"None of the {count} axes can be used."
    return f"{len(useless)} of {count} axes cannot be used ({', '.join(useless)}); {_OTHERS[state]}"


def _about_useless(useless: Mapping[str, Misfit]) -> str:
    """Which axes cannot be used, and why."""
    parts = [
        f"{axis} (its variance at {at.tau:.3g} s is {at.times:.2g} times too {'large' if at.ratio > 1 else 'small'})"
        for axis, at in useless.items()
    ]
    whose = "its model does" if len(parts) == 1 else "their models do"
    return f"{', '.join(parts)} cannot be used: {whose} not describe the curve, and a test rejects it. See below."


def _point(state: State, text: str) -> dict[str, Any]:
    return {"state": state, "text": text}


def _about_axes(calibration: Calibration) -> dict[str, Any]:
    done, failed = len(calibration.axes), calibration.failed
    if failed:
        missing = "; ".join(f"{axis}: {why}" for axis, why in failed.items())
        return _point("bad", f"{done} of {done + len(failed)} axes are calibrated. Not calibrated is {missing}.")
    wv = next(iter(calibration.axes.values())).fit.wavelet_variance
    long = length_text(wv.samples / wv.rate)
    axes = {1: "The one axis is", 2: "Both axes are"}.get(done, f"All {done} axes are")
    return _point("good", f"{axes} calibrated, from {long} of recording at {wv.rate:g} Hz.")


def _about_sensors(calibration: Calibration, useless: Mapping[str, Misfit]) -> list[dict[str, Any]]:
    """What each sensor has: the first numbers that anyone asks for, over the axes that can be used."""
    said = []
    for sensor, members in by_sensor(calibration.axes).items():
        axes = {axis: one for axis, one in members.items() if axis not in useless}
        sheets = [found.datasheet for found in axes.values()]
        numbers = []
        for symbol in in_order([list(sheet) for sheet in sheets]):
            entries = {axis: one.datasheet[symbol] for axis, one in axes.items() if symbol in one.datasheet}
            if symbol in _TOLD:
                numbers.append(f"{next(iter(entries.values())).title} {symbol} {_range(entries)}")
        if numbers:
            name = SENSORS.get(sensor, sensor or "Axes")
            only = f" ({', '.join(axes)} only)" if len(axes) < len(members) else ""
            said.append(_point("good", f"{name}{only}: {'; '.join(numbers)}."))
    return said


_TOLD = ("N", "B", "K")


def _range(entries: Mapping[str, Entry]) -> str:
    """From the smallest to the largest value; limits where the data only bound all of them."""
    known: dict[str, float] = {}
    bounds = []
    unit = ""
    for axis, entry in entries.items():
        value, _, high, unit = entry.in_units("datasheet")
        if not entry.upper_only:
            known[axis] = value
        elif high is not None and math.isfinite(high):
            bounds.append(high)
    if known:
        texts = dict.fromkeys(significant(value, 3) for value in (min(known.values()), max(known.values())))
        more = f" (on {', '.join(known)}; of others only a limit is known)" if len(known) < len(entries) else ""
        return f"{' to '.join(texts)} {unit}{more}"
    return f"at most {significant(max(bounds), 3)} {unit}" if bounds else "not determined"


def _about_fit(calibration: Calibration, useless: Mapping[str, Misfit]) -> list[dict[str, Any]]:
    bad = [axis for axis in rejected(calibration) if axis not in useless]
    tested = [axis for axis, found in calibration.axes.items() if found.test is not None and axis not in useless]
    if bad:
        return [
            _point(
                "look",
                f"On {', '.join(bad)} some scale is off the model by more than chance: the values describe the curve, "
                "but the truth may lie far outside their intervals.",
            )
        ]
    if len(useless) == len(calibration.axes):
        return []
    if not tested:
        return [_point("look", "The recording is too short for a test of the models.")]
    models = "The models of the other axes" if useless else "The models"
    return [
        _point("good", f"{models} describe the data within chance: no test rejects one, at 5 % for all axes together.")
    ]


def _about_outliers(calibration: Calibration) -> dict[str, Any]:
    looked = calibration.verdicts
    struck = [axis for axis, found in looked.items() if found.contaminated]
    if not looked:
        return _point("look", "Outliers were not looked for.")
    if not struck:
        blind = [axis for axis, found in looked.items() if not found.tested.any()]
        if len(blind) == len(looked):
            return _point("look", "Whether outliers raise the curves could not be tested.")
        untold = f"; not tested: {', '.join(blind)}" if blind else ""
        return _point("look" if blind else "good", f"No outliers raise the curves{untold}.")
    left = [axis for axis in struck if calibration.axes[axis].fit.wavelet_variance.robust]
    kept = [axis for axis in struck if axis not in left]
    parts = [f"left out of {', '.join(left)}"] if left else []
    parts += [f"kept in {', '.join(kept)}, whose noise is overstated"] if kept else []
    return _point("look", f"The recording was disturbed: its outliers are {'; and '.join(parts)}.")


def _about_recording(calibration: Calibration) -> list[dict[str, Any]]:
    recording = calibration.recording
    if recording is None:
        return []
    if not recording.static:
        return [_point("bad", "The unit did not stand still: the curves hold its motion as well as its noise.")]
    gaps = f", in {recording.segments} segments" if recording.segments > 1 else ""
    still = _point("good", f"The unit stood still{gaps}.")
    return [still, *(_point("look", _sentence(text)) for text in shifts(calibration.cautions))]


def _about_units(calibration: Calibration) -> list[dict[str, Any]]:
    """What says that the numbers may be wrong by a factor, which no test of a model can see."""
    return [_point("bad" if grave else "look", _sentence(text)) for text, grave in doubts(calibration.cautions).items()]


def _sentence(text: str) -> str:
    """A caution as a sentence; the name of an axis at its head stays as it is."""
    begun = text if "_" in text.split(maxsplit=1)[0] else f"{text[:1].upper()}{text[1:]}"
    return begun if begun.endswith((".", "?")) else f"{begun}."


def _about_errors(calibration: Calibration) -> list[dict[str, Any]]:
    poor = [axis for axis, found in calibration.axes.items() if found.needed]
    if not poor:
        return []
    return [
        _point("look", f"Some parameters of {', '.join(poor)} are known to no better than {100 * SEEN:g} %; see below.")
    ]


def _about_proof(calibration: Calibration) -> list[dict[str, Any]]:
    gaps = [found.fit.gap for found in calibration.axes.values()]
    proven = [gap for gap in gaps if gap is not None]
    if len(proven) < len(gaps):
        return []
    gain = f"more than {100 * max(proven):.2g} % of its objective" if max(proven) > 0 else "anything"
    return [_point("good", f"Each fit is proven best: no other values gain {gain}.")]
