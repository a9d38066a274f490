"""Compute the bias of each axis at rest: mean with standard error, gravity, turn-on spread, and rms of its changes."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np

from gmwm.base.documents import Documented
from gmwm.base.errors import GmwmError
from gmwm.base.lazy import scipy
from gmwm.base.statistics import confidence_of_mean, effects, spread_limits
from gmwm.base.text import duration_text
from gmwm.base.units import sensor_of
from gmwm.calibration.averaging import weighted_candidates
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.recording_info import Recording
from gmwm.choosing.datasheets.bias_changes import BiasTerms, Variance
from gmwm.choosing.datasheets.entry import Entry
from gmwm.choosing.selection.ranking import Ranking
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.inspection import Inspection

S = TypeVar("S")
T = TypeVar("T")


GRAVITY, GRAVITY_ERROR = 9.806, 0.016
"""Default gravity (m/s²) and its standard deviation: middle and spread of a uniform distribution from 9.780 at the
equator to 9.832 at the poles (WGS 84)."""
STEEPEST_AXIS_DEG = 20.0
"""Angle (°) to the vertical up to which a bias is known without attitude: level axes' biases change gravity along it by
less than 0.07 m/s² (tests/calibration/test_rest.py)."""


class AxisMean(NamedTuple):
    """Mean of an axis in one recording, samples without and with lost ones, and gravity with error or None."""

    mean: float
    samples: int
    span: int
    gravity: tuple[float, float] | None = (0.0, 0.0)

    def variance(self, terms: BiasTerms) -> Variance:
        """Return the error variance of the mean for the terms of a model."""
        return terms.variance_of_mean(self.samples, self.span)


@dataclass(frozen=True, kw_only=True)
class BiasAtRest(Documented):
    """The bias of one axis at rest, in its SI unit.

    `mean`, without knocks and outliers, estimates the constant part, or with a random walk the level at the end;
    `error`, `low` and `high` follow from the model. `gravity` is its part in the mean (0: gyroscope, None: unknown
    attitude). `turn_on` is the standard deviation between recordings beyond their noise, None for one. `rms` is that of
    slow terms about the mean over `duration` (s); both have limits at `level`.

    >>> one = BiasAtRest(
    ...     mean=9.81, error=1e-4, low=9.8098, high=9.8102, gravity=9.806, gravity_error=0.016, recordings=1, rms=2e-4,
    ...     rms_low=1e-4, rms_high=4e-4, duration=3600.0, level=0.95, unit="m/s²",
    ... )
    >>> round(one.bias, 4), one.bias_error > one.gravity_error
    (0.004, True)
    """

    mean: float
    error: float
    low: float
    high: float
    gravity: float | None
    gravity_error: float
    recordings: int
    turn_on: float | None = None
    turn_on_low: float | None = None
    turn_on_high: float | None = None
    rms: float
    rms_low: float
    rms_high: float
    duration: float
    level: float
    unit: str
    document_keys = (
        "mean", "error", "low", "high", "gravity", "gravity_error", "recordings", "turn_on", "turn_on_low",
        "turn_on_high", "rms", "rms_low", "rms_high", "duration", "level", "unit", "bias", "bias_error",
    )  # fmt: skip

    @property
    def bias(self) -> float | None:
        """The mean without gravity; None if the attitude is not known well enough."""
        return None if self.gravity is None else self.mean - self.gravity

    @property
    def bias_error(self) -> float:
        """Standard error of the bias, which includes the standard errors of the mean and of the gravity."""
        return math.hypot(self.error, self.gravity_error)

    @property
    def interval(self) -> tuple[float, float]:
        """Confidence interval of the bias, or of the mean if the gravity along the axis is not known."""
        if self.gravity is None:
            return self.low, self.high
        reach = _quantile(math.inf, self.level) * self.gravity_error
        centre = self.mean - self.gravity
        return centre - math.hypot(self.mean - self.low, reach), centre + math.hypot(self.high - self.mean, reach)

    @property
    def entries(self) -> tuple[Entry, ...]:
        """Datasheet entries of the bias (or the mean if the gravity is not known), the turn-on spread and the rms."""
        low, high = self.interval
        has_gravity = self.bias is not None
        entries = [
            Entry(
                symbol="b" if has_gravity else "mean",
                title="bias at rest" if has_gravity else "mean at rest, with gravity",
                value=self.mean if self.bias is None else self.bias, low=low, high=high, unit=self.unit,
            )
        ]  # fmt: skip
        if self.turn_on is not None:
            entries.append(
                Entry(
                    symbol="b_on", title="turn-on spread of the bias", value=self.turn_on, low=self.turn_on_low,
                    high=self.turn_on_high, unit=self.unit, upper_only=not self.turn_on_low,
                )
            )  # fmt: skip
        if self.rms > 0:
            title = f"rms of the bias over {duration_text(self.duration)}"
            entries.append(
                Entry(
                    symbol="b_rms", title=title, value=self.rms, low=self.rms_low, high=self.rms_high, unit=self.unit,
                    upper_only=self.rms_low == 0,
                )
            )  # fmt: skip
        return tuple(entries)


def means_of(inspections: Sequence[Inspection], options: CalibrationOptions) -> dict[str, AxisMean]:
    """Return the mean of each axis of a recording, from the inspections of its parts."""
    means: dict[str, AxisMean] = {}
    for inspection in inspections:
        span = inspection.samples + round(Recording.of(inspection).missing * inspection.rate)
        means |= {axis: AxisMean(item.rest, inspection.samples, span) for axis, item in inspection.axes.items()}
    gravity = gravity_of({axis: item.mean for axis, item in means.items()}, options)
    return {axis: item._replace(gravity=gravity[axis]) for axis, item in means.items()}


def bias_at_rest(fit: Fit, ranking: Ranking, means: Sequence[AxisMean], *, level: float) -> BiasAtRest:
    """Compute an axis's bias at rest from means by recording; noise is averaged over the ranking's models."""
    parts = [mean_of_recording.gravity for mean_of_recording in means if mean_of_recording.gravity is not None]
    removed = len(parts) == len(means)
    values = np.array([mean_of_recording.mean for mean_of_recording in means])
    x = values - (np.array([part[0] for part in parts]) if removed else 0.0)
    fits = [(weight, fit if item.recommended else item.fit) for weight, item in weighted_candidates(ranking)]
    terms = _of_models(fits, BiasTerms.of)
    models = [_of_models(terms, mean_of_recording.variance) for mean_of_recording in means]
    s2 = np.array([_average(mean_of_recording).value for mean_of_recording in models])
    spread: tuple[float, float, float] | None = None
    if len(x) == 1:
        centre, error = float(x[0]), math.sqrt(s2[0])
        reach = reach_of(models[0], level)
        low, high = centre - reach, centre + reach
    else:
        s2 = np.maximum(s2, np.finfo(float).tiny)
        all_of = effects(x, s2)
        centre, error = float(all_of.mean), float(all_of.error)
        low, high = (float(end) for end in confidence_of_mean(x, s2, level))
        least, most = (math.sqrt(float(end)) for end in spread_limits(x, s2, level))
        spread = (math.sqrt(float(all_of.spread2)), least, most) if removed else None
    mean = centre + float(np.mean(values - x))
    wv = fit.wavelet_variance
    # The rms of the bias is computed over an hour, or over the duration of a shorter recording.
    duration = min(3600.0, max(mean_of_recording.span for mean_of_recording in means) / wv.rate)
    rms = _average(_of_models(terms, lambda mean_of_recording: mean_of_recording.variance_over(duration)))
    rms_ends = _limits(rms, level)
    return BiasAtRest(
        mean=mean, error=error, low=low + mean - centre, high=high + mean - centre,
        gravity=mean - centre if removed else None,
        gravity_error=max((part[1] for part in parts), default=0.0) if removed else 0.0,
        recordings=len(means), turn_on=spread[0] if spread else None, turn_on_low=spread[1] if spread else None,
        turn_on_high=spread[2] if spread else None, rms=math.sqrt(rms.value), rms_low=rms_ends[0],
        rms_high=rms_ends[1], duration=duration, level=level, unit=wv.unit,
    )  # fmt: skip


def reach_of(models: Sequence[tuple[float, Variance]], level: float) -> float:
    """Return half the interval of a mean, averaged by tail areas over models (docs/validation/rest.md): Student's with
    2/r² ≥ 1 degrees of freedom for a variance's relative error r, up to the normal interval of its largest value."""
    spreads = [
        (w, math.sqrt(variance.value), max(2 / max(variance.relative, 1e-9) ** 2, 1.0))
        for w, variance in models
        if variance.value > 0
    ]
    total = sum(weight for weight, _, _ in spreads)
    reaches = [_quantile(freedom, level) * size for _, size, freedom in spreads]
    low, high = min(reaches, default=0.0), max(reaches, default=0.0)
    while high - low > 1e-9 * high:
        middle = (low + high) / 2
        outside = sum(
            weight * 2 * float(scipy.special.stdtr(freedom, -middle / size)) for weight, size, freedom in spreads
        )
        low, high = (middle, high) if outside > (1 - level) * total else (low, middle)
    return min(high, _quantile(math.inf, level) * math.sqrt(max((v.limit for _, v in models), default=0.0)))


