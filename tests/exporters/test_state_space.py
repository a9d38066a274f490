"""The matrices that are written have the wavelet variance of the model, in steps and in continuous time."""

import subprocess
import sys

import numpy as np
import pytest

from gmwm.continuous_statespace import ContinuousStateSpace
from gmwm.statespace import StateSpace


def loaded(text):
    names = {}
    exec(compile(text, "noise.py", "exec"), names)
    return names


def test_the_file_has_the_wavelet_variance_of_the_fit(unit):
    _, calibration = unit
    names = loaded(calibration.export(format="state-space"))
    for axis, fit in calibration.items():
        found = names["matrices"](axis)
        space = StateSpace(**found, diffuse=names["AXES"][axis]["diffuse"])
        wv = fit.wavelet_variance
        levels = wv.levels[:12]
        assert space.haar_variance(levels) == pytest.approx(fit.implied[:12], rel=1e-8)


def test_the_continuous_matrices_of_the_file_have_the_steps_of_the_discrete_ones(units):
    axes = loaded(units["gauss-markov"].export(format="state-space"))["AXES"]
    for one in axes.values():
        steps = ContinuousStateSpace(one["A"], one["Qc"], one["H_c"], one["Rc"]).discrete(one["rate"])
        for name in ("F", "Q", "H", "R"):
            np.testing.assert_allclose(getattr(steps, name), one[name], rtol=1e-12)


def test_axes_join_to_one_system(units):
    names = loaded(units["gauss-markov"].export(format="state-space"))
    whole = names["unit"]()
    one_by_one = [names["matrices"](axis) for axis in names["AXES"]]
    assert whole["F"].shape == (7, 7)
    assert whole["H"].shape == (6, 7)
    assert np.array_equal(whole["H"].sum(axis=1), np.ones(6) + np.eye(6)[1])
    assert np.array_equal(np.diag(whole["R"]), [one["R"][0, 0] for one in one_by_one])
    assert whole["m0"].shape == (7,)
    assert names["unit"](["gyro_y"])["F"].shape == (2, 2)


def test_its_simulation_has_the_right_size(units):
    names = loaded(units["quantized"].export(format="state-space"))
    drawn = names["simulate"]("accel_x", 20_000, seed=1)
    # 2Q² + σ²; four standard errors of differences that are correlated.
    assert np.var(np.diff(drawn)) == pytest.approx(6 * 1e-5 + 2 * 2e-5, rel=0.06)


@pytest.mark.slow
def test_it_runs_with_numpy_alone(units, tmp_path):
    path = tmp_path / "noise.py"
    units["no-walk"].export(path, format="state-space")
    command = [sys.executable, "-c", f"import runpy, sys; runpy.run_path({str(path)!r}, run_name='__main__'); "
               "assert 'gmwm' not in sys.modules and 'scipy' not in sys.modules"]  # fmt: skip
    printed = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert printed.splitlines()[0] == "6 axes, 1 states in all"
    assert len(printed.splitlines()) == 7
