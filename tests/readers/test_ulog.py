"""PX4 logs: made with struct by the published format, and by pyulog's own writer."""

import struct
import tracemalloc

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, GmwmError, OptionError, ReadError
from gmwm.base.units import AXES
from gmwm.files.formats import ulog as ulog_module
from gmwm.files.formats.ulog import UlogReader
from gmwm.files.readers import find_reader, read
from tests.helpers import code_of, device, raises

pyulog = pytest.importorskip("pyulog")

SIGNATURE = b"ULog\x01\x12\x35\x01"
COMBINED = (
    "sensor_combined:uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;uint32_t accelerometer_integral_dt;"
)
SENSOR = "uint64_t timestamp;uint64_t timestamp_sample;uint32_t device_id;float x;float y;float z;float temperature;"
GYRO, ACCEL = f"sensor_gyro:{SENSOR}", f"sensor_accel:{SENSOR}"
STATUS = "vehicle_status:uint64_t timestamp;uint8_t state;uint8_t[7] _padding0;"
START = 12_345_678


def message(kind, data):
    return struct.pack("<HB", len(data), ord(kind)) + data


def ulog(formats, subscriptions, data):
    """A log: formats as texts, subscriptions as (id, instance, name), data as (id, bytes)."""
    parts = [SIGNATURE + struct.pack("<Q", START), message("B", bytes(40))]
    parts += [message("F", text.encode()) for text in formats]
    parts += [message("A", struct.pack("<BH", instance, k) + name.encode()) for k, instance, name in subscriptions]
    parts += [message("D", struct.pack("<H", k) + payload) for k, payload in data]
    return b"".join(parts)


def numbers(samples=200, seed=0):
    values = np.random.default_rng(seed).normal(0, 0.01, (samples, 6)).astype(np.float32)
    values[:, 5] -= 9.8
    return values


def combined(samples=200):
    rows = enumerate(numbers(samples).tolist())
    data = [(7, struct.pack("<Q3fIi3fI", START + 4000 * k, *row[:3], 4000, 0, *row[3:], 4000)) for k, row in rows]
    status = [(3, struct.pack("<QB", START + 10**5 * k, 1)) for k in range(3)]
    return ulog([COMBINED, STATUS], [(7, 0, "sensor_combined"), (3, 0, "vehicle_status")], data + status)


def sensors(samples=100, temperature=31.5):
    subscriptions = [(1, 0, "sensor_gyro"), (2, 1, "sensor_gyro"), (4, 0, "sensor_accel")]
    data = []
    for which, _, _ in subscriptions:
        for k, row in enumerate(numbers(samples, which).tolist()):
            stamp = START + 1250 * k
            data.append((which, struct.pack("<QQI4f", stamp + 300, stamp, 9, *row[3:], temperature + k / 64)))
    return ulog([GYRO, ACCEL], subscriptions, data)


@pytest.fixture
def file(tmp_path):
    return tmp_path / "log.ulg"


def test_sensor_combined(file):
    file.write_bytes(combined())
    assert find_reader(file).name == "ulog"
    imu = read(file)
    assert imu.axes == AXES
    assert imu.rate == 250
    assert imu["gyro_x"].start == START / 1e6
    np.testing.assert_array_equal(np.column_stack([imu[axis].values for axis in AXES]), numbers())
    assert {imu[axis].unit for axis in AXES[:3]} == {"rad/s"}


def test_pyulog_s_own_file_and_values(file, tmp_path):
    file.write_bytes(combined())
    log = pyulog.ULog(str(file))
    log.write_ulog(str(tmp_path / "again.ulg"))
    again, data = read(tmp_path / "again.ulg"), log.get_dataset("sensor_combined").data
    for k in range(3):
        np.testing.assert_array_equal(again[AXES[k]].values, data[f"gyro_rad[{k}]"])
        np.testing.assert_array_equal(again[AXES[3 + k]].values, data[f"accelerometer_m_s2[{k}]"])


def layouts(path):
    return {layout.topic: layout for layout in UlogReader().layouts(path)}


def test_each_instance_is_a_recording(file):
    file.write_bytes(sensors())
    found = layouts(file)
    assert list(found) == ["sensor_accel_0", "sensor_gyro_0", "sensor_gyro_1"]
    with raises(ReadError, "3 recordings", "sensor_accel_0", "sensor_gyro_0", "sensor_gyro_1"):
        read(file)
    assert read(file, topic="sensor_gyro_1").axes == AXES[:3]
    for topic, seed in (("sensor_gyro_0", 1), ("sensor_gyro_1", 2), ("sensor_accel_0", 4)):
        layout = found[topic]
        (chunk,) = UlogReader().chunks(file, layout, range(5))
        assert [channel.axis.split("_")[0] for channel in layout.channels][1:4] == [topic.split("_")[1]] * 3
        # When a sample was taken, not when it was published.
        assert layout.channels[0].name == "timestamp_sample"
        assert chunk[0].tolist() == [START + 1250 * k for k in range(100)]
        for k in range(3):
            np.testing.assert_array_equal(chunk[1 + k], numbers(100, seed)[:, 3 + k])
        assert chunk[4][1] == 31.5 + 1 / 64


