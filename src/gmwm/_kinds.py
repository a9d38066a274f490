"""Check the types of a result that was read from a file. Each field is compared with its annotation, recursively."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from gmwm._text import with_article
from gmwm.errors import ReadError
from gmwm.remarks import Remark

_KEYS = {
    "intervals": "confidence_intervals", "test": "goodness_of_fit", "verdict": "contamination", "general": "fits",
    "wavelet": "wavelet_covariance", "nodes": "search_nodes",
}  # fmt: skip
"""Fields that have another name in the document, for error messages."""
_WORDS: Mapping[Any, str] = {
    str: "a string", float: "a number", int: "a whole number", bool: "true or false", NoneType: "null",
}  # fmt: skip
_KINDS: dict[type, Mapping[str, Any]] = {}
_POSITIVE = ("rate", "samples")
_SHARES = ("confidence", "efficiency")
LARGEST = 1e150
"""Largest finite number in a document. The square of a larger number overflows."""


@dataclass(frozen=True)
class Document:
    """The kind of document that is expected (`noun`), and the advice if a document is of another kind."""

    noun: str
    advice: str

    def error(self, what: str) -> ReadError:
        """Return the error for a document that is something else."""
        return ReadError(f"not {with_article(self.noun)}: {what}".rstrip("."), advice=self.advice)

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Convert the errors of a wrong document to a ReadError."""
        try:
            yield
        except ReadError:
            raise
        except KeyError as error:
            raise self.error(f"{error.args[0]!r} is missing") from error
        except (TypeError, ValueError, AttributeError, IndexError, ArithmeticError, AssertionError) as error:
            raise self.error(str(error)) from error


def require_kinds(found: Any, where: str, document: Document) -> None:
    """Raise an error if a field of a result does not have the type of its annotation.

    An integer is allowed for a float. Arrays must not contain NaN, unless the class has the attribute `marks_with_nan`.
    All arrays of an object must have the same length. The confidence, the efficiency and the fields that the attribute
    `shares` of the class lists must be between 0 and 1. No finite number may exceed `LARGEST`.

    Parameters
    ----------
    found : dataclass
        The result.
    where : str
        Name of the result in error messages.
    document : Document
        The kind of document that was read.

    Raises
    ------
    ReadError
        If a field is wrong; the message names it.
    """
    lengths = {}
    for name, kind in _hints(type(found)).items():
        value, key = getattr(found, name), f"{where}.{_KEYS.get(name, name)}".lstrip(".")
        _require(value, kind, key, document)
        if name in _POSITIVE and not value > 0:
            raise document.error(f"{key} must be above zero; got {value!r}")
        if name in (*_SHARES, *getattr(found, "shares", ())) and value is not None and not 0 < value < 1:
            raise document.error(f"{key} must be between 0 and 1; got {value!r}")
        if isinstance(value, np.ndarray):
            if value.ndim == 0:
                raise document.error(f"{key} must be a list of numbers; got {value.tolist()!r}")
            if np.any(np.isnan(value)) and not getattr(found, "marks_with_nan", False):
                raise document.error(f"{key} must contain numbers only; got {value.tolist()!r}")
            if value.ndim == 1:
                lengths[key] = value.size
    if len(set(lengths.values())) > 1 or 0 in lengths.values():
        sizes = ", ".join(f"{key} has {size}" for key, size in lengths.items())
        raise document.error(f"these lists must have the same length, at least 1: {sizes}")


def _hints(kind: type) -> Mapping[str, Any]:
    """Return the type of each field. Class variables are left out, because their types are not imported."""
    if kind not in _KINDS:
        types = {field.name: field.type for field in fields(kind)}
        _KINDS[kind] = get_type_hints(SimpleNamespace(__annotations__=types), vars(sys.modules[kind.__module__]))
    return _KINDS[kind]


def _require(value: Any, kind: Any, key: str, document: Document) -> None:
    if not _is(value, kind):
        shown = (
            "null" if value is None else repr(value) if isinstance(value, str | int | float) else type(value).__name__
        )
        raise document.error(f"{key} must be {_words(kind)}; got {shown}")
    if isinstance(value, Remark):  # checked when it was read
        return
    if _is_too_large(value):
        raise document.error(f"{key} has a number above {LARGEST:g}")
    if is_dataclass(value):  # a datasheet is a mapping too
        require_kinds(value, key, document)
    elif isinstance(value, Mapping):
        inner = get_args(kind)[1] if get_args(kind) else Any
        for name, item in value.items():
            _require(item, inner, f"{key}.{name}", document)
    elif isinstance(value, tuple):
        inners = get_args(_alone(kind))
        for place, item in enumerate(value):
            _require(item, inners[0] if inners[-1] is ... else inners[place], f"{key}[{place}]", document)


def _is_too_large(value: Any) -> bool:
    """Return whether a number, or a number of an array, is finite and larger than `LARGEST`."""
    if isinstance(value, np.ndarray):
        sizes = np.abs(value)
        return bool(np.any((sizes > LARGEST) & (sizes != np.inf)))
    return isinstance(value, int | float) and LARGEST < abs(value) != float("inf")


def _origin(kind: Any) -> Any:
    """Return the class of a type. From NumPy 2.5 on, `NDArray` is an alias, and `get_origin` returns the alias."""
    origin = get_origin(kind)
    return get_origin(origin.__value__) if hasattr(origin, "__value__") else origin


def _is(value: Any, kind: Any) -> bool:
    """Return whether a value has a type; its items are not checked."""
    origin = _origin(kind)
    if kind is Any:
        return True
    if origin in (Union, UnionType):
        return any(_is(value, one) for one in get_args(kind))
    if origin is Literal:
        return any(value == one and type(value) is type(one) for one in get_args(kind))
    if origin is tuple:
        inners = get_args(kind)
        return isinstance(value, tuple) and (inners[-1] is ... or len(value) == len(inners))
    if kind in (int, float):
        whole = int if kind is int else int | float
        return isinstance(value, whole | np.integer) and not isinstance(value, bool)
    return isinstance(value, origin or kind)


def _alone(kind: Any) -> Any:
    """Return a tuple type, or the tuple type in a union with None."""
    if get_origin(kind) is tuple:
        return kind
    return next((one for one in get_args(kind) if get_origin(one) is tuple), kind)


def _words(kind: Any) -> str:
    origin = _origin(kind)
    if origin in (Union, UnionType):
        return " or ".join(_words(one) for one in get_args(kind))
    if origin is Literal:
        return " or ".join(map(repr, get_args(kind)))
    known = {tuple: "a list", np.ndarray: "a list of numbers"}
    return _WORDS.get(kind) or known.get(origin, "an object")
