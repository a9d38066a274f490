"""What the models of a unit come down to in a filter that knows white noise and a random walk only."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gmwm.datasheets.bias import SYMBOL
from gmwm.datasheets.effective import WALK, WHITE, Use, by_deviation, counted, is_flicker, is_scale_free, noise_in_use
from gmwm.datasheets.entry import Entry, significant
from gmwm.datasheets.equivalent_terms import translated
from gmwm.datasheets.limits import hidden
from gmwm.errors import DataError
from gmwm.estimation.result import Fit
from gmwm.signals import letter_of, sensor_of
from gmwm.units import SI_UNIT, Quantity

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.calibration.result import AxisCalibration

Rule = Literal["worst", "mean", "each"]
RULES: Mapping[Rule, str] = {
    "worst": "the largest of",
    "mean": "the root mean square of",
    "each": "one for each of",
}
"""How the axes of a sensor become the numbers of a file, in words."""

NAMES: Mapping[Quantity, str] = {"gyro": "gyroscopes", "accel": "accelerometers"}
"""The sensors, in words."""


@dataclass(frozen=True)
class Number:
    """A number of an axis or a sensor; where `upper`, the data only bound it, and it is the upper limit."""

    value: float
    upper: bool

    def scaled(self, factor: float) -> Number:
        """The number times a positive factor."""
        return Number(factor * self.value, self.upper)


@dataclass(frozen=True)
class AxisNoise:
    """N and K of one axis, B of its flicker noise, and what they are for."""

    axis: str
    fit: Fit
    N: Number
    K: Number
    B: Number
    use: Use

    @property
    def time(self) -> float:
        """Correlation time (s) that its walk is given where a consumer wants one."""
        return walk_time(self.fit, self.use.horizon) if self.use.time is None else self.use.time


@dataclass(frozen=True)
class SensorNoise:
    """N and K of one sensor in SI, inflated.

    Parameters
    ----------
    quantity : "gyro" or "accel"
    axes : tuple of AxisNoise
        As measured, not inflated.
    N, K, B : tuple of Number
        Three of them: for x, y and z. All the same but where the rule is "each". B is that of flicker noise alone.
    """

    quantity: Quantity
    axes: tuple[AxisNoise, ...]
    N: tuple[Number, ...]
    K: tuple[Number, ...]
    B: tuple[Number, ...]

    @property
    def rate(self) -> float:
        """Samples per second (Hz) of the recording."""
        return self.axes[0].fit.wavelet_variance.rate


def sensor_noise(
    calibration: Calibration, quantity: Quantity, rule: Rule, inflation: float, uses: Mapping[str, Use]
) -> SensorNoise | None:
    """What a sensor comes down to; None where it was not calibrated.

    Raises
    ------
    DataError
        If the data do not even bound a number, or an axis that is wanted by itself was not calibrated.
    """
    names = axes_of(calibration, quantity)
    if not names:
        return None
    level = calibration.settings.confidence
    axes = tuple(
        axis_noise(axis, calibration.axes[axis], quantity=quantity, use=uses[axis], level=level) for axis in names
    )
    return SensorNoise(
        quantity,
        axes,
        N=ruled([(one.axis, one.N) for one in axes], rule, inflation),
        K=ruled([(one.axis, one.K) for one in axes], rule, inflation),
        B=ruled([(one.axis, one.B) for one in axes], rule, inflation),
    )


def axes_of(calibration: Calibration, quantity: Quantity) -> list[str]:
    """The axes of a sensor that were calibrated, in order."""
    return sorted(axis for axis in calibration if sensor_of(axis) == quantity)


def require_unit(axis: str, fit: Fit, quantity: Quantity) -> None:
    """An error where an axis is not in the SI unit of its sensor, as those of a recording are."""
    if fit.wavelet_variance.unit != SI_UNIT[quantity]:
        raise DataError(
            f"{axis} is in {fit.wavelet_variance.unit or 'no known unit'}, where {SI_UNIT[quantity]} is expected of "
            f"{NAMES[quantity]}; gmwm.read and gmwm.Signal take units="
        )


def axis_noise(axis: str, found: AxisCalibration, quantity: Quantity, use: Use, level: float) -> AxisNoise:
    """N and K of one axis in a use: of the model, or upper limits where it has nothing of the kind."""
    fit = found.fit
    require_unit(axis, fit, quantity)
    # Several files are made of one calibration; refits take their time.
    kept: dict[tuple[Use, float], tuple[Number, Number]] = fit.__dict__.setdefault("_two_numbers", {})
    if (use, level) not in kept:
        entries = noise_in_use(fit, use, level)
        kept[use, level] = (
            _number(axis, fit, entries["N_eff"], level),
            _number(axis, fit, entries["K_eff"], level),
        )
    (white, walk), flicker = kept[use, level], _flicker(found)
    if use.flicker and flicker.value > 0 and not any(WALK in counted(p, use, fit.wavelet_variance.rate)
                                                     for p in translated(fit)[0].model.processes):  # fmt: skip
        # The wandering is in the flicker noise: a walk that the data do not show is not added to it.
        walk = Number(0.0, False)
    return AxisNoise(axis=axis, fit=fit, N=white, K=walk, B=flicker, use=use)


def _flicker(found: AxisCalibration) -> Number:
    """B of the flicker term, which is that of its datasheet where the model has one that is not zero."""
    entry = found.datasheet.get(SYMBOL)
    if entry is None or entry.term is None:
        return Number(0.0, False)
    bounded = entry.upper_only and entry.high is not None and math.isfinite(entry.high)
    return Number(entry.high or 0.0, True) if bounded else Number(entry.value, False)


def ruled(given: Sequence[tuple[str, Number]], rule: Rule, inflation: float) -> tuple[Number, ...]:
    """Three numbers by the rule, times the inflation factor."""
    numbers = [number for _, number in given]
    if rule == "each":
        by_letter = {letter_of(axis): number for axis, number in given}
        lacking = [letter for letter in "xyz" if letter not in by_letter]
        if lacking:
            sensor = sensor_of(given[0][0])
            raise DataError(
                f"axes='each' needs x, y and z of a sensor, {sensor}_{lacking[0]} is not calibrated; take axes='worst'"
            )
        return tuple(by_letter[letter].scaled(inflation) for letter in "xyz")
    if rule == "worst":
        one = max(numbers, key=lambda number: number.value)
    else:
        square = sum(number.value**2 for number in numbers) / len(numbers)
        one = Number(math.sqrt(square), any(number.upper for number in numbers))
    return (one.scaled(inflation),) * 3


def _number(axis: str, fit: Fit, entry: Entry, level: float) -> Number:
    """The value of an entry; its upper limit where the data only bound it or the model has nothing of the kind."""
    if entry.value > 0 and not entry.upper_only:
        return Number(entry.value, False)
    try:
        high = max(entry.high or 0.0, hidden(fit, entry, level))
    except DataError as error:
        raise DataError(str(error).replace("the data do", f"the data of {axis} do", 1)) from error
    if not math.isfinite(high):
        raise DataError(f"the data of {axis} do not bound its {entry.title}; a longer recording may")
    return Number(high, True)


def slow_terms(fit: Fit, horizon: float) -> dict[str, float]:
    """Correlation times (s), finite, of the terms that are a walk over the horizon; by label."""
    written, labels = translated(fit)
    found = {}
    for label, process in zip(labels, written.model.processes, strict=True):
        time = process.correlation_time(fit.wavelet_variance.rate)
        if process.scale > 0 and time is not None and horizon <= time < math.inf:
            found[label] = time
    return found


def walk_time(fit: Fit, horizon: float) -> float:
    """Correlation time (s) of the walk: of the slowest term, or the record's length where no end of it shows."""
    written, _ = translated(fit)
    wv = fit.wavelet_variance
    times = slow_terms(fit, horizon).values()
    endless = any(
        p.scale > 0
        and WALK in counted(p, Use(horizon), wv.rate)
        and (p.correlation_time(wv.rate) == math.inf or is_scale_free(p, wv.rate))
        for p in written.model.processes
    )
    return wv.samples / wv.rate if endless or not times else max(times)


