"""Parser of model texts such as "3*GM + WN(sigma2=fixed(1e-6)) + RW"; it never evaluates code.

    model   = term { "+" term }
    term    = [ count "*" ] process | process "*" count
    process = name [ "(" [ entry { "," entry } ] ")" ]
    entry   = order | value | parameter "=" value
    value   = number | "fixed" "(" number ")"

Values without a name come first, in the order of parameters. Orders are whole numbers before them: "AR(2, 1.4, -0.6)";
"AR(phi=[1.4, -0.6])" gives coefficients instead. Names of processes have any case. `str(model)` names every value."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, NoReturn

from gmwm.base.errors import ModelError
from gmwm.theory.processes.base import Process, admit_guest_processes, registry
from gmwm.theory.processes.model import MOST_TERMS, Model
from gmwm.theory.processes.ordered import Ordered, ordered_classes
from gmwm.theory.processes.parameter import Fixed, Value

_TOKEN = re.compile(
    r"\s*(?:(?P<name>[A-Za-z_]\w*)|(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<mark>[-+*(),=\[\]]))", re.ASCII
)
# 100 terms of 100 characters, against long run times (test_a_text_of_a_sum_that_is_no_model).


def parse_model(text: str) -> Model:
    """Parse a model in the grammar of the module docstring; ModelError states the position of an error.

    >>> parse_model("2*GM + WN(sigma2=fixed(1e-6))")
    Model('2*GM + WN(sigma2=fixed(1e-06))')
    >>> parse_model("AR1(0.9, fixed(0.1))")
    Model('AR1(phi=0.9, sigma2=fixed(0.1))')
    >>> parse_model("GM + VN")
    Traceback (most recent call last):
    gmwm.base.errors.ModelError: the model "GM + VN" cannot be read at "VN" (character 6): there is no process...
    """
    longest_text = 10_000
    if not isinstance(text, str):
        raise ModelError(
            f'the text of a model must be a string, such as "2*GM + WN"; got {text!r}', got=text, argument="text"
        )
    if len(text) > longest_text:
        raise ModelError(
            f"the text of a model has at most {longest_text} characters; got {len(text)}",
            got=len(text),
            argument="text",
        )
    return _ModelParser(text).model()


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    at: int


@dataclass
class _ModelParser:
    """Recursive-descent parser of the text of one model."""

    text: str
    tokens: list[_Token] = field(default_factory=list)
    position: int = 0

    def __post_init__(self) -> None:
        at, end = 0, len(self.text.rstrip())
        while at < end:
            match = _TOKEN.match(self.text, at)
            if match is None:
                at += len(self.text[at:]) - len(self.text[at:].lstrip())
                self._fail(_Token("mark", self.text[at], at), "a model cannot contain this character")
            kind = match.lastgroup or ""
            self.tokens.append(_Token(kind, match[kind], match.start(kind)))
            at = match.end()
        self.tokens.append(_Token("end", "", end))

    def model(self) -> Model:
        processes = self._term()
        while self._take("+"):
            processes += self._term()
            if len(processes) > MOST_TERMS:
                break
        if self._next.kind != "end" and len(processes) <= MOST_TERMS:
            self._fail(self._next, 'expected "+" or the end')
        return Model(tuple(processes))

    def _term(self) -> list[Process]:
        if self._next.kind == "number":
            count = self._count()
            self._expect("*", "between a count and a process, as in 3*GM")
            return [self._process()] * count
        process = self._process()
        return [process] * self._count() if self._take("*") else [process]

    def _count(self) -> int:
        token = self._advance()
        if token.kind != "number" or not token.text.isdigit() or not 1 <= int(token.text[:9]) <= MOST_TERMS:
            self._fail(token, f"expected a count from 1 to {MOST_TERMS}, as in 3*GM")
        return int(token.text)

    def _process(self) -> Process:
        token = self._advance()
        if token.kind != "name":
            self._fail(token, f"expected a process, one of {_registered()}")
        process = _find(token.text)
        if process is None:
            admit_guest_processes()
            process = _find(token.text)
        if process is None:
            self._fail(token, f"there is no process of this name; the processes are {_registered()}")
        opened = self._take("(")
        if issubclass(process, Ordered):
            orders = self._orders(process) if opened else []
            if not orders and opened and self._next.kind == "name":
                given_at_once = self._coefficients(process)
                try:
                    return process(**given_at_once)
                except ModelError as error:
                    self._fail(token, error)
            try:
                process = process.of(*orders)
            except ModelError as error:
                self._fail(token, error)
        arguments = self._arguments(process) if opened else {}
        try:
            return process(**arguments)
        except ModelError as error:
            self._fail(token, error)

    def _orders(self, ordered: type[Ordered]) -> list[int]:
        orders: list[int] = []
        most = len(ordered.order_names())
        while len(orders) < most and (
            self._next.kind == "number" or (self._next.text == ordered.period_name and orders)
        ):
            if self._take(ordered.period_name, "name"):
                self._expect("=", f"after {ordered.period_name}")
            token = self._advance()
            if not token.text.isdigit():
                self._fail(token, f"expected an order, a whole number, as in {ordered.written()}")
            orders.append(int(token.text[:9]))
            if self._next.text != ")":
                self._expect(",", "between orders and parameters")
        return orders

    def _coefficients(self, ordered: type[Ordered]) -> dict[str, Any]:
        """Read arguments without leading orders: lists of coefficients, single parameters, or named orders."""
        arguments: dict[str, Any] = {}
        while not self._take(")"):
            if arguments:
                self._expect(",", "between parameters")
            token = self._advance()
            if token.kind != "name":
                self._fail(token, f'expected coefficients by name, such as {ordered.polynomials[0].name}=[…], or ")"')
            if token.text in arguments:
                self._fail(token, "this is given twice")
            self._expect("=", f"after {token.text}")
            if token.text in ordered.order_names():
                number = self._advance()
                if not number.text.isdigit():
                    self._fail(number, f"expected an order, a whole number, as in {ordered.written()}")
                arguments[token.text] = int(number.text[:9])
            else:
                arguments[token.text] = self._list() if self._take("[") else self._value()
        return arguments

    def _list(self) -> list[float | Fixed]:
        values: list[float | Fixed] = []
        while not self._take("]"):
            if values:
                self._expect(",", "between coefficients")
            values.append(self._value())
        return values

    def _arguments(self, process: type[Process]) -> dict[str, Value]:
        parameters = {p.name: p for p in process.parameters}
        example = f"{next(iter(parameters))}=…"
        if not issubclass(process, Ordered):
            example = f"{process.name}({example})"
        arguments: dict[str, Value] = {}
        named = False
        while not self._take(")"):
            if arguments:
                self._expect(",", "between parameters")
            token = self._next
            by_name = token.kind == "name" and token.text != "fixed"
            if by_name:
                name = self._advance().text
                if name not in parameters:
                    self._fail(
                        token, f"{process.name} has no such parameter; its parameters are {', '.join(parameters)}"
                    )
                if name in arguments:
                    self._fail(token, "this parameter is given twice")
                self._expect("=", f"after {name}")
            elif token.kind != "number" and token.text not in ("fixed", "+", "-"):
                self._fail(token, f'expected a parameter by name, such as {example}, or ")"')
            elif named:
                self._fail(token, f"values without a name must come before values with a name; write {example}")
            elif len(arguments) == len(parameters):
                self._fail(token, f"too many values; the parameters of {process.name} are {', '.join(parameters)}")
            else:
                name = list(parameters)[len(arguments)]
            named = named or by_name
            start, value = self._next, self._value()
            try:
                arguments[name] = parameters[name].checked(value, process.name)
            except ModelError as error:
                self._fail(start, error)
        return arguments

    def _value(self) -> float | Fixed:
        if self._next.text == "fixed":
            self._advance()
            self._expect("(", "after fixed")
            number = self._number()
            self._expect(")", "after the fixed value")
            return Fixed(number)
        return self._number()

    def _number(self) -> float:
        sign = -1.0 if self._next.text == "-" else 1.0
        if self._next.text in ("-", "+"):
            self._advance()
        token = self._advance()
        if token.kind != "number" or float(token.text) == float("inf"):
            self._fail(token, "expected a finite number or fixed(number)")
        return sign * float(token.text)

    @property
    def _next(self) -> _Token:
        return self.tokens[self.position]

    def _advance(self) -> _Token:
        token = self._next
        self.position = min(self.position + 1, len(self.tokens) - 1)
        return token

    def _take(self, text: str | None, kind: str = "mark") -> bool:
        if self._next.kind != kind or self._next.text != text:
            return False
        self._advance()
        return True

    def _expect(self, mark: str, where: str) -> None:
        if not self._take(mark):
            self._fail(self._next, f'expected "{mark}" {where}')

    def _fail(self, token: _Token, why: str | ModelError) -> NoReturn:
        piece = f'"{token.text}" (character {token.at + 1})' if token.kind != "end" else "the end"
        reason, advice, facts = (why, "", {}) if isinstance(why, str) else (why.reason, why.advice, why.facts)
        shown = self.text if len(self.text) <= 80 else self.text[:77] + "..."
        error = ModelError(f'the model "{shown}" cannot be read at {piece}: {reason}', got=token.text, advice=advice)
        error.facts.update(facts)
        error.facts["character"] = None if token.kind == "end" else token.at + 1
        raise error


def _find(name: str) -> type[Process] | type[Ordered] | None:
    """Return the process of a name, in which upper and lower case are not distinguished."""
    classes = {**registry, **ordered_classes}
    return next((process for key, process in classes.items() if key.casefold() == name.casefold()), None)


def _registered() -> str:
    return ", ".join([*registry, *(ordered.written() for ordered in ordered_classes.values())])
