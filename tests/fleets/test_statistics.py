"""Statistics of a fleet: location and spread without estimation error, outliers, axes that differ, and remarks."""

import json
import math
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from scipy import stats

from gmwm.applications.fleets.statistics import fleet_statistics, hotelling
from gmwm.applications.fleets.statistics_result import deviants, looked_for, of_units
from gmwm.applications.fleets.summary_text import summary
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Remark, Severity
from gmwm.base.statistics import between_units, effects, prediction_limits, spread_limits
from tests.helpers import codes, only, raises

Z = stats.norm.ppf(0.975)

# NIST/SEMATECH e-Handbook of Statistical Methods, 1.3.5.17.3, from Rosner (1983).
ROSNER = np.array(
    [-0.25, 0.68, 0.94, 1.15, 1.20, 1.26, 1.26, 1.34, 1.38, 1.43, 1.49, 1.49, 1.55, 1.56, 1.58, 1.65, 1.69, 1.70, 1.76,
     1.77, 1.81, 1.91, 1.94, 1.96, 1.99, 2.06, 2.09, 2.10, 2.14, 2.15, 2.23, 2.24, 2.26, 2.35, 2.37, 2.40, 2.47, 2.54,
     2.62, 2.64, 2.90, 2.92, 2.92, 2.93, 3.21, 3.26, 3.30, 3.59, 3.68, 4.30, 4.64, 5.34, 5.42, 6.01]
)  # fmt: skip


def fleet(n=20, seed=21, axes=("gyro_x", "gyro_y", "gyro_z"), spread=0.1, error=0.02, shifts=None, model="WN"):
    """A table of healthy units: N of each axis, about 1e-4 rad/s/√Hz; `shifts` multiplies it for some (unit, axis)."""
    rng = np.random.default_rng(seed)
    rows = []
    for unit in range(n):
        for axis in axes:
            x = math.log(1e-4) + spread * rng.normal() + error * rng.normal()
            N = math.exp(x) * (shifts or {}).get((unit, axis), 1.0)
            ends = {"N_low": N * math.exp(-Z * error), "N_high": N * math.exp(Z * error)}
            rows.append({"unit": f"{unit}.csv", "axis": axis, "status": "calibrated", "model": model, "N": N, **ends})
    return pl.DataFrame(rows).with_columns(N_unit=pl.lit("rad/s/√Hz"))


def with_number(table, symbol, value, low, high, unit):
    """The table with one more number, the same for every row or a list."""
    named = {symbol: value, f"{symbol}_low": low, f"{symbol}_high": high}
    columns = [
        pl.Series(name, given if isinstance(given, list) else [given] * table.height, dtype=pl.Float64)
        for name, given in named.items()
    ]
    return table.with_columns(*columns, pl.lit(unit).alias(f"{symbol}_unit"))


# --- location and spread ----------------------------------------------------------------------------


def test_the_spread_is_where_q_is_its_expectation_whatever_the_errors():
    rng = np.random.default_rng(2)
    s = np.exp(rng.uniform(-3, 3, size=(50, 15)))
    x = 2.0 * rng.normal(size=s.shape) + s * rng.normal(size=s.shape)
    x[:, 12:] = np.where(rng.random((50, 3)) < 0.5, np.nan, x[:, 12:])
    found = effects(x, s * s)
    for row, s2, mean, tau2 in zip(x, s * s, found.mean, found.spread2, strict=True):
        there = np.isfinite(row)
        w = 1 / (tau2 + s2[there])
        assert mean == pytest.approx(np.average(row[there], weights=w), rel=1e-9, abs=1e-12)
        q = np.sum(w * (row[there] - mean) ** 2)
        assert q == pytest.approx(there.sum() - 1, rel=1e-6) if tau2 > 0 else q <= there.sum() - 1
    assert 10 < np.sum(found.spread2 > 0) < 50 or np.all(found.spread2 > 0)


