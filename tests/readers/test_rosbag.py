"""Recordings of ROS, made by rosbags' own writers, read back to the last bit."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from contextlib import closing

import numpy as np
import pytest

from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.units import AXES
from gmwm.files.readers import find_reader, read
from tests.helpers import codes, only, raises
from tests.readers.rosbag_files import (
    CONTAINERS,
    START,
    STEP,
    flat,
    imu,
    nested,
    numbers,
    recorded,
    store_of,
    written,
)

IMU = "sensor_msgs/msg/Imu"


def content(folder):
    """The one file of a directory beside metadata.yaml."""
    return next(file for file in folder.iterdir() if file.name != "metadata.yaml")


@pytest.mark.slow
@pytest.mark.parametrize("container", CONTAINERS)
def test_every_container_gives_the_numbers_bit_for_bit(tmp_path, container):
    data = numbers(300)
    path = recorded(tmp_path, container, data)
    found = read(path)
    assert [found[axis].values.tolist() for axis in AXES] == data.T.tolist()
    assert found.rate == 200
    assert found["gyro_x"].start == START / 1e9
    assert found.remarks[0] == Remark.of("topic-chosen", case="read", topic="/imu/data", type="sensor_msgs/msg/Imu")
    assert only(found.remarks, "unit-named:unit", "gyro").facts == {"case": "unit", "unit": "rad/s", "source": "ros"}


@pytest.mark.slow
@pytest.mark.parametrize("container", ["db3", "mcap", "mcap-zstd", "db3-file", "db3-message", "mcap-message"])
def test_a_file_of_a_directory_stands_for_itself(tmp_path, container):
    data = numbers()
    folder = recorded(tmp_path, container, data)
    alone = shutil.copy(content(folder), tmp_path)
    other_name = shutil.copy(content(folder), tmp_path / "x.bin") if not container.endswith("-file") else alone
    for path in (alone, other_name, folder / "metadata.yaml"):
        assert read(path)["accel_z"].values.tolist() == data[:, 5].tolist()
        assert find_reader(tmp_path / path).name == "rosbag"


@pytest.mark.slow
def test_small_batches_give_the_same(tmp_path, monkeypatch):
    data = numbers(500)
    for container in ("ros1", "db3", "mcap"):
        path = recorded(tmp_path, container, data)
        for name in ("bagfiles", "bag_sqlite"):
            monkeypatch.setattr(f"gmwm.files.formats.{name}.BATCH_BYTES", 1000)
        monkeypatch.setattr("gmwm.files.formats.bag_sqlite._FIRST", 3)
        assert read(path)["gyro_y"].values.tolist() == data[:, 1].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("container", ["db3", "ros1"])
@pytest.mark.parametrize("names", [["imu", "imu_link"], ["f" * k for k in range(40)]])
def test_frames_of_changing_length(tmp_path, container, names):
    """Messages that are not laid out alike are read all the same."""
    store, data = store_of(container), numbers(200)
    messages = [
        (START + k * STEP, imu(store, START + k * STEP, row, frame=names[k % len(names)])) for k, row in enumerate(data)
    ]
    found = read(written(tmp_path, container, {"/imu": (IMU, messages)}))
    assert [found[axis].values.tolist() for axis in AXES] == data.T.tolist()


@pytest.mark.parametrize("container", ["db3", "mcap", "ros1"])
def test_stamps_of_zero_give_way_to_the_time_of_recording(tmp_path, container):
    store, data = store_of(container), numbers()
    messages = [(START + k * STEP, imu(store, 0, row)) for k, row in enumerate(data)]
    found = read(written(tmp_path, container, {"/imu": (IMU, messages)}))
    assert found.rate == 200
    assert found["gyro_x"].start == START / 1e9
    assert only(found.remarks, "time-read:read").facts["form"] == "log"


def test_the_time_of_recording_on_demand(tmp_path):
    path = recorded(tmp_path)
    assert "left-out" not in codes(read(path).remarks)
    found = read(path, columns={"time": "log_time"})
    assert found["gyro_x"].start == pytest.approx(START / 1e9 + 999e-9, abs=0, rel=1e-15)
    assert found.axes == AXES


def test_topics_are_listed_when_several_fit(tmp_path):
    store, data = store_of("mcap"), numbers()
    messages = [(START + k * STEP, imu(store, START + k * STEP, row)) for k, row in enumerate(data)]
    other = [(time, imu(store, time, data[k] * 2)) for k, (time, _) in enumerate(messages)]
    path = written(tmp_path, "mcap", {"/imu/a": (IMU, messages), "/imu/b": (IMU, other)})
    with raises(ReadError, "2 recordings", "/imu/a", "gyro_x", "/b", advises=["topic="]):
        read(path)
    assert read(path, topic="/imu/b")["accel_y"].values.tolist() == (2 * data[:, 4]).tolist()
    with raises(OptionError, "'/imu/c'", argument="topic"):
        read(path, topic="/imu/c")


@pytest.mark.slow
def test_one_inertial_topic_among_others_is_found(tmp_path):
    for container in ("ros1", "db3", "mcap"):
        store, data = store_of(container), numbers()
        fix, vector = store.types["geometry_msgs/msg/PointStamped"], store.types["geometry_msgs/msg/Point"]
        text = store.types["std_msgs/msg/String"]
        messages = [(START + k * STEP, imu(store, START + k * STEP, row)) for k, row in enumerate(data)]
        points = [(time, fix(message.header, vector(1.0, 2.0, 3.0))) for time, message in messages[::10]]
        texts = [(time, text("x" * 1000)) for time, _ in messages[::7]]
        path = written(
            tmp_path,
            container,
            {
                "/p": ("geometry_msgs/msg/PointStamped", points),
                "/imu": (IMU, messages),
                "/t": ("std_msgs/msg/String", texts),
            },
        )
        assert read(path)["gyro_z"].values.tolist() == data[:, 2].tolist()


def test_no_inertial_topic_is_an_error_that_lists_all(tmp_path):
    store = store_of("mcap")
    point, text = store.types["geometry_msgs/msg/Point"], store.types["std_msgs/msg/Float64"]
    points = [(START + k, point(1.0, 2.0, 3.0)) for k in range(9)]
    path = written(
        tmp_path,
        "mcap",
        {
            "/p": ("geometry_msgs/msg/Point", points),
            "/f": ("std_msgs/msg/Float64", [(t, text(1.0)) for t, _ in points]),
        },
    )
    with raises(ReadError, "/p, /f", code="no-inertial-data", advises=["topic="]):
        read(path)


@pytest.mark.parametrize("marked", [False, True])
def test_gyroscope_and_accelerometer_on_topics_of_their_own(tmp_path, marked):
    """As RealSense cameras have them: two clocks, the other sensor zero or marked as absent."""
    store, data = store_of("mcap"), numbers()
    gyro, accel = data.copy(), data.copy()
    if not marked:
        gyro[:, 3:] = accel[:, :3] = 0
    topics = {}
    for name, rows, step, covariance in (("gyro", gyro, STEP, (0, -1)), ("accel", accel, 2 * STEP, (-1, 0))):
        messages = [
            (START + k * step, imu(store, START + k * step, row, covariance=covariance if marked else (0.01, 0.01)))
            for k, row in enumerate(rows)
        ]
        topics[f"/camera/{name}/sample"] = (IMU, messages)
    path = written(tmp_path, "mcap", topics)
    with raises(ReadError, "gyro_x", "gyro_y", "gyro_z"):
        read(path)
    first, second = read(path, topic="/camera/gyro/sample"), read(path, topic="/camera/accel/sample")
    assert first.axes == AXES[:3]
    assert second.axes == AXES[3:]
    assert (first.rate, second.rate) == (200, 100)
    assert second["accel_z"].values.tolist() == data[:, 5].tolist()
    facts = {"reason": "absent"} if marked else {"reason": "zero", "count": 60}
    assert only(first.remarks, "file-content:absent").facts == {"case": "absent", **facts}


@pytest.mark.parametrize("container", ["ros1", "db3", "mcap-zstd"])
def test_a_flat_type_of_ones_own(tmp_path, container):
    store, data = store_of(container), numbers()
    messages = [(START + k * STEP, flat(store, START + k * STEP, row, "abc"[: k % 4])) for k, row in enumerate(data)]
    path = written(tmp_path, container, {"/vn": ("my_msgs/msg/Flat", messages)})
    found = read(path, units={"gyro": "rad/s", "accel": "m/s2", "time": "us"})
    assert found.axes == ("gyro_x", "gyro_y", "accel_x")
    assert found.rate == 200
    assert found["gyro_y"].values.tolist() == data[:, 1].tolist()
    assert found["accel_x"].values.tolist() == data[:, 5].astype(np.float32).astype(float).tolist()
    assert np.all(found.temperature == 20.5)
    mapped = read(path, columns={"accel_z": "gx", "time": "log_time"}, units={"accel": "m/s2"})
    assert mapped["accel_z"].values.tolist() == data[:, 0].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("container", ["ros1", "db3", "mcap"])
def test_fields_of_nested_messages_by_their_paths(tmp_path, container):
    store, data = store_of(container), numbers()
    messages = [(START + k * STEP, nested(store, START + k * STEP, row, k % 5)) for k, row in enumerate(data)]
    path = written(tmp_path, container, {"/raw": ("vn_msgs/msg/Nested", messages)})
    found = read(
        path, columns={"gyro_x": "gyro[0]", "accel_z": "parts[0].value", "accel_y": "parts[1].value"},
        units={"gyro": "rad/s", "accel": "m/s2"},
    )  # fmt: skip
    assert found["gyro_x"].values.tolist() == data[:, 0].astype(np.float32).astype(float).tolist()
    assert found["accel_z"].values.tolist() == data[:, 3].tolist()
    assert found["accel_y"].values.tolist() == data[:, 4].tolist()
    assert found["gyro_x"].start == START / 1e9
    assert read(path, units={"gyro": "deg/s"}).axes == AXES[:3]  # three numbers named gyro are x, y and z


def test_an_empty_topic_is_told(tmp_path):
    for container in ("ros1", "db3", "mcap"):
        store = store_of(container)
        text = store.types["std_msgs/msg/String"]
        texts = [(START + k, text("x")) for k in range(9)]
        path = written(tmp_path, container, {"/imu": (IMU, []), "/t": ("std_msgs/msg/String", texts)})
        with pytest.raises((DataError, ReadError), match=r"has 0 samples|none of them known as inertial"):
            read(path)


@pytest.mark.slow
def test_a_recording_in_several_files_is_one(tmp_path):
    data = numbers(100)
    store = store_of("db3")
    parts = []
    for rows in (slice(0, 40), slice(40, 100)):
        messages = [(START + j * STEP, imu(store, START + j * STEP, data[j])) for j in range(100)[rows]]
        parts.append(written(tmp_path, "db3", {"/imu": (IMU, messages)}))
    folder = parts[0]
    shutil.copy(content(parts[1]), folder / "made_1.db3")
    text = (folder / "metadata.yaml").read_text()
    assert "made.db3" in text
    (folder / "metadata.yaml").write_text(text.replace("- made.db3", "- made.db3\n  - ../elsewhere/made_1.db3", 1))
    assert read(folder)["gyro_x"].values.tolist() == data[:, 0].tolist()
    (folder / "made_1.db3").unlink()
    with raises(ReadError, "made_1.db3"):
        read(folder)


def test_messages_out_of_order_are_put_by_the_time_of_recording(tmp_path):
    """Written by several threads, neighbours may be swapped in the file."""
    data = numbers()
    folder = recorded(tmp_path, "db3", data)
    with closing(sqlite3.connect(content(folder))) as base:
        rows = base.execute("SELECT topic_id, timestamp, data FROM messages ORDER BY id").fetchall()
        base.execute("DELETE FROM messages")
        rows[10], rows[11] = rows[11], rows[10]
        base.executemany("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", rows)
        base.commit()
    assert read(folder)["gyro_x"].values.tolist() == data[:, 0].tolist()


@pytest.mark.parametrize("profile", [b"", b"ros2", b"x"])
def test_mcap_without_profile_and_without_summary(tmp_path, profile):
    data = numbers()
    whole = content(recorded(tmp_path, "mcap", data)).read_bytes()
    size = struct.unpack_from("<Q", whole, 9)[0]
    head = struct.pack("<I", len(profile)) + profile + struct.pack("<I", 0)
    body = whole[17 + size :]
    start = len(whole) - 8 - 20 - 9
    end = body[: start - 17 - size]
    footer = b"\x02" + struct.pack("<QQQI", 20, 0, 0, 0) + whole[:8]
    # Without a summary what follows the end of the data is no part of the recording.
    path = tmp_path / "plain.mcap"
    path.write_bytes(whole[:8] + b"\x01" + struct.pack("<Q", len(head)) + head + end + footer)
    assert read(path)["gyro_x"].values.tolist() == data[:, 0].tolist()
