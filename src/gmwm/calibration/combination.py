"""Combine the calibrations of sensors with different clocks into one calibration of the unit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from gmwm.base.errors import DataError
from gmwm.base.remarks import Remark
from gmwm.calibration.recording_info import Recording
from gmwm.calibration.result import Calibration


def combine(calibrations: Sequence[Calibration]) -> Calibration:
    """Return one calibration with the axes of all given calibrations. `Calibration.combined` describes the rules."""
    first = calibrations[0]
    if len(calibrations) == 1:
        return first
    axes = [axis for calibration in calibrations for axis in (*calibration.axes, *calibration.failed)]
    twice = sorted({axis for axis in axes if axes.count(axis) > 1})
    if twice:
        raise DataError(
            f"{twice[0]} is in more than one of {len(calibrations)} calibrations",
            advice="Combine calibrations of different sensors; several recordings of one sensor are calibrated "
            "together.",
        )
    if any(calibration.settings.confidence != first.settings.confidence for calibration in calibrations):
        raise DataError("the calibrations have different confidence levels", advice="Calibrate with the same level.")
    recordings: dict[str, Recording] = {}
    remarks: list[Remark] = []
    for calibration in calibrations:
        name = _name(calibration)
        descriptions = calibration.recordings if calibration.recording is None else {name: calibration.recording}
        for key, value in descriptions.items():
            recordings[key if key not in recordings else f"{key} ({len(recordings) + 1})"] = value
        for remark in calibration.recording_remarks:
            # A remark on all axes of one calibration is none on those of the others.
            subjects = list(calibration.axes) if remark.message.spoils or remark.message.raises else [name]
            remarks += [remark] if remark.subject else [remark.about(subject) for subject in subjects]
    return replace(
        first,
        axes={
            axis: axis_calibration
            for calibration in calibrations
            for axis, axis_calibration in calibration.axes.items()
        },
        failed={axis: reason for calibration in calibrations for axis, reason in calibration.failed.items()},
        source=" and ".join(dict.fromkeys(calibration.source for calibration in calibrations if calibration.source)),
        recording_remarks=tuple(remarks),
        recording=None,
        recordings=recordings,
    )


def _name(calibration: Calibration) -> str:
    """Return a name for the recording of a calibration: its topic, its source, or its axes."""
    topics = [
        str(r.facts["topic"])
        for r in calibration.recording_remarks
        if r.code == "topic-chosen" and r.facts["case"] == "read"
    ]
    return topics[0] if len(topics) == 1 else calibration.source or " ".join(calibration.axes)
