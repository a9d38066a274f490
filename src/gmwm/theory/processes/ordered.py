"""Processes whose number of parameters depends on their orders, such as AR(2).

A class for given orders is created at its first use and cached, but not registered, as their number is unlimited."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from types import new_class
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gmwm.base.errors import ModelError
from gmwm.theory.processes.base import Process, admit_guest_processes, registry
from gmwm.theory.processes.parameter import Fixed, Parameter, Value

if TYPE_CHECKING:
    from typing_extensions import Self

ordered_classes: dict[str, type[Ordered]] = {}  # every ordered process by name, in display order


def every_class() -> dict[str, type[Process]]:
    """Return every registered process and examples of each ordered process, by name. Tests use them."""
    examples = (ordered.of(*orders) for ordered in ordered_classes.values() for orders in ordered.examples)
    return {**registry, **{process.name: process for process in examples}}


def find_class(name: str) -> type[Process] | None:
    """Find a registered process or the class of an ordered process, such as "ARMA(2,1)"; None if unknown.

    >>> find_class("WN").title
    'White noise'
    """
    ordered, bracket, orders = name.rstrip(")").partition("(")
    if ordered in ordered_classes and bracket and all(order.isdigit() for order in orders.split(",")):
        return ordered_classes[ordered].of(*map(int, orders.split(",")))
    if name not in registry:
        admit_guest_processes()
    return registry.get(name)


@dataclass(frozen=True)
class Polynomial:
    """Coefficients of one polynomial, such as phi1, phi2, … ("phi", "φ"), numbered up to its `order`, such as "p"."""

    name: str
    symbol: str
    order: str
    description: str

    def parameters(self, count: int) -> tuple[Parameter, ...]:
        """Return the parameters of a polynomial with `count` coefficients."""
        digits = str.maketrans("0123456789", "₀₁₂₃₄₅₆₇₈₉")
        return tuple(
            # No polynomial with all zeros on one side of the unit circle has a larger coefficient.
            Parameter(
                f"{self.name}{i}",
                f"{self.symbol}{str(i).translate(digits)}",
                f"{self.description} {i}",
                domain="between",
                limits=(-float(math.comb(count, i)), float(math.comb(count, i))),
            )
            for i in range(1, count + 1)
        )


class Ordered(Process, abstract=True):
    """Process with orders. A subclass defines polynomials and theory. `AR(2)`, `AR(2, phi1=1.4, sigma2=fixed(1.0))` and
    `AR(phi=[1.4, -0.6], sigma2=1.0)` are instances of `AR.of(2)`."""

    polynomials: ClassVar[tuple[Polynomial, ...]]  # the polynomials, in the order of the arguments
    period_name: ClassVar[str | None] = None
    """Name of the period, which is the last order; None for a process without a period."""
    scale_of: ClassVar[Parameter]  # the scale parameter, which is the last parameter
    examples: ClassVar[tuple[tuple[int, ...], ...]]  # orders of the processes that tests use as examples
    order_class: ClassVar[type[Ordered]]  # the class without orders, such as ARMA for ARMA(2, 1)
    orders: ClassVar[tuple[int, ...]]  # the orders of this class
    _made: ClassVar[dict[tuple[int, ...], type[Any]]]

    def __init_subclass__(cls, *, abstract: bool = False, listed: bool = True, **kwargs: Any) -> None:
        super().__init_subclass__(abstract=abstract, **kwargs)
        if abstract and listed:
            cls.order_class, cls.parameters, cls._made = cls, (), {}
            ordered_classes[cls.name] = cls

    @classmethod
    def order_names(cls) -> tuple[str, ...]:
        """Return the names of the orders, such as ("p", "q"), in the order of the arguments."""
        names = tuple(polynomial.order for polynomial in cls.polynomials)
        return names if cls.period_name is None else (*names, cls.period_name)

    @classmethod
    def written(cls) -> str:
        """Return the notation of the process with the names of its orders, such as "ARMA(p, q)"."""
        return f"{cls.order_class.name}({', '.join(cls.order_names())})"

    @classmethod
    def of(cls, *orders: int) -> type[Self]:
        """Return the class of these orders; ModelError if one is missing, negative or too large, or all are zero."""
        ordered = cls.order_class
        key = ordered._checked_orders(orders)
        if key not in ordered._made:
            ordered._made[key] = ordered._new(key)
        return ordered._made[key]

    @classmethod
    def _checked_orders(cls, orders: Iterable[object]) -> tuple[int, ...]:
        # Largest lag (samples) that a process can have.
        most_lags = 63
        values, names = tuple(orders), cls.order_names()
        if len(values) != len(names):
            first = cls.polynomials[0].name
            raise ModelError(
                f"{cls.name} needs its orders, {cls.written()}, or its coefficients, {first}=[…]; "
                f"got {len(values)} orders",
                got=values,
                argument="orders",
            )
        for name, order in zip(names, values, strict=True):
            least = 2 if name == cls.period_name else 0
            if isinstance(order, bool) or not isinstance(order, (int, np.integer)) or order < least:
                message = f"{name} of {cls.written()} must be a whole number from {least}; got {order!r}"
                raise ModelError(message, argument=name, got=order)
        numbers = tuple(int(order) for order in values)  # type: ignore[call-overload]
        reach = cls.lags(numbers)
        if reach > most_lags:
            raise ModelError(
                f"{_name(cls, numbers)} reaches back {reach} samples; the maximum is {most_lags}", got=numbers,
                reach=reach, argument="orders",
            )  # fmt: skip
        cls.check_orders(numbers)
        return numbers

    @classmethod
    def lags(cls, orders: tuple[int, ...]) -> int:
        """Return the largest lag (samples) of a process of these orders."""
        return max(orders)

    @classmethod
    @abstractmethod
    def check_orders(cls, orders: tuple[int, ...]) -> None:
        """Raise ModelError, with advice, if no process has these orders."""

    @classmethod
    def _new(cls, orders: tuple[int, ...]) -> type[Any]:
        parts = [part.parameters(n) for part, n in zip(cls.polynomials, orders, strict=False)]
        parameters = (*(p for part in parts for p in part), cls.scale_of)

        def body(namespace: dict[str, Any]) -> None:
            namespace.update(
                name=_name(cls, orders), title=f"{cls.title} of order {', '.join(map(str, orders))}",
                parameters=parameters, orders=orders, __doc__=cls.__doc__, __module__=cls.__module__,
                __annotations__={p.name: Value for p in parameters},
                **dict.fromkeys((p.name for p in parameters), None),
            )  # fmt: skip

        kind = new_class(_name(cls, orders), (cls,), {"register": False}, body)
        return dataclass(frozen=True, repr=False, init=False)(kind)

    def __new__(cls, *orders: int, **values: Any) -> Self:
        """Create an instance of the class with these orders, or with the number of coefficients given."""
        if cls.order_class is cls:
            kind = cls.of(*cls._orders_of(orders, values))
        else:
            if orders and cls._orders_of(orders, values) != cls.orders:
                raise ModelError(f"{cls.name} has the orders {cls.orders}; got {orders}", got=orders, argument="orders")
            kind = cls
        return object.__new__(kind)

    def __init__(self, *orders: int, **values: Value | Sequence[Value]) -> None:
        order_names = self.order_names()
        parameters = {name: value for name, value in values.items() if name not in order_names}
        for polynomial in self.polynomials:
            if (sequence := parameters.pop(polynomial.name, None)) is not None:
                for i, value in enumerate(_sequence(sequence, self, polynomial), 1):
                    name = f"{polynomial.name}{i}"
                    if name in parameters:
                        raise ModelError(
                            f"{self.name}.{name} is given twice, in {polynomial.name} and by itself", argument=name
                        )
                    parameters[name] = value
        names = [p.name for p in self.parameters]
        for name in parameters:
            if name not in names:
                raise self.no_parameter(name)
        for name in names:
            object.__setattr__(self, name, parameters.get(name))
        self.__post_init__()

    def __post_init__(self) -> None:
        try:
            super().__post_init__()
        except ModelError:
            # If all coefficients are numbers, checking them together gives a better message.
            numbers = [value for value in self.values.values() if value is not None]
            if all(isinstance(value, float | Real) and math.isfinite(value) for value in numbers):
                self.check_values()
            raise
        self.check_values()

    @abstractmethod
    def check_values(self) -> None:
        """Raise ModelError, with advice, if the coefficients are valid separately but not together."""

    @classmethod
    def _orders_of(cls, orders: tuple[int, ...], values: Mapping[str, Any]) -> tuple[int, ...]:
        """Return the orders that are given, or the orders that follow from the numbers of coefficients."""
        numbers = list(orders)
        if cls.period_name is not None and cls.period_name in values:
            if len(numbers) >= len(cls.order_names()):
                raise ModelError(f"the {cls.period_name} of {cls.written()} is given twice", argument=cls.period_name)
            numbers.append(values[cls.period_name])
        lists = {p: values.get(p.name) for p in cls.polynomials}
        counts = {p.order: len(_sequence(given, cls, p)) for p, given in lists.items() if given is not None}
        named = [values[name] for name in cls.order_names() if name in values and name != cls.period_name]
        if named and not orders and not counts:
            numbers = [*named, *numbers]
        if not counts:
            return tuple(numbers)
        if not orders:
            return (*(counts.get(p.order, 0) for p in cls.polynomials), *numbers)
        for polynomial, order in zip(cls.polynomials, numbers, strict=False):
            if counts.get(polynomial.order, order) != order:
                raise ModelError(
                    f"{_name(cls.order_class, tuple(numbers))} has {polynomial.order} = {order!r}, but "
                    f"{polynomial.name} has {counts[polynomial.order]} values",
                    argument=polynomial.order,
                    got=order,
                    advice="Give either orders or coefficients.",
                )
        return tuple(numbers)

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.order_class, self.orders, {p.name: getattr(self, p.name) for p in self.parameters})

    def __str__(self) -> str:
        values = [f"{p.name}={v!r}" for p in self.parameters if (v := getattr(self, p.name)) is not None]
        orders = [str(n) for n in self.orders]
        return f"{self.order_class.name}({', '.join([*orders, *values])})" if values else self.name

    def coefficients(self, name: str) -> list[float | None]:
        """Return the values of the coefficients called `name`, fixed or not; None for a coefficient without a value."""
        values = self.values
        return [values[p.name] for p in self.nonlinear_parameters() if p.name.rstrip("0123456789") == name]


def _again(ordered: type[Ordered], orders: tuple[int, ...], values: dict[str, Value]) -> Ordered:
    return ordered.of(*orders)(**values)


def _name(ordered: type[Ordered], orders: tuple[int, ...]) -> str:
    return f"{ordered.name}({','.join(map(str, orders))})"


def _sequence(values: Any, owner: Any, polynomial: Polynomial) -> list[Value]:
    if isinstance(values, (str, Fixed, Mapping)) or not isinstance(values, Iterable):
        raise ModelError(
            f"{polynomial.name} of {owner.name} must be a list of coefficients; got {values!r}",
            argument=polynomial.name, got=values, advice="A single coefficient is called `{first}`.",
            first=f"{polynomial.name}1",
        )  # fmt: skip
    return [value.item() if isinstance(value, np.generic) else value for value in values]
