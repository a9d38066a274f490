"""Settings of a project in gmwm.toml or pyproject.toml."""

import numpy as np
import pytest

from gmwm.base.errors import OptionError, ReadError
from gmwm.cli.command import find_settings, with_settings
from gmwm.files.readers.api import read
from tests.helpers import raises

ROWS = "".join(f"{k % 7},{k % 5},{k % 3}\n" for k in range(400))


@pytest.fixture
def project(tmp_path, monkeypatch):
    """A folder with a table without names, in whose subfolder commands run."""
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / "one.csv").write_text(ROWS, encoding="utf-8")
    monkeypatch.chdir(tmp_path / "logs")
    return tmp_path


SETTINGS = 'rate = 50\nunits = { gyro = "deg/s" }\ncolumns = ["gyro_x", "gyro_y", "gyro_z"]\n'


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("gmwm.toml", SETTINGS),
        ("gmwm.toml", 'rate = 50.0\nunits = "gyro=deg/s"\ncolumns = { gyro_x = 0, gyro_y = 1, gyro_z = 2 }\n'),
        ("pyproject.toml", f'[project]\nname = "lab"\n\n[tool.gmwm]\n{SETTINGS}'),
    ],
)
def test_commands_use_settings_and_say_so(gmwm, project, name, text):
    given = gmwm("info", "one.csv", "--rate", "50", "--units", "gyro=deg/s", "--columns", "gyro_x,gyro_y,gyro_z")
    (project / name).write_text(text, encoding="utf-8")
    stated = gmwm("info", "one.csv")
    assert (given.code, stated.code) == (0, 0)
    assert stated.out == given.out
    assert f"note: 3 options of {project / name}: --rate 50.0" in stated.err


def test_an_option_replaces_a_setting(gmwm, project):
    (project / "gmwm.toml").write_text(SETTINGS, encoding="utf-8")
    done = gmwm("info", "one.csv", "--rate", "200")
    assert "at 200 Hz" in done.out
    assert "--rate" not in done.err


def test_the_next_settings_count(project):
    (project / "gmwm.toml").write_text("rate = 1\n", encoding="utf-8")
    (project / "logs" / "pyproject.toml").write_text('[project]\nname = "lab"\n', encoding="utf-8")
    assert find_settings(project / "logs") == (project / "gmwm.toml", {"rate": 1.0})
    (project / "logs" / "gmwm.toml").write_text("", encoding="utf-8")
    assert find_settings(project / "logs") == (project / "logs" / "gmwm.toml", {})


@pytest.mark.parametrize(
    ("text", "error", "facts"),
    [
        ("rat = 50\n", OptionError, ["'rat'"]),
        ('rate = "50"\n', OptionError, ["Hz"]),
        ("rate = \n", ReadError, ["gmwm.toml"]),
    ],
)
def test_wrong_settings_are_errors(project, text, error, facts):
    (project / "gmwm.toml").write_text(text, encoding="utf-8")
    with raises(error, *facts):
        with_settings({}, project)


def test_a_damaged_pyproject_of_another_program_is_ignored(project):
    (project / "pyproject.toml").write_text("[", encoding="utf-8")
    assert find_settings(project) == (None, {})


def test_the_mount_names_axes_by_the_vehicle(gmwm, project):
    (project / "gmwm.toml").write_text(f'{SETTINGS}mount = {{ x = "-y", y = "x", z = "z" }}\n', encoding="utf-8")
    done = gmwm("convert", "one.csv", "mounted.csv")
    assert "--mount x=-y,y=x,z=z" in done.err
    raw = np.array([row.split(",") for row in ROWS.split()], dtype=float)
    turned = read(project / "logs" / "mounted.csv")
    for axis, values in {"gyro_x": -raw[:, 1], "gyro_y": raw[:, 0], "gyro_z": raw[:, 2]}.items():
        np.testing.assert_allclose(turned[axis].values, np.deg2rad(values), rtol=1e-12)


def test_watch_uses_settings(gmwm, project):
    (project / "gmwm.toml").write_text(f'{SETTINGS}topic = "imu"\n', encoding="utf-8")
    done = gmwm("watch", "one.csv", "--idle", "0.1s", "--json")
    assert done.code == 0
    assert list(done.json["axes"]) == ["gyro_x", "gyro_y", "gyro_z"]
    assert "--topic" not in done.err


@pytest.mark.parametrize("mount", ["x=y", "x=y,y=y,z=z", "x=--y,y=x,z=z", "up=z,x=x,y=y"])
def test_a_mount_has_each_axis_once(gmwm, project, mount):
    (project / "gmwm.toml").write_text(SETTINGS, encoding="utf-8")
    done = gmwm("info", "one.csv", "--mount", mount)
    assert done.code == 2
    assert "x=-y,y=x,z=z" in done.err
