"""What a ranking holds, what may be asked of it, and what is refused."""

from __future__ import annotations

import json
from collections import Counter

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.remarks import Remark
from gmwm.choosing.selection.structure import structure_of
from gmwm.measuring.covariance.api import wavelet_covariance
from tests.helpers import code_of, codes, only, raises

RATE = 100.0
TRUE = "GM(beta=0.5, sigma2=1.0) + WN(sigma2=4.0)"
GENERAL = "2*GM + WN + QN + RW"


def simulated(count=40_000, seed=3):
    return gmwm.Model.parse(TRUE).simulate(count, RATE, rng=seed)


@pytest.fixture(scope="module")
def wv():
    return gmwm.wavelet_variance(gmwm.Signal(simulated(), RATE, "rad/s", "gyro_x"))


@pytest.fixture(scope="module")
def ranking(wv):
    return gmwm.select(GENERAL, wv)


@pytest.fixture(scope="module")
def several():
    return gmwm.select("2*GM + WN + RW", np.split(simulated(), 2), RATE)


def test_every_sum_is_there_once_and_the_best_is_first(ranking):
    assert len(ranking) == 3 * 2 * 2 * 2 - 1
    assert len({candidate.structure for candidate in ranking}) == len(ranking)
    assert list(ranking) == list(ranking.candidates)
    values = np.array([candidate.wic.value for candidate in ranking])
    differences = np.array([candidate.difference for candidate in ranking])
    np.testing.assert_allclose(differences, values - values[0], rtol=1e-9)
    # Two ways to write one model may differ in the last digits.
    assert np.all(np.diff(values) > -1e-6 * values[:-1])
    assert ranking.best is ranking[0]
    for candidate in ranking:
        assert candidate.wic.value == candidate.wic.loss + candidate.wic.optimism
        assert candidate.wic.loss == candidate.fit.objective
        assert candidate.out_of_sample is None
        np.testing.assert_array_equal(candidate.fit.weighting_matrix, ranking.weighting_matrix)


def test_the_truth_is_recommended(ranking):
    assert ranking.recommended is ranking["GM + WN"]
    assert [c for c in ranking if c.recommended] == [ranking.recommended]
    assert ranking.recommended in ranking.equivalent
    assert all(c.equivalent for c in ranking.equivalent)
    assert ranking.recommended.parameters == min(c.parameters for c in ranking.equivalent) == 3
    # None of them contains another.
    structures = [structure_of(c.model) for c in ranking.equivalent]
    assert not any(a <= b for a in structures for b in structures if a is not b)


def test_what_comes_down_to_a_smaller_model_names_it(ranking):
    same = [c for c in ranking if c.same_as is not None]
    assert same
    assert set(same).isdisjoint(ranking.distinct)
    assert len(same) + len(ranking.distinct) == len(ranking)
    for candidate in same:
        smaller = ranking[candidate.same_as]
        assert smaller.same_as is None
        assert candidate.boundary
        assert candidate.parameters == smaller.parameters
        assert candidate.fit.objective == pytest.approx(smaller.fit.objective, rel=1e-6)
        assert len(smaller.model.processes) <= len(candidate.model.processes)
        assert not candidate.equivalent


def test_candidates_by_place_text_and_model(ranking):
    assert ranking[np.int64(1)] is ranking[1]
    assert ranking[-1] is ranking.candidates[-1]
    assert ranking[:2] == ranking.candidates[:2]
    found = ranking["GM + WN"]
    for key in ("WN + GM", gmwm.WN() + gmwm.GM(), "GM(beta=7.0) + WN", gmwm.Model.parse(TRUE)):
        assert ranking[key] is found
    with raises(OptionError, "GM", "23 candidates"):
        ranking["3*GM"]
    with pytest.raises(IndexError):
        ranking[99]


