"""Dates and times as text are the numbers that they stand for, or are refused with the way out."""

from __future__ import annotations

import gzip
import warnings
import zipfile

import numpy as np
import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm.base.errors import OptionError, ReadError, UnitError
from gmwm.cli.output import one_line
from gmwm.files.clock.text_stamps import Midnights, form_remark, is_stamp, times_of
from gmwm.files.formats import text
from gmwm.files.readers import interpretation, read, stream
from gmwm.files.readers.growing_files import Lines, growing_stream
from tests.helpers import each, only, raises
from tests.readers.test_parts import same as same_parts
from tests.readers.test_stream import columns, stamps, written
from tests.readers.test_stream import same as same_chunks

FIXED = settings(derandomize=True, max_examples=60, deadline=None)
BEGIN = int(np.datetime64("2024-05-01T23:59:55", "ns").view(np.int64))
STEP = 10_000_000
VALUES = np.round(np.random.default_rng(7).normal(size=(1200, 2)) * 0.05, 5)


def iso(ns, digits=9, between="T", tail="", point="."):
    """A stamp as programs write it, with so many digits of a second."""
    said = str(np.datetime64(int(ns), "ns"))
    return said[:10] + between + said[11:19] + (point + said[20 : 20 + digits] if digits else "") + tail


FORMS = {
    "T": iso,
    "Z": lambda ns: iso(ns, tail="Z"),
    "microseconds": lambda ns: iso(ns, 6),
    "blank": lambda ns: iso(ns, 6, " "),
    "blank and milliseconds": lambda ns: iso(ns, 3, " "),
    "lower case": lambda ns: iso(ns, 6, "t", "z"),
    "decimal comma in quotes": lambda ns: f'"{iso(ns, 6, " ", point=",")}"',
    "quotes": lambda ns: f'"{iso(ns, 6, " ")}"',
    "slashes": lambda ns: iso(ns, 6, " ").replace("-", "/"),
    "points": lambda ns: iso(ns, 6, " ").replace("-", "."),
    "basic": lambda ns: iso(ns, 6, tail="Z").replace("-", "").replace(":", ""),
    "UTC": lambda ns: iso(ns, 6, " ", " UTC"),
    "pandas": lambda ns: iso(ns, 6, " ", "+00:00"),
    "Go": lambda ns: iso(ns, 9, " ", " +0000 UTC"),
    "Java": lambda ns: iso(ns, 9, tail="+00:00[Etc/UTC]"),
    "offset": lambda ns: iso(ns + 7200 * 10**9, 6, tail="+02:00"),
    "negative offset": lambda ns: iso(ns - 12_600 * 10**9, 6, tail="-03:30"),
    "short offset": lambda ns: iso(ns + 7200 * 10**9, 6, " ", "+02"),
    "twelve digits": lambda ns: iso(ns, 9, tail="123Z"),
    "no zeros at the end": lambda ns: iso(ns).rstrip("0").rstrip("."),
    "Python": lambda ns: iso(ns, 6) if ns % 10**9 else iso(ns, 0),
    "offset that changes": lambda ns: (
        iso(ns + 7200 * 10**9, 6, tail="+02:00") if ns < BEGIN + 6 * 10**9 else iso(ns + 3600 * 10**9, 6, tail="+01:00")
    ),
}


def saved(folder, cells, name="time"):
    """A file of two axes whose times are these cells."""
    path = folder / "a.csv"
    rows = "".join(f"{s},{a!r},{b!r}\n" for s, (a, b) in zip(cells, VALUES.tolist(), strict=False))
    path.write_text(f"{name},gyro_x [rad/s],gyro_y [rad/s]\n{rows}")
    return path


def clock(kind):
    """Stamps (ns) of 100 Hz, in whole milliseconds."""
    k = np.arange(VALUES.shape[0], dtype=np.int64)
    rng = np.random.default_rng(3)
    if kind == "gaps":
        k = k + 9 * (k > 300) + 86_400 * 100 * 3 * (k > 700)
    ns = BEGIN + k * STEP
    if kind == "jitter":
        ns = ns + rng.integers(-2, 3, size=k.size) * 10**6
    if kind == "summer time ends":
        ns = np.where(k < 500, ns, ns - 3600 * 10**9)
    if kind == "summer time begins":
        ns = np.where(k < 500, ns, ns + 3600 * 10**9)
    if kind == "repeated":
        ns[400] = ns[399]
    if kind == "bursts":
        ns = BEGIN + k // 10 * 10 * STEP
    return ns


