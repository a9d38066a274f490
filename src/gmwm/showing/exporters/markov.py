"""Exports for programs with white noise and one Gauss-Markov bias: gnss-ins-sim, NaveGo, KF-GINS and Gazebo."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar

from gmwm.base.lazy import once_per_result
from gmwm.base.text import duration_text
from gmwm.base.units import STANDARD_GRAVITY
from gmwm.calibration import Calibration
from gmwm.fitting.estimation.result import Fit
from gmwm.showing.exporters import two_states
from gmwm.showing.exporters.base import ExportOptions, Noise, TwoNumbers, register
from gmwm.showing.exporters.reduction import AxisNoise, Number, SensorNoise, ruled, three
from gmwm.showing.exporters.text import commented, commented_notes, row_mark, shortened, unended, written


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
    """Fit white noise and a GM bias to each axis by least squares of the log Allan variance from `low` to `high` (s),
    also limits of T; `common` gives one T. If K is an upper limit, so is σ, which has the walk K at times below T."""
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
            sigma = axis.K.scaled(math.sqrt(time / 2))
            fitted[axis.axis] = Bias(axis=axis.axis, N=axis.N, sigma=sigma, time=time, error=0.0)
    return fitted


def _alone(fit: Fit, low: float, high: float) -> two_states.States:
    """Return the white noise and the bias of one axis, which are computed once."""
    return once_per_result(fit, "bias", (low, high), lambda: _together([fit], low, high)[0])


def _together(fits: Sequence[Fit], low: float, high: float) -> list[two_states.States]:
    """Return the white noise and the bias of each axis, with one correlation time for all."""
    curves = [two_states.Curve.of(fit, low, high) for fit in fits]
    # White noise is fitted beside a bias whose correlation time may be far longer, like that of a random walk.
    # At 1e5 times the longest averaging time, it is a walk within 1e-5 (tests/importers/test_files.py).
    white = [
        once_per_result(fit, "white", (low, high), partial(_beside_walk, curve, low, high))
        for fit, curve in zip(fits, curves, strict=True)
    ]
    return two_states.fit_states(curves, 1, low, high, white=white)


def _beside_walk(curve: two_states.Curve, low: float, high: float) -> float:
    return two_states.fit_states([curve], 1, low, 1e5 * high)[0].white


@dataclass(frozen=True)
class MarkovNoise(Noise):
    """The noise parameters of a unit, with the Gauss-Markov bias of each axis."""

    biases: Mapping[str, Bias] = field(default_factory=dict)


class GaussMarkov(TwoNumbers):
    """Base of formats with N and a Gauss-Markov bias of σ and T; `common` if the program has one T for all axes."""

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
        return low, max(noise.options.duration, two_states.LEAST_AVERAGING_RATIO * low)
    lengths = [axis.fit.wavelet_variance.samples / axis.fit.wavelet_variance.rate
               for sensor in noise.sensors for axis in sensor.axes]  # fmt: skip
    return low, max(min(two_states.LONGEST_AVERAGING_S, *lengths), two_states.LEAST_AVERAGING_RATIO * low)


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


_DEGREE = math.pi / 180


@register
class GnssInsSim(GaussMarkov):
    """gnss-ins-sim's constant bias, N and Gauss-Markov bias (σ, T) of each axis. Source: `imu_model.py` and
    `pathgen.py` (`bias_drift`) of gnss-ins-sim."""

    name = "gnss-ins-sim"
    title = "gnss-ins-sim (dictionary for imu_model.IMU)"
    extension = ".py"
    default_axes = "each"
    takes = frozenset({"axes", "inflation", "horizon", "duration"})
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: continuous in time, of x, y and z. gyro_b deg/h, gyro_arw deg/√h, gyro_b_stability deg/h and "
        "gyro_b_corr s; accel_b m/s², accel_vrw m/s/√h, accel_b_stability m/s² and accel_b_corr s. b_stability and "
        "b_corr are σ and the correlation time of a Gauss-Markov process, not the bias instability of a datasheet.",
    )
    usage = ("Pass the dictionary: imu_model.IMU(accuracy=imu_err, axis=6, gps=False).",)

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the Python code of the dictionary."""
        lines = ["import numpy as np", "", "imu_err = {"]
        for name, walk, sensor, factor in (
            ("gyro", "arw", noise.of("gyro"), 1 / _DEGREE), ("accel", "vrw", noise.of("accel"), 1.0)
        ):  # fmt: skip
            rate = 3600 * factor if name == "gyro" else 1.0
            bias = of_sensor(sensor, found, noise)
            sigmas = [sigma for sigma, _ in bias]
            lines += [
                _python(f"{name}_b", [Number(rate * x, False) for x in three(noise.rest, sensor.quantity)], ""),
                _python(f"{name}_{walk}", [n.scaled(60 * factor) for n in sensor.N], row_mark(sensor.N)),
                _python(f"{name}_b_stability", [sigma.scaled(rate) for sigma in sigmas], row_mark(sigmas)),
                _python(f"{name}_b_corr", [Number(time, False) for _, time in bias], ""),
            ]
        return [*lines, "}"]


