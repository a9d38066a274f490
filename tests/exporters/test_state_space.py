"""The matrices that are written have the wavelet variance of the model, in steps and in continuous time."""

import subprocess
import sys

import numpy as np
import pytest
from scipy.linalg import expm

from gmwm.exporters import export
from gmwm.exporters.matrices import continuous, discrete
from gmwm.processes import parse_model
from gmwm.statespace import StateSpace

MODELS = (
    "WN(sigma2=4e-7)",
    "GM(beta=0.1, sigma2=2e-8) + RW(gamma2=1e-11) + WN(sigma2=6e-7)",
    "2*GM(beta=3.0, sigma2=1e-8) + DR(omega=-1e-9)".replace("2*GM", "GM(beta=1e-3, sigma2=1e-8) + GM"),
    "AR1(phi=0.9, sigma2=1e-8) + WN(sigma2=6e-7)",
    "QN(q2=3e-7) + WN(sigma2=6e-7) + GM(beta=50.0, sigma2=0.0)",
)


def loaded(text):
    names = {}
    exec(compile(text, "noise.py", "exec"), names)
    return names


def test_the_file_has_the_wavelet_variance_of_the_fit(unit):
    _, calibration = unit
    names = loaded(export(calibration, format="state-space"))
    for axis, fit in calibration.items():
        found = names["matrices"](axis)
        space = StateSpace(**found, diffuse=names["AXES"][axis]["diffuse"])
        wv = fit.wavelet_variance
        levels = wv.levels[:12]
        assert space.haar_variance(levels) == pytest.approx(fit.implied[:12], rel=1e-8)


def test_axes_join_to_one_system(units):
    names = loaded(export(units["gauss-markov"], format="state-space"))
    whole = names["unit"]()
    one_by_one = [names["matrices"](axis) for axis in names["AXES"]]
    assert whole["F"].shape == (7, 7)
    assert whole["H"].shape == (6, 7)
    assert np.array_equal(whole["H"].sum(axis=1), np.ones(6) + np.eye(6)[1])
    assert np.array_equal(np.diag(whole["R"]), [one["R"][0, 0] for one in one_by_one])
    assert whole["m0"].shape == (7,)
    assert names["unit"](["gyro_y"])["F"].shape == (2, 2)


def test_its_simulation_has_the_right_size(units):
    names = loaded(export(units["quantized"], format="state-space"))
    drawn = names["simulate"]("accel_x", 20_000, seed=1)
    # 2Q² + σ²; four standard errors of differences that are correlated.
    assert np.var(np.diff(drawn)) == pytest.approx(6 * 1e-5 + 2 * 2e-5, rel=0.06)


def test_it_runs_with_numpy_alone(units, tmp_path):
    path = tmp_path / "noise.py"
    export(units["no-walk"], path, format="state-space")
    command = [sys.executable, "-c", f"import runpy, sys; runpy.run_path({str(path)!r}, run_name='__main__'); "
               "assert 'gmwm' not in sys.modules and 'scipy' not in sys.modules"]  # fmt: skip
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert printed.splitlines()[0] == "6 axes, 1 states in all"
    assert len(printed.splitlines()) == 7


@pytest.mark.parametrize("text", MODELS)
@pytest.mark.parametrize("rate", [10.0, 400.0])
def test_continuous_systems_have_the_steps_of_the_discrete_ones(text, rate):
    model = parse_model(text)
    space, labels = discrete(model, rate)
    found = continuous(model, rate)
    kept = [k for k, label in enumerate(labels) if label not in found.left_out]
    p = len(kept)
    assert found.A.shape == (p, p)
    # Van Loan: the exponential of [[−A, Qc], [0, Aᵀ]] Δt has F⁻¹Q and Fᵀ in its right half.
    whole = expm(np.block([[-found.A, found.Qc], [np.zeros((p, p)), found.A.T]]) / rate)
    step = whole[p:, p:].T
    scale = np.sqrt(np.maximum(np.diag(space.Q)[kept], 1e-30))
    assert step == pytest.approx(space.F[np.ix_(kept, kept)], rel=1e-9, abs=1e-12)
    assert (step @ whole[:p, p:]) / np.outer(scale, scale) == pytest.approx(
        space.Q[np.ix_(kept, kept)] / np.outer(scale, scale), rel=1e-6, abs=1e-9
    )
    assert found.Rc[0, 0] * rate == pytest.approx(space.R[0, 0], rel=1e-12)
    assert np.array_equal(found.H[0], space.H[0, kept])


def test_steps_without_a_continuous_form_are_left_out_and_named():
    found = continuous(parse_model("QN(q2=1e-7) + AR1(phi=-0.5, sigma2=1e-7) + WN(sigma2=1e-6)"), 100.0)
    assert found.left_out == ("QN", "AR1")
    assert found.A.size == 0
