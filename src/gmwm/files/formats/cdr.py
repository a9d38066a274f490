"""Decode the numbers in serialised ROS messages, many messages at once if they have the same layout.

CDR (ROS 2) has a head of four bytes (byte order) and aligned values; ROS 1 has neither. Equal lengths of strings and
sequences give strided columns; rosbags decodes other messages. Sources: OMG Common Data Representation
(formal/02-06-51, 15.3); ROS wiki, "msg", serialization."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice
from struct import Struct
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadCode, ReadError
from gmwm.base.extras import library
from gmwm.base.text import with_article
from gmwm.files.formats.bagfiles import TEXT_LIMIT, Topic

Encoding = Literal["cdr", "ros1"]  # serialisation of messages

SIZES = {
    "bool": "b1", "byte": "u1", "char": "u1", "octet": "u1", "uint8": "u1", "int8": "i1", "uint16": "u2", "int16": "i2",
    "uint32": "u4", "int32": "i4", "uint64": "u8", "int64": "i8", "float32": "f4", "float64": "f8",
}  # fmt: skip
"""Types that are a single number, with their names in NumPy."""

TIME = "builtin_interfaces/msg/Time"  # the type of a time stamp: seconds and nanoseconds, 32 bits each

_LONG = 16  # longer arrays of numbers are not channels
_STEPS = 100_000  # largest number of parts of a message
_TEMPLATES = 8  # layouts to try in a batch before the general decoder decodes the rest
_COPY_OR_EXPORT = "Copy the file again, or export the topic as CSV."
_WORDS = {"<": Struct("<I"), ">": Struct(">I")}

# Kinds of a field in rosbags; the numbers are part of its interface.
_BASE, _NAME, _ARRAY, _SEQUENCE = 1, 2, 3, 4

Description = Any  # type of a field in the form of rosbags: (kind, (type, …)), nested for arrays


def topic_error(what: str, code: ReadCode) -> ReadError:
    """Return the error for messages that cannot be decoded."""
    return ReadError(what, code=code, advice="Export the topic as CSV.")


@dataclass(frozen=True)
class Definition:
    """A message type with all types that it contains."""

    name: str  # name of the type, for example "sensor_msgs/msg/Imu"
    # for each type name, the name and the description of each field of the type
    types: Mapping[str, Sequence[tuple[str, Description]]]
    encoding: Encoding  # serialisation of the messages

    def leaves(self) -> tuple[str, ...]:
        """Return the names of numbers in every message, such as "gyro[0]"; stamps in ns, no strings or sequences."""
        return tuple(islice(self._leaves(self.name, "", 0), 512))

    def decoder(self, wanted: Sequence[str]) -> Decoder:
        """Return a decoder of some numbers."""
        return Decoder(self, wanted)

    def _leaves(self, kind: str, prefix: str, depth: int) -> Iterator[str]:
        for name, description in self.fields(kind, depth):
            path = prefix + name
            sort, inner = description
            if sort == _ARRAY:
                part, count = inner
                if count <= _LONG:
                    for k in range(count):
                        yield from self._leaf(part, f"{path}[{k}]", depth)
            elif sort != _SEQUENCE:
                yield from self._leaf(description, path, depth)

    def _leaf(self, description: Description, path: str, depth: int) -> Iterator[str]:
        sort, inner = description
        if sort == _BASE:
            if inner[0] in SIZES:
                yield path
        elif inner == TIME:
            yield path
        else:
            yield from self._leaves(inner, f"{path}.", depth + 1)

    def fields(self, kind: str, depth: int) -> Sequence[tuple[str, Description]]:
        """Return the fields of one of the types, which is nested in `depth` others."""
        if depth > 32:  # largest nesting depth: a definition that contains itself would have no end
            raise topic_error(f"the message type {self.name} holds itself", "type-recursive")
        if kind not in self.types:
            raise topic_error(
                f"the message type {self.name} holds {kind}, which the recording does not define", "type-undefined"
            )
        return self.types[kind]


@dataclass(frozen=True)
class Template:
    """Positions of the numbers in a message, valid for all messages with the same lengths of strings and sequences."""

    order: str  # byte order
    # For each wanted number, its NumPy type and its offset in the message (bytes). The type "time" is two 32-bit words
    places: Mapping[str, tuple[str, int]]
    words: tuple[tuple[int, int], ...]  # offset (bytes) and value of the length of each string and sequence
    size: int  # length of the message (bytes)


@dataclass
class _Walk:
    """State of a pass over a message: the current position, and the numbers and lengths found so far."""

    definition: Definition
    message: bytes
    wanted: frozenset[str]
    order: str
    base: int
    position: int
    steps: int = 0
    places: dict[str, tuple[str, int]] = field(default_factory=dict)
    words: list[tuple[int, int]] = field(default_factory=list)

    def align(self, size: int) -> None:
        if self.definition.encoding == "cdr":
            self.position += -(self.position - self.base) % size

    def length(self) -> int:
        self.align(4)
        if self.position + 4 > len(self.message):
            raise self.mismatch()
        value = int(_WORDS[self.order].unpack_from(self.message, self.position)[0])
        self.words.append((self.position, value))
        self.position += 4
        return value

    def struct(self, kind: str, prefix: str, depth: int = 0) -> None:
        for name, description in self.definition.fields(kind, depth):
            self.value(description, prefix + name, depth)

    def value(self, description: Description, path: str, depth: int) -> None:
        self.steps += 1
        if self.steps > _STEPS:
            raise topic_error(f"a message of type {self.definition.name} has more than {_STEPS} parts", "too-many")
        if self.position > len(self.message):
            raise self.mismatch()
        sort, inner = description
        if sort == _BASE and inner[0] == "string":
            length = self.length()
            self.position += length
        elif sort == _BASE and inner[0] in SIZES:
            self.number(SIZES[inner[0]], int(SIZES[inner[0]][1]), path)
        elif sort == _BASE:
            raise topic_error(
                f"the message type {self.definition.name} holds {with_article(inner[0])} ({path}), which is not "
                "supported", "unsupported",
            )  # fmt: skip
        elif sort == _NAME and inner == TIME:
            self.number("time", 4, path)
        elif sort == _NAME:
            self.struct(inner, f"{path}.", depth + 1)
        else:
            part, count = inner[0], inner[1] if sort == _ARRAY else self.length()
            if part[0] == _BASE and part[1][0] in SIZES and count > _LONG:
                size = int(SIZES[part[1][0]][1])
                self.align(size)
                self.position += size * count
                return
            for k in range(count):
                self.value(part, f"{path}[{k}]", depth)

    def number(self, kind: str, alignment: int, path: str) -> None:
        self.align(alignment)
        if path in self.wanted:
            self.places[path] = (kind, self.position)
        self.position += 8 if kind == "time" else alignment

    def mismatch(self) -> ReadError:
        return ReadError(
            f"a message of {len(self.message)} bytes does not fit its type {self.definition.name}: damaged, or of "
            "another version of it",
            code="message-damaged", advice=_COPY_OR_EXPORT,
        )  # fmt: skip


def template(definition: Definition, message: bytes, wanted: Sequence[str]) -> Template:
    """Find the positions of the numbers in a message."""
    cdr = definition.encoding == "cdr"
    if cdr and message[:2] not in (b"\0\0", b"\0\1"):
        begin = " ".join(f"{byte:02x}" for byte in message[:4])
        raise ReadError(
            f"a message of type {definition.name} begins with the bytes {begin or '(none)'}, expected CDR (00 00 or "
            "00 01)", code="message-encoding", advice=_COPY_OR_EXPORT,
        )  # fmt: skip
    start = 4 if cdr else 0
    walk = _Walk(
        definition=definition, message=message, wanted=frozenset(wanted),
        order=">" if message[:2] == b"\0\0" and cdr else "<", base=start, position=start,
    )  # fmt: skip
    if cdr and len(message) < 4:
        raise walk.mismatch()
    walk.struct(definition.name, "")
    if not 0 <= len(message) - walk.position <= (3 if cdr else 0):
        raise walk.mismatch()
    return Template(walk.order, walk.places, tuple(walk.words), len(message))


class Decoder:
    """Decodes the numbers of messages of one type."""

    def __init__(self, definition: Definition, wanted: Sequence[str]) -> None:
        self.definition = definition
        self.wanted = tuple(wanted)
        self.slow = 0
        """Number of messages that needed the general decoder."""
        self._known: list[Template] = []
        self._store: Any = None

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """Decode the wanted numbers of N messages. Return an array (N,) of int64 or float64 for each name."""
        sizes = np.fromiter(map(len, messages), np.int64, len(messages))
        out: dict[str, NDArray[Any]] = {}
        remaining = np.arange(len(messages))
        for _ in range(_TEMPLATES):
            if not remaining.size:
                break
            first = messages[int(remaining[0])]
            alike = remaining[sizes[remaining] == len(first)]
            # Usually all messages fit, so no selection is needed.
            rows = messages if alike.size == len(messages) else [messages[k] for k in alike.tolist()]
            plan = self._template(first)
            # Strings and sequences in a message: with more, the next message hardly ever has the same lengths
            if len(plan.words) > 256:
                break
            numbers, fits = self._read_columns(b"".join(rows), plan)
            for name, values in numbers.items():
                _put(out, name, values=values[fits], rows=alike[fits], count=len(messages))
            remaining = np.setdiff1d(remaining, alike[fits], assume_unique=True)
        if remaining.size:
            for name, values in self.general([messages[k] for k in remaining.tolist()]).items():
                _put(out, name, values=values, rows=remaining, count=len(messages))
        return out

    def _template(self, message: bytes) -> Template:
        """Return a template that fits a message: a known one, or a new one."""
        for plan in self._known:
            if plan.size == len(message) and bool(self._read_columns(message, plan)[1][0]):
                return plan
        plan = template(self.definition, message, self.wanted)
        self._known = [plan, *self._known[: _TEMPLATES - 1]]
        return plan

    def _read_columns(self, joined: bytes, plan: Template) -> tuple[dict[str, NDArray[Any]], NDArray[np.bool_]]:
        """Read the numbers at the offsets of the template; return them with a mask of the messages that fit."""
        fields = [
            (f"{name}#{k}", plan.order + word, offset + 4 * k)
            for name, (kind, offset) in plan.places.items()
            # Seconds and nanoseconds; unsigned in ROS 1, which matters from 2038 on
            for k, word in enumerate(("i4", "u4") if kind == "time" else (kind,))
        ]
        fields += [(f"#{k}", plan.order + "u4", offset) for k, (offset, _) in enumerate(plan.words)]
        cdr = self.definition.encoding == "cdr"
        names, formats, offsets = zip(*fields, *([("#order", "<u2", 0)] if cdr else []), strict=True)
        record = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": plan.size})
        table = np.frombuffer(joined, record)
        fits = np.ones(table.size, dtype=bool)
        if cdr:
            fits &= table["#order"] == (0x0100 if plan.order == "<" else 0)
        for k, (_, value) in enumerate(plan.words):
            fits &= table[f"#{k}"] == value
        numbers = {}
        for name, (kind, _) in plan.places.items():
            if kind == "time":
                seconds, nanoseconds = table[f"{name}#0"].astype(np.int64), table[f"{name}#1"].astype(np.int64)
                numbers[name] = seconds * 10**9 + nanoseconds
            elif kind == "b1":  # any byte but 0 is true
                numbers[name] = _wide(table[f"{name}#0"].view(np.uint8) != 0)
            else:
                numbers[name] = _wide(table[f"{name}#0"])
        return numbers, fits

    def general(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """Decode the same numbers as `decode` with the decoder of rosbags, one message at a time."""
        self.slow += len(messages)
        if self._store is None:
            self._store = _store(self.definition)
        store, name = self._store, self.definition.name
        decode = store.deserialize_cdr if self.definition.encoding == "cdr" else store.deserialize_ros1
        paths = [(leaf, _path(leaf)) for leaf in self.wanted]
        columns: dict[str, list[Any]] = {leaf: [] for leaf in self.wanted}
        for message in messages:
            try:
                decoded = decode(message, name)
            except Exception as error:  # a library can raise any error on invalid data
                raise ReadError(
                    f"a message of {len(message)} bytes does not fit its type {name}: {error}",
                    code="message-damaged",
                    advice=_COPY_OR_EXPORT,
                ) from error
            for leaf, path in paths:
                columns[leaf].append(_follow(decoded, path))
        return {leaf: _wide(np.array(values)) for leaf, values in columns.items()}


def _put(out: dict[str, NDArray[Any]], name: str, values: NDArray[Any], rows: NDArray[np.int64], count: int) -> None:
    """Write values into the given rows of a column of `out`."""
    if values.size == count:
        out[name] = values
        return
    column = out.setdefault(name, np.zeros(count, dtype=values.dtype))
    if column.dtype != values.dtype:
        column = out[name] = column.astype(np.float64)
    column[rows] = values


def _wide(values: NDArray[Any]) -> NDArray[Any]:
    """Convert integers to int64 if they fit, and everything else to float64."""
    if values.dtype.kind == "u" and values.dtype.itemsize == 8 and values.size and int(values.max()) > 2**63 - 1:
        return values.astype(np.float64)
    return values.astype(np.int64 if values.dtype.kind in "iub" else np.float64)


def _path(leaf: str) -> list[str | int]:
    """Split the name of a number into steps: "a.b[2]" becomes a, b, 2."""
    steps: list[str | int] = []
    for part in leaf.split("."):
        name, *indices = part.replace("]", "").split("[")
        steps += [name, *map(int, indices)]
    return steps


def _follow(message: Any, path: Sequence[str | int]) -> Any:
    """Return the number at a path in a decoded message. A time stamp is converted to nanoseconds."""
    from rosbags.typesys.base import normalize_fieldname

    for step in path:
        message = message[step] if isinstance(step, int) else getattr(message, normalize_fieldname(step))
    return message.sec * 10**9 + message.nanosec if hasattr(message, "nanosec") else message


def _store(definition: Definition) -> Any:
    """Convert the types to the form that the decoder of rosbags needs."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.EMPTY)
    try:
        defined = set(store.fielddefs)
        # Constants are omitted, because the decoder generates code from the definition in the file.
        store.register({name: ([], list(fields)) for name, fields in definition.types.items() if name not in defined})
    except Exception as error:  # a library can raise any error on an invalid definition
        raise topic_error(f"the message type {definition.name} is not understood: {error}", "type-invalid") from error
    return store


