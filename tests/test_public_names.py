"""What `gmwm` and its packages offer: few names, each in one place, and one way to do each thing."""

import ast
import inspect
import pydoc
from importlib import import_module
from pkgutil import iter_modules

import numpy as np
import pytest

import gmwm
from tests.helpers import each

ROOMS = {module.name for module in iter_modules(gmwm.__path__) if module.ispkg}
PACKAGES = [f"gmwm.{name}" for name in gmwm._PACKAGES if name not in ("app", "errors", "options")]
DOUBLES = (
    "agreement", "datasheet", "export", "export_formats", "loglikelihood", "parse_model", "plot_imu", "report_data",
    "write", "write_components",
)  # fmt: skip


def test_the_package_has_about_fifty_names():
    assert 40 <= len(gmwm.__all__) <= 52
    assert len(set(gmwm.__all__)) == len(gmwm.__all__)
    visible = {name for name in dir(gmwm) if name[0] != "_" and not inspect.ismodule(getattr(gmwm, name))}
    assert visible == set(gmwm.__all__)


def test_names_come_from_the_packages_that_type_checkers_see():
    blocks = [node for node in ast.parse(inspect.getsource(gmwm)).body if isinstance(node, ast.If)]
    imports = [node for node in blocks[0].body if isinstance(node, ast.ImportFrom) and node.module != "gmwm"]
    seen = {name.name: node.module for node in imports for name in node.names}
    listed = {name: package for package, names in gmwm._NAMES.items() for name in names}
    homes = {name: listed.get(name, "processes") for name in gmwm.__all__}
    rooms = {name: package.rpartition(".")[0] for name, package in gmwm._PACKAGES.items() if name != "app"}
    assert seen == {name: gmwm._PACKAGES.get(home, f"gmwm.{home}") for name, home in homes.items()} | rooms


@each("name", gmwm._PACKAGES)
def test_short_and_full_names_are_the_same_package(name):
    short, full = import_module(f"gmwm.{name}"), import_module(gmwm._PACKAGES[name])
    assert short is full
    assert short.__spec__.name == short.__name__ == gmwm._PACKAGES[name]


def test_the_rooms_are_few_and_import_nothing():
    assert {*gmwm._ROOMS, "calibration", "cli"} == ROOMS
    for room in gmwm._ROOMS:
        (statement,) = ast.parse(inspect.getsource(import_module(f"gmwm.{room}"))).body
        assert isinstance(statement, ast.Expr), room


def test_help_lists_every_function_and_class():
    shown = pydoc.plain(pydoc.render_doc(gmwm))
    functions, _, _ = shown.partition("\nDATA\n")
    for name in gmwm.__all__:
        assert f"\n    {name}(" in functions or f"class {name}(" in functions or f"class {name}\n" in functions, name


@each("name", [name for name in gmwm.__all__ if inspect.isfunction(getattr(gmwm, name))])
def test_the_first_words_of_help_name_every_function(name):
    assert f"`{name}`" in gmwm.__doc__


@each("package", PACKAGES)
def test_every_package_lists_its_names(package):
    module = import_module(package)
    assert module.__all__
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


@pytest.mark.parametrize(
    "package", ["filters", "outliers", "signals", "statespace", "continuous_statespace", "time_base", "units"]
)
def test_modules_with_public_functions_list_them(package):
    module = import_module(f"gmwm.{package}")
    assert [name for name in module.__all__ if not hasattr(module, name)] == []


@pytest.mark.parametrize("name", DOUBLES)
def test_functions_that_double_a_method_are_gone(name):
    assert not hasattr(gmwm, name)


def test_each_method_is_there():
    simulated = gmwm.simulate("WN(sigma2=1e-6)", rate=100.0, samples=50, rng=1, components=True)
    model = gmwm.Model.parse("WN(sigma2=1e-6)")
    for thing, method in (
        (simulated.imu, "plot"), (simulated.imu, "write"), (simulated["gyro_x"].signal, "plot"),
        (simulated["gyro_x"].signal, "write"), (simulated, "write_components"),
        (simulated["gyro_x"], "write_components"),
        (model, "loglikelihood"), (gmwm.fit(model.structure, simulated.imu["gyro_x"]), "datasheet"),
    ):  # fmt: skip
        assert callable(getattr(thing, method))
    for method in ("report", "export", "plot"):
        assert hasattr(gmwm.Calibration, method)


def test_a_recording_writes_itself(tmp_path):
    imu = gmwm.simulate({"gyro": "WN(sigma2=1e-6)"}, rate=100.0, samples=50, rng=1)
    imu.write(tmp_path / "whole.parquet")
    imu["gyro_y"].write(tmp_path / "one.csv")
    np.testing.assert_array_equal(gmwm.read(tmp_path / "whole.parquet")["gyro_y"].values, imu["gyro_y"].values)
    np.testing.assert_array_equal(gmwm.read(tmp_path / "one.csv")["gyro_y"].values, imu["gyro_y"].values)


@pytest.mark.parametrize(
    "call",
    [
        lambda text, x: gmwm.fit(text, x, rate=100.0).model.structure,
        lambda text, x: gmwm.fit_ml(text, x, rate=100.0).model.structure,
        lambda text, x: gmwm.select(text, x, rate=100.0).recommended.structure,
        lambda text, x: gmwm.rank([text], x, rate=100.0)[0].model.structure,
    ],
)
def test_a_model_may_be_a_text(call):
    x = gmwm.WN(sigma2=1.0).simulate(1000, 100.0, rng=1)
    assert call("WN", x) == call(gmwm.Model.parse("WN"), x) == "WN"
