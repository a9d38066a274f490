"""The plot of a fleet: its units sorted by value, the range of a further unit, and the names of outliers."""

import math
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

from gmwm.applications.fleets import Fleet
from gmwm.applications.fleets.plot import plot_fleet
from gmwm.applications.fleets.statistics import fleet_statistics
from gmwm.base.errors import OptionError
from gmwm.base.units import datasheet_units
from gmwm.showing.plots.figure import description
from tests.helpers import raises

DEG = datasheet_units("rad/s/√Hz")["deg/√h"]


def fleet(n, odd=None, sensors=("gyro", "accel")):
    rng = np.random.default_rng(n)
    rows = []
    for unit in range(n):
        for sensor in sensors:
            for letter in "xyz":
                N = 1e-4 * math.exp(0.1 * rng.normal()) * (8.0 if (unit, letter) == odd else 1.0)
                bounded = unit % 3 == 0
                rows.append({
                    "unit": f"lot/unit_{unit}.csv", "axis": f"{sensor}_{letter}", "status": "calibrated", "model": "WN",
                    "N": N, "N_low": 0.95 * N, "N_high": 1.05 * N,
                    "N_unit": "rad/s/√Hz" if sensor == "gyro" else "m/s²/√Hz",
                    "K": None if bounded else N / 100, "K_low": 0.0 if bounded else N / 200, "K_high": N / 50,
                    "K_unit": "rad/s/√s" if sensor == "gyro" else "m/s²/√s",
                })  # fmt: skip
    table = pl.DataFrame(rows, infer_schema_length=None)
    return SimpleNamespace(table=table, statistics=fleet_statistics(table))


@pytest.mark.parametrize("n", [12, 40, 41, 300])
def test_a_panel_a_number_a_strip_an_axis_in_datasheet_units(n):
    told = fleet(n, odd=(5, "y"))
    figure = description(plot_fleet)(told)
    assert [panel.title for panel in figure.panels] == [
        "Gyroscope N", "Gyroscope K", "Accelerometer N", "Accelerometer K",
    ]  # fmt: skip
    panel = figure.panels[0]
    assert panel.y.label == "N (deg/√h)"
    assert [tick.label for tick in panel.x.ticks] == ["X", "Y", "Z"]
    name = "Unit, with its confidence interval" if n <= 40 else "Units, sorted by value"
    curves = [line for line in panel.lines if line.label == name]
    assert len(curves) == 3
    assert len({line.stroke.colour for line in curves}) == 3
    values = told.table.filter(pl.col("axis") == "gyro_x")["N"].sort().to_numpy() * DEG
    np.testing.assert_allclose(curves[0].y[[0, -1]], values[[0, -1]])
    for place, line in enumerate(curves, start=1):
        assert np.all(np.diff(line.y) >= 0)
        assert np.all(np.diff(line.x) > 0)
        assert place - 0.5 < line.x[0] < line.x[-1] < place + 0.5
    row = told.statistics["gyro_z.N"]
    np.testing.assert_allclose([panel.bands[2].lower[0], panel.bands[2].upper[0]], np.array(
        [row.predicted_low, row.predicted_high]) * DEG)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("n", [12, 300])
def test_an_odd_unit_is_a_star_with_its_name_and_no_dot(n):
    told = fleet(n, odd=(5, "y"))
    panel = description(plot_fleet)(told).panels[0]
    (odd,) = [one for one in told.statistics.outliers if (one.axis, one.symbol) == ("gyro_y", "N")]
    stars = panel["Outlier"]
    np.testing.assert_allclose(stars.y, [odd.value * DEG])
    assert [text.text for text in panel.texts] == ["unit_5"]
    assert panel.y.limits[0] < stars.y[0] < panel.y.limits[1]
    others = [line for line in panel.lines if line is not stars and line.label and line.stroke.width != 0.8]
    assert all(not np.any(np.isclose(line.y, stars.y[0])) for line in others)
    assert "1 outlier" in description(plot_fleet)(told).title
    assert description(plot_fleet)(fleet(n)).title == f"{n} units"


