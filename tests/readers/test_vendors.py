"""Text of instruments, by headers as their programs write them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gmwm.base.errors import DataError, OptionError, ReadError, UnitError
from gmwm.files.readers import find_reader, read
from tests.helpers import only, raises

VALUES = np.round(np.random.default_rng(5).normal(size=(40, 6)) * 0.05 + [0, 0, 0, 0, 0, 9.8], 6)
XSENS = "// Start Time: Unknown\n// Update Rate: {0}Hz\n// Filter Profile: human (46.1)\n// Firmware Version: 4.6.0\n"
NAMES = "PacketCounter\tSampleTimeFine\tAcc_X\tAcc_Y\tAcc_Z\tFreeAcc_X\tGyr_X\tGyr_Y\tGyr_Z\tMag_X\tMat[1][1]\n"


def table(imu):
    return np.column_stack([imu[axis].values for axis in imu])


def saved(folder, content, name="MT_0120067F-000.txt"):
    path = folder / name
    path.write_text(content)
    return path


def xsens(tick, packet=lambda k: k, order="\t"):
    rows = ""
    for k, (gx, gy, gz, ax, ay, az) in enumerate(VALUES):
        rows += "\t".join(map(str, (packet(k), tick(k), ax, ay, az, 0.1, gx, gy, gz, 0.4, 0.9))) + "\n"
    return (XSENS.format("100.0") + NAMES + rows).replace("\t", order)


@pytest.mark.parametrize("order", ["\t", ",", ";"])
def test_xsens_by_its_clock(tmp_path, order):
    path = saved(tmp_path, xsens(lambda k: 4_294_000_000 + 25 * k, order=order))
    imu = read(path)
    assert find_reader(path).name == "xsens"
    assert table(imu).tolist() == VALUES.tolist()
    assert (imu.rate, imu.time_base.jitter) == (400, 0)


def test_xsens_by_its_counter(tmp_path):
    imu = read(saved(tmp_path, xsens(lambda k: "", lambda k: (65_520 + k + 5 * (k > 29)) % 65_536)))
    assert imu.rate == pytest.approx(100, rel=1e-12)
    assert [b - a for a, b in imu.segments] == [30, 10]
    assert imu.time_base.gaps[0][1] == pytest.approx(0.06, rel=1e-9)
    assert only(imu.remarks, "time-read:read").facts["form"] == "packets"


def test_xsens_increments(tmp_path):
    names = "PacketCounter\tSampleTimeFine\tVelInc_X\tVelInc_Y\tVelInc_Z\tOriInc_q0\tOriInc_q1\tOriInc_q2\tOriInc_q3\n"
    rows = ""
    for k, row in enumerate(VALUES):
        cells = (k, 25 * k, *map(repr, (row[3:] / 400).tolist()), 1.0, *map(repr, (row[:3] / 800).tolist()))
        rows += "\t".join(map(str, cells)) + "\n"
    imu = read(saved(tmp_path, XSENS.format("400.0") + names + rows))
    np.testing.assert_allclose(table(imu), VALUES, rtol=1e-14)
    assert only(imu.remarks, "unit-named:increments", "VelInc_X").facts == {"case": "increments", "source": "file"}


def test_what_xsens_dot_writes_is_not_taken_for_it(tmp_path):
    # It has the names, but gyroscopes in deg/s and microseconds, and no comments.
    path = saved(tmp_path, xsens(lambda k: 192_856_375 + 16_667 * k)[len(XSENS.format("100.0")) :])
    assert find_reader(path).name == "text"
    with raises(UnitError, code="unit-unnamed"):
        read(path, units={"accel": "m/s2"})


EPSON = (
    "#Log esensorlib,,,Output Rate,200.0,Filter Setting,K32_FC50,,,\n"
    "#Creation Date:,2024-06-11 12:02:29.830146,PROD_ID=G366PDG0,VERSION=373,SERIAL_NUM=T1000062,,,,,\n"
)
FACTORS = "SF_GYRO=+0.01515152{0}(deg/s)/bit,SF_ACCL=+0.25000000{0}mg/bit,SF_TEMPC=+0.00390625{0}degC/bit\n"


def test_epson_scaled(tmp_path):
    header = "Sample No.,Flags[hex],Ts[deg.C],Gx[dps],Gy[dps],Gz[dps],Ax[mG],Ay[mG],Az[mG],Counter[dec]\n"
    values = VALUES * [1, 1, 1, 100, 100, 100]
    rows = "".join(f"{k},0x0,{25 + k / 100},{','.join(map(str, row))},{k}\n" for k, row in enumerate(values))
    footer = "#Log End,2024-06-11 12:03:29,,,,,,,,\n"
    path = saved(tmp_path, EPSON + "#Scaled Data," + FACTORS.format("/2^16 ") + header + rows + footer, "log.csv")
    imu = read(path)
    assert find_reader(path).name == "epson"
    assert imu.rate == 200
    np.testing.assert_allclose(table(imu), values * ([np.pi / 180] * 3 + [9.80665e-3] * 3), rtol=1e-15)
    assert imu.temperature[0] == 25
    assert only(imu.remarks, "unit-named:unit", "accel").facts == {"case": "unit", "unit": "mg", "source": "header"}


@pytest.mark.parametrize(("power", "shift"), [(" / 2^16 ", 2**16), (" ", 1)])
def test_epson_raw_counts(tmp_path, power, shift):
    header = "Sample No.,Gx[dec],Gy[dec],Gz[dec],Ax[dec],Ay[dec],Az[dec]\n"
    counts = np.arange(240).reshape(40, 6) * 7 % 100 + [0, 0, 0, 0, 0, 4000 * shift]
    rows = "".join(f"{k},{','.join(map(str, row))}\n" for k, row in enumerate(counts))
    imu = read(saved(tmp_path, EPSON + "#Raw Data," + FACTORS.format(power) + header + rows, "log.csv"))
    factors = [0.01515152 / shift * np.pi / 180] * 3 + [0.25 / shift * 9.80665e-3] * 3
    np.testing.assert_allclose(table(imu), counts * factors, rtol=1e-14)


def test_epson_increments_and_an_older_header(tmp_path):
    header = "Sample No.,DAx[deg],DVy[m/s],Counter[dec]\n"
    body = "".join(f"{k},{k % 3 / 1000},{k % 5 / 100},{k}\n" for k in range(40))
    imu = read(saved(tmp_path, EPSON + "#Scaled Data," + FACTORS.format(" ") + header + body, "log.csv"))
    assert imu["gyro_x"].values[1] == pytest.approx(np.radians(0.2), rel=1e-14)
    assert imu["accel_y"].values[1] == pytest.approx(2.0, rel=1e-14)
    old = "M-G362 CSV Log File created by Python,Log Duration (sec): 10.000,,,,\nCreation Date:,2016-01-01,,,,,,,,\n"
    old += "Scaled 16-bit Data,SF_GYRO=+0.0050 dps/lsb,SF_ACCL=+0.125 mg/lsb,SF_TEMP=-0.0042725 degC/lsb,,,,,,\n"
    old += "Sample No.,Gx[dps],Gy[dps],Gz[dps],Ax[mG],Ay[mG],Az[mG],Ts[deg.C],Counter[dec],Error\n"
    old += "".join(f"{k},{','.join(map(str, row))},25.0,{k},0\n" for k, row in enumerate(VALUES * 100))
    path = saved(tmp_path, old, "old.csv")
    with raises(ReadError, "no time column", advises=["rate="]):
        read(path)
    assert read(path, rate=125).rate == 125


def test_a_rate_in_a_comment(tmp_path):
    rows = "".join(f"{k % 3}\n" for k in range(20))
    for comment, rate in (
        ("# sample rate: 250 Hz", 250), ("% Sampling frequency (Hz): 1000", 1000), ("# output rate = 1.6 kHz", 1600),
    ):  # fmt: skip
        assert read(saved(tmp_path, f"{comment}\ngx [rad/s]\n{rows}")).rate == rate
    for comment in ("# sample rate: 250 Hz\n# output rate: 100 Hz", "# data rate: see manual"):
        with raises(ReadError, "no time column", advises=["rate="]):
            read(saved(tmp_path, f"{comment}\ngx [rad/s]\n{rows}"))


COUNTS = "t [s],gx,gy,az\n" + "".join(f"{k / 100},{k % 5 - 2},{k % 7},{16384 + k % 3}\n" for k in range(50))


def test_factors_for_raw_counts(tmp_path):
    path = saved(tmp_path, COUNTS, "a.csv")
    units = {"gyro": "deg/s", "accel": "g"}
    imu = read(path, units=units, scale={"gyro": 1 / 131, "gyro_y": 1 / 65.5, "accel": 1 / 16384})
    k = np.arange(50)
    np.testing.assert_allclose(imu["gyro_x"].values, np.radians((k % 5 - 2) / 131), rtol=1e-14)
    np.testing.assert_allclose(imu["gyro_y"].values, np.radians(k % 7 / 65.5), rtol=1e-14)
    np.testing.assert_allclose(imu["accel_z"].values, (1 + k % 3 / 16384) * 9.80665, rtol=1e-14)
    assert only(imu.remarks, "unit-named:factor", "gyro_y").facts["factor"] == pytest.approx(1 / 65.5, rel=1e-12)


def test_declared_increments(tmp_path):
    path = saved(tmp_path, COUNTS, "a.csv")
    units = {"gyro": "deg/s", "accel": "m/s2"}
    imu = read(path, units=units, increments=["gyro_x", "accel"])
    k = np.arange(50)
    np.testing.assert_allclose(imu["gyro_x"].values, np.radians(k % 5 - 2) * 100, rtol=1e-14)
    np.testing.assert_allclose(imu["gyro_y"].values, np.radians(k % 7), rtol=1e-14)
    np.testing.assert_allclose(imu["accel_z"].values, (16384 + k % 3) * 100.0, rtol=1e-14)
    only = read(path, units=units, increments=True, columns={"time": 0, "gyro_y": 2})
    np.testing.assert_allclose(only["gyro_y"].values, np.radians(k % 7) * 100, rtol=1e-14)


@pytest.mark.parametrize(
    ("argument", "value", "got", "facts"),
    [
        ("scale", {"gyro": 0}, 0, ["gyro"]),
        ("scale", {"gyro": "1/131"}, "1/131", ["gyro"]),
        ("scale", {"gyro": math.nan}, math.nan, ["gyro"]),
        ("scale", {"gyros": 1}, "gyros", ["gyro, accel, gyro_x"]),
        ("scale", 3, 3, []),
        ("scale", {"gyro_z": 2.0}, "gyro_z", ["gyro_x, gyro_y, accel_z"]),
        ("increments", "gyro", "gyro", ["True"]),
        ("increments", ["time"], "time", ["gyro, accel, gyro_x"]),
        ("increments", ["accel_x"], "accel_x", []),
    ],
)
def test_factors_that_make_no_sense(tmp_path, argument, value, got, facts):
    options = {argument: value}
    with raises(OptionError, *facts, argument=argument, got=got):
        read(saved(tmp_path, COUNTS, "a.csv"), units={"gyro": "deg/s", "accel": "g"}, **options)


@pytest.mark.parametrize("name", ["xsens", "epson", "sensorlogger"])
def test_cut_foreign_and_mislabelled(tmp_path, name):
    plain = "time [s],gx [rad/s]\n" + "".join(f"{k},{k % 3}\n" for k in range(20))
    assert len(read(saved(tmp_path, plain, "a.csv"), format=name)) == 20
    with pytest.raises(ReadError) as caught:
        read(saved(tmp_path, "// nothing\n", "b.csv"), format=name)
    assert caught.value.code in ("empty", "no-numbers")
    (tmp_path / "c.csv").write_bytes(bytes(range(256)))
    with raises(ReadError, "c.csv"):
        read(tmp_path / "c.csv", format=name)
    whole = xsens(lambda k: 25 * k)
    with pytest.raises((ReadError, DataError)):
        read(saved(tmp_path, whole[: whole.index("\n4\t") + 8]))