IMU = "sensor_msgs/msg/Imu"

_FIELD_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_TYPE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)+")
_EMPTY = (("structure_needs_at_least_one_member", (1, ("uint8", 0))),)  # how CDR stores a message without fields


def definition(topic: Topic) -> Definition | None:
    """Return the type of a topic's messages, or None; before ROS 2 Iron, only types that ROS includes are known."""
    library("rosbags")
    from rosbags.typesys import Stores, get_typestore

    if topic.encoding not in ("cdr", "ros1"):  # serialisation formats of messages that gmwm can decode
        return None
    ros1 = topic.encoding == "ros1"
    if topic.text:
        types = _parse_types(topic)
    else:
        store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
        types = {name: fields for name, (_, fields) in store.fielddefs.items()}
    if topic.type not in types:
        return None
    return Definition(topic.type, types if ros1 else {k: v or _EMPTY for k, v in types.items()}, topic.encoding)  # type: ignore[arg-type]


def _parse_types(topic: Topic) -> Mapping[str, Sequence[tuple[str, Description]]]:
    """Parse the definition text of a topic into its types."""
    from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

    if len(topic.text) > TEXT_LIMIT:
        raise topic_error(f"{topic.name}: its type is defined in more than {TEXT_LIMIT} characters", "type-invalid")
    definitions: dict[str, Any] = dict(get_typestore(Stores.EMPTY).fielddefs)
    try:
        if topic.language != "ros2idl":
            definitions |= get_types_from_msg(topic.text, topic.type)
        else:  # several files are joined, each after a line of = and a line with its name
            line = "=" * 80 + "\n"
            joined = topic.text.startswith(f"{line}IDL: ")
            parts = [part.partition("\n")[2] for part in topic.text.split(line)[1:]] if joined else [topic.text]
            for part in parts:
                definitions |= get_types_from_idl(part)
    except Exception as error:  # a library can raise any error on an invalid definition
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise topic_error(
            f"{topic.name}: the definition of its type {topic.type} is not understood ({reason})", "type-invalid"
        ) from error
    types = {name: fields for name, (_, fields) in definitions.items()}
    for name, fields in types.items():
        _require_plain(name, fields, topic)
    return types


def _require_plain(name: str, fields: Sequence[tuple[str, Description]], topic: Topic) -> None:
    """Require plain names and short arrays, because code of the decoder is generated from them."""
    plain = bool(_TYPE.fullmatch(name))
    for label, (sort, inner) in fields:
        plain &= bool(_FIELD_NAME.fullmatch(label))
        if sort in (3, 4):
            part, count = inner
            # Elements of an array of strings or messages; the general decoder has a line of code for each
            plain &= sort == 4 or count <= 4096 or (part[0] == 1 and part[1][0] != "string")
            sort, inner = part
        plain &= sort != 2 or bool(_TYPE.fullmatch(inner))
    if not plain:
        raise topic_error(
            f"{topic.name}: the definition of its type {topic.type} holds what is no name, or a huge array",
            "type-invalid",
        )
