"""Text files as people and instruments write them: read right, or refused with the line and the way out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gmwm.base.errors import DataError, GmwmWarning, OptionError, ReadError, UnitError
from gmwm.files.formats import text
from gmwm.files.readers import read
from tests.helpers import only, raises, table

UNITS = ("s", *["rad/s"] * 3, *["m/s^2"] * 3)
NAMES = ("time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
HEADER = [name if name == "time" else f"{name} [{unit}]" for name, unit in zip(NAMES, UNITS, strict=True)]
VALUES = np.round(np.random.default_rng(5).normal(size=(40, 6)) * 0.05 + [0, 0, 0, 0, 0, 9.8], 4)


def rows(separator=",", time=lambda k: f"{k / 100:.2f}", end="\n", values=VALUES):
    return "".join(separator.join([time(k), *map(str, row)]) + end for k, row in enumerate(values))


def saved(folder: Path, content: str | bytes, name="static.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


PLAIN = ",".join(HEADER) + "\n"
GOOD = {
    "plain": PLAIN + rows(),
    "no last line feed": (PLAIN + rows())[:-1],
    "semicolon and decimal comma": ";".join(HEADER) + "\n" + rows(";").replace(".", ","),
    "tabs": "\t".join(HEADER) + "\n" + rows("\t"),
    "bars": "|".join(HEADER) + "\n" + rows("|"),
    "runs of blanks": " ".join(HEADER) + "\n   " + rows("    ").replace("\n", "  \n   "),
    "blanks and tabs": " ".join(HEADER) + "\n" + rows(" \t "),
    "blanks under commas": ",".join(HEADER) + "\n" + rows("  "),
    "blank behind the comma": ", ".join(HEADER) + "\n" + rows(", "),
    "comments of three kinds": "# one, two\n% three\n// four\n" + PLAIN + rows(),
    "header in a comment": "# made by a logger, v2\n#" + PLAIN + rows(),
    "header in a percent comment": "%" + PLAIN + rows(),
    "comments between": PLAIN + "# a\n" + rows().replace("\n0.20", "\n# b\n0.20"),
    "comment only far below": PLAIN + rows() + "# stopped\n",
    "blank lines between": PLAIN + "\n" + rows().replace("\n0.20", "\n\n\n0.20") + "\n\n",
    "trailing delimiter": PLAIN.replace("\n", ",\n") + rows(end=",\n"),
    "trailing delimiter in rows": PLAIN + rows(end=",\n"),
    "quoted header": ",".join(f'"{name}"' for name in HEADER) + "\n" + rows(),
    "quoted numbers": PLAIN + "".join(",".join(f'"{c}"' for c in r.split(",")) + "\n" for r in rows().split()),
    "byte order mark": b"\xef\xbb\xbf" + (PLAIN + rows()).encode(),
    "carriage returns": (PLAIN + rows()).replace("\n", "\r\n"),
    "title above": "Static test of unit 7\n\n" + PLAIN + rows(),
    "row of units": ",".join(NAMES) + "\n" + ",".join(UNITS) + "\n" + rows(),
    "row of bracketed units": ",".join(NAMES) + "\n" + ",".join(f"[{u}]" for u in UNITS) + "\n" + rows(),
    "units in a comment": "# gyro in rad/s, accel in m/s^2, time in s\n" + ",".join(NAMES) + "\n" + rows(),
    "units of all columns in a comment": f"# units: {','.join(UNITS)}\n" + ",".join(NAMES) + "\n" + rows(),
    "index column": "," + PLAIN + "".join(f"{k},{r}\n" for k, r in enumerate(rows().split())),
    "text column": "frame," + PLAIN + "".join(f"imu_link,{r}\n" for r in rows().split()),
    "quoted text with a delimiter": "note," + PLAIN + "".join(f'"a, b",{r}\n' for r in rows().split()),
    "scientific": PLAIN + "".join(",".join(f"{float(c):.12E}" for c in r.split(",")) + "\n" for r in rows().split()),
}


def test_a_comment_may_come_later_than_the_lines_that_show_the_form(tmp_path):
    values = np.random.default_rng(6).normal([0, 0, 0, 0, 0, 9.8], 0.05, (4000, 6)).round(6)
    lines = rows(values=values).splitlines(keepends=True)
    path = saved(tmp_path, PLAIN + "".join(lines[:3000]) + "# card full\n" + "".join(lines[3000:]))
    assert len(read(path)) == 4000


@pytest.mark.parametrize("content", GOOD.values(), ids=GOOD.keys())
def test_the_same_numbers_however_they_are_written(tmp_path, content):
    imu = read(saved(tmp_path, content))
    assert imu.axes == NAMES[1:]
    assert table(imu).tolist() == VALUES.tolist()
    assert imu.rate == 100
    assert imu.segments == ((0, 40),)


@pytest.mark.parametrize("name", ["static.csv", "static.txt", "static", "static.parquet"])
def test_content_goes_before_extension(tmp_path, name):
    assert len(read(saved(tmp_path, GOOD["plain"], name))) == 40


@pytest.mark.parametrize("block", [64, 200, 1000])
def test_blocks_of_any_size_give_the_same(tmp_path, monkeypatch, block):
    path = saved(tmp_path, GOOD["comments between"])
    whole = table(read(path))
    monkeypatch.setattr(text, "BLOCK_BYTES", block)
    assert table(read(path)).tolist() == whole.tolist()
    bad = saved(tmp_path, PLAIN + rows() + "0.4,1,2,err,4,5,6\n")
    with raises(ReadError, "line 42", "'gyro_z [rad/s]'", "'err'"):
        read(bad)


def test_euroc_header_is_not_a_comment_and_nanoseconds_are_exact(tmp_path):
    header = (
        "#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],"
        "a_RS_S_x [m s^-2],a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]\n"
    )
    imu = read(saved(tmp_path, header + rows(time=lambda k: str(1_403_636_579_758_555_393 + k * 2_500_000))))
    assert imu.rate == 400
    assert imu.time_base.jitter == 0
    assert table(imu).tolist() == VALUES.tolist()


def test_kalibr_header(tmp_path):
    header = "timestamp,omega_x,omega_y,omega_z,alpha_x,alpha_y,alpha_z\n"
    path = saved(tmp_path, header + rows(time=lambda k: str(10**18 + k * 5_000_000)))
    imu = read(path)
    assert (imu.rate, imu.axes) == (200, NAMES[1:])
    assert table(imu).tolist() == VALUES.tolist()
    assert only(imu.remarks, "file-content:layout").facts["format"] == "Kalibr's imu0.csv"


def test_ros_fields_are_si_and_said_so(tmp_path):
    fields = [f"angular_velocity.{a}" for a in "xyz"] + [f"linear_acceleration.{a}" for a in "xyz"]
    imu = read(saved(tmp_path, ",".join(["time", *fields]) + "\n" + rows()))
    assert table(imu).tolist() == VALUES.tolist()
    for sensor in ("gyro", "accel"):
        assert only(imu.remarks, "unit-named:unit", sensor).facts["source"] == "ros"


def test_integers_first_then_floats(tmp_path):
    lines = "".join(f"{k},{v}\n" for k, v in enumerate([0, 1, 2, 1] * 60 + [0.5, 0.25]))
    imu = read(saved(tmp_path, "time [s],gyro_x [rad/s]\n" + lines))
    assert imu["gyro_x"].values[-1] == 0.25


def test_a_single_column(tmp_path):
    content = "gyro_y [deg/s]\n" + "".join(f"{k % 5}\n" for k in range(20))
    imu = read(saved(tmp_path, content), rate=50)
    np.testing.assert_allclose(imu["gyro_y"].values[:3], np.radians([0, 1, 2]), rtol=1e-15)


def test_latin_1_degrees(tmp_path):
    content = ("time;gyro_x [°/s]\n" + "".join(f"{k / 100};{k % 3}\n" for k in range(20))).encode("latin-1")
    assert read(saved(tmp_path, content))["gyro_x"].values[1] == pytest.approx(np.radians(1), rel=1e-15)


def test_temperature_is_kept(tmp_path):
    content = "time,gyro_x [rad/s],Ts[degC]\n" + "".join(f"{k / 100},{k % 3},{20 + k / 10}\n" for k in range(20))
    assert read(saved(tmp_path, content)).temperature[-1] == 21.9


NAMELESS = "".join(line.split(",", 1)[1] for line in rows().splitlines(keepends=True))
NINE = "0.4,1,2,3,4,5,6,7,8\n"
BAD = {
    "short row": (PLAIN + rows() + "0.4,1,2\n" + rows(), "row-length", ["line 42", "3 values", "expected 7"], []),
    "cut off": ((PLAIN + rows())[:-25], "row-length", ["line 41"], ["bad_lines='skip'"]),
    "long row": (PLAIN + rows() + NINE, "row-length", ["line 42", "9 values", "expected 7"], []),
    "text": (PLAIN + rows() + "0.4,1,x,3,4,5,6\n", "row-invalid", ["line 42", "'gyro_y", "'x'"], ["columns="]),
    "all constant": (PLAIN + rows(values=VALUES * 0), None, ["gyro_x", "0 "], []),
    "seven samples": (PLAIN + rows(values=VALUES[:7]), None, ["7 samples", "at least 8"], []),
    "empty": ("", "empty", [], []),
    "header only": (PLAIN, "no-numbers", [], []),
    "comments only": ("# 1\n# 2\n", "empty", [], []),
    "prose": ("Dear all\n\nbye\n", "no-numbers", ["'bye'"], []),
    "binary": (bytes(range(256)) * 9, "unknown-format", ["static.csv", "00 01 02"], ["format="]),
    "seven nameless": (rows(), "columns-unnamed", ["0.00"], ["columns=['time', 'gyro_x'"]),
    "six nameless": (NAMELESS, "columns-unnamed", ["6 columns"], ["columns=['gyro_x'"]),
    "header too long": (PLAIN.replace("\n", ",q\n") + rows(), "header-mismatch", ["line 1", "8 columns", "line 2"], []),
    "no axis": ("a,b\n" + "1,2\n" * 9, "no-inertial-data", ["a, b"], ["columns="]),
    "no time": (PLAIN[5:] + NAMELESS, "no-time", [], ["rate="]),
    "dates": (PLAIN + rows(time=lambda k: f"2026-11-21 10:00:{k}"), "dates-unreadable", ["2026-11-21 10"], ["None"]),
    "two gyroscopes": ("time,a_gyro_x,b_gyro_x\n0,1,2\n1,2,3\n", "columns-ambiguous", ["gyro_x"], ["'gyro_x': 1"]),
    "no gyro unit": ("time,gx\n" + "".join(f"0.{k},{k % 3}\n" for k in range(10, 30)), "unit-unnamed", [], ["units="]),
    "unclear time": (PLAIN + rows(time=lambda k: str(k)), "unit-unknown", ["1000 Hz in ms"], ["units="]),
    "still time": (PLAIN + rows(time=lambda k: "1.5"), "time-order", [], ["columns=", "rate="]),
    "half units": ("gx [dps],gy,t_ms\n" + "".join(f"{k},1,{k}\n" for k in range(9)), "unit-unnamed", ["gyro_y"], []),
}  # fmt: skip


@pytest.mark.parametrize(("content", "code", "facts", "advises"), BAD.values(), ids=BAD.keys())
def test_what_cannot_be_read_says_why_and_the_way_out(tmp_path, content, code, facts, advises):
    kind = DataError if code is None else UnitError if code.startswith("unit") else ReadError
    with raises(kind, *facts, code=code, advises=advises):
        read(saved(tmp_path, content))


@pytest.mark.parametrize("delimiter", [",", " "])
def test_a_long_row_is_found_whatever_columns_are_read(tmp_path, delimiter):
    content = (PLAIN + rows() + NINE + rows()).replace(",", delimiter)
    path, options = saved(tmp_path, content), {"columns": {"time": None, "gyro_x": 2}, "rate": 100.0}
    with raises(ReadError, "line 42", "9 values, expected 7", code="row-length"):
        read(path, **options, units={"gyro": "rad/s"})
    with pytest.warns(GmwmWarning, match="1 lost sample"):
        imu = read(path, **options, units={"gyro": "rad/s"}, bad_lines="skip")
    assert imu["gyro_x"].values.tolist() == 2 * VALUES[:, 1].tolist()


def test_paths(tmp_path):
    with raises(ReadError, code="is-directory"):
        read(tmp_path)
    with raises(ReadError, argument="path"):
        read(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("argument", "value", "facts"),
    [
        ("columns", {"gyro_x": "nix"}, ["'nix'", "gyro_x", "time, gyro_x"]),
        ("columns", {"gyro_x": 7}, ["7", "gyro_x", "0 to 6"]),
        ("columns", {"gyrox": 1}, ["gyrox"]),
        ("columns", ["time", "gyro_x"], ["2 columns", "7"]),
        ("columns", {"gyro_x": 1, "gyro_y": 1}, ["gyro_x and gyro_y"]),
        ("columns", "gyro_x", ["'gyro_x'"]),
        ("columns", ["gyro_x"] * 7, ["gyro_x once"]),
        ("units", {"mag": "T"}, ["'mag'"]),
        ("units", "furlong", ["'furlong'"]),
        ("units", {"gyro": 3}, ["got 3"]),
        ("columns", 5, ["got 5"]),
        ("gaps", "glue", ["'glue'"]),
        ("format", "bag", ["parquet", "'bag'"]),
        ("rate", -1, ["-1"]),
    ],
)
def test_wrong_options_say_what_may_be(tmp_path, argument, value, facts):
    with raises(OptionError, *facts, argument=argument):
        read(saved(tmp_path, GOOD["plain"]), **{argument: value})


def test_columns_by_name_index_and_order(tmp_path):
    named = saved(tmp_path, GOOD["plain"])
    assert read(named, columns={"gyro_x": 3})["gyro_x"].values.tolist() == VALUES[:, 2].tolist()
    assert read(named, columns={"gyro_x": "gyro_y [rad/s]"})["gyro_x"].values.tolist() == VALUES[:, 1].tolist()
    assert read(named, columns={"gyro_z": None}).axes == ("gyro_x", "gyro_y", "accel_x", "accel_y", "accel_z")
    assert not read(named, rate=7, columns={"time": None}).time_base.stamped
    nameless = saved(tmp_path, rows())
    imu = read(nameless, columns=["time", "gyro_z", None, "", None, None, None], units={"gyro": "deg/s"})
    assert imu.axes == ("gyro_z",)
    np.testing.assert_allclose(imu["gyro_z"].values, np.radians(VALUES[:, 0]), rtol=1e-15)
    assert read(nameless, columns={"accel_x": 4, "time": 0}, units={"accel": "m/s2"}).rate == 100


@pytest.mark.parametrize(
    ("form", "lost", "told"),
    [("%.6f", 2, True), ("%.6f", 7, True), ("%.9e", 2, True), ("%.9e", 6, True), ("%.6f", 1, False), ("%d", 1, False)],
)
def test_a_number_that_was_cut_off_is_an_error_and_a_missing_line_end_is_none(tmp_path, form, lost, told):
    numbers = np.random.default_rng(3).normal(9.8, 0.1, (200, 2)) * (1000 if form == "%d" else 1)
    text = "gyro_x [rad/s],accel_z [m/s^2]\n" + "".join(f"{a:.3f},{form % b}\n" for a, b in numbers)
    path = saved(tmp_path, text[:-lost])
    if told:
        with raises(ReadError, code="cut-off", advises=["bad_lines='skip'"]):
            read(path, rate=100.0)
    else:
        assert len(read(path, rate=100.0)["accel_z"]) == 200
