"""Intervals averaged over models: laws of the tail areas, and datasheets that only become less certain."""

import math
from dataclasses import replace
from statistics import NormalDist
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import GM
from gmwm.calibration import averaging
from gmwm.calibration.averaging import (
    ABSENT,
    EQUIVALENT_DIFFERENCE,
    LEAST_WEIGHT,
    MOST_MODELS,
    WALK_SHARE,
    WeightedEstimate,
    _narrow_enough,
    _scale,
    averaged_datasheet,
    averaged_interval,
    averaged_intervals,
    weighted_candidates,
)
from gmwm.choosing.datasheets import Datasheet, Entry, datasheet
from gmwm.fitting.estimation.intervals import with_quick_intervals
from tests.helpers import each

LEVEL = 0.95
ONE = WeightedEstimate(weight=1.0, value=2.0, low=1.0, high=5.0)
OTHER = WeightedEstimate(weight=0.4, value=3.0, low=2.5, high=3.6)
LIMIT = WeightedEstimate(weight=1.0, value=0.5, low=0.0, high=4.0, upper_only=True)


@each("level", [0.5, 0.8, 0.95, 0.99])
@each("one", [ONE, LIMIT, replace(ONE, high=math.inf), replace(LIMIT, high=math.inf), replace(ONE, low=0.0)])
def test_the_average_of_one_model_is_its_own_interval(one, level):
    assert averaged_interval([one], level) == pytest.approx((one.low, one.high))
    assert averaged_interval([one, replace(one, weight=3.0)], level) == pytest.approx((one.low, one.high))


def test_the_ends_have_the_averaged_tail_areas():
    low, high = averaged_interval([ONE, OTHER], LEVEL)
    reach = NormalDist().inv_cdf(0.975)

    def above(one, x):
        side = one.high if x > one.value else one.low
        return 1 - NormalDist().cdf(math.log(x / one.value) / abs(math.log(side / one.value)) * reach)

    for end, area in ((low, 0.975), (high, 0.025)):
        assert (above(ONE, end) + 0.4 * above(OTHER, end)) / 1.4 == pytest.approx(area, abs=1e-9)
    # It is between the ends of the models, and so by simulation.
    assert 1.0 < low < 2.5
    assert 3.6 < high < 5.0
    rng, size = np.random.default_rng(1), 400_000
    z, chosen = rng.normal(size=size) / reach, rng.random(size) < 1 / 1.4
    first = 2.0 * np.where(z > 0, 2.5, 2.0) ** z
    second = 3.0 * np.where(z > 0, 1.2, 1.2) ** z
    assert np.quantile(np.where(chosen, first, second), [0.025, 0.975]) == pytest.approx([low, high], rel=0.02)


def test_order_and_scale_of_weights_do_not_matter():
    there = averaged_interval([ONE, OTHER, replace(ABSENT, weight=0.01)], LEVEL)
    back = averaged_interval(
        [replace(ABSENT, weight=0.1), replace(OTHER, weight=4.0), replace(ONE, weight=10.0)], LEVEL
    )
    assert there == pytest.approx(back)


@pytest.mark.parametrize(("share", "is_zero"), [(0.01, False), (0.02, False), (0.03, True), (0.6, True)])
def test_models_without_the_number_lower_it_to_zero(share, is_zero):
    low, high = averaged_interval([replace(ONE, weight=1 - share), replace(ABSENT, weight=share)], LEVEL)
    assert (low == 0.0) is is_zero
    assert low < ONE.low
    assert 0 < high < ONE.high


def test_without_the_number_it_is_zero():
    assert averaged_interval([replace(ABSENT, weight=1.0)], LEVEL) == (0.0, 0.0)
    assert averaged_interval([], LEVEL) == (0.0, 0.0)


def test_a_model_that_does_not_bound_a_number_makes_it_unbounded():
    low, high = averaged_interval([ONE, replace(OTHER, high=math.inf)], LEVEL)
    assert high == math.inf
    assert ONE.low < low < OTHER.low


# --- the models ---------------------------------------------------------------------------------------


def ranking_of(*rows):
    """Rows of difference, equivalent, recommended."""
    names = ("difference", "equivalent", "recommended")
    return SimpleNamespace(distinct=[SimpleNamespace(**dict(zip(names, row, strict=True))) for row in rows])


def test_weights_are_those_of_the_criterion():
    ranking = ranking_of((0.0, True, False), (3.0, True, True), (9.0, True, False), (2.0, False, False))
    found = weighted_candidates(ranking)
    assert [one.recommended for _, one in found] == [True, False, False, False]
    assert [weight for weight, _ in found] == pytest.approx(np.exp([-1.5, 0.0, -1.0, -EQUIVALENT_DIFFERENCE / 2]))


def test_unlikely_models_are_left_out_but_never_the_recommended_one():
    found = weighted_candidates(ranking_of((0.0, False, False), (8.0, False, False), (30.0, False, True)))
    assert math.exp(-4.0) < LEAST_WEIGHT
    assert [one.difference for _, one in found] == [30.0, 0.0]
    many = ranking_of(*((0.1 * k, True, k == 7) for k in range(12)))
    found = weighted_candidates(many)
    assert len(found) == MOST_MODELS
    assert found[0][1].recommended