def test_where_errors_are_nothing_all_is_as_of_a_normal_sample():
    x = np.random.default_rng(3).normal(5.0, 2.0, size=(3, 9))
    tiny = np.full(x.shape, 1e-14)
    found = effects(x, tiny)
    np.testing.assert_allclose(found.spread2, x.var(axis=1, ddof=1), rtol=1e-9)
    np.testing.assert_allclose(found.error, x.std(axis=1, ddof=1) / 3, rtol=1e-9)
    np.testing.assert_allclose(2 * found.spread2**2 / found.spread2_variance, 8, rtol=1e-6)
    low, high = spread_limits(x, tiny, 0.9)
    np.testing.assert_allclose(low, 8 * x.var(axis=1, ddof=1) / stats.chi2.ppf(0.95, 8), rtol=1e-6)
    np.testing.assert_allclose(high, 8 * x.var(axis=1, ddof=1) / stats.chi2.ppf(0.05, 8), rtol=1e-6)
    ends = prediction_limits(x, tiny, 0.95)
    reach = stats.t.ppf(0.975, 8) * x.std(axis=1, ddof=1) * math.sqrt(1 + 1 / 9)
    np.testing.assert_allclose(ends, (x.mean(axis=1) - reach, x.mean(axis=1) + reach), rtol=1e-3)


def test_units_that_are_alike_have_no_spread():
    x = np.random.default_rng(4).normal(size=(200, 10))
    errors = np.full(x.shape, 4.0)
    found = between_units(x, errors)
    assert np.mean(found == 0) > 0.9
    assert np.all(spread_limits(x, errors, 0.95)[0] == 0)
    # One unit alone has none, and neither have none at all.
    assert between_units(np.array([[1.0, np.nan], [np.nan, np.nan]]), np.ones((2, 2))).tolist() == [0.0, 0.0]


def test_the_spread_is_free_of_error_and_the_share_of_error_is_told():
    found = fleet_statistics(fleet(400, spread=0.1, error=0.1))["gyro_x.N"]
    assert found.spread_low < 0.1 < found.spread_high
    assert found.spread == pytest.approx(0.1, rel=0.25)
    assert found.error == pytest.approx(0.1, rel=1e-6)
    assert found.error_share == pytest.approx(0.5, abs=0.15)
    assert found.typical_low < 1e-4 < found.typical_high
    # The estimates scatter by √2 as much as the units.
    assert math.log(found.quantile_95 / found.quantile_05) > 1.2 * math.log(
        found.predicted_high / found.predicted_low
    ) * (1.645 / 1.96)


def test_units_of_measure_and_the_order_of_units_change_nothing():
    table = fleet(15, shifts={(3, "gyro_y"): 3.0})
    one = fleet_statistics(table)
    scaled = table.with_columns([pl.col(name) * 1e6 for name in ("N", "N_low", "N_high")])
    other = fleet_statistics(scaled.sample(fraction=1.0, shuffle=True, seed=5))
    for row in one.rows:
        twin = other[f"{row.axis}.{row.symbol}"]
        assert twin.typical == pytest.approx(1e6 * row.typical)
        assert twin.spread == pytest.approx(row.spread)
        assert twin.predicted_high == pytest.approx(1e6 * row.predicted_high)
    assert [(o.unit, o.axis, round(o.distance, 6)) for o in one.outliers] == [
        (o.unit, o.axis, round(o.distance, 6)) for o in other.outliers
    ]
    assert [d.pvalue for d in one.differences] == pytest.approx([d.pvalue for d in other.differences])


def test_axes_of_a_unit_that_go_together_count_as_one_unit():
    alone = fleet(30, axes=("gyro_x",), error=1e-4)
    three = pl.concat([alone.with_columns(axis=pl.lit(f"gyro_{k}")) for k in "xyz"])
    single, all_axes = fleet_statistics(alone)["gyro_x.N"], fleet_statistics(three)["gyro.N"]
    assert all_axes.units == 3 * single.units == 90
    assert all_axes.typical == pytest.approx(single.typical)
    widths = [math.log(row.typical_high / row.typical_low) for row in (all_axes, single)]
    assert widths[0] == pytest.approx(widths[1], rel=0.02)
    widths = [math.log(row.predicted_high / row.predicted_low) for row in (all_axes, single)]
    assert widths[0] == pytest.approx(widths[1], rel=0.03)


# --- outliers ---------------------------------------------------------------------------------------


def test_rosner_finds_three_of_his_sample():
    x = ROSNER[None]
    found = deviants(x, np.full(x.shape, 1e-14))
    n = 54 - np.arange(3)
    t = np.abs(found.distance[0, :3])
    inner = (n - 1) * t / np.sqrt(n * (n - 2 + t * t))
    np.testing.assert_allclose(inner, [3.118, 2.942, 3.179], atol=1e-3)
    assert ROSNER[found.places[0, :3]].tolist() == [6.01, 5.42, 5.34]
    assert np.sum(found.pvalue[0] <= 0.05) == 3


