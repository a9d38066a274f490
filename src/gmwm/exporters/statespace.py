"""State-space matrices of the full model, as a Python file that needs only NumPy."""

from __future__ import annotations

from pprint import pformat
from typing import TYPE_CHECKING, Any

from gmwm.errors import MissingTheoryError
from gmwm.exporters.base import Exporter, ExportOptions, register, title_line
from gmwm.exporters.findings import of_ramps
from gmwm.exporters.matrices import rows
from gmwm.exporters.text import cautions, commented, paragraphs, plain, recording
from gmwm.processes.ladder import approximated
from gmwm.remarks import Remark

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

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
)
_CODE = '''

def matrices(axis):
    """The matrices of one axis as arrays."""
    one = AXES[axis]
    p = len(one["states"])
    shapes = {"F": (p, p), "Q": (p, p), "H": (1, p), "R": (1, 1), "m0": (p,), "P0": (p, p)}
    return {name: np.array(one[name], dtype=float).reshape(shape) for name, shape in shapes.items()}


def unit(axes=None):
    """The matrices of several axes as one block-diagonal system, all axes by default."""
    chosen = [matrices(axis) for axis in (AXES if axes is None else axes)]
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


@register
class StateSpaceFile(Exporter):
    """Python file with F, Q, H, R, m0, P0 and A, Qc, H_c, Rc of each axis, and code that combines and simulates
    them."""

    name = "state-space"
    title = "NumPy (state-space matrices of the full model, as a Python file)"
    extension = ".py"

    def export(self, calibration: Calibration, options: ExportOptions) -> str:
        """Return the text of a Python file."""
        first, last = paragraphs(self.remarks(calibration, options))
        head = commented([title_line(self), recording(calibration), *first, *_MEANING, *last], "#")
        axes = {plain(axis): axis_matrices(axis, calibration) for axis in calibration}
        table = pformat(axes, indent=1, width=110, sort_dicts=False)
        return "\n".join([*head, "", "import numpy as np", "", f"AXES = {table}", _CODE])

    def remarks(self, calibration: Calibration, options: ExportOptions) -> tuple[Remark, ...]:
        """Return warnings of the calibration, and remarks on its rate ramps."""
        states = (
            remark
            for axis, fit in calibration.items()
            for remark in approximated(fit.model, fit.wavelet_variance.rate, axis)
        )
        return (*cautions(calibration), *of_ramps(calibration), *states)


def axis_matrices(axis: str, calibration: Calibration) -> dict[str, Any]:
    """Return the matrices of one axis as lists, with all digits."""
    fit = calibration[axis]
    rate = fit.wavelet_variance.rate
    try:
        space, smooth = fit.model.state_space(rate), fit.model.continuous(rate)
    except MissingTheoryError as error:
        raise error.at(axis) from error
    return {
        "model": str(fit.model),
        "unit": plain(fit.wavelet_variance.unit),
        "rate": rate,
        "states": list(fit.model.state_terms(rate)),
        "F": rows(space.F),
        "Q": rows(space.Q),
        "H": rows(space.H),
        "R": rows(space.R),
        "m0": space.m0.tolist(),
        "P0": rows(space.P0),
        "diffuse": space.diffuse.tolist(),
        "A": rows(smooth.A),
        "Qc": rows(smooth.Qc),
        "H_c": rows(smooth.H),
        "Rc": rows(smooth.Rc),
        "left_out": list(smooth.left_out),
    }
