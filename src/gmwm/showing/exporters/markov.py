"""Approximate the noise of an axis by white noise and one Gauss-Markov bias, for programs with this model."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, ClassVar

from gmwm.base.text import duration_text
from gmwm.showing.exporters.base import ExportOptions, Noise, TwoNumbers
from gmwm.showing.exporters.reduction import AxisNoise, Number, SensorNoise, ruled
from gmwm.showing.exporters.two_states import (
    LEAST_AVERAGING_RATIO,
    LONGEST_AVERAGING_S,
    Curve,
    States,
    cached,
    fit_states,
)

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.fitting.estimation.result import Fit


@dataclass(frozen=True)
class Bias:
    """White noise and Gauss-Markov bias of one axis."""

    axis: str  # name of the axis
    # white noise and standard deviation of the bias (SI), before inflation
    N: Number
    sigma: Number
    time: float  # correlation time (s)
    error: float  # largest relative difference to the Allan deviation of the model

    @property
    def walk(self) -> Number:
        """Random walk K = σ √(2/T) (SI), which describes the bias at times far below the correlation time."""
        return self.sigma.scaled(math.sqrt(2 / self.time))


def biases(axes: Sequence[AxisNoise], low: float, high: float, *, common: bool) -> dict[str, Bias]:
    """Fit white noise and a Gauss-Markov bias to each axis by least squares on the logarithm of the Allan variance,
    from `low` to `high` (s), which are also the limits of the correlation time. If `common`, all axes have one
    correlation time. If K of an axis is an upper limit, so is σ: the RMS of this random walk over the longest averaging
    time."""
    slow = [axis for axis in axes if not axis.K.upper and axis.K.value > 0]
    groups = [slow] if common and slow else [[axis] for axis in slow]
    fitted: dict[str, Bias] = {}
    for group in groups:
        states = [_alone(group[0].fit, low, high)] if len(group) == 1 else _together([a.fit for a in group], low, high)
        fitted |= {
            axis.axis: Bias(
                axis=axis.axis, N=Number(state.white, axis.N.upper), sigma=Number(state.sigma[0], False),
                time=state.time[0], error=state.error,
            )
            for axis, state in zip(group, states, strict=True) if state.sigma
        }  # fmt: skip
    time = next(iter(fitted.values())).time if common and fitted else high
    for axis in axes:
        if axis.axis not in fitted:
            sigma = axis.K.scaled(math.sqrt(high / 6))
            fitted[axis.axis] = Bias(axis=axis.axis, N=axis.N, sigma=sigma, time=time, error=0.0)
    return fitted


def _alone(fit: Fit, low: float, high: float) -> States:
    """Return the white noise and the bias of one axis, which are computed once."""
    return cached(fit, "bias", (low, high), lambda: _together([fit], low, high)[0])


def _together(fits: Sequence[Fit], low: float, high: float) -> list[States]:
    """Return the white noise and the bias of each axis, with one correlation time for all."""
    curves = [Curve.of(fit, low, high) for fit in fits]
    # White noise is fitted beside a bias whose correlation time may be far longer, like that of a random walk.
    # At 1e5 times the longest averaging time, it is a walk within 1e-5 (tests/importers/test_files.py).
    white = [
        cached(fit, "white", (low, high), partial(_beside_walk, curve, low, high))
        for fit, curve in zip(fits, curves, strict=True)
    ]
    return fit_states(curves, 1, low, high, white=white)


def _beside_walk(curve: Curve, low: float, high: float) -> float:
    return fit_states([curve], 1, low, 1e5 * high)[0].white


@dataclass(frozen=True)
class MarkovNoise(Noise):
    """The noise parameters of a unit, with the Gauss-Markov bias of each axis."""

    biases: Mapping[str, Bias] = field(default_factory=dict)


class GaussMarkov(TwoNumbers):
    """Base class of formats with white noise N and a Gauss-Markov bias with the standard deviation σ and the
    correlation time T; `common` if the program has one T for all axes."""

    takes = frozenset({"axes", "inflation", "horizon", "duration", "rate"})
    per_axis = True
    common: ClassVar[bool] = False

    @abstractmethod
    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the lines below the head, in ASCII, for N and the bias of each axis."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines below the head."""
        return self.rows(noise, self.biases(noise))

    def biases(self, noise: Noise) -> Mapping[str, Bias]:
        """Return the Gauss-Markov bias of each axis for the options of the file."""
        assert isinstance(noise, MarkovNoise)
        return noise.biases

    def predictions(self, noise: Noise) -> list[str]:
        """Return a sentence on how well N, σ and T describe the models."""
        low, high = band(noise)
        found = self.biases(noise).values()
        fits = [f"{max(100 * bias.error, 0.01):.2g} % for {bias.axis}" for bias in found if not bias.sigma.upper]
        text = "N, sigma and T have the Allan deviation that is nearest to the model at averaging times from "
        text += f"{duration_text(low, 3)} to {duration_text(high, 3)}"
        text += f": within {', '.join(fits)}." if fits else "."
        if ends := [bias.axis for bias in found if not bias.sigma.upper and bias.time > 0.999 * high]:
            text += f" T of {', '.join(ends)} is the end of this band."
        if bounded := [bias.axis for bias in found if bias.sigma.upper]:
            text += f" sigma of {', '.join(bounded)} is an upper limit, and T is not measured."
        return [text]

    def _noise(self, calibration: Calibration, options: ExportOptions) -> Noise:
        noise = super()._noise(calibration, options)
        axes = [axis for sensor in noise.sensors for axis in sensor.axes]
        found = biases(axes, *band(noise), common=self.common)

        def with_bias(sensor: SensorNoise | None) -> SensorNoise | None:
            if sensor is None:
                return None
            each = tuple(replace(axis, N=found[axis.axis].N) for axis in sensor.axes)
            white = ruled([(axis.axis, axis.N) for axis in each], options.axes, options.inflation)
            return replace(sensor, axes=each, N=white)

        return MarkovNoise(
            with_bias(noise.gyro), with_bias(noise.accel), options, topic=noise.topic, rest=noise.rest, biases=found
        )


def band(noise: Noise) -> tuple[float, float]:
    """Return the shortest and the longest averaging time (s) of the fit."""
    low = noise.options.horizon
    if noise.options.duration is not None:
        return low, max(noise.options.duration, LEAST_AVERAGING_RATIO * low)
    lengths = [axis.fit.wavelet_variance.samples / axis.fit.wavelet_variance.rate
               for sensor in noise.sensors for axis in sensor.axes]  # fmt: skip
    return low, max(min(LONGEST_AVERAGING_S, *lengths), LEAST_AVERAGING_RATIO * low)


def of_sensor(sensor: SensorNoise, found: Mapping[str, Bias], noise: Noise) -> tuple[tuple[Number, float], ...]:
    """Return σ (after inflation) and T for the x, y and z axes of a sensor, combined by the rule of the file."""
    rule, inflation = noise.options.axes, noise.options.inflation
    if rule == "worst":
        worst = max((found[axis.axis] for axis in sensor.axes), key=lambda bias: bias.sigma.value)
        return ((worst.sigma.scaled(inflation), worst.time),) * 3
    sigmas = ruled([(axis.axis, found[axis.axis].sigma) for axis in sensor.axes], rule, inflation)
    if rule == "each":
        order = sorted(axis.axis for axis in sensor.axes)
        return tuple((sigma, found[axis].time) for sigma, axis in zip(sigmas, order, strict=True))
    longest = max(found[axis.axis].time for axis in sensor.axes)
    return tuple((sigma, longest) for sigma in sigmas)
