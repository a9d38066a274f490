"""Recordings of one unit agree but for a stated share of false alarms; what differs is named."""

import json
import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

import gmwm
from gmwm import agree
from gmwm.base.errors import OptionError, UnitError
from gmwm.base.remarks import Remark
from gmwm.calibration.agreement import _error_correlations, _shared_factors
from gmwm.choosing.datasheets import Datasheet, Entry
from gmwm.files.importers.values import as_reference
from tests.helpers import code_of, codes, only, raises

TRUTH = {
    "gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)",
    "gyro_y": "WN(sigma2=4e-7) + GM(beta=4.0, sigma2=3e-7)",
}
LOUDER = {**TRUTH, "gyro_y": "WN(sigma2=1.6e-6) + GM(beta=4.0, sigma2=3e-7)"}
WITHIN = "GM + WN + RW"
Z = NormalDist().inv_cdf(0.975)


def recorded(truth, seed, **options):
    imu = gmwm.simulate(truth, rate=100.0, samples=100_000, rng=seed)
    return gmwm.calibrate(replace(imu, source=f"records/day_{seed}.csv"), WITHIN, **options)


@pytest.fixture(scope="module")
def three():
    return [recorded(TRUTH, seed) for seed in (11, 12, 13)]


@pytest.fixture(scope="module")
def changed(three):
    return [*three[:2], recorded(LOUDER, 14)]


def sheet(*entries, model="GM + WN", level=0.95, unit="rad/s"):
    times = np.array([0.01, 0.02])
    return Datasheet(
        entries=entries,
        axis="gyro_x",
        unit=unit,
        model=model,
        samples=1000,
        rate=100.0,
        level=level,
        averaging_time=times,
        allan_deviation=np.ones(2),
    )


def point(symbol, value, error, unit="rad/s/√Hz", **given):
    factor = math.exp(Z * error)
    return Entry(
        symbol=symbol, title="a number", value=value, low=value / factor, high=value * factor, unit=unit, **given
    )


def ramp(value, error):
    return Entry(
        symbol="R", title="ramp", value=value, low=value - Z * error, high=value + Z * error, unit="rad/s²", term="DR"
    )


def limit(symbol, value, high, unit="rad/s/√s", **given):
    return Entry(
        symbol=symbol,
        title="a number",
        value=value,
        low=-high if symbol == "R" else 0.0,
        high=high,
        unit=unit,
        upper_only=True,
        **given,
    )


def of(*sheets, **options):
    return agree([{"gyro_x": one} for one in sheets], **options)


# --- recordings -------------------------------------------------------------------------------------


@pytest.mark.slow
def test_recordings_of_one_unit_agree(three):
    found = agree(three)
    assert found.labels == ("day_11", "day_12", "day_13")
    assert found.disagreeing == ()
    assert {(row.axis, row.symbol) for row in found.compared} >= {
        ("gyro_x", "N"), ("gyro_x", "K"), ("gyro_y", "N"), ("gyro_y", "T_c"), ("gyro_y", "q_c"),
    }  # fmt: skip
    assert found.verdict.facts["state"] == "all"
    assert found.verdict.facts["compared"] == len(found.compared) + len(found.sensors)
    assert "recordings-differ:agreement" not in codes(found.remarks)
    assert found.summary().count("≠") == 1, "only in the legend"


@pytest.mark.slow
def test_a_number_that_changed_is_named(changed):
    found = agree(changed)
    assert [(row.axis, row.symbol) for row in found.disagreeing] == [("gyro_y", "N of WN")]
    row = found["gyro_y.N of WN"]
    assert row.apart == pytest.approx(1.0, abs=0.1)
    assert row.agrees is False
    assert row.adjusted >= row.pvalue
    assert (found.verdict.facts["state"], found.verdict.facts["differing"]) == ("one", 1)
    remark = only(found.remarks, "recordings-differ:agreement")
    assert (remark.subject, remark.facts["unit"], remark.facts["p"]) == ("N of WN of gyro_y", "deg/√h", row.adjusted)
    assert remark.facts["values"][0].startswith(f"{row.entries[0].in_units()[0]:.3g} ±")
    assert found.summary().count("≠") == 2


