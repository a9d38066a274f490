"""Description of the recording of a calibration: length, time base and file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from gmwm.base.documents import Documented
from gmwm.measuring.inspection import Inspection


@dataclass(frozen=True, kw_only=True)
class Recording(Documented):
    """Length, time base and file of a recording.

    `duration` (s) excludes gaps, which last `missing` (s); `jitter` (s) is the RMS one of time stamps; `static` means
    that no motion was found; `gravity` (m/s²) is the norm of the mean specific force; `temperature` its range (°C),
    `file` a name without folders. None or "": not known."""

    samples: int
    rate: float
    duration: float
    segments: int
    missing: float
    jitter: float | None
    static: bool
    knocks: int
    gravity: float | None
    temperature: tuple[float, float] | None
    file: str = ""
    size: int | None = None
    sha256: str | None = None

    @classmethod
    def of(cls, inspection: Inspection) -> Recording:
        """Return the description of a recording, from its inspection."""
        base = inspection.time_base
        missing = sum(duration - 1 / inspection.rate for _, duration in base.gaps)
        return cls(
            samples=inspection.samples, rate=inspection.rate, duration=inspection.duration,
            segments=inspection.segments, missing=float(missing), jitter=float(base.jitter) if base.stamped else None,
            static=bool(inspection.static), knocks=len(inspection.knocks) * inspection.has_knocks,
            gravity=inspection.gravity, temperature=inspection.temperature,
        )  # fmt: skip

    def of_file(self, path: str | os.PathLike[str]) -> Recording:
        """Return the description with the name, size and SHA-256 of a file. For a folder, only the name is set."""
        file = Path(path)
        if not file.is_file():
            return replace(self, file=file.name)
        digest = hashlib.sha256()
        with file.open("rb") as content:
            for block in iter(partial(content.read, 1 << 20), b""):
                digest.update(block)
        return replace(self, file=file.name, size=file.stat().st_size, sha256=digest.hexdigest())

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Recording:
        """Restore a description from the result of `to_dict`; the calibration checks the types of the fields."""
        temperature = values["temperature"]
        pair = None if temperature is None else (float(temperature[0]), float(temperature[1]))
        return cls(**{**values, "temperature": pair})


def of_recording(subject: str, name: str) -> str:
    """Return the subject of a remark, an axis, a sensor or nothing, with the name of the recording that it is about."""
    return f"{subject} in {name}" if subject else name
