"""Tests of the house itself: what is loaded, who knows what, how long a file is, and whether the words are true."""

from __future__ import annotations

import ast
import inspect
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

import pytest

import gmwm
from gmwm.theory.processes import registry
from tests.helpers import each, tomllib
from tests.house_figures import figures, modules_of_calibrate, parsed

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "gmwm"
HEAVY = ("matplotlib", "plotly", "polars", "dask", "scipy", "typer", "rich")
MISSING = () if find_spec("dash") else ("gmwm.applications.app.page.",)
"""Modules of an extra that is not installed."""
LONGEST_FILE = 600
LONGEST_COMMAND = 40
BY_POSITION = (gmwm.statespace.StateSpace, gmwm.continuous_statespace.ContinuousStateSpace)
"""Their matrices F, Q, H, R … have the order that the field gives them. The kernels are exempt too."""


def modules() -> list[str]:
    """Every module of the package, but the one whose import runs the command line, and those of a missing extra."""
    found = walk_packages(gmwm.__path__, "gmwm.", onerror=_no_module_is_skipped)
    names = (module.name for module in found if module.name != "gmwm.__main__")
    return ["gmwm", *(name for name in names if not name.startswith(MISSING))]


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


# --- the package ------------------------------------------------------------------------------------


@pytest.mark.slow
def test_import_stays_light() -> None:
    command = [sys.executable, "-c", "import sys, gmwm; print(*sys.modules)"]
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "gmwm" in loaded
    assert [name for name in loaded if name.startswith(("gmwm.", "numpy"))] == []
    command[2] = "import sys, gmwm; [getattr(gmwm, name) for name in gmwm.__all__]; print(*sys.modules)"
    loaded = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split()
    assert "gmwm.calibration" in loaded
    assert [name for name in HEAVY if name in loaded] == []


@pytest.mark.slow
def test_upward_imports_are_local_to_methods() -> None:
    with (ROOT / "pyproject.toml").open("rb") as file:
        (contract,) = tomllib.load(file)["tool"]["importlinter"]["contracts"]
    ignored = [entry.split(" -> ") for entry in contract["ignore_imports"]]
    assert ignored
    for importer, imported in ignored:
        tree = parsed(Path(import_module(importer).__file__ or ""))
        owners = [node for node in tree.body if isinstance(node, ast.ClassDef)]
        methods = [node for owner in owners for node in owner.body if isinstance(node, ast.FunctionDef)]
        every, local = (
            [
                node
                for top in tops
                for node in ast.walk(top)
                if isinstance(node, ast.ImportFrom) and node.module == imported
            ]
            for tops in (_without_type_checking(tree), methods)
        )
        assert every == local != [], f"{importer} -> {imported}"


def _without_type_checking(tree: ast.Module) -> list[ast.stmt]:
    guard = "TYPE_CHECKING"
    return [node for node in tree.body if not (isinstance(node, ast.If) and ast.unparse(node.test) == guard)]


def test_the_path_in_the_guide_exists() -> None:
    guide = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = guide[guide.index("### One path") : guide.index("Outside the package:")]
    cells = [part for row in section.splitlines() if row.startswith("| ") for part in row.split(";")]
    count = 0
    for cell in cells:
        names = re.findall(r"`([^`]+)`", cell)
        files = [name for name in names if name.endswith(".py")]
        for file in files:
            text = (PACKAGE / file).read_text(encoding="utf-8")
            after = names[names.index(file) + 1 :]
            for name in after[:1]:
                count += 1
                assert re.search(rf"(def|class) {name.split('.')[0]}\b", text), f"{file} has no {name}"
    assert count > 12


@pytest.mark.slow
def test_methods_have_the_parameters_of_the_functions_that_they_call() -> None:
    pairs = dict(delegating_methods())
    assert {"KalmanMethods.smooth", "Stream.psd", "Stream.parts"} <= set(pairs)
    assert len(pairs) > 15
    for name, (method, function) in pairs.items():
        own, theirs = (list(inspect.signature(one).parameters.values())[1:] for one in (method, function))
        assert own == theirs, name