def test_one_odd_unit_is_found_and_taken_out_of_what_is_typical():
    found = fleet_statistics(fleet(20, shifts={(7, "gyro_y"): 4.0}))
    (odd,) = found.outliers
    assert (odd.unit, odd.axis, odd.symbol, odd.si) == ("7.csv", "gyro_y", "N", "rad/s/√Hz")
    assert odd.times == pytest.approx(4.0, rel=0.3)
    assert odd.value == pytest.approx(odd.times * odd.typical)
    assert odd.low < odd.value < odd.high
    assert odd.pvalue < 1e-3
    row = found["gyro_y.N"]
    assert (row.units, row.outliers, row.searched) == (20, 1, True)
    assert row.spread_low < 0.1 < row.spread_high
    assert row.predicted_high < odd.value


def test_two_that_hide_behind_one_another_are_both_found():
    shifts = {(3, "gyro_x"): 6.0, (11, "gyro_x"): 6.5}
    found = fleet_statistics(fleet(25, shifts=shifts))
    assert {odd.unit for odd in found.outliers} == {"3.csv", "11.csv"}


def test_a_badly_measured_unit_is_not_odd_for_that():
    table = fleet(20, axes=("gyro_x",), shifts={(7, "gyro_x"): 4.0})
    wide = pl.when(pl.col("unit") == "7.csv").then(1.0).otherwise(0.02)
    vague = table.with_columns(N_low=pl.col("N") * (-Z * wide).exp(), N_high=pl.col("N") * (Z * wide).exp())
    assert fleet_statistics(table).outliers
    assert not fleet_statistics(vague).outliers


@pytest.mark.parametrize("n", [8, 25])
@pytest.mark.parametrize("ends", [(1.0, 1.0), (0.1, 1.0)])
def test_healthy_units_raise_an_alarm_as_seldom_as_said(n, ends):
    rng = np.random.default_rng(12)
    s = np.exp(rng.uniform(*np.log(ends), size=(3000, n)))
    x = 2.0 * rng.normal(size=s.shape) + s * rng.normal(size=s.shape)
    pvalues = deviants(x, s * s).pvalue[:, 0]
    # The bound of Bonferroni is near; of several outliers at once Rosner's procedure takes a little more.
    for size in (0.05, 0.01):
        assert np.mean(pvalues <= size) < 1.15 * size + 4 * math.sqrt(size / 3000)


@pytest.mark.slow
def test_a_fleet_of_many_numbers_raises_no_more():
    alarms = [bool(fleet_statistics(fleet(10, seed=seed)).outliers) for seed in range(25)]
    # The size is 5 %: of 25 fleets 6 or more would come by chance once in a thousand times.
    assert sum(alarms) < 6


def test_among_few_units_none_is_looked_for():
    found = fleet_statistics(fleet(7, shifts={(3, "gyro_x"): 100.0}))
    assert not found.outliers
    assert not any(row.searched for row in found.rows)
    remark = only(found.remarks, "not-compared:few")
    assert (remark.subject, remark.facts["fewest"]) == ("N of gyro", 8)
    assert "check-passed:fleet" not in codes(found.remarks)
    assert looked_for(np.array([7, 8])).tolist() == [0, 1]


def test_too_few_units_for_a_spread_are_a_remark():
    two, three = (fleet_statistics(fleet(n)) for n in (2, 3))
    assert (two["gyro_x.N"].units, two["gyro_x.N"].spread, two["gyro_x.N"].predicted_high) == (2, None, None)
    remark = only(two.remarks, "few-units:number")
    assert (remark.subject, remark.facts) == ("N of gyro", {"case": "number", "units": 2, "least": 3, "fewest": 8})
    assert [only(found.remarks, "few-units:fleet").facts["units"] for found in (two, three)] == [2, 3]
    assert "few-units:number" not in codes(three.remarks)
    assert "few-units:fleet" not in codes(fleet_statistics(fleet(4)).remarks)


# --- what is compared -------------------------------------------------------------------------------


