"""Output of commands: the result as text or JSON on stdout, files, and warnings and progress bars on stderr."""

from __future__ import annotations

import codecs
import json
import sys
import textwrap
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TextIO, TypeVar

import typer

import gmwm
from gmwm.base.atomic_files import write_text, written_together
from gmwm.base.errors import FitWarning, GmwmError, GmwmWarning, OptionError
from gmwm.base.extras import is_installed, missing
from gmwm.base.remarks import Dialect, Remark, Severity, brief
from gmwm.base.remarks.rendering import MOST_REMARKS
from gmwm.base.reporting import warn
from gmwm.base.text import TEXT_WIDTH, with_minus
from gmwm.base.threads import in_threads

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

T = TypeVar("T")
Item = TypeVar("Item", bound="gmwm.Signal | gmwm.WaveletVariance")


def over_axes(work: Callable[[Item], T], signals: Mapping[str, Item], what: str) -> dict[str, T]:
    """Call a function for each axis in parallel threads; errors name it, and `what` labels the progress bar."""
    with progress(what, len(signals)) as advance:
        return in_threads(
            lambda _, signal: work(signal), signals, done=lambda axis: advance(f"{what}: {axis}")
        )  # fmt: skip


@dataclass(frozen=True)
class NewFile:
    """A file to write: its path, the function that writes it to a path, and the label of the progress bar."""

    path: Path
    write: Callable[[Path], object]
    label: str = ""


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """The result of a command, before it is printed and its files are written."""

    command: str  # name of the command
    document: Mapping[str, Any]  # the result for --json, without the remarks
    text: str = ""  # the result as text
    all_text: str = ""  # the text with all remarks, for --all-remarks; "" if `text` has all of them
    files: tuple[NewFile, ...] = ()  # files to write
    # whether all files are in one folder and are written together: if one fails, none is written
    together: bool = False
    obsolete: tuple[Path, ...] = ()  # files of an earlier run, which are removed after the new files are written
    # Files that the command has already written. The list of files starts with them.
    written: tuple[Path, ...] = ()
    listed: bool = True  # whether the paths of the files are printed after the text
    closing: str = ""  # text to print after the list of files
    # remarks of the command to print as warnings, in addition to the warnings of the library
    remarks: tuple[Remark, ...] = ()
    # Remarks that the text already contains. They are not printed as warnings; --json lists them with the others.
    in_text: tuple[Remark, ...] = ()
    failure: GmwmError | None = None  # the error to raise after the result is printed
    status: int = 0  # exit code if there is no failure
    # whether --json prints the document in one line, because the command has printed other lines of JSON before
    in_one_line: bool = False

    @property
    def paths(self) -> list[Path]:
        """Paths of all files of the result, those already written first."""
        return [*self.written, *(file.path for file in self.files)]


def finish(outcome: Outcome, warned: Warned, *, json: bool, every: bool = False) -> None:
    """Write a result's files, print it as text or JSON, and raise its failure, or `typer.Exit` for a code ≠ 0."""
    for remark in outcome.remarks:
        tell(remark)
    together = outcome.together and outcome.files
    with written_together(outcome.files[0].path.parent) if together else nullcontext() as folder:
        for file in outcome.files:
            with progress(file.label) if file.label else nullcontext():
                file.write(file.path if folder is None else folder / file.path.name)
        for path in outcome.obsolete:
            path.unlink(missing_ok=True)
    warned.show()
    if json:
        remarks = [*outcome.in_text, *warned.remarks]
        print_json(outcome.command, outcome.document, remarks, in_one_line=outcome.in_one_line)
    else:
        text = outcome.all_text if every and outcome.all_text else outcome.text
        if text:
            print(text, end="" if text.endswith("\n") else "\n")
        if outcome.listed and outcome.paths:
            print("", *_written(outcome.paths), sep="\n")
        if outcome.closing:
            print(outcome.closing)
    if outcome.failure is not None:
        raise outcome.failure
    if outcome.status:
        raise typer.Exit(outcome.status)