@pytest.fixture(scope="module")
def unclear():
    """A weak random walk: models with and without it are as good."""
    truth = gmwm.Model.parse("WN(sigma2=4e-7) + GM(beta=0.5, sigma2=3e-8) + RW(gamma2=2e-13)")
    signal = gmwm.Signal(truth.simulate(100_000, 100.0, rng=4), 100.0, "rad/s", "gyro_x")
    ranking = gmwm.select("2*GM + WN + QN + RW", gmwm.wavelet_variance(signal))
    return ranking, datasheet(with_quick_intervals(ranking.recommended.fit, LEVEL), LEVEL)


@pytest.mark.slow
def test_datasheets_never_become_narrower(unclear):
    ranking, sheet = unclear
    found = averaged_datasheet(sheet, ranking, LEVEL)
    assert len(weighted_candidates(ranking)) > 1
    assert list(found) == list(sheet)
    wider = 0
    for symbol, entry in found.items():
        before = sheet[symbol]
        assert entry.low <= before.low <= entry.value <= before.high <= entry.high or before.upper_only
        assert entry.value == before.value
        wider += entry.low < before.low or entry.high > before.high
    assert wider > 0


def test_a_number_that_other_models_lack_is_an_upper_limit(unclear):
    ranking, sheet = unclear
    lone = replace(sheet, entries=(*sheet.entries, replace(sheet["N"], symbol="Q_r", title="quality factor")))
    entry = averaged_datasheet(lone, ranking, LEVEL)["Q_r"]
    assert entry.upper_only
    assert entry.low == 0.0
    assert entry.high >= sheet["N"].high
    held = replace(lone, entries=tuple(replace(e, held=True) for e in lone.entries))
    assert averaged_datasheet(held, ranking, LEVEL).entries == held.entries


def test_one_model_leaves_all_as_it_is(unclear):
    ranking, sheet = unclear
    alone = replace(ranking, candidates=(ranking.recommended,))
    assert averaged_datasheet(sheet, alone, LEVEL) is sheet
    intervals = ranking.recommended.fit.confidence_intervals(LEVEL)
    found = averaged_intervals(ranking.recommended.fit, intervals, sheet)
    for name, ends in intervals.items():
        assert found[name] == pytest.approx(ends, rel=0.05)


def test_parameters_become_wider_as_much_as_their_numbers(unclear):
    ranking, sheet = unclear
    fit = ranking.recommended.fit
    (term,) = (name for name, p in zip(fit.model.terms, fit.model.processes, strict=True) if p.name == "GM")
    time = sheet["T_c"]
    wide = replace(time, low=time.value / 3, high=time.value * 3)
    wide = replace(sheet, entries=tuple(wide if e is time else e for e in sheet.entries))
    intervals = fit.confidence_intervals(LEVEL)
    found = averaged_intervals(fit, intervals, wide)
    value = fit.parameters[f"{term}.beta"]
    assert found[f"{term}.beta"] == pytest.approx((value / 3, value * 3))
    assert found[f"{term}.sigma2"] == intervals[f"{term}.sigma2"]
    endless = replace(time, low=0.0, high=math.inf)
    endless = replace(sheet, entries=tuple(endless if e is time else e for e in sheet.entries))
    assert averaged_intervals(fit, intervals, endless)[f"{term}.beta"] == (0.0, math.inf)


def test_powers_of_ratios():
    assert _scale(3.0, 2.0, 2.0) == pytest.approx(12.0)
    assert (_scale(3.0, 0.0, 2.0), _scale(3.0, 0.0, -1.0)) == (0.0, math.inf)
    assert (_scale(3.0, math.inf, 2.0), _scale(3.0, math.inf, -1.0)) == (math.inf, 0.0)
    assert (_scale(3.0, 2.0, 1e5), _scale(3.0, 0.5, 1e5)) == (math.inf, 0.0)


def test_a_slow_gauss_markov_process_counts_as_a_random_walk():
    truth = gmwm.Model.parse("WN(sigma2=4e-7) + RW(gamma2=1e-11)")
    signal = gmwm.Signal(truth.simulate(50_000, 100.0, rng=4), 100.0, "rad/s", "gyro_x")
    ranking = gmwm.rank(["WN + RW", "WN + GM"], gmwm.wavelet_variance(signal))
    sheets = {}
    for one in ranking:
        sheets[one.structure] = datasheet(with_quick_intervals(one.fit, LEVEL), LEVEL)
    other = next(sheet for structure, sheet in sheets.items() if "GM" in structure)
    assert other["T_c"].value > WALK_SHARE * 500.0
    # Both are the rise of the curve at long scales.
    assert other["q_c"].value == pytest.approx(sheets["WN + RW"]["K"].value, rel=0.3)
    both = replace(
        ranking,
        candidates=tuple(replace(c, equivalent=True, recommended="RW" in c.structure, same_as=None) for c in ranking),
    )
    entry = averaged_datasheet(sheets["WN + RW"], both, LEVEL)["K"]
    assert not entry.upper_only
    assert entry.low > 0


