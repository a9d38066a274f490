"""Combine N, K and the biases at rest of the axes of a unit into the parameters of a file."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from gmwm.base.errors import DataError
from gmwm.base.lazy import once_per_result
from gmwm.base.remarks import Remark
from gmwm.base.units import SI_UNIT, Quantity, letter_of, sensor_of
from gmwm.calibration import Calibration
from gmwm.calibration.number_verdicts import as_limit
from gmwm.calibration.rest import BiasAtRest
from gmwm.calibration.result import AxisCalibration
from gmwm.choosing.datasheets.bias import SYMBOL
from gmwm.choosing.datasheets.effective import Use, filter_entries, limited
from gmwm.choosing.datasheets.entry import Entry
from gmwm.fitting.estimation.result import GIVEN, Fit


def three(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> tuple[float, ...]:
    """Return the biases (SI) of the x, y and z axes of a sensor. A bias that is not known is 0."""
    known = {letter_of(axis): one.bias for axis, one in rest.items() if sensor_of(axis) == quantity}
    return tuple(known.get(letter) or 0.0 for letter in "xyz")


def known_axes(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> list[str]:
    """Return the axes of a sensor whose bias is known."""
    return [axis for axis, one in rest.items() if sensor_of(axis) == quantity and one.bias is not None]


def stated(calibration: Calibration, quantities: Sequence[Quantity]) -> Iterator[str]:
    """Yield a sentence on the biases of each sensor, with standard errors and the size of their changes."""
    for quantity in quantities:
        axes = sorted(known_axes(calibration.rest, quantity))
        if not axes:
            continue
        rest = [calibration.rest[axis] for axis in axes]
        each = ", ".join(
            f"{axis} {bias.bias:.3g} +- {bias.bias_error:.1g}" for axis, bias in zip(axes, rest, strict=True)
        )
        rms = max(bias.rms for bias in rest)
        spread = [bias.turn_on for bias in rest if bias.turn_on is not None]
        turn_on = f", turn-on spread {max(spread):.2g}" if spread else ""
        yield f"Bias at rest ({SI_UNIT[quantity]}): {each}; rms over {rest[0].duration:.4g} s {rms:.2g}{turn_on}."


def unknown(calibration: Calibration, quantities: Sequence[Quantity]) -> Iterator[Remark]:
    """Yield a remark for each sensor with axes whose bias is not known, so that the file contains 0."""
    for quantity in quantities:
        known = set(known_axes(calibration.rest, quantity))
        letters = {letter_of(axis) for axis in known}
        axes = [f"{quantity}_{letter}" for letter in "xyz" if letter not in letters]
        if axes:
            seen = any(sensor_of(axis) == quantity for axis in calibration.rest)
            yield Remark.of(
                "bias-not-known", ", ".join(axes), why="tilt" if seen and quantity == "accel" else "recording",
                sensor=NAMES[quantity],
            )  # fmt: skip


def prior(rest: Mapping[str, BiasAtRest], quantity: Quantity) -> float | None:
    """Return the prior standard deviation (SI) of a bias for a filter, or None: worst axis's root sum of squares of
    error, RMS change at rest and turn-on spread."""
    known = [rest[axis] for axis in known_axes(rest, quantity)]
    if len(known) < 3:
        return None
    return max(math.hypot(one.bias_error, one.rms, one.turn_on or 0.0) for one in known)


Rule = Literal["worst", "mean", "each"]
RULES: Mapping[Rule, str] = {"worst": "the largest of", "mean": "the root mean square of", "each": "one for each of"}
"""Rules that combine the axes of a sensor into the parameters of a file, with their descriptions."""

NAMES: Mapping[Quantity, str] = {"gyro": "gyroscopes", "accel": "accelerometers"}  # names of the sensors in sentences


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
    """Noise parameters of one axis in SI units."""

    axis: str  # name of the axis
    fit: Fit  # fit of the noise model
    # white noise, random walk, and coefficient of the flicker term
    N: Number
    K: Number
    B: Number
    use: Use  # horizon and treatment of flicker noise for which N and K are computed


@dataclass(frozen=True)
class SensorNoise:
    """Noise parameters of one sensor in SI units, after inflation."""

    quantity: Quantity  # kind of the sensor
    axes: tuple[AxisNoise, ...]  # parameters of each axis, before inflation
    # White noise, random walk and flicker coefficient for x, y and z, equal unless the rule is "each".
    N: tuple[Number, ...]
    K: tuple[Number, ...]
    B: tuple[Number, ...]

    def worst(self, symbol: str) -> AxisNoise:
        """Return the axis with the largest number N, K or B, limits included."""
        return max(self.axes, key=lambda each: getattr(each, symbol).value)

    @property
    def rate(self) -> float:
        """Sampling rate (Hz) of the recording."""
        return self.axes[0].fit.wavelet_variance.rate


def sensor_noise(
    calibration: Calibration, quantity: Quantity, rule: Rule, inflation: float, use: Use
) -> SensorNoise | None:
    """Return N, K and B of a sensor, or None if not calibrated; DataError if the data lack what the rule needs."""
    names = axes_of(calibration, quantity)
    if not names:
        return None
    level = calibration.settings.confidence
    axes = tuple(axis_noise(axis, calibration.axes[axis], quantity=quantity, use=use, level=level) for axis in names)
    white, walk, flicker = (
        ruled([(each.axis, getattr(each, symbol)) for each in axes], rule, inflation) for symbol in ("N", "K", "B")
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


def axis_noise(axis: str, calibrated: AxisCalibration, quantity: Quantity, use: Use, level: float) -> AxisNoise:
    """Return N and K of one axis for a use: the numbers of its datasheet, unless the horizon or the program differ."""
    fit = calibrated.fit
    require_unit(axis, fit, quantity)
    flicker = _flicker(calibrated)
    white, walk = filter_pair(calibrated, use, level)
    # If the flicker term describes the slow noise, no upper limit of a random walk is added.
    described = use.flicker and flicker.value > 0 and filter_entries(fit, use, level)["K"].value == 0
    K = Number(0.0, False) if described else _number(axis, fit, walk)
    return AxisNoise(axis, fit, N=_number(axis, fit, white), K=K, B=flicker, use=use)


def filter_pair(calibrated: AxisCalibration, use: Use, level: float) -> tuple[Entry, Entry]:
    """Return N and K of an axis for a use: those of its datasheet, unless the horizon or the program differ."""
    fit, sheet = calibrated.fit, calibrated.datasheet
    if use == Use() and {"N", "K"} <= set(sheet):
        return sheet["N"], sheet["K"]
    # The entries are stored, because many files are written from one calibration, and a limit needs another fit.
    numbers = once_per_result(
        fit, "limited", (use, level), lambda: limited(fit, filter_entries(fit, use, level), use.horizon, level)
    )
    white, walk = (
        as_limit(entry) if entry.symbol in sheet and sheet[entry.symbol].upper_only else entry
        for entry in (numbers["N"], numbers["K"])
    )
    return white, walk


def _flicker(calibrated: AxisCalibration) -> Number:
    """Return B of the flicker term from the datasheet, or zero if the model has no flicker term."""
    entry = calibrated.datasheet.get(SYMBOL)
    if entry is None or entry.term is None:
        return Number(0.0, False)
    bounded = entry.upper_only and entry.high is not None and math.isfinite(entry.high)
    return Number(entry.high or 0.0, True) if bounded else Number(entry.value, False)


def ruled(numbers: Sequence[tuple[str, Number]], rule: Rule, inflation: float) -> tuple[Number, ...]:
    """Combine a parameter of several axes by a rule, and multiply it by the inflation factor."""
    if rule == "each":
        by_letter = {letter_of(axis): number for axis, number in numbers}
        if missing := [letter for letter in "xyz" if letter not in by_letter]:
            sensor = sensor_of(numbers[0][0])
            raise DataError(
                f"{sensor}_{missing[0]} is not calibrated, so there is no number for each axis",
                advice="Combine the other axes with the rule 'worst' or 'mean'.",
            )
        return tuple(by_letter[letter].scaled(inflation) for letter in "xyz")
    values = [number for _, number in numbers]
    if rule == "worst":
        combined = max(values, key=lambda number: number.value)
    else:
        square = sum(number.value**2 for number in values) / len(values)
        combined = Number(math.sqrt(square), any(number.upper for number in values))
    return (combined.scaled(inflation),) * 3


def _number(axis: str, fit: Fit, entry: Entry) -> Number:
    """Return the value of a parameter, or its upper limit if the data do not distinguish it from zero."""
    if not entry.upper_only:
        return Number(entry.value, False)
    if fit.weighting == GIVEN:
        examples = {"gyroN": "N=0.15deg/√h", "accelN": "N=60µg/√Hz", "accelK": "K=0.1mg/√h, or as B=0.02mg"}
        raise DataError(
            f"the numbers of {axis} contain no {entry.title}, and there is no recording that limits it",
            advice="Add it, for example as {example}.",
            example=examples.get(axis[:-2] + entry.symbol[:1], "K=2deg/h/√h, or as B=3deg/h"),
        )
    if entry.high is None or not math.isfinite(entry.high):
        raise DataError(
            f"the data of {axis} do not determine an upper limit of its {entry.title}", advice="Record longer."
        )
    return Number(entry.high, True)


def lines_of(fit: Fit) -> list[tuple[float, float, str]]:
    """Return amplitude, frequency (Hz) and term of each sinusoid, strongest first; N and K cannot represent them."""
    rate = fit.wavelet_variance.rate
    return sorted((
        (math.sqrt(2 * line[0]), process.oscillation() or abs(line[1]) * rate, term)
        for term, process in fit.model.by_term.items()
        if (line := process.line(rate)) is not None and process.scale > 0
    ), reverse=True)  # fmt: skip
