"""Missing values, bad lines, rows of other messages and dead axes: nothing is lost without a word, or spliced."""

import itertools
import warnings

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.base.errors import DataError, GmwmWarning, ReadError
from gmwm.files.clock import clock
from gmwm.files.clock.missing_values import gaps_of
from gmwm.files.formats import parquet, text
from gmwm.files.readers import interpretation, read, stream
from gmwm.files.readers.parts import PartReader
from tests.helpers import code_of, codes, raises, warns

ROWS = 6000
VALUES = np.random.default_rng(1).normal(size=(ROWS, 2)).round(6)
HEADER = "time [s],gyro_x [rad/s],gyro_y [rad/s]\n"
LINES = [f"{k / 100:.2f},{x},{y}\n" for k, (x, y) in enumerate(VALUES.tolist())]


@pytest.fixture
def small_blocks(monkeypatch):
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 1000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 20_000)
    monkeypatch.setattr(parquet, "TABLE_ROWS", 700)


def saved(tmp_path, lines, header=HEADER):
    path = tmp_path / "static.csv"
    path.write_text(header + "".join(lines))
    return path


def changed(**lines):
    """The lines of the file with some of them replaced, "_17" for line 17."""
    out = list(LINES)
    for key, line in lines.items():
        out[int(key[1:])] = line
    return out


def joined(source):
    """Samples, segments and starts of a stream."""
    chunks = list(source)
    values = np.concatenate([chunk["gyro_x"] for chunk in chunks])
    assert [chunk.first for chunk in chunks] == list(itertools.accumulate(map(len, chunks), initial=0))[:-1]
    begins = [chunk for k, chunk in enumerate(chunks) if k == 0 or chunk.segment != chunks[k - 1].segment]
    edges = [*(chunk.first for chunk in begins), values.size]
    return values, tuple(itertools.pairwise(edges)), [chunk.start for chunk in begins]


@pytest.mark.slow
@pytest.mark.parametrize("cell", ["nan", "", "NA", "NaN", "-inf", "1e999", "null", "N/A"])
def test_a_missing_value_is_a_gap(tmp_path, cell):
    with warns("samples-lost:axes", count=1, axes=("gyro_x",), without="gyro_x:none"):
        imu = read(saved(tmp_path, changed(_17=f"0.17,{cell},1\n")))
    assert imu.segments == ((0, 17), (17, ROWS - 1))
    assert imu["gyro_y"].starts == pytest.approx((0.0, 0.18))
    assert imu["gyro_y"].values.tolist() == np.delete(VALUES[:, 1], 17).tolist()
    assert imu.time_base.gaps == ((17, pytest.approx(0.02)),)
    assert imu.time_base.lost == 1


@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_without_time_stamps_a_lost_sample_keeps_its_place(tmp_path):
    lines = [line.partition(",")[2] for line in changed(_0="0,nan,1\n", _17="0,,\n", _18="0,1,\n", _5999="0,,1\n")]
    imu = read(saved(tmp_path, lines, "gyro_x [rad/s],gyro_y [rad/s]\n"), rate=100)
    assert imu.segments == ((0, 16), (16, ROWS - 4))
    assert imu["gyro_x"].starts == pytest.approx((0.01, 0.19))
    assert imu.time_base.gaps == ((16, pytest.approx(0.03)),)
    assert imu.time_base.lost == 4


