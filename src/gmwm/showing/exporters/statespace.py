"""Export of the state-space matrices of the full model, and of N and K, for NumPy, MATLAB, C++ and other programs."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from gmwm.base.documents import indented_json
from gmwm.base.errors import MissingTheoryError
from gmwm.base.lazy import once_per_result
from gmwm.base.remarks import Remark
from gmwm.calibration import Calibration
from gmwm.fitting.estimation.result import Fit
from gmwm.showing.exporters.base import Exporter, ExportOptions, Noise, TwoNumbers, register, top
from gmwm.showing.exporters.quality import of_ramps
from gmwm.showing.exporters.reduction import Number
from gmwm.showing.exporters.text import cautions, commented, paragraphs, plain, recording, written
from gmwm.showing.exporters.two_states import STATES, TwoStates, is_ramp_of, two_states
from gmwm.theory.processes.ladder import approximation_remarks
from gmwm.theory.processes.model import Model


def has_matrices(model: Model, rate: float) -> bool:
    """Return whether every term of a model has a state-space form."""
    try:
        model.state_space(rate)
    except MissingTheoryError:
        return False
    return True


def rows(matrix: Iterable[Iterable[float]]) -> list[list[float]]:
    """Return a matrix as a list of rows, with full precision."""
    return np.asarray(matrix, dtype=np.float64).tolist()  # type: ignore[no-any-return]


_MEANING = (
    "Discrete, in steps of one sample at the rate of the axis: x[t+1] = F x[t] + w, Var w = Q; y[t] = H x[t] + v, Var "
    "v = R. x[0] has the mean m0 and the covariance P0. States marked in diffuse have no stationary distribution: "
    "start a filter with a large variance of these states.",
    "Continuous: dx/dt = A x + w, w white with density Qc; y = H_c x + v, v white with density Rc. Over a step of dt, "
    "F = expm(A dt), and v has the variance Rc/dt. The terms in left_out, such as quantization noise, exist only in "
    "discrete time.",
    "Units: u is rad/s for gyroscopes and m/s² for accelerometers. F and H have no unit; Q, R and P0 u² (a state of "
    "slope: u per sample); A 1/s, Qc u²/s, Rc u²/Hz. y is the noise of the sensor, to be added to the true signal.",
    "Axes: each by itself. Inflation: none. Horizon: none, the model is complete. The values are the estimates; terms "
    "with an estimate of zero have the value zero.",
    "two_states: for filters that can hold two states for each axis. White noise and the two Gauss-Markov states that "
    "are nearest to the Allan deviation of the model, without its sinusoids and ramps, from the horizon to the "
    "duration, by least squares of the logarithm. An axis with at most two states of slow noise "
    "has no two_states.",
)
_CODE = '''

def matrices(axis, two_states=False):
    """The matrices of one axis as arrays, of the model or of the two states that are nearest to it."""
    one = AXES[axis]
    one = (two_states and one["two_states"]) or one
    p = len(one["states"])
    shapes = {"F": (p, p), "Q": (p, p), "H": (1, p), "R": (1, 1), "m0": (p,), "P0": (p, p)}
    return {name: np.array(one[name], dtype=float).reshape(shape) for name, shape in shapes.items()}


def unit(axes=None, two_states=False):
    """The matrices of several axes as one block-diagonal system, all axes by default."""
    chosen = [matrices(axis, two_states) for axis in (AXES if axes is None else axes)]
    joined = {name: _joined([one[name] for one in chosen]) for name in ("F", "Q", "H", "R", "P0")}
    return {**joined, "m0": np.concatenate([one["m0"] for one in chosen])}


def _joined(blocks):
    out = np.zeros([sum(block.shape[k] for block in blocks) for k in (0, 1)])
    row = column = 0
    for block in blocks:
        out[row : row + block.shape[0], column : column + block.shape[1]] = block
        row, column = row + block.shape[0], column + block.shape[1]
    return out


def simulate(axis, samples, seed):
    """Noise of one axis, Gaussian, in the unit of the sensor."""
    rng, one = np.random.default_rng(seed), matrices(axis)
    root, states = _root(one["Q"]), len(one["m0"])
    x = one["m0"] + _root(one["P0"]) @ rng.standard_normal(states)
    y = np.sqrt(one["R"][0, 0]) * rng.standard_normal(samples)
    for t in range(samples):
        y[t] += one["H"][0] @ x
        x = one["F"] @ x + root @ rng.standard_normal(states)
    return y


def _root(covariance):
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


if __name__ == "__main__":
    whole = unit()
    print(f"{len(AXES)} axes, {whole['F'].shape[0]} states in all")
    for axis in AXES:
        print(f"{axis}: {len(AXES[axis]['states'])} states, standard deviation {simulate(axis, 1000, 1).std():.3e}")
'''


class StateSpaces(Exporter):
    """Base class of formats with the discrete- and continuous-time state-space matrices of each axis."""

    takes = frozenset({"rate", "horizon", "duration"})

    def head(self, calibration: Calibration, options: ExportOptions) -> list[str]:
        """Return the paragraphs of the head of the file."""
        step = (
            "Steps: of one sample of the recording."
            if options.rate is None
            else f"Steps: of 1/{options.rate:g} s, from the matrices in continuous time. Terms in left_out are missing."
        )
        reduced = [_reduced_text(axis, fit, options) for axis, fit in calibration.items()]
        notes = paragraphs(self.remarks(calibration, options))
        return [*top(self, calibration), recording(calibration), *_MEANING, step, *filter(None, reduced), *notes]

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return cautions of the calibration, and remarks on rate ramps and on approximated terms."""
        states = (
            remark
            for axis, fit in calibration.items()
            for remark in approximation_remarks(fit.model, fit.wavelet_variance.rate, axis)
        )
        return (*cautions(calibration), *of_ramps(calibration), *states)


