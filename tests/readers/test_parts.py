"""Parts of a recording, each read by itself, are together what one pass gives."""

import gzip
import pickle
import warnings

import h5py
import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError, ReadError
from gmwm.files.contract import Mark, Reader, find_reader
from gmwm.files.formats import arrays, parquet, text, waypoint
from gmwm.files.readers import interpretation, parts, stream
from gmwm.files.readers.interpretation import of_file
from gmwm.files.readers.parts import PartReader
from gmwm.files.readers.streams import Stream
from tests.helpers import only, raises
from tests.readers.test_imr import imr
from tests.readers.test_stream import FORMATS_AND_STAMPS, ROWS, columns, stamps, written

UNITS = {"gyro": "deg/s", "accel": "g"}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Blocks and heads so small that a file of some thousand rows has many of them."""
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 3000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 60_000)
    monkeypatch.setattr(parquet, "TABLE_ROWS", 1500)
    monkeypatch.setattr(arrays, "ARRAY_ROWS", 1500)
    monkeypatch.setattr(waypoint, "RECORDS_OF_CHUNK", 1500)


def firsts(chunks):
    """The rows that begin a segment."""
    return [p.first for k, p in enumerate(chunks) if p.segment != (chunks[k - 1].segment if k else 0)]


def whole(source):
    """All chunks of a stream, and what it warns of at the end."""
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        found = list(source)
    return found, [str(w.message) for w in told]


def same(source, count):
    """Whether parts are what one pass gives; the parts."""
    expected, told = whole(source)
    divided = pickle.loads(pickle.dumps(source.parts(count)))
    assert [part.first for part in divided[1:]] == [part.stop for part in divided[:-1]]
    seen, summary = [], None
    for part in divided:
        reader = PartReader(part)
        own = [chunk for samples in reader.samples() for chunk in samples.chunks(part.size)]
        assert all(len(chunk) <= part.size for chunk in own)
        assert own[0].first == part.first
        seen.append((own, firsts(own)))
        summary = reader.summary if summary is None else summary.followed_by(reader.summary)
    for axis in source.axes:
        joined = np.concatenate([chunk[axis] for own, _ in seen for chunk in own])
        assert np.array_equal(joined, np.concatenate([chunk[axis] for chunk in expected]))
    assert [row for _, own in seen for row in own] == firsts(expected)
    assert (summary.first, summary.stop) == (0, expected[-1].first + len(expected[-1]))
    assert [str(remark) for remark in of_file(summary.remarks(source._found), source.source)] == told
    base = summary.time_base(source._found)
    for name in ("rate", "stamped", "start", "gaps", "duplicates", "backward"):
        assert getattr(base, name) == getattr(source.time_base, name), name
    assert base.jitter == pytest.approx(source.time_base.jitter, rel=1e-9)
    return divided


@pytest.mark.slow
@pytest.mark.parametrize(("suffix", "kind"), FORMATS_AND_STAMPS)
def test_parts_are_what_is_read(tmp_path, suffix, kind):
    time = stamps(kind, np.random.default_rng(3))
    name = "timestamp_ns" if kind == "nanoseconds" else "time_s"
    path = written(tmp_path / f"a{suffix}", {name: time} | columns())
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        source = stream(path, units=UNITS, chunk=777)
    assert len(same(source, 3)) == 3


@pytest.mark.slow
@pytest.mark.parametrize("apart", range(-3, 4))
def test_a_gap_at_a_seam_or_beside_it(tmp_path, apart):
    k = np.arange(ROWS)
    path = written(tmp_path / "a.parquet", {"time": (k + 7 * (k >= 10_500 + apart)) * 0.01} | columns())
    source = stream(path, units=UNITS)
    _, right = same(source, 2)
    assert right.first == 10_500
    reader = PartReader(right)
    begin = next(chunk for samples in reader.samples() for chunk in samples.chunks(777))
    assert begin.segment == (apart == 0)
    assert begin.start == pytest.approx((10_500 + 7 * (apart <= 0)) * 0.01, rel=1e-12)


def test_without_stamps_and_more_parts_than_rows_allow(tmp_path):
    path = written(tmp_path / "a.npy", columns())
    divided = same(stream(path, 125.0, units=UNITS), 1000)
    assert 2 <= len(divided) <= 4
    assert all(part.stop - part.first >= parts.SHORTEST_PART for part in divided)
    (only,) = same(stream(path, 125.0, units=UNITS), 1)
    assert only.whole
    assert "all rows" in repr(only)


@pytest.mark.slow
def test_hdf5_and_bare_records(tmp_path):
    table = np.column_stack([np.arange(ROWS) * 0.01, *columns().values()])
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["imu/time"] = table[:, 0]
        file["imu/gyro [deg/s]"] = table[:, 1:4]
    assert len(same(stream(tmp_path / "a.h5"), 3)) == 3
    imu = gmwm.simulate({"gyro": "WN(sigma2=1e-6)", "accel": "WN(sigma2=1e-4)"}, rate=100.0, samples=ROWS, rng=2)
    kind = next(kind for kind in waypoint.TYPES if kind.name == "LN200")
    imu.write(tmp_path / "a.imu", format=kind.format)
    assert len(same(stream(tmp_path / "a.imu", format=kind.format), 3)) == 3
    head = imr(samples=0)
    (tmp_path / "a.imr").write_bytes(head + (tmp_path / "a.imu").read_bytes())
    assert len(same(stream(tmp_path / "a.imr"), 4)) == 4


@pytest.mark.slow
def test_what_cannot_be_divided_is_one_part(tmp_path):
    path = written(tmp_path / "a.csv", {"time_s": stamps("gaps", None)} | columns())
    packed = tmp_path / "a.csv.gz"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    (part,) = same(stream(packed, units=UNITS), 4)
    assert part.whole
    assert part.stop is None


ODD = {
    "plain": "1,2\n3,4\n5,6\n",
    "no end": "1,2\n3,4\n5,6",
    "blanks": "1,2\n\n3,4\n \t\n\n5,6\n\n\n",
    "blank end": "1,2\n3,4\n  ",
    "crlf": "1,2\r\n3,4\r\n\r\n5,6\r\n",
    "crlf, no end": "1,2\r\n3,4\r\n5,6",
    "padded": "  1, 2\n  3, 4\n\n  5, 6\n",
    "comments": "# first\n1,2\n# between\n3,4\n\n5,6\n# last",
    "quotes": 'a,"b"\n"1","2"\n"3","4"\n',
    "header": "\n\nx,y\n1,2\n3,4\n",
    "mark": "\ufeff1,2\n3,4\n",
    "tabs": "1\t2\n3\t4\n\t\n5\t6\n",
    "spaces": "  1   2\n  3   4\n \n  5   6\n   ",
}


@pytest.mark.parametrize("name", ODD)
@pytest.mark.parametrize("block", [3, 7, 16, 1000])
def test_rows_of_text_are_counted_as_they_are_read(tmp_path, monkeypatch, name, block):
    monkeypatch.setattr(text, "BLOCK_BYTES", block)
    path = tmp_path / "a.txt"
    path.write_bytes(ODD[name].encode())
    reader = find_reader(path, "text")
    layout = reader.layouts(path)[0]
    read = [chunk[0] for chunk in reader.chunks(path, layout, [0])]
    marks = reader.marks(path, layout)
    assert [mark.row for mark in marks] == [0, *np.cumsum([part.size for part in read])]
    for mark in marks[:-1]:
        rest = np.concatenate([chunk[0] for chunk in reader.chunks_from(path, layout, [0], mark)])
        assert np.array_equal(rest, np.concatenate(read)[mark.row :])


def test_a_format_of_another_hand_is_skipped_through(tmp_path):
    path = written(tmp_path / "a.npy", columns())
    reader = find_reader(path)
    layout = reader.layouts(path)[0]
    skipped = Reader.chunks_from(reader, path, layout, [0], Mark(6000))
    own = reader.chunks_from(path, layout, [0], Mark(6000))
    assert np.array_equal(np.concatenate([c[0] for c in skipped]), np.concatenate([c[0] for c in own]))
    assert Reader.marks(reader, path, layout) == ()


def test_counted_packets_are_one_part(tmp_path):
    rows = "\n".join(f"{(65_000 + k) % 65_536},{k % 7 * 0.1},{k % 5 * 0.2},{k % 3 * 0.1}" for k in range(9000))
    path = tmp_path / "a.txt"
    path.write_text(f"// Update Rate: 100.0Hz\nPacketCounter,Gyr_X,Gyr_Y,Gyr_Z\n{rows}\n")
    source = stream(path)
    assert only(source.remarks, "time-read:read").facts["form"] == "packets"
    assert same(source, 2)[0].whole


def test_what_is_wrong_is_told_with_its_row(tmp_path):
    path = written(tmp_path / "a.csv", {"time": stamps("even", None)} | columns())
    path.write_text(path.read_text() + "200.01,1,2\n")
    with raises(ReadError, "line 20002", "3 values", "expected 7"):  # by the pass over the time stamps
        stream(path, units=UNITS)


@pytest.mark.slow
def test_another_file_under_the_same_path(tmp_path):
    path = written(tmp_path / "a.npy", columns())
    divided = stream(path, 100.0, units=UNITS).parts(3)
    np.save(path, np.load(path)[:-1])
    with raises(ReadError, path, path.stat().st_size, divided[1].bytes):
        list(divided[1])
    path.unlink()
    with raises(ReadError, path, advises=["this path"]):
        list(divided[1])
    text_path = written(tmp_path / "a.csv", columns())
    divided = stream(text_path, 100.0, units=UNITS).parts(3)
    lines = text_path.read_text().splitlines(keepends=True)
    text_path.write_text("".join(lines[:6000]) + "\n" * len(lines[6000]) + "".join(lines[6001:]))
    with raises(ReadError, code="changed"):
        [list(part) for part in divided]


def test_options_are_checked_at_the_door(tmp_path):
    source = stream(written(tmp_path / "a.npy", columns()), 100.0, units=UNITS)
    for count in (0, 1.5, True, "many"):
        with raises(OptionError, argument="count"):
            source.parts(count)
    growing = Stream("a pipe", source._found, lambda: iter(()), 100)
    with raises(OptionError, advises=["Save it to a file"]):
        growing.parts(2)