def test_the_remarks_say_what_the_table_marks(ranking):
    assert only(ranking.remarks, "recommended:model").facts["model"] == "GM + WN"
    others = [c.structure for c in ranking.equivalent if not c.recommended]
    assert ("recommended:equal" in codes(ranking.remarks)) == bool(others)
    assert [list(r.facts["models"]) for r in ranking.remarks if code_of(r) == "recommended:equal"] == (
        [others] if others else []
    )
    reduced = len(ranking) - len(ranking.distinct)
    assert only(ranking.remarks, "recommended:reduced").facts["count"] == reduced
    assert "model-rejected:ranking" not in codes(ranking.remarks)
    assert {remark.subject for remark in ranking.remarks} == {"gyro_x"}
    assert "model-rejected:ranking" in codes(gmwm.rank(["WN", "RW"], simulated(), RATE).remarks)


@pytest.mark.slow
def test_tables_have_the_best_candidates(ranking):
    summary = ranking.summary()
    html = ranking._repr_html_()
    assert html.startswith("<table>")
    rows = html.count("<tr>") - 1
    for limit in (1, 3, None):
        head, cells = ranking.table(limit)
        least = len(ranking.distinct) if limit is None else limit
        assert least <= len(cells) <= max(least, least + len(ranking.equivalent))
        assert all(len(row) == len(head) for row in cells)
    assert rows == len(ranking.table()[1])
    assert len(ranking.summary(limit=2)) < len(summary) <= len(ranking.summary(limit=None))
    assert "GM + WN recommended" in repr(ranking)
    assert "GM + WN" in repr(ranking["GM + WN"])


def test_a_p_value_is_that_of_the_fit(ranking):
    candidate = ranking["GM + WN"]
    assert candidate.pvalue == candidate.fit.goodness_of_fit().pvalue
    assert candidate.pvalue > 0.01
    assert ranking["WN"].pvalue < 1e-6


def test_it_can_be_written_as_json(ranking):
    document = json.loads(json.dumps(ranking.to_dict()))
    assert document["recommended"] == "GM + WN"
    assert document["weighting"] == "optimal"
    assert len(document["candidates"]) == len(ranking)
    first = document["candidates"][0]
    assert first["wic"]["value"] == ranking.best.wic.value
    assert first["difference"] == 0.0
    assert [c["recommended"] for c in document["candidates"]].count(True) == 1
    assert [Remark.from_dict(one) for one in document["remarks"]] == list(ranking.remarks)


def test_a_comparison_is_antisymmetric(ranking):
    one, other = ranking.compare("GM + WN", "WN"), ranking.compare("WN", "GM + WN")
    assert one.difference == -other.difference == ranking["GM + WN"].difference - ranking["WN"].difference
    assert one.error == pytest.approx(other.error)
    assert (one.first, one.second) == (other.second, other.first)
    assert one.difference < -2 * one.error < 0
    assert one.remark == other.remark
    assert code_of(one.remark) == "criteria-differ:differ"
    facts = one.remark.facts
    assert (facts["better"], facts["worse"], facts["clear"]) == ("GM + WN", "WN", "yes")
    assert (facts["difference"], facts["error"]) == (-one.difference, pytest.approx(one.error))


def test_a_model_does_not_differ_from_itself_or_from_one_that_comes_down_to_it(ranking):
    smaller = next(c for c in ranking if c.same_as == "GM + WN" and c.fit is ranking["GM + WN"].fit)
    for other in ("GM + WN", smaller.model):
        comparison = ranking.compare("GM + WN", other)
        assert comparison.difference == comparison.error == 0
        assert code_of(comparison.remark) == "criteria-differ:equal"


def test_the_error_of_a_difference_is_that_of_theory():
    # With Ω = V⁻¹ and curves that are linear in one parameter more, the difference of the losses is a chi-square with
    # one degree of freedom, not central where the term is there: its variance is 2 + 4 times the difference.
    truth = gmwm.WN(sigma2=1.0) + gmwm.RW(gamma2=2e-8)
    ranking = gmwm.rank(["WN", "WN + RW"], truth.simulate(100_000, RATE, rng=5), RATE)
    comparison = ranking.compare("WN", "WN + RW")
    fall = comparison.first.wic.loss - comparison.second.wic.loss
    assert fall > 1
    assert comparison.error**2 == pytest.approx(2 + 4 * fall, rel=0.01)


def test_the_order_of_terms_changes_nothing(wv, ranking):
    other = gmwm.select("RW + QN + WN + 2*GM", wv)
    for candidate in ranking:
        twin = other[candidate.model]
        assert twin.wic.value == pytest.approx(candidate.wic.value, rel=1e-6)
        assert twin.equivalent == candidate.equivalent
        assert twin.recommended == candidate.recommended