def test_the_summary_fits_eighty_columns(changed):
    reference = {"gyro.N": (0.2, "deg/√h"), "gyro.R": (1.0, "deg/h/h")}
    for labels in (None, ["a", "b", "c"], [f"a very long name of the recording number {k}" for k in range(3)]):
        text = agree(changed, labels=labels, reference=reference).summary()
        assert max(map(len, text.splitlines())) <= 80
        for label in labels or ():
            assert label in text
    many = agree([*changed, *changed], labels=[f"recording {k}" for k in range(6)]).summary()
    assert max(map(len, many.splitlines())) <= 80
    assert all(f"({k})" in many for k in range(1, 7))


def test_axes_of_one_recording_are_not_compared(three):
    one = replace(three[1], axes={axis: found for axis, found in three[1].axes.items() if axis == "gyro_x"})
    found = agree([three[0], one])
    assert {row.axis for row in found.compared} == {"gyro_x"}
    assert {row.reason for row in found if row.axis == "gyro_y"} == {"one recording"}
    assert found.models["gyro_y"][1] is None
    assert found.summary().startswith("Not every recording has gyro_y. gmwm compared")
    lone = {remark.subject for remark in found.remarks if code_of(remark) == "not-compared:single"}
    assert lone == {f"{row.symbol} of gyro_y" for row in found if row.axis == "gyro_y"}
    other = replace(three[1], axes={"gyro_z": three[1].axes["gyro_x"]})
    axes = {"day_11": "gyro_x, gyro_y", "day_12": "gyro_z"}
    with raises(OptionError, argument="calibrations", got=axes):
        agree([three[0], other])


def test_models_that_a_test_rejects_are_a_remark(three):
    axis = three[0].axes["gyro_x"]
    poor = replace(three[0], axes={**three[0].axes, "gyro_x": replace(axis, test=replace(axis.test, pvalue=1e-9))})
    found = agree([poor, *three[1:]])
    assert found.rejected == {"gyro_x": ("day_11",)}
    remark = only(found.remarks, "model-rejected:recording")
    assert (remark.subject, remark.facts["recordings"]) == ("gyro_x", ("day_11",))


def test_it_is_plain_numbers(changed):
    found = agree(changed, reference={"gyro.N": (0.2, "deg/√h")})
    content = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert content["disagreeing"] == ["gyro_y.N of WN"]
    assert content["compared"] == len(found.compared) + len(found.sensors)
    assert len(content["rows"]) == len(found) == len(list(found))
    assert content["rows"][0]["reference"]["unit"] == "deg/√h"
    assert [Remark.from_dict(one) for one in content["remarks"]] == list(found.remarks)
    assert Remark.from_dict(content["verdict"]) == found.verdict
    assert "<pre>" in found._repr_html_()
    assert repr(found) == f"Agreement({len(found.compared)} numbers compared, 1 differ)"
    with pytest.raises(KeyError, match=r"gyro_y\.N"):
        found["gyro_z.N"]


# --- the test ---------------------------------------------------------------------------------------


@pytest.mark.slow
def test_false_alarms_are_as_many_as_stated():
    rng, trials, size = np.random.default_rng(5), 400, 0.05
    errors = {"N": 0.002, "K": 0.1, "T_c": 0.3, "q_c": 0.05}
    alarms = 0
    for _ in range(trials):
        sheets = [
            sheet(*(point(s, math.exp(e * rng.standard_normal()), e) for s, e in errors.items()),
                  ramp(0.1 + rng.standard_normal(), 1.0))
            for _ in range(3)
        ]  # fmt: skip
        alarms += bool(of(*sheets, size=size).disagreeing)
    # Holm's level of five independent tests is 1 − (1 − size/5)^5, within three standard errors.
    expected = 1 - (1 - size / 5) ** 5
    assert alarms / trials == pytest.approx(expected, abs=3 * math.sqrt(expected * (1 - expected) / trials))


@pytest.mark.slow
def test_a_limit_and_a_number_rarely_differ_by_chance():
    rng, trials = np.random.default_rng(6), 2000
    alarms = 0
    for _ in range(trials):
        # K² of 1 known to 0.8, so that the data only bound it, and to 0.1.
        weak, sharp = 1 + 0.8 * rng.standard_normal(), 1 + 0.1 * rng.standard_normal()
        bound = limit("K", math.sqrt(max(weak, 0.0)), math.sqrt(max(weak, 0.0) + Z * 0.8))
        alarms += bool(of(sheet(bound), sheet(point("K", math.sqrt(sharp), 0.05 / sharp, "rad/s/√s"))).disagreeing)
    assert alarms / trials <= 0.05 + 3 * math.sqrt(0.05 * 0.95 / trials)


