"""Write the noise of a calibrated unit as files for other programs."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm._files import write_text
from gmwm.datasheets.effective import checked_horizon
from gmwm.errors import DataError, MissingTheoryError, OptionError
from gmwm.exporters.base import HORIZON, Exporter, ExportOptions, find_exporter, registered
from gmwm.exporters.reduction import RULES, Rule

if TYPE_CHECKING:
    from gmwm.calibration import Calibration


def export(
    calibration: Calibration,
    path: str | os.PathLike[str] | None = None,
    format: str = "kalibr",
    *,
    axes: Rule | None = None,
    inflation: float = 1.0,
    horizon: float = HORIZON,
    rate: float | None = None,
) -> str:
    """Export the noise of a calibrated unit in the format of another program.

    Most programs have two parameters for a sensor, white noise N and a random walk K of the bias. The file has the
    numbers of `effective_noise`: N_eff² = N² + Σ 2σ²_GM/β of the terms with a correlation time below the horizon, and
    K_eff² = K² + Σ 2βσ²_GM of the others. If the model has no such noise, or the data do not distinguish it from zero,
    the file has its upper limit and marks it as one; it never has a zero or an assumed value. The head of each file
    states the units, continuous or discrete numbers, the axes, the inflation, the horizon, the models and the source.

    Parameters
    ----------
    calibration : Calibration
    path : path, optional
        File to write; an error leaves an existing file unchanged.
    format : str
        One of `export_formats()`.
    axes : "worst", "mean" or "each", optional
        How the axes of a sensor are combined: the largest number, the root mean square, or one number for each axis if
        the format allows it. The default is the largest for filters, and each for simulators and messages.
    inflation : float
        Factor for standard deviations and densities; variances grow by its square.
    horizon : float
        Time (s) over which the consumer relies on the sensor alone.
    rate : float, optional
        Sampling rate (Hz) of the consumer; by default that of the recording.

    Returns
    -------
    str
        The text of the file.

    Raises
    ------
    OptionError
        If an option has an invalid value, or the format does not use it.
    DataError
        If a sensor that the consumer needs was not calibrated, or the data do not determine an upper limit.
    MissingTheoryError
        If a process of a model does not define the theory that the format needs.

    Examples
    --------
    >>> import gmwm
    >>> truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel_x": "WN(sigma2=2e-5)"}
    >>> imu = gmwm.simulate(truth, rate=100.0, samples=100_000, seed=1)
    >>> text = export(gmwm.calibrate(imu, "WN + RW"), format="kalibr")
    >>> [line for line in text.splitlines() if line.startswith(("gyroscope", "update"))]
    ['gyroscope_noise_density: 6...e-05  # rad/s/sqrt(Hz)', 'gyroscope_random_walk: ...  # rad/s^2/sqrt(Hz)',
     'update_rate: 100.0  # Hz']
    >>> "UPPER LIMIT, not a measured value: K of the accelerometers" in text
    True
    """
    exporter = find_exporter(format)
    given = {"axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate}
    options = _options(exporter, given)
    for name, value in given.items():
        if name not in exporter.takes and value != _DEFAULTS[name]:
            used = ", ".join(sorted(exporter.takes)) or "none of these options"
            raise OptionError(argument=name, expected=f"left out for the format {format}, which uses {used}", got=value)
    text = exporter.export(calibration, options)
    if path is not None:
        write_text(path, text)
    return text


def export_all(
    calibration: Calibration,
    folder: str | os.PathLike[str],
    *,
    axes: Rule | None = None,
    inflation: float = 1.0,
    horizon: float = HORIZON,
    rate: float | None = None,
) -> tuple[dict[str, Path], dict[str, str]]:
    """Export a calibration in every format; each format uses the options that apply to it.

    Parameters
    ----------
    calibration, axes, inflation, horizon, rate
        As for `export`. For `axes="each"`, formats with one number for a sensor use their default.
    folder : path
        An existing folder. Each file has the name of its format.

    Returns
    -------
    mapping of format to Path, mapping of format to str
        The files, and the reason for each format that was not written.
    """
    written: dict[str, Path] = {}
    reasons: dict[str, str] = {}
    for exporter in registered():
        given: dict[str, Any] = {"axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate}
        given = {name: value if name in exporter.takes else _DEFAULTS[name] for name, value in given.items()}
        if axes == "each" and not exporter.per_axis:
            given["axes"] = None
        options = _options(exporter, given)
        try:
            text = exporter.export(calibration, options)
        except (DataError, MissingTheoryError) as error:
            reasons[exporter.name] = str(error)
            continue
        target = Path(folder) / f"{exporter.name}{exporter.extension}"
        write_text(target, text)
        written[exporter.name] = target
    return written, reasons


def export_formats() -> dict[str, str]:
    """Return the formats that `export` writes: the name and the program of each.

    >>> export_formats()["kalibr"]
    'Kalibr (imu.yaml)'
    """
    return {exporter.name: exporter.title for exporter in registered()}


_DEFAULTS: Mapping[str, Any] = {"axes": None, "inflation": 1.0, "horizon": HORIZON, "rate": None}


def _options(exporter: Exporter, given: Mapping[str, Any]) -> ExportOptions:
    axes, inflation, rate = given["axes"], given["inflation"], given["rate"]
    if axes is not None and axes not in RULES:
        raise OptionError(argument="axes", expected=f"one of {', '.join(map(repr, RULES))}", got=axes)
    return ExportOptions(
        exporter.default_axes if axes is None else axes,
        _positive("inflation", inflation),
        checked_horizon(given["horizon"]),
        None if rate is None else _positive("rate", rate),
    )


def _positive(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise OptionError(argument=name, expected="a positive number", got=value)
    return float(value)
