"""Documents of results: the fields of a dataclass as JSON values, and back; CONTRIBUTING.md, "Documents", is a guide.

`document_keys` are a class's keys in order, by default its fields: `"name"`, or `"key=name"`. `"?"` marks a key that
may be missing; with `"~inf"` or `"~nan"`, null is this number. `"*name"` inserts a member's keys. Other names than
fields are written and not read."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import (
    TYPE_CHECKING,
    Any,
    ClassVar,
    Literal,
    NamedTuple,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

import numpy as np

from gmwm.base import _core
from gmwm.base.errors import OptionError
from gmwm.base.kinds import Document, array_type, field_types, require_kinds
from gmwm.base.remarks import Remark, Severity

if TYPE_CHECKING:
    from typing_extensions import Self

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]
_SIMPLE: Mapping[Any, str] = {
    str: "string", bool: "boolean", int: "integer", NoneType: "null", float: "number",
}  # fmt: skip
REMARK: Schema = {
    "type": "object",
    "properties": {
        "code": {"type": "string"}, "severity": {"enum": [severity.name.lower() for severity in Severity]},
        "subject": {"type": "string"}, "facts": {"type": "object"}, "text": {"type": "string"},
    },
    "required": ["code", "severity", "subject", "facts", "text"],
}  # fmt: skip


def is_result(head: bytes) -> bool:
    """Return whether a file that begins with `head` is a JSON document that gmwm wrote.

    >>> is_result(b'{"format": "gmwm-calibration", "version": 2'), is_result(b'{"gyro_x": 1}')
    (True, False)
    """
    return re.search(rb'"gmwm":\s*"|"format":\s*"gmwm-', head[:200]) is not None


class Schemas:
    """The schemas of the classes in a document, by name. `number` is the schema of a number."""

    def __init__(self, number: Schema) -> None:
        self.by_name: dict[str, Schema] = {
            "number": number, "numbers": {"type": "array", "items": {"anyOf": [_to("number"), _to("numbers")]}},
            "gaps": {"type": "array", "items": {"anyOf": [_to("number"), {"type": "null"}, _to("gaps")]}},
            "remark": REMARK,
        }  # fmt: skip

    def of(self, kind: Any) -> Schema:
        """Return the schema of a type; a class with a document is defined once, and referred to."""
        origin, inner = get_origin(kind), get_args(kind)
        if (number_type := array_type(kind)) is not None:
            return {"type": "array", "items": {"type": "boolean"}} if number_type is np.bool_ else _to("numbers")
        if origin in (Union, UnionType):
            return {"anyOf": [self.of(member) for member in inner]}
        if origin is Literal:
            return {"enum": list(inner)}
        if origin is tuple:
            return {"type": "array", "items": self.of(inner[0]) if inner[-1] is ... else {}}
        if isinstance(origin, type) and issubclass(origin, Mapping):
            return {"type": "object", "additionalProperties": self.of(inner[1])}
        if kind is float:
            return _to("number")
        if kind in _SIMPLE or kind in TEXTS:
            return {"type": _SIMPLE.get(kind, "string")}
        if kind is Remark:
            return _to("remark")
        if not isinstance(kind, type) or getattr(kind, "to_dict", None) is not Documented.to_dict:
            return {"type": "object"} if is_dataclass(kind) or hasattr(kind, "to_dict") else {}
        name = kind.__name__
        if name not in self.by_name:
            self.by_name[name] = {}  # a class can contain itself
            self.by_name[name] = self._of_document(kind)
        return _to(name)

    def _of_document(self, kind: type) -> Schema:
        """Return the schema of a class with `document_keys`."""
        properties: dict[str, Schema] = {}
        required: list[str] = []
        types = field_types(kind)
        for entry in entries_of(kind):
            value = self.of(types[entry.name]) if entry.is_field else self.of(_computed(kind, entry.name))
            if entry.inlined:
                inlined = self.by_name.get(value.get("$ref", "").rpartition("/")[2], {})
                properties |= inlined.get("properties", {})
                required += inlined.get("required", [])
                continue
            if entry.default is not None:  # null stands for a number
                value = _to("gaps") if value == _to("numbers") else {"anyOf": [value, {"type": "null"}]}
            properties[entry.key] = value
            required += [] if entry.optional else [entry.key]
        return {"type": "object", "properties": properties, "required": required}


def _to(name: str) -> Schema:
    return {"$ref": f"#/$defs/{name}"}


def _computed(kind: type, name: str) -> Any:
    """Return the type of a property or method; any type if it is not known."""
    member = getattr(kind, name)
    try:
        return get_type_hints(getattr(member, "fget", member)).get("return", Any)
    except (NameError, TypeError):  # imported only for type checkers, or a value of the class
        return Any


T = TypeVar("T")

_READERS: dict[type, Callable[[str], Any]] = {}  # functions that read the classes that a document contains as a text


def write_as_text(kind: type[T], read: Callable[[str], T]) -> None:
    """Let documents contain the objects of a class as a text."""
    TEXTS[kind], _READERS[kind] = str, read


class DocKey(NamedTuple):
    """Entry of `document_keys`; `default` is the number that null stands for, `inlined` marks `"*name"`."""

    key: str
    name: str
    default: float | None
    is_field: bool
    optional: bool
    inlined: bool


_ENTRIES: dict[Any, tuple[DocKey, ...]] = {}


def entries_of(kind: Any) -> tuple[DocKey, ...]:
    """Return the entries of the document of a dataclass."""
    if kind in _ENTRIES:
        return _ENTRIES[kind]
    names = [field.name for field in fields(kind)]
    entries = []
    for text in getattr(kind, "document_keys", ()) or names:
        key, _, name = text.lstrip("*").rstrip("?").partition("=")
        name, _, default = (name or key).partition("~")
        entries.append(
            DocKey(key.partition("~")[0], name, default=float(default) if default else None, is_field=name in names,
                  optional=text.endswith("?"), inlined=text.startswith("*"))
        )  # fmt: skip
    return _ENTRIES.setdefault(kind, tuple(entries))


class Documented:
    """Base of dataclasses with a JSON document; with `document`, fields are checked by annotation and name."""

    document_keys: ClassVar[tuple[str, ...]] = ()
    document: ClassVar[Document | None] = None

    def to_dict(self) -> dict[str, Any]:
        """Return the document: numbers, lists, texts and mappings for JSON."""
        return _written(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Restore an object from the output of `to_dict`, exactly, also after a round trip through JSON. Unknown keys
        are ignored. Raises ReadError if a value is missing, or has the wrong type, size or range."""
        if cls.document is None:
            return _read(cls, values)
        with cls.document.reading():
            result = _read(cls, values)
        require_kinds(result, "", cls.document)
        return result

    def require_consistent(self) -> None:
        """Raise an error if fields that were read contradict each other; by default, they never do."""


