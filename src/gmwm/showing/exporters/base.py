"""Base class of exporters, base class of formats with two noise parameters per sensor, and registry of formats.

Each format is a subclass of `Exporter` with the decorator `@register`. A file with N and K begins with its
verdict in at most three lines. The numbers follow, and then at most 15 lines of comment: the recording, units,
continuous or discrete time, axes, inflation factor, horizon, how well a filter predicts with the numbers, upper limits,
and what the numbers leave out.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, TypeVar

from gmwm.base.errors import DataError, GmwmError, OptionError
from gmwm.base.extras import admit_guests
from gmwm.base.remarks import Remark, Severity
from gmwm.base.text import version
from gmwm.base.units import Quantity
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S, Use
from gmwm.showing.exporters.quality import left_out, limits, not_measured, predictions, remarks_of, rule_of, verdict
from gmwm.showing.exporters.reduction import NAMES, Rule, SensorNoise, sensor_noise, stated, unknown
from gmwm.showing.exporters.text import (
    cautions,
    is_given,
    laid_out,
    paragraphs,
    recording,
    written_rate,
)

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.rest import BiasAtRest


@dataclass(frozen=True)
class ExportOptions:
    """Options of an exported file."""

    # how the axes of a sensor are combined: the largest number, the root mean square, or one number for each axis
    axes: Rule
    # Factor by which standard deviations and noise densities are multiplied. Variances are multiplied by its
    # square.
    inflation: float = 1.0
    horizon: float = (
        DEFAULT_HORIZON_S  # horizon T (s) over which a filter with N and K predicts best; see `effective_noise`
    )
    # sampling rate (Hz) in the program that reads the file; None for the rate of the recording
    rate: float | None = None
    # longest averaging time (s) in the fit of a Gauss-Markov bias; None for one hour, or for the length of the
    # recording if it is shorter
    duration: float | None = None


class Exporter(ABC):
    """A file format for another program.

    Attributes
    ----------
    name : str
        Name of the format for `calibration.export(…, format=)`.
    title : str
        Program or purpose of the file.
    extension : str
        Extension of the file, with the dot.
    default_axes : "worst", "mean" or "each"
        Default of the option `axes`.
    takes : frozenset of str
        Options that the format uses, out of "axes", "inflation", "horizon", "rate" and "duration".
    both : bool
        Whether the format needs both gyroscopes and accelerometers.
    per_axis : bool
        Whether the format allows different numbers for the axes of a sensor.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    extension: ClassVar[str]
    default_axes: ClassVar[Rule] = "worst"
    takes: ClassVar[frozenset[str]] = frozenset()
    both: ClassVar[bool] = False
    per_axis: ClassVar[bool] = False

    @abstractmethod
    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of the file. Raises a DataError if a sensor that it needs was not calibrated, or if the data
        do not determine an upper limit that it needs."""

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return the remarks that the file contains: cautions of the calibration, and noise that the format leaves
        out."""
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
    """Base class of formats with two noise parameters per sensor: white noise N, and random walk K of the bias.

    Attributes
    ----------
    comment : str
        Characters that start a comment line.
    first : str
        Line that the file must start with; an empty string for none.
    meaning : tuple of str
        Sentences that state the unit of each key, and whether it is in continuous or discrete time.
    usage : tuple of str
        Sentences on how to use the file.
    flicker : str
        Name of the program's parameter for flicker noise; an empty string if it has none.
    biases_of : tuple of "gyro" or "accel"
        Sensors whose bias at rest is in the file.
    """

    takes = frozenset({"axes", "inflation", "horizon", "rate"})
    both = True
    comment: ClassVar[str] = "#"
    first: ClassVar[str] = ""
    meaning: ClassVar[tuple[str, ...]]
    usage: ClassVar[tuple[str, ...]] = ()
    flicker: ClassVar[str] = ""
    biases_of: ClassVar[tuple[Quantity, ...]] = ()

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
        return [] if self.flicker else predictions(noise.sensors)

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


QUANTITIES: tuple[Quantity, Quantity] = ("gyro", "accel")
"""The sensors in the order in which files list them."""
