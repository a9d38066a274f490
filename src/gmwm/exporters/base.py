"""The contract of an exporter, what those for filters with two numbers share, and the registry.

A format is one file in this folder: a subclass of `Exporter` under `@register`. Whoever reads the file later sees in
its head what the numbers are: unit, continuous or discrete, which axes, inflation, horizon, models, source, limits.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from typing import TYPE_CHECKING, ClassVar, TypeVar

from gmwm.datasheets.effective import Use
from gmwm.errors import DataError, OptionError
from gmwm.exporters.limits import upper_limits
from gmwm.exporters.reduction import (
    BY_DEVIATION,
    RULES,
    Rule,
    SensorNoise,
    axes_of,
    counted_as,
    lines_of,
    sensor_noise,
    walk_time,
)
from gmwm.exporters.text import commented, recording, written_rate
from gmwm.units import Quantity

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

HORIZON = 1.0
"""Default horizon (s): between two fixes of a satellite receiver, some tens of images or scans."""

_NEAR = 3.0
"""A correlation time within this factor of the horizon is told."""


@dataclass(frozen=True)
class ExportOptions:
    """How a file is to be made.

    Parameters
    ----------
    axes : "worst", "mean" or "each"
        Which of the axes of a sensor the number is of: the largest, the root mean square, or one for each.
    inflation : float
        Factor on all standard deviations and densities; variances grow by its square.
    horizon : float
        T_h (s) of `effective_noise`.
    rate : float or None
        Samples per second (Hz) that the consumer will get; None for that of the recording.
    """

    axes: Rule
    inflation: float = 1.0
    horizon: float = HORIZON
    rate: float | None = None


class Exporter(ABC):
    """A format: its name, what it is, and the text of a file.

    Attributes
    ----------
    name : str
        For `calibration.export(…, format=)`.
    title : str
        What the file is for, in words.
    extension : str
        Of the file, with the dot.
    default_axes : "worst", "mean" or "each"
    takes : frozenset of str
        Which options the format uses: "axes", "inflation", "horizon", "rate".
    both : bool
        Whether it needs gyroscopes and accelerometers.
    per_axis : bool
        Whether it takes numbers of its own for each axis.
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
        """The text of the file.

        Raises
        ------
        DataError
            If a sensor that the consumer needs was not calibrated, or the data do not bound a number.
        """


E_ = TypeVar("E_", bound=type[Exporter])

_EXPORTERS: dict[str, Exporter] = {}


def register(exporter: E_) -> E_:
    """Add a format; use as a class decorator."""
    if exporter.name in _EXPORTERS:
        raise ValueError(f"an exporter named {exporter.name!r} is registered already")
    _EXPORTERS[exporter.name] = exporter()
    return exporter


def registered() -> tuple[Exporter, ...]:
    """All formats, by name."""
    return tuple(_EXPORTERS[name] for name in sorted(_EXPORTERS))


def find_exporter(format: str) -> Exporter:
    """The format of a name.

    Raises
    ------
    OptionError
        If there is none.
    """
    if format not in _EXPORTERS:
        raise OptionError(f"format must be one of {', '.join(sorted(_EXPORTERS))}; got {format!r}")
    return _EXPORTERS[format]


@dataclass(frozen=True)
class Noise:
    """The numbers of a unit, with the options of one file."""

    gyro: SensorNoise | None
    accel: SensorNoise | None
    options: ExportOptions

    @property
    def sensors(self) -> tuple[SensorNoise, ...]:
        """Those that were calibrated."""
        return tuple(sensor for sensor in (self.gyro, self.accel) if sensor is not None)

    @property
    def rate(self) -> float:
        """Samples per second (Hz) that the consumer gets; where the sensors differ, the gyroscopes'."""
        return self.sensors[0].rate if self.options.rate is None else self.options.rate

    @property
    def written_rate(self) -> str:
        """The rate as files have it."""
        return written_rate(self.rate)

    def of(self, quantity: Quantity) -> SensorNoise:
        """A sensor that must be there."""
        found = self.gyro if quantity == "gyro" else self.accel
        assert found is not None
        return found


