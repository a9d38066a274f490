"""Write the noise of a calibrated unit to files for other programs."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.base.atomic_files import write_text
from gmwm.base.errors import DataError, MissingTheoryError, OptionError
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S, checked_horizon
from gmwm.showing.exporters.base import Exporter, ExportOptions, find_exporter, registered
from gmwm.showing.exporters.reduction import RULES, Rule

if TYPE_CHECKING:
    from gmwm.calibration import Calibration


def export(
    calibration: Calibration, path: str | os.PathLike[str] | None = None, format: str = "kalibr", *,
    axes: Rule | None = None, inflation: float = 1.0, horizon: float = DEFAULT_HORIZON_S, rate: float | None = None,
    duration: float | None = None,
) -> str:  # fmt: skip
    """Return the noise of a unit in the format of another program; see `Calibration.export`."""
    exporter = find_exporter(format)
    given = {"axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate, "duration": duration}
    options = _options(exporter, given)
    for name, value in given.items():
        if name not in exporter.takes and value != _DEFAULTS[name]:
            used = ", ".join(sorted(exporter.takes)) or "none of these options"
            raise OptionError(argument=name, expected=f"left out for the format {format}, which uses {used}", got=value)
    if path is not None:
        require_extension(format, path)
    text = exporter.export(calibration, options)
    if path is not None:
        write_text(path, text)
    return text


def export_all(
    calibration: Calibration, folder: str | os.PathLike[str], *, axes: Rule | None = None, inflation: float = 1.0,
    horizon: float = DEFAULT_HORIZON_S, rate: float | None = None, duration: float | None = None,
) -> tuple[dict[str, Path], dict[str, str]]:  # fmt: skip
    """Export a calibration in every format. Each format uses the options that apply to it.

    Parameters
    ----------
    calibration, axes, inflation, horizon, rate, duration
        As for `export`. With `axes="each"`, formats with one number per sensor use their default rule.
    folder : path
        An existing folder. Each file is named after its format.

    Returns
    -------
    mapping of format to Path, mapping of format to str
        The written files, and the reason for each format that was not written.
    """
    written: dict[str, Path] = {}
    reasons: dict[str, str] = {}
    for exporter in registered():
        given: dict[str, Any] = {
            "axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate, "duration": duration,
        }  # fmt: skip
        given = {name: value if name in exporter.takes else _DEFAULTS[name] for name, value in given.items()}
        if axes == "each" and not exporter.per_axis:
            given["axes"] = None
        options = _options(exporter, given)
        try:
            text = exporter.export(calibration, options)
        except (DataError, MissingTheoryError) as error:
            reasons[exporter.name] = error.reason
            continue
        target = Path(folder) / f"{exporter.name}{exporter.extension}"
        write_text(target, text)
        written[exporter.name] = target
    return written, reasons


def require_extension(format: str, path: str | os.PathLike[str], argument: str = "path") -> None:
    """Raise an OptionError if the extension of a file does not belong to the format."""
    wanted, found = find_exporter(format).extension, Path(path).suffix.lower()
    if found and found != wanted and {found, wanted} != {".yml", ".yaml"}:
        raise OptionError(
            f"{Path(path).name} does not have the extension of the format {format}, {wanted}", argument=argument,
            got=str(path),
            advice=f"Name the file {Path(path).with_suffix(wanted).name}, or choose another {{--format}}.",
        )  # fmt: skip


def export_formats() -> dict[str, str]:
    """Return the formats that `export` can write, as a mapping from the name of the format to the program.

    >>> export_formats()["kalibr"]
    'Kalibr (imu.yaml)'
    """
    return {exporter.name: exporter.title for exporter in registered()}


_DEFAULTS: Mapping[str, Any] = {
    "axes": None,
    "inflation": 1.0,
    "horizon": DEFAULT_HORIZON_S,
    "rate": None,
    "duration": None,
}


def _options(exporter: Exporter, given: Mapping[str, Any]) -> ExportOptions:
    axes, inflation, rate, duration = (given[name] for name in ("axes", "inflation", "rate", "duration"))
    if axes is not None and axes not in RULES:
        raise OptionError(argument="axes", expected=f"one of {', '.join(map(repr, RULES))}", got=axes)
    return ExportOptions(
        axes=exporter.default_axes if axes is None else axes, inflation=_positive("inflation", inflation),
        horizon=checked_horizon(given["horizon"]), rate=None if rate is None else _positive("rate", rate),
        duration=None if duration is None else _positive("duration", duration),
    )  # fmt: skip


def _positive(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise OptionError(argument=name, expected="a positive number", got=value)
    return float(value)
