"""From a calibration to the files that others read."""

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
    """The noise of a unit as another program reads it: as text, and in a file where `path` is given.

    Most programs know two numbers of a sensor, white noise N and a random walk K of the bias. They are those of
    `effective_noise`: N_eff² = N² + Σ 2σ²_GM/β of the terms correlated for less than the horizon, K_eff² = K² +
    Σ 2βσ²_GM of the others. Where the model has nothing of the kind, or the data cannot tell it from zero, the file has
    the upper limit that the data give in the model with such a term, and says that it is one: never a zero, and never
    a made-up value. The head of each file says units, continuous or discrete, axes, inflation, horizon, models, source.

    Parameters
    ----------
    calibration : Calibration
    path : path, optional
        Written whole or not at all.
    format : str
        One of `export_formats()`.
    axes : "worst", "mean" or "each", optional
        Of the axes of a sensor the largest, the root mean square, or one for each where the format takes such; by
        default the largest for filters, each for simulators and messages.
    inflation : float
        Factor on standard deviations and densities; variances grow by its square.
    horizon : float
        How long (s) the consumer relies on the sensor alone.
    rate : float, optional
        Samples per second (Hz) that the consumer will get; that of the recording by default.

    Returns
    -------
    str
        The text of the file.

    Raises
    ------
    OptionError
        If an option is not one of those it may be, or has no meaning for the format.
    DataError
        If a sensor that the consumer needs was not calibrated, or the data do not even bound a number.
    MissingTheoryError
        If the theory of a process in a model does not suffice.

    Examples
    --------
    >>> import gmwm
    >>> truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel_x": "WN(sigma2=2e-5)"}
    >>> imu = gmwm.simulate(truth, rate=100.0, samples=100_000, rng=1)
    >>> text = export(gmwm.calibrate(imu, "WN + RW"), format="kalibr")
    >>> [line for line in text.splitlines() if line.startswith(("gyroscope", "update"))]
    ['gyroscope_noise_density: 6...e-05  # rad/s/sqrt(Hz)', 'gyroscope_random_walk: ...  # rad/s^2/sqrt(Hz)',
     'update_rate: 100.0  # Hz']
    >>> "UPPER LIMIT, not a measured value: K of the accelerometers." in text
    True
    """
    exporter = find_exporter(format)
    given = {"axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate}
    options = _options(exporter, given)
    for name, value in given.items():
        if name not in exporter.takes and value != _DEFAULTS[name]:
            takes = f"it takes {', '.join(sorted(exporter.takes))}" if exporter.takes else "it takes no options"
            raise OptionError(f"{name} has no meaning for {format!r}: {takes}")
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
    """Every format, in a file of its name each; options are used where they have a meaning.

    Parameters
    ----------
    calibration, axes, inflation, horizon, rate
        As for `export`. "each" is taken for "worst" where a format has one number for a sensor.
    folder : path
        A directory that is there.

    Returns
    -------
    mapping of format to Path, mapping of format to str
        What was written, and why others were not.
    """
    written: dict[str, Path] = {}
    left: dict[str, str] = {}
    for exporter in registered():
        given: dict[str, Any] = {"axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate}
        given = {name: value if name in exporter.takes else _DEFAULTS[name] for name, value in given.items()}
        if axes == "each" and not exporter.per_axis:
            given["axes"] = None
        options = _options(exporter, given)
        try:
            text = exporter.export(calibration, options)
        except (DataError, MissingTheoryError) as error:
            left[exporter.name] = str(error)
            continue
        target = Path(folder) / f"{exporter.name}{exporter.extension}"
        write_text(target, text)
        written[exporter.name] = target
    return written, left


def export_formats() -> dict[str, str]:
    """The formats that `export` writes: name and what it is for.

    >>> export_formats()["kalibr"]
    'Kalibr (imu.yaml)'
    """
    return {exporter.name: exporter.title for exporter in registered()}


_DEFAULTS: Mapping[str, Any] = {"axes": None, "inflation": 1.0, "horizon": HORIZON, "rate": None}


def _options(exporter: Exporter, given: Mapping[str, Any]) -> ExportOptions:
    axes, inflation, rate = given["axes"], given["inflation"], given["rate"]
    if axes is not None and axes not in RULES:
        raise OptionError(f"axes must be one of {', '.join(map(repr, RULES))}; got {axes!r}")
    return ExportOptions(
        exporter.default_axes if axes is None else axes,
        _positive("inflation", inflation),
        checked_horizon(given["horizon"]),
        None if rate is None else _positive("rate", rate),
    )


def _positive(name: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 < value < math.inf:
        raise OptionError(f"{name} must be a positive number, got {value!r}")
    return float(value)
