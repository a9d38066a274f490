"""Exports for programs with white noise and one Gauss-Markov bias: gnss-ins-sim, NaveGo, KF-GINS and Gazebo."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from gmwm.base.text import duration_text
from gmwm.base.units import STANDARD_GRAVITY
from gmwm.showing.exporters.base import Noise, TwoNumbers, register
from gmwm.showing.exporters.one_state import TIMES, Bias, biases
from gmwm.showing.exporters.quality import range_text
from gmwm.showing.exporters.reduction import Number, SensorNoise, ruled, three
from gmwm.showing.exporters.text import commented, commented_notes, row_mark, shortened, unended, written
from gmwm.showing.exporters.two_states import longest_averaging


class GaussMarkov(TwoNumbers):
    """Base of formats with N and a Gauss-Markov bias of σ and T; `common` if the program has one T for all axes."""

    takes = frozenset({"axes", "inflation", "horizon", "duration", "rate"})
    per_axis = True
    common: ClassVar[bool] = False

    def biases(self, noise: Noise) -> Mapping[str, Bias]:
        """Return the Gauss-Markov bias of each axis for the options of the file."""
        axes = [axis for sensor in noise.sensors for axis in sensor.axes]
        return biases(axes, noise.options.horizon, noise.options.duration, common=self.common)

    def predictions(self, noise: Noise) -> list[str]:
        """Return sentences on how well N, σ and T describe the models."""
        fits, found = [axis.fit for sensor in noise.sensors for axis in sensor.axes], self.biases(noise).items()
        high = longest_averaging(fits, noise.options.horizon, noise.options.duration)
        text = "N, sigma and T are for a filter with a Gauss-Markov bias."
        if fitted := [bias for _, bias in found if bias.claims]:
            times = ", ".join(f"{time * noise.options.horizon:g}" for time in TIMES)
            ratios = ", ".join(map(range_text, zip(*(bias.claims for bias in fitted), strict=True)))
            text += f" Stated over real error of predictions over {times} s: {ratios}. Allan deviation up to "
            text += f"{duration_text(high, 3)}: within {100 * max(bias.error for bias in fitted):.2g} % of the model's."
        if ends := [axis for axis, bias in found if bias.claims and bias.time > 0.999 * high]:
            text += f" T of {', '.join(ends)} is the longest averaging time."
        if bounded := [axis for axis, bias in found if bias.sigma.upper]:
            text += f" sigma of {', '.join(bounded)} is an upper limit, and T is not measured."
        return [text]

    def of_sensor(self, sensor: SensorNoise, noise: Noise) -> tuple[tuple[Number, float], ...]:
        """Return σ (after inflation) and T for the x, y and z axes of a sensor, combined by the rule of the file."""
        rule, inflation, found = noise.options.axes, noise.options.inflation, self.biases(noise)
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

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the Python code of the dictionary."""
        lines = ["import numpy as np", "", "imu_err = {"]
        for name, walk, sensor, factor in (
            ("gyro", "arw", noise.of("gyro"), 1 / _DEGREE), ("accel", "vrw", noise.of("accel"), 1.0)
        ):  # fmt: skip
            rate = 3600 * factor if name == "gyro" else 1.0
            bias = self.of_sensor(sensor, noise)
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

    def body(self, noise: Noise) -> Sequence[str]:
        """Return MATLAB code that sets the fields of the structure."""
        lines = []
        for sensor, prefix, density, walk, factor, unit in (
            (noise.of("gyro"), "gb", "arw", "arrw", 1 / _DEGREE, 60 / _DEGREE),
            (noise.of("accel"), "ab", "vrw", "vrrw", 1e3 / STANDARD_GRAVITY, 60.0),
        ):
            bias = self.of_sensor(sensor, noise)
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

    The filter's driving noise has the density 2σ²/T. Source: `kf-gins.yaml`, `kf_gins.cpp` and `gi_engine.cpp`."""

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

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the entry with its five keys."""
        gyro, accel = noise.of("gyro"), noise.of("accel")
        sigmas = [[sigma for sigma, _ in self.of_sensor(sensor, noise)] for sensor in (gyro, accel)]
        states = list(self.biases(noise).values())
        measured = any(bias.claims for bias in states)
        return [
            "imunoise:", _yaml("arw", gyro.N, 60 / _DEGREE, "deg/sqrt(h)"), _yaml("vrw", accel.N, 60, "m/s/sqrt(h)"),
            _yaml("gbstd", sigmas[0], 3600 / _DEGREE, "deg/h"), _yaml("abstd", sigmas[1], 1e5, "mGal"),
            f"  corrtime: {written(states[0].time / 3600)}  # h{'' if measured else '  not measured'}",
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

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the XML element "imu" with the noise of each axis."""
        names = {"gyro": "angular_velocity", "accel": "linear_acceleration"}
        lines = [f"<!-- stddev for {noise.written_rate} Hz -->", "<imu>"]
        for sensor in noise.sensors:
            lines.append(f"  <{names[sensor.quantity]}>")
            for letter, white, (sigma, time) in zip("xyz", sensor.N, self.of_sensor(sensor, noise), strict=True):
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