def test_the_statistic_is_the_chi_square_of_the_logarithms():
    values, errors = np.array([1.0, 1.1, 0.97]), np.array([0.02, 0.05, 0.03])
    found = of(*(sheet(point("N", v, e)) for v, e in zip(values, errors, strict=True)))["gyro_x.N"]
    x, w = np.log(values), errors**-2
    statistic = np.sum(w * (x - np.sum(w * x) / np.sum(w)) ** 2)
    assert found.pvalue == pytest.approx(math.exp(-statistic / 2), rel=1e-9)  # chi-square of two degrees of freedom


@pytest.mark.parametrize("signs", [(1.0, 1.0), (1.0, -1.0)])
def test_ramps_keep_their_sign(signs):
    found = of(*(sheet(ramp(5.0 * sign, 0.5)) for sign in signs))
    assert bool(found.disagreeing) is (signs == (1.0, -1.0))
    assert found["gyro_x.R"].apart == (0.0 if signs == (1.0, 1.0) else None)
    assert ("drift:ramps" in codes(found.remarks)) is (signs == (1.0, -1.0))


def test_b_of_flicker_noise_is_not_compared_with_the_lowest_point_of_a_curve():
    flicker, lowest = point("B", 1.0, 0.01, "rad/s", term="FN"), point("B", 2.0, 0.01, "rad/s", tau=10.0)
    found = of(sheet(flicker), sheet(lowest))
    assert (found["gyro_x.B"].agrees, found["gyro_x.B"].reason) == (None, "kinds")
    assert only(found.remarks, "not-compared:kinds").subject == "B of gyro_x"
    assert of(sheet(flicker), sheet(flicker))["gyro_x.B"].agrees
    assert of(sheet(lowest), sheet(lowest))["gyro_x.B"].agrees


@pytest.mark.parametrize("extra", [{}, {"tau": 10.0}])
def test_a_single_limit_agrees_if_it_reaches_the_interval(extra):
    number = point("K", 1.0, 0.1, "rad/s/√s")
    for high, agrees in ((0.999 * number.low, False), (1.001 * number.low, True), (5.0, True)):
        found = of(sheet(number), sheet(limit("K", 0.3 * min(high, 1.0), high, **extra)))["gyro_x.K"]
        assert found.agrees is agrees
    # Where the limit ends at the interval's end, p is that of the ends.
    touching = of(sheet(number), sheet(limit("K", 0.3, number.low, **extra)))["gyro_x.K"]
    assert touching.pvalue == pytest.approx(0.05, rel=1e-4)


def test_limits_of_ramps_have_two_sides():
    for value, agrees in ((-5.0, False), (5.0, False), (-1.5, True), (1.5, True)):
        found = of(sheet(ramp(value, 0.5)), sheet(limit("R", 0.2, 1.0, "rad/s²")))["gyro_x.R"]
        assert found.agrees is agrees


def test_two_limits_agree_and_none_counts_for_two_tests():
    found = of(sheet(limit("K", 0.0, 1e-3)), sheet(limit("K", 0.0, 1e3)))["gyro_x.K"]
    assert (found.agrees, found.pvalue, found.apart) == (True, 1.0, None)
    number = sheet(point("K", 1.0, 0.1, "rad/s/√s"))
    once = of(number, sheet(limit("K", 0.3, 0.6)))["gyro_x.K"].pvalue
    twice = of(number, sheet(limit("K", 0.3, 0.6)), sheet(limit("K", 0.3, 0.7)))["gyro_x.K"].pvalue
    assert twice == pytest.approx(2 * once, rel=1e-6)


def test_holm_raises_each_by_those_that_are_left():
    entries = [[point(s, math.exp(d), 0.1) for s, d in (("N", d), ("B", 0.2), ("Q", 0.0))] for d in (0.0, 0.5)]
    entries[1][1] = point("B", math.exp(0.5), 0.1)
    rows = {row.symbol: row for row in of(*(sheet(*e) for e in entries))}
    assert rows["N"].adjusted == pytest.approx(3 * rows["N"].pvalue)
    assert rows["B"].adjusted == pytest.approx(2 * rows["B"].pvalue)
    assert rows["Q"].adjusted == rows["Q"].pvalue == 1.0


