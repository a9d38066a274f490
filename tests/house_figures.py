"""Figures of the house: how large the package is, how it is named, and which way a calibration takes through it.

    python -m tests.house_figures [src/gmwm] [--list NAME]

`--list NAME` prints the places behind one figure. tests/test_house.py holds some of these figures to a limit.
"""

from __future__ import annotations

import argparse
import ast
import os
import re
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
BANNED = {
    "found", "one", "own", "known", "given", "some", "kept", "whole", "wanted", "asked", "there", "beside", "rest",
    "made", "said", "left",
}  # fmt: skip
"""Pronouns and participles that say nothing about a local variable."""
VERBS = {"bleed", "embed", "exceed", "feed", "need", "proceed", "read", "seed", "shed", "speed", "succeed", "thread"}
"""Words that end like a participle but are verbs or nouns."""
IRREGULAR = {"built", "cut", "drawn", "given", "held", "kept", "known", "left", "lost", "made", "met", "said", "seen",
             "sent", "set_apart", "shown", "spread", "split", "taken", "told", "written"}  # fmt: skip
PINNED = re.compile(r"tests?[/ ]|docs/validation|\bpaper\b|\bstudy\b|\b(19|20)\d\d\b|[Ss]ee `|equation|chapter|section")


@cache
def parsed(file: Path) -> ast.Module:
    """Return the syntax tree of a file, which several figures and tests walk."""
    return ast.parse(file.read_text(encoding="utf-8"))


@cache
def nodes(tree: ast.Module) -> list[ast.AST]:
    """Return every node of a tree."""
    return list(ast.walk(tree))


def files(package: Path) -> list[Path]:
    """Every Python file of the package."""
    return sorted(package.rglob("*.py"))


def place(package: Path, file: Path, node: ast.AST) -> str:
    """File and line of a node."""
    return f"{file.relative_to(package)}:{getattr(node, 'lineno', 0)}"


def assigned_names(tree: ast.Module) -> Iterator[tuple[str, ast.AST]]:
    """Names that functions assign: targets of assignments, loops, comprehensions and `with`."""
    for function in nodes(tree):
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda):
            for node in ast.walk(function):
                if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                    yield node.id, node


def functions(tree: ast.Module) -> Iterator[ast.FunctionDef]:
    """Every function and method."""
    for node in nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield node


def is_participle(name: str) -> bool:
    """Whether the name of a function is a single participle, such as `measured` or `_moved`."""
    word = name.strip("_")
    return "_" not in word and (word in IRREGULAR or (word.endswith("ed") and word not in VERBS))


def constants(tree: ast.Module) -> Iterator[tuple[str, ast.AST, str]]:
    """Numeric constants of a module, with the text below each."""
    for node, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(node, ast.Assign) and len(node.targets) == 1 and isinstance(node.targets[0], ast.Name):
            name, value = node.targets[0].id, node.value
        elif isinstance(node, ast.AnnAssign) and node.value is not None and isinstance(node.target, ast.Name):
            name, value = node.target.id, node.value
        else:
            continue
        if name.upper() != name or not _is_number(value):
            continue
        text = ""
        if isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant):
            text = str(following.value.value)
        yield name, node, text


def _is_number(value: ast.expr) -> bool:
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    return isinstance(value, ast.BinOp) and _is_number(value.left) and _is_number(value.right)


def modules_of_calibrate(package: Path) -> list[str]:
    """Modules of the package that the name `gmwm.calibrate` loads."""
    program = "import sys, gmwm; gmwm.calibrate; print(*sorted(n for n in sys.modules if n.startswith('gmwm.')))"
    return [name for name in _output(program, package).split() if not _is_short(name)]


def _is_short(name: str) -> bool:
    import gmwm

    return name.removeprefix("gmwm.") in getattr(gmwm, "_PACKAGES", ())


def rooms_of_calibrate(package: Path) -> list[str]:
    """Packages whose functions receive the recording during `gmwm.calibrate`, in order, without repetitions."""
    program = """
import sys, os
import gmwm
from tests.helpers import tomllib
imu = gmwm.simulate(gmwm.simulation.reference_imu(), rate=100.0, duration=120.0, rng=1)
gmwm.calibrate(imu, threads=1)
steps, prefix = [], os.path.dirname(gmwm.__file__) + "/"
def enter(frame, event, argument):
    file = frame.f_code.co_filename
    if event == "call" and file.startswith(prefix):
        if any(value is imu for value in list(frame.f_locals.values())[:3]):
            room = file[len(prefix):].split("/")
            steps.append("/".join(room[:-1][:2]) or room[0].removesuffix(".py"))
sys.setprofile(enter)
gmwm.calibrate(imu, threads=1)
sys.setprofile(None)
print(*[step for step, before in zip(steps, [None, *steps]) if step != before])
"""
    return _output(program, package).split()