@pytest.mark.parametrize("factor", [2.0**-20, 1e6])
def test_the_unit_changes_nothing_but_the_numbers(ranking, factor):
    scaled = gmwm.select(GENERAL, factor * simulated(), RATE)
    assert scaled.recommended.structure == ranking.recommended.structure
    assert {c.structure for c in scaled.equivalent} == {c.structure for c in ranking.equivalent}
    for candidate in ranking:
        twin = scaled[candidate.model]
        assert twin.wic.value == pytest.approx(candidate.wic.value, rel=1e-5)
        assert twin.same_as == candidate.same_as
    sigma2 = scaled.recommended.fit.parameters["WN.sigma2"]
    assert sigma2 == pytest.approx(factor**2 * ranking.recommended.fit.parameters["WN.sigma2"], rel=1e-6)


def test_the_same_seed_gives_the_same_ranking(wv, ranking):
    assert gmwm.select(GENERAL, wv).to_dict() == ranking.to_dict()


@pytest.mark.slow
def test_signal_array_and_wavelet_variance_are_one(wv, ranking):
    signal = gmwm.Signal(simulated(), RATE, "rad/s", "gyro_x")
    for again in (gmwm.select(GENERAL, signal), gmwm.select(GENERAL, [wv])):
        assert again.to_dict() == ranking.to_dict()
    array = gmwm.select(GENERAL, simulated(), RATE)
    assert array.remarks == tuple(remark.about("") for remark in ranking.remarks)
    assert {**array.to_dict(), "remarks": []} == {**ranking.to_dict(), "remarks": []}


def test_what_is_held_is_in_every_candidate(wv):
    ranking = gmwm.select("GM + RW + WN(sigma2=fixed(4.0))", wv)
    assert len(ranking) == 3
    for candidate in ranking:
        assert "WN" in candidate.model.terms
        assert candidate.fit.parameters["WN.sigma2"] == 4.0
    assert ranking.recommended.parameters == 2
    assert ranking["GM + WN(sigma2=fixed(4.0))"] is ranking.recommended
    assert ranking.label(ranking.recommended) == "GM + WN(sigma2=fixed(4.0))"


def test_the_coefficients_of_a_filter_are_not_shown():
    wv = gmwm.wavelet_variance(gmwm.simulate_signal("WN(sigma2=4)", rate=100.0, samples=20_000, rng=1).signal)
    held = "MA(3, theta1=fixed(0.0123456789), theta2=fixed(0.0234567891), theta3=fixed(0.0345678912))"
    ranking = gmwm.select(f"RW + {held}", wv)
    assert {ranking.label(one) for one in ranking} == {"MA(3)", "RW", "RW + MA(3)"}
    assert "theta1" not in " ".join(cell for row in ranking.table()[1] for cell in row)
    twice = gmwm.rank([held, held.replace("0.0123", "0.0124")], wv)
    assert {twice.label(one) for one in twice} == {one.structure for one in twice}


def test_named_candidates_are_ranked_under_the_weights_of_their_union(wv, ranking):
    named = gmwm.rank(["WN + RW", gmwm.GM() + gmwm.WN(), "RW", "2*GM + WN + QN + RW"], wv)
    assert Counter(c.structure for c in named) == Counter(["WN + RW", "GM + WN", "RW", "2*GM + WN + QN + RW"])
    for candidate in named:
        assert candidate.wic.value == pytest.approx(ranking[candidate.model].wic.value, rel=1e-6)
    assert named.recommended.structure == "GM + WN"
    assert len(gmwm.rank(["WN + RW", "RW + WN"], wv)) == 1
    only = gmwm.rank(["WN + RW"], wv)
    assert only.best is only.recommended is only[0]
    assert only.best.difference == 0


def test_diagonal_weights(wv):
    ranking = gmwm.select("GM + WN + RW", wv, weighting="diagonal")
    assert ranking.weighting == "diagonal"
    assert np.count_nonzero(ranking.weighting_matrix) == len(wv)
    np.testing.assert_allclose(np.diag(ranking.weighting_matrix), 1 / np.diag(ranking.wavelet), rtol=1e-3)
    assert ranking.recommended.structure == "GM + WN"