def test_numbers_of_terms_are_compared_in_equal_models_only():
    both = [point("N", 1.0, 0.01), point("T_c", 1.0, 0.01, "s")], [point("N", 1.0, 0.01), point("T_c", 9.0, 0.01, "s")]
    alike = of(sheet(*both[0]), sheet(*both[1]))
    assert [row.symbol for row in alike.disagreeing] == ["T_c"]
    other = of(sheet(*both[0]), sheet(*both[1], model="GM + WN + RW"))
    assert [row.symbol for row in other.compared] == ["N"]
    assert other["gyro_x.T_c"].reason == "models"
    remark = only(other.remarks, "not-compared:models")
    assert (remark.subject, remark.facts["numbers"]) == ("gyro_x", ("N", "K", "B", "Q"))
    assert "not-compared:models" not in codes(alike.remarks)


def test_what_was_held_or_has_no_interval_is_not_compared():
    known = sheet(point("N", 1.0, 0.01))
    for poor in (
        Entry(symbol="N", title="a number", value=9.0, low=9.0, high=9.0, unit="rad/s/√Hz", held=True),
        Entry(symbol="N", title="a number", value=9.0, low=None, high=None, unit="rad/s/√Hz"),
        Entry(symbol="N", title="a number", value=9.0, low=0.0, high=math.inf, unit="rad/s/√Hz"),
    ):
        found = of(known, sheet(poor))
        assert found["gyro_x.N"].reason == "interval"
        assert found.verdict.facts["state"] == "none"


def test_levels_of_the_intervals_do_not_matter():
    wide = NormalDist().inv_cdf(0.995)
    other = Entry(
        symbol="N",
        title="a number",
        value=1.1,
        low=1.1 / math.exp(wide * 0.03),
        high=1.1 * math.exp(wide * 0.03),
        unit="rad/s/√Hz",
    )
    expected = of(sheet(point("N", 1.0, 0.03)), sheet(point("N", 1.1, 0.03)))["gyro_x.N"].pvalue
    found = of(sheet(point("N", 1.0, 0.03)), sheet(other, level=0.99))["gyro_x.N"].pvalue
    assert found == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("factor", [1e-12, 1e9])
def test_the_unit_does_not_change_the_verdict(factor):
    def scaled(entry):
        return replace(entry, value=factor * entry.value, low=factor * entry.low, high=factor * entry.high)

    ones = [point("N", 1.0, 0.1), limit("K", 0.3, 0.6), ramp(5.0, 0.5)]
    others = [point("N", 1.2, 0.1), point("K", 1.0, 0.1, "rad/s/√s"), ramp(6.0, 0.5)]
    expected = [row.pvalue for row in of(sheet(*ones), sheet(*others))]
    found = of(sheet(*map(scaled, ones)), sheet(*map(scaled, others)))
    assert [row.pvalue for row in found] == pytest.approx(expected, rel=1e-6)


# --- the reference values ----------------------------------------------------------------------------


def test_references_are_of_sensors_and_axes(three):
    density = three[0].datasheets["gyro_x"]["N"].in_units("deg/√h")[0]
    found = agree(three, reference={"gyro_y.N": (9.0, "°/√h"), "gyro.N": (density, "deg/√h"), "gyro.Q": (1, "µrad")})
    assert found["gyro_x.N"].ratios[0] == pytest.approx(1.0, rel=1e-12)
    assert found["gyro_y.N"].reference.value == 9.0
    assert found["gyro_x.K"].ratios == (None, None, None)
    assert found.unmatched == ("gyro.Q",)
    assert only(found.remarks, "not-compared:reference").subject == "gyro.Q"


def test_a_limit_has_the_ratio_of_its_end():
    found = of(sheet(limit("K", 0.1, 0.6)), sheet(limit("K", 0.1, 3.0)), reference={"gyro.K": (2.0, "rad/s²/√Hz")})
    assert found["gyro_x.K"].ratios == pytest.approx((0.3, 1.5))
    assert "≤ 0.3 " in found.summary()


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("deg/√h", "rad/s/√Hz", math.pi / 180 / 60),
        ("° / sqrt(hr)", "rad/s/√Hz", math.pi / 180 / 60),
        ("m/s/√h", "m/s²/√Hz", 1 / 60),
        ("ug/rt(Hz)", "m/s²/√Hz", 9.80665e-6),
        ("m/s^2/√Hz", "m/s²/√Hz", 1.0),
        ("°/s", "rad/s", math.pi / 180),
        ("deg/hr", "rad/s", math.pi / 180 / 3600),
        ("mdps", "rad/s", math.pi / 180e3),
        ("mGal", "m/s²", 1e-5),
        ("deg/hour/√hour", "rad/s/√s", math.pi / 180 / 3600 / 60),
    ],
)
def test_units_as_datasheets_write_them(unit, si, factor):
    assert as_reference("x", (2.0, unit), si).si == pytest.approx(2 * factor, rel=1e-12)


