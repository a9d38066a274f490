"""The matrices that are written have the wavelet variance of the model, in steps and in continuous time."""

import json
import re
import subprocess
import sys

import numpy as np
import pytest

from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.statespace import StateSpace

from .conftest import RATE


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


def matlab(text):
    """Structures of a MATLAB file: noise.AXIS.MATRIX = [...; ...];"""
    found = {}
    code = "\n".join(line for line in text.splitlines() if not line.startswith("%"))
    for axis, key, rows in re.findall(r"^noise\.(\w+)\.(\w+) = \[([^\]]*)\];$", code, re.MULTILINE):
        found.setdefault(axis, {})[key] = np.array([[float(x) for x in row.split()] for row in rows.split(";")])
    return found


def cpp(text):
    """Functions of a C++ header: s.MATRIX.resize(rows, columns); s.MATRIX << values;"""
    found = {}
    for axis, body in re.findall(r"^inline StateSpace (\w+)\(\) \{$(.*?)^\}$", text, re.MULTILINE | re.DOTALL):
        sizes = {key: (int(a), int(b)) for key, a, b in re.findall(r"s\.(\w+)\.resize\((\d+), (\d+)\);", body)}
        values = {
            key: np.array([float(x) for x in row.split(",")]) for key, row in re.findall(r"s\.(\w+) << (.*);", body)
        }
        # Eigen's comma initializer fills by rows, and needs every element.
        found[axis] = {key: values.get(key, np.zeros(0)).reshape(size) for key, size in sizes.items()}
    return found


READ = {"state-space-matlab": matlab, "state-space-cpp": cpp,
        "state-space-json": lambda text: {a: {k: np.array(v) for k, v in one.items() if isinstance(v, list)}
                                          for a, one in json.loads(text)["axes"].items()}}  # fmt: skip


@pytest.mark.parametrize("format", READ)
@pytest.mark.parametrize("rate", [None, 50.0])
def test_other_languages_have_the_same_matrices(units, format, rate):
    for unit in (units["quantized"], units["gauss-markov"]):
        found = READ[format](unit.export(format=format, rate=rate))
        assert list(found) == list(unit)
        for axis, fit in unit.items():
            smooth = fit.model.continuous(RATE)
            space = fit.model.state_space(RATE) if rate is None else smooth.discrete(rate)
            for key in ("F", "Q", "H", "R", "P0"):
                assert np.array_equal(np.reshape(found[axis][key], getattr(space, key).shape), getattr(space, key))
            for key, wanted in (("A", smooth.A), ("Qc", smooth.Qc), ("H_c", smooth.H), ("Rc", smooth.Rc)):
                assert np.array_equal(np.reshape(found[axis][key], wanted.shape), wanted)


def test_another_rate_keeps_the_noise_of_long_times(units):
    """Ten seconds of the sum of the noise have the same variance at the rate of the recording and at a tenth of it."""
    unit = units["gauss-markov"]
    for axis, fit in unit.items():
        own = fit.model.state_space(RATE)
        at = loaded(unit.export(format="state-space", rate=20.0))["matrices"](axis)
        slow = StateSpace(**{key: at[key] for key in ("F", "Q", "H", "R", "m0", "P0")})
        n = 10 * RATE
        ratio = (slow.block_variance([n / 10])[0] / (n / 10) ** 2) / (own.block_variance([n])[0] / n**2)
        assert ratio == pytest.approx(1.0, rel=0.02)
