"""Tests of the house itself: what is loaded, who knows what, how long a file is, and whether the words are true."""

from __future__ import annotations

import ast
import inspect
import re
import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from pkgutil import walk_packages

import pytest

import gmwm
from gmwm._late import LateMethod, LateProperty
from gmwm.processes import registry
from tests.docs.shown import missing

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "gmwm"
HEAVY = ("matplotlib", "plotly", "polars", "dask", "scipy", "typer", "rich")
LONGEST_FILE = 600

# Every method of a result whose code is in a higher layer, and where it lives.
LATE_METHODS = {
    "gmwm.calibration.result.Calibration.export": "gmwm.exporters:export",
    "gmwm.calibration.result.Calibration.plot": "gmwm.plots.imu:plot_imu",
    "gmwm.calibration.result.Calibration.report": "gmwm.reports:report",
    "gmwm.estimation.result.Fit._repr_html_": "gmwm.inference.summary:as_html",
    "gmwm.estimation.result.Fit.bootstrap": "gmwm.inference.bootstrap:bootstrap",
    "gmwm.estimation.result.Fit.confidence_intervals": "gmwm.inference.intervals:confidence_intervals",
    "gmwm.estimation.result.Fit.covariance": "gmwm.inference.asymptotic:parameter_covariance",
    "gmwm.estimation.result.Fit.datasheet": "gmwm.datasheets:datasheet",
    "gmwm.estimation.result.Fit.goodness_of_fit": "gmwm.inference.goodness:goodness_of_fit",
    "gmwm.estimation.result.Fit.plot": "gmwm.plots.fit:plot_fit",
    "gmwm.estimation.result.Fit.sandwich": "gmwm.inference.asymptotic:sandwich",
    "gmwm.estimation.result.Fit.standard_errors": "gmwm.inference.asymptotic:standard_errors",
    "gmwm.estimation.result.Fit.wic": "gmwm.inference.criterion:wic",
    "gmwm.estimation.result.Fit.summary": "gmwm.inference.summary:summary",
    "gmwm.estimation.result.Fit.filter": "gmwm.likelihood.tracks:filter_tracks",
    "gmwm.estimation.result.Fit.predict": "gmwm.likelihood.tracks:predict_tracks",
    "gmwm.estimation.result.Fit.residuals": "gmwm.likelihood.innovations:residuals",
    "gmwm.estimation.result.Fit.smooth": "gmwm.likelihood.tracks:smooth_tracks",
    "gmwm.fleets.result.Fleet.plot": "gmwm.plots.fleet:plot_fleet",
    "gmwm.inference.planning.Plan.plot": "gmwm.plots.plan:plot_plan",
    "gmwm.likelihood.innovations.Residuals.plot": "gmwm.plots.residuals:plot_residuals",
    "gmwm.likelihood.result.LikelihoodFit._repr_html_": "gmwm.likelihood.summary:as_html",
    "gmwm.likelihood.result.LikelihoodFit.confidence_intervals": "gmwm.likelihood.intervals:confidence_intervals",
    "gmwm.likelihood.result.LikelihoodFit.filter": "gmwm.likelihood.tracks:filter_tracks",
    "gmwm.likelihood.result.LikelihoodFit.plot": "gmwm.plots.fit:plot_fit",
    "gmwm.likelihood.result.LikelihoodFit.predict": "gmwm.likelihood.tracks:predict_tracks",
    "gmwm.likelihood.result.LikelihoodFit.residuals": "gmwm.likelihood.innovations:residuals",
    "gmwm.likelihood.result.LikelihoodFit.smooth": "gmwm.likelihood.tracks:smooth_tracks",
    "gmwm.likelihood.result.LikelihoodFit.summary": "gmwm.likelihood.summary:summary",
    "gmwm.likelihood.tracks.Tracks.plot": "gmwm.plots.tracks:plot_tracks",
    "gmwm.processes.model.Model.filter": "gmwm.likelihood.tracks:filter_tracks",
    "gmwm.processes.model.Model.loglikelihood": "gmwm.likelihood.estimator:loglikelihood",
    "gmwm.processes.model.Model.predict": "gmwm.likelihood.tracks:predict_tracks",
    "gmwm.processes.model.Model.residuals": "gmwm.likelihood.innovations:residuals",
    "gmwm.processes.model.Model.smooth": "gmwm.likelihood.tracks:smooth_tracks",
    "gmwm.readers.streams.Stream.parts": "gmwm.readers.parts:parts_of",
    "gmwm.readers.streams.Stream.wavelet_variance": "gmwm.streaming.passes:stream_variance",
    "gmwm.selection.ranking.Comparison.plot": "gmwm.plots.ranking:plot_candidates",
    "gmwm.selection.ranking.Ranking.plot": "gmwm.plots.ranking:plot_ranking",
    "gmwm.signals.Imu.between": "gmwm.time_ranges:cut",
    "gmwm.signals.Imu.plot": "gmwm.plots.series:plot_recording",
    "gmwm.signals.Signal.plot": "gmwm.plots.series:plot_signal",
    "gmwm.simulation.components.SimulatedSignal.plot": "gmwm.plots.series:plot_components",
    "gmwm.variance.allan_regression.AllanRegression.plot": "gmwm.plots.allan:plot_avlr",
    "gmwm.variance.clusters.ClusterVariance.plot": "gmwm.plots.allan:plot_allan",
    "gmwm.variance.result.WaveletVariance.plot": "gmwm.plots.variance:plot_wavelet_variance",
}


