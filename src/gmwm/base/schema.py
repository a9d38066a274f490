"""JSON Schema of documents, made from the types and keys by which `gmwm.base.documents` writes and reads them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import is_dataclass
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from gmwm.base.documents import TEXTS, Documented, entries_of
from gmwm.base.kinds import array_type, field_types
from gmwm.base.remarks import Remark, Severity

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