@register
class StateSpaceFile(StateSpaces):
    """Python file with the matrices of each axis, and with functions that combine and simulate them."""

    name = "state-space"
    title = "NumPy (state-space matrices of the full model, as a Python file)"
    extension = ".py"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of a Python file."""
        axes = {plain(axis): axis_matrices(axis, calibration, options) for axis in calibration}
        table = _literal(axes)
        head = commented(self.head(calibration, options), "#")
        return "\n".join([*head, "", "import numpy as np", "", f"AXES = {table}", _CODE])


@register
class StateSpaceJson(StateSpaces):
    """JSON file with the matrices of each axis."""

    name = "state-space-json"
    title = "other programs (state-space matrices of the full model, as JSON)"
    extension = ".json"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of a JSON document. The head is a list under the key "gmwm"."""
        axes = {plain(axis): axis_matrices(axis, calibration, options) for axis in calibration}
        head = [line[2:].strip() for line in commented(self.head(calibration, options), "#")]
        return indented_json({"axes": axes, "gmwm": head}, escaped=True) + "\n"


@register
class StateSpaceMatlab(StateSpaces):
    """MATLAB or Octave file that creates a structure with the matrices of each axis."""

    name = "state-space-matlab"
    title = "MATLAB and Octave (state-space matrices of the full model)"
    extension = ".m"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of a file with assignments to noise.AXIS.MATRIX."""
        lines = [*commented(self.head(calibration, options), "%"), "", "noise = struct();"]
        for axis in calibration:
            one = axis_matrices(axis, calibration, options)
            lines.append("")
            for name, system in _systems(f"noise.{_identifier(axis)}", ".", one):
                lines += [f"{name}.model = '{system['model']}';", f"{name}.rate = {system['rate']!r};"]
                lines += [f"{name}.{key} = {_matlab(system[key])};" for key in MATRICES]
                lines.append(f"{name}.diffuse = {_matlab([system['diffuse']])} == 1;")
        return "\n".join(lines) + "\n"


@register
class StateSpaceCpp(StateSpaces):
    """C++ header with the matrices of each axis as Eigen matrices."""

    name = "state-space-cpp"
    title = "C++ with Eigen (state-space matrices of the full model, as a header)"
    extension = ".hpp"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of a header with a function for each axis."""
        lines = [
            *commented(self.head(calibration, options), "//"), "", "#pragma once", "", "#include <Eigen/Dense>", "",
            "namespace gmwm_noise {", "", "struct StateSpace {", "  double rate;  // Hz",
            "  Eigen::MatrixXd F, Q, H, R, m0, P0;  // discrete; m0 is a column",
            "  Eigen::MatrixXd A, Qc, H_c, Rc;  // continuous", "};",
        ]  # fmt: skip
        for axis in calibration:
            for name, one in _systems(_identifier(axis), "_", axis_matrices(axis, calibration, options)):
                lines += ["", f"// {one['model']}", f"inline StateSpace {name}() {{", "  StateSpace s;"]
                lines.append(f"  s.rate = {float(one['rate'])!r};")
                for key in MATRICES:
                    matrix = _matrix(one[key])
                    width = len(matrix[0]) if matrix else 0
                    lines.append(f"  s.{key}.resize({len(matrix)}, {width});")
                    if width:
                        lines.append(f"  s.{key} << {', '.join(repr(float(x)) for row in matrix for x in row)};")
                lines += ["  return s;", "}"]
        return "\n".join([*lines, "", "}  // namespace gmwm_noise"]) + "\n"