@pytest.mark.slow
def test_several_recordings_are_ranked_by_the_loss_on_the_others(several):
    scores = [candidate.out_of_sample for candidate in several]
    assert all(score is not None for score in scores)
    assert [c.difference for c in several] == pytest.approx([score - scores[0] for score in scores])
    assert min(scores) == pytest.approx(scores[0], rel=1e-6)
    assert several.recommended.structure == "GM + WN"
    candidate = several["GM + WN"]
    one, two = candidate.fit.wavelet_variance.recordings.values()
    model = several.general.model
    losses = []
    for fitted, left_out in ((one, two), (two, one)):
        # Both halves have the same length, and so the same weights.
        weights = np.linalg.inv(wavelet_covariance(model, one.samples, RATE, levels=len(one)))
        implied = gmwm.fit("GM + WN", fitted, weighting=several.weighting_matrix[: len(one), : len(one)]).implied
        miss = left_out.variance - implied
        losses.append(miss @ weights @ miss)
    assert candidate.out_of_sample == pytest.approx(np.mean(losses), rel=1e-3)
    assert candidate.wic.loss == pytest.approx(candidate.fit.objective)
    assert several.to_dict()["recordings"] == 2
    assert "out of sample" in several.table()[0]


def test_recordings_of_two_lengths_have_the_levels_of_the_longer_one():
    ranking = gmwm.select("GM + WN", [simulated(20_000, 1), simulated(9_000, 2)], RATE)
    wv = ranking.best.fit.wavelet_variance
    assert (len(wv), wv.samples) == (14, 29_000)
    assert [len(one) for one in wv.recordings.values()] == [14, 13]
    assert ranking.recommended.structure == "GM + WN"


def test_a_disturbance_of_one_recording_is_not_modelled():
    x = [simulated(20_000, seed) for seed in (1, 2, 3)]
    x[0] = x[0] + np.cumsum(np.random.default_rng(4).normal(size=20_000)) * 0.02
    ranking = gmwm.select("GM + WN + RW", x, RATE)
    assert ranking.best.structure == "GM + WN"
    assert ranking["GM + WN"].out_of_sample < ranking["GM + WN + RW"].out_of_sample


def test_a_short_record_leaves_out_what_it_cannot_carry():
    x = simulated(64)
    ranking = gmwm.select("3*GM + WN + QN + RW", x, RATE)
    assert len(ranking.best.fit.wavelet_variance) == 6
    assert 0 < len(ranking) < 4 * 2 * 2 * 2 - 1
    for candidate in ranking:
        assert len(candidate.model.names) <= 6
    with raises(OptionError, "3*GM + WN"):
        ranking["3*GM + WN"]
    assert "3*GM" in {c.structure for c in ranking}


def test_robust():
    x = simulated()
    x[::1000] += 100.0
    ranking = gmwm.select("GM + WN + RW", x, RATE, robust=True, efficiency=0.5)
    assert ranking.best.fit.wavelet_variance.robust
    assert ranking.best.fit.wavelet_variance.efficiency == 0.5
    assert ranking.recommended.fit.parameters["WN.sigma2"] == pytest.approx(4.0, rel=0.2)


@pytest.mark.slow
def test_a_higher_confidence_never_has_fewer_equivalents(wv):
    counts = []
    for confidence in (0.5, 0.95, 0.999):
        ranking = gmwm.select(GENERAL, wv, confidence=confidence)
        assert ranking.confidence == confidence
        counts.append(ranking.recommended.parameters)
    assert counts == sorted(counts, reverse=True)


@pytest.mark.slow
def test_bootstrap_of_the_criterion_agrees_with_theory(wv):
    models = ["GM + WN", "WN"]
    drawn = gmwm.rank(models, wv, criterion="bootstrap", draws=400, rng=1)
    theory = gmwm.rank(models, wv)
    assert drawn.best.wic.method == "bootstrap"
    for candidate in drawn:
        # 2 tr[Cov Ω] of p parameters has a relative standard error of about √(2 / (p draws)) and more.
        assert candidate.wic.optimism == pytest.approx(theory[candidate.model].wic.optimism, rel=0.35)
        assert candidate.wic.loss == pytest.approx(theory[candidate.model].wic.loss, rel=1e-9)


