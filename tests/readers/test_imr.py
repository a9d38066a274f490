"""NovAtel .imr files, made with struct by the published table of the header."""

import struct

import numpy as np
import pytest

from gmwm.base.errors import DataError, ReadError
from gmwm.base.remarks import Quantity
from gmwm.base.units import AXES
from gmwm.files.readers import find_reader, read
from tests.helpers import only, raises

HEADER = "8sbdiidddiid32s4s32s12s?iii354s"
DEFAULT = {"rate": 125.0, "gyro": 1e-6, "accel": 2e-5, "angle": 1, "velocity": 1, "clock": 2, "endian": 0}


def imr(order="<", samples=300, stamps=None, cut=0, **changed):
    h = DEFAULT | {"endian": int(order == ">")} | changed
    head = struct.pack(
        order + HEADER, b"$IMURAW\0", h["endian"], 8.8, h["angle"], h["velocity"], h["rate"], h["gyro"], h["accel"],
        h["clock"], 0, 0.0, b"A sensor", b"", b"a program", b"", False, 0, 0, 0, b"",
    )  # fmt: skip
    assert len(head) == 512
    times, numbers = table(samples)
    times = times if stamps is None else stamps
    body = b"".join(struct.pack(order + "d6i", t, *row) for t, row in zip(times, numbers.tolist(), strict=True))
    return (head + body)[: len(head + body) - cut]


def table(samples=300):
    numbers = np.random.default_rng(8).integers(-500, 500, (samples, 6))
    numbers[:, 5] += 3900
    return 200_000 + np.arange(samples) / 125, numbers


@pytest.fixture
def file(tmp_path):
    return tmp_path / "static.imr"


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("angle", [0, 1])
@pytest.mark.parametrize("velocity", [0, 1])
def test_scales_and_increments_as_the_header_says(file, order, angle, velocity):
    file.write_bytes(imr(order, angle=angle, velocity=velocity))
    assert find_reader(file).name == "imr"
    imu = read(file)
    assert (imu.rate, imu["gyro_x"].start) == (125, 200_000)
    for k, axis in enumerate(AXES):
        sensor, flag, scale = ("gyro", angle, np.radians(1e-6)) if k < 3 else ("accel", velocity, 2e-5)
        expected = table()[1][:, k] * scale * (125 if flag else 1)
        np.testing.assert_allclose(imu[axis].values, expected, rtol=1e-14, err_msg=sensor)
    assert only(imu.remarks, "file-content:sensor").facts["name"] == "A sensor"
    assert only(imu.remarks, "time-read:read").facts == {"case": "read", "form": "week", "clock": "GPS"}


def test_it_is_known_by_its_signature(tmp_path):
    # Some programs name these files .imu.
    path = tmp_path / "static.imu"
    path.write_bytes(imr())
    assert find_reader(path).name == "imr"


def test_a_contradiction_of_rates_is_noted(file):
    file.write_bytes(imr(rate=250.0))
    facts = only(read(file).remarks, "rate-stated:stated").facts
    assert (facts["rate"], facts["used"]) == (Quantity(250.0, "Hz"), "no")
    assert facts["stamps"].value == pytest.approx(125.0, rel=1e-6)


@pytest.mark.parametrize(
    ("content", "code", "facts"),
    [
        (imr(cut=1), "cut-off", ["static.imr", "299 records", "32 bytes", "31 bytes"]),
        (imr(samples=0), "empty", ["static.imr"]),
        (imr(samples=0, cut=100), "cut-off", ["412 of 512 bytes"]),
        (b"$IMURAW\0", "cut-off", ["8 of"]),
        (imr(endian=7), "header-damaged", ["7", "0 or 1"]),
        (imr(endian=1), "header-damaged", ["bDeltaTheta", "16777216"]),
        (imr(angle=3), "header-damaged", ["bDeltaTheta", "3", "0 or 1"]),
        (imr(rate=0.0), "header-damaged", ["dDataRateHz", "0"]),
        (imr(gyro=float("nan")), "header-damaged", ["dGyroScaleFactor", "nan"]),
        (imr(accel=-1.0), "header-damaged", ["dAccelScaleFactor", "-1"]),
        (imr(samples=9, stamps=[float("nan")] * 9), "time-implausible", ["32 bytes", "nan, nan, nan, nan"]),
        (b"", "empty", []),
    ],
)
def test_what_is_wrong_is_told(file, content, code, facts):
    file.write_bytes(content)
    with raises(ReadError, *facts, code=code):
        read(file)


def test_few_records_and_foreign_files(file):
    file.write_bytes(imr(samples=1))
    with raises(DataError, "static.imr", "1 sample", "at least 8"):
        read(file)
    file.write_text("gyro_x\n1\n2\n")
    with raises(ReadError, code="wrong-format"):
        read(file, format="imr")


@pytest.mark.slow
def test_every_byte_of_the_header_may_be_wrong(file):
    # What a damaged header leads to is a recording or a clear error, never a traceback.
    whole = imr(samples=20)
    rng = np.random.default_rng(11)
    for at in range(512):
        broken = bytearray(whole)
        broken[at] = rng.integers(256)
        file.write_bytes(broken)
        try:
            read(file)
        except (ReadError, DataError):
            continue
