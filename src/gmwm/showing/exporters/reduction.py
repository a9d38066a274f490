"""Reduce the noise models of a unit to white noise N and random walk K, the parameters of most filters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gmwm.base.axis_names import letter_of, sensor_of
from gmwm.base.errors import DataError, GmwmError
from gmwm.base.units import SI_UNIT, Quantity
from gmwm.choosing.datasheets.bias import SYMBOL
from gmwm.choosing.datasheets.effective import WALK, WHITE, Use, by_deviation, counted, is_flicker, noise_in_use
from gmwm.choosing.datasheets.entry import Entry
from gmwm.choosing.datasheets.equivalent_terms import translated
from gmwm.choosing.datasheets.limits import hidden
from gmwm.fitting.estimation.result import GIVEN, Fit

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.result import AxisCalibration

Rule = Literal["worst", "mean", "each"]
RULES: Mapping[Rule, str] = {
    "worst": "the largest of",
    "mean": "the root mean square of",
    "each": "one for each of",
}
"""Rules that combine the axes of a sensor into the parameters of a file, with their descriptions."""

NAMES: Mapping[Quantity, str] = {"gyro": "gyroscopes", "accel": "accelerometers"}
"""Names of the sensors in sentences."""


@dataclass(frozen=True)
class Number:
    """Value of a noise parameter: a measured value, or an upper limit if `upper` is true."""

    value: float
    upper: bool

    def scaled(self, factor: float) -> Number:
        """Return the value multiplied by a positive factor."""
        return Number(factor * self.value, self.upper)


@dataclass(frozen=True)
class AxisNoise:
    """Noise parameters of one axis in SI units.

    Attributes
    ----------
    axis : str
        Name of the axis.
    fit : Fit
        Fit of the noise model.
    N, K, B : Number
        White noise, random walk, and coefficient of the flicker term.
    use : Use
        Horizon and treatment of flicker noise for which N and K are computed.
    """

    axis: str
    fit: Fit
    N: Number
    K: Number
    B: Number
    use: Use

    @property
    def at_horizon(self) -> float:
        """Allan variance N²/T_h + K² T_h/3 of N and K at the horizon T_h."""
        return self.N.value**2 / self.use.horizon + self.K.value**2 * self.use.horizon / 3


@dataclass(frozen=True)
class SensorNoise:
    """Noise parameters of one sensor in SI units, after inflation.

    Parameters
    ----------
    quantity : "gyro" or "accel"
        Kind of the sensor.
    axes : tuple of AxisNoise
        Parameters of each axis, before inflation.
    N, K, B : tuple of Number
        White noise, random walk and coefficient of the flicker term, with three values for x, y and z. The three values
        are equal unless the rule is "each".
    """

    quantity: Quantity
    axes: tuple[AxisNoise, ...]
    N: tuple[Number, ...]
    K: tuple[Number, ...]
    B: tuple[Number, ...]

    @property
    def worst(self) -> AxisNoise:
        """The axis with the largest Allan deviation at the horizon. The rule "worst" uses the parameters of this
        axis."""
        return max(self.axes, key=lambda one: one.at_horizon)

    @property
    def rate(self) -> float:
        """Sampling rate (Hz) of the recording."""
        return self.axes[0].fit.wavelet_variance.rate


def sensor_noise(
    calibration: Calibration, quantity: Quantity, rule: Rule, inflation: float, use: Use
) -> SensorNoise | None:
    """Return N, K and B of a sensor, or None if it was not calibrated.

    Raises
    ------
    DataError
        If the data do not determine even an upper limit, or if the rule is "each" and an axis was not calibrated.
    """
    names = axes_of(calibration, quantity)
    if not names:
        return None
    level = calibration.settings.confidence
    axes = tuple(axis_noise(axis, calibration.axes[axis], quantity=quantity, use=use, level=level) for axis in names)
    used = axes if rule != "worst" else (max(axes, key=lambda one: one.at_horizon),)
    white, walk, flicker = (
        ruled([(one.axis, getattr(one, symbol)) for one in used], rule, inflation) for symbol in ("N", "K", "B")
    )
    return SensorNoise(quantity, axes, N=white, K=walk, B=flicker)


def axes_of(calibration: Calibration, quantity: Quantity) -> list[str]:
    """Return the calibrated axes of a sensor, in alphabetical order."""
    return sorted(axis for axis in calibration if sensor_of(axis) == quantity)


def require_unit(axis: str, fit: Fit, quantity: Quantity) -> None:
    """Raise an error if the signal of an axis is not in the SI unit of its sensor."""
    if fit.wavelet_variance.unit != SI_UNIT[quantity]:
        raise DataError(
            f"{axis} is in {fit.wavelet_variance.unit or 'an unknown unit'} instead of {SI_UNIT[quantity]}",
            advice="Read the recording again with {--units}.",
        )


def axis_noise(axis: str, found: AxisCalibration, quantity: Quantity, use: Use, level: float) -> AxisNoise:
    """Return N and K of one axis for a use. If the model has no such noise, they are upper limits."""
    fit = found.fit
    require_unit(axis, fit, quantity)
    # The values are stored, because many files are written from one calibration, and an upper limit needs another fit.
    known: dict[tuple[Use, float], tuple[Number, Number]] = fit.__dict__.setdefault("_two_numbers", {})
    flicker = _flicker(found)
    if (use, level) not in known:
        entries = noise_in_use(fit, use, level)
        white = _number(axis, fit, entries["N_eff"], level)
        processes, rate = translated(fit)[0].model.processes, fit.wavelet_variance.rate
        # If the flicker term describes the slow noise, no upper limit of a random walk is added.
        alone = use.flicker and flicker.value > 0 and not any(WALK in counted(p, use, rate) for p in processes)
        known[use, level] = (white, Number(0.0, False) if alone else _number(axis, fit, entries["K_eff"], level))
    white, walk = known[use, level]
    return AxisNoise(axis=axis, fit=fit, N=white, K=walk, B=flicker, use=use)


def _flicker(found: AxisCalibration) -> Number:
    """Return B of the flicker term from the datasheet, or zero if the model has no flicker term."""
    entry = found.datasheet.get(SYMBOL)
    if entry is None or entry.term is None:
        return Number(0.0, False)
    bounded = entry.upper_only and entry.high is not None and math.isfinite(entry.high)
    return Number(entry.high or 0.0, True) if bounded else Number(entry.value, False)


def ruled(given: Sequence[tuple[str, Number]], rule: Rule, inflation: float) -> tuple[Number, ...]:
    """Combine a parameter of several axes by a rule, and multiply it by the inflation factor."""
    numbers = [number for _, number in given]
    if rule == "each":
        by_letter = {letter_of(axis): number for axis, number in given}
        if missing := [letter for letter in "xyz" if letter not in by_letter]:
            sensor = sensor_of(given[0][0])
            raise DataError(
                f"{sensor}_{missing[0]} is not calibrated, so there is no number for each axis",
                advice="Combine the other axes with the rule 'worst' or 'mean'.",
            )
        return tuple(by_letter[letter].scaled(inflation) for letter in "xyz")
    if rule == "worst":
        one = max(numbers, key=lambda number: number.value)
    else:
        square = sum(number.value**2 for number in numbers) / len(numbers)
        one = Number(math.sqrt(square), any(number.upper for number in numbers))
    return (one.scaled(inflation),) * 3


def _number(axis: str, fit: Fit, entry: Entry, level: float) -> Number:
    """Return the value of a parameter, or its upper limit if the data do not distinguish it from zero."""
    if entry.value > 0 and not entry.upper_only:
        return Number(entry.value, False)
    if fit.weighting == GIVEN:
        raise DataError(
            f"the numbers of {axis} contain no {entry.title}, and there is no recording that limits it",
            advice="Add it, for example a random walk as K=2deg/h/√h, or a bias instability as B=3deg/h.",
        )
    try:
        high = max(entry.high or 0.0, hidden(fit, entry, level))
    except DataError as error:
        raise _unbounded(axis, entry, error.__cause__) from error
    if not math.isfinite(high):
        raise _unbounded(axis, entry)
    return Number(high, True)


def _unbounded(axis: str, entry: Entry, cause: BaseException | None = None) -> DataError:
    message = f"the data of {axis} do not determine an upper limit of its {entry.title}"
    if isinstance(cause, GmwmError):
        return DataError(f"{message}: {cause.reason}", advice="Record longer.").with_advice_of(cause)
    return DataError(message, advice="Record longer.")


def counted_as(fit: Fit, use: Use) -> dict[str, list[str]]:
    """Return the terms of a model by the parameter of the file that includes them.

    The keys are "N", "K", the parameter for flicker noise, and "" for terms that no parameter includes.
    """
    written, labels = translated(fit)
    rate = fit.wavelet_variance.rate
    found: dict[str, list[str]] = {"N": [], "K": [], "": []}
    if use.flicker:
        found = {"N": [], "K": [], use.flicker: [], "": []}
    for label, process in zip(labels, written.model.processes, strict=True):
        if process.scale == 0 or process.line(rate) is not None:
            continue
        powers = counted(process, use, rate)
        time = process.correlation_time(rate)
        if powers and by_deviation(process, use.horizon, rate):
            label = f"{label} (by its Allan deviation)"
        elif powers and time is not None and 0 < time < math.inf:
            label = f"{label} (T_c {time:.3g} s)"
        for power in powers:
            found["N" if power == WHITE else "K"].append(label)
        if not powers:
            found[use.flicker if use.flicker and is_flicker(process, rate) else ""].append(label)
    return found


def replaced_terms(fit: Fit, use: Use) -> tuple[str, ...]:
    """Return the terms that are replaced by noise with the same Allan deviation at the horizon only."""
    written, labels = translated(fit)
    rate = fit.wavelet_variance.rate
    return tuple(
        label
        for label, process in zip(labels, written.model.processes, strict=True)
        if process.scale > 0
        and process.line(rate) is None
        and counted(process, use, rate)
        and by_deviation(process, use.horizon, rate)
    )


@dataclass(frozen=True)
class Line:
    """A sinusoid of a model: name of the term, frequency (Hz), and amplitude in the unit of the signal."""

    term: str
    frequency: float
    amplitude: float


def lines_of(fit: Fit) -> list[Line]:
    """Return the sinusoids of a fit. A filter with only N and K cannot represent them."""
    rate = fit.wavelet_variance.rate
    found = []
    for term, process in zip(fit.model.terms, fit.model.processes, strict=True):
        line = process.line(rate)
        if line is None or process.scale == 0:
            continue
        times = {number.time_power: number.value for number in process.physical(rate) if not number.signal_power}
        found.append(Line(term, times.get(-1.0, abs(line[1]) * rate), math.sqrt(2 * line[0])))
    return found
