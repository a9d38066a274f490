"""Combine the calibrations of sensors with different clocks into one calibration of the unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from gmwm.base.errors import DataError
from gmwm.base.remarks import Remark

if TYPE_CHECKING:
    from gmwm.calibration.recording_info import Recording
    from gmwm.calibration.result import Calibration


def combined(calibrations: Sequence[Calibration]) -> Calibration:
    """Return one calibration with the axes of all given calibrations. `Calibration.combined` describes the rules."""
    first = calibrations[0]
    if len(calibrations) == 1:
        return first
    axes = [axis for one in calibrations for axis in (*one.axes, *one.failed)]
    twice = sorted({axis for axis in axes if axes.count(axis) > 1})
    if twice:
        raise DataError(
            f"{twice[0]} is in more than one of {len(calibrations)} calibrations",
            advice="Combine calibrations of different sensors; several recordings of one sensor are calibrated "
            "together.",
        )
    if any(one.settings.confidence != first.settings.confidence for one in calibrations):
        raise DataError("the calibrations have different confidence levels", advice="Calibrate with the same level.")
    recordings: dict[str, Recording] = {}
    remarks: list[Remark] = []
    for one in calibrations:
        name = _name(one)
        own = one.recordings if one.recording is None else {name: one.recording}
        for key, value in own.items():
            recordings[key if key not in recordings else f"{key} ({len(recordings) + 1})"] = value
        remarks += [remark if remark.subject else remark.about(name) for remark in one.recording_remarks]
    return replace(
        first,
        axes={axis: found for one in calibrations for axis, found in one.axes.items()},
        failed={axis: reason for one in calibrations for axis, reason in one.failed.items()},
        source=" and ".join(dict.fromkeys(one.source for one in calibrations if one.source)),
        recording_remarks=tuple(remarks),
        recording=None,
        recordings=recordings,
    )


def _name(calibration: Calibration) -> str:
    """Return a name for the recording of a calibration: its topic, its source, or its axes."""
    topics = [str(r.facts["topic"]) for r in calibration.recording_remarks if r.code == "topic-read"]
    return topics[0] if len(topics) == 1 else calibration.source or " ".join(calibration.axes)