class TwoNumbers(Exporter):
    """A consumer that knows white noise N and a random walk K of the bias, and no more.

    Attributes
    ----------
    comment : str
        What begins a line of comment.
    first : str
        A line that must stand above all; "" for none.
    meaning : tuple of str
        Unit of each key, and whether it is continuous or discrete.
    advice : tuple of str
        What else is to be known.
    flicker : str
        Its parameter for flicker noise; "" where it has none.
    """

    takes = frozenset({"axes", "inflation", "horizon", "rate"})
    both = True
    comment: ClassVar[str] = "#"
    first: ClassVar[str] = ""
    meaning: ClassVar[tuple[str, ...]]
    advice: ClassVar[tuple[str, ...]] = ()
    flicker: ClassVar[str] = ""

    @abstractmethod
    def body(self, noise: Noise) -> Sequence[str]:
        """The lines below the head, in ASCII."""

    def time_of(self, axis: str, times: Mapping[str, float], options: ExportOptions) -> float | None:
        """Correlation time (s) of the Gauss-Markov bias that K drives, after those of all axes; None for a walk."""
        return None

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Head and body."""
        noise = self._noise(calibration, options)
        head = [self.first] if self.first else []
        head += commented(self.head(calibration, noise), self.comment)
        return "\n".join([*head, "", *self.body(noise)]) + "\n"

    def head(self, calibration: Calibration, noise: Noise) -> list[str]:
        """What is to be known of the file, paragraph by paragraph."""
        options = noise.options
        said = [
            f"Noise of an IMU for {self.title}. Written by gmwm {metadata.version('gmwm')}.",
            *recording(calibration),
        ]
        said += self.meaning
        for sensor in noise.sensors:
            axes = ", ".join(one.axis for one in sensor.axes)
            said.append(f"{_SENSORS[sensor.quantity]}: {RULES[options.axes]} {axes}.")
        said += [f"Not calibrated: {axis}." for axis in calibration.failed]
        said.append(
            f"Inflation factor: {options.inflation:g}"
            + (". As measured at rest; filters in the field commonly need more." if options.inflation == 1 else ".")
        )
        said.append(
            f"Horizon: {options.horizon:g} s. Terms that are correlated for less are white noise (N), for longer a "
            "random walk (K)."
        )
        if len({sensor.rate for sensor in noise.sensors}) > 1 and options.rate is None:
            rates = ", ".join(f"{_SENSORS[sensor.quantity].lower()} {sensor.rate:g} Hz" for sensor in noise.sensors)
            said.append(f"The sensors have rates of their own ({rates}); discrete numbers are for the first of them.")
        said += _models(noise)
        said += upper_limits(noise.sensors, options.axes, calibration.settings.confidence)
        return [*said, *self.advice]

    def _noise(self, calibration: Calibration, options: ExportOptions) -> Noise:
        if options.axes == "each" and not self.per_axis:
            raise OptionError(f"{self.name} has one number for the axes of a sensor: axes must be 'worst' or 'mean'")
        axes = [axis for quantity in QUANTITIES for axis in axes_of(calibration, quantity)]
        times = {axis: walk_time(calibration[axis], options.horizon) for axis in axes}
        uses = {axis: Use(options.horizon, self.time_of(axis, times, options), self.flicker) for axis in axes}
        gyro, accel = (
            sensor_noise(calibration, quantity, rule=options.axes, inflation=options.inflation, uses=uses)
            for quantity in QUANTITIES
        )
        missing = [_SENSORS[q] for q, found in zip(QUANTITIES, (gyro, accel), strict=True) if found is None]
        if missing and (self.both or len(missing) == 2):
            raise DataError(
                f"{self.name} needs gyroscopes and accelerometers, as gyro_x and accel_x; {missing[0].lower()} are not "
                f"in this calibration, which has {', '.join(calibration)}"
            )
        return Noise(gyro, accel, options)


QUANTITIES: tuple[Quantity, Quantity] = ("gyro", "accel")
"""The sensors, in the order of the files."""
_SENSORS: dict[Quantity, str] = {"gyro": "Gyroscopes", "accel": "Accelerometers"}


def _models(noise: Noise) -> list[str]:
    """The model of each axis, what of it counts as what, and what is near the horizon."""
    horizon, said = noise.options.horizon, []
    axes = [one for sensor in noise.sensors for one in sensor.axes]
    listed = [counted_as(one.fit, one.use) for one in axes]
    for one, found in zip(axes, listed, strict=True):
        parts = [f"{what}: {', '.join(terms)}" for what, terms in found.items() if terms]
        counts = f" ({'; '.join(parts)})" if parts else ""
        said.append(f"Model of {one.axis}: {one.fit.model.structure}{counts}.")
    if any(found["in neither"] for found in listed):
        said.append("In neither: quantization noise averages out, and a ramp is no noise.")
    said += [f"Not in these numbers: {line}, on {one.axis}." for one in axes for line in lines_of(one.fit)]
    if any(BY_DEVIATION in term for found in listed for terms in found.values() for term in terms):
        said += _by_deviation(noise)
    near = [
        one.axis
        for sensor in noise.sensors
        for one in sensor.axes
        for process in one.fit.model.processes
        if process.scale > 0 and 1 / _NEAR < (process.correlation_time(sensor.rate) or 0.0) / horizon < _NEAR
    ]
    if near:
        said.append(
            f"A correlation time of {', '.join(dict.fromkeys(near))} is near the horizon: N and K hang on which side "
            "it is counted to."
        )
    return said


def _by_deviation(noise: Noise) -> list[str]:
    """What is counted by its Allan deviation, and how far off it is at other averaging times."""
    horizon = noise.options.horizon
    times = dict.fromkeys(one.use.time for sensor in noise.sensors for one in sensor.axes)
    said = (
        "By its Allan deviation: a term without a correlation time, as flicker noise, or without a driving noise that "
        "makes a walk of it, is counted as what has its Allan deviation at "
    )
    off = "Where that of the term is flat, as of flicker noise, "
    if None not in times:
        given = ", ".join(f"{time:.4g} s" for time in times if time is not None)
        return [
            f"{said}its correlation time, or the one in this file ({given}): a Gauss-Markov bias of that correlation "
            f"time; what falls at {horizon:g} s is white noise (N). {off}that bias has, at times t far shorter than T, "
            "about 1.4 √(t/T) of it, too little."
        ]
    return [
        f"{said}the horizon T = {horizon:g} s: a random walk (K), or white noise (N) where it falls there. {off}that "
        f"walk has √(t/T) times it at an averaging time t: a tenth at {horizon / 100:g} s, ten times at "
        f"{100 * horizon:g} s."
    ]
