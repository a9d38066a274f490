"""Run the statistical studies: `python -m validation [--reduced] [--output DIRECTORY] [NAME ...]`.

`--tables` prints all tables of studies that were run, and `--pages` writes their pages again.

A study is a module `study_<something>.py` in this folder with

- `NAME`: its name, and that of its files (letters, digits and hyphens),
- `SEED`: the integer from which everything random in it follows,
- `run(reduced: bool) -> dict`: the result, with the numbers under "rows"; `reduced` is what the tests run,
- `table(result: dict) -> str`: the result as Markdown,
- and, where there is something to see, `draw(result: dict, path: Path)`, which writes its picture.

Each study becomes `<NAME>.json` and a page `<NAME>.md` (validation/pages.py) in docs/validation, both or neither; where
there is a picture, that is `<NAME>.svg`. They hold no date and no timing: the same seed and the same versions give the
same bytes. The one exception is the comparison of methods, which tells how long each takes.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from pathlib import Path
from pkgutil import iter_modules
from types import ModuleType
from typing import Any

import gmwm
import validation
from gmwm.base.atomic_files import written_whole
from validation.pages import appendix, page, write

DOCUMENTS = Path(__file__).resolve().parent.parent / "docs" / "validation"
VERSIONS = ("gmwm", "numpy", "scipy")


@dataclass(frozen=True)
class Record:
    """A study that was run, as it is written."""

    name: str
    json: str
    markdown: str

    def write(self, directory: Path) -> None:
        # Both texts exist before either file does, so a study that fails leaves the last record as it was.
        with (
            written_whole(directory / f"{self.name}.json") as data,
            written_whole(directory / f"{self.name}.md") as words,
        ):
            data.write_text(self.json, encoding="utf-8")
            words.write_text(self.markdown, encoding="utf-8")


def find_studies() -> dict[str, ModuleType]:
    """Every study in this folder by its name, in the order of the names.

    Raises
    ------
    TypeError
        If a module named study_* lacks what a study has, or takes another's name.
    """
    studies: dict[str, ModuleType] = {}
    for found in iter_modules(validation.__path__):
        if not found.name.startswith("study_"):
            continue
        module = import_module(f"validation.{found.name}")
        lacking = [name for name in ("NAME", "SEED", "run", "table") if not hasattr(module, name)]
        if lacking:
            raise TypeError(f"validation/{found.name}.py must define {', '.join(lacking)}; see validation/__main__.py")
        if not re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", module.NAME) or module.NAME in studies:
            raise TypeError(
                f"NAME in validation/{found.name}.py must be lower-case words joined by hyphens, "
                f"and its own, got {module.NAME!r}"
            )
        studies[module.NAME] = module
    return dict(sorted(studies.items()))


def run_study(study: ModuleType, *, reduced: bool = False) -> Record:
    """Run one study and put its result into words; nothing is written."""
    with warnings.catch_warnings():
        # A term that the data do not show is part of what is studied.
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        result = study.run(reduced)
    if not result.get("rows"):
        raise ValueError(f"study {study.NAME} gave no rows: its result must hold the numbers under 'rows'")
    head = {
        "study": study.NAME,
        "reduced": reduced,
        "seed": study.SEED,
        "versions": {package: version(package) for package in VERSIONS},
    }
    try:
        text = json.dumps(head | result | head, indent=1, ensure_ascii=False, allow_nan=False, default=_plain)
    except ValueError as error:
        raise ValueError(f"study {study.NAME} has a NaN or an infinity in its result") from error
    return Record(study.NAME, text + "\n", page(study, head | result | head))


def stored(study: ModuleType) -> dict[str, Any]:
    """The result of a study that was run."""
    content: dict[str, Any] = json.loads((DOCUMENTS / f"{study.NAME}.json").read_text(encoding="utf-8"))
    return content


def _plain(value: Any) -> Any:
    """NumPy's numbers and arrays as Python's, which JSON knows."""
    if hasattr(value, "tolist"):
        return value.tolist()
    raise TypeError(f"a result holds numbers, texts, lists and mappings, got {type(value).__name__}")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the studies named, or all; print each table and write each record."""
    parser = argparse.ArgumentParser(prog="python -m validation", description="Run the statistical studies.")
    parser.add_argument("names", nargs="*", metavar="NAME", help="studies to run; all of them by default")
    parser.add_argument("--reduced", action="store_true", help="the short version; written only where --output says")
    parser.add_argument("--tables", action="store_true", help="print all tables of studies that were run")
    parser.add_argument("--pages", action="store_true", help="write the pages of studies that were run")
    parser.add_argument("--output", type=Path, metavar="DIRECTORY", help="default: docs/validation")
    options = parser.parse_args(arguments)
    studies = find_studies()
    if unknown := sorted(set(options.names) - set(studies)):
        parser.error(f"no study called {', '.join(unknown)}; there are: {', '.join(studies) or 'none'}")
    if options.tables or options.pages:
        for name in options.names or [name for name in studies if (DOCUMENTS / f"{name}.json").is_file()]:
            if options.tables:
                print(appendix(studies[name], stored(studies[name])))
            if options.pages:
                write(studies[name], stored(studies[name]), DOCUMENTS)
        return 0
    # A reduced run must not take the place of the record of a full one.
    directory = options.output or (None if options.reduced else DOCUMENTS)
    for name in options.names or studies:
        record = run_study(studies[name], reduced=options.reduced)
        print(record.markdown, flush=True)
        if directory is not None:
            record.write(directory)
            if draw := getattr(studies[name], "draw", None):
                draw(json.loads(record.json), directory / f"{name}.svg")
            print(f"wrote {directory / name}.json and .md{' and .svg' if draw else ''}\n", flush=True)
    if not studies:
        print("there are no studies yet: none of validation/study_*.py exists")
    return 0


if __name__ == "__main__":
    sys.exit(main())