def test_one_sensor_alone_with_its_temperature(file):
    rows = enumerate(numbers(100).tolist())
    data = [(1, struct.pack("<QQI4f", START + 1250 * k, 0, 9, *row[:3], 20 + k / 4)) for k, row in rows]
    file.write_bytes(ulog([GYRO], [(1, 0, "sensor_gyro")], data))
    imu = read(file)
    assert imu.axes == AXES[:3]
    assert imu.rate == 800
    assert imu["gyro_x"].start == START / 1e6  # no sample has a stamp of its own: those of publication
    assert np.asarray(imu.temperature).tolist() == [20 + k / 4 for k in range(100)]


def test_a_temperature_that_is_none_is_left_out(file):
    file.write_bytes(sensors(temperature=float("nan")))
    assert all(len(layout.channels) == 4 for layout in layouts(file).values())


@pytest.mark.parametrize("cut", [1, 2, 10, 13, 14, 50])
def test_a_log_that_was_cut_off(file, cut):
    # The last message, of a status, has 3 + 11 bytes: without all of them the log ends well.
    file.write_bytes(combined()[:-cut])
    if cut == 14:
        assert len(read(file)) == 200
        return
    with raises(ReadError, advises=["write_ulog"]):
        read(file)


def test_the_way_out_of_a_cut_log_leads_out(file, tmp_path):
    file.write_bytes(combined()[:-20])
    with raises(ReadError, code="cut-off"):
        read(file)
    pyulog.ULog(str(file)).write_ulog(str(tmp_path / "whole.ulg"))
    assert len(read(tmp_path / "whole.ulg")) == 200


@pytest.mark.parametrize(
    ("content", "code", "facts"),
    [
        (b"", "empty", []),
        (SIGNATURE, "damaged", ["log.ulg", "too short"]),
        (SIGNATURE + bytes(8), "no-inertial-data", ["sensor_combined, sensor_gyro, sensor_accel"]),
        (ulog([STATUS], [(3, 0, "vehicle_status")], [(3, struct.pack("<QB", 1, 1))]), "no-inertial-data", ["log.ulg"]),
        (ulog([COMBINED], [(7, 0, "sensor_combined")], []), "no-inertial-data", ["log.ulg"]),
        (ulog([COMBINED], [(7, 0, "sensor_combined")], [(7, bytes(20))] * 9), "damaged", ["log.ulg"]),
        (ulog([COMBINED], [(7, 0, "sensor_combined")], [(8, bytes(52))] * 9), "damaged", ["no subscription"]),
        (ulog(["sensor_gyro:b[60000] x;", "b:c[60000] x;", "c:"], [(1, 0, "sensor_gyro")], []), "too-many", [2000]),
        (ulog(["sensor_gyro:b x;", "b:sensor_gyro x;"], [(1, 0, "sensor_gyro")], []), "type-recursive", []),
        (
            ulog(["sensor_gyro:t0 x;", *(f"t{k}:t{k + 1} x;" for k in range(3000))], [(1, 0, "sensor_gyro")], []),
            "damaged",
            ["nested"],
        ),
        (ulog(["sensor_gyro:b x;"], [(1, 0, "sensor_gyro")], []), "damaged", ["'A'"]),
        (ulog(["sensor_gyro:nonsense;"], [(1, 0, "sensor_gyro")], []), "damaged", ["'F'"]),
        (combined() + bytes(3), "damaged", ["a message is invalid"]),
        (
            ulog(["sensor_gyro:uint64_t timestamp;float x;"], [(1, 0, "sensor_gyro")], [(1, bytes(12))] * 9),
            "no-inertial-data",
            [],
        ),
        (SIGNATURE + bytes(8) + message("B", bytes(8) + b"\xff" * 8 + bytes(24)), "damaged", ["incompatible flag"]),
    ],
)
def test_what_is_wrong_is_told(file, content, code, facts, capsys):
    file.write_bytes(content)
    with raises(ReadError, *facts, code=code):
        read(file)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize("place", [1, 16, 58])
def test_appended_data_before_their_message_are_refused(file, place):
    whole = bytearray(combined())
    struct.pack_into("<Q", whole, 16 + 3 + 16, place)
    file.write_bytes(whole)
    with raises(ReadError, "appended data", code="damaged"):
        read(file)


def test_few_samples_and_foreign_files(file):
    file.write_bytes(combined(1))
    with raises(DataError, "log.ulg", "1 sample", "at least 8"):
        read(file)
    file.write_text("gyro_x\n1\n2\n")
    with raises(ReadError, "log.ulg"):
        read(file, format="ulog")


@pytest.mark.slow
def test_any_damage_is_a_clear_error_or_a_recording(file):
    whole = combined(40)
    rng = np.random.default_rng(12)
    for _ in range(400):
        broken = bytearray(whole)
        for _ in range(rng.integers(1, 4)):
            broken[rng.integers(len(broken))] = rng.integers(256)
        file.write_bytes(broken)
        try:
            read(file)
        except (GmwmError, Warning):
            continue


