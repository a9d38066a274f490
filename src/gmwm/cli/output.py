"""The result of a command and its output: text or JSON on stdout, files, warnings and progress on stderr."""

from __future__ import annotations

import codecs
import json
import math
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TextIO

from gmwm._files import write_text, written_together
from gmwm.cli.errors import as_options, one_line
from gmwm.errors import FitWarning, GmwmError, GmwmWarning, OptionError

if TYPE_CHECKING:
    from gmwm.signals import Imu


@dataclass(frozen=True)
class NewFile:
    """A file to write: its path, the function that writes it whole, and the label of the progress bar."""

    path: Path
    write: Callable[[Path], object]
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The result of a command, before anything of it is printed or written.

    Attributes
    ----------
    command : str
        Name of the command.
    document : mapping
        The result for --json, without the warnings.
    text : str
        The result for a reader.
    files : tuple of NewFile
        Files to write.
    together : bool
        Whether the files belong to one folder and are written all or none.
    obsolete : tuple of Path
        Files of an earlier run to remove when the new ones are there.
    written : tuple of Path
        Files that the library has written already; they are listed before the others.
    listed : bool
        Whether the files are listed after the text.
    closing : str
        Text after the list of files.
    remarks : tuple of str
        Warnings that neither the library nor the text has.
    in_text : tuple of str
        Warnings that the text contains; --json has them among its warnings.
    failure : GmwmError or None
        The error to end with, after the result of what came before it.
    """

    command: str
    document: Mapping[str, Any]
    text: str = ""
    files: tuple[NewFile, ...] = ()
    together: bool = False
    obsolete: tuple[Path, ...] = ()
    written: tuple[Path, ...] = ()
    listed: bool = True
    closing: str = ""
    remarks: tuple[str, ...] = ()
    in_text: tuple[str, ...] = ()
    failure: GmwmError | None = None

    @property
    def paths(self) -> list[Path]:
        """All files of the result."""
        return [*self.written, *(file.path for file in self.files)]


def finish(outcome: Outcome, warned: Sequence[str], *, json: bool) -> None:
    """Write the files of a result, and print it as text or as JSON with what was `warned` of."""
    for remark in (*(outcome.in_text if json else ()), *outcome.remarks):
        tell(remark)
    _write_files(outcome)
    if json:
        print_json(outcome.command, outcome.document, warned)
    else:
        if outcome.text:
            print(outcome.text, end="" if outcome.text.endswith("\n") else "\n")
        if outcome.listed and outcome.paths:
            print("\nWrote", *(f"  {path}" for path in outcome.paths), sep="\n")
        if outcome.closing:
            print(outcome.closing)
    if outcome.failure is not None:
        raise outcome.failure


def _write_files(outcome: Outcome) -> None:
    if not outcome.together or not outcome.files:
        for file in outcome.files:
            with progress(file.label) if file.label else nullcontext():
                file.write(file.path)
        return
    with written_together(outcome.files[0].path.parent) as room:
        for file in outcome.files:
            with progress(file.label) if file.label else nullcontext():
                file.write(room / file.path.name)
        for path in outcome.obsolete:
            path.unlink(missing_ok=True)


def text_file(path: Path, text: str) -> NewFile:
    """A file with this text."""
    return NewFile(path, lambda target: write_text(target, text))


def file_names(files: Sequence[NewFile]) -> list[str]:
    """The paths of files to write, as --json has them."""
    return [str(file.path) for file in files]


class Advance(Protocol):
    """Moves a progress bar by one step, or so many, which the text describes."""

    def __call__(self, text: str, steps: int = 1, /) -> None:
        """Move on."""


def print_json(command: str, content: Mapping[str, Any], warned: Sequence[str]) -> None:
    """The result of a command on stdout, as `json_text` has it, escaped where stdout is not in UTF-8."""
    escaped = codecs.lookup(sys.stdout.encoding or "utf-8").name != "utf-8"
    print(json_text(command, {**content, "warnings": list(warned)}, escaped=escaped))


def json_text(command: str, content: Mapping[str, Any], *, escaped: bool = False) -> str:
    """The result of a command as JSON, with the version; NaN and infinities are null.

    All that is not ASCII is `escaped` if so asked, as \\u00b2 for ².

    >>> print(json_text("wv", {"limits": [1.0, float("inf")]}))
    {
     "gmwm": "...",
     "command": "wv",
     "limits": [
      1.0,
      null
     ]
    }
    """
    from gmwm import __version__

    document = _plain({"gmwm": __version__, "command": command, **content})
    return json.dumps(document, allow_nan=False, ensure_ascii=escaped, indent=1)


def _plain(value: Any) -> Any:
    """`value` with what JSON has no word for replaced: NaN and infinities by null, NumPy numbers by numbers."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def table_text(
    columns: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    title: str = "",
    texts: int = 1,
    rules: Sequence[int] = (),
) -> str:
    """A table; the first `texts` columns are texts, the others numbers; a rule follows the rows in `rules`.

    Bold heads on a terminal, plain text elsewhere. It is as wide as it must be: nothing wraps or is cut.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        title=title or None,
        title_justify="left",
        title_style="bold",
        box=box.SIMPLE_HEAD,
        pad_edge=False,
        padding=(0, 1),
    )
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k < texts else "right", no_wrap=True)
    for k, row in enumerate(rows):
        table.add_row(*row, end_section=k in rules)
    console = Console(highlight=False, markup=False, width=10_000)
    with console.capture() as captured:
        console.print(table)
    lines = (line.rstrip() for line in captured.get().splitlines())
    return "\n".join(lines).strip("\n")


def units_text(units: Mapping[str, str]) -> str:
    """The units of parameters in a line, each name once."""
    of = {name.rpartition(".")[2]: unit for name, unit in units.items() if unit}
    # A name may stand for two units (σ² of GM and of AR1): then the parameters are named in full.
    if len(set(of.items())) != len({(name.rpartition(".")[2], unit) for name, unit in units.items() if unit}):
        of = dict(units)
    return "in " + ", ".join(f"{unit} ({name})" for name, unit in of.items())


@contextmanager
def told_warnings() -> Iterator[list[str]]:
    """Print each GmwmWarning as one line on stderr, once; yields the list of those printed so far.

    Those of fits are left to `Fit.diagnostics`, where they stand beside the axis.
    """
    told: list[str] = []

    def show(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        if not issubclass(category, GmwmWarning):
            print(f"{category.__name__}: {message} ({filename}:{lineno})", file=sys.stderr)
        elif not issubclass(category, FitWarning):
            text = as_options(one_line(str(message)))
            if text not in told:
                told.append(text)
                print(f"warning: {text}", file=sys.stderr)

    with warnings.catch_warnings():
        warnings.simplefilter("always", GmwmWarning)
        warnings.showwarning = show
        yield told


def tell(message: str) -> None:
    """Warn the user at once; `told_warnings` prints it."""
    warnings.warn(message, GmwmWarning, stacklevel=2)


def tell_cautions(imu: Imu) -> None:
    """Print what an inspection warns of, as motion and knocks, for who did not ask for one."""
    from gmwm.inspection import inspect

    with progress("inspecting"):
        inspection = inspect(imu)
    for warning in inspection.warnings:
        tell(warning)


def calibration_file(path: Path) -> Path:
    """The calibration.json at `path`, or in the folder that `gmwm calibrate --output` wrote."""
    return path / "calibration.json" if path.is_dir() else path


def made_directory(path: Path, option: str = "--output") -> Path:
    """The directory `path`, made with those above it where there is none."""
    if path.exists() and not path.is_dir():
        raise OptionError(f"{option} must be a directory, {path} is a file; name another one")
    path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def progress(what: str, steps: int | None = None) -> Iterator[Advance]:
    """A progress bar on stderr while the block runs, if that is a terminal; it leaves nothing behind."""
    if not sys.stderr.isatty():
        yield lambda text, steps=1, /: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(bar_width=24), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=steps)
        yield lambda text, steps=1, /: bar.update(task, advance=steps, description=text)