def test_wrong_references_say_what_they_may_be(three):
    with raises(UnitError, argument="reference", got="deg/h") as caught:
        agree(three, reference={"gyro.N": (2.0, "deg/h")})
    assert "deg/√h" in caught.value.expected
    with raises(UnitError, argument="reference", got="mg"):
        agree(three, reference={"gyro.B": (2.0, "mg")})
    with raises(OptionError, argument="reference", got="accel.N") as caught:
        agree(three, reference={"accel.N": (2.0, "m/s/√h")})
    assert "gyro, gyro_x, gyro_y" in caught.value.expected
    with raises(OptionError, argument="reference", got="gyro.M"):
        agree(three, reference={"gyro.M": (2.0, "deg/√h")})
    for given in (2.0, (0.0, "deg/√h"), (math.nan, "deg/√h"), ("2", 3.0), (True, "deg/√h"), "ab"):
        with pytest.raises(OptionError) as caught:
            agree(three, reference={"gyro.N": given})
        assert caught.value.argument == "reference"
        assert caught.value.got is given


# --- the door ---------------------------------------------------------------------------------------


def test_one_recording_is_no_agreement(three):
    for given in ([], three[:1], three[0], "calibration.json"):
        with raises(OptionError, argument="calibrations"):
            agree(given)
    for given in ({}, {"gyro_x": three[0]["gyro_x"]}, 3):
        with raises(OptionError, argument="calibrations", got=f"{type(given).__name__} in place 2"):
            agree([three[0], given])


def test_options_are_checked(three):
    for size in (0, 1, True, "5 %"):
        with raises(OptionError, argument="size", got=size):
            agree(three, size=size)
    for labels in (["a"], ["a", "a", "b"], "abc", [1, 2, 3], ["", "a", "b"]):
        with raises(OptionError, argument="labels", got=labels):
            agree(three, labels=labels)


def test_an_axis_has_one_unit():
    with raises(UnitError, "gyro_x", "rad/s in 1", "u in 2"):
        of(sheet(point("N", 1.0, 0.1)), sheet(point("N", 1.0, 0.1, "u/√Hz"), unit="u"))


def test_labels_fall_back_on_numbers(three):
    assert agree([three[0], three[0]]).labels == ("1", "2")
    assert agree(three[:2], labels=("a", "b")).labels == ("a", "b")


@pytest.mark.slow
def test_an_axis_that_is_absent_is_not_a_model_without_a_number(calibration):
    axes = dict(calibration.axes)
    gone = axes.pop("accel_x")
    unrecorded = replace(calibration, axes=axes)
    lost = replace(calibration, axes=axes, failed={"accel_x": "constant"})
    for other, said in ((unrecorded, "not recorded"), (lost, "not calibrated")):
        found = gmwm.agree([calibration, other], labels=["a", "b"], reference={"accel.N": (0.1, "m/s/√h")})
        section = found.summary().split("\naccel_x\n")[1].split("\n\n")[0]
        (row,) = [line for line in section.splitlines() if line.strip().startswith("model")]
        assert row.endswith(said)
        assert "–" not in section
        assert gone.fit.model.structure.replace(" ", "") in row
        (beside,) = [line for line in found.summary().splitlines() if line.strip().startswith("accel_x N  ")]
        assert beside.endswith(said)


# --- all axes of a sensor ------------------------------------------------------------------------------


def unit_of(values, error=0.1, low=("gyro_x", "gyro_y", "gyro_z")):
    """Sheets of three axes, each with one K and its standard error on the logarithmic scale."""
    return {axis: sheet(point("K", value, error, unit="rad/s/√s")) for axis, value in zip(low, values, strict=True)}


