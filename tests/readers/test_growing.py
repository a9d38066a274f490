"""Text that grows is what it is when it is whole."""

import io
import os

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, ReadError, UnitError
from gmwm.files.readers import growing_files
from gmwm.files.readers.growing_files import GrowingFile, GrowingPipe, Lines, growing_stream
from gmwm.recording.options import ReadOptions
from tests.helpers import raises


@pytest.fixture(autouse=True)
def fast(monkeypatch):
    monkeypatch.setattr(growing_files, "POLL_S", 0.001)


def table(rows=3000, gap=1200):
    rng = np.random.default_rng(1)
    k = np.arange(rows)
    values = rng.normal(size=(rows, 2))
    lines = [f"{(i + 90 * (i >= gap)) * 0.01:.2f},{a!r},{b!r}\n" for i, (a, b) in zip(k, values.tolist(), strict=True)]
    return ("# a bench\ntime [s],gyro_x [deg/s],gyro_z [deg/s]\n" + "".join(lines)).encode()


def served(data, cuts):
    """Bytes handed out in parts, with looks between them at which nothing has come."""
    parts = [data[a:b] for a, b in zip([0, *cuts], [*cuts, len(data)], strict=True)]
    return iter([part for one in parts for part in (one, b"")] + [None]).__next__


def followed(data, cuts, **options):
    lines = Lines(served(data, cuts), lambda: True)
    source = growing_stream(lines, "bench.csv", ReadOptions(**options), patience=0.0)
    return source, list(source), lines


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_however_it_comes_it_is_what_it_is_as_a_whole(tmp_path, seed):
    data = table()
    (tmp_path / "a.csv").write_bytes(data)
    imu = gmwm.read(tmp_path / "a.csv")
    rng = np.random.default_rng(seed)
    cuts = sorted(rng.integers(0, len(data), size=(3, 30, 300)[seed % 3]).tolist())
    source, chunks, lines = followed(data, cuts)
    assert source.rate == imu.rate
    for axis in imu.axes:
        assert np.array_equal(np.concatenate([chunk[axis] for chunk in chunks]), imu[axis].values)
    starts = {chunk.segment: chunk.first for chunk in reversed(chunks)}
    assert list(starts.values())[::-1] == [first for first, _ in imu.segments] == [0, 1200]
    assert lines.rest == b""


@pytest.mark.slow
def test_byte_by_byte():
    data = table(rows=20, gap=99)
    _, chunks, _ = followed(data, list(range(1, len(data))))
    assert sum(len(chunk) for chunk in chunks) == 20


def test_a_line_without_an_end_is_left_out():
    data = table(rows=400, gap=999)
    _, chunks, lines = followed(data[:-5], [3000])
    assert sum(len(chunk) for chunk in chunks) == 399
    assert lines.rest == data[data.rfind(b"\n", 0, -1) + 1 : -5]


def test_nothing_is_lost_between_the_first_lines_and_the_rest():
    """A pipe that has given its first lines long before the others."""
    data = table(rows=600, gap=999)
    first = data.find(b"\n", 4000) + 1
    given = iter([data[:first], *[b""] * 5, data[first:], None])
    source = growing_stream(Lines(given.__next__, lambda: True), "a", patience=0.0)
    assert sum(len(chunk) for chunk in source) == 600
    with pytest.raises(StopIteration):
        next(given)


def test_breathing_ends_it():
    looks = iter([True] * 3 + [False] * 9)
    lines = Lines(served(table(), []), looks.__next__)
    chunks = list(growing_stream(lines, "a", patience=0.0))
    assert sum(len(chunk) for chunk in chunks) == 3000


def test_data_that_wait_while_the_last_lines_are_processed_are_read(monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(growing_files.time, "monotonic", lambda: clock[0])
    lines = Lines(iter([b"a\n", b"b\n", b"", b"", b"never\n"]).__next__, lambda: True, idle=3.0)
    assert lines.look() == b"a\n"
    clock[0] = 100.0
    assert lines.look() == b"b\n"
    clock[0] = 200.0
    assert lines.look() == b""
    assert not lines.ended
    clock[0] = 203.0
    assert lines.look() == b""
    assert lines.ended


def test_what_it_is_not_is_an_error():
    with raises(ReadError, code="empty"):
        followed(b"time,gyro", [])
    with raises(ReadError, code="not-text"):
        followed(b"PAR1\0\1\2\3\n" * 40, [])
    with raises(UnitError, "gyro_x"):
        followed(table().replace(b"deg/s", b""), [])
    with raises(DataError, 5, 8):
        followed(table(rows=5), [])
    with raises(ReadError, "line 3003", "'gyro_x [deg/s]'", "'oops'"):
        followed(table() + b"40.00,oops,1\n", [60_000])


def test_a_file_that_grows(tmp_path):
    path = tmp_path / "a.csv"
    data = table()
    path.write_bytes(data[:1000])
    take = GrowingFile(path)
    assert take() == data[:1000]
    assert take() == b""
    with path.open("ab") as file:
        file.write(data[1000:1500])
    assert take() == data[1000:1500]
    assert take.trouble == ""
    path.write_bytes(b"time\n")
    assert take() is None
    assert "was truncated to 5 bytes" in take.trouble
    assert take() is None
    take.close()


@pytest.mark.skipif(os.name == "nt", reason="an open file cannot be replaced there")
def test_a_file_that_goes(tmp_path):
    path = tmp_path / "a.csv"
    for act, said in ((lambda: path.unlink(), "removed"), (lambda: (tmp_path / "b").rename(path), "replaced")):
        path.write_bytes(b"one\n")
        (tmp_path / "b").write_bytes(b"another one\n")
        take = GrowingFile(path)
        act()
        assert take() == b"one\n"
        assert take() is None
        assert f"was {said}" in take.trouble
        take.close()
    with raises(ReadError, code="not-readable"):
        GrowingFile(tmp_path / "none")


def test_a_pipe():
    data, got = table(), b""
    take = GrowingPipe(io.BufferedReader(io.BytesIO(data)))
    while (part := take()) is not None:
        got += part
    assert got == data
    assert take() is None
