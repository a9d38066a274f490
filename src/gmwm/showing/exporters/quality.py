"""How well a filter with N and K of a file predicts, and how true its stated error is."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gmwm.choosing.datasheets.filter_numbers import samples_in, smallest_error
from gmwm.choosing.datasheets.misfit import curve_ratio
from gmwm.choosing.datasheets.prediction import FilterGain, Forecast
from gmwm.showing.exporters.reduction import NAMES, AxisNoise, SensorNoise

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
    error = Forecast.of(processes, rate, samples, lines=False).error(gain)[0]
    ratio = curve_ratio(axis.fit)
    real = Forecast.of(processes, rate, samples, ratio).error(gain)[0]
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
                f"{NAMES[sensor.quantity].capitalize()}: N and K hold for predictions of up to {true[-1]:g} s; for "
                "longer ones, set the horizon to their length."
            )
        large = large or losses[-1] > LARGE_LOSS
    return [*lines, "Filters with Gauss-Markov states (format state-space) predict better."] if large else lines


def _listed(numbers: Iterable[float]) -> str:
    return ", ".join(f"{number:.2f}" for number in numbers)
