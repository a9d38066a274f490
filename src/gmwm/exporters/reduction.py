"""What the models of a unit come down to in a filter that knows white noise and a random walk only."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from gmwm.datasheets.effective import WHITE, counted, effective_noise, is_scale_free
from gmwm.datasheets.entry import Entry
from gmwm.datasheets.translation import translated
from gmwm.errors import DataError, FitWarning, GmwmError, OptionError
from gmwm.estimation import fit as fitted
from gmwm.estimation.result import Fit
from gmwm.estimation.reweighting import REWEIGHTED
from gmwm.processes.base import Process
from gmwm.processes.noise import WN
from gmwm.processes.walk import RW
from gmwm.units import SI_UNIT, Quantity, noise_unit

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

Rule = Literal["worst", "mean", "each"]
RULES: Mapping[Rule, str] = {
    "worst": "the largest of",
    "mean": "the root mean square of",
    "each": "one for each of",
}
"""How the axes of a sensor become the numbers of a file, in words."""

_NAMES: Mapping[Quantity, str] = {"gyro": "gyroscopes", "accel": "accelerometers"}
_KINDS: Mapping[str, type[Process]] = {"N_eff": WN, "K_eff": RW}
"""What is added to a model that has nothing of the kind, to ask the data how much of it there could be."""


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
    """N and K of one axis, and the correlation time (s) that its walk is given where a consumer wants one."""

    axis: str
    fit: Fit
    N: Number
    K: Number
    time: float


@dataclass(frozen=True)
class SensorNoise:
    """N and K of one sensor in SI, inflated.

    Parameters
    ----------
    quantity : "gyro" or "accel"
    axes : tuple of AxisNoise
        As measured, not inflated.
    N, K : tuple of Number
        Three of them: for x, y and z. All the same but where the rule is "each".
    """

    quantity: Quantity
    axes: tuple[AxisNoise, ...]
    N: tuple[Number, ...]
    K: tuple[Number, ...]

    @property
    def rate(self) -> float:
        """Samples per second (Hz) of the recording."""
        return self.axes[0].fit.wavelet_variance.rate


def sensor_noise(
    calibration: Calibration, quantity: Quantity, rule: Rule, inflation: float, horizon: float
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
    axes = tuple(axis_noise(axis, calibration[axis], quantity, horizon, level) for axis in names)
    return SensorNoise(
        quantity,
        axes,
        ruled([(one.axis, one.N) for one in axes], rule, inflation),
        ruled([(one.axis, one.K) for one in axes], rule, inflation),
    )


def axes_of(calibration: Calibration, quantity: Quantity) -> list[str]:
    """The axes of a sensor that were calibrated, in order."""
    return sorted(axis for axis in calibration if axis.rpartition("_")[0] == quantity)


def require_unit(axis: str, fit: Fit, quantity: Quantity) -> None:
    """An error where an axis is not in the SI unit of its sensor, as those of a recording are."""
    if fit.wavelet_variance.unit != SI_UNIT[quantity]:
        raise DataError(
            f"{axis} is in {fit.wavelet_variance.unit or 'no known unit'}, where {SI_UNIT[quantity]} is expected of "
            f"{_NAMES[quantity]}; gmwm.read and gmwm.Signal take units="
        )


def axis_noise(axis: str, fit: Fit, quantity: Quantity, horizon: float, level: float) -> AxisNoise:
    """N and K of one axis over a horizon: of the model, or upper limits where it has nothing of the kind."""
    require_unit(axis, fit, quantity)
    # Several files are made of one calibration; refits take their time.
    kept: dict[tuple[float, float], tuple[Number, Number]] = fit.__dict__.setdefault("_two_numbers", {})
    if (horizon, level) not in kept:
        entries = effective_noise(fit, horizon, level)
        kept[horizon, level] = (
            _number(axis, fit, entries["N_eff"], level),
            _number(axis, fit, entries["K_eff"], level),
        )
    white, walk = kept[horizon, level]
    return AxisNoise(axis, fit, white, walk, _walk_time(fit, horizon))


def ruled(given: Sequence[tuple[str, Number]], rule: Rule, inflation: float) -> tuple[Number, ...]:
    """Three numbers by the rule, times the inflation factor."""
    numbers = [number for _, number in given]
    if rule == "each":
        by_letter = {axis.rpartition("_")[2]: number for axis, number in given}
        lacking = [letter for letter in "xyz" if letter not in by_letter]
        if lacking:
            sensor = given[0][0].rpartition("_")[0]
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
    high = max(entry.high or 0.0, _limit(axis, fit, entry, level))
    if not math.isfinite(high):
        raise DataError(f"the data of {axis} do not bound its {entry.title}; a longer recording may")
    return Number(high, True)


def _limit(axis: str, fit: Fit, entry: Entry, level: float) -> float:
    """The upper limit in the model with a term of the kind, which the data do not need but could hide."""
    kind, (base, _) = _KINDS[entry.symbol], translated(fit)
    try:
        holder = base if any(isinstance(p, kind) for p in base.model.processes) else _widened(base, kind)
        intervals = holder.confidence_intervals(level)
    except GmwmError as error:
        raise DataError(f"the data of {axis} do not bound its {entry.title}: {error}") from error
    pairs = zip(holder.model.terms, holder.model.processes, strict=True)
    term, process = next((t, p) for t, p in pairs if isinstance(p, kind))
    scale = process.scale_parameter().name
    high = process.value(scale) if process.is_fixed(scale) else intervals[f"{term}.{scale}"][1]
    if not math.isfinite(high):
        return math.inf
    wv = fit.wavelet_variance
    number = process.with_values(**{scale: high}).physical(wv.rate)[0]
    return noise_unit(number.time_power, wv.unit)[1] * number.value


def _widened(fit: Fit, kind: type[Process]) -> Fit:
    """The fit of the model with one more term to the same data."""
    weighting = fit.weighting if fit.weighting in REWEIGHTED else fit.weighting_matrix
    with warnings.catch_warnings():
        # That the term is not needed is known.
        warnings.simplefilter("ignore", FitWarning)
        return fitted(fit.model + kind(), fit.wavelet_variance, weighting=weighting, certify=False)


def slow_terms(fit: Fit, horizon: float) -> dict[str, float]:
    """Correlation times (s), finite, of the terms that are a walk over the horizon; by label."""
    written, labels = translated(fit)
    found = {}
    for label, process in zip(labels, written.model.processes, strict=True):
        time = process.correlation_time(fit.wavelet_variance.rate)
        if process.scale > 0 and time is not None and horizon <= time < math.inf:
            found[label] = time
    return found


def _walk_time(fit: Fit, horizon: float) -> float:
    """Correlation time (s) of the walk: of the slowest term, or the record's length where no end of it shows."""
    written, _ = translated(fit)
    wv = fit.wavelet_variance
    times = slow_terms(fit, horizon).values()
    endless = any(p.scale > 0 and p.correlation_time(wv.rate) == math.inf for p in written.model.processes)
    return wv.samples / wv.rate if endless or not times else max(times)