def test_a_common_change_of_all_axes_is_found_that_no_axis_shows():
    found = agree([unit_of([1e-5, 2e-5, 3e-5]), unit_of([1.3e-5, 2.6e-5, 3.9e-5])], labels=["monday", "tuesday"])
    assert found.disagreeing == ()
    (shared,) = found.sensors
    assert (shared.sensor, shared.symbol, shared.axes) == ("gyro", "K", ("gyro_x", "gyro_y", "gyro_z"))
    assert shared.factors[0] == (1.0, 1.0, 1.0)
    # Three log-ratios with the standard error 0.1 √2: the error of their mean is 0.1 √(2/3).
    half = Z * 0.1 * math.sqrt(2 / 3)
    assert shared.factors[1] == pytest.approx((1.3, 1.3 * math.exp(-half), 1.3 * math.exp(half)))
    assert shared.pvalue == pytest.approx(math.erfc(math.log(1.3) / (0.1 * math.sqrt(2 / 3)) / math.sqrt(2)))
    assert shared.agrees is False
    remark = only(found.remarks, "recordings-differ:sensor")
    assert remark.subject == "K of gyro"
    assert "1.3 (1.11 … 1.53) in tuesday" in str(remark)
    assert "gyro K" in found.summary()
    assert found.verdict.facts["differing"] == 1


@pytest.mark.slow
def test_the_test_of_a_sensor_has_its_size():
    generator = np.random.default_rng(5)
    named = []
    for _ in range(1200):
        errors = generator.uniform(0.05, 0.3, (3, 3))
        logs = np.log([1e-5, 2e-5, 3e-5]) + errors * generator.standard_normal((3, 3))
        logs[generator.uniform(size=(3, 3)) < 0.1] = np.nan  # an upper limit, which has no place in this test
        units = [
            {
                axis: sheet(limit("K", 1e-5, 9e-5) if np.isnan(x) else point("K", math.exp(x), error, unit="rad/s/√s"))
                for axis, x, error in zip(("gyro_x", "gyro_y", "gyro_z"), *row, strict=True)
            }
            for row in zip(logs, errors, strict=True)
        ]
        named.append([shared.agrees is False for shared in agree(units).sensors] == [True])
    assert 0.031 < np.mean(named) < 0.069  # three standard errors of 5 %


def test_recordings_without_a_common_axis_have_no_factor():
    alone = unit_of([1e-5, 2e-5], low=("accel_x", "accel_y"))
    found = agree([unit_of([1e-5, 2e-5, 3e-5]), alone, unit_of([1e-5, 2e-5, 3e-5])])
    (shared,) = found.sensors
    assert shared.factors[1] is None
    assert shared.factors[2] == pytest.approx((1.0, math.exp(-0.16003), math.exp(0.16003)), rel=1e-4)
    assert found.summary()
    assert agree([{"gyro_x": sheet(point("K", 1.0, 0.1))}] * 2).sensors == (), "one axis is its own test"


@pytest.mark.slow
def test_the_test_of_a_sensor_whose_axes_share_noise_has_its_size():
    generator = np.random.default_rng(6)
    shared = np.full((3, 3), 0.6) + 0.4 * np.eye(3)
    pvalues = []
    for _ in range(1200):
        errors = generator.uniform(0.05, 0.3, (3, 2))
        logs = errors * (np.linalg.cholesky(shared) @ generator.standard_normal((3, 2)))
        of_axes = {axis: list(zip(*row, strict=True)) for axis, *row in zip("xyz", logs, errors, strict=True)}
        pvalues.append([_shared_factors("gyro", "K", of_axes, of).pvalue for of in ([shared] * 2, [np.eye(3)] * 2)])
    sizes = np.mean(np.array(pvalues) < 0.05, axis=0)
    assert 0.035 < sizes[0] < 0.065
    assert sizes[1] > 0.15, "with independent axes, the test would be wrong"


def test_axes_that_share_noise_have_correlated_errors(three):
    pairs = ("gyro_x/gyro_y",)
    remark = Remark.of(
        "noise-shared", case="calibration", pairs=pairs, correlations=(-0.8,), strongest=pairs, count=1, many="no",
        correlation=0.8, first="gyro_x", second="gyro_y", tau=1.0, size=0.05,
    )  # fmt: skip
    shared = replace(three[0], recording_remarks=(remark,))
    assert _error_correlations(shared, ["gyro_y", "gyro_x"]) == pytest.approx(np.array([[1, 0.64], [0.64, 1]]))
    assert np.all(_error_correlations(three[0].datasheets, ["gyro_y", "gyro_x"]) == np.eye(2))
