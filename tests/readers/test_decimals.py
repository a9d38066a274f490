"""Commas and points in numbers, blank lines, commented rows, and time stamps in two columns."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import ReadError
from gmwm.files.formats.line_forms import find_parts
from tests.helpers import codes, only, raises

RATE, SIZE = 100, 300
NOISE = np.random.default_rng(3).normal(scale=0.01, size=SIZE)


def saved(folder, header, row, name="log.tsv"):
    path = folder / name
    lines = [row(k) for k in range(SIZE)]
    path.write_text("\n".join([header, *lines, ""]))
    return path


@pytest.mark.parametrize("delimiter", ["\t", ";", "|"])
@pytest.mark.parametrize(
    ("header", "cell", "sizes"),
    [
        ("accel_z [mg]", lambda k: f"{1000 + k % 7:,}", (1.0, 1e-3)),
        ("time [ms]", lambda k: f"{100_000 + 10 * k:,}", ()),
    ],
)
def test_commas_before_three_digits_are_a_question_beside_points(tmp_path, delimiter, header, cell, sizes):
    path = saved(
        tmp_path, delimiter.join(["t [s]" if sizes else "gyro_z [deg/s]", "gyro_x [deg/s]", header]),
        lambda k: delimiter.join([f"{k / RATE:.2f}", f"{NOISE[k]:.4f}", cell(k)]),
    )  # fmt: skip
    for read in (gmwm.read, gmwm.stream):
        with raises(ReadError, code="decimal-comma", advises=["text:thousands", "text:decimal-comma"]):
            read(path)
    imu = gmwm.read(path, format="text:thousands")
    assert imu.rate == pytest.approx(RATE)
    for size, format in zip(sizes, ("text:thousands", "text:decimal-comma"), strict=False):
        z = gmwm.read(path, format=format)["accel_z"].values
        np.testing.assert_allclose(z[:7], size * (1000 + np.arange(7)) * 9.80665e-3, rtol=1e-12)


@pytest.mark.parametrize(("delimiter", "quote"), [(";", ""), (",", '"'), (";", '"')])
def test_commas_that_must_be_decimal_signs_are_no_question(tmp_path, delimiter, quote):
    def row(k: int) -> str:
        cells = (f"{k / RATE:.3f}", f"{NOISE[k]:.4f}", f"{1.004 + NOISE[k]:.3f}")
        return delimiter.join(quote + cell.replace(".", ",") + quote for cell in cells)

    path = saved(tmp_path, delimiter.join(["time [s]", "gyro_x [deg/s]", "accel_z [g]"]), row)
    imu = gmwm.read(path)
    streamed = np.concatenate([chunk.values["accel_z"] for chunk in gmwm.stream(path, chunk=97)])
    np.testing.assert_array_equal(streamed, imu["accel_z"].values)
    assert imu["accel_z"].values.mean() == pytest.approx(9.85, rel=1e-2)


def test_points_between_thousands_before_a_decimal_comma_are_left_out(tmp_path):
    """As a spreadsheet with German settings writes numbers."""
    values = 1000.0 + 2.0 * NOISE
    time = 999_950 + 10 * np.arange(SIZE)

    def row(k: int) -> str:
        cells = (f"{time[k]:,.1f}", f"{NOISE[k]:,.4f}", f"{values[k]:,.4f}")
        return ";".join(cell.replace(",", "#").replace(".", ",").replace("#", ".") for cell in cells)

    path = saved(tmp_path, "time [ms];gyro_x [deg/s];accel_z [mg]", row)
    imu = gmwm.read(path)
    assert imu.rate == pytest.approx(RATE)
    np.testing.assert_allclose(imu["accel_z"].values, values * 9.80665e-3, atol=1e-6)
    streamed = np.concatenate([chunk.values["accel_z"] for chunk in gmwm.stream(path, chunk=97)])
    np.testing.assert_array_equal(streamed, imu["accel_z"].values)
    path.write_text(path.read_text() + "3.000.000,0;0,5;1.005\n")
    with raises(ReadError, code="decimal-comma"):
        gmwm.read(path)


@pytest.mark.parametrize("digits", [2, 3, 4])
def test_points_between_thousands_may_be_in_most_cells(tmp_path, digits):
    values = 1000.0 * NOISE

    def row(k: int) -> str:
        cells = (f"{10 * k:,.{digits}f}", f"{30_000 + values[k]:,.{digits}f}", f"{-20_000 - values[k]:,.{digits}f}")
        return ";".join(cell.replace(",", "#").replace(".", ",").replace("#", ".") for cell in cells)

    imu = gmwm.read(saved(tmp_path, "time [ms];gyro_x [mdeg/s];gyro_y [mdeg/s]", row))
    np.testing.assert_allclose(np.degrees(imu["gyro_x"].values), 30 + NOISE, atol=1e-5)


@pytest.mark.parametrize("blank", ["\f", "\v", " \f ", "\t"])
def test_a_line_of_form_feeds_is_blank_in_read_and_in_stream(tmp_path, blank):
    rows = [f"{k / RATE:.2f},{NOISE[k]:.6f}" + f"\n{blank}" * (k % 60 == 9) for k in range(SIZE)]
    path = saved(tmp_path, "time [s],gyro_x [rad/s]", lambda k: rows[k])
    imu, stream = gmwm.read(path), gmwm.stream(path)
    assert len(imu) == SIZE == sum(chunk.values["gyro_x"].size for chunk in stream)
    assert imu.time_base.gaps == stream.time_base.gaps == ()


def test_commented_rows_are_counted(tmp_path):
    path = saved(
        tmp_path, "# a comment\ntime [s],gyro_x [rad/s]",
        lambda k: "#" * (k >= 200) + f"{k / RATE:.2f},{NOISE[k]:.6f}",
    )  # fmt: skip
    imu = gmwm.read(path)
    assert len(imu) == 200
    assert only(imu.remarks, "left-out:commented").facts == {"case": "commented", "count": 100, "sign": "#"}
    assert "left-out:commented" in codes(gmwm.stream(path).remarks)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("names", "size"),
    [("gps_sow,gps_ms", 3), ("epoch,millis", 3), ("frame.secs,frame.nsecs", 9),
     ("time_sec,time_nsec", 9), ("sec,usec", 6), ("seconds,nanoseconds", 9), ("tv_sec,tv_usec", 6), ("time,ms", 3),
     ("timestamp_s,fraction", 6), ("header.stamp.sec,header.stamp.nanosec", 9), ("t,us", 6), ("secs,nsecs", 9)],
)  # fmt: skip
def test_seconds_and_fractions_are_joined(tmp_path, names, size):
    def row(k: int) -> str:
        seconds, hundredths = divmod(k, RATE)
        return f"{1_700_000_000 + seconds},{hundredths * 10 ** (size - 2)},{NOISE[k]:.6f}"

    path = saved(tmp_path, f"{names},gyro_x [rad/s]", row, "log.csv")
    imu = gmwm.read(path)
    assert (imu.rate, imu.time_base.gaps, imu.time_base.jitter) == (RATE, (), 0)
    assert only(imu.remarks, "time-read:read").facts["columns"] == tuple(names.split(","))
    assert gmwm.stream(path).rate == RATE


@pytest.mark.parametrize("form", [lambda k: f"{k / RATE:.6f}", lambda k: f"{k / RATE:.3g}"])
@pytest.mark.parametrize(("names", "scale"), [("time,fraction", 1), ("time_sec,time_nsec", 10**9), ("sec,usec", 10**6)])
def test_fractions_in_any_notation_are_joined(tmp_path, names, scale, form):
    def row(k: int) -> str:
        return f"{1_700_000_000 + k // RATE}.0,{form(scale * (k % RATE))},{NOISE[k]:.6f}"

    imu = gmwm.read(saved(tmp_path, f"{names},gyro_x [rad/s]", row, "log.csv"))
    assert (imu.rate, imu.time_base.gaps, imu.time_base.jitter) == (RATE, (), 0)


def test_counters_and_second_clocks_are_no_fractions():
    seconds = [k // 100 for k in range(300)]
    tables = {
        "a counter within each second": [k % 100 for k in range(300)],
        "a clock of its own": [10_000_000 * k for k in range(300)],
        "a counter": list(range(300)),
        "noise": np.random.default_rng(1).integers(0, 1000, 300).tolist(),
    }
    for numbers in tables.values():
        rows = [[str(a), str(b), "0.1"] for a, b in zip(seconds, numbers, strict=True)]
        assert find_parts(["time", "other", "gyro_x"], rows) is None
