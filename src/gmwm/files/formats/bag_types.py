"""Find the message types of ROS recordings, in the file or among the definitions that ROS includes."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

from gmwm.base.extras import library
from gmwm.files.formats.bagfiles import TEXT_LIMIT, Topic
from gmwm.files.formats.cdr import Definition, Description, topic_error

IMU = "sensor_msgs/msg/Imu"

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_TYPE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)+")
_EMPTY = (("structure_needs_at_least_one_member", (1, ("uint8", 0))),)  # how CDR stores a message without fields


def definition(topic: Topic) -> Definition | None:
    """Return the type of the messages of a topic, or None if it is not defined or its messages cannot be decoded.

    Recordings before ROS 2 Iron contain no definitions; their types are those that ROS includes.
    """
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
    for field, (sort, inner) in fields:
        plain &= bool(_NAME.fullmatch(field))
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