def gravity_of(means: Mapping[str, float], options: CalibrationOptions) -> dict[str, tuple[float, float] | None]:
    """Return gravity along each axis with its error, or None. It is √(g² − h²) for a near-vertical axis, with the norm
    h of the level axes' means, whose biases have a second-order effect; for a level axis it is g times its tilt."""
    gravity: dict[str, tuple[float, float] | None] = dict.fromkeys(means, (0.0, 0.0))
    accel = {axis: mean for axis, mean in means.items() if sensor_of(axis) == "accel"}
    gravity |= dict.fromkeys(accel)
    g, error = (GRAVITY, GRAVITY_ERROR) if options.gravity is None else (options.gravity, 0.0)
    upright = [axis for axis, mean in accel.items() if abs(mean) > g / 2]
    if len(upright) != 1:
        return gravity
    (vertical,) = upright
    side = math.copysign(1.0, accel[vertical])
    if options.tilt is not None:
        angle = math.radians(options.tilt) / math.sqrt(3)  # standard deviation of a uniform distribution
        gravity |= dict.fromkeys(accel, (0.0, g * angle))
        gravity[vertical] = side * g, math.hypot(error, g * angle**2)
        return gravity
    level = math.hypot(*(mean for axis, mean in accel.items() if axis != vertical))
    if len(accel) == 3 and level <= g * math.sin(math.radians(STEEPEST_AXIS_DEG)):
        # 0.2 m/s², 20 mg, is a typical limit in datasheets of MEMS accelerometers (tests/calibration/test_rest.py).
        off = math.hypot(error, level / g * 0.2, 0.2**2 / (2 * g))
        gravity[vertical] = side * math.sqrt(g * g - level * level), off
    return gravity


