"""Base classes of exporters and of formats with two noise parameters per sensor, and registry (`@register`).

A file with N and K begins with its verdict in at most three lines. The numbers follow, and at most 15 lines of comment:
recording, units, kind of time, axes, inflation, horizon, quality of predictions, upper limits, and omissions."""

from __future__ import annotations

import math
import os
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from gmwm.base.atomic_files import write_text
from gmwm.base.errors import DataError, GmwmError, MissingTheoryError, OptionError
from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Remark, Severity
from gmwm.base.text import version
from gmwm.base.units import Quantity
from gmwm.calibration import Calibration
from gmwm.calibration.rest import BiasAtRest
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S, Use, checked_horizon
from gmwm.showing.exporters.quality import left_out, limits, not_measured, predictions, remarks_of, rule_of, verdict
from gmwm.showing.exporters.reduction import NAMES, RULES, Rule, SensorNoise, sensor_noise, stated, unknown
from gmwm.showing.exporters.text import cautions, is_given, laid_out, paragraphs, recording, written_rate


@dataclass(frozen=True)
class ExportOptions:
    """Options of an exported file."""

    # how the axes of a sensor are combined: the largest number, the root mean square, or one number for each axis
    axes: Rule
    # factor of standard deviations and densities, squared for variances
    inflation: float = 1.0
    horizon: float = (
        DEFAULT_HORIZON_S  # horizon T (s) over which a filter with N and K predicts best; see `effective_noise`
    )
    # sampling rate (Hz) in the program that reads the file; None for the rate of the recording
    rate: float | None = None
    # longest averaging time (s) in the fit of a Gauss-Markov bias; None for one hour or a shorter recording
    duration: float | None = None


class Exporter(ABC):
    """A file format for another program."""

    name: ClassVar[str]  # name for `calibration.export(…, format=)`
    title: ClassVar[str]  # program or purpose of the file
    extension: ClassVar[str]  # with the dot
    default_axes: ClassVar[Rule] = "worst"  # default of the option `axes`
    takes: ClassVar[frozenset[str]] = frozenset()  # options out of "axes", "inflation", "horizon", "rate", "duration"
    both: ClassVar[bool] = False  # whether the format needs both gyroscopes and accelerometers
    per_axis: ClassVar[bool] = False  # whether the format allows different numbers for the axes of a sensor

    @abstractmethod
    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the file; DataError if a sensor or an upper limit that it needs is missing."""

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return the file's remarks: cautions of the calibration, and noise that the format leaves out."""
        return tuple(cautions(calibration))


E_ = TypeVar("E_", bound=type[Exporter])

_EXPORTERS: dict[str, Exporter] = {}


def register(exporter: E_) -> E_:
    """Add a format to the registry (a class decorator)."""
    if exporter.name in _EXPORTERS:
        raise ValueError(f"an exporter named {exporter.name!r} is registered already")
    _EXPORTERS[exporter.name] = exporter()
    return exporter


def registered() -> tuple[Exporter, ...]:
    """Return all formats, in alphabetical order."""
    _admit_guests()
    return tuple(_EXPORTERS[name] for name in sorted(_EXPORTERS))


def _admit_guests() -> None:
    """Register the formats of other packages. Their entry points in `gmwm.exporters` name subclasses of `Exporter`."""
    admit_guests("gmwm.exporters", _require_registered)


def _require_registered(name: str, exporter: object) -> None:
    if exporter not in [type(format) for format in _EXPORTERS.values()]:
        raise TypeError(f"{name} is not a registered subclass of gmwm.exporters.Exporter")


def find_exporter(format: str) -> Exporter:
    """Return the exporter of a format. Raises an OptionError if there is no such format."""
    if format not in _EXPORTERS:
        _admit_guests()
    if format not in _EXPORTERS:
        raise OptionError(argument="format", expected=f"one of {', '.join(sorted(_EXPORTERS))}", got=format)
    return _EXPORTERS[format]


def top(exporter: Exporter, calibration: Calibration) -> list[str]:
    """Return the paragraphs with which a file begins: its title and its verdict."""
    return [f"Noise of an IMU for {exporter.title}. Written by gmwm {version()}.", verdict(calibration)]


@dataclass(frozen=True)
class Noise:
    """The noise parameters of a unit for the options of one file."""

    # noise parameters of the gyroscopes and the accelerometers; None for a sensor that was not calibrated
    gyro: SensorNoise | None
    accel: SensorNoise | None
    options: ExportOptions  # options of the file
    topic: str = ""  # ROS topic of the recording; an empty string if it is unknown
    rest: Mapping[str, BiasAtRest] = field(default_factory=dict)  # bias at rest of the axes for which it is known

    @property
    def sensors(self) -> tuple[SensorNoise, ...]:
        """The calibrated sensors."""
        return tuple(sensor for sensor in (self.gyro, self.accel) if sensor is not None)

    @property
    def rate(self) -> float:
        """Sampling rate (Hz) for discrete-time values; by default the rate of the first calibrated sensor."""
        return self.sensors[0].rate if self.options.rate is None else self.options.rate

    @property
    def written_rate(self) -> str:
        """The sampling rate as text for a file."""
        return written_rate(self.rate)

    def of(self, quantity: Quantity) -> SensorNoise:
        """Return the noise parameters of a sensor that the format requires."""
        found = self.gyro if quantity == "gyro" else self.accel
        assert found is not None
        return found