def counted_as(fit: Fit, use: Use) -> dict[str, list[str]]:
    """Which terms of noise are in "N", in "K", in the parameter for flicker noise, and in neither; in words."""
    written, labels = translated(fit)
    rate = fit.wavelet_variance.rate
    found: dict[str, list[str]] = {"N": [], "K": [], "in neither": []}
    if use.flicker:
        found = {"N": [], "K": [], use.flicker: [], "in neither": []}
    for label, process in zip(labels, written.model.processes, strict=True):
        if process.scale == 0 or process.line(rate) is not None:
            continue
        powers = counted(process, use, rate)
        time = process.correlation_time(rate)
        if powers and by_deviation(process, use.horizon, rate):
            label = f"{label} {BY_DEVIATION}"
        elif powers and time is not None and 0 < time < math.inf:
            label = f"{label} (T_c {time:.3g} s)"
        for power in powers:
            found["N" if power == WHITE else "K"].append(label)
        if not powers:
            found[use.flicker if use.flicker and is_flicker(process, rate) else "in neither"].append(label)
    return found


BY_DEVIATION = "(by its Allan deviation)"
"""What stands behind a term that is counted so."""


def lines_of(fit: Fit) -> list[str]:
    """The lines of a model, in words."""
    rate, unit, said = fit.wavelet_variance.rate, fit.wavelet_variance.unit or "u", []
    for process in fit.model.processes:
        line = process.line(rate)
        if line is None or process.scale == 0:
            continue
        told = {number.time_power: number.value for number in process.physical(rate) if not number.signal_power}
        frequency, amplitude = told.get(-1.0, abs(line[1]) * rate), math.sqrt(2 * line[0])
        said.append(f"a line at {significant(frequency, 3)} Hz of amplitude {significant(amplitude, 3)} {unit}")
    return said