def counted_as(fit: Fit, horizon: float) -> dict[str, list[str]]:
    """Which terms are in "N", in "K", and in neither; in words."""
    written, labels = translated(fit)
    rate = fit.wavelet_variance.rate
    found: dict[str, list[str]] = {"N": [], "K": [], "in neither": []}
    for label, process in zip(labels, written.model.processes, strict=True):
        if process.scale == 0:
            continue
        power = counted(process, horizon, rate)
        time = process.correlation_time(rate)
        if power is not None and is_scale_free(process, rate):
            label = f"{label} (by its Allan deviation at the horizon)"
        elif power is not None and time is not None and 0 < time < math.inf:
            label = f"{label} (T_c {time:.3g} s)"
        found["in neither" if power is None else "N" if power == WHITE else "K"].append(label)
    return found


def has_scale_free(fit: Fit) -> bool:
    """Whether a term that is there has no correlation time, as flicker noise."""
    rate = fit.wavelet_variance.rate
    return any(process.scale > 0 and is_scale_free(process, rate) for process in translated(fit)[0].model.processes)


def checked_horizon(horizon: float) -> float:
    """A positive time in s."""
    if isinstance(horizon, bool) or not isinstance(horizon, int | float) or not 0 < horizon < math.inf:
        raise OptionError(f"horizon must be a positive time in s, got {horizon!r}")
    return float(horizon)