class TwoNumbers(Exporter):
    """Base class of formats with two noise parameters per sensor: white noise N, and random walk K of the bias."""

    takes = frozenset({"axes", "inflation", "horizon", "rate"})
    both = True
    comment: ClassVar[str] = "#"  # characters that start a comment line
    first: ClassVar[str] = ""  # line that the file must start with
    meaning: ClassVar[tuple[str, ...]]  # sentences on the unit of each key, and on continuous or discrete time
    usage: ClassVar[tuple[str, ...]] = ()  # sentences on how to use the file
    flicker: ClassVar[str] = ""  # name of the program's parameter for flicker noise; "" if it has none
    biases_of: ClassVar[tuple[Quantity, ...]] = ()  # sensors whose bias at rest is in the file

    @abstractmethod
    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines of the file below the head, in ASCII."""

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the file: the verdict, the numbers, and the notes."""
        noise = self._noise(calibration, options)
        return self.layout(top(self, calibration), noise, self.notes(calibration, noise))

    def layout(self, head: Sequence[str], noise: Noise, notes: Sequence[str]) -> str:
        """Return the text of the file from the paragraphs of its head and of its notes."""
        first = f"{self.first}\n" if self.first else ""
        return first + laid_out(head, self.body(noise), notes, self.comment)

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on upper limits and on sinusoids."""
        return self._remarks(calibration, self._noise(calibration, options))

    def notes(self, calibration: Calibration, noise: Noise) -> list[str]:
        """Return the paragraphs below the numbers, the most important first."""
        options = noise.options
        found = list(remarks_of(noise, calibration.settings.confidence))
        rates = [remark for remark in found if remark.code == "rates-differ"]
        warned, measured = cautions(calibration), not is_given(calibration)
        at_rest = " Measured at rest; in the field, filters usually need more." if options.inflation == 1 else ""
        return [
            recording(calibration), *self.meaning,
            *paragraphs([*(remark for remark in warned if remark.severity <= Severity.BIASED), *rates]),
            *(rule_of(sensor, options.axes) for sensor in noise.sensors),
            *paragraphs(remark for remark in warned if remark.severity > Severity.BIASED), *limits(found),
            *not_measured(unknown(calibration, self.biases_of)),
            f"Inflation factor: {options.inflation:g}.{at_rest if measured else ''} Horizon: {options.horizon:g} s.",
            *left_out(noise.sensors), *self.predictions(noise), *stated(calibration, self.biases_of),
            *self.advice(noise),
        ]  # fmt: skip

    def predictions(self, noise: Noise) -> list[str]:
        """Return sentences on how well a filter with the numbers predicts."""
        return [] if self.flicker else predictions(noise.sensors, noise.options.inflation)

    def advice(self, noise: Noise) -> tuple[str, ...]:
        """Return sentences on how to use the file."""
        return self.usage

    def _remarks(self, calibration: Calibration, noise: Noise) -> tuple[Remark, ...]:
        found = remarks_of(noise, calibration.settings.confidence)
        return (*cautions(calibration), *found, *unknown(calibration, self.biases_of))

    def _noise(self, calibration: Calibration, options: ExportOptions) -> Noise:
        if options.axes == "each" and not self.per_axis:
            raise OptionError(
                argument="axes", expected=f"'worst' or 'mean', because {self.name} has one number for all axes",
                got=options.axes,
            )  # fmt: skip
        use = Use(options.horizon, self.flicker)
        gyro, accel = (
            sensor_noise(calibration, quantity, rule=options.axes, inflation=options.inflation, use=use)
            for quantity in QUANTITIES
        )
        missing = [q for q, found in zip(QUANTITIES, (gyro, accel), strict=True) if found is None]
        if missing and (self.both or len(missing) == 2):
            raise sensor_missing(calibration, missing[0], self.name)
        return Noise(gyro, accel, options, topic=topic_of(calibration), rest=calibration.rest)


def sensor_missing(calibration: Calibration, quantity: Quantity, format: str) -> GmwmError:
    """Create the error for a format that needs a sensor that was not calibrated."""
    return DataError(
        f"the format needs gyroscopes and accelerometers, but this calibration has no {NAMES[quantity]}, "
        f"only {', '.join(calibration)}",
        advice="Calibrate a recording with axes such as gyro_x and accel_x.",
    ).about(format)


def topic_of(calibration: Calibration) -> str:
    """Return the ROS topic of the calibrated recording, or an empty string if it has no valid topic name."""
    topics = {
        str(remark.facts["topic"])
        for remark in calibration.recording_remarks
        if remark.code == "topic-chosen" and remark.facts["case"] == "read"
    }
    name = topics.pop() if len(topics) == 1 else ""
    return name if re.fullmatch(r"/[A-Za-z][A-Za-z0-9_/]*", name) else ""


QUANTITIES: tuple[Quantity, Quantity] = ("gyro", "accel")  # the sensors in the order in which files list them


def export(
    calibration: Calibration, path: str | os.PathLike[str] | None = None, format: str = "kalibr", *,
    axes: Rule | None = None, inflation: float = 1.0, horizon: float = DEFAULT_HORIZON_S, rate: float | None = None,
    duration: float | None = None,
) -> str:  # fmt: skip
    """Return the noise of a unit in the format of another program; see `Calibration.export`."""
    exporter = find_exporter(format)
    arguments = {"axes": axes, "inflation": inflation, "horizon": horizon, "rate": rate, "duration": duration}
    options = _options(exporter, arguments)
    for name, value in arguments.items():
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
    """Export a calibration in every format into an existing folder; return files, or reasons, by format. With
    `axes="each"`, formats with one number per sensor use their default rule."""
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
    extension, suffix = find_exporter(format).extension, Path(path).suffix.lower()
    if suffix and suffix != extension and {suffix, extension} != {".yml", ".yaml"}:
        raise OptionError(
            f"{Path(path).name} does not have the extension of the format {format}, {extension}", argument=argument,
            got=str(path),
            advice=f"Name the file {Path(path).with_suffix(extension).name}, or choose another {{--format}}.",
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