def test_upper_limits_are_counted_but_not_compared():
    table = fleet(12, axes=("gyro_x",))
    K = np.exp(np.random.default_rng(6).normal(-14, 0.1, size=12))
    value, low, high = ([float(f * k) for k in K] for f in (1.0, 0.8, 1.25))
    for unit, limit in ((2, 1e-9), (5, 1e-5)):
        value[unit], low[unit], high[unit] = None, 0.0, limit
    found = fleet_statistics(with_number(table, "K", value, low, high, "rad/s/√s"))["gyro_x.K"]
    assert (found.units, found.limited, found.left_out) == (10, 2, 0)
    assert found.below == ("2.csv",)
    assert not found.shown_by
    remarks = fleet_statistics(with_number(table, "K", value, low, high, "rad/s/√s")).remarks
    assert only(remarks, "not-compared:limits").subject == "K of gyro"
    assert only(remarks, "shown-by-few:below").facts["units"] == ("2.csv",)


def test_the_few_that_show_what_the_others_do_not_are_named():
    table = fleet(12, axes=("gyro_x",))
    value, low, high = [None] * 11 + [1e-5], [0.0] * 11 + [0.8e-5], [1e-6] * 11 + [1.2e-5]
    found = fleet_statistics(with_number(table, "K", value, low, high, "rad/s/√s"))
    assert found["gyro_x.K"].shown_by == ("11.csv",)
    remark = only(found.remarks, "shown-by-few:few")
    assert (remark.subject, remark.facts) == ("K of gyro_x", {"case": "few", "shown": ("11.csv",), "limited": 11})


def test_the_ramp_is_compared_with_its_sign_and_a_limit_is_about_zero():
    table = fleet(20, axes=("gyro_x",))
    rng = np.random.default_rng(17)
    R = (1e-9 * rng.normal(size=20)).tolist()
    R[4] = 2e-8
    low, high = [r - 2e-10 for r in R], [r + 2e-10 for r in R]
    R[9], low[9], high[9] = None, 0.0, 3e-10
    found = fleet_statistics(with_number(table, "R", R, low, high, "rad/s²"))
    row = found["gyro_x.R"]
    assert row.signed
    assert row.units == 20
    assert row.predicted_low < 0 < row.predicted_high
    assert row.spread_low < 1e-9 < row.spread_high
    (odd,) = found.outliers
    assert (odd.unit, odd.times, odd.value) == ("4.csv", None, 2e-8)


def test_numbers_of_the_model_are_compared_within_the_commonest_model():
    table = fleet(12, axes=("gyro_x",), model="GM + WN")
    table = table.with_columns(
        model=pl.when(pl.col("unit").is_in(["0.csv", "1.csv"])).then(pl.lit("2*GM + WN")).otherwise(pl.col("model"))
    )
    table = with_number(table, "T_c", 100.0, 80.0, 125.0, "s")
    row = fleet_statistics(table)["gyro_x.T_c"]
    assert (row.model, row.units, row.left_out) == ("GM + WN", 10, 2)
    assert fleet_statistics(table)["gyro_x.N"].units == 12
    remark = only(fleet_statistics(table).remarks, "not-compared:model")
    assert (remark.subject, remark.facts["model"]) == ("T_c of gyro", "GM + WN")


def test_numbers_without_an_interval_or_of_other_units_are_left_out():
    table = fleet(12, axes=("gyro_x",))
    table = table.with_columns(N_high=pl.when(pl.col("unit") == "3.csv").then(float("inf")).otherwise(pl.col("N_high")))
    table = table.with_columns(N_low=pl.when(pl.col("unit") == "4.csv").then(None).otherwise(pl.col("N_low")))
    table = table.with_columns(N_unit=pl.when(pl.col("unit") == "5.csv").then(pl.lit("u/√Hz")).otherwise("N_unit"))
    row = fleet_statistics(table)["gyro_x.N"]
    assert (row.units, row.left_out) == (9, 3)
    assert only(fleet_statistics(table).remarks, "not-compared:interval").subject == "N of gyro"


def test_failed_units_are_not_counted():
    table = fleet(9)
    failed = pl.DataFrame({"unit": ["bad.csv"], "axis": [None], "status": ["failed"], "model": [None]})
    found = fleet_statistics(pl.concat([table, failed], how="diagonal_relaxed"))
    assert found.units == 9
    none = fleet_statistics(table.with_columns(status=pl.lit("failed")))
    assert (none.units, none.rows) == (0, ())
    assert none.remarks == ()


# --- axes -------------------------------------------------------------------------------------------


def test_of_two_axes_hotelling_is_student():
    d = np.random.default_rng(8).normal(0.5, 1.0, size=(1, 12))
    assert hotelling(d) == pytest.approx(stats.ttest_1samp(d[0], 0.0).pvalue)
    assert hotelling(np.ones((1, 12))) is None
    assert hotelling(np.vstack([d, 2 * d])) is None


