"""What gmwm reports while it works: warnings and steps, also through the logger "gmwm", and progress bars."""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from html import escape
from importlib import import_module
from typing import Any, Literal

from gmwm.base.errors import GmwmWarning
from gmwm.base.remarks import Severity

LOGGER = logging.getLogger("gmwm")
LOGGER.addHandler(logging.NullHandler())  # nothing is printed unless the program configures logging

Progress = Callable[[int, int, str], object]
"""Function of the number of finished steps, the number of all steps, and a description of the last step."""


def warn(warning: GmwmWarning, stacklevel: int = 2) -> None:
    """Issue a warning and log it; `stacklevel` is that of `warnings.warn` in the caller."""
    level = logging.INFO if warning.remark.severity is Severity.INFO else logging.WARNING
    LOGGER.log(level, "%s", warning, extra={"code": warning.remark.code})
    warnings.warn(warning, stacklevel=stacklevel + 1)


@contextmanager
def reported(progress: Progress | Literal[True] | None, title: str) -> Iterator[Progress]:
    """Provide a function that logs each step and passes it on to `progress`, or to a progress bar if it is True."""
    with _bar(title) if progress is True else _unchanged(progress) as show:

        def report(done: int, steps: int, text: str) -> None:
            LOGGER.info("%s: %d of %d, %s", title, done, steps, text)
            if show is not None:
                show(done, steps, text)

        yield report


@contextmanager
def _unchanged(progress: Progress | None) -> Iterator[Progress | None]:
    yield progress


@contextmanager
def _bar(title: str) -> Iterator[Progress]:
    """Show a progress bar: below the cell of a notebook, or on stderr."""
    ipython: Any = sys.modules.get("IPython")
    if ipython is not None and hasattr(ipython.get_ipython(), "kernel"):
        cell: Any = import_module("IPython.display")
        handle = cell.display(cell.HTML(bar_html(title, 0, 1, "")), display_id=True)
        yield lambda done, steps, text: handle.update(cell.HTML(bar_html(title, done, steps, text)))
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(bar_width=24), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title)
        yield lambda done, steps, text: bar.update(task, completed=done, total=steps, description=text)


def bar_html(title: str, done: int, steps: int, text: str) -> str:
    """Return a progress bar as HTML.

    >>> bar_html("calibrating", 1, 4, "gyro_x: fit")
    '<progress value="1" max="4"></progress> calibrating: 1 of 4, gyro_x: fit'
    """
    state = f"{done} of {steps}, {escape(text)}" if text else "…"
    return f'<progress value="{done}" max="{steps}"></progress> {escape(title)}: {state}'