def _python(key: str, numbers: Sequence[Number], mark: str) -> str:
    comment = f"  #{mark[1:]}" if mark else ""
    return f"    '{key}': np.array([{', '.join(map(written, numbers))}]),{comment}"


@register
class NaveGo(GaussMarkov):
    """NaveGo's N, range of the constant bias, and Gauss-Markov bias (σ, T) of each axis. Source: `imu_si_errors.m`,
    `noise_b_sta.m` and `noise_b_dyn.m` of NaveGo, and its examples."""

    name = "navego"
    title = "NaveGo (structure for imu_si_errors)"
    extension = ".m"
    comment = "%"
    default_axes = "each"
    biases_of = ("gyro", "accel")
    meaning = (
        "Units: continuous in time, of x, y and z. arw deg/√h, vrw m/s/√h; gb_sta deg/s and ab_sta mg are sizes of the "
        "bias at rest: NaveGo draws a bias between minus and plus this size. gb_dyn deg/s and ab_dyn mg are the "
        "standard deviations of Gauss-Markov biases with the correlation times gb_corr and ab_corr in s, not the bias "
        "instability of a datasheet. arrw and vrrw are zero, because these biases include the random walk.",
    )
    usage = ("Convert to SI units: imu1 = imu_si_errors(imu, 1/imu.freq). Magnetometers: add m_psd of your file.",)

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return MATLAB code that sets the fields of the structure."""
        lines = []
        for sensor, prefix, density, walk, factor, unit in (
            (noise.of("gyro"), "gb", "arw", "arrw", 1 / _DEGREE, 60 / _DEGREE),
            (noise.of("accel"), "ab", "vrw", "vrrw", 1e3 / STANDARD_GRAVITY, 60.0),
        ):
            bias = of_sensor(sensor, found, noise)
            sigmas = [sigma for sigma, _ in bias]
            lines += [
                _matlab(density, [number.scaled(unit) for number in sensor.N], row_mark(sensor.N)),
                f"imu.{walk} = zeros(1, 3);",
                _matlab(
                    f"{prefix}_sta", [Number(factor * abs(x), False) for x in three(noise.rest, sensor.quantity)], ""
                ),
                _matlab(f"{prefix}_dyn", [sigma.scaled(factor) for sigma in sigmas], row_mark(sigmas)),
                _matlab(f"{prefix}_corr", [Number(time, False) for _, time in bias], ""),
            ]
        return [*lines, f"imu.freq = {noise.written_rate};"]


def _matlab(key: str, numbers: Sequence[Number], mark: str) -> str:
    comment = f"  %{mark[1:]}" if mark else ""
    return f"imu.{key} = [{' '.join(map(written, numbers))}];{comment}"


@register
class KfGins(GaussMarkov):
    """KF-GINS's N and Gauss-Markov bias σ of each axis, with one correlation time T.

    The filter's driving noise has the density 2σ²/T. A single slow Gauss-Markov term gives σ and T. Source:
    `dataset/kf-gins.yaml`, `kf_gins.cpp` and `gi_engine.cpp` of KF-GINS."""

    name = "kfgins"
    title = "KF-GINS (kf-gins.yaml)"
    extension = ".yaml"
    common = True
    default_axes = "each"
    takes = frozenset({"axes", "inflation", "horizon", "duration"})
    meaning = (
        "Units: continuous in time. arw deg/√h, vrw m/s/√h; gbstd deg/h and abstd mGal are the standard deviations of "
        "Gauss-Markov biases with the correlation time corrtime in h, one for all axes.",
    )
    usage = ("Keep gsstd and asstd of your file: a recording at rest does not show scale factors.",)

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the entry with its five keys."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        sigmas = [[sigma for sigma, _ in of_sensor(sensor, found, noise)] for sensor in (gyro, accel)]
        time = next(iter(found.values())).time
        measured = not all(bias.sigma.upper for bias in found.values())
        return [
            "imunoise:", _yaml("arw", gyro.N, 60 / _DEGREE, "deg/sqrt(h)"), _yaml("vrw", accel.N, 60, "m/s/sqrt(h)"),
            _yaml("gbstd", sigmas[0], 3600 / _DEGREE, "deg/h"), _yaml("abstd", sigmas[1], 1e5, "mGal"),
            f"  corrtime: {written(time / 3600)}  # h{'' if measured else '  not measured'}",
        ]  # fmt: skip


def _yaml(key: str, numbers: Sequence[Number], factor: float, unit: str) -> str:
    shown = ", ".join(written(number.scaled(factor)) for number in numbers)
    return f"  {key}: [{shown}]  # {unit}{row_mark(numbers)}"


@register
class Gazebo(GaussMarkov):
    """Gazebo's standard deviation N√f of a sample at rate f, and a Gauss-Markov bias with driving noise q = σ√(2/T).

    A step is b ← e^(−Δt/T) b + w with Var w = q² T (1 − e^(−2Δt/T))/2. Source: SDFormat's description of noise, and
    `GaussianNoiseModel.cc` of Gazebo."""

    name = "gazebo"
    title = "Gazebo (SDF)"
    extension = ".sdf"
    comment = ""
    default_axes = "each"
    both = False
    meaning = (
        "Units: stddev is discrete, the standard deviation of a sample, N √f: rad/s and m/s². dynamic_bias_stddev is "
        "continuous, the driving noise of a Gauss-Markov bias: rad/s/√s and m/s²/√s; "
        "dynamic_bias_correlation_time s.",
    )
    usage = ("Put this element into <sensor type='imu'>. Its update_rate must be the rate of stddev.",)

    def layout(self, head: Sequence[str], noise: Noise, notes: Sequence[str]) -> str:
        """Return the text of the file, with the head and the notes as XML comments."""
        above, below = commented(shortened(head), ""), commented_notes(notes, "")
        return "\n".join([*_comment(above), *self.body(noise), *_comment(below)]) + "\n"

    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the XML element "imu" with the noise of each axis."""
        names = {"gyro": "angular_velocity", "accel": "linear_acceleration"}
        lines = [f"<!-- stddev for {noise.written_rate} Hz -->", "<imu>"]
        for sensor in noise.sensors:
            lines.append(f"  <{names[sensor.quantity]}>")
            for letter, white, (sigma, time) in zip("xyz", sensor.N, of_sensor(sensor, found, noise), strict=True):
                lines += _axis(letter, white.scaled(math.sqrt(noise.rate)), sigma.scaled(math.sqrt(2 / time)), time)
            lines.append(f"  </{names[sensor.quantity]}>")
        return [*lines, "</imu>"]


def _comment(lines: Sequence[str]) -> list[str]:
    return ["<!--", *(f"  {unended(line.strip())}" for line in lines), "-->"]


def _axis(letter: str, stddev: Number, drive: Number, time: float) -> list[str]:
    upper = [key for key, number in (("stddev", stddev), ("dynamic_bias_stddev", drive)) if number.upper]
    return [
        f"    <{letter}>", '      <noise type="gaussian">',
        *([f"        <!-- upper limit: {', '.join(upper)} -->"] if upper else []), "        <mean>0.0</mean>",
        f"        <stddev>{written(stddev)}</stddev>",
        f"        <dynamic_bias_stddev>{written(drive)}</dynamic_bias_stddev>",
        f"        <dynamic_bias_correlation_time>{written(time)}</dynamic_bias_correlation_time>", "      </noise>",
        f"    </{letter}>",
    ]  # fmt: skip
