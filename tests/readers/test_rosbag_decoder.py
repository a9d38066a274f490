"""Numbers at fixed offsets against rosbags' general decoder: the same to the last bit, or both refuse."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import get_types_from_msg

from gmwm.base.errors import ReadError
from gmwm.files.formats.cdr import Decoder, Definition, template
from tests.helpers import each, raises
from tests.readers.rosbag_files import FLAT, NESTED, PART, START, STEP, flat, imu, nested, numbers, store_of

KINDS = {"imu": "sensor_msgs/msg/Imu", "flat": "my_msgs/msg/Flat", "nested": "vn_msgs/msg/Nested"}
WAYS = ("ros1", "little", "big")


def serialised(kind, way, lengths, count=40, seed=1):
    """Messages of a type whose texts and sequences have the given lengths, one after another."""
    store, data = store_of("ros1" if way == "ros1" else "mcap"), numbers(count, seed)
    out = []
    for k, row in enumerate(data):
        stamp, length = START + k * STEP, lengths[k % len(lengths)]
        message = {
            "imu": lambda s, r, n: imu(store, s, r, "f" * n),
            "flat": lambda s, r, n: flat(store, s, r, "f" * n),
            "nested": lambda s, r, n: nested(store, s, r, n),
        }[kind](stamp, row, length)
        if way == "ros1":
            out.append(bytes(store.serialize_ros1(message, KINDS[kind])))
        else:
            out.append(bytes(store.serialize_cdr(message, KINDS[kind], little_endian=way == "little")))
    return out


def defined(kind, way):
    store = store_of("ros1" if way == "ros1" else "mcap")
    types = {name: fields for name, (_, fields) in store.fielddefs.items()}
    return Definition(KINDS[kind], types, "ros1" if way == "ros1" else "cdr")


def same(one, other):
    assert one.keys() == other.keys()
    for name, values in one.items():
        assert values.dtype == other[name].dtype, name
        assert values.tobytes() == other[name].tobytes(), name


@pytest.mark.slow
@each("way", WAYS)
@each("kind", KINDS)
@each("lengths", [[3], [0], [3, 8], [1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13]])
def test_the_fast_path_equals_the_general_decoder(kind, way, lengths):
    messages = serialised(kind, way, lengths, count=20)
    definition = defined(kind, way)
    leaves = definition.leaves()
    assert len(leaves) >= 7
    fast = Decoder(definition, leaves)
    same(fast.decode(messages), Decoder(definition, leaves).general(messages))
    few = len({len(message) for message in messages}) <= 2
    assert (fast.slow == 0) == few or len(lengths) > 2


@pytest.mark.slow
def test_only_messages_that_differ_go_the_slow_way():
    fast = Decoder(defined("imu", "little"), ["angular_velocity.x"])
    fast.decode(serialised("imu", "little", [8]))
    assert fast.slow == 0
    fast.decode(serialised("imu", "little", list(range(0, 130, 5))))
    assert 0 < fast.slow < 40


@pytest.mark.slow
def test_mixed_byte_orders():
    messages = serialised("imu", "little", [3])
    messages[1::2] = serialised("imu", "big", [3])[1::2]
    definition = defined("imu", "little")
    fast = Decoder(definition, definition.leaves())
    same(fast.decode(messages), Decoder(definition, definition.leaves()).general(messages))
    assert fast.slow == 0


def test_same_size_with_lengths_swapped_is_seen():
    """Two texts may trade their lengths: the size of the message is the same, the places are not."""
    types = {
        name: fields for name, (_, fields) in get_types_from_msg("string a\nfloat64 x\nstring b", "t/msg/T").items()
    }
    definition = Definition("t/msg/T", types, "ros1")
    word = lambda n: n.to_bytes(4, "little")  # noqa: E731
    number = np.float64(1.5).tobytes()
    one, other = (word(n) + b"a" * n + number + word(m) + b"b" * m for n, m in ((2, 9), (9, 2)))
    assert len(one) == len(other)
    assert Decoder(definition, ["x"]).decode([one, other, one])["x"].tolist() == [1.5, 1.5, 1.5]


def test_stamps_of_both_versions():
    """Nanoseconds since 1970 are exact."""
    for way, seconds in (("little", -5), ("ros1", 2**31 - 1)):
        store = store_of("ros1" if way == "ros1" else "mcap")
        time = store.types["builtin_interfaces/msg/Time"](seconds, 999_999_999)
        name = "std_msgs/msg/Header"
        kind = store.types[name]
        message = kind(0, time, "x") if way == "ros1" else kind(time, "x")
        data = bytes(store.serialize_ros1(message, name) if way == "ros1" else store.serialize_cdr(message, name))
        types = {key: fields for key, (_, fields) in store.fielddefs.items()}
        definition = Definition(name, types, "ros1" if way == "ros1" else "cdr")
        assert Decoder(definition, ["stamp"]).decode([data])["stamp"].tolist() == [seconds * 10**9 + 999_999_999]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_message_cut_anywhere_is_an_error(kind, way):
    message = serialised(kind, way, [5], count=1)[0]
    decoder = Decoder(defined(kind, way), ["header.stamp"] if kind != "flat" else ["timestamp"])
    spare = 0 if way == "ros1" else 3
    for size in range(len(message)):
        with pytest.raises(ReadError) as caught:
            decoder.decode([message[:size]])
        assert caught.value.code in ("message-damaged", "message-encoding")
    for more in range(1, 9):
        if more > spare:
            with raises(ReadError, code="message-damaged"):
                decoder.decode([message + b"\0" * more])


def test_a_huge_text_and_a_huge_count_are_errors_at_once():
    types = {name: fields for name, (_, fields) in get_types_from_msg("string a\nfloat64 x", "t/msg/T").items()}
    types["t/msg/Empty"] = []
    types["t/msg/Many"] = [("empty", (4, ((2, "t/msg/Empty"), 0)))]
    for size in (2**31, 2**32 - 1, 100):
        with raises(ReadError, code="message-damaged"):
            Decoder(Definition("t/msg/T", types, "ros1"), ["x"]).decode([size.to_bytes(4, "little") + b"a" * 20])
    with raises(ReadError, "100000 parts"):
        template(Definition("t/msg/Many", types, "ros1"), b"\xff\xff\xff\xff", [])


def test_types_that_hold_themselves_or_unknown_ones():
    types = {"t/msg/A": [("b", (2, "t/msg/B"))], "t/msg/B": [("a", (2, "t/msg/A"))], "t/msg/C": [("d", (2, "t/msg/D"))]}
    with raises(ReadError, "t/msg/A", code="type-recursive"):
        Definition("t/msg/A", types, "cdr").leaves()
    with raises(ReadError, "t/msg/A", code="type-recursive"):
        template(Definition("t/msg/A", types, "ros1"), b"", [])
    with raises(ReadError, "t/msg/D", code="type-undefined"):
        Definition("t/msg/C", types, "cdr").leaves()


def test_unsigned_numbers_beyond_int64_become_float():
    types = {name: fields for name, (_, fields) in get_types_from_msg("uint64 n", "t/msg/T").items()}
    decoder = Decoder(Definition("t/msg/T", types, "ros1"), ["n"])
    assert decoder.decode([(2**64 - 1).to_bytes(8, "little")])["n"].tolist() == [2.0**64]
    assert decoder.decode([(2**63 - 1).to_bytes(8, "little")])["n"].tolist() == [2**63 - 1]


@pytest.mark.slow
@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.sampled_from(list(KINDS)), st.sampled_from(WAYS), st.data())
def test_damaged_messages_are_numbers_or_errors_alike(kind, way, data):
    """Bytes are overwritten at random: where both decoders accept what is left, they agree."""
    messages = [bytearray(message) for message in serialised(kind, way, [2, 5], count=4)]
    for message in messages[:2]:
        for _ in range(data.draw(st.integers(1, 3))):
            message[data.draw(st.integers(0, len(message) - 1))] = data.draw(st.integers(0, 255))
    definition = defined(kind, way)
    plain = [bytes(message) for message in messages]
    try:
        fast = Decoder(definition, definition.leaves()).decode(plain)
    except ReadError:
        return
    try:
        slow = Decoder(definition, definition.leaves()).general(plain)
    except ReadError:
        return  # it also looks at what a text holds, which nobody asked for
    same(fast, slow)


def test_definitions_are_what_the_recording_says():
    assert "gx" in FLAT
    assert defined("flat", "little").leaves() == ("timestamp", "temperature", "ok", "gx", "gy", "ax", "counts")
    leaves = defined("nested", "little").leaves()
    assert leaves[:4] == ("header.stamp", "gyro[0]", "gyro[1]", "gyro[2]")
    assert {"parts[1].big", "when", "small"} < set(leaves)
    assert not [leaf for leaf in leaves if leaf.startswith(("raw", "rest", "names"))]
    assert "raw" in NESTED
    assert "label" in PART
