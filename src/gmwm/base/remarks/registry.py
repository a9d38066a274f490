"""Registry of remarks: the severity, the sentence and the advice of each code, from `messages.toml`."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import IntEnum
from functools import cache
from importlib.resources import files
from string import Formatter
from typing import Any

from gmwm.base.lazy import tomllib
from gmwm.base.template import Fact, Quantity


class Severity(IntEnum):
    """Consequence of a remark for the values that it concerns. The most severe level comes first."""

    UNUSABLE = 0
    """The values cannot be used."""
    WRONG = 1
    """The values may be wrong by a large factor."""
    BIASED = 2
    """The confidence intervals may contain the true values less often than stated."""
    UNCERTAIN = 3
    """The confidence intervals are right, but they are wide, or some values are missing."""
    INFO = 4
    """The values are not affected. The remark states how they were obtained."""

    @property
    def label(self) -> str:
        """Name of the severity in lower case, as in JSON documents."""
        return self.name.lower()


SECTIONS: Mapping[str, str] = {
    "reading": "Reading a file",
    "recording": "The recording",
    "curve": "The wavelet variance",
    "fit": "A fitted model",
    "selection": "Several candidate models",
    "numbers": "Numbers of a datasheet",
    "calibration": "A calibration",
    "axes": "Several axes together",
    "agreement": "Several calibrations of one unit",
    "fleet": "A fleet of units",
    "plan": "A planned recording",
    "files": "Files for other programs",
}
"""Sections of the documentation of remarks, in order: identifier and title."""


@dataclass(frozen=True)
class Choice:
    """Templates by the value of the fact `by`, in lower case; "otherwise" has the template for all other values."""

    by: str
    templates: Mapping[str, Text]

    def of(self, facts: Mapping[str, Fact]) -> str:
        """Return the template for these facts."""
        value = str(facts[self.by]).lower()
        return _resolved(self.templates[value if value in self.templates else OTHERWISE], facts)


Text = str | Choice
OTHERWISE = "otherwise"  # key of the template for all values of a fact that have no template of their own
CASE = "case"  # fact that tells apart the situations of a code


@dataclass(frozen=True)
class Message:
    """The entry of a code in the registry; `cause` is the situation as a noun phrase, if it can make numbers wrong.

    `sentence` and `advice` are templates; `{subjects}` are otherwise written before the sentence, each with `detail` in
    parentheses. `meaning` (Markdown) and `examples` (facts of each case) are for the documentation. `raises` and
    `spoils` are symbols of numbers that are upper limits or wrong, "all", or the name of a fact with the symbols."""

    code: str
    section: str
    severity: Text
    sentence: Text
    advice: Text = ""
    detail: Text = ""
    meaning: str = ""
    cause: str = ""
    examples: tuple[Mapping[str, Fact], ...] = ({},)
    raises: tuple[str, ...] = ()
    spoils: tuple[str, ...] = ()

    def sentence_for(self, facts: Mapping[str, Fact]) -> str:
        """Return the template of the sentence for these facts."""
        return _resolved(self.sentence, facts)

    def advice_for(self, facts: Mapping[str, Fact]) -> str:
        """Return the template of the advice for these facts."""
        return _resolved(self.advice, facts)

    def detail_for(self, facts: Mapping[str, Fact]) -> str:
        """Return the template of the text after the name of each subject for these facts."""
        return _resolved(self.detail, facts)

    def severity_for(self, facts: Mapping[str, Fact]) -> Severity:
        """Return the severity for these facts."""
        return Severity[_resolved(self.severity, facts).upper()]

    def needs(self, facts: Mapping[str, Fact]) -> set[str]:
        """Return the names of all facts that the message needs."""
        deciding = self._deciding_facts(facts)
        if deciding - facts.keys():
            return deciding
        return deciding | set(_fields(self.sentence_for(facts), self.advice_for(facts), self.detail_for(facts)))

    def constant_facts(self, facts: Mapping[str, Fact]) -> set[str]:
        """Return the names of the facts that must be equal for all subjects in one sentence."""
        return self._deciding_facts(facts) | set(_fields(self.sentence_for(facts), self.advice_for(facts)))

    def _deciding_facts(self, facts: Mapping[str, Fact]) -> set[str]:
        """Return the names of the facts that choose the templates, as far as `facts` has them."""
        return set().union(
            *(_deciding(text, facts) for text in (self.severity, self.sentence, self.detail, self.advice))
        )


def _resolved(text: Text, facts: Mapping[str, Fact]) -> str:
    return text.of(facts) if isinstance(text, Choice) else text


def _deciding(text: Text, facts: Mapping[str, Fact]) -> set[str]:
    if not isinstance(text, Choice):
        return set()
    if text.by not in facts:
        return {text.by}
    value = str(facts[text.by]).lower()
    return {text.by} | _deciding(text.templates[value if value in text.templates else OTHERWISE], facts)


def _fields(*templates: str) -> Iterator[str]:
    for template in templates:
        for _, name, _, _ in Formatter().parse(template):
            if name is None or name == "subjects" or name.startswith("gmwm "):
                continue
            if not name.startswith("--"):
                yield name
            elif (value := name.partition("=")[2]).startswith("@"):
                yield value[1:]


@cache
def message(code: str) -> Message:
    """Return the entry of a code in the registry. Only this entry is parsed: the whole file takes 50 ms."""
    return _parse(_tables()[code])[code]


@cache
def messages() -> Mapping[str, Message]:
    """Return all messages by code, in the order of the file."""
    return _parse(_content())


def _content() -> str:
    return files("gmwm.base.remarks").joinpath("messages.toml").read_text(encoding="utf-8")


@cache
def _tables() -> Mapping[str, str]:
    """Return each table of the file by name. A line that begins like a name is a link if more follows the bracket."""
    matches = re.finditer(r"^\[([a-z0-9-]+)\]\n.*?(?=^\[[a-z0-9-]+\]\n|\Z)", _content(), re.MULTILINE | re.DOTALL)
    return {match[1]: match[0] for match in matches}


def _parse(text: str) -> dict[str, Message]:
    return {code: _message(code, entry) for code, entry in tomllib.loads(text).items()}


def _message(code: str, entry: Mapping[str, Any]) -> Message:
    return Message(
        code=code, section=entry["section"], severity=_text(entry["severity"]),
        sentence=_text(entry["sentence"]), advice=_text(entry.get("advice", "")), detail=_text(entry.get("detail", "")),
        meaning=entry.get("meaning", "").strip(), cause=entry.get("cause", ""),
        examples=tuple(
            {name: as_fact(value) for name, value in example.items()}
            for example in entry.get("examples", [entry.get("example", {})])
        ),
        raises=tuple(entry.get("raises", ())), spoils=tuple(entry.get("spoils", ())),
    )  # fmt: skip


def _text(value: str | Mapping[str, Any]) -> Text:
    if isinstance(value, str):
        return value
    return Choice(value["by"], {name: _text(text) for name, text in value.items() if name != "by"})


def as_fact(value: Any) -> Fact:
    """Convert a plain value to a fact. `{value, unit}` becomes a number with a unit, and a list becomes a tuple."""
    if isinstance(value, Mapping):
        return Quantity(float("nan") if value["value"] is None else float(value["value"]), str(value["unit"]))
    if isinstance(value, list | tuple):
        return tuple(as_fact(item) for item in value)
    return value if isinstance(value, str | bool | int | float) or value is None else str(value)