def delegating_methods() -> Iterator[tuple[str, tuple[Callable[..., object], Callable[..., object]]]]:
    """Methods that import a function and return its value for their object and parameters: each with it."""
    for file in python_files():
        name = ".".join(file.relative_to(PACKAGE.parent).with_suffix("").parts).removesuffix(".__init__")
        for owner in parsed(file).body:
            if not isinstance(owner, ast.ClassDef):
                continue
            for node in owner.body:
                if isinstance(node, ast.FunctionDef) and (place := _delegate(node)):
                    method = vars(getattr(import_module(name), owner.name))[node.name]
                    function = getattr(import_module(place[0]), place[1])
                    yield f"{owner.name}.{node.name}", (getattr(method, "func", method), function)


def _delegate(method: ast.FunctionDef) -> tuple[str, str] | None:
    """Module and name of the function that a method imports and returns the value of, with the object as its first."""
    imported = {
        alias.asname or alias.name: (node.module or "", alias.name)
        for node in method.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
    }
    last = method.body[-1]
    if not (isinstance(last, ast.Return) and isinstance(call := last.value, ast.Call) and call.args):
        return None
    is_self = ast.unparse(call.args[0]) in ("self", "self._fit", "self._modelled")
    passes_on = all(isinstance(given, ast.Name) for given in [*call.args[1:], *(k.value for k in call.keywords)])
    return imported.get(ast.unparse(call.func)) if is_self and passes_on else None


@pytest.mark.slow
def test_at_most_four_arguments_are_passed_by_position() -> None:
    count, wrong = 0, []
    for name in modules():
        module = import_module(name)
        file = Path(module.__file__ or "")
        if file.suffix != ".py":
            continue
        for call, called in calls(parsed(file), vars(module), None):
            home = getattr(called, "__module__", None) or ""
            if not home.startswith("gmwm.") or home == "gmwm.base._core" or called in BY_POSITION:
                continue
            count += 1
            if len(call.args) > 4 and not _takes_any_number(called):
                wrong.append(f"{file.relative_to(ROOT)}:{call.lineno} {ast.unparse(call.func)}")
    assert wrong == []
    assert count > 5000


def calls(node: ast.AST, names: Mapping[str, Any], owner: type | None) -> Iterator[tuple[ast.Call, Any]]:
    """Each call under a node, with what is called as far as its name tells: None for a method of an unknown object."""
    if isinstance(node, ast.ClassDef):
        owner = names.get(node.name, owner)
    if isinstance(node, ast.FunctionDef):
        local = [part for part in ast.walk(node) if isinstance(part, ast.ImportFrom) and part.module]
        found = {a.asname or a.name: (part.module, a.name) for part in local for a in part.names}
        ours = {
            name: place
            for name, place in found.items()
            if str(place[0]).startswith("gmwm.") and not str(place[0]).startswith(MISSING)
        }
        names = {**names, **{name: getattr(import_module(str(module)), own) for name, (module, own) in ours.items()}}
    if isinstance(node, ast.Call):
        yield node, _called(node.func, names, owner)
    for child in ast.iter_child_nodes(node):
        yield from calls(child, names, owner)


def _called(function: ast.expr, names: Mapping[str, Any], owner: type | None) -> Any:
    if isinstance(function, ast.Name):
        return owner if function.id in ("cls", "self") else names.get(function.id)
    if isinstance(function, ast.Attribute):
        return getattr(_called(function.value, names, owner), function.attr, None)
    return None


def _takes_any_number(called: Callable[..., object]) -> bool:
    return any(p.kind is p.VAR_POSITIONAL for p in inspect.signature(called).parameters.values())