def sheet_of(model, *numbers):
    """A datasheet with rows of symbol, value, low, high."""
    entries = tuple(
        Entry(symbol=symbol, title="", value=value, low=low, high=high, unit="rad/s", upper_only=False)
        for symbol, value, low, high in numbers
    )
    return Datasheet(
        entries=entries, axis="gyro_x", unit="rad/s", model=model, samples=100_000, rate=100.0, level=LEVEL,
        averaging_time=np.array([0.01]), allan_deviation=np.ones(1),
    )  # fmt: skip


def averaged_over(monkeypatch, sheet, other):
    """The datasheet of the recommended model, averaged with one equivalent model whose datasheet is `other`."""
    ranking = ranking_of((0.0, True, True), (0.0, True, False))
    for candidate in ranking.distinct:
        candidate.fit = None
    monkeypatch.setattr(averaging.FitCurve, "of", lambda fit: None)
    monkeypatch.setattr(averaging, "with_quick_intervals", lambda fit, level: fit)
    monkeypatch.setattr(averaging, "model_datasheet", lambda fit, level: other)
    return averaged_datasheet(sheet, ranking, LEVEL)


@pytest.mark.parametrize(("ratio", "counts"), [(7e3, True), (1.5e4, False)])
def test_a_model_with_an_undetermined_gauss_markov_term_does_not_count(monkeypatch, ratio, counts):
    sheet = sheet_of("WN", ("N", 1.0, 0.9, 1.1))
    term = ("T_c", 1.0, 0.1, 10.0), ("q_c", 1.0, 1 / math.sqrt(ratio), math.sqrt(ratio))
    entry = averaged_over(monkeypatch, sheet, sheet_of("GM + WN", ("N", 2.0, 1.9, 2.1), *term))["N"]
    assert (entry.high > 2) is counts


@pytest.mark.parametrize(("time", "alike"), [(4.0, True), (6.0, False), (0.25, True), (1 / 6, False)])
def test_gauss_markov_terms_of_similar_correlation_times_are_the_same(monkeypatch, time, alike):
    sheet = sheet_of("GM", ("T_c", 1.0, 0.9, 1.1), ("q_c", 1.0, 0.9, 1.1))
    other = sheet_of("GM + WN", ("T_c", time, 0.9 * time, 1.1 * time), ("q_c", 3.0, 2.9, 3.1))
    entry = averaged_over(monkeypatch, sheet, other)["q_c"]
    assert (entry.high > 2.5) is alike


@pytest.mark.slow
def test_a_slow_gauss_markov_process_is_named_beside_the_random_walk():
    """GM of 300 s in two hours: its curve is that of a random walk at most scales."""
    rng = np.random.default_rng(3)
    white, steps = 1e-4 * rng.normal(size=(2, 360_000))
    slow = lfilter([1e-3], [1.0, -math.exp(-1 / 15_000)], steps)
    found = gmwm.calibrate(gmwm.Signal(white + slow, 50.0, "rad/s", "gyro_x"))
    (remark,) = [remark for remark in found.remarks if remark.code == "walk-or-markov"]
    assert 72 <= remark.facts["time"].value <= 7200
    alone = gmwm.calibrate(gmwm.Signal(white + slow, 50.0, "rad/s", "gyro_x"), "WN + RW")
    assert "K" in alone.datasheets["gyro_x"]
    assert not any(remark.code == "walk-or-markov" for remark in alone.remarks)


def test_a_parameter_that_is_not_determined_has_a_limit():
    scale, shape = GM().parameters[1], GM().parameters[0]
    assert (scale.name, shape.name) == ("sigma2", "beta")
    assert _narrow_enough(scale, (1.0, 99.0)) == (1.0, 99.0)
    assert _narrow_enough(scale, (1.0, 101.0)) == (0.0, 101.0)
    assert _narrow_enough(shape, (1.0, 9.0)) == (1.0, 9.0)
    assert _narrow_enough(shape, (1.0, 11.0)) == (0.0, math.inf)


def test_the_interval_of_b_holds_the_coefficient_of_flicker_noise_and_the_minimum_of_the_curve(monkeypatch):
    rng = np.random.default_rng((41, 1))
    white, walk = rng.normal(size=60_000), np.cumsum(3e-3 * rng.normal(size=60_000))
    axis = gmwm.calibrate({"gyro_x": gmwm.Signal(white + walk, 100.0, "rad/s")}).axes["gyro_x"]
    sheet, every = averaging.model_datasheet(axis.fit, 0.95), axis.ranking
    other = next(replace(c, difference=2.0) for c in every.distinct if c.fit.model.structure == "WN + FN")
    assert axis.fit.model.structure == "WN + RW"
    monkeypatch.setattr(averaging, "MOST_MODELS", 1)
    few = replace(every, candidates=(*(c for c in every.candidates if c.recommended), other))
    widened = averaged_datasheet(sheet, few, 0.95)
    assert widened["B"].low < averaging.model_datasheet(other.fit, 0.95)["B"].value < sheet["B"].low
    assert (widened["N"].low, widened["N"].high) == (sheet["N"].low, sheet["N"].high)