def _written(result: Any) -> dict[str, Any]:
    content: dict[str, Any] = {}
    for entry in entries_of(type(result)):
        value = getattr(result, entry.name)
        value = plain(value() if callable(value) else value, finite=entry.default is not None)
        if entry.inlined:
            content.update(value)
        else:
            content[entry.key] = value
    return content


def fields_of(kind: type, values: Mapping[str, Any]) -> dict[str, Any]:
    """Read the fields of a dataclass that are in its document."""
    types, content = field_types(kind), dict[str, Any]()
    for entry in entries_of(kind):
        if entry.is_field and not (entry.optional and entry.key not in values):
            value = values if entry.inlined else values[entry.key]
            content[entry.name] = _value(types[entry.name], value, entry)
    return content


def _read(kind: type[T], values: Mapping[str, Any]) -> T:
    """Read a dataclass from its document."""
    result = kind(**fields_of(kind, values))
    if isinstance(result, Documented):
        result.require_consistent()
    return result


def _value(kind: Any, value: Any, entry: DocKey) -> Any:
    """Read a value whose annotation is `kind`. A value of the wrong type is left as it is if a check names it later."""
    if (number_type := array_type(kind)) is not None:
        numbers = np.array(_filled(value, entry.default), dtype=number_type)
        if numbers.dtype.kind == "i" and not np.array_equal(numbers, np.array(value, dtype=np.float64)):
            raise OptionError(argument=entry.key, expected="whole numbers", got=value)
        return numbers
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        kinds = [one for one in inner if one is not NoneType]
        return value if value is None or len(kinds) > 1 else _value(kinds[0], value, entry)
    if origin is Literal and value not in inner:
        raise OptionError(argument=entry.key, expected=f"one of {', '.join(map(str, inner))}", got=value)
    if origin is tuple:
        kinds = [inner[0]] * len(value) if inner[-1] is ... else list(inner)
        return tuple(_value(one, item, entry) for one, item in zip(kinds, value, strict=True))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        return {inner[0](key): _value(inner[1], item, entry) for key, item in value.items()}
    if kind is int and isinstance(value, float) and not value.is_integer():
        raise OptionError(argument=entry.key, expected="a whole number", got=value)
    if kind in (int, float) and not isinstance(number := _filled(value, entry.default), str | bool | NoneType):
        return kind(number)
    if kind in _READERS:
        return _READERS[kind](value)
    reader = getattr(kind, "from_dict", None)
    if reader is not None and getattr(reader, "__func__", None) is not Documented.from_dict.__func__:  # type: ignore[attr-defined]
        return reader(value)
    return _read(kind, value) if hasattr(kind, "__dataclass_fields__") else value


