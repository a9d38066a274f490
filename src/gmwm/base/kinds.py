"""Check the types of a result that was read from a file. Each field is compared with its annotation, recursively."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from types import NoneType, SimpleNamespace, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix
from gmwm.base.errors import ReadError
from gmwm.base.text import with_article

_KEYS = {
    "intervals": "confidence_intervals", "test": "goodness_of_fit", "verdict": "contamination", "general": "fits",
    "wavelet": "wavelet_covariance",
}  # fmt: skip
"""Fields that have another name in the document, for error messages; `document_keys` of a class states others."""
_WORDS: Mapping[Any, str] = {
    str: "a string", float: "a number", int: "a whole number", bool: "true or false", NoneType: "null",
}  # fmt: skip
_KINDS: dict[type, Mapping[str, Any]] = {}
_POSITIVE = {
    "rate", "samples", "counts", "segments", "strides", "degrees_of_freedom", "freedom", "freedoms", "length",
    "blocks", "comparisons", "frequency", "recordings", "tau",
}  # fmt: skip
_NOT_NEGATIVE = {
    "variance", "lower", "upper", "implied", "decomposition", "allan_deviation", "density", "model_error", "filled",
    "missing", "duration", "knocks", "spikes", "in_knocks", "count", "energy", "df", "rms", "rms_low", "rms_high",
    "turn_on", "turn_on_low", "turn_on_high", "width", "error", "errors", "standard_errors", "gravity_error",
    "level_error", "frequency_error", "amplitude", "amplitude_error", "tau_error",
}  # fmt: skip
_SHARES = ("confidence", "efficiency")
_PROBABILITIES = ("pvalue", "pvalues", "p_value")
_COVARIANCES = ("covariance", "wavelet", "weighting_matrix")
"""Fields > 0, ≥ 0, in (0, 1) and in [0, 1], and symmetric matrices without negative eigenvalues, in all classes."""
LARGEST_COUNT = 1 << 62  # largest number of samples or of anything else that is counted
LARGEST_NUMBER = 1e150
"""Largest finite number in a document, and inverse of a positive one; squares of larger ones overflow."""


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
    """Raise an error unless fields have their annotated type (integers as floats) and the range of their name: equal
    lengths, covariances, numbers to `LARGEST_NUMBER`, counts to `LARGEST_COUNT`, NaN with `marks_with_nan`."""
    lengths = {}
    renamed = (text.split("=") for text in getattr(found, "document_keys", ()) if "=" in text)
    keys = {name.partition("~")[0]: key for key, name in renamed}
    for name, kind in field_types(type(found)).items():
        value, key = getattr(found, name), f"{where}.{keys.get(name) or _KEYS.get(name, name)}".lstrip(".")
        _require(value, kind, key, document)
        _require_range(name, value, key, document)
        if name in (*_SHARES, *getattr(found, "shares", ())) and value is not None and not 0 < value < 1:
            raise document.error(f"{key} must be between 0 and 1; got {value!r}")
        if not getattr(found, "marks_with_nan", False) and np.any(np.isnan(_numbers_of(value))):
            raise document.error(f"{key} must contain numbers only; got {_value_text(value)}")
        if isinstance(value, np.ndarray):
            if value.ndim == 0 or (value.ndim > 1 and name in _lists(type(found))):
                raise document.error(f"{key} must be a list of numbers; got {_value_text(value)}")
            if value.ndim == 1:
                lengths[key] = value.size
    if len(set(lengths.values())) > 1 or 0 in lengths.values():
        sizes = ", ".join(f"{key} has {size}" for key, size in lengths.items())
        raise document.error(f"these lists must have the same length, at least 1: {sizes}")


def field_types(kind: type) -> Mapping[str, Any]:
    """Return the type of each field. Class variables are left out, because their types are not imported."""
    if kind not in _KINDS:
        types = {field.name: field.type for field in fields(kind)}
        _KINDS[kind] = get_type_hints(SimpleNamespace(__annotations__=types), vars(sys.modules[kind.__module__]))
    return _KINDS[kind]


def _lists(kind: type) -> frozenset[str]:
    """Return the names of the fields with one list of numbers: those whose annotation is `Vector`, or of integers."""
    return frozenset(
        field.name for field in fields(kind) if str(field.type) in ("Vector", "Integers", "NDArray[np.int64]")
    )


def _require(value: Any, kind: Any, key: str, document: Document) -> None:
    if not _is(value, kind):
        shown = (
            "null" if value is None else repr(value) if isinstance(value, str | int | float) else type(value).__name__
        )
        raise document.error(f"{key} must be {_words(kind)}; got {shown}")
    if getattr(value, "checks_itself", False):
        return
    if _is_too_large(value):
        raise document.error(f"{key} has a number above {LARGEST_NUMBER:g}")
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


def _require_range(name: str, value: Any, key: str, document: Document) -> None:
    """Raise an error if a number is not in the range that the name of its field implies."""
    if isinstance(value, Mapping) and name == "decomposition":
        for term, part in value.items():
            _require_range(name, part, f"{key}.{term}", document)
    numbers = _numbers_of(value)
    if name in _POSITIVE and np.any(numbers <= 0):
        raise document.error(f"{key} must be above zero; got {_value_text(value)}")
    if name in _POSITIVE and np.any(numbers < 1 / LARGEST_NUMBER):
        raise document.error(f"{key} must be at least {1 / LARGEST_NUMBER:g}; got {_value_text(value)}")
    if name in _NOT_NEGATIVE and np.any(numbers < 0):
        raise document.error(f"{key} must not be negative; got {_value_text(value)}")
    if name in _POSITIVE | _NOT_NEGATIVE and isinstance(value, int) and value > LARGEST_COUNT:
        raise document.error(f"{key} must not exceed {LARGEST_COUNT}; got {_value_text(value)}")
    if name in _PROBABILITIES and np.any((numbers < 0) | (numbers > 1)):
        raise document.error(f"{key} must be from 0 to 1; got {_value_text(value)}")
    if name in _COVARIANCES and isinstance(value, np.ndarray):
        require_covariance(value, key, document)


def require_covariance(values: Matrix, key: str, document: Document) -> None:
    """Raise an error if a matrix is not square, symmetric and positive semidefinite. Infinite variances are allowed."""
    # Largest asymmetry and negative eigenvalue of a matrix, relative to a unit diagonal.
    rounding = 1e-6
    if values.ndim != 2 or values.shape[0] != values.shape[1]:
        raise document.error(f"{key} must be a square matrix; got the shape {values.shape}")
    diagonal = np.diag(values)
    if not np.all(diagonal >= 0):
        raise document.error(f"{key} must not have negative numbers on its diagonal; got {_value_text(diagonal)}")
    determined = np.isfinite(diagonal) & (diagonal > 0)
    scale = np.sqrt(diagonal[determined])
    unit = values[np.ix_(determined, determined)] / scale[:, None] / scale
    if not np.all(np.abs(unit - unit.T) <= rounding):
        raise document.error(f"{key} must be a symmetric matrix")
    if unit.size and np.linalg.eigvalsh(unit)[0] < -rounding * len(unit):
        raise document.error(f"{key} must not have a negative eigenvalue")


def _numbers_of(value: Any) -> NDArray[np.float64]:
    """Return the numbers of a number, an array, or a tuple of numbers; an empty array for any other value."""
    if isinstance(value, tuple) and all(_is(number, float) for number in value):
        value = [float(number) for number in value]
    elif not isinstance(value, np.ndarray) and not _is(value, float):
        value = []
    return np.asarray(value, dtype=np.float64)


def _value_text(value: Any) -> str:
    """Return the text of numbers for a message; the first ones of many."""
    return repr(value.tolist() if isinstance(value, np.ndarray) else value)[:100]


def _is_too_large(value: Any) -> bool:
    """Return whether a number, or a number of an array, is finite and larger than `LARGEST_NUMBER`."""
    if isinstance(value, np.ndarray):
        sizes = np.abs(value)
        return bool(np.any((sizes > LARGEST_NUMBER) & (sizes != np.inf)))
    return isinstance(value, int | float) and LARGEST_NUMBER < abs(value) != float("inf")


def array_type(kind: Any) -> Any:
    """Return the type of the numbers of an array type such as `NDArray[np.float64]`; None for another type."""
    if _origin(kind) is not np.ndarray:
        return None
    inner = get_args(kind)[-1]
    return get_args(inner)[0] if get_args(inner) else inner


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
        return any(_is(value, member) for member in get_args(kind))
    if origin is Literal:
        return any(value == member and type(value) is type(member) for member in get_args(kind))
    if origin is tuple:
        inners = get_args(kind)
        return isinstance(value, tuple) and (inners[-1] is ... or len(value) == len(inners))
    if kind in (int, float):
        number = int if kind is int else int | float
        return isinstance(value, number | np.integer) and not isinstance(value, bool)
    return isinstance(value, origin or kind)


def _alone(kind: Any) -> Any:
    """Return a tuple type, or the tuple type in a union with None."""
    if get_origin(kind) is tuple:
        return kind
    return next((member for member in get_args(kind) if get_origin(member) is tuple), kind)


def _words(kind: Any) -> str:
    origin = _origin(kind)
    if origin in (Union, UnionType):
        return " or ".join(_words(member) for member in get_args(kind))
    if origin is Literal:
        return " or ".join(map(repr, get_args(kind)))
    names = {tuple: "a list", np.ndarray: "a list of numbers"}
    return _WORDS.get(kind) or names.get(origin, "an object")