def modules() -> list[str]:
    """Every module of the package, but the one whose import runs the command line."""
    found = walk_packages(gmwm.__path__, "gmwm.", onerror=_no_module_is_skipped)
    return ["gmwm", *(module.name for module in found if module.name != "gmwm.__main__")]


def _no_module_is_skipped(name: str) -> None:
    raise ImportError(f"{name} cannot be imported")


def python_files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def source_files() -> list[Path]:
    folders = ("src", "cpp", "tests", "benchmarks", "validation", "examples", "release")
    suffixes = {".py", ".pyi", ".cpp", ".hpp"}
    return [file for folder in folders for file in (ROOT / folder).rglob("*") if file.suffix in suffixes]


def project() -> dict[str, object]:
    with (ROOT / "pyproject.toml").open("rb") as file:
        return tomllib.load(file)["project"]  # type: ignore[no-any-return]


def late_methods() -> Iterator[tuple[str, LateMethod[..., object] | LateProperty[object]]]:
    for name in modules():
        for _, found in inspect.getmembers(import_module(name), inspect.isclass):
            if found.__module__ != name:
                continue
            for attribute, value in vars(found).items():
                if isinstance(value, LateMethod | LateProperty):
                    yield f"{name}.{found.__qualname__}.{attribute}", value


# --- the package ------------------------------------------------------------------------------------


def test_import_stays_light() -> None:
    command = [sys.executable, "-c", "import sys, gmwm; print(*sys.modules)"]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "gmwm" in loaded
    assert [name for name in HEAVY if name in loaded] == []


def test_late_methods_are_listed_and_lead_to_functions() -> None:
    found = dict(late_methods())
    assert {name: method.target for name, method in found.items()} == LATE_METHODS
    for name, method in found.items():
        first = next(iter(inspect.signature(method.resolve()).parameters.values()))
        assert first.kind in (first.POSITIONAL_ONLY, first.POSITIONAL_OR_KEYWORD), name
        assert method.__doc__, name


