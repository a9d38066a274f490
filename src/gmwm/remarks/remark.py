"""Remarks: information about a result that a user needs, as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from gmwm._template import Dialect, Fact, Quantity
from gmwm.remarks.registry import Message, as_fact, message
from gmwm.remarks.severity import Severity


@dataclass(frozen=True)
class Remark:
    """Information that a user needs before using a result, as data.

    Attributes
    ----------
    code : str
        A code from the registry, `gmwm.remarks.messages()`.
    subject : str
        The axis, term, scale or file that the remark is about; "" for the whole result.
    facts : mapping of name to fact
        The values, with their units, and the names in the sentence.
    severity : Severity
    advice : str
        Template of the advice: what to do.

    Examples
    --------
    >>> remark = Remark.of("stamps-repeated", "imu.csv", count=3)
    >>> remark.severity.label, remark.facts["count"]
    ('info', 3)
    """

    code: str
    severity: Severity
    subject: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    advice: str = ""

    @classmethod
    def of(cls, code: str, subject: str = "", /, **facts: Fact) -> Remark:
        """Make the remark of a registered code, with the severity and advice of the registry.

        Raises
        ------
        KeyError
            If the code is not registered, or its sentence needs a fact that is missing.
        """
        known = message(code)
        if missing := known.needs(facts) - facts.keys():
            raise KeyError(f"{code} needs the facts {', '.join(sorted(missing))}")
        return cls(code, known.severity, subject=subject, facts=facts, advice=known.advice_for(facts))

    @property
    def message(self) -> Message:
        """The entry of the code in the registry."""
        return message(self.code)

    def about(self, subject: str) -> Remark:
        """Return the same remark about another subject."""
        return replace(self, subject=subject)

    def text(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Return the sentence and the advice, for Python, the shell or HTML."""
        from gmwm.remarks.rendering import one_text

        return one_text(self, dialect)

    def to_dict(self) -> dict[str, Any]:
        """Return the remark as plain values, ready for JSON; `text` is the text in the shell."""
        return {
            "code": self.code,
            "severity": self.severity.label,
            "subject": self.subject,
            "facts": {name: _plain(fact) for name, fact in self.facts.items()},
            "text": self.text(Dialect.SHELL),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Remark:
        """Restore a remark from the result of its `to_dict`.

        Raises
        ------
        KeyError
            If its code is not registered, or a fact is missing.
        """
        facts = {str(name): as_fact(value) for name, value in values["facts"].items()}
        return cls.of(str(values["code"]), str(values["subject"]), **facts)

    def __hash__(self) -> int:
        return hash((self.code, self.subject, repr(sorted(self.facts.items(), key=lambda item: item[0]))))

    def __str__(self) -> str:
        return self.text()


def sorted_remarks(remarks: Iterable[Remark]) -> list[Remark]:
    """Sort remarks by severity, and remove repeated ones. Remarks about reading the file are last in each severity."""
    return sorted(dict.fromkeys(remarks), key=lambda remark: (remark.severity, remark.message.section == "reading"))


def _plain(fact: Fact) -> Any:
    if isinstance(fact, Quantity):
        return {"value": fact.value, "unit": fact.unit}
    return [_plain(item) for item in fact] if isinstance(fact, tuple) else fact
