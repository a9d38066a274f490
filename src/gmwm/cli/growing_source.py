"""Input for commands that read a text file or standard input while it is being written."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark

if TYPE_CHECKING:
    from gmwm.files.readers.growing_files import GrowingFile, GrowingPipe, Lines

Idle = Annotated[
    str | None,
    typer.Option(
        help="Stop after this time without new data. Default: stop at Ctrl-C or at the end of standard input.",
        metavar="LENGTH",
    ),
]


@contextmanager
def growing_source(file: str) -> Iterator[tuple[GrowingFile | GrowingPipe, Path]]:
    """Open a growing file, or standard input for "-", and yield its reader and its name."""
    from gmwm.files.readers.growing_files import GrowingFile, GrowingPipe

    if file != "-" and not Path(file).is_file():
        problem = "is not a file" if Path(file).exists() else "does not exist"
        raise OptionError(
            f"{file} {problem}", argument="file", got=file,
            advice="Pass a text file that is being written, or - for standard input.",
        )  # fmt: skip
    take = GrowingPipe(sys.stdin.buffer) if file == "-" else GrowingFile(Path(file))
    try:
        yield take, Path("standard input" if file == "-" else file)
    finally:
        take.close()


def remarks_on_end(take: GrowingFile | GrowingPipe, name: Path, lines: Lines) -> tuple[Remark, ...]:
    """Return remarks if reading ended because of a problem, or if the last line was incomplete."""
    remarks = [Remark.of("watch-ended", str(name), reason=take.trouble)] if take.trouble else []
    return (*remarks, *([Remark.of("last-line", str(name), case="left-out")] if lines.rest else []))


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C was pressed. A second Ctrl-C raises KeyboardInterrupt."""
    pressed = False

    def note(*_: Any) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: pressed
    finally:
        signal.signal(signal.SIGINT, before)
