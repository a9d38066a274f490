"""The core works without the libraries of the extras, and names the extra that a feature needs."""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest

from gmwm.base.errors import MissingDependencyError
from gmwm.base.extras import LIBRARIES, is_installed, library
from gmwm.theory.simulation import simulate
from tests.helpers import raises, tomllib

ROOT = Path(__file__).resolve().parent.parent
BLOCKED = ("dash", "dask", "distributed", "flask", "h5py", "lz4", "matplotlib", "pandas", "pywt", "rosbags", "xarray")
START = "import sys\nfor name in {}: sys.modules[name] = None\nfrom gmwm.cli import start\nstart()"


def described() -> dict[str, list[str]]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        project = tomllib.load(file)["project"]
    return {"core": project["dependencies"], **project["optional-dependencies"]}


def names(requirements: list[str]) -> set[str]:
    return {re.split(r"[<>=;\[]", requirement)[0].lower() for requirement in requirements}


def test_each_library_is_in_its_extra_and_not_in_the_core():
    extras = described()
    for module, (_, extra, _) in LIBRARIES.items():
        package = {"pywt": "pywavelets"}.get(module, module.partition(".")[0])
        assert package in names(extras[extra])
        assert package not in names(extras["core"])
        assert is_installed(module)
    (everything,) = extras["all"]
    assert set(re.findall(r"\w+", everything)) - {"gmwm"} == {library.extra for library in LIBRARIES.values()}


@pytest.mark.parametrize("module", LIBRARIES)
def test_a_missing_library_names_its_extra(module, monkeypatch):
    monkeypatch.delitem(sys.modules, module, raising=False)  # another test may have imported it
    monkeypatch.setitem(sys.modules, module.partition(".")[0], None)
    assert not is_installed(module)
    with raises(MissingDependencyError, advises=[f'pip install "gmwm[{LIBRARIES[module].extra}]"']):
        library(module)


def test_a_damaged_library_shows_its_own_error(monkeypatch, tmp_path):
    (tmp_path / "h5py.py").write_text("import no_such_module\n", encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "h5py", raising=False)
    with pytest.raises(ModuleNotFoundError, match="no_such_module"):
        library("h5py")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("core")
    imu = simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}, rate=100.0, samples=20_000, rng=5)
    imu.write(folder / "g.csv")
    simulate({"gyro": "WN(sigma2=4e-7)"}, rate=100.0, samples=100, rng=5).write(folder / "g.mcap")
    with h5py.File(folder / "g.h5", "w") as file:
        file["gyro_x"] = imu["gyro_x"].values
    np.save(folder / "g.npy", imu["gyro_x"].values)
    return folder


def core(folder: Path, *arguments: str, blocked: tuple[str, ...] = BLOCKED) -> subprocess.CompletedProcess[str]:
    """Run a command without the libraries of all extras."""
    command = (sys.executable, "-c", START.format(blocked), *arguments)
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["g.csv", "g.npy"])
def test_the_core_calibrates_a_file_and_leaves_only_the_plots_out(folder, name):
    given = ("--rate", "100", "--units", "gyro=rad/s", "--columns", "gyro_x") if name.endswith("npy") else ()
    blocked = ("polars", *BLOCKED) if name.endswith("npy") else BLOCKED
    done = core(folder, "calibrate", name, *given, "--within", "WN + RW", "--output", f"out-{name}", blocked=blocked)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert [line for line in done.stderr.splitlines() if 'pip install "gmwm[plots]"' in line]
    written = {file.name for file in (folder / f"out-{name}").iterdir()}
    assert {"calibration.json", "report.html", "summary.txt"} <= written
    assert not [file for file in written if file.endswith(".png")]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "extra"),
    [
        ("info g.csv --plot picture.png", "plots"),
        ("info g.mcap", "ros"),
        ("info g.h5", "hdf5"),
        ("fleet . --scheduler tcp://127.0.0.1:1 --output fleet", "dask"),
        ("wv g.csv --filter sym5", "wavelets"),
        ("app g.csv", "app"),
    ],
)
def test_what_needs_an_extra_is_refused_in_one_line(folder, command, extra):
    done = core(folder, *command.split())
    assert done.returncode == 2
    assert re.fullmatch(rf'error: .* not installed\. Install it: `pip install "gmwm\[{extra}\]"`\.\n', done.stderr)


def test_python_3_10_reads_toml_with_tomli(monkeypatch):
    monkeypatch.setattr(sys, "version_info", (3, 10, 13))
    monkeypatch.setitem(sys.modules, "tomli", tomllib)
    assert runpy.run_path(str(ROOT / "src" / "gmwm" / "base" / "lazy.py"))["tomllib"] is tomllib