MATRICES = ("F", "Q", "H", "R", "m0", "P0", "A", "Qc", "H_c", "Rc")
"""Names of the matrices of an axis, in the order in which files list them."""


def _literal(value: Any, indent: int = 0) -> str:
    """Return numbers, strings, lists and dicts as Python code, with what does not fit in a line on several lines."""
    text, between = repr(value), ",\n" + (indent + 1) * " "
    if len(text) + indent < 110 or not isinstance(value, dict | list):
        return text
    if isinstance(value, dict):
        items = [f"{key!r}: {_literal(item, indent + 3 + len(repr(key)))}" for key, item in value.items()]
        return "{" + between.join(items) + "}"
    return "[" + between.join(_literal(item, indent + 1) for item in value) + "]"


def _matrix(value: Any) -> list[list[float]]:
    """Return a matrix unchanged, or a vector as a matrix with one column."""
    return [[x] for x in value] if value and not isinstance(value[0], list) else value


def _matlab(value: Any) -> str:
    """Return a matrix as MATLAB code, with full precision."""
    matrix = _matrix(value)
    if not any(matrix):
        return f"zeros({len(matrix)}, 0)"
    return f"[{'; '.join(' '.join(repr(float(x)) for x in row) for row in matrix)}]"


def _identifier(axis: str) -> str:
    """Return the name of an axis as a valid identifier for MATLAB and C++.

    >>> _identifier("gyro x[2]")
    'gyro_x_2_'
    """
    name = re.sub(r"[^A-Za-z0-9_]", "_", axis)
    return name if name[:1].isalpha() else f"axis_{name}"


def axis_matrices(axis: str, calibration: Calibration, options: ExportOptions) -> dict[str, Any]:
    """Return an axis's state-space matrices, and those of two states, at the rate of the options or recording."""
    fit, key = calibration[axis], (options.rate, options.horizon, options.duration)
    try:
        return once_per_result(fit, "matrices", key, lambda: _axis_matrices(fit, options))
    except MissingTheoryError as error:
        raise error.at(axis) from error


def _axis_matrices(fit: Fit, options: ExportOptions) -> dict[str, Any]:
    whole = _matrices(fit.model, fit, options.rate)
    reduced = _reduced(fit, options)
    if reduced is None:
        return {**whole, "two_states": None}
    matrices = _matrices(reduced.model(fit.wavelet_variance.rate), fit, options.rate)
    facts = asdict(reduced)
    return {**whole, "two_states": {**facts, **matrices}}


def _reduced(fit: Fit, options: ExportOptions) -> TwoStates | None:
    """Return the reduction of a model to two states, or None if the model has at most two slow states."""
    rate = fit.wavelet_variance.rate
    slow = {
        term
        for term, process in fit.model.by_term.items()
        if process.scale > 0 and process.line(rate) is None and not is_ramp_of(process, rate)
        and ((time := process.correlation_time(rate)) is None or time >= options.horizon)
    }  # fmt: skip
    if sum(term in slow for term in fit.model.state_terms(rate)) <= STATES:
        return None
    return two_states(fit, options.horizon, options.duration)


def _reduced_text(axis: str, fit: Fit, options: ExportOptions) -> str:
    """Describe the reduction of an axis to two states, or return "" if there is none."""
    try:
        reduced = _reduced(fit, options)
    except MissingTheoryError as error:
        raise error.at(axis) from error
    return "" if reduced is None else f"two_states of {axis}: {reduced.text(fit.wavelet_variance.unit)}."


