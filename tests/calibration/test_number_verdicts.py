"""The verdict of each number: bounds, reasons, the scale at which a misfit lies, and trends that are small."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import gmwm
from gmwm.applications.fleets.unit_job import rows_of
from gmwm.base.remarks import Quantity, Remark, Severity
from gmwm.base.remarks.registry import messages
from gmwm.base.remarks.rendering import cases
from gmwm.calibration.number_verdicts import Usability, affected, as_limit, verdict_of_number
from gmwm.calibration.recording_findings import recording_remarks
from gmwm.choosing.datasheets import Entry
from gmwm.showing.reports.content import report_data
from tests.helpers import code_of, only

WALK = Entry(symbol="K", title="random walk", value=2.0, low=1.6, high=2.5, unit="rad/s/√s")


def trend(left):
    """A warm-up without which K is a share (%) of what it is."""
    span = Quantity(60.0, "s")
    return Remark.of(
        "warm-up", "gyro_x", case="large", size=Quantity(1.0, "deg/h"), tau=span, left=left,
        numbers=("B", "K", "R"), duration=span, first=span, way="start",
    )  # fmt: skip


@pytest.mark.slow
def test_k_of_a_recording_that_is_still_warming_up_is_a_bound():
    rng, n, rate = np.random.default_rng(41), 90_000, 50.0
    walk = np.cumsum(rng.normal(0, 1e-5, n)) / math.sqrt(rate)
    values = rng.normal(0, 1e-4, n) * math.sqrt(rate) + walk + 2e-3 * np.exp(-np.arange(n) / rate / 300)
    imu = gmwm.Imu({"gyro_x": gmwm.Signal(values, rate, "rad/s", "gyro_x")})
    kept = gmwm.calibrate(imu, "WN + RW", warmup="keep")
    assert kept.number_verdicts["gyro_x"]["K"].usability is Usability.BOUND
    removed = gmwm.calibrate(imu, "WN + RW", against="warmup")
    assert removed.number_verdicts["gyro_x"]["K"].usability is Usability.USE
    walk = removed.datasheets["gyro_x"]["K"]
    assert walk.low <= 1e-5 <= walk.high


def test_a_number_without_remarks_is_used_or_a_bound_or_not_determined():
    assert verdict_of_number(WALK, ()).usability is Usability.USE
    assert verdict_of_number(replace(WALK, upper_only=True), ()).usability is Usability.BOUND
    assert verdict_of_number(replace(WALK, high=math.inf), ()).usability is Usability.DO_NOT_USE


def test_a_trend_makes_a_bound_unless_its_effect_is_within_the_interval():
    large, small = trend(85.0), trend(95.0)  # the interval begins at 0.8 of K
    assert verdict_of_number(WALK, [large]).usability is Usability.BOUND
    assert verdict_of_number(WALK, [large]).reason == large
    assert verdict_of_number(WALK, [small]).usability is Usability.USE
    white = replace(WALK, symbol="N")
    assert verdict_of_number(white, [large]).usability is Usability.USE


def test_a_ramp_that_noise_describes_as_well_makes_k_a_bound():
    noise = np.random.default_rng(3).normal(size=40_000) + 1e-5 * np.arange(40_000)
    found = gmwm.calibrate(gmwm.Signal(1e-3 * noise, 20.0, "rad/s", "gyro_x"), "WN + DR")
    assert only(found.remarks, "drift:drift").facts["numbers"] == ("K",)
    axis = found.axes["gyro_x"]
    entries = tuple(as_limit(entry) if entry.symbol == "R" else entry for entry in axis.datasheet.entries)
    limited = replace(found, axes={"gyro_x": replace(axis, datasheet=replace(axis.datasheet, entries=entries))})
    assert limited.number_verdicts["gyro_x"]["K"].usability is Usability.BOUND
    assert only(limited.remarks, "drift:possible").facts["rate"].value > 0


def test_a_limit_is_the_upper_end_of_the_interval():
    limit = as_limit(WALK)
    assert (limit.low, limit.high, limit.upper_only) == (0.0, 2.5, True)
    assert as_limit(limit) == limit
    ramp = as_limit(replace(WALK, symbol="R", value=-2.0, low=-2.5, high=-1.6))
    assert (ramp.low, ramp.high) == (-2.5, 2.5)
    time = replace(WALK, symbol="T_c[2]")
    assert as_limit(time) == time


def test_a_remark_that_spoils_a_number_comes_before_one_that_raises_it():
    short = Remark.of("too-short", "gyro_x", case="scales", least=7, scales=4, numbers=("all numbers",))
    verdict = verdict_of_number(WALK, [short, trend(50.0)])
    assert (verdict.usability, verdict.reason) == (Usability.DO_NOT_USE, short)


@pytest.fixture(scope="module")
def calibration():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)"}, rate=100.0, samples=60_000, rng=1)
    return gmwm.calibrate(imu, "WN + RW")


@pytest.mark.parametrize(("multiple", "usability"), [(45.0, "use"), (20.0, "do not use")])
def test_a_misfit_far_beyond_the_averaging_time_of_a_filter_leaves_k(calibration, multiple, usability):
    sheet = calibration.datasheets["gyro_x"]
    tau = Quantity(multiple * sheet["N"].value / sheet["K"].value, "s")
    numbers = (*affected(("K", "B"), tau.value, sheet), "slow terms")
    misfit = Remark.of("coarse-misfit", "gyro_x", case="below", tau=tau, ratio=5.0, numbers=numbers)
    verdicts = replace(calibration, recording_remarks=(misfit,)).number_verdicts["gyro_x"]
    assert verdicts["K"].usability.value == usability
    assert verdicts["B"].usability is Usability.DO_NOT_USE
    assert verdicts["N"].usability is Usability.USE


def test_the_verdict_of_a_calibration_counts_its_numbers(calibration):
    facts = calibration.verdict.facts
    assert (facts["axes"], facts["N_use"], facts["K_use"]) == (1, 1, 1)
    assert calibration.to_dict()["use"]["gyro_x"]["N"] == {"use": "use", "reason": None}


@pytest.mark.slow
def test_a_weak_walk_is_a_bound_and_no_misfit():
    # White noise and a walk that the recording hardly shows: a model without the walk lies below the coarsest scales.
    rng, true = np.random.default_rng(500), 2e-6
    axes = {
        axis: gmwm.Signal(rng.normal(0, 1e-3, 100_000) + np.cumsum(rng.normal(0, 2e-7, 100_000)), 100.0, "rad/s", axis)
        for axis in ("gyro_x", "gyro_y", "gyro_z")
    }
    calibrations = [gmwm.calibrate({axis: signal}) for axis, signal in axes.items()]
    for calibration in calibrations:
        ((axis, result),) = calibration.axes.items()
        assert calibration.number_verdicts[axis]["K"].to_dict()["use"] != "do not use"
        assert result.datasheet["K"].low <= true <= result.datasheet["K"].high


def test_a_number_that_a_remark_names_is_not_marked_as_usable(calibration):
    for message in messages().values():
        for remark in cases(message):
            verdicts = replace(calibration, recording_remarks=(replace(remark, subject="gyro_x"),)).number_verdicts
            numbers = remark.facts.get("numbers")
            # This remark names the source of two numbers, and has nothing against them.
            affects = message.code != "numbers-from-curve" and remark.severity is not Severity.INFO
            if isinstance(numbers, tuple) and affects:
                usable = {symbol for symbol, one in verdicts["gyro_x"].items() if one.usability is Usability.USE}
                assert not usable.intersection(map(str, numbers)), (message.code, remark.facts)


def test_a_trend_within_the_intervals_names_no_number(calibration):
    sheet = calibration.datasheets["gyro_x"]
    facts = {"size": Quantity(1.0, "deg/h"), "left": 99.9}
    curve = Remark.of("trend", "gyro_x", case="curve", **facts, numbers=tuple(s for s in ("K", "B") if s in sheet))
    inspection = SimpleNamespace(remarks=(curve,), source="a.csv")
    (remark,) = recording_remarks(inspection, calibration.axes)
    assert (code_of(remark), remark.severity, remark.facts["numbers"]) == ("trend:small", Severity.INFO, ())
    strong = replace(curve, facts={**curve.facts, "left": 10.0})
    (remark,) = recording_remarks(SimpleNamespace(remarks=(strong,), source="a.csv"), calibration.axes)
    assert (code_of(remark), remark.severity) == ("trend:curve", Severity.WRONG)


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "robust", "usability"), [
    (2.0, "auto", Usability.DO_NOT_USE), (2.0, False, Usability.USE), (1.2, "auto", Usability.USE),
])  # fmt: skip
def test_n_of_noise_whose_strength_changes_is_right_or_cannot_be_used(factor, robust, usability):
    rng, rate = np.random.default_rng(8), 100.0
    strength = np.repeat(factor ** rng.normal(size=1_500), 100)  # another one each second
    x = gmwm.Signal(1e-3 * strength * rng.normal(size=strength.size), rate, "rad/s", "gyro_x")
    found = gmwm.calibrate(gmwm.Imu({"gyro_x": x}), "WN + RW", robust=robust)
    assert found.number_verdicts["gyro_x"]["N"].usability is usability
    if usability is Usability.USE:
        density = float(np.std(x.values)) / math.sqrt(rate)
        assert found.datasheets["gyro_x"]["N"].value == pytest.approx(density, rel=0.03)


def test_every_table_marks_a_number_that_must_not_be_used():
    """300 samples have too few scales for any number."""
    x = np.random.default_rng(1).normal(size=300)
    found = gmwm.calibrate({"gyro_x": gmwm.Signal(1e-3 * x, 10.0, "rad/s", axis="gyro_x")}, within="WN + RW")
    uses = {symbol: verdict.usability.value for symbol, verdict in found.number_verdicts["gyro_x"].items()}
    refused = [symbol for symbol in "NKB" if uses[symbol] == "do not use"]
    assert refused
    rows = [line.split() for line in found.summary(details=True).splitlines()]
    assert [row[0] for row in rows if row and row[0] in "NKB" and row[-1] == "✗"] == refused
    assert "✗: do not use." in " ".join(found.summary(details=True).split())
    agreement = gmwm.agree([found, found], labels=["a", "b"])
    assert not agreement.compared  # of numbers without a meaning
    marked = [row["symbol"] for row in agreement.to_dict()["rows"] if row["use"] == ["do not use"] * 2]
    assert [symbol for symbol in marked if symbol in "NKB"] == refused
    compared = agreement.summary()
    assert [line.strip()[0] for line in compared.splitlines() if line.count("✗") == 2] == refused
    (row,) = rows_of("a", "a.csv", found)
    assert [symbol for symbol in "NKB" if symbol in row and row[f"{symbol}_high"] is None] == refused
    table = found.export(format="latex").splitlines()
    assert [line[0] for line in table if "(do not use)" in line] == refused
    shown = {row["symbol"]: row["mark"] for row in report_data(found)["axes"][0]["numbers"]}
    assert [symbol for symbol in shown if shown[symbol] == "✗" and symbol in "NKB"] == refused
    content = json.loads(found.export(format="json"))
    assert {symbol: verdict["use"] for symbol, verdict in content["use"]["gyro_x"].items()} == uses


@pytest.mark.parametrize("subject", ["gyro_x in tuesday", "gyro in tuesday", "tuesday", "gyro_y in tuesday"])
def test_a_remark_on_one_of_several_recordings_counts_for_its_axes(calibration, subject):
    steps = Remark.of("level-steps", subject, case="settles", parts=("9 s to 99 s",), ranges=((9.0, 99.0),))
    days = replace(calibration, recording_remarks=(steps,), recordings=dict.fromkeys(("monday", "tuesday")))
    usable = days.number_verdicts["gyro_x"]["K"].usability
    assert usable is (Usability.USE if "gyro_y" in subject else Usability.BOUND)


def test_a_remark_on_all_axes_of_a_calibration_counts_for_its_axes_in_a_combination(calibration):
    imu = gmwm.simulate({"accel_x": "WN(sigma2=2e-5)"}, rate=100.0, samples=60_000, rng=1)
    repeated = Remark.of("rows-repeated", count=100)
    both = replace(calibration, recording_remarks=(repeated,)).combined(gmwm.calibrate(imu, "WN"))
    used = {axis: verdicts["N"].usability.value for axis, verdicts in both.number_verdicts.items()}
    assert used == {"gyro_x": "do not use", "accel_x": "use"}


@pytest.mark.parametrize(("source", "count"), [("log.csv", 0), ("l*.csv", 0), ("other.csv", 1)])
def test_a_remark_on_the_file_counts_for_all_its_axes(calibration, source, count):
    rate = Quantity(90.0, "Hz")
    remark = Remark.of("rate-ambiguous", "log.csv", case="complete", every=10, rate=rate, other=Quantity(100.0, "Hz"))
    found = tuple(recording_remarks(SimpleNamespace(remarks=(remark,), source=source), calibration.axes))
    uses = replace(calibration, recording_remarks=found).number_verdicts["gyro_x"].values()
    assert sum(verdict.usability is Usability.USE for verdict in uses) == 3 * count
    budget = replace(calibration, recording_remarks=found).budget("60s")
    assert count or "budget-of-wrong" in {remark.code for remark in budget.remarks}
