"""ROS recordings, of devices and made ones, are read as rosbags reads them; and what stands beside the samples."""

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

import gmwm
from gmwm.base.units import AXES
from gmwm.files.readers import read, stream
from tests.helpers import codes, device
from tests.readers.rosbag_files import START, STEP, header, imu, numbers, store_of, written

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")


def by_any_reader(path, topic="/imu/data"):
    """Time stamps (ns), gyroscopes and accelerometers as rosbags gives them."""
    rows = []
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        connections = [one for one in reader.connections if one.topic == topic]
        for connection, _, raw in reader.messages(connections):
            message = reader.deserialize(raw, connection.msgtype)
            stamp, gyro, accel = message.header.stamp, message.angular_velocity, message.linear_acceleration
            rows.append((stamp.sec * 10**9 + stamp.nanosec, gyro.x, gyro.y, gyro.z, accel.x, accel.y, accel.z))
    return np.array([row[0] for row in rows]), np.array([row[1:] for row in rows])


def values(recording):
    return np.column_stack([recording[axis].values for axis in recording.axes])


@pytest.mark.slow
@pytest.mark.parametrize(("name", "rate"), [("cra-ros-pkg_test1.bag", 30.013), ("cra-ros-pkg_test2.bag", 50)])
def test_bags_of_robots(name, rate):
    path = device(name)
    found = read(path)
    stamps, expected = by_any_reader(path)
    assert found.axes == AXES
    assert found.rate == pytest.approx(rate, rel=1e-5)
    np.testing.assert_array_equal(values(found), expected)
    assert found["gyro_x"].start == stamps[0] / 1e9
    assert sum(map(len, stream(path))) == len(expected)


@pytest.mark.slow
@pytest.mark.parametrize("container", ["ros1-lz4", "db3", "mcap-zstd"])
def test_made_recordings(tmp_path, container):
    store, data = store_of(container), numbers(300)
    late = np.random.default_rng(2).integers(0, STEP, 300)
    messages = [(START + k * STEP + int(late[k]), imu(store, START + k * STEP, row)) for k, row in enumerate(data)]
    path = written(tmp_path, container, {"/imu/data": ("sensor_msgs/msg/Imu", messages)})
    stamps, expected = by_any_reader(path)
    found = read(path)
    np.testing.assert_array_equal(values(found), expected)
    assert found["gyro_x"].start == stamps[0] / 1e9


@pytest.mark.slow
@pytest.mark.parametrize("late", [0, STEP - 1])
def test_mcap_and_database_give_the_same_digits(tmp_path, late):
    store, data = store_of("mcap"), numbers(3000)
    lag = np.random.default_rng(2).integers(0, late + 1, 3000)
    messages = [(START + k * STEP + int(lag[k]), imu(store, START + k * STEP, row)) for k, row in enumerate(data)]
    topics = {"/imu/data": ("sensor_msgs/msg/Imu", messages)}
    one, other = (read(written(tmp_path, container, topics)) for container in ("mcap", "db3"))
    assert (one.rate, one.segments, one["gyro_x"].starts) == (other.rate, other.segments, other["gyro_x"].starts)
    np.testing.assert_array_equal(values(one), values(other))
    assert len(one.segments) == 1
    curves = [gmwm.wavelet_variance(recording["gyro_x"]) for recording in (one, other)]
    np.testing.assert_array_equal(curves[0].variance, curves[1].variance)


def temperature(store, stamp, value):
    return store.types["sensor_msgs/msg/Temperature"](header(store, stamp), value, 0.0)


@pytest.mark.slow
@pytest.mark.parametrize("container", ["ros1", "db3", "mcap"])
def test_a_temperature_topic_beside_the_imu(tmp_path, container):
    store, data = store_of(container), numbers(400)
    messages = [(START + k * STEP + 999, imu(store, START + k * STEP, row)) for k, row in enumerate(data)]
    stamps = [START + k * 100 * STEP for k in range(5)]
    warm = [(stamp + 5, temperature(store, stamp, 20.0 + k)) for k, stamp in enumerate(stamps)]
    topics = {
        "/imu0/data": ("sensor_msgs/msg/Imu", messages),
        "/imu1/data": ("sensor_msgs/msg/Imu", messages),
        "/imu1/temperature": ("sensor_msgs/msg/Temperature", warm),
    }
    path = written(tmp_path, container, topics)
    found = read(path, topic="/imu1/data")
    assert found.temperature == pytest.approx(20 + np.arange(400) / 100, abs=1e-9)
    assert "file-content:temperature" in codes(found.remarks)
    other = read(path, topic="/imu0/data")
    assert other.temperature is None
    np.testing.assert_array_equal(values(found), values(other))
    assert sum(map(len, stream(path, topic="/imu1/data"))) == 400


@pytest.mark.slow
def test_the_topic_is_written_to_the_file_for_kalibr(tmp_path):
    store, data = store_of("mcap"), numbers(4000)
    messages = [(START + k * STEP, imu(store, START + k * STEP, row)) for k, row in enumerate(data)]
    path = written(tmp_path, "mcap", {"/os_cloud/imu": ("sensor_msgs/msg/Imu", messages)})
    calibration = gmwm.calibrate(read(path), within="WN + RW", robust=False)
    assert "rostopic: /os_cloud/imu\n" in calibration.export(format="kalibr")
    assert "placeholder" not in calibration.export(format="kalibr")
    assert "  rostopic: /os_cloud/imu\n" in calibration.export(format="openvins")
