"""How well a filter with N and K of a file predicts, and how true its stated error is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gmwm.choosing.datasheets.filter_numbers import samples_in, smallest_error
from gmwm.choosing.datasheets.misfit import curve_ratio
from gmwm.choosing.datasheets.prediction import FilterGain, FilterPrediction
from gmwm.showing.exporters.reduction import NAMES, AxisNoise, SensorNoise
from gmwm.showing.exporters.two_states import (
    LEAST_AVERAGING_RATIO,
    LONGEST_AVERAGING_S,
    Curve,
    cached,
    fit_states,
)

TIMES = (1.0, 10.0, 60.0)
"""Times (s) over which the predictions of the filters are compared."""
TRUE = (0.8, 1.3)
"""Ratios of the stated to the real error between which a file says nothing more. A convention, pinned by
tests/exporters/test_quality.py."""
LARGE_LOSS = 1.2
"""Loss at the longest time from which a file advises a filter with more states. A convention, pinned by
tests/exporters/test_quality.py."""


@dataclass(frozen=True)
class Quality:
    """RMS error of the predicted mean over a time: over that of the filter of the full model, and stated over real.

    `loss` is None if the full model has no filter.
    """

    loss: float | None
    claim: float


def qualities(axis: AxisNoise) -> tuple[Quality, ...]:
    """Return the quality of N and K of an axis at each of `TIMES`, without inflation."""
    stored: dict[tuple[float, float], tuple[Quality, ...]] = axis.fit.__dict__.setdefault("_qualities", {})
    key = axis.N.value, axis.K.value
    if key not in stored:
        stored[key] = tuple(_quality(axis, time) for time in TIMES)
    return stored[key]


def _quality(axis: AxisNoise, time: float) -> Quality:
    processes, rate = axis.fit.model.processes, axis.fit.wavelet_variance.rate
    samples, gain = samples_in(time, rate), FilterGain(axis.K.value / (axis.N.value * rate))
    # The filter of the full model has no sinusoids either.
    error = FilterPrediction.of(processes, rate, samples, lines=False).error(gain)[0]
    ratio = curve_ratio(axis.fit)
    real = FilterPrediction.of(processes, rate, samples, ratio).error(gain)[0]
    least = smallest_error(processes, rate, samples)
    stated = axis.N.value**2 * rate * gain.claim(samples)[0]
    return Quality(None if least is None else math.sqrt(max(error / least, 1.0)), math.sqrt(stated / real))


def predictions(sensors: Iterable[SensorNoise]) -> list[str]:
    """Return a sentence for each sensor on the loss of N and K against the full model, and on their stated error, each
    for the axis where it is worst."""
    lines, times, large = [], "/".join(f"{time:g}" for time in TIMES), False
    for sensor in sensors:
        axes = [axis for axis in sensor.axes if axis.N.value > 0]
        if not axes:
            continue
        by_time = list(zip(*(qualities(axis) for axis in axes), strict=True))
        losses = [max((each.loss for each in at if each.loss is not None), default=math.nan) for at in by_time]
        claims = [max((each.claim for each in at), key=lambda claim: abs(math.log(claim))) for at in by_time]
        text = f"{NAMES[sensor.quantity].capitalize()}, {times} s: "
        if not any(map(math.isnan, losses)):
            text += f"error / full model's error {_listed(losses)}; "
        lines.append(f"{text}stated / real error {_listed(claims)}.")
        true = [time for time, claim in zip(TIMES, claims, strict=True) if TRUE[0] <= claim <= TRUE[1]]
        if true and true[-1] < TIMES[-1]:
            lines.append(
                f"{NAMES[sensor.quantity].capitalize()}: N and K hold up to {true[-1]:g} s; beyond, set the "
                f"horizon{_bias_instead(axes)}."
            )
        large = large or losses[-1] > LARGE_LOSS
    return [*lines, "Filters with Gauss-Markov states (format state-space) predict better."] if large else lines


def _bias_instead(axes: Sequence[AxisNoise]) -> str:
    """Return white noise and a Gauss-Markov bias for the axis with the worst stated error at the longest time. The
    errors that a filter with these numbers states are true at all times (docs/validation/filter.md)."""
    axis = max(axes, key=lambda axis: abs(math.log(qualities(axis)[-1].claim)))
    longest = min(LONGEST_AVERAGING_S, axis.fit.wavelet_variance.samples / axis.fit.wavelet_variance.rate)
    band = TIMES[0], max(longest, LEAST_AVERAGING_RATIO * TIMES[0])
    state = cached(axis.fit, "one state", band, lambda: fit_states([Curve.of(axis.fit, *band)], 1, *band)[0])
    if axis.K.upper or not state.sigma or state.white <= 0:
        return ""
    # Short, because a file has few lines of comment; the units are those of the file.
    return f" or N {state.white:.3g}, σ {state.sigma[0]:.2g}, T {state.time[0]:.2g} s ({axis.axis})"


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{number:.2f}" for number in numbers)
