"""Position series: files written here as the published descriptions of their formats state."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import ReadError, UnitError
from tests.helpers import raises

DAYS = np.datetime64("2015-06-01") + np.flatnonzero(np.random.default_rng(1).random(900) > 0.1)
MJD = (DAYS - np.datetime64("1858-11-17")).astype(int)
EAST, NORTH, UP = np.round(np.random.default_rng(2).normal(size=(3, DAYS.size)), 2)  # mm
MONTHS = ["JAN", "FEB", "MAR", "APR", "MAY", "JUN", "JUL", "AUG", "SEP", "OCT", "NOV", "DEC"]


def tenv3(head=True):
    rows = ["site YYMMMDD yyyy.yyyy __MJD week d reflon _e0(m) __east(m) ____n0(m) _north(m) u0(m) ____up(m)"] * head
    for day, mjd, e, n, u in zip(map(str, DAYS), MJD, EAST, NORTH, UP, strict=True):
        stamp = day[2:4] + MONTHS[int(day[5:7]) - 1] + day[8:]
        rows.append(
            f"COVE {stamp} {2000 + (mjd - 51544) / 365.25:.4f} {mjd} {(mjd - 44244) // 7} {(mjd - 44244) % 7} -112.8  "
            f"-3815 {e / 1e3 - 0.4:.6f}   4276712 {n / 1e3 + 0.8:.6f}  1687  {u / 1e3 + 0.3:.6f}  0.1800 0.000902"
        )
    return rows


def pos():
    rows = [
        "PBO Station Position Time Series. Reference Frame : IGS14",
        "4-character ID: P087",
        "*YYYYMMDD HHMMSS JJJJJ",
    ]
    for day, mjd, e, n, u in zip(map(str, DAYS), MJD, EAST, NORTH, UP, strict=True):
        rows.append(
            f" {day.replace('-', '')} 120000 {mjd + 0.5:.4f} -2155505.10836 -4365309.66694  4110324.80217  0.00284  "
            f"0.00521  0.00468  0.820 -0.777 -0.863   40.3632055 243.7207346 2358.26 {n / 1e3:.5f} {e / 1e3:.5f} "
            f"{u / 1e3:.5f} 0.00284 0.00221 0.00468 0.011 -0.077 -0.063 final"
        )
    return rows


def table(head, first, scale=1.0, sep=","):
    return [head] + [
        sep.join(map(str, row)) for row in zip(first, EAST * scale, NORTH * scale, UP * scale, strict=True)
    ]


def calendar_years():
    year = DAYS.astype("M8[Y]")
    begin, end = year.astype("M8[D]"), (year + np.timedelta64(1, "Y")).astype("M8[D]")
    share = ((DAYS - begin).astype(int) + 0.5) / (end - begin).astype(int)
    return [f"{value:.4f}" for value in year.astype(int) + 1970 + share]


FILES = {
    "tenv3": (tenv3(), {}),
    "tenv3 without a head": (tenv3(head=False), {}),
    ".pos": (pos(), {}),
    "dates": (table("date,east (mm),north (mm),up (mm)", DAYS), {}),
    "dates with times": (table("time,dE[mm],dN[mm],dU[mm]", np.char.add(DAYS.astype(str), " 12:00:00")), {}),
    "decimal years": (table("# year e(m) n(m) u(m)", calendar_years(), 1e-3, sep=" "), {}),
    "modified Julian days": (table("mjd;e;n;u", MJD, sep=";"), {"units": {"position": "mm"}}),
    "without a head": (
        table("", MJD, sep=" ")[1:], {"columns": ["time", "east", "north", "up"], "units": {"position": "mm"}},
    ),
    "other names": (
        table("when,a,b,c", DAYS), {"columns": {"up": "c", "north": 2, "east": "a"}, "units": {"position": "mm"}},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_a_series_is_read_in_metres_with_its_gaps(tmp_path, name):
    lines, options = FILES[name]
    path = tmp_path / "series.txt"
    path.write_text("\n".join(lines) + "\n")
    recording = gmwm.read(path, **options)
    assert recording.axes == ("east", "north", "up")
    for axis, values in zip(recording.axes, (EAST, NORTH, UP), strict=True):
        signal = recording[axis]
        assert signal.unit == "m"
        np.testing.assert_allclose(np.diff(signal.values), np.diff(values) / 1e3, atol=2e-9)
        days = (signal.times() - signal.times()[0]) / 86_400
        np.testing.assert_allclose(days, (DAYS - DAYS[0]).astype(int), atol=1e-6)
        assert abs(signal.start / 86_400 - DAYS[0].astype(int)) < 1


@pytest.mark.parametrize("decimals", [3, 4])
def test_psmsl_is_monthly_with_missing_months(tmp_path, decimals):
    months = np.arange(240)
    level = 7000 + np.random.default_rng(3).integers(-90, 90, months.size)
    level[[7, 100, 101]] = -99999
    path = tmp_path / "1.rlrdata"
    path.write_text("".join(f" {1955 + (k + 0.5) / 12:.{decimals}f};{level[k]:6d}; 0;000\n" for k in months))
    signal = gmwm.read(path)["level"]
    assert (len(signal), len(signal.segments)) == (237, 3)
    np.testing.assert_allclose(signal.values, level[level > 0] / 1e3)
    assert signal.rate == pytest.approx(12 / (365.25 * 86_400))


@pytest.mark.parametrize(
    ("line", "error"),
    [("2016-02-30,1,1,1", "line 5"), ("2015-06-01,1,1,1", "is repeated"), ("2018-01-01,1,one,1", "line 5")],
)
def test_a_wrong_row_is_named(tmp_path, line, error):
    lines = FILES["dates"][0]
    (tmp_path / "series.csv").write_text("\n".join([*lines[:4], line, *lines[4:]]))
    with raises(ReadError, error):
        gmwm.read(tmp_path / "series.csv")


def test_a_unit_of_a_position_is_a_length(tmp_path):
    with raises(UnitError, "m, cm, mm"):
        gmwm.read(tmp_path / "x.csv", units={"position": "g"})


def test_a_recording_of_a_sensor_with_a_height_is_no_series(tmp_path):
    rows = "".join(f"{15_000 + k},{(-1) ** k * 0.1},{k % 7}\n" for k in range(64))
    (tmp_path / "log.csv").write_text("mjd,gyro_x [deg/s],h\n" + rows)
    assert gmwm.read(tmp_path / "log.csv", rate=100).axes == ("gyro_x",)