def _filled(value: Any, default: float | None) -> Any:
    """Replace None by the number that it stands for."""
    if default is None:
        return value
    if isinstance(value, list):
        return [_filled(item, default) for item in value]
    return default if value is None else value


TEXTS: dict[type, Callable[[Any], str]] = {}
"""Functions that write the objects of a class as a text; `gmwm.base.documents.write_as_text` registers them."""
_SAME = frozenset({bool, int, str})


def plain(value: Any, *, finite: bool = True) -> Any:
    """Convert arrays and tuples to lists, results to dicts, and, if `finite`, numbers that are not finite to None.

    >>> plain({"x": np.array([[1.0, np.nan]]), "names": ("a", "b")})
    {'x': [[1.0, None]], 'names': ['a', 'b']}
    """
    if type(value) is float:
        return None if finite and not math.isfinite(value) else value
    if value is None or type(value) in _SAME:
        return value
    if hasattr(value, "to_dict"):
        return value.to_dict()
    if type(value) in TEXTS:
        return TEXTS[type(value)](value)
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name), finite=finite) for field in fields(value)}
    if isinstance(value, Mapping):
        return {name: plain(item, finite=finite) for name, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        numbers = value.tolist()
        return numbers if value.dtype.kind in "biuf" and not finite else plain(numbers, finite=finite)
    if isinstance(value, list | tuple):
        return [plain(item, finite=finite) for item in value]
    return None if finite and isinstance(value, float) and not math.isfinite(value) else value


def plain_fields(result: object, names: str, *, finite: bool = True) -> dict[str, Any]:
    """Return the attributes of a result whose names are separated by spaces, as `plain` converts them."""
    return {name: plain(getattr(result, name), finite=finite) for name in names.split()}


@cache
def _encoder(escaped: bool) -> Callable[[Any], str]:
    return json.JSONEncoder(allow_nan=False, ensure_ascii=escaped, separators=(",", ": ")).encode


def indented_json(value: Any, *, escaped: bool = False) -> str:
    """Return the text of `json.dumps(value, indent=1, allow_nan=False)`, five times as fast. If `escaped` is true, the
    text is ASCII."""
    text = _encoder(escaped)(value).encode(errors="surrogatepass")
    return _core.indented(text).decode(errors="surrogatepass")
