"""Remarks: information that a user needs about a result, as data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

from gmwm.base.remarks.registry import Message, Severity, as_fact, message
from gmwm.base.template import Dialect, Fact, Quantity


@dataclass(frozen=True)
class Remark:
    """Information that a user needs before using a result: a message `code` of `gmwm.remarks.messages()`, the axis,
    term, scale or file (`subject`, "" for the whole result), `facts` of the sentence, `severity`, and template of
    `advice`.

    >>> remark = Remark.of("rows-repeated", "imu.csv", count=3)
    >>> remark.severity.label, remark.facts["count"]
    ('wrong', 3)
    """

    checks_itself: ClassVar[bool] = True  # so that `gmwm.base.kinds` need not
    code: str
    severity: Severity
    subject: str = ""
    facts: Mapping[str, Fact] = field(default_factory=dict)
    advice: str = ""

    @classmethod
    def of(cls, code: str, subject: str = "", /, **facts: Fact) -> Remark:
        """Create a remark with severity and advice of the registry; KeyError for unknown codes or missing facts."""
        entry = message(code)
        if missing := entry.needs(facts) - facts.keys():
            raise KeyError(f"{code} needs the facts {', '.join(sorted(missing))}")
        return cls(code, entry.severity_for(facts), subject=subject, facts=facts, advice=entry.advice_for(facts))

    @property
    def message(self) -> Message:
        """The entry of the code in the registry."""
        return message(self.code)

    def about(self, subject: str) -> Remark:
        """Return the same remark about another subject."""
        return replace(self, subject=subject)

    def text(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Return the sentence and the advice as text for Python, the shell or HTML."""
        from gmwm.base.remarks.rendering import one_text

        return one_text(self, dialect)

    def to_dict(self) -> dict[str, Any]:
        """Return the remark as plain values for JSON. The key "text" has the text for the shell."""
        return {
            "code": self.code, "severity": self.severity.label, "subject": self.subject,
            "facts": {name: _plain(fact) for name, fact in self.facts.items()}, "text": self.text(Dialect.SHELL),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Remark:
        """Restore a remark from its `to_dict`; KeyError for unknown codes or missing facts."""
        facts = {str(name): as_fact(value) for name, value in values["facts"].items()}
        return cls.of(str(values["code"]), str(values["subject"]), **facts)

    def __hash__(self) -> int:
        return hash((self.code, self.subject, repr(sorted(self.facts.items(), key=lambda item: item[0]))))

    def __str__(self) -> str:
        return self.text()


def sorted_remarks(remarks: Iterable[Remark]) -> list[Remark]:
    """Sort remarks by severity, those about reading the file last, without repetitions."""
    return sorted(dict.fromkeys(remarks), key=lambda remark: (remark.severity, remark.message.section == "reading"))


def _plain(fact: Fact) -> Any:
    if isinstance(fact, Quantity):
        return {"value": fact.value, "unit": fact.unit}
    return [_plain(item) for item in fact] if isinstance(fact, tuple) else fact
