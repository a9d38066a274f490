"""Make noise models from a datasheet, a model as text, or a file of another program."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from gmwm.base.arrays import as_rate
from gmwm.base.documents import is_result
from gmwm.base.errors import OptionError, ReadError
from gmwm.files.importers.files import FORMATS, Format, ParameterFile, parse
from gmwm.files.importers.values import EXAMPLE, Values, read_datasheet
from gmwm.theory.processes.model import Model

_LARGEST = 2_000_000
"""Largest file (bytes) that is searched for keys: a configuration is far smaller, a recording far larger."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Given:
    """Noise models that come from a datasheet, a model or a file instead of a recording.

    Attributes
    ----------
    models : mapping of axis to Model
        Model of each axis, with a value for every parameter.
    values : mapping of axis to Values
        The noise numbers of each axis for which the source states numbers instead of a model.
    rate : float
        Sampling rate (Hz).
    format : str
        Name of the program whose file was read; "datasheet" for text.
    source : str
        Name of the file, or the text.
    written : mapping of axis to mapping of symbol to (key, value)
        Key and value of each number in the file; empty for text.
    """

    models: Mapping[str, Model]
    values: Mapping[str, Values]
    rate: float
    format: str
    source: str
    written: Mapping[str, Mapping[str, tuple[str, float | None]]] = field(default_factory=dict)


def given_noise(source: str | Path, rate: float | None = None) -> Given:
    """Read noise models from the numbers of a datasheet, a model as text, or the file of another program.

    Files of Kalibr, allan_variance_ros, OpenVINS, Kimera, imu_utils, VINS, ORB-SLAM3, LIO-SAM, FAST-LIO, KF-GINS, PX4,
    ArduPilot and MATLAB are recognised by their keys. The page docs/howto/without-recording.md states how each number
    is converted.

    Parameters
    ----------
    source : str or Path
        A file, a part of a file such as "kalibr.yaml:imu1", or text such as
        "gyro: N=0.15deg/√h, B=3deg/h over 100s; accel: N=60µg/√Hz".
    rate : float, optional
        Sampling rate (Hz); by default the rate in the file. Discrete noise models depend on it.

    Returns
    -------
    Given
        The models, the numbers and the sampling rate.

    Raises
    ------
    OptionError
        If the source is neither a file nor text with numbers, or the rate is missing.
    ReadError
        If the file has no known keys, or a number is missing.
    UnitError
        If a unit does not belong to a number.

    Examples
    --------
    >>> found = given_noise("gyro: N=0.15deg/√h, K=1e-6rad/s/√s", rate=100.0)
    >>> list(found.models), found.models["gyro_x"].structure
    (['gyro_x', 'gyro_y', 'gyro_z'], 'WN + RW')
    """
    path, part = Path(source), ""
    if not _is_file(path):
        name, _, part = str(source).rpartition(":")
        path = Path(name) if name and _is_file(Path(name)) else path
    if not _is_file(path):
        text = str(source)
        if ":" not in text or ("=" not in text and "(" not in text):
            raise OptionError(argument="source", expected=f"an existing file, or text such as '{EXAMPLE}'", got=text)
        axes = read_datasheet(text)
        return _given(axes, _rate(rate, None, text), "datasheet", text)
    try:
        form, content = _recognised(path, part)
        stated_rate = content.rate()
        needed = rate if rate is not None else stated_rate
        if form.needs_rate and needed is None:
            raise OptionError(
                f"{path} of {form.name} has numbers for one sampling rate, but not the rate",
                argument="rate", got=rate, advice="Give it with {--rate}.",
            )  # fmt: skip
        values = form.read(content, needed)
    except ReadError as error:
        raise error.at(str(path)) from error
    noise = _given(dict(values), _rate(rate, stated_rate, str(path)), form.name, str(path))
    return replace(noise, written={axis: form.written(content, axis) for axis in values})


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a text can be too long for a name
        return False


def _recognised(path: Path, part: str) -> tuple[Format, ParameterFile]:
    with path.open("rb") as file:
        head = file.read(200)
    if is_result(head):
        advice = "Pass it as the calibration, or with {--from_fits}."
        raise ReadError("the file is a result of gmwm, not of another program", advice=advice)
    if path.stat().st_size > _LARGEST:
        raise ReadError("the file is too large for a configuration")
    content = parse(path.read_text(encoding="utf-8", errors="replace"), path)
    content = content.part(part) if part else content
    for form in FORMATS:
        if form.matches(content):
            return form, content
    names = ", ".join(form.name for form in FORMATS)
    raise ReadError(
        f"the file has no noise numbers that gmwm knows: it recognises files of {names}",
        advice="Write the numbers as text instead, for example `gyro: N=0.15deg/√h`.",
    )


def _rate(given: float | None, known: float | None, source: str) -> float:
    rate = given if given is not None else known
    if rate is None:
        raise OptionError(
            f"the sampling rate of {source} is not known, and a discrete noise model needs it",
            argument="rate", got=given, advice="Give it with {--rate}.",
        )  # fmt: skip
    return as_rate(rate)


def _given(axes: Mapping[str, Values | Model], rate: float, format: str, source: str) -> Given:
    models = {axis: entry if isinstance(entry, Model) else entry.model(rate) for axis, entry in axes.items()}
    for axis, model in models.items():
        if missing := [name for name, value in model.parameters.items() if value is None]:
            raise OptionError(argument="source", expected=f"a value for {', '.join(missing)} of {axis}", got=str(model))
    values = {axis: entry for axis, entry in axes.items() if isinstance(entry, Values)}
    return Given(models=models, values=values, rate=rate, format=format, source=source)
