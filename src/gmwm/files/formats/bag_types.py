"""Find the message types of ROS recordings, in the file or among the definitions that ROS includes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from gmwm.files.formats.bagfiles import TEXT_LIMIT, Topic
from gmwm.files.formats.cdr import Definition, Description, topic_error

ENCODINGS = ("cdr", "ros1")
"""Serialisation formats of messages that gmwm can decode."""

IMU = "sensor_msgs/msg/Imu"

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_TYPE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)+")
_LARGEST = 4096  # elements of an array of strings or messages; the general decoder has a line of code for each
_EMPTY = (("structure_needs_at_least_one_member", (1, ("uint8", 0))),)  # how CDR stores a message without fields


def definition(topic: Topic) -> Definition | None:
    """Return the type of the messages of a topic, or None if it is not defined or its messages cannot be decoded."""
    if topic.encoding not in ENCODINGS:
        return None
    ros1 = topic.encoding == "ros1"
    types = _parsed(topic) if topic.text else _builtin(ros1)
    if topic.type not in types:
        return None
    return Definition(topic.type, types if ros1 else {k: v or _EMPTY for k, v in types.items()}, topic.encoding)  # type: ignore[arg-type]


def _builtin(ros1: bool) -> Mapping[str, Sequence[tuple[str, Description]]]:
    """Return the types that ROS includes, for recordings before ROS 2 Iron, which do not contain definitions."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    return {name: fields for name, (_, fields) in store.fielddefs.items()}


def _parsed(topic: Topic) -> Mapping[str, Sequence[tuple[str, Description]]]:
    """Parse the definition text of a topic into its types."""
    from rosbags.typesys import Stores, get_typestore

    if len(topic.text) > TEXT_LIMIT:
        raise topic_error(f"{topic.name}: its type is defined in more than {TEXT_LIMIT} characters", "type-invalid")
    found: dict[str, Any] = {}
    try:
        for text in _idl_parts(topic.text) if topic.language == "ros2idl" else (topic.text,):
            found |= _parse(text, topic)
    except Exception as error:  # a library can raise any error on an invalid definition
        reason = str(error).splitlines()[0][:200] if str(error) else type(error).__name__
        raise topic_error(
            f"{topic.name}: the definition of its type {topic.type} is not understood ({reason})", "type-invalid"
        ) from error
    types = {name: fields for name, (_, fields) in get_typestore(Stores.EMPTY).fielddefs.items()}
    types |= {name: fields for name, (_, fields) in found.items()}
    for name, fields in types.items():
        _require_plain(name, fields, topic)
    return types


def _parse(text: str, topic: Topic) -> dict[str, Any]:
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    if topic.language == "ros2idl":
        return dict(get_types_from_idl(text))
    return dict(get_types_from_msg(text, topic.type))


def _idl_parts(text: str) -> list[str]:
    """Split a joined IDL text into its files. A line of = and a line with the name precede each file."""
    line = "=" * 80 + "\n"
    if not text.startswith(f"{line}IDL: "):
        return [text]
    return [part.partition("\n")[2] for part in text.split(line)[1:]]


def _require_plain(name: str, fields: Sequence[tuple[str, Description]], topic: Topic) -> None:
    """Require plain names and short arrays, because code of the decoder is generated from them."""
    plain = bool(_TYPE.fullmatch(name))
    for field, (sort, inner) in fields:
        plain &= bool(_NAME.fullmatch(field))
        if sort in (3, 4):
            part, count = inner
            plain &= sort == 4 or count <= _LARGEST or (part[0] == 1 and part[1][0] != "string")
            sort, inner = part
        plain &= sort != 2 or bool(_TYPE.fullmatch(inner))
    if not plain:
        raise topic_error(
            f"{topic.name}: the definition of its type {topic.type} holds what is no name, or a huge array",
            "type-invalid",
        )