def test_blocks_of_any_size_give_the_same_numbers(file, monkeypatch):
    file.write_bytes(whole_log())
    expected = read(file)
    for block in (1 << 10, 4001, 70_000):
        monkeypatch.setattr(ulog_module, "_BLOCK", block)
        found = gmwm.stream(file, chunk=333)
        assert [remark.code for remark in found.remarks] == [remark.code for remark in expected.remarks]
        samples = list(found.samples())
        assert sum(1 for _ in UlogReader().chunks(file, layouts(file)["sensor_combined_0"], [0])) > 50_000 // block
        for axis in AXES:
            assert np.concatenate([one.values[axis] for one in samples]).tolist() == expected[axis].values.tolist()
        heat = np.concatenate([one.temperature for one in samples])
        np.testing.assert_array_equal(heat, expected.temperature)


@pytest.mark.slow
def test_memory_does_not_grow_with_the_log(file, monkeypatch):
    """The temperatures of a sensor at full rate are thinned; both passes hold one block."""
    monkeypatch.setattr(ulog_module, "_BLOCK", 1 << 16)
    monkeypatch.setattr(ulog_module, "_MOST_TEMPERATURES", 1 << 8)
    peaks = []
    for samples in (4000, 16_000):
        file.write_bytes(sensors(samples))
        tracemalloc.start()
        (layout,) = (one for one in UlogReader().layouts(file) if one.topic == "sensor_gyro_1")
        rows = sum(chunk[1].size for chunk in UlogReader().chunks(file, layout, range(5)))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert rows == samples
    assert peaks[1] < 1.2 * peaks[0]


def whole_log(selected=9):
    """A log as PX4 writes it: the six axes at 250 Hz, each sensor at 1 Hz with its temperature."""
    rows = enumerate(numbers(1000).tolist())
    data = [(7, struct.pack("<Q3fIi3fI", START + 4000 * k, *row[:3], 4000, 0, *row[3:], 4000)) for k, row in rows]
    for which, number, temperature in ((1, 8, 50.0), (2, 9, 30.0), (4, 8, 10.0)):
        for k in range(5):
            stamp = START + 1_000_000 * k
            data.append((which, struct.pack("<QQI4f", stamp, stamp, number, 0.1, 0.1, 0.1, temperature + k)))
    data.append((5, struct.pack("<QII", START, 8, selected)))
    selection = "sensor_selection:uint64_t timestamp;uint32_t accel_device_id;uint32_t gyro_device_id;"
    names = [(7, 0, "sensor_combined"), (1, 0, "sensor_gyro"), (2, 1, "sensor_gyro"), (4, 0, "sensor_accel")]
    return ulog([COMBINED, GYRO, ACCEL, selection], [*names, (5, 0, "sensor_selection")], data)


def test_sensor_combined_is_preferred_and_has_the_temperature_of_its_gyroscope(file):
    file.write_bytes(whole_log())
    imu = read(file)
    assert (imu.axes, imu.rate, len(imu)) == (AXES, 250, 1000)
    assert imu.temperature == pytest.approx(30 + np.arange(1000) / 250, abs=1e-6)
    chosen = next(remark for remark in imu.remarks if code_of(remark) == "topic-chosen:chosen")
    assert "250 Hz, 4 s" in chosen.text()
    assert "sensor_gyro_1 (gyro_x, gyro_y, gyro_z; 1 Hz, 4 s)" in chosen.text()
    assert read(file, topic="sensor_combined").rate == 250
    with raises(OptionError, "sensor_combined_0 (", "; 250 Hz, 4 s)", argument="topic"):
        read(file, topic="vehicle_imu")
    file.write_bytes(whole_log(selected=8))
    assert read(file).temperature[0] == 50


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "stepped"),
    [
        ("", ()), ("_appended_multiple", ()), ("_log_small", ()),
        ("_px4_events", AXES[:5]), ("_logging_tagged_and_default_params", AXES[:5]),
    ],
)  # fmt: skip
@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_logs_of_devices_are_read_as_pyulog_does(name, stepped):
    path = device(f"PX4_pyulog_sample{name}.ulg")
    imu = read(path)
    data = pyulog.ULog(str(path), ["sensor_combined"]).data_list[0].data
    for k in range(3):
        np.testing.assert_array_equal(imu[AXES[k]].values, data[f"gyro_rad[{k}]"])
        np.testing.assert_array_equal(imu[AXES[3 + k]].values, data[f"accelerometer_m_s2[{k}]"])
    # Means of four 16-bit samples with a range of 2000 deg/s or 16 g, rounded to float32 after the calibration.
    steps = {axis: np.radians(2000) / 2**17 if axis in AXES[:3] else 16 * 9.80665 / 2**17 for axis in stepped}
    found = {axis: item.lsb for axis, item in gmwm.inspect(imu).axes.items() if item.lsb is not None}
    assert found == pytest.approx(steps, rel=1e-5)