@pytest.mark.slow
def test_only_the_command_line_imports_from_the_package_itself() -> None:
    upstairs = {PACKAGE / "__init__.py", PACKAGE / "__main__.py", *(PACKAGE / "cli").glob("*.py")}
    upstairs |= set((PACKAGE / "applications" / "app").rglob("*.py"))
    wrong = []
    for file in sorted(set(python_files()) - upstairs):
        for node in ast.walk(parsed(file)):
            if isinstance(node, ast.Import):
                allowed = all(alias.name != "gmwm" for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                allowed = node.level == 0 and node.module != "gmwm"
            else:
                continue
            if not allowed:
                wrong.append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert wrong == []


@pytest.mark.slow
def test_only_the_process_knows_its_name() -> None:
    places: dict[str, list[str]] = {name: [] for name in registry}
    for file in python_files():
        for statement in parsed(file).body:
            if _is_list_of_exports(statement):
                continue
            for node in ast.walk(statement):
                if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value in places:
                    places[node.value].append(f"{file.relative_to(ROOT)}:{node.lineno}")
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def _is_list_of_exports(statement: ast.stmt) -> bool:
    return isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "__all__"


@each("name", [name for name in dir(gmwm) if not name.startswith("_")])
def test_public_names_say_what_they_are(name: str) -> None:
    thing = getattr(gmwm, name)
    words = vars(thing).get("__doc__") if inspect.isclass(thing) else inspect.getdoc(thing)
    # A dataclass without words of its own gets its signature for words.
    assert words, name
    assert not words.startswith(f"{name}("), name


@pytest.mark.slow
def test_the_figures_of_the_house_stay() -> None:
    limits = {"entries": 14, "classes": 0, "locals": 1, "participles": 3, "constants": 440, "codes": 110, "upward": 12}
    found = figures(PACKAGE)
    assert {name: found[name][0] for name in limits if found[name][0] > limits[name]} == {}
    assert len(modules_of_calibrate(PACKAGE)) <= 150


def test_no_source_file_is_too_long() -> None:
    files = source_files()
    assert len(files) > len(python_files())
    lengths = {str(file.relative_to(ROOT)): len(file.read_text(encoding="utf-8").splitlines()) for file in files}
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_FILE} == {}


def test_commands_are_short_and_return_an_outcome() -> None:
    # Options, one call of the library, an outcome: what is longer is a task that has a function of its own.
    from gmwm.cli.main import NAMES

    assert len(NAMES) > 10
    lengths, wrong = {}, []
    for name in NAMES:
        tree = parsed(PACKAGE / "cli" / f"{name}.py")
        (found,) = (node for node in tree.body if isinstance(node, ast.FunctionDef) and node.name == name)
        body = found.body[1:]  # without the docstring
        summary, *_ = (ast.get_docstring(found) or "").split("\n\n")
        assert " ".join(summary.split()) == NAMES[name]
        lengths[name] = found.body[-1].end_lineno - body[0].lineno + 1  # type: ignore[operator]
        if [ast.unparse(one) for one in found.decorator_list] != ["command"] or ast.unparse(found.returns) != "Outcome":  # type: ignore[arg-type]
            wrong.append(name)
    assert {name: lines for name, lines in lengths.items() if lines > LONGEST_COMMAND} == {}
    assert wrong == []


def test_every_error_of_a_reader_has_a_code() -> None:
    kinds = {"ReadError", "UnitError", "PackedError", "PicklesError"}
    without = [
        f"{file.name}:{node.lineno}"
        for file in (PACKAGE / "files" / "readers").rglob("*.py")
        for node in ast.walk(parsed(file))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in kinds
        if not any(keyword.arg == "code" for keyword in node.keywords)
    ]
    assert without == []


