"""The package's docstrings for Sphinx: plain text with formulas in it."""

from __future__ import annotations

import inspect
import re
import sys
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from sphinx.application import Sphinx

MARKS = re.compile(r"(``[^`\n]+``|`[^`\n]+`)|([|*]|_(?=\W|$))")
"""Between backticks, or what reStructuredText would take for markup: |x|, 2*GM, a_ at the end of a word."""
PAGE = re.compile(r"\bdocs/([\w/-]+)\.md\b")
RULE = re.compile("-{3,}")
SECTIONS = ("Parameters", "Attributes", "Returns", "Raises", "Yields")
ENTRY = re.compile(r"^\.\. auto(?:function|class|exception):: (gmwm\.\S+)$", re.MULTILINE)
FORMULAS = "formulas"
CONSTANT = re.compile(r"=([A-Z][A-Z_]+)\b")
"""A default that the code has a name for."""


def as_text(app: Sphinx, what: str, name: str, thing: object, options: object, lines: list[str]) -> None:
    """Take |ω| and 2*GM for what they are; only backticks mark anything in our docstrings, and examples stay.

    An example after a section of parameters or errors becomes a section of its own, as it would count as one of them.
    """
    lines[:] = with_returned(thing, lines)
    # An attribute's words are not "type: words", as napoleon takes a colon in the first line to mean.
    written = ["\\ "] if what in ("attribute", "property") else []
    section, in_example = "", False
    link = Links(name, thing)
    for before, line, following in zip(["", *lines[:-1]], lines, [*lines[1:], ""], strict=True):
        if RULE.fullmatch(following):
            section = line
        starts = line.lstrip().startswith(">>>")
        if starts and not in_example and line.startswith(">>>") and section in SECTIONS:
            section = "Examples"
            written += [section, "-" * len(section)]
        in_example = starts or (in_example and bool(line.strip()))
        if not section and line.startswith(" ") and not before.strip() and not in_example:
            written += [".. code-block:: text", "   :class: formulas", ""]
            section = FORMULAS
        elif section == FORMULAS and line and not line.startswith(" "):
            section = ""
        if in_example or section == FORMULAS:
            written.append(line)
        else:
            is_type = section in SECTIONS and section != "Raises" and not line.startswith(" ")
            written.append(_marked(link.types(line) if is_type else line, link))
    lines[:] = written


def with_returned(thing: object, lines: list[str]) -> list[str]:
    """Words about parameters, with a section for the type that the function returns unless they have one."""
    kind = getattr(getattr(thing, "__func__", thing), "__annotations__", {}).get("return")
    sections = [k - 1 for k, line in enumerate(lines) if RULE.fullmatch(line)]
    if kind in (None, "None") or "Parameters" not in lines or "Returns" in lines or inspect.isclass(thing):
        return lines
    place = next((k for k in sections if lines[k] != "Parameters"), len(lines))
    return [*lines[:place], "Returns", "-------", str(kind), "", *lines[place:]]


def _marked(line: str, link: Links) -> str:
    """A line of plain text as Sphinx reads it, with the pages and the names of the API that it names as links."""
    escaped = MARKS.sub(lambda found: link.name(found[1]) if found[1] else f"\\{found[2]}", line)
    return PAGE.sub(r":doc:`/\1`", escaped)


@cache
def documented() -> dict[str, str]:
    """What the API pages have, by the shortest name: "Fit" is gmwm.Fit, "Entry" gmwm.datasheets.Entry."""
    pages = (Path(__file__).parents[1] / "api").glob("*.md")
    names = [name for page in sorted(pages) for name in ENTRY.findall(page.read_text(encoding="utf-8"))]
    return {name.rpartition(".")[2]: name for name in names}


class Links:
    """Links from the words about one thing to what else the API has; none to itself."""

    def __init__(self, name: str, thing: object) -> None:
        self.itself = name
        self.owner = name if inspect.isclass(thing) else name.rpartition(".")[0]
        # The words of a class tell what its methods take.
        takers = [thing, *vars(thing).values()] if inspect.isclass(thing) else [thing]
        self.taken: set[str] = set()
        for taker in takers:
            function = getattr(taker, "__func__", taker)
            if inspect.isfunction(function):
                self.taken.update(inspect.signature(function).parameters)

    def types(self, line: str) -> str:
        """The line "name : type" or "type", with the classes in the type as links."""
        name, colon, kind = line.rpartition(" : ")
        if RULE.fullmatch(line) or "`" in line or line in SECTIONS:
            return line
        classes = {short: full for short, full in documented().items() if short[0].isupper() and full != self.itself}
        words = re.sub(
            r"(?<![\w.\"'(])[A-Z]\w+(?![\w(=])",
            lambda found: f":py:class:`{found[0]} <{classes[found[0]]}>`" if found[0] in classes else found[0],
            kind,
        )
        return name + colon + words

    def name(self, marked: str) -> str:
        """What stands between backticks, as a link where it is a name of the API and not one of its own parameters."""
        text = marked.strip("`")
        bare = text.removesuffix("()")
        first, _, rest = bare.removeprefix("gmwm.").partition(".")
        if not re.fullmatch(r"[\w.]+", bare) or (first in self.taken and not rest):
            return marked
        if first in documented():
            full = ".".join(filter(None, (documented()[first], rest)))
        elif self.owner.rpartition(".")[2] in documented() and not rest and _is_member(self.owner, first):
            full = f"{self.owner}.{first}"
        else:
            return marked
        return f":py:obj:`{text} <{full}>`" if full != self.itself and _is_there(full) else marked


def _is_member(owner: str, name: str) -> bool:
    return _is_there(f"{owner}.{name}")


@cache
def _is_there(full: str) -> bool:
    """Whether a thing of this name has a place of its own in the API: fields stand in their class's list."""
    parts = full.split(".")
    for cut in range(len(parts), 0, -1):
        try:
            thing: Any = import_module(".".join(parts[:cut]))
        except ImportError:
            continue
        for part in parts[cut:]:
            thing = getattr(thing, part, None)
        return thing is not None and (callable(thing) or isinstance(thing, property | cached_property))
    return False


def as_called(app: Sphinx, what: str, name: str, thing: Any, options: object, call: str, gives: str) -> Any:
    """Values in place of constants; no call of a result, whose words tell of attributes alone."""
    words = inspect.getdoc(thing) or ""
    if what == "class" and "Attributes\n---" in words and "Parameters\n---" not in words:
        return "", gives
    module = sys.modules.get(getattr(thing, "__module__", ""))

    def value(found: re.Match[str]) -> str:
        constant = getattr(module, found[1], None)
        constant = getattr(constant, "name", constant)
        return f"={constant!r}" if isinstance(constant, str | float | int | tuple) else found[0]

    return (CONSTANT.sub(value, call).replace("<factory>", "...") if call else call), gives


def setup(app: Sphinx) -> dict[str, bool]:
    """Before napoleon, which reads the sections, and before anything is documented."""
    app.connect("autodoc-process-docstring", as_text, priority=100)
    app.connect("autodoc-process-signature", as_called)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