def known_of(path, **options):
    """What is known of a recording, without its remarks."""
    imu = read(path, **options)
    signal = imu["gyro_x"]
    return imu.rate, imu.segments, signal.starts, imu.time_base, [imu[a].values.tolist() for a in imu]


KINDS = ("regular", "jitter", "summer time ends", "summer time begins", "repeated", "bursts")


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.TimeBaseWarning")
@pytest.mark.parametrize(
    ("form", "kind"),
    [(form, "gaps") for form in FORMS] + [(form, kind) for form in ("Z", "offset that changes") for kind in KINDS],
)
def test_stamps_say_what_whole_nanoseconds_say(tmp_path, monkeypatch, form, kind):
    ns = clock(kind)
    expected = known_of(saved(tmp_path, ns, "time [ns]"))
    path = saved(tmp_path, map(FORMS[form], ns.tolist()))
    assert known_of(path) == expected
    monkeypatch.setattr(text, "BLOCK_BYTES", 5000)
    assert known_of(path) == expected


@pytest.mark.slow
@FIXED
@given(
    st.lists(st.integers(-8 * 10**18, 7 * 10**18), min_size=1, max_size=30),
    st.integers(1, 9),
    st.sampled_from(["", "Z", "+00:00", "-0930", "+14"]),
)
def test_every_time_of_the_calendar(times, digits, zone):
    ns = np.array(times, dtype=np.int64)
    ns -= ns % 10 ** (9 - digits)
    hours = {"-0930": -9.5, "+14": 14}.get(zone, 0)
    cells = pl.Series([iso(t, digits, tail=zone) for t in ns.tolist()])
    found = times_of(cells, cells[0]).view(np.int64)
    assert found.tolist() == (ns - int(hours * 3600) * 10**9).tolist()


@FIXED
@given(st.lists(st.integers(0, 86_400 * 1000 - 1), min_size=1, max_size=30), st.booleans())
def test_every_time_of_day(times, zeros):
    ns = np.array(times, dtype=np.int64) * 10**6
    cells = [iso(t, 3)[11:] for t in ns.tolist()]
    cells = [cell if zeros else cell.lstrip("0").rjust(11, "0") for cell in cells]
    assert times_of(pl.Series(cells), cells[0]).view(np.int64).tolist() == ns.tolist()


@each(
    "cell",
    [
        "2024-13-01T12:00:00", "2024-02-30T12:00:00", "2023-02-29T12:00:00", "2024-05-00T12:00:00",
        "2024-05-01T24:00:00", "2024-05-01T12:60:00", "2024-05-01T12:00:61", "0001-01-01T00:00:00",
        "9999-12-31T23:59:59", "2024-05-112:00:00.5", "2024-05-01T12:00:00.", "2024-05-01", "12:00:00", "NaT", "now",
        "2024-05-01T12:00:00Z", "2024-05-01T12:00:00+02:0", "2024-05-01T12:0", "２０２４-05-01T12:00:00", "x",
        "1714564800.5", "2024-05-01 12:00:00 5",
    ],
)  # fmt: skip
def test_what_is_no_time_is_not_taken_for_one(cell):
    good = "2024-05-01T12:00:00"
    for cells in ([good, cell], [cell, good], [cell], [good, "2024-05-01T12:00:00.5", cell]):
        found = times_of(pl.Series(cells), good)
        assert np.isnat(found).tolist() == [c == cell for c in cells]