def _written(paths: Sequence[Path]) -> list[str]:
    """Return the lines that name the written files: one path, or the names of the files in each folder."""
    if len(paths) == 1:
        return [f"Wrote {paths[0]}"]
    folders: dict[Path, list[str]] = {}
    for path in paths:
        folders.setdefault(path.parent, []).append(path.name)
    return [
        line
        for folder, names in folders.items()
        for line in textwrap.wrap(f"Wrote to {folder}: {', '.join(names)}", TEXT_WIDTH, subsequent_indent="  ",
                                  break_long_words=False, break_on_hyphens=False)
    ]  # fmt: skip


def text_file(path: Path, text: str) -> NewFile:
    """Return a file to write that contains a text."""
    return NewFile(path, lambda target: write_text(target, text))


def plot_file(path: Path | None, draw: Callable[[Path], object]) -> tuple[NewFile, ...]:
    """Return the file of the option --plot; an empty tuple if the option is not given."""
    return () if path is None else (NewFile(path, draw, f"plotting {path.name}"),)


def optional_plots(*files: NewFile) -> tuple[NewFile, ...]:
    """Return the plots of the option --output; without Matplotlib none, and a line on stderr says so."""
    if is_installed("matplotlib"):
        return files
    print(f"note: {missing('matplotlib')}", file=sys.stderr)
    return ()


def csv_file(
    path: Path | None, head: str, tables: Iterable[tuple[Sequence[str], Sequence[ArrayLike]]]
) -> tuple[NewFile, ...]:
    """Return the file of the option --csv. Each table has texts, which begin its rows, and columns of equal length."""
    if path is None:
        return ()
    import numpy as np

    rows = [
        ",".join([*texts, *map(str, row)])
        for texts, columns in tables
        for row in zip(*(np.asarray(column).tolist() for column in columns), strict=True)
    ]
    return (text_file(path, "\n".join([head, *rows]) + "\n"),)


def file_names(files: Sequence[NewFile]) -> list[str]:
    """Return the paths of files to write, for --json."""
    return [str(file.path) for file in files]


class Advance(Protocol):
    """Function that advances a progress bar."""

    def __call__(self, text: str, steps: int = 1, /) -> None:
        """Advance the bar by a number of steps, and show a text that describes the current work."""


def print_json(
    command: str, content: Mapping[str, Any], remarks: Iterable[Remark], *, in_one_line: bool = False
) -> None:
    """Print a result as JSON (ASCII unless stdout is UTF-8) with its own remarks, then the others."""
    escaped = codecs.lookup(sys.stdout.encoding or "utf-8").name != "utf-8"
    entries = list(content.get("remarks", ()))
    entries += [entry for entry in (remark.to_dict() for remark in dict.fromkeys(remarks)) if entry not in entries]
    print(json_text(command, {**content, "remarks": entries}, escaped=escaped, in_one_line=in_one_line))


