"""What was recorded, as a calibration remembers it: the file, its time base, and how it was understood."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from gmwm.inspection import Inspection


@dataclass(frozen=True, kw_only=True)
class Recording:
    """The facts of a recording.

    Attributes
    ----------
    samples, rate, duration : int, float (Hz), float (s)
        Length without gaps.
    segments : int
        Number of segments without a gap.
    missing : float
        Time that the gaps lost (s).
    jitter : float or None
        Of the time stamps (s, root mean square); None where there are none.
    static : bool
        Whether nothing was found that says the unit moved.
    knocks : int
        Bursts of outliers.
    gravity : float or None
        Norm of the mean specific force (m/s²); None without three accelerometers.
    temperature : (lowest, highest) or None
        In °C.
    file : str
        Name of the file, without its folders; "" where it is not known.
    size : int or None
        Of the file, in bytes.
    sha256 : str or None
        Of the file's content: the same digits are the same recording.
    """

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
    def of(cls, found: Inspection) -> Recording:
        """The facts that an inspection found."""
        base = found.time_base
        missing = sum(duration - 1 / found.rate for _, duration in base.gaps)
        return cls(
            samples=found.samples,
            rate=found.rate,
            duration=found.duration,
            segments=found.segments,
            missing=float(missing),
            jitter=float(base.jitter) if base.stamped else None,
            static=bool(found.static),
            knocks=len(found.knocks),
            gravity=found.gravity,
            temperature=found.temperature,
        )

    def of_file(self, path: str | os.PathLike[str]) -> Recording:
        """The same with name, size and SHA-256 of the file; of a folder with its name alone."""
        file = Path(path)
        if not file.is_file():
            return replace(self, file=file.name)
        with file.open("rb") as content:
            digest = hashlib.file_digest(content, "sha256").hexdigest()
        return replace(self, file=file.name, size=file.stat().st_size, sha256=digest)

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain numbers, lists and texts, ready for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Recording:
        """The recording whose `to_dict` gave `values`."""
        given = dict(values)
        temperature = given["temperature"]
        given["temperature"] = None if temperature is None else (float(temperature[0]), float(temperature[1]))
        return cls(**given)