def test_one_version_everywhere() -> None:
    citation = re.search(r"^version: *[\"']?([^\"'\s]+)", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)
    log = re.search(r"^## *([0-9][^\s]*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert citation is not None
    assert log is not None
    assert project()["version"] == gmwm.__version__ == citation[1] == log[1]


# --- errors and remarks are data --------------------------------------------------------------------

EDITS = {
    "capitalize", "casefold", "count", "endswith", "find", "index", "lower", "lstrip", "partition", "removeprefix",
    "removesuffix", "replace", "rpartition", "rsplit", "rstrip", "split", "splitlines", "startswith", "strip", "title",
    "translate", "upper",
}  # fmt: skip
"""Methods of str that search, split or change a text."""


@pytest.mark.slow
def test_no_code_searches_or_edits_the_text_of_errors_and_remarks() -> None:
    """Code decides by type, argument, code and facts.

    The check sees texts of gmwm's errors in their handlers, texts of remarks and results, the facts given to
    `Remark.of`, and local variables with such a text. It does not see a text that another function receives.
    """
    places = []
    for file in python_files():
        tree = parsed(file)
        places += [f"{file.relative_to(ROOT)}:{line}" for line in sorted(edited_prose(tree))]
    assert places == []


@pytest.mark.parametrize(
    "source",
    [
        "try:\n    f()\nexcept DataError as error:\n    g(str(error).replace('a', 'b'))",
        "try:\n    f()\nexcept (KeyError, GmwmError) as error:\n    text = str(error)\n    g('a' in text)",
        "try:\n    f()\nexcept ReadError as error:\n    g(re.sub('a', 'b', f'{error}'))",
        "try:\n    f()\nexcept ReadError as error:\n    g(error.reason.rstrip('.'))",
        "def f(remark):\n    return remark.text(Dialect.SHELL).startswith('a')",
        "def f(result):\n    words = result.summary()\n    return words.removeprefix('a')",
        "Remark.of('not-fitted', axis, reason=why.rstrip('.'))",
    ],
)
def test_the_check_finds_edited_texts(source: str) -> None:
    assert edited_prose(ast.parse(source))


@pytest.mark.parametrize(
    "source",
    [
        "try:\n    f()\nexcept OSError as error:\n    g(str(error).splitlines()[0])",
        "try:\n    f()\nexcept DataError as error:\n    g(f'{axis}: {error}')",
        "def f(text):\n    return text.replace('a', 'b')",
    ],
)
def test_the_check_allows_other_texts(source: str) -> None:
    assert edited_prose(ast.parse(source)) == set()


def edited_prose(tree: ast.Module) -> set[int]:
    """Lines that search, split or edit the text of an error, a remark or a result."""
    own = {name for name, kind in vars(gmwm.errors).items() if inspect.isclass(kind) and issubclass(kind, Exception)}
    lines: set[int] = set()
    for scope in ast.walk(tree):
        if isinstance(scope, ast.ExceptHandler) and scope.name and scope.type is not None:
            caught = {node.id for node in ast.walk(scope.type) if isinstance(node, ast.Name)}
            lines |= _edits(scope, {scope.name} if caught & own else set())
        elif isinstance(scope, ast.FunctionDef | ast.Module):
            lines |= _edits(scope, set())
        elif isinstance(scope, ast.Call) and ast.unparse(scope.func) == "Remark.of":
            given = [node for keyword in scope.keywords for node in ast.walk(keyword.value)]
            lines |= {node.lineno for node in given if isinstance(node, ast.Call) and _edited(node) is not None}
    return lines


def _edits(scope: ast.AST, errors: set[str]) -> set[int]:
    """Lines of a scope that edit texts of these errors, or of remarks and results."""
    nodes = list(ast.walk(scope))
    texts: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Assign) and _is_prose(node.value, errors, set()):
            texts |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    lines = set()
    for node in nodes:
        used: list[ast.expr] = []
        if isinstance(node, ast.Call):
            edited = _edited(node)
            used = [edited] if edited is not None else []
            used += node.args if ast.unparse(node.func).startswith("re.") else []
        elif isinstance(node, ast.Compare):
            used = [node.left, *node.comparators]
        if any(_is_prose(one, errors, texts) for one in used):
            lines.add(node.lineno)  # type: ignore[attr-defined]
    return lines


def _edited(call: ast.Call) -> ast.expr | None:
    """What a call of a method of str searches or changes."""
    return call.func.value if isinstance(call.func, ast.Attribute) and call.func.attr in EDITS else None


def _is_prose(node: ast.expr, errors: set[str], texts: set[str]) -> bool:
    """Whether an expression is the text of an error, a remark or a result."""
    if isinstance(node, ast.Name):
        return node.id in texts
    if isinstance(node, ast.JoinedStr):
        return any(isinstance(one, ast.FormattedValue) and ast.unparse(one.value) in errors for one in node.values)
    if isinstance(node, ast.Attribute):
        return node.attr in ("reason", "message") and ast.unparse(node.value) in errors
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id == "str" and len(node.args) == 1 and ast.unparse(node.args[0]) in errors
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
        return node.func.attr == "summary" or (
            node.func.attr == "text" and bool(node.args or "remark" in ast.unparse(node.func.value))
        )
    return False


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


@pytest.mark.docs
def test_readme_python_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from gmwm.theory.simulation import reference_imu, simulate

    code = blocks("README.md", "python")
    assert code
    monkeypatch.chdir(tmp_path)
    simulate(reference_imu(), rate=100.0, duration=300.0, rng=1).write("static.csv")
    names: dict[str, object] = {}
    for block in code:
        exec(compile(block, "README.md", "exec"), names)


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