def test_only_the_command_line_imports_from_the_package_itself() -> None:
    # The layers in pyproject.toml leave out `from gmwm import _core`; nothing else may slip through there.
    upstairs = {PACKAGE / "__init__.py", PACKAGE / "__main__.py", *(PACKAGE / "cli").glob("*.py")}
    wrong = []
    for file in sorted(set(python_files()) - upstairs):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                allowed = all(alias.name != "gmwm" for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                core = [alias.name for alias in node.names] == ["_core"]
                allowed = node.level == 0 and (node.module != "gmwm" or core)
            else:
                continue
            if not allowed:
                wrong.append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert wrong == []


@pytest.mark.parametrize("name", registry)
def test_only_the_process_knows_its_name(name: str) -> None:
    places = [
        f"{file.relative_to(ROOT)}:{node.lineno}"
        for file in python_files()
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        if isinstance(node, ast.Constant) and node.value == name
    ]
    assert len(places) <= 1, places


@pytest.mark.parametrize("name", [name for name in dir(gmwm) if not name.startswith("_")])
def test_public_names_say_what_they_are(name: str) -> None:
    thing = getattr(gmwm, name)
    words = vars(thing).get("__doc__") if inspect.isclass(thing) else inspect.getdoc(thing)
    # A dataclass without words of its own gets its signature for words.
    assert words, name
    assert not words.startswith(f"{name}("), name


def test_no_source_file_is_too_long() -> None:
    files = source_files()
    assert len(files) > len(python_files())
    lengths = {str(file.relative_to(ROOT)): len(file.read_text(encoding="utf-8").splitlines()) for file in files}
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_FILE} == {}


def test_one_version_everywhere() -> None:
    citation = re.search(r"^version: *[\"']?([^\"'\s]+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    log = re.search(r"^## *([0-9][^\s]*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert citation is not None
    assert log is not None
    assert project()["version"] == gmwm.__version__ == citation[1] == log[1]


# --- the words --------------------------------------------------------------------------------------


def blocks(file: str, language: str) -> list[str]:
    text = (ROOT / file).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def shell_lines() -> list[list[str]]:
    """The commands in README's and CONTRIBUTING's shell blocks, as words."""
    text = "\n".join(block for file in ("README.md", "CONTRIBUTING.md") for block in blocks(file, "sh"))
    lines = [shlex.split(line, comments=True) for line in text.replace("\\\n", " ").splitlines()]
    return [words for line in lines if line for words in _split_at_and(line)]


def _split_at_and(words: list[str]) -> Iterator[list[str]]:
    start = 0
    for index, word in enumerate([*words, "&&"]):
        if word == "&&":
            yield words[start:index]
            start = index + 1


def test_readme_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gmwm.simulation import reference_imu, simulate
    from gmwm.writers import write

    code = blocks("README.md", "python")
    assert code
    monkeypatch.chdir(tmp_path)
    write(simulate(reference_imu(), rate=100.0, duration=1200.0, seed=1), "static.csv")
    names: dict[str, object] = {}
    for block in code:
        exec(compile(block, "README.md", "exec"), names)


def test_readme_shows_what_the_demo_prints(tmp_path: Path) -> None:
    (shown,) = blocks("README.md", "text")
    command = [sys.executable, "-m", "gmwm", "demo", "--output", str(tmp_path)]
    printed = subprocess.run(command, capture_output=True, encoding="utf-8", check=True).stdout
    assert missing(shown, printed) == ""


def test_commands_in_the_words_exist() -> None:
    import typer

    from gmwm.cli.main import app

    command_line = typer.main.get_command(app)
    commands = command_line.commands  # type: ignore[attr-defined]
    used = [words[1:] for words in shell_lines() if Path(words[0]).name == "gmwm"]
    assert used
    for name, *rest in used:
        assert name in commands
        known = {option for parameter in commands[name].params for option in parameter.opts} | {"--help"}
        assert {word.split("=")[0] for word in rest if word.startswith("--")} <= known, name


def test_make_targets_in_the_words_exist() -> None:
    targets = re.findall(r"^([a-z][a-z-]*):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
    used = {word for words in shell_lines() if words[0] == "make" for word in words[1:] if "=" not in word}
    assert {"demo", "test"} <= used <= set(targets)


def test_every_dependency_has_its_reason() -> None:
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    with (ROOT / "pyproject.toml").open("rb") as file:
        described = tomllib.load(file)
    extras = described["project"].get("optional-dependencies", {})
    wanted = [described["build-system"]["requires"], described["project"]["dependencies"], *extras.values()]
    names = {re.split(r"[<>=!~\[; ]", requirement)[0] for group in wanted for requirement in group}
    assert {name for name in names if f"| {name} |" not in text} == set()