def test_a_leap_second_is_the_next_second():
    cells = ["2016-12-31T23:59:59", "2016-12-31T23:59:60", "2017-01-01T00:00:00"]
    found = times_of(pl.Series(cells), cells[0])
    assert (np.diff(found) // np.timedelta64(1, "s")).tolist() == [1, 0]
    assert times_of(pl.Series([*cells, "2017-01-01T00:00:00.5"]), cells[0])[:3].tolist() == found.tolist()


@each(
    ("cell", "yes"),
    [
        ("2024-05-01T12:00:00", True), ("2024-05-01 12:00:00.5 +02:00", True), ("0:00:01", True), ("125:00:01,5", True),
        ("2024-05-01", False), ("2024-05-01 12:00", False), ("12:00", False), ("05/01/2024 12:00:00", False),
        ("1.5.2024 12:00:00", False), ("2024-05-01 03:00:00 PM", False), ("20240501120000", False), ("1.5", False),
        ("20240501", False), ("", False), ("Wed May 1 12:00:00 2024", False), ("12:00:00:05", False),
    ],
)  # fmt: skip
def test_what_a_stamp_is(cell, yes):
    assert is_stamp(cell) is yes


@pytest.mark.parametrize(
    ("cell", "facts"),
    [
        ("2024-05-01T12:00:00Z", {"form": "utc"}),
        ("2024-05-01 12:00:00 UTC", {"form": "utc"}),
        ("2024-05-01T12:00:00+02:00", {"form": "offset", "offset": "+02:00"}),
        ("2024-05-01T12:00:00", {"form": "local"}),
        ("12:00:00", {"form": "clock"}),
    ],
)
def test_the_remarks_say_how_it_was_understood(tmp_path, cell, facts):
    facts = {"case": "read", **facts}
    assert form_remark(cell).facts == facts
    cells = [cell.replace("12:00:00", f"12:00:{k // 10:02d}.{k % 10}") for k in range(60)]
    remark = only(read(saved(tmp_path, cells)).remarks, "time-read:read")
    assert remark.facts == facts
    inspection = gmwm.inspect(read(saved(tmp_path, cells)))
    assert remark in inspection.remarks
    assert remark.text() in one_line(inspection.summary())


@pytest.mark.slow
def test_times_of_day_go_on_after_midnight(tmp_path):
    for kind in ("regular", "jitter"):
        ns = clock(kind)
        found, numbers = read(saved(tmp_path, [iso(t, 3)[11:] for t in ns])), read(saved(tmp_path, ns, "time [ns]"))
        assert (found.rate, found.segments) == (numbers.rate, numbers.segments)
        assert found["gyro_x"].starts == (86_395.0 + (ns[0] - BEGIN) / 1e9,)
        assert found.time_base.jitter == numbers.time_base.jitter


def test_times_of_day_over_days_and_blocks():
    ns = BEGIN % (86_400 * 10**9) + np.arange(0, 6 * 86_400, 3600) * 10**9
    followed, parts = Midnights(), np.array_split(ns % (86_400 * 10**9), [5, 6, 30, 31, 77])
    joined = np.concatenate([followed.continue_days(part) for part in parts])
    assert joined.tolist() == ns.tolist()


def test_times_of_day_that_are_out_of_order_or_set_back(tmp_path):
    ms = np.array([86_399_990, 0, 86_399_995, 10, 20])
    assert Midnights().continue_days(ms * 10**6).tolist() == ((ms + 86_400_000 * (ms < 1000)) * 10**6).tolist()
    back = np.array([7200, 7201, 3602, 3603]) * 10**9
    assert Midnights().continue_days(back).tolist() == back.tolist()
    elapsed = np.array([86_399, 86_400, 86_401, 200_000]) * 10**9
    assert Midnights().continue_days(elapsed).tolist() == elapsed.tolist()


FIRST = "2024-05-01T12:00:00.000Z"
BAD = {
    "no seconds": (lambda s: s[:16], "dates-unreadable", ["a.csv", "2024-05-01T12:00"], ["rate="]),
    "minutes": (lambda s: s[14:23], "dates-unreadable", ["a.csv", "('59:55"], []),
    "date alone": (lambda s: s[:10], "dates-without-times", [], ["columns="]),
    "no month": (lambda s: s.replace("-05-", "-13-"), "row-invalid", ["line 2", "'2024-13-"], []),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_not_read_says_why_and_the_way_out(tmp_path, kind):
    form, code, facts, advises = BAD[kind]
    cells = [form(iso(BEGIN + k * STEP, 3, tail="Z")) for k in range(60)]
    with raises(ReadError, *facts, code=code, advises=advises):
        read(saved(tmp_path, cells))
    assert read(saved(tmp_path, cells), columns={"time": None}, rate=50).rate == 50


@pytest.mark.parametrize(
    "cell", ["NaT", "12:00:05.000", "2024-05-02T00:00:00.000", "2024-02-30T00:00:00.000Z", "1714564800"]
)
@pytest.mark.parametrize("block", [300, 1 << 20])
def test_a_bad_stamp_is_told_with_its_line(tmp_path, monkeypatch, block, cell):
    monkeypatch.setattr(text, "BLOCK_BYTES", block)
    cells = [iso(BEGIN + k * STEP, 3, tail="Z") for k in range(90)]
    cells[40] = cell
    with raises(ReadError, "line 42", "'time'", repr(cell), code="row-invalid"):
        read(saved(tmp_path, cells))


def test_lines_are_counted_over_blank_lines_and_comments(tmp_path):
    cells = [iso(BEGIN + k * STEP, 3) for k in range(40)]
    path = saved(tmp_path, cells)
    good = path.read_text()
    path.write_text("# made today\n" + good.replace(cells[9], f"# a\n\n{cells[9]}") + "NaT,0.1,0.2\n")
    with raises(ReadError, "line 45", "'time'", "'NaT'"):
        read(path)


def test_a_stamp_that_was_cut_off(tmp_path):
    lines = "".join(f"{k % 7},{iso(BEGIN + k * STEP, 3, tail='Z')}\n" for k in range(40))
    path = tmp_path / "a.csv"
    for cut in (1, 2, 9):
        path.write_text(("gyro_x [rad/s],time\n" + lines)[:-cut])
        if cut == 1:
            assert only(read(path).remarks, "last-line:read")
            continue
        with raises(ReadError, "line 41", code="row-invalid", advises=["bad_lines='skip'"]):
            read(path)
    path.write_text(saved(tmp_path, [iso(BEGIN + k * STEP, 3) for k in range(40)]).read_text()[:-30])
    with raises(ReadError, "line 41", "1 values", "expected 3"):
        read(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["time [s]", "timestamp [ISO8601]", "Timestamp (UTC)", "t_ms", "datetime", "Date", ""])
def test_the_name_of_the_column_does_not_matter(tmp_path, name):
    ns = clock("regular")
    expected = known_of(saved(tmp_path, ns, "time [ns]"))
    assert known_of(saved(tmp_path, map(iso, ns), name)) == expected
    choice = {"time": 0}
    assert known_of(saved(tmp_path, map(iso, ns), name), columns=choice) == expected


def test_without_names(tmp_path):
    ns = clock("regular")
    path = saved(tmp_path, map(iso, ns))
    path.write_text(path.read_text().partition("\n")[2])
    with raises(ReadError, "3 columns", "2024-05-01T23:59:55"):
        read(path)
    imu = read(path, columns=["time", "gyro_x", "gyro_y"], units={"gyro": "rad/s"})
    assert (imu.rate, imu.time_base.start) == (100, BEGIN / 1e9)


def test_a_named_time_goes_before_dates_that_nobody_named(tmp_path):
    rows = "".join(f"{iso(BEGIN + k // 50 * 10**9, 0)},{k / 100},{k % 7}\n" for k in range(80))
    path = tmp_path / "a.csv"
    path.write_text("saved,time [s],gyro_x [rad/s]\n" + rows)
    assert read(path).time_base.start == 0
    path.write_text("saved,note,gyro_x [rad/s]\n" + rows.replace(iso(BEGIN + 10**9, 0), iso(BEGIN, 0)))
    assert not read(path, rate=100).time_base.stamped  # one date in all rows is no clock


def test_a_date_and_a_time_in_two_columns(tmp_path):
    rows = "".join(f"{iso(t)[:10]} {iso(t, 3)[11:]} {k % 7}\n" for k, t in enumerate(clock("regular").tolist()))
    path = tmp_path / "a.txt"
    path.write_text("date time gyro_x_[rad/s]\n" + rows)
    imu = read(path)
    assert (imu.rate, imu.segments, imu.time_base.start) == (100, ((0, 1200),), 86_395)
    assert only(imu.remarks, "left-out:names").facts == {"case": "names", "kind": "columns", "names": ("date",)}
    with raises(ReadError, code="dates-without-times", advises=["columns="]):
        read(path, columns={"time": "date"})


@pytest.mark.parametrize("separator", [";", "\t", "|"])
def test_with_decimal_commas_in_all_columns(tmp_path, separator):
    rows = "".join(
        separator.join([iso(BEGIN + k * STEP, 3, " ", point=","), f"0,{k % 7}5"]) + "\r\n" for k in range(60)
    )
    path = tmp_path / "a.csv"
    path.write_text(f"time{separator}gyro_x [deg/s]\n" + rows)
    imu = read(path)
    assert (imu.rate, imu.time_base.start) == (100, BEGIN / 1e9)
    assert np.degrees(imu["gyro_x"].values[1]) == pytest.approx(0.15, rel=1e-12)


def test_runs_of_blanks_with_a_t(tmp_path):
    rows = "".join(f"  {iso(BEGIN + k * STEP, 3)}   {k % 7}   \n" for k in range(60))
    path = tmp_path / "a.txt"
    path.write_text("time  gyro_x_[rad/s]\n" + rows)
    assert (read(path).rate, read(path).time_base.start) == (100, BEGIN / 1e9)


@pytest.mark.slow
def test_units_and_rates_that_are_declared(tmp_path):
    path = saved(tmp_path, map(iso, clock("regular")))
    with raises(UnitError, "dates and times", "'s'", argument="units", advises=["units="]):
        read(path, units={"time": "s"})
    assert read(path, rate=100).rate == 100
    with raises(ReadError, "50 Hz", "100 Hz", argument="rate"):
        read(path, rate=50)


def test_dates_are_no_axis(tmp_path):
    path = saved(tmp_path, map(iso, clock("regular")))
    with raises(ReadError, "gyro_z", "'time'"):
        read(path, columns={"gyro_z": "time"}, rate=100)
    with raises(OptionError, "time", "gyro_z", argument="columns"):
        read(path, columns={"gyro_z": 0, "time": 0})


@pytest.mark.slow
def test_packed_and_in_archives(tmp_path):
    path = saved(tmp_path, map(iso, clock("gaps")))
    expected = known_of(path)
    packed, archive = tmp_path / "a.csv.gz", tmp_path / "a.zip"
    packed.write_bytes(gzip.compress(path.read_bytes()))
    with zipfile.ZipFile(archive, "w") as file:
        file.write(path, "a.csv")
    assert known_of(packed) == known_of(archive) == expected


@pytest.mark.filterwarnings("ignore::gmwm.errors.TimeBaseWarning")
def test_whole_seconds_are_rounded_stamps_as_any(tmp_path):
    ns = clock("regular")
    found = known_of(saved(tmp_path, [iso(t, 0) for t in ns.tolist()]))
    assert found[3].duplicates == 1188
    assert found == known_of(saved(tmp_path, ns // 10**9 * 10**9, "time [ns]"))


def part_files(path, ns):
    """Table of six axes with these stamps, as text."""
    table = {name: np.round(v, 6) for name, v in columns().items()}
    return written(path, {"time": ns} | table)


AS_TEXT = {
    "dates": lambda ns: iso(ns, 6, tail="Z"),
    "zeros left out": lambda ns: iso(ns).rstrip("0").rstrip("."),
    "times of day": lambda ns: iso(ns, 6)[11:],
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "kind"),
    [("dates", kind) for kind in ("even", "gaps", "one lost", "jitter", "late", "bursts")]
    + [("zeros left out", "bursts"), ("times of day", "gaps")],
)
def test_in_chunks_and_parts(tmp_path, monkeypatch, form, kind):
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 3000)
    monkeypatch.setattr(text, "BLOCK_BYTES", 60_000)
    ns = BEGIN + np.round(stamps(kind, np.random.default_rng(3)) * 1e6).astype(np.int64) * 1000
    path = part_files(tmp_path / "a.csv", [AS_TEXT[form](t) for t in ns.tolist()])
    options = {"units": {"gyro": "deg/s", "accel": "g"}}
    imu, _ = same_chunks(path, **options)
    assert len(imu.segments) == {"gaps": 8, "one lost": 2, "jitter": 2, "bursts": 2}.get(kind, 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        source = stream(path, chunk=777, **options)
    divided = same_parts(source, 3)
    assert len(divided) == (1 if form == "times of day" else 3)


@pytest.mark.slow
@pytest.mark.parametrize("form", AS_TEXT)
def test_a_text_that_grows(tmp_path, form):
    path = saved(tmp_path, [AS_TEXT[form](t) for t in clock("gaps").tolist()])
    imu, data = read(path), path.read_bytes()
    parts = [data[k : k + 999] for k in range(0, len(data), 999)]
    source = growing_stream(Lines(iter([*parts, None]).__next__, lambda: True), path)
    found = list(source)
    assert [p.first for k, p in enumerate(found) if k == 0 or p.segment != found[k - 1].segment] == [
        first for first, _ in imu.segments
    ]
    assert np.concatenate([chunk["gyro_y"] for chunk in found]).tolist() == imu["gyro_y"].values.tolist()
    assert source.time_base.start == imu.time_base.start


@pytest.mark.parametrize("head", ["time gyro_x_[rad/s]", "# time gyro_x_[rad/s]"])
def test_a_name_for_a_date_and_a_time_parted_by_a_blank(tmp_path, head):
    ns = clock("regular").tolist()
    path = tmp_path / "a.txt"
    path.write_text(head + "\n" + "".join(f"{iso(t, 3, ' ')} {k % 7}\n" for k, t in enumerate(ns)))
    imu = read(path)
    assert (imu.rate, imu.segments, imu.time_base.start) == (100, ((0, 1200),), 86_395)
    assert imu["gyro_x"].values[:8].tolist() == [0, 1, 2, 3, 4, 5, 6, 0]


def test_a_comma_before_the_fraction_that_parts_columns_too(tmp_path):
    path = saved(tmp_path, [iso(t, 3, " ", point=",") for t in clock("regular").tolist()])
    with raises(ReadError, "line 2", "55,000", advises=["quotes"]):
        read(path)


def test_in_parquet_as_text_and_as_dates(tmp_path):
    ns = clock("gaps")
    expected = known_of(saved(tmp_path, map(iso, ns)))
    axes = {f"gyro_{axis} [rad/s]": VALUES[:, k] for k, axis in enumerate("xy")}
    path = tmp_path / "a.parquet"
    cells = [iso(t, 9, " ", "Z") for t in ns.tolist()]
    for column in (pl.Series(cells), pl.Series(ns).cast(pl.Datetime("ns"))):
        pl.DataFrame({"time [s]": column, **axes}).write_parquet(path)
        assert known_of(path) == expected
    pl.DataFrame({"time": [*cells[:700], "NaT", *cells[701:]], **axes}).write_parquet(path)
    with raises(ReadError, "'time'", "'NaT'", "row 701"):
        read(path)
    pl.DataFrame({"time": [cell[11:23] for cell in cells], **axes}).write_parquet(path)
    with raises(ReadError, "'time'", "String", code="column-not-numbers"):
        read(path)


@pytest.mark.parametrize("name", ["dt", "time_step [s]", "sampling_period", "deltaTime_us"])
def test_times_between_rows_are_added_up(tmp_path, name):
    steps = np.where(np.arange(1200) == 700, 0.03, 0.01) * (1_000_000 if name.endswith("us") else 1)
    steps += 0.02 * steps * np.random.default_rng(3).choice((-1, 1), size=1200)  # jitter of 2 %
    steps[0] = 0
    path = saved(tmp_path, [f"{step:.7g}" for step in steps], name=name)
    imu, chunks = read(path), list(stream(path, chunk=100))
    assert imu.rate == pytest.approx(100, rel=1e-3)
    assert [round(seconds * 100) for _, seconds in imu.time_base.gaps] == [3]
    assert np.array_equal(np.concatenate([chunk.values["gyro_x"] for chunk in chunks]), imu["gyro_x"].values)
    assert {"case": "read", "form": "intervals", "columns": (name,)} in [remark.facts for remark in imu.remarks]


def test_other_numbers_are_no_times_between_rows(tmp_path):
    clock = [f"{0.01 * k:.2f}" for k in range(1200)]
    assert read(saved(tmp_path, clock, name="time_step")).rate == 100
    wild = [f"{step:.4f}" for step in np.random.default_rng(1).exponential(0.01, 1200)]
    for steps in (wild, ["-0.01"] * 1200, ["on"] * 1200):
        with raises(ReadError, "no time column"):
            read(saved(tmp_path, steps, name="dt"))
    assert read(saved(tmp_path, ["0.01"] * 1200, name="dt"), rate=50.0).rate == 50  # the rate of the user counts


def test_a_stated_unit_with_a_rate_that_no_sensor_has_is_an_error(tmp_path):
    path = saved(tmp_path, [f"{1.4e9 + 0.005 * k:.3f}" for k in range(1200)], name="timestamp [ns]")
    with raises(UnitError, "200 Hz in s", advises=["time"]):
        read(path)
    assert read(path, units={"time": "s"}).rate == 200
