"""Facts on the recordings of a report: length, time stamps, gaps, motion and temperature."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from gmwm.base.text import duration_text
from gmwm.choosing.datasheets.entry import significant

if TYPE_CHECKING:
    from gmwm.calibration.recording_info import Recording
    from gmwm.calibration.result import Calibration

Facts = list[tuple[str, str]]
"""Pairs of name and value, in the order of the page."""


def recording_facts(calibration: Calibration) -> dict[str, Any]:
    """Return the facts on the recording, as "facts" and "rows".

    For a single recording, "facts" has all facts. For several recordings, it has the common facts, and "rows" is a
    table with a column for each recording.
    """
    axes = [("Axes", ", ".join([*calibration.axes, *calibration.failed])), ("Units", _units(calibration))]
    if calibration.recordings:
        columns = [
            dict([*_file(recording), *_length(recording.samples, recording.rate), *_conditions(recording)])
            for recording in calibration.recordings.values()
        ]
        titles = list(dict.fromkeys(title for column in columns for title in column))
        rows = [["", *calibration.recordings], *([t, *(c.get(t, "") for c in columns)] for t in titles)]
        return {"facts": axes, "rows": rows}
    recording = calibration.recording
    source = calibration.source_name
    facts: Facts = [("Source", source)] if source and (recording is None or source != recording.file) else []
    if recording is None:
        wv = next(iter(calibration.axes.values())).fit.wavelet_variance
        return {"facts": [*facts, *_length(wv.samples, wv.rate), *axes], "rows": []}
    facts += [*_file(recording), *_length(recording.samples, recording.rate), *axes, *_conditions(recording)]
    return {"facts": facts, "rows": []}


def title_of(calibration: Calibration) -> str:
    """Return the title of a report, with the name of the file."""
    recording = calibration.recording
    name = recording.file if recording is not None and recording.file else calibration.source_name
    return f"Calibration of {name}" if name else "Calibration"


def _file(recording: Recording) -> Facts:
    name = f"{recording.file}, {recording.size} bytes"
    return [("File", name), ("SHA-256", recording.sha256)] if recording.sha256 else []


def _length(samples: int, rate: float) -> Facts:
    return [("Sampling rate", f"{rate:g} Hz"), ("Length", f"{samples} samples, {duration_text(samples / rate)}")]


def _conditions(recording: Recording) -> Facts:
    """Return the facts on gaps, time stamps, motion and temperature of a recording."""
    gaps = recording.segments - 1
    lost = f"{gaps}, {duration_text(recording.missing)} missing" if recording.missing > 0 else str(gaps)
    jitter = recording.jitter
    stamps = "none" if jitter is None else f"jitter {significant(jitter, 3)} s (root mean square)"
    facts: Facts = [("Gaps", lost if gaps else "none"), ("Time stamps", stamps)]
    facts += [("At rest", "yes" if recording.static else "no"), ("Knocks", str(recording.knocks))]
    if recording.gravity is not None:
        facts.append(("Specific force", f"{recording.gravity:.5g} m/s²"))
    limits = recording.temperature
    temperature = "not recorded" if limits is None else f"{limits[0]:.4g} to {limits[1]:.4g} °C"
    return [*facts, ("Temperature", temperature)]


def _units(calibration: Calibration) -> str:
    units: dict[str, list[str]] = {}
    for axis, fit in calibration.items():
        units.setdefault(fit.wavelet_variance.unit or "not known", []).append(axis)
    return "; ".join(f"{unit}: {', '.join(axes)}" for unit, axes in units.items())