def _of_models(models: Sequence[tuple[float, T]], of: Callable[[T], S]) -> list[tuple[float, S]]:
    """Return what `of` computes for each plausible model, with the weight of the model."""
    parts = []
    for weight, item in models:
        try:
            parts.append((weight, of(item)))
        except GmwmError:  # A model without standard errors gives no information about the bias.
            continue
    return parts


def _average(models: Sequence[tuple[float, Variance]]) -> Variance:
    """Return the weighted mean of the variances of the models. Its error includes the spread between the models."""
    total = sum(weight for weight, _ in models)
    value = sum(weight * variance.value for weight, variance in models) / total if total else 0.0
    if value <= 0:
        return Variance(0.0, 0.0)
    scatter = sum(
        weight * ((variance.value * variance.relative) ** 2 + (variance.value - value) ** 2)
        for weight, variance in models
    )
    limit = max(variance.limit for weight, variance in models)
    return Variance(value, math.sqrt(scatter / total) / value, limit)


def _limits(variance: Variance, level: float) -> tuple[float, float]:
    """Return a standard deviation's interval, symmetric by logarithm, from 0 if its variance is insignificant."""
    reach = _quantile(math.inf, level) * variance.relative
    size = math.sqrt(variance.value)
    most = max(size, math.sqrt(variance.limit))
    if reach >= 1:
        return 0.0, min(size * math.sqrt(1 + reach), most)
    return size * math.exp(-reach / 2), min(size * math.exp(reach / 2), most)


def _quantile(freedom: float, level: float) -> float:
    """Return the two-sided quantile of Student's distribution with `freedom` degrees of freedom at a level."""
    share = (1 + level) / 2
    return float(scipy.special.ndtri(share) if math.isinf(freedom) else scipy.special.stdtrit(freedom, share))