def _systems(name: str, mark: str, axis: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield a name and the matrices of the model of an axis and, if it exists, of its reduction to two states."""
    yield name, axis
    if axis["two_states"] is not None:
        yield f"{name}{mark}two_states", axis["two_states"]


def _matrices(model: Model, fit: Fit, rate: float | None) -> dict[str, Any]:
    """Return a noise model of an axis with its state-space matrices, as numbers, lists and strings."""
    own = fit.wavelet_variance.rate
    space, smooth = model.state_space(own), model.continuous(own)
    states = list(model.state_terms(own))
    if rate is not None and rate != own:
        space, states = smooth.discrete(rate), list(smooth.terms)
    return {
        "model": plain(str(model)), "unit": plain(fit.wavelet_variance.unit), "rate": own if rate is None else rate,
        "states": states, "F": rows(space.F), "Q": rows(space.Q), "H": rows(space.H), "R": rows(space.R),
        "m0": space.m0.tolist(), "P0": rows(space.P0), "diffuse": space.diffuse.tolist(), "A": rows(smooth.A),
        "Qc": rows(smooth.Qc), "H_c": rows(smooth.H), "Rc": rows(smooth.Rc), "left_out": list(smooth.left_out),
    }  # fmt: skip


_FLICKER = "BiasInstability"
_LASTING = 100.0
"""Time lag (s) up to which the filter of imuSensor produces flicker noise in an exported file. The head states it."""


@register
class Matlab(TwoNumbers):
    """MATLAB's imuSensor with N, K and flicker noise of each axis.

    With the NoiseType "single-sided", a sample has NoiseDensity √f and a step of the walk RandomWalk/√f, which are N
    and K; the default "double-sided" uses f/2. BiasInstability B drives a filter: flicker noise of density B²/(2π|f|)
    up to as many lags as it has poles (default: one), then white noise.

    Source: reference pages of imuSensor, gyroparams, accelparams and fractalcoef, and the simulator's code."""

    name = "matlab"
    title = "MATLAB (imuSensor with gyroparams and accelparams)"
    extension = ".m"
    comment = "%"
    default_axes = "each"
    both = False
    per_axis = True
    flicker = _FLICKER
    meaning = (
        "Units: continuous-time densities, one-sigma. NoiseDensity (rad/s)/√Hz and (m/s²)/√Hz; RandomWalk is the rate "
        "and acceleration random walk K in (rad/s)/√s and (m/s²)/√s, which MATLAB writes as (rad/s)√Hz and (m/s²)√Hz.",
        "NoiseType is single-sided, so that a sample has the standard deviation N √f. With MATLAB's default, "
        "double-sided, it is smaller by √2, and the random walk is larger by √2.",
    )

    def advice(self, noise: Noise) -> tuple[str, ...]:
        """Return sentences on BiasInstability."""
        if not _has_flicker(noise):
            return ("BiasInstability stays 0: it is another process in addition to N and K, which describe all noise.",)
        return (
            "BiasInstability is the coefficient B of the flicker noise in rad/s and m/s². N and K do not include it. "
            f"Its filter produces flicker noise up to a time lag of as many samples as it has poles, here {_LASTING:g} "
            "s: increase poles for longer simulations. fractalcoef needs R2023b or later.",
        )

    def body(self, noise: Noise) -> Sequence[str]:
        """Return MATLAB code with one call for each sensor."""
        lines = [f"poles = {math.ceil(_LASTING * noise.rate)};"] if _has_flicker(noise) else []
        for sensor, maker in ((noise.gyro, "gyro"), (noise.accel, "accel")):
            if sensor is not None:
                lines += [
                    f"{maker} = {maker}params( ...", f"    'NoiseDensity', {_row(sensor.N)}, ...",
                    f"    'RandomWalk', {_row(sensor.K)}, ...",
                ]  # fmt: skip
                if _has_flicker(noise):
                    lines += [
                        f"    '{_FLICKER}', {_row(sensor.B)}, ...",
                        f"    '{_FLICKER}Coefficients', fractalcoef(poles, 1), ...",
                    ]
                lines.append("    'NoiseType', 'single-sided');")
        if len(noise.sensors) == 2:
            lines.append(
                f"imu = imuSensor('accel-gyro', 'SampleRate', {noise.written_rate}, "
                "'Gyroscope', gyro, 'Accelerometer', accel);"
            )
        return lines


def _has_flicker(noise: Noise) -> bool:
    return any(number.value > 0 for sensor in noise.sensors for number in sensor.B)


def _row(numbers: Sequence[Number]) -> str:
    return f"[{' '.join(written(number) for number in numbers)}]"
