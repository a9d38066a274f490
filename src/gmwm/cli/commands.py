"""The commands of `gmwm`, each of which is imported when it is used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import Any

import typer

from gmwm.cli.errors import OnceCommand, OneLineErrors
from gmwm.cli.output import one_line

NAMES = (
    "calibrate", "app", "fleet", "report", "info", "wv", "allan", "psd", "cross", "same", "fuse", "compare",
    "fit", "joint", "select", "track", "residuals", "watch", "monitor", "agree", "budget", "export", "plan", "convert",
    "simulate", "demo",
)  # fmt: skip
"""Names of the commands, in the order of the help. The function of a command is in the module with its name."""


class Commands(Mapping[str, Any]):
    """The commands by name, which are imported when they are looked up.

    Parameters
    ----------
    others : mapping of name to command
        Further commands, which a script has added.
    """

    def __init__(self, others: Mapping[str, Any]) -> None:
        self._names, self._load = (*NAMES, *others), dict(others)

    def __getitem__(self, name: str) -> Any:
        if name not in self._load and name in NAMES:
            self._load[name] = _load(name)
        return self._load[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class Program(OneLineErrors):
    """The command `gmwm` with its subcommands."""

    def __init__(self, **given: Any) -> None:
        super().__init__(**given)
        self.commands = Commands(self.commands)  # type: ignore[assignment]  # none is added or removed from here on

    def list_commands(self, ctx: typer.Context) -> list[str]:  # type: ignore[override]
        """Return the names of the commands, without importing them."""
        return list(self.commands)


def help_text(text: str | None) -> str:
    """Return a docstring with each paragraph on one line, so that the help wraps at the width of the terminal."""
    return "\n\n".join(one_line(paragraph) for paragraph in (text or "").split("\n\n"))


def _load(name: str) -> Any:
    """Import a command."""
    module = import_module(f"gmwm.cli.{name}")
    function = getattr(module, name)
    program = typer.Typer(rich_markup_mode="rich", pretty_exceptions_enable=False, add_completion=False)
    epilog = "\n\n".join(("Examples:", *module.EXAMPLES))
    program.command(name, cls=OnceCommand, help=help_text(function.__doc__), epilog=epilog)(function)
    return typer.main.get_command(program)