def test_an_axis_that_differs_is_told_and_what_units_share_does_not_hide_it():
    shifts = {(unit, "gyro_z"): 1.1 for unit in range(20)}
    found = fleet_statistics(fleet(20, shifts=shifts, spread=0.05))
    assert only(found.remarks, "axes-differ").subject == "N of gyro"
    (apart,) = found.differences
    assert apart.differs
    assert apart.units == 20
    ratio = apart.relative["gyro_z"] / math.sqrt(apart.relative["gyro_x"] * apart.relative["gyro_y"])
    assert ratio == pytest.approx(1.1, abs=4 * 0.05 * math.sqrt(1.5 / 20))
    assert math.prod(apart.relative.values()) == pytest.approx(1.0)
    d = np.random.default_rng(9).normal(size=(400, 2, 10))
    # The size of 5 % scatters by 1.1 % in 400 samples.
    assert abs(np.mean([hotelling(one) <= 0.05 for one in d]) - 0.05) < 4 * 0.011


# --- doors, documents, words ------------------------------------------------------------------------


def test_what_cannot_be_is_refused():
    table = fleet(8)
    with raises(OptionError, argument="size", got=5):
        fleet_statistics(table, size=5)
    with raises(OptionError, argument="confidence"):
        fleet_statistics(table, confidence=95)
    with raises(DataError, argument="table", got=["model"]):
        fleet_statistics(table.drop("model"))
    with raises(DataError, argument="table", got="several rows for gyro_x of 0.csv"):
        fleet_statistics(pl.concat([table, table]))
    with pytest.raises(KeyError, match=r"gyro_x\.N"):
        fleet_statistics(table)["gyro_x.K"]


def test_it_is_a_table_and_plain_values():
    found = fleet_statistics(fleet(10, shifts={(2, "gyro_x"): 9.0}))
    assert found.table.height == len(found.rows) == 4
    assert found.table["axis"].to_list() == ["gyro", "gyro_x", "gyro_y", "gyro_z"]
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert content["units"] == 10
    assert content["outliers"][0]["unit"] == "2.csv"
    assert content["rows"][1]["typical"] == found["gyro_x.N"].typical
    assert [Remark.from_dict(one) for one in content["remarks"]] == list(found.remarks)
    assert "10 units" in repr(found)


def test_the_summary_has_units_failures_outliers_and_remarks():
    table = fleet(20, shifts={(2, "gyro_x"): 9.0})
    table = table.with_columns(p_value=pl.lit(1e-9), contaminated=pl.lit(False))
    failed = {f"bad{k}.csv": "no samples" for k in range(13)}
    names = [*table["unit"].unique(maintain_order=True), *failed]
    found = fleet_statistics(table)
    remarks = [*of_units(table, len(names), len(failed)), *found.remarks]
    many = SimpleNamespace(
        units=names, failed=failed, left_out=(), kept=15, done=5, table=table, statistics=found, remarks=remarks
    )
    text = summary(many)
    assert max(map(len, text.splitlines())) <= 80
    flat = " ".join(text.split())
    assert "Fleet of 33 units: 20 calibrated (5 now, 15 before), 13 failed" in flat
    assert "bad9.csv: no samples" in flat
    assert "bad10.csv" not in flat
    assert "and 3 more" in flat
    assert "2.csv, gyro_x N:" in flat
    assert "deg/√h" in flat
    assert "N white noise density of a filter" in flat
    assert only(remarks, "not-calibrated:fleet").facts == {"case": "fleet", "failed": 13, "units": 33}
    assert only(remarks, "model-rejected:fleet").facts == {"case": "fleet", "rejected": 60, "tested": 60}
    assert "outliers-found:fleet" not in codes(remarks)
    outlier = only(remarks, "units-outlying:units")
    assert (outlier.subject, outlier.facts["count"], outlier.severity) == ("2.csv", 1, Severity.BIASED)


def test_outliers_in_samples_are_a_remark():
    table = fleet(4).with_columns(contaminated=pl.col("unit") == "2.csv")
    assert only(of_units(table, 4, 0), "outliers-found:fleet").facts == {
        "case": "fleet",
        "contaminated": 3,
        "tested": 12,
    }


def test_a_healthy_fleet_has_no_grave_remark():
    remarks = fleet_statistics(fleet(20)).remarks
    assert only(remarks, "check-passed:fleet").facts["size"] == 0.05
    assert {remark.severity for remark in remarks} == {Severity.INFO}
