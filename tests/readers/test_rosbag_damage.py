"""Files that are no recordings, or not all of one: a clear error, never a part of the numbers, never a traceback."""

from __future__ import annotations

import shutil
import sqlite3
import struct
import warnings
from contextlib import closing

import numpy as np
import pytest

from gmwm.base.errors import GmwmError, GmwmWarning, ReadError
from gmwm.files.formats import bagfiles
from gmwm.files.formats.bag_mcap import McapStorage
from gmwm.files.formats.bagfiles import Topic, decompress
from gmwm.files.formats.cdr import definition
from gmwm.files.readers import read
from tests.helpers import each, raises
from tests.readers.rosbag_files import CONTAINERS, START, STEP, flat, imu, numbers, recorded, store_of, written

DATA = numbers(40)


def one_file(folder, container):
    path = recorded(folder, container, DATA)
    return path if path.is_file() else next(file for file in path.iterdir() if file.name != "metadata.yaml")


@pytest.mark.slow
def test_cut_anywhere(tmp_path):
    """A file cut off is an error at every length: containers say where they end."""
    for container in ("ros1", "ros1-lz4", "db3", "mcap", "mcap-zstd"):
        path = one_file(tmp_path, container)
        whole = path.read_bytes()
        cut = tmp_path / f"cut{path.suffix}"
        for size in [*range(1, 64), *range(64, len(whole), max(1, len(whole) // 60)), len(whole) - 1]:
            cut.write_bytes(whole[:size])
            with pytest.raises(GmwmError):
                read(cut, format="rosbag")


@pytest.mark.slow
@pytest.mark.parametrize("container", CONTAINERS)
def test_bytes_overwritten(tmp_path, container):
    """Damage is an error, or in what nobody reads, or in a number: never a traceback, never another count."""
    path = one_file(tmp_path, container)
    whole = bytearray(path.read_bytes())
    random = np.random.default_rng(5)
    for _ in range(30):
        damaged = bytearray(whole)
        at = int(random.integers(0, len(whole)))
        damaged[at : at + 4] = random.bytes(4)
        path.write_bytes(damaged[: len(whole)])
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", GmwmWarning)
                found = read(path, format="rosbag", topic="/imu/data")
        except GmwmError:
            continue
        assert len(found) <= len(DATA)


def test_foreign_and_mislabelled_files(tmp_path):
    text = tmp_path / "a.mcap"
    text.write_text("time,gyro_x [rad/s]\n" + "".join(f"{k / 10},{k % 7}\n" for k in range(20)))
    assert len(read(text)) == 20  # the content decides
    with raises(ReadError, "ROS 1", "SQLite", "MCAP"):
        read(text, format="rosbag")
    other = tmp_path / "other.db3"
    with closing(sqlite3.connect(other)) as base:
        base.execute("CREATE TABLE songs (name)")
        base.commit()
    with raises(ReadError, "SQLite"):
        read(other)
    old = tmp_path / "old.bag"
    old.write_bytes(b"#ROSBAG V1.2\n" + b"\0" * 100)
    with raises(ReadError, "ROS 1", "version 1.2", "expected 2.0"):
        read(old)
    right, wrong = one_file(tmp_path, "mcap"), tmp_path / "wrong.bag"
    shutil.copy(right, wrong)
    assert len(read(wrong)) == len(DATA)
    with raises(ReadError, code="is-directory"):
        read(tmp_path)


@pytest.mark.parametrize(
    ("statements", "code"),
    [
        # A view could be a program that never ends.
        (
            ["ALTER TABLE messages RENAME TO real", "CREATE VIEW messages AS SELECT * FROM real"],
            "no-recording",
        ),
        (["UPDATE messages SET data = 'text' WHERE id = 20"], "message-damaged"),
    ],
)
def test_a_view_is_no_table_and_messages_are_bytes(tmp_path, statements, code):
    path = one_file(tmp_path, "db3")
    with closing(sqlite3.connect(path)) as base:
        for statement in statements:
            base.execute(statement)
        base.commit()
    with raises(ReadError, code=code):
        read(path)


def test_what_is_not_yet_in_the_database_is_read_from_its_log(tmp_path):
    """A recorder that was killed leaves a log beside the file, and in it the last messages."""
    path = one_file(tmp_path, "db3")
    copy = tmp_path / "copy.db3"
    with closing(sqlite3.connect(path)) as base:
        base.execute("PRAGMA journal_mode=WAL")
        rows = base.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
        base.execute("DELETE FROM messages WHERE id > 30")
        base.commit()
        base.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        base.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows[30:])
        base.commit()
        for end in ("", "-wal"):
            shutil.copy(f"{path}{end}", f"{copy}{end}")
    assert read(copy)["gyro_x"].values.tolist() == DATA[:, 0].tolist()


def test_a_bag_that_was_not_closed(tmp_path):
    path = recorded(tmp_path, "ros1", DATA)
    whole = bytearray(path.read_bytes())
    at = whole.index(b"index_pos=") + 10
    whole[at : at + 8] = bytes(8)
    path.write_bytes(whole)
    with raises(ReadError, code="no-index", advises=["rosbag reindex"]):
        read(path)
    whole[at : at + 8] = b"\xff" * 8
    path.write_bytes(whole)
    with raises(ReadError, code="index-damaged"):
        read(path)


def test_an_mcap_that_was_not_closed(tmp_path):
    path = one_file(tmp_path, "mcap")
    path.write_bytes(path.read_bytes()[:-8])
    with raises(ReadError, code="cut-off", advises=["mcap recover"]):
        read(path)


def test_checksums_are_looked_at(tmp_path):
    path = one_file(tmp_path, "mcap")
    whole = bytearray(path.read_bytes())
    at = whole.index(np.float64(DATA[20, 5]).tobytes())
    whole[at] ^= 1
    path.write_bytes(whole)
    storage = McapStorage(path)
    (topic,) = storage.topics()
    with_sum = struct.unpack_from("<I", whole, whole.index(b"\x06", 60) + 9 + 24)[0] != 0
    if with_sum:
        with raises(ReadError, code="checksum-wrong"):
            list(storage.batches(topic))
    with raises(ReadError, code="checksum-wrong"):
        bagfiles.require_checksum(b"ab", 1, path)


@pytest.mark.slow
def test_bombs(tmp_path):
    import bz2

    import lz4.frame

    zeros = bytes(10_000_000)
    zstd = bagfiles._decompressor("zstd").__class__.__module__
    assert "zstd" in zstd
    for kind, data in (("bz2", bz2.compress(zeros)), ("lz4", lz4.frame.compress(zeros))):
        assert len(decompress(data, kind, len(zeros), tmp_path)) == len(zeros)
        with raises(ReadError, "1001 bytes", "expected 1000"):
            decompress(data, kind, 1000, tmp_path)
        with raises(ReadError, code="chunk-damaged"):
            decompress(data[: len(data) // 2], kind, len(zeros), tmp_path)
    with raises(ReadError, "256 MB"):
        decompress(b"", "lz4", 1 << 40, tmp_path)
    with raises(ReadError, "'rar'"):
        decompress(b"", "rar", 10, tmp_path)


def test_metadata_that_is_none(tmp_path):
    for text in (
        "rosbag2_bagfile_information:\n  relative_file_paths: 3\n",
        "rosbag2_bagfile_information: [\n",
        "rosbag2_bagfile_information:\n  a: !!python/object/apply:os.system [x]\n  relative_file_paths: []\n",
    ):
        (tmp_path / "metadata.yaml").write_text(text)
        with raises(ReadError, "metadata.yaml", code="no-recording"):
            read(tmp_path)
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  relative_file_paths: []\n")
    with raises(ReadError, "0 files"):
        read(tmp_path)


def test_a_type_that_nobody_defines(tmp_path):
    """Databases before ROS 2 Iron hold no definitions: standard types are known all the same, others are not."""
    store = store_of("db3")
    for kind, make in (("sensor_msgs/msg/Imu", imu), ("my_msgs/msg/Flat", flat)):
        messages = [(START + k * STEP, make(store, START + k * STEP, row)) for k, row in enumerate(DATA)]
        folder = written(tmp_path, "db3", {"/a": (kind, messages)})
        path = next(file for file in folder.iterdir() if file.suffix == ".db3")
        with closing(sqlite3.connect(path)) as base:
            base.execute("DROP TABLE message_definitions")
            base.commit()
        if make is imu:
            assert read(path)["gyro_x"].values.tolist() == DATA[:, 0].tolist()
        else:
            with raises(ReadError, "my_msgs/msg/Flat"):
                read(path)


@each(
    "text",
    [
        "float64 x\x00",
        "float64",
        "float64[99999999] a\nstring[99999999] b",
        "other/Kind[5000] a",
        "=" * 90,
        "float64 x=1;import os",
        "(" * 5000,
    ],
)
@each("language", ["ros1msg", "ros2msg", "ros2idl"])
def test_definitions_by_strangers(text, language):
    topic = Topic("/a", "t/msg/T", "ros1" if language == "ros1msg" else "cdr", text, language)
    with raises(ReadError, "/a", code="type-invalid"):
        definition(topic)
    with raises(ReadError, "1048576 characters"):
        definition(Topic("/a", "t/msg/T", "cdr", "x" * (1 << 21), language))
    odd = Topic("/a", 't/msg/T"\nimport os', "cdr", "float64 x", language)
    with raises(ReadError, "/a", code="type-invalid"):
        definition(odd)


def test_an_idl_definition():
    text = (
        "=" * 80 + "\nIDL: t/msg/T\nmodule t { module msg { struct T { double gyro_x; long n; }; }; };\n"
        "\n" + "=" * 80 + "\nIDL: t/msg/B\nmodule t { module msg { struct B { float y; }; }; };\n"
    )
    found = definition(Topic("/a", "t/msg/T", "cdr", text, "ros2idl"))
    assert found is not None
    assert found.leaves() == ("gyro_x", "n")
    assert definition(Topic("/a", "t/msg/T", "json", text, "ros2idl")) is None
