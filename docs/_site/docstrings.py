"""The package's docstrings for Sphinx: plain text with formulas in it; late methods as the methods that they are."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable
from importlib import import_module
from pkgutil import walk_packages
from typing import TYPE_CHECKING, Any

import gmwm
from gmwm._late import LateMethod, LateProperty

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MARKS = re.compile(r"(``[^`\n]+``|`[^`\n]+`)|([|*]|_(?=\W|$))")
"""Between backticks, or what reStructuredText would take for markup: |x|, 2*GM, a_ at the end of a word."""
PAGE = re.compile(r"\bdocs/([\w/-]+)\.md\b")
RULE = re.compile("-{3,}")
SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Yields")


def as_text(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Take |ω| and 2*GM for what they are; only backticks mark anything in our docstrings, and examples stay.

    An example after a section of parameters or errors becomes a section of its own, as it would count as one of them.
    """
    # An attribute's words are not "type: words", as napoleon takes a colon in the first line to mean.
    written = [""] if what in ("attribute", "property") else []
    section, in_example = "", False
    for line, following in zip(lines, [*lines[1:], ""], strict=True):
        if RULE.fullmatch(following):
            section = line
        starts = line.lstrip().startswith(">>>")
        if starts and not in_example and line.startswith(">>>") and section in SECTIONS:
            section = "Examples"
            written += [section, "-" * len(section)]
        in_example = starts or (in_example and bool(line.strip()))
        written.append(line if in_example else _marked(line))
    lines[:] = written


def _marked(line: str) -> str:
    """A line of plain text as Sphinx reads it, with the pages that it names as links."""
    escaped = MARKS.sub(lambda found: found[1] or f"\\{found[2]}", line)
    return PAGE.sub(r":doc:`/\1`", escaped)


def late_members() -> list[tuple[type, str, LateMethod[..., Any] | LateProperty[Any]]]:
    """Every late method and property of the package, with its class."""
    found = {}
    for module in walk_packages(gmwm.__path__, "gmwm."):
        if module.name == "gmwm.__main__":
            continue
        for _, owner in inspect.getmembers(import_module(module.name), inspect.isclass):
            if owner.__module__.startswith("gmwm"):
                late = {
                    name: value for name, value in vars(owner).items() if isinstance(value, LateMethod | LateProperty)
                }
                found.update({(owner, name): value for name, value in late.items()})
    return [(owner, name, value) for (owner, name), value in found.items()]


def as_method(owner: type, name: str, late: LateMethod[..., Any]) -> Callable[..., Any]:
    """A function like the one behind a late method: its signature, and its words but for those of the object."""
    target = late.resolve()

    def method(*args: Any, **kwargs: Any) -> Any:
        return target(*args, **kwargs)

    words = inspect.getdoc(target) or late.__doc__ or ""
    first = next(iter(inspect.signature(target).parameters))
    method.__doc__ = _without_parameter(words, first)
    method.__signature__ = inspect.signature(target)  # type: ignore[attr-defined]
    method.__name__, method.__module__, method.__qualname__ = name, owner.__module__, f"{owner.__qualname__}.{name}"
    return method


def _without_parameter(words: str, name: str) -> str:
    """Without the entry of a parameter, and without a section that it was alone in."""
    words = re.sub(rf"^{re.escape(name)} : .*\n(?:(?: +.*)?\n)*?(?=\S|\Z)", "", words, count=1, flags=re.MULTILINE)
    return re.sub(r"^Parameters\n-+\n\s*(?=^\w+\n-+\n|\Z)", "", words, flags=re.MULTILINE)


def bind(app: Sphinx) -> None:
    """Put the methods where the late ones are: for this process, which only writes the site."""
    for owner, name, late in late_members():
        if isinstance(late, LateMethod):
            setattr(owner, name, as_method(owner, name, late))
        else:
            setattr(owner, name, property(late.resolve(), doc=late.__doc__))


def setup(app: Sphinx) -> dict[str, bool]:
    """Before napoleon, which reads the sections, and before anything is documented."""
    app.connect("builder-inited", bind)
    app.connect("autodoc-process-docstring", as_text, priority=100)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