def kinds_of_lines(text: str, tree: ast.Module) -> Counter[str]:
    """Lines of one file by what they hold: code, docstrings, signatures, imports, comments, nothing."""
    kinds = ["comment" if line.lstrip().startswith("#") else "code" if line.strip() else "blank"
             for line in text.splitlines()]  # fmt: skip
    for node in nodes(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            _mark(kinds, node.lineno, node.end_lineno, "import")
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            _mark(kinds, node.lineno, node.body[0].lineno - 1, "signature")
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            _mark(kinds, node.lineno, node.end_lineno, "docstring")
    return Counter(kinds)


def _mark(kinds: list[str], first: int, last: int | None, kind: str) -> None:
    """Give lines that hold code a more exact kind; a docstring has its blank lines too."""
    for number in range(first - 1, last or first):
        if kind == "docstring" or kinds[number] == "code":
            kinds[number] = kind


def _output(program: str, package: Path) -> str:
    environment = {**os.environ, "PYTHONPATH": str(package.parent)}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    return done.stdout


def figures(package: Path) -> dict[str, tuple[float, list[str]]]:
    """Each figure with the places behind it."""
    texts = {file: file.read_text(encoding="utf-8") for file in files(package)}
    trees = {file: parsed(file) for file in texts}
    kinds: Counter[str] = Counter()
    folders: Counter[str] = Counter()
    for file, text in texts.items():
        kinds += kinds_of_lines(text, trees[file])
        folders["/".join(file.relative_to(package).parts[:-1][:2]) or "."] += len(text.splitlines())
    names, banned = 0, []
    named, participles = 0, []
    classes: dict[str, list[str]] = defaultdict(list)
    numbers, sourced = [], 0
    meanings: dict[str, set[str]] = defaultdict(set)
    for file, tree in trees.items():
        for name, node in assigned_names(tree):
            names += 1
            if name.strip("_") in BANNED:
                banned.append(f"{place(package, file, node)} {name}")
        for function in functions(tree):
            named += 1
            if is_participle(function.name):
                participles.append(f"{place(package, file, function)} {function.name}")
        for node in nodes(tree):
            if isinstance(node, ast.ClassDef):
                classes[node.name.strip("_")].append(place(package, file, node))
        for name, node, text in constants(tree):
            numbers.append(f"{place(package, file, node)} {name}")
            sourced += bool(PINNED.search(text))
            meanings[name.strip("_")].add(str(file))
    doubles = [f"{name}: {', '.join(places)}" for name, places in sorted(classes.items()) if len(places) > 1]
    messages = next(iter(package.rglob("messages.toml")))
    codes = tomllib.loads(messages.read_text(encoding="utf-8"))
    entries = [
        entry.name for entry in sorted(package.iterdir()) if entry.name != "__pycache__" and entry.suffix != ".so"
    ]
    with (package.parent.parent / "pyproject.toml").open("rb") as file_:
        (contract, *_) = tomllib.load(file_)["tool"]["importlinter"]["contracts"]
    upward = [entry for entry in contract["ignore_imports"] if entry != "gmwm.** -> gmwm"]
    return {
        "lines": (kinds.total(), [f"{count:>6} {name}" for name, count in (kinds + folders).most_common()]),
        "files": (len(trees), []),
        "entries": (len(entries), entries),
        "locals": (round(100 * len(banned) / names, 2), banned),
        "participles": (round(100 * len(participles) / named, 2), participles),
        "classes": (len(doubles), doubles),
        "constants": (len(numbers), numbers),
        "sourced": (round(100 * sourced / len(numbers)), []),
        "constant_names": (
            max(map(len, meanings.values())),
            [f"{k}: {len(v)}" for k, v in meanings.items() if len(v) > 1],
        ),
        "codes": (len(_codes(codes)), sorted(_codes(codes))),
        "upward": (len(upward), upward),
    }


def words_of_documents(docs: Path = ROOT / "docs") -> list[tuple[int, Path]]:
    """Words of each page for users, as `wc -w` counts them, the longest first. Pages for contributors are left out.

    Appendices that the site makes from the records of studies are not in the folder.
    """
    pages = [page for page in docs.rglob("*.md") if docs / "contributing" not in page.parents]
    return sorted(((len(page.read_text(encoding="utf-8").split()), page) for page in pages), reverse=True)


def _codes(table: dict[str, object]) -> list[str]:
    """Codes of messages: the tables that have a severity."""
    codes = []
    for name, entry in table.items():
        if isinstance(entry, dict):
            codes += [name] if "severity" in entry else _codes(entry)
    return codes


MEANING = {
    "lines": "lines of Python",
    "files": "files of Python",
    "entries": "entries at the top of the package",
    "locals": "% of assigned local names that are pronouns or participles",
    "participles": "% of functions named by a participle",
    "classes": "names of classes with more than one meaning",
    "constants": "numeric constants of modules",
    "sourced": "% of these with a source",
    "constant_names": "most modules that use one name for a constant",
    "codes": "codes of messages",
    "upward": "upward imports in methods",
    "words": "words of the documentation for users",
    "modules": "modules loaded by the name gmwm.calibrate",
    "rooms": "rooms that calibrate(data) visits",
}


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", nargs="?", type=Path, default=ROOT / "src" / "gmwm")
    parser.add_argument("--list", choices=MEANING)
    options = parser.parse_args()
    package = options.package.resolve()
    every = figures(package)
    pages = words_of_documents()
    every["words"] = (sum(count for count, _ in pages), [f"{count} {page.relative_to(ROOT)}" for count, page in pages])
    every["modules"] = (len(loaded := modules_of_calibrate(package)), loaded)
    every["rooms"] = (len(steps := rooms_of_calibrate(package)), steps)
    if options.list:
        print("\n".join(every[options.list][1]))
        return
    for name, meaning in MEANING.items():
        print(f"{every[name][0]:>8g}  {meaning} ({name})")


if __name__ == "__main__":
    main()