def json_text(command: str, content: Mapping[str, Any], *, escaped: bool = False, in_one_line: bool = False) -> str:
    """Format a command's result as JSON with gmwm's version, null for NaN and infinities; `escaped` is ASCII.

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
    from gmwm.base.documents import indented_json, plain

    document = plain({"gmwm": __version__, "command": command, **content})
    if in_one_line:
        return json.dumps(document, allow_nan=False, ensure_ascii=escaped)
    return indented_json(document, escaped=escaped)


def table_text(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "", texts: int = 1, rules: Sequence[int] = ()
) -> str:
    """Format a table as wide as its contents: the first `texts` columns left-aligned, lines below `rules`."""
    from rich import box
    from rich.console import Console
    from rich.table import Table

    table = Table(
        title=title or None, title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False,
        padding=(0, 1),
    )  # fmt: skip
    for k, column in enumerate(columns):
        table.add_column(column, justify="left" if k < texts else "right", no_wrap=True)
    for k, row in enumerate(rows):
        table.add_row(*map(with_minus, row), end_section=k in rules)
    console = Console(highlight=False, markup=False, width=10_000)
    with console.capture() as captured:
        console.print(table)
    lines = (line.rstrip() for line in captured.get().splitlines())
    return "\n".join(lines).strip("\n")


def units_text(units: Mapping[str, str]) -> str:
    """Format the units of parameters in one line, with each parameter name once."""
    of = {name.rpartition(".")[2]: unit for name, unit in units.items() if unit}
    # If two parameters with the same short name have different units, such as σ² of GM and of AR1, use full names.
    if len(set(of.items())) != len({(name.rpartition(".")[2], unit) for name, unit in units.items() if unit}):
        of = dict(units)
    return "in " + ", ".join(f"{unit} ({name})" for name, unit in of.items())


class Warned:
    """Remarks of a command that are printed as warnings on stderr: the five most severe, or all if `every` is true."""

    def __init__(self, *, every: bool) -> None:
        self.remarks: list[Remark] = []
        self._every, self._shown = every, False

    def add(self, remark: Remark) -> None:
        """Add a remark, unless the same remark was added before."""
        if remark not in self.remarks:
            self.remarks.append(remark)

    def show(self) -> None:
        """Print the remarks on stderr. A second call prints nothing."""
        if self._shown:
            return
        self._shown = True
        remarks = [remark for remark in self.remarks if remark.severity is not Severity.INFO or self._every]
        most = len(remarks) if self._every else MOST_REMARKS
        for text in brief(remarks, Dialect.SHELL, rest="--all-remarks", most=most):
            print(f"warning: {one_line(text)}", file=sys.stderr)
        if remarks and sys.stderr.isatty():
            print("gmwm explain CODE says more about a message.", file=sys.stderr)


@contextmanager
def collect_warnings(*, every: bool = False) -> Iterator[Warned]:
    """Collect GmwmWarnings in the block, and print them at its end, but no FitWarning, whose remark is in the text."""
    warned = Warned(every=every)

    def show(
        message: Warning | str, category: type[Warning], filename: str, lineno: int, file: TextIO | None = None,
        line: str | None = None,
    ) -> None:  # fmt: skip
        if not isinstance(message, GmwmWarning):
            print(f"{category.__name__}: {message} ({filename}:{lineno})", file=sys.stderr)
        elif not isinstance(message, FitWarning):
            warned.add(message.remark)

    with warnings.catch_warnings():
        warnings.simplefilter("always", GmwmWarning)
        warnings.showwarning = show
        try:
            yield warned
        finally:
            warned.show()


def tell(remark: Remark) -> None:
    """Add a remark to the warnings of the command. `collect_warnings` prints it."""
    warn(GmwmWarning(remark), stacklevel=2)


def one_line(text: str) -> str:
    """Join the lines of a text with single spaces.

    >>> one_line("a first\\n   and a second")
    'a first and a second'
    """
    return " ".join(text.split())


def calibration_file(path: Path) -> Path:
    """Return the path of a calibration.json: the path itself, or the file in it if the path is a folder."""
    return path / "calibration.json" if path.is_dir() else path


def make_directory(path: Path, argument: str = "output") -> Path:
    """Create a directory and its parents if they do not exist, and return the path."""
    if path.exists() and not path.is_dir():
        raise OptionError(
            argument=argument, expected="a directory", got=str(path), advice="{path} is a file.", path=str(path)
        )
    path.mkdir(parents=True, exist_ok=True)
    return path


@contextmanager
def progress(what: str, steps: int | None = None) -> Iterator[Advance]:
    """Show a progress bar on stderr while the block runs, and remove it at the end. Only a terminal shows a bar."""
    if not sys.stderr.isatty():
        yield lambda text, steps=1, /: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(bar_width=24), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=steps)
        yield lambda text, steps=1, /: bar.update(task, advance=steps, description=text)
