"""The state-space files run in C++ with Eigen and in Octave, and have the matrices of the JSON file there."""

import importlib.util
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import gmwm
from gmwm.showing.exporters.statespace import MATRICES

from .conftest import exact_curve

pytestmark = pytest.mark.slow

TRUTHS = {
    "gyro_x": "FN(b2=2e-9) + WN(sigma2=6e-7)",
    "gyro_y": "GM(beta=0.1, sigma2=2e-8) + QN(q2=3e-7) + WN(sigma2=6e-7)",
    "gyro_z": "WN(sigma2=6e-7)",
}
MODELS = {"gyro_x": "FN + WN", "gyro_y": "GM + QN + WN", "gyro_z": "WN"}


def eigen():
    """The folder with Eigen's headers, of the package cmeel-eigen or of the system; None if there is none."""
    found = importlib.util.find_spec("cmeel")
    places = [Path(root).parent / "cmeel.prefix" for root in (found.submodule_search_locations or ())] if found else []
    folders = [place / "include" / "eigen3" for place in (*places, Path("/usr"), Path("/usr/local"))]
    return next((folder for folder in folders if (folder / "Eigen" / "Dense").is_file()), None)


@pytest.fixture(scope="module")
def unit():
    return gmwm.calibrate({axis: exact_curve(axis, truth) for axis, truth in TRUTHS.items()}, models=MODELS)


def systems(unit):
    """The matrices of the JSON file by name of the system in C++."""
    for axis, one in json.loads(unit.export(format="state-space-json"))["axes"].items():
        yield axis, one
        if one["two_states"] is not None:
            yield f"{axis}_two_states", one["two_states"]


def agree(printed, unit):
    """Compare lines "SYSTEM MATRIX ROWS COLUMNS values…" with the matrices of the JSON file."""
    found = {}
    for line in printed.splitlines():
        system, matrix, *numbers = line.split()
        rows, columns, *values = map(float, numbers)
        found[system, matrix] = np.reshape(values, (int(rows), int(columns)))
    wanted = {(name, key): np.array(one[key]) for name, one in systems(unit) for key in MATRICES}
    assert found.keys() == wanted.keys()
    assert ("gyro_x_two_states", "F") in wanted
    for key, matrix in wanted.items():
        assert np.array_equal(found[key], matrix.reshape(found[key].shape)), key
        assert found[key].size == matrix.size


@pytest.mark.skipif(shutil.which("g++") is None or eigen() is None, reason="needs g++ and Eigen: pip install '.[dev]'")
def test_cpp_compiles_and_has_the_matrices(unit, tmp_path):
    unit.export(tmp_path / "noise.hpp", format="state-space-cpp")
    names = [name for name, _ in systems(unit)]
    prints = "".join(f'  print("{name}", "{key}", {name}().{key});\n' for name in names for key in MATRICES)
    (tmp_path / "main.cpp").write_text(
        '#include "noise.hpp"\n#include <cstdio>\n'
        "static void print(const char* system, const char* name, const Eigen::MatrixXd& m) {\n"
        '  std::printf("%s %s %d %d", system, name, int(m.rows()), int(m.cols()));\n'
        "  for (int i = 0; i < m.rows(); ++i)\n"
        '    for (int j = 0; j < m.cols(); ++j) std::printf(" %.17g", m(i, j));\n'
        '  std::printf("\\n");\n}\n'
        f"int main() {{\n  using namespace gmwm_noise;\n{prints}}}\n"
    )
    warnings = ["-std=c++17", "-O0", "-Wall", "-Wextra", "-Werror", "-isystem", str(eigen())]
    subprocess.run(["g++", *warnings, "main.cpp", "-o", "main"], cwd=tmp_path, check=True, capture_output=True)
    agree(subprocess.run([tmp_path / "main"], check=True, capture_output=True, text=True).stdout, unit)


@pytest.mark.skipif(shutil.which("octave") is None, reason="needs Octave: apt install octave")
def test_matlab_runs_in_octave_and_has_the_matrices(unit, tmp_path):
    unit.export(tmp_path / "noise_of_unit.m", format="state-space-matlab")
    keys = ", ".join(f"'{key}'" for key in MATRICES)
    (tmp_path / "main.m").write_text(
        f"noise_of_unit\nkeys = {{{keys}}};\n"
        "function show(system, one, keys)\n"
        "  for k = 1:numel(keys)\n"
        "    m = one.(keys{k});\n"
        "    printf('%s %s %d %d', system, keys{k}, rows(m), columns(m)); printf(' %.17g', m'); printf('\\n');\n"
        "  end\nend\n"
        "axes_of = fieldnames(noise);\n"
        "for k = 1:numel(axes_of)\n"
        "  one = noise.(axes_of{k}); show(axes_of{k}, one, keys);\n"
        "  if isfield(one, 'two_states') show([axes_of{k} '_two_states'], one.two_states, keys); end\n"
        "end\n"
    )
    command = ["octave", "--no-gui", "--norc", "--quiet", "main.m"]
    agree(subprocess.run(command, cwd=tmp_path, check=True, capture_output=True, text=True).stdout, unit)