def test_few_units_have_a_symbol_and_a_name_each():
    panel = description(plot_fleet)(fleet(3)).panels[0]
    assert set(panel.labels) >= {"unit_0", "unit_1", "unit_2"}
    for unit in range(3):
        dots = [line for line in panel.lines if line.label == f"unit_{unit}"]
        assert len(dots) == 3
        assert len({line.stroke.symbol for line in dots}) == 1
    told = fleet(2)
    alike = told.table.with_columns(unit=pl.col("unit").str.replace("lot/unit_(.).csv", "$1/unit.csv"))
    renamed = SimpleNamespace(table=alike, statistics=fleet_statistics(alike))
    assert set(description(plot_fleet)(renamed).labels) >= {"0", "1"}


@pytest.mark.slow
def test_limits_are_triangles_beside_the_strip():
    few, many = (description(plot_fleet)(fleet(n)).panels[1]["Upper limits"] for n in (12, 300))
    assert few.y.size == 4
    assert many.y.size == 3
    assert few.stroke.symbol == many.stroke.symbol == "down"


def test_what_only_one_unit_has_is_not_drawn_unless_there_is_nothing_else():
    table = fleet(3, sensors=("gyro",)).table
    only = pl.col("unit").str.contains("unit_0") & (pl.col("axis") == "gyro_x")
    with_time = table.with_columns([pl.when(only).then(pl.lit(x)).alias(f"T_c{end}") for x, end in
                                    ((2.0, ""), (1.5, "_low"), (2.5, "_high"), ("s", "_unit"))])  # fmt: skip
    titles = [
        [
            panel.title
            for panel in description(plot_fleet)(SimpleNamespace(table=t, statistics=fleet_statistics(t))).panels
        ]
        for t in (with_time, with_time.filter(pl.col("unit").str.contains("unit_0")))
    ]
    assert titles == [["Gyroscope N", "Gyroscope K"], ["Gyroscope N", "Gyroscope K", "Gyroscope T_c"]]


@pytest.mark.slow
def test_small_numbers_are_written_with_a_power_of_ten():
    told = fleet(12)
    table = told.table.with_columns([pl.col(name) * 1e-6 for name in ("N", "N_low", "N_high")])
    panel = description(plot_fleet)(SimpleNamespace(table=table, statistics=fleet_statistics(table))).panels[0]
    assert panel.y.label == "N (10⁻⁹ deg/√h)" or panel.y.label == "N (10⁻⁶ deg/√h)"
    assert 0.1 < panel.y.limits[1] < 1000


@pytest.mark.slow
def test_it_is_drawn_and_written_for_one_sensor_and_one_unit_too(tmp_path):
    for told in (fleet(9, sensors=("gyro",)), fleet(1)):
        Fleet.plot(told, path=tmp_path / "fleet.svg")
        assert (tmp_path / "fleet.svg").read_bytes().startswith(b"<?xml")
    empty = told.table.with_columns(status=pl.lit("failed"))
    with raises(OptionError, argument="fleet", advises=["reason"]):
        description(plot_fleet)(SimpleNamespace(table=empty, statistics=fleet_statistics(empty)))


@pytest.mark.parametrize("n", [3, 12])
def test_limits_are_inside_the_frame_and_the_legend_is_ordered(n):
    figure = description(plot_fleet)(fleet(n))
    for panel in figure.panels:
        assert all(np.nanmax(line.x) < panel.x.limits[1] - 0.1 for line in panel.lines)
    labels = figure.labels
    assert labels[:3] == ("unit_0", "unit_1", "unit_2") if n == 3 else labels[0].startswith("Unit")
    assert labels.index("Typical value") < labels.index("Range of a further unit (95 %)")