BAD = {
    "short": "0.17,0.1\n",
    "long": "0.17,0.1,0.2,0.3\n",
    "text": "0.17,0.1#$2,0.2\n",
    "two lines in one": "0.17,0.1,0.18,0.1,0.2\n",
    "no UTF-8": "0.17,\udcff\udcfe,0.2\n",
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", BAD)
def test_a_bad_line_is_an_error_or_a_gap(tmp_path, kind):
    path = tmp_path / "static.csv"
    path.write_bytes((HEADER + "".join(changed(_17=BAD[kind]))).encode(errors="surrogateescape"))
    with raises(ReadError, "line 19", advises=["bad_lines='skip'"]):
        read(path)
    with warns("samples-lost:lost", count=1):
        imu = read(path, bad_lines="skip")
    assert imu.segments == ((0, 17), (17, ROWS - 1))
    assert imu.time_base.lost == 1
    assert imu["gyro_x"].values.tolist() == np.delete(VALUES[:, 0], 17).tolist()


@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
@pytest.mark.parametrize(
    "cells", ["2024-05-01T10:00:{0:06.3f}Z", "10:00:{0:06.3f}", "{1}"], ids=["dates", "times of day", "nanoseconds"]
)
def test_bad_lines_between_stamps_of_any_form(tmp_path, small_blocks, cells):
    lines = [
        cells.format(k / 100, 1_700_000_000_000_000_000 + k * 10_000_000) + "," + line.partition(",")[2]
        for k, line in enumerate(LINES)
    ]
    lines[40], lines[5000] = "@@@\n", ",,\n"
    imu = read(saved(tmp_path, lines), bad_lines="skip", units={"time": "ns"} if cells == "{1}" else None)
    assert imu.rate == pytest.approx(100, rel=1e-9)
    assert imu.segments == ((0, 40), (40, 4999), (4999, ROWS - 2))
    assert [duration for _, duration in imu.time_base.gaps] == pytest.approx([0.02, 0.02])
    assert imu.time_base.lost == 2


@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_a_bad_line_between_blanks(tmp_path):
    lines = [line.replace(",", "  ") for line in changed(_17="0.17,0.1\n", _20="0.2,NA,1\n")]
    imu = read(saved(tmp_path, lines, "time gyro_x gyro_y\n"), units={"gyro": "rad/s"}, bad_lines="skip")
    assert imu.segments == ((0, 17), (17, 19), (19, ROWS - 2))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_a_last_line_that_was_cut_off_is_skipped(tmp_path):
    path = saved(tmp_path, LINES)
    for cut in (4, 14):
        path.write_text((HEADER + "".join(LINES))[:-cut])
        with raises(ReadError, advises=["bad_lines='skip'"]):
            read(path)
        assert read(path, bad_lines="skip").segments == ((0, ROWS - 1),)


@pytest.mark.slow
@pytest.mark.parametrize("blanks", [False, True])
def test_a_repeated_header_is_no_row(tmp_path, small_blocks, blanks):
    again = [*LINES[:300], "\n" * blanks + HEADER, *LINES[300:]]
    path = saved(tmp_path, again)
    assert read(path).segments == ((0, ROWS),)
    divided = stream(path).parts(4)
    assert sum(len(chunk) for part in divided for chunk in part) == ROWS


@pytest.mark.slow
@pytest.mark.parametrize("form", ["csv", "parquet"])
@pytest.mark.parametrize("clock", [True, False])
@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_streams_and_parts_lose_the_same_samples(tmp_path, small_blocks, clock, form):
    rng = np.random.default_rng(3)
    values = VALUES.copy()
    values[rng.integers(0, ROWS, 60), rng.integers(0, 2, 60)] = np.nan
    values[[0, 1, 699, 700, 701, 1400, 2100, 4200, ROWS - 1], 0] = np.nan
    time = (np.arange(ROWS) + 9 * (np.arange(ROWS) > 2500) + 5 * (np.arange(ROWS) >= 701)) / 100
    path = tmp_path / f"a.{form}"
    table = {"time": time} if clock else {}
    frame = pl.DataFrame(table | {"gyro_x": values[:, 0], "gyro_y": values[:, 1]})
    _ = frame.write_csv(path) if form == "csv" else frame.fill_nan(None).write_parquet(path)
    options = {"units": {"gyro": "rad/s", "time": "s"} if clock else {"gyro": "rad/s"}, "rate": 100.0}
    whole = read(path, **options)
    signal = whole["gyro_x"]
    expected = np.flatnonzero(np.isfinite(values).all(axis=1))
    assert signal.values.tolist() == values[expected, 0].tolist()
    assert signal.times() == pytest.approx(time[expected] if clock else expected / 100, abs=1e-9)
    source = stream(path, chunk=500, **options)
    streamed, segments, starts = joined(source)
    assert streamed.tolist() == signal.values.tolist()
    assert segments == signal.segments
    assert starts == pytest.approx(signal.starts)
    assert source.time_base.lost == whole.time_base.lost == ROWS - expected.size
    np.testing.assert_allclose(source.time_base.gaps, whole.time_base.gaps, rtol=1e-9)
    samples, summary = [], None
    for part in stream(path, **options).parts(4):
        reader = PartReader(part)
        samples += [x for part in reader.samples() for x in part.values["gyro_x"].tolist()]
        summary = reader.summary if summary is None else summary.followed_by(reader.summary)
    assert samples == signal.values.tolist()
    assert (summary.lost, summary.stop) == (whole.time_base.lost, len(signal))
    np.testing.assert_allclose(summary.gaps, whole.time_base.gaps, rtol=1e-9)


@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_lost_samples_are_not_spliced_in_the_wavelet_variance(tmp_path):
    values = np.cumsum(VALUES, axis=0)
    whole = {"gyro_x": values[:, 0], "gyro_y": values[:, 1]}
    holes = {axis: v.copy() for axis, v in whole.items()}
    holes["gyro_x"][[1000, 1001, 4000]] = np.nan
    pl.DataFrame(holes).write_parquet(tmp_path / "a.parquet")
    imu = read(tmp_path / "a.parquet", rate=100, units={"gyro": "rad/s"})
    missing = gmwm.Signal.from_missing(np.where(np.isnan(holes["gyro_x"]), np.nan, whole["gyro_y"]), 100.0)
    mine, theirs = gmwm.wavelet_variance(imu["gyro_y"]), gmwm.wavelet_variance(missing)
    np.testing.assert_allclose(mine.variance, theirs.variance, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(("value", "kind"), [(0.25, "constant"), (np.nan, "missing")])
def test_a_dead_axis_does_not_fail_the_file(tmp_path, small_blocks, value, kind):
    frame = pl.DataFrame({"time": np.arange(ROWS) / 100, "gyro_x": VALUES[:, 0], "gyro_y": value, "gyro_z": 1.0})
    frame = frame.with_columns(gyro_z=pl.Series(VALUES[:, 1]))
    frame.write_csv(tmp_path / "a.csv")
    with warns("axis-dead", "gyro_y", kind=kind):
        imu = read(tmp_path / "a.csv", units={"gyro": "rad/s"})
    assert imu.axes == ("gyro_x", "gyro_z")
    assert len(imu.segments) == 1
    with warns("axis-dead", "gyro_y", kind=kind):
        source = stream(tmp_path / "a.csv", units={"gyro": "rad/s"})
    assert source.axes == imu.axes
    assert sum(map(len, source)) == ROWS


@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
def test_gravity_is_inferred_with_a_dead_accelerometer(tmp_path):
    table = {
        "time": np.arange(ROWS) / 100,
        "accel_x": VALUES[:, 0] * 1e-3,
        "accel_y": 0.0,
        "accel_z": 1 + VALUES[:, 1] * 1e-3,
    }
    pl.DataFrame(table).write_csv(tmp_path / "a.csv")
    assert read(tmp_path / "a.csv").axes == ("accel_x", "accel_z")
    assert np.mean(read(tmp_path / "a.csv")["accel_z"].values) == pytest.approx(9.80665, rel=1e-3)


@pytest.mark.slow
def test_rows_of_other_messages_are_left_out(tmp_path, small_blocks):
    lines = []
    for k, line in enumerate(LINES):
        lines += [line.replace("\n", ",\n")] + (
            [f"{k / 100 + 0.004:.3f},,,{20 + k / 100:.2f}\n"] if k % 10 == 3 else []
        )
    path = saved(tmp_path, lines, HEADER.replace("\n", ",temperature\n"))
    imu = read(path)
    assert (imu.rate, imu.segments) == (100.0, ((0, ROWS),))
    assert imu.time_base.lost == 0
    assert [r.facts["count"] for r in imu.remarks if code_of(r) == "file-content:other-rows"] == [600]
    # Their temperature is interpolated to the samples.
    assert imu.temperature[10:-10] == pytest.approx(20 + np.arange(10, ROWS - 10) / 100 - 0.004, abs=1e-6)
    assert sum(map(len, stream(path))) == ROWS


@pytest.mark.slow
@pytest.mark.parametrize("stamped", [True, False])
@pytest.mark.parametrize("kind", ["end", "beginning", "every third", "other rows"])
def test_a_sensor_that_lacks_values_costs_the_others_nothing(tmp_path, small_blocks, kind, stamped):
    k = np.arange(ROWS)
    away = {"end": k >= ROWS // 2, "beginning": k < ROWS // 2, "every third": k % 3 > 0, "other rows": k % 3 == 1}[kind]
    table = {"gyro_x": VALUES[:, 0], "accel_x": np.where(away, np.nan, VALUES[:, 1])}
    if kind == "other rows":  # the sensors have rows of their own
        table = {"gyro_x": np.where(away, np.nan, VALUES[:, 0]), "accel_x": np.where(away, VALUES[:, 1], np.nan)}
    if stamped:
        table["time"] = k / 100 if kind != "other rows" else np.cumsum(~away) / 100 + 0.004 * away
    pl.DataFrame(table).write_parquet(tmp_path / "a.parquet")
    options = {"units": {"gyro": "rad/s", "accel": "g"}, "rate": None if stamped else 100.0}
    counts = {axis: float(np.isfinite(table[axis]).sum()) for axis in ("gyro_x", "accel_x")}
    facts = {"kind": "sparse", "value": counts["accel_x"], "rows": int(counts["gyro_x"]), "columns": "accel_x:accel_x"}
    with warns("axis-dead", "accel_x", **facts):
        imu = read(tmp_path / "a.parquet", **options)
    assert imu.axes == ("gyro_x",)
    assert len(imu) == counts["gyro_x"]
    assert len(imu.segments) == 1 or not stamped
    warnings.simplefilter("ignore", GmwmWarning)  # the rows of the other sensor are lost samples of a known place
    with warns("axis-dead", "accel_x", **facts):
        source = stream(tmp_path / "a.parquet", **options)
    assert source.axes == imu.axes
    assert np.array_equal(np.concatenate([chunk["gyro_x"] for chunk in source]), imu["gyro_x"].values)
    if stamped:
        alone = read(tmp_path / "a.parquet", columns={"accel_x": "accel_x"}, **options)
        assert len(alone) == counts["accel_x"]


def test_sensors_with_rows_of_their_own_and_equal_rates(tmp_path):
    odd = np.arange(ROWS) % 2 > 0
    table = {
        "time": np.arange(ROWS) / 100,
        "gyro_x": np.where(odd, VALUES[:, 0], np.nan),
        "accel_x": np.where(odd, np.nan, VALUES[:, 1]),
    }
    pl.DataFrame(table).write_parquet(tmp_path / "a.parquet")
    with raises(DataError, "gyro_x in 3000, accel_x in 3000", advises=["columns={'gyro_x': 'gyro_x'}"]):
        read(tmp_path / "a.parquet", units={"gyro": "rad/s", "accel": "g"})


def test_gaps_of_lost_rows_and_time_stamps():
    pairs, stamped = [(3, 5), (9, 10), (20, 24)], [(10, 0.5), (22, 0.25), (23, 0.15)]
    found = gaps_of(pairs, [4, 8, 18], stamped=stamped, rate=10.0)
    assert found == ((4, pytest.approx(0.2)), (8, 0.5), (18, pytest.approx(0.6)))


@pytest.mark.parametrize("axes", [1, 3])
def test_a_logger_that_writes_only_changes_is_refused_at_once(tmp_path, axes):
    """The steps are so coarse that rows repeat. Without these rows, N was wrong, or `calibrate` took minutes."""
    rng = np.random.default_rng(3)
    values = 1e-3 * np.round(rng.normal(size=(ROWS, axes)) / (0.7 if axes == 1 else 3))
    changed = np.append(True, np.any(np.diff(values, axis=0) != 0, axis=1))
    changed[::700] = True  # some loggers also write at regular times
    header = "time [s]," + ",".join(f"gyro_{'xyz'[k]} [rad/s]" for k in range(axes)) + "\n"
    lines = [f"{k / 100:.2f},{','.join(map(str, row))}\n" for k, row in enumerate(values.tolist())]
    path = saved(tmp_path, [line for line, new in zip(lines, changed.tolist(), strict=True) if new], header)
    for opened in (read, stream):
        with raises(ReadError, code="changes-only"):
            opened(path)
    some = saved(tmp_path, [line for line, lost in zip(lines, rng.random(ROWS) < 0.2, strict=True) if not lost], header)
    assert len(read(some)["gyro_x"].segments) > 500


BUFFERS = [*LINES[:2000], *LINES[1200:2000], *LINES[2000:4500], *LINES[3800:4500], *LINES[4500:]]


@pytest.mark.parametrize("block", [1 << 20, 1000])
def test_a_buffer_that_was_written_twice_is_used_once(tmp_path, small_blocks, monkeypatch, block):
    monkeypatch.setattr(clock, "BLOCK", block)
    monkeypatch.setattr(clock, "MARGIN", 1000)
    path = saved(tmp_path, BUFFERS)
    with warns("stamps-irregular:again", count=2, rows=1500):
        imu = read(path)
    once = read(saved(tmp_path, LINES))
    assert (imu.segments, imu.time_base) == (once.segments, once.time_base)
    assert all(np.array_equal(imu[axis].values, once[axis].values) for axis in once)
    with warns("stamps-irregular:again", count=2, rows=1500):
        source = stream(saved(tmp_path, BUFFERS))
    (part,) = source.parts(3)
    for samples in (source.samples(), PartReader(part).samples()):
        values = np.concatenate([some.values["gyro_x"] for some in samples])
        assert np.array_equal(values, once["gyro_x"].values)


def test_rows_that_look_like_earlier_ones_are_no_copies(tmp_path):
    stamps = [line.split(",")[0] for line in LINES]
    coarse = (VALUES > 3).astype(int)  # nearly always zero
    other = [f"{stamps[k]},{x},{y}\n" for k, (x, y) in zip(range(1200, 2000), VALUES[3000:3800], strict=True)]
    steady = [f"{stamp},{x},{y}\n" for stamp, (x, y) in zip(stamps, coarse, strict=True)]
    held = [f"{stamp},{x},{y}\n" for stamp, (x, y) in zip(stamps, np.repeat(VALUES[::20], 20, axis=0), strict=True)]
    zeros = next(k for k in range(1000) if not coarse[k : k + 100].any())
    for lines in (
        [*LINES[:2000], *other, *LINES[2000:]],
        [*steady[: zeros + 100], *steady[zeros : zeros + 50], *steady[zeros + 100 :]],
        held,
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", GmwmWarning)
            imu = read(saved(tmp_path, lines))
        assert "stamps-irregular:again" not in codes(imu.remarks)
        assert imu["gyro_x"].values.size == len(lines)


@pytest.mark.parametrize("word", ["-nan(ind)", "nan(ind)", "1.#QNAN", "-1.#IND00"])
def test_the_words_of_c_for_no_number_are_missing_values(tmp_path, word):
    lines = [line if k != 700 else f"7.00,{word},{word}\n" for k, line in enumerate(LINES)]
    imu = read(saved(tmp_path, lines))
    assert imu["gyro_x"].values.size == ROWS - 1
    assert [row for row, _ in imu.time_base.gaps] == [700]


def test_signs_of_typeset_numbers_are_read(tmp_path):
    expected = read(saved(tmp_path, LINES))["gyro_x"].values
    assert np.array_equal(read(saved(tmp_path, [line.replace("-", "−") for line in LINES]))["gyro_x"].values, expected)


def test_files_with_byte_order_marks_can_be_joined(tmp_path, small_blocks):
    path = saved(tmp_path, [*LINES[:3000], "\ufeff" + HEADER, *LINES[3000:]], header="\ufeff" + HEADER)
    assert read(path)["gyro_x"].values.size == ROWS
    rows = stream(path)._rows
    assert rows.reader.marks(rows.path, rows.layout)[-1].row == ROWS


def test_zero_bytes_after_a_loss_of_power_are_told(tmp_path):
    with raises(ReadError, "line 6002", "4096 zero bytes", advises=["tr -d"]):
        read(saved(tmp_path, [*LINES, "\0" * 4096]))
