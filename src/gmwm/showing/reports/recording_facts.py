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
    if calibration.recordings:
        common = {"Axes": ", ".join([*calibration.axes, *calibration.failed]), "Units": _units(calibration)}
        columns = [dict(_described(one)) for one in calibration.recordings.values()]
        titles = list(dict.fromkeys(title for column in columns for title in column))
        rows = [["", *calibration.recordings], *([t, *(c.get(t, "") for c in columns)] for t in titles)]
        return {"facts": list(common.items()), "rows": rows}
    found = calibration.recording
    wv = next(iter(calibration.axes.values())).fit.wavelet_variance
    samples, rate = (wv.samples, wv.rate) if found is None else (found.samples, found.rate)
    facts: Facts = [("Source", calibration.source)] if calibration.source else []
    if found is not None and found.sha256:
        facts += [("File", f"{found.file}, {found.size} bytes"), ("SHA-256", found.sha256)]
    facts += [
        ("Sampling rate", f"{rate:.10g} Hz"),
        ("Length", f"{samples} samples, {duration_text(samples / rate)}"),
        ("Axes", ", ".join([*calibration.axes, *calibration.failed])),
        ("Units", _units(calibration)),
    ]
    return {"facts": facts if found is None else [*facts, *_measured(found)], "rows": []}


def _described(found: Recording) -> Facts:
    """Return the facts on one of several recordings."""
    file = [("File", f"{found.file}, {found.size} bytes"), ("SHA-256", found.sha256)] if found.sha256 else []
    length = f"{found.samples} samples, {duration_text(found.samples / found.rate)}"
    return [*file, ("Sampling rate", f"{found.rate:.10g} Hz"), ("Length", length), *_measured(found)]


def _measured(found: Recording) -> Facts:
    """Return the facts on gaps, time stamps, motion and temperature of a recording."""
    gaps = found.segments - 1
    lost = f"{gaps}, {duration_text(found.missing)} missing" if found.missing > 0 else str(gaps)
    stamps = "none" if found.jitter is None else f"jitter {significant(found.jitter, 3)} s (root mean square)"
    facts: Facts = [("Gaps", lost if gaps else "none"), ("Time stamps", stamps)]
    facts += [("At rest", "yes" if found.static else "no"), ("Knocks", str(found.knocks))]
    if found.gravity is not None:
        facts.append(("Specific force", f"{found.gravity:.5g} m/s²"))
    low_high = found.temperature
    temperature = "not recorded" if low_high is None else f"{low_high[0]:.4g} to {low_high[1]:.4g} °C"
    return [*facts, ("Temperature", temperature)]


def _units(calibration: Calibration) -> str:
    units: dict[str, list[str]] = {}
    for axis, found in calibration.axes.items():
        units.setdefault(found.fit.wavelet_variance.unit or "not known", []).append(axis)
    return "; ".join(f"{unit}: {', '.join(axes)}" for unit, axes in units.items())