def test_progress_is_told(wv):
    told = []
    gmwm.select("GM + WN + RW", wv, progress=lambda done, of: told.append((done, of)))
    assert told == [(k, 7) for k in range(1, 8)]


@pytest.mark.parametrize(
    ("argument", "value"),
    [
        ("weighting", "identity"),
        ("criterion", "aic"),
        ("confidence", 1.0),
        ("confidence", 0.05),
        ("confidence", float("nan")),
        ("draws", 99),
        ("draws", True),
        ("draws", 500.0),
        ("rng", -1),
    ],
)
def test_options_that_are_refused(wv, argument, value):
    for call, model in ((gmwm.select, "GM + WN"), (gmwm.rank, ["GM + WN"])):
        with raises(OptionError, argument=argument):
            call(model, wv, **{argument: value})


@pytest.mark.parametrize(("argument", "value"), [("rate", 50.0), ("robust", True)])
def test_options_that_contradict_the_wavelet_variance_are_refused(wv, argument, value):
    for call, model in ((gmwm.select, "GM + WN"), (gmwm.rank, ["GM + WN"])):
        with raises(OptionError, argument=argument):
            call(model, wv, **{argument: value})


@pytest.mark.parametrize(
    "models", [[], "GM + WN", gmwm.WN(), gmwm.WN() + gmwm.RW()], ids=["none", "text", "process", "model"]
)
def test_candidates_must_be_a_list(wv, models):
    with raises(OptionError, argument="models", got=models):
        gmwm.rank(models, wv)


@pytest.mark.parametrize(("models", "facts"), [(["WN", 3], [3]), (["WN", "8*GM"], ["8*GM", "16", "15 levels"])])
def test_candidates_that_are_refused(wv, models, facts):
    with raises(ModelError, *facts):
        gmwm.rank(models, wv)


@pytest.mark.parametrize(
    ("general", "words"),
    [
        ("WN(sigma2=fixed(4.0))", "fixed"),
        (
            "94*GM + GM(beta=fixed(1)) + GM(beta=fixed(2)) + GM(beta=fixed(3)) + WN + QN + RW",
            "5000",
        ),
    ],
)
def test_general_models_that_are_refused(wv, general, words):
    with raises(ModelError, words):
        gmwm.select(general, wv)


def test_data_that_are_refused(wv):
    with raises(ModelError, "constant"):
        gmwm.select("GM + WN", np.ones(1000), RATE)
    with raises(DataError, argument="data", got=[]):
        gmwm.select("GM + WN", [])
    with raises(DataError, "8 samples", argument="x"):
        gmwm.select("GM + WN", simulated(2), RATE)
    with raises(DataError, "100 Hz", "50 Hz"):
        gmwm.select("GM + WN", [wv, gmwm.wavelet_variance(gmwm.Signal(simulated(), 50.0, "rad/s", "gyro_x"))])
    with raises(DataError, "rad/s", "m/s²"):
        gmwm.select("GM + WN", [wv, gmwm.wavelet_variance(gmwm.Signal(simulated(), RATE, "m/s²", "accel_x"))])
    with raises(DataError, "classical", "robust"):
        gmwm.select("GM + WN", [wv, gmwm.wavelet_variance(gmwm.Signal(simulated(), RATE, "rad/s"), robust=True)])
    with raises(ModelError, "levels, 1"):
        gmwm.select("GM", gmwm.WaveletVariance.from_values([1.0], samples=1000, rate=RATE))


@pytest.mark.slow
@pytest.mark.parametrize("names", [("ARMA(1,1)", "GM + WN"), ("GM + WN", "ARMA(1,1)")])
def test_of_two_names_for_one_curve_the_first_is_recommended(names):
    x = gmwm.Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0)").simulate(4000, RATE, rng=2)
    ranking = gmwm.rank(names, x, RATE, draws=100)
    assert tuple(c.structure for c in ranking) == names
    assert [(c.equivalent, c.recommended) for c in ranking] == [(True, True), (True, False)]
    assert ranking[1].difference == pytest.approx(0, abs=1e-6 * ranking[0].wic.value)
