from __future__ import annotations

import gzip
import io

import numpy as np
import pytest

from gmwm.base.errors import GmwmError, ReadError
from gmwm.files.formats import text
from gmwm.files.formats.byte_sources import PackedError, zstd_library
from gmwm.files.readers import find_reader, read
from tests.helpers import raises, table

VALUES = np.random.default_rng(2).normal(size=(3000, 2))
ROWS = "".join(f"{k / 100:.2f},{gx!r},{ay!r}\n" for k, (gx, ay) in enumerate(VALUES.tolist()))
PLAIN = f"time [s],gx [rad/s],ay [m/s2]\n{ROWS}".encode()
PACK = {".gz": gzip.compress, ".zst": zstd_library().compress}


def saved(folder, content, suffix, name="a.csv"):
    path = folder / (name + suffix)
    path.write_bytes(content)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("suffix", PACK)
@pytest.mark.parametrize("block", [500, 8 << 20])
def test_the_same_numbers_packed(tmp_path, suffix, block, monkeypatch):
    monkeypatch.setattr(text, "BLOCK_BYTES", block)
    imu = read(saved(tmp_path, PACK[suffix](PLAIN), suffix))
    assert table(imu).tolist() == VALUES.tolist()
    assert imu.rate == 100


@pytest.mark.parametrize("suffix", PACK)
def test_several_frames_and_a_wrong_name(tmp_path, suffix):
    half = PLAIN.index(b"\n15.00") + 3
    content = PACK[suffix](PLAIN[:half]) + PACK[suffix](PLAIN[half:])
    path = saved(tmp_path, content, ".csv")
    assert find_reader(path).name == "compressed"
    assert table(read(path)).tolist() == VALUES.tolist()


def test_formats_with_a_header_of_their_own(tmp_path):
    header = b"timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n"
    rows = b"".join(b"%d,%d,1,2,3,4,9\n" % (10**18 + k * 5_000_000, k) for k in range(20))
    imu = read(saved(tmp_path, gzip.compress(header + rows), ".gz"), columns={"gyro_x": 1, "time": 0})
    assert (imu.rate, imu["gyro_x"].unit) == (200, "rad/s")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", PACK)
def test_cut_anywhere_or_damaged(tmp_path, suffix):
    whole = PACK[suffix](PLAIN)
    for size in [*range(20), *range(20, len(whole) - 1, 1999), len(whole) - 1]:
        path = saved(tmp_path, whole[:size], suffix)
        with pytest.raises(GmwmError):
            read(path)
    broken = bytearray(whole)
    broken[len(whole) // 2] ^= 0xFF
    with pytest.raises(GmwmError):
        read(saved(tmp_path, bytes(broken), suffix))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", PACK)
def test_a_bomb_is_not_unpacked(tmp_path, suffix):
    line = b"0,1,1\n" * (1 << 20)
    if suffix == ".gz":
        packed = io.BytesIO()
        with gzip.GzipFile(fileobj=packed, mode="wb", compresslevel=9) as file:
            for _ in range(40):
                file.write(line)
        content = packed.getvalue()
    else:
        content = zstd_library().compress(line * 40)
    with raises(PackedError, code="too-large"):
        read(saved(tmp_path, content, suffix), columns=["time", "gyro_x", None], units={"gyro": "rad/s", "time": "s"})


@pytest.mark.parametrize("suffix", PACK)
def test_what_is_packed_is_no_text(tmp_path, suffix):
    with raises(ReadError, code="not-text"):
        read(saved(tmp_path, PACK[suffix](bytes(range(256)) * 9), suffix))
    with raises(ReadError, code="empty"):
        read(saved(tmp_path, PACK[suffix](b""), suffix))
    with raises(PackedError, code="damaged"):
        read(saved(tmp_path, PLAIN, suffix), format="compressed")
