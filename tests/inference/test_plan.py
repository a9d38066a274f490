"""`gmwm.plan`: errors before a recording is made, and the length that a wanted error takes."""

import json
import math

import numpy as np
import pytest

import gmwm
from gmwm import DR, GM, QN, RW, WN
from gmwm.base.errors import ModelError, OptionError
from gmwm.base.text import duration_text
from gmwm.fitting.estimation.asymptotic import sandwich, sandwich_of
from gmwm.measuring.covariance import Design, covariance
from tests.helpers import only, raises

RATE = 100.0
MODELS = {
    "walk": WN(sigma2=4e-6) + RW(gamma2=1e-10),
    "markov": GM(beta=8.0, sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=4e-10),
    "drift": DR(omega=2e-8) + WN(sigma2=4e-6) + RW(gamma2=1e-12),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("weighting", ["diagonal", "optimal"])
def test_the_length_needed_is_the_shortest_from_which_on_the_error_is_small_enough(name, weighting):
    plan = gmwm.plan(MODELS[name], duration=600.0, rate=RATE, weighting=weighting)
    for accuracy in (0.03, 0.3):
        for parameter, seconds in plan.needed(accuracy).items():
            assert plan.at(1.01 * seconds)[parameter] <= accuracy
            beyond = [plan.at(factor * seconds)[parameter] for factor in np.geomspace(1.02, 8.0, 10)]
            assert max(beyond) <= 1.01 * accuracy
            if 0.98 * seconds > plan.durations[0]:
                assert plan.at(0.98 * seconds)[parameter] > accuracy


@pytest.mark.slow
def test_a_fit_of_that_length_has_these_errors():
    truth, samples = MODELS["markov"], 50_000
    variance = truth.wavelet_variance(15, RATE)
    for weighting in ("diagonal", "optimal"):
        fit = gmwm.fit(truth.structure, gmwm.WaveletVariance.from_values(variance, samples, RATE), weighting=weighting)
        found = sandwich(fit)
        planned = gmwm.plan(truth, duration=samples / RATE, rate=RATE, weighting=weighting).at(samples / RATE)
        assert found.names == tuple(planned)
        np.testing.assert_allclose(np.sqrt(np.diag(found.relative)), list(planned.values()), rtol=1e-3)


def test_white_noise_alone_has_the_textbook_error():
    # Of any weights Ω: D = ν²/σ², so that Var σ̂²/σ⁴ = νᵀΩVΩν / (νᵀΩν)², and optimal ones reach 2/N nearly.
    samples = 4096
    design = Design(np.arange(1, 13), samples, RATE)
    wavelet, nu = covariance(gmwm.Model((WN(sigma2=3.0),)), design), 3.0 / 2.0 ** np.arange(1, 13)
    weights = nu / np.diag(wavelet)
    expected = math.sqrt(weights @ wavelet @ weights) / (weights @ nu)
    plan = gmwm.plan(WN(sigma2=3.0), duration=samples / RATE, rate=RATE)
    assert plan.at(samples / RATE)["WN.sigma2"] == pytest.approx(expected, rel=1e-9)
    best = gmwm.plan(WN(sigma2=3.0), duration=samples / RATE, rate=RATE, weighting="optimal")
    best = best.at(samples / RATE)["WN.sigma2"]
    assert math.sqrt(2 / samples) <= best <= 1.01 * math.sqrt(2 / samples)


@pytest.mark.parametrize("scale", [1e-100, 1e-12, 1.0, 1e12, 1e100])
def test_errors_do_not_know_the_unit(scale):
    model = GM(beta=8.0, sigma2=scale) + WN(sigma2=4 * scale)
    plain = gmwm.plan(GM(beta=8.0, sigma2=1.0) + WN(sigma2=4.0), duration=60.0, rate=RATE)
    scaled = gmwm.plan(model, duration=60.0, rate=RATE)
    for name, curve in plain.errors.items():
        np.testing.assert_allclose(scaled.errors[name], curve, rtol=1e-9)


@pytest.mark.slow
def test_the_curve_runs_from_the_shortest_record_to_the_planned_one():
    plan = gmwm.plan(MODELS["markov"], duration=7200.0, rate=RATE)
    assert list(plan.errors) == ["GM.beta", "GM.sigma2", "WN.sigma2", "RW.gamma2"]
    assert plan.durations[0] == 32 / RATE
    assert plan.durations[-1] == plan.duration == 7200.0
    assert np.all(np.diff(plan.durations) > 0)
    assert np.all(plan.durations[1:] / plan.durations[:-1] < 1.4)
    for name, curve in plan.errors.items():
        assert curve.shape == plan.durations.shape
        assert curve[-1] == plan.at(7200.0)[name]
        assert not curve.flags.writeable
    with pytest.raises(TypeError):
        plan.errors["GM.beta"] = plan.durations


@pytest.mark.slow
def test_held_parameters_are_known():
    free = gmwm.plan(MODELS["markov"], duration=600.0, rate=RATE).at(600.0)
    held = gmwm.plan("GM(beta=fixed(8.0), sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=4e-10)", duration=600.0, rate=RATE)
    held = held.at(600.0)
    assert list(held) == ["GM.sigma2", "WN.sigma2", "RW.gamma2"]
    assert held["GM.sigma2"] < free["GM.sigma2"]


@pytest.mark.slow
def test_optimal_weights_lose_nothing():
    for model in MODELS.values():
        diagonal, optimal = (
            gmwm.plan(model, duration=600.0, rate=RATE, weighting=w).errors for w in ("diagonal", "optimal")
        )
        for name, curve in optimal.items():
            assert np.all(curve <= diagonal[name] * (1 + 1e-6))


@pytest.mark.slow
def test_an_uncertain_parameter_has_a_remark():
    plan = gmwm.plan(MODELS["walk"], duration=60.0, rate=RATE, unit="rad/s")
    assert 0.5 < plan.at(60.0)["RW.gamma2"] < math.inf
    text = plan.summary(0.2)
    remark = only(plan.remarks, "poorly-known:plan")
    assert (remark.facts["parameters"], remark.facts["duration"].value) == (("RW.gamma2",), 60.0)
    assert remark.text() in text
    assert "(rad/s)² per sample" in text
    row = next(line for line in text.splitlines() if "RW.gamma2" in line)
    assert row.split("  ")[-1].strip() == duration_text(plan.needed(0.2)["RW.gamma2"]) == "7.9 min"
    long = gmwm.plan(MODELS["walk"], duration=7200.0, rate=RATE)
    assert long.remarks == ()
    assert "5.2 %" in long.summary()


def test_parameters_with_the_same_effect_have_a_remark():
    plan = gmwm.plan(GM(beta=1e6, sigma2=1e-6) + WN(sigma2=1e-6) + RW(gamma2=1e-10), duration=600.0, rate=RATE)
    errors = plan.at(600.0)
    assert math.isinf(errors["WN.sigma2"])
    assert math.isinf(errors["GM.sigma2"])
    assert math.isfinite(errors["RW.gamma2"])
    assert math.isinf(plan.needed()["WN.sigma2"])
    text = plan.summary()
    remark = only(plan.remarks, "poorly-known:impossible")
    assert remark.facts["parameters"] == ("GM.beta", "GM.sigma2", "WN.sigma2")
    assert remark.facts["duration"].value == 600.0
    assert remark.text() in text
    assert "> 69 d" in text


def test_a_plan_that_is_out_of_reach_is_infinite():
    plan = gmwm.plan(WN(sigma2=1.0), duration=1.0, rate=RATE)
    assert math.isinf(plan.needed(1e-6)["WN.sigma2"])
    assert plan.needed(0.5)["WN.sigma2"] >= plan.durations[0]


def test_as_plain_numbers_and_in_a_notebook():
    plan = gmwm.plan(MODELS["walk"], duration=60.0, rate=RATE)
    content = json.loads(json.dumps(plan.to_dict()))
    assert content["errors"]["RW.gamma2"] == plan.errors["RW.gamma2"].tolist()
    assert content["planned"] == plan.at(60.0)
    assert gmwm.Model.parse(content["model"]) == plan.model
    assert content["parameters"] == plan.model.parameters
    assert "<pre>Relative standard errors of WN + RW" in plan._repr_html_()
    assert repr(plan) == "Plan(WN + RW, 60 s at 100 Hz)"


@pytest.mark.parametrize(
    ("model", "error", "facts", "advice"),
    [
        ("WN(sigma2=1.0) + RW", ModelError, ["RW.gamma2"], "RW(gamma2=…)"),
        ("2*GM + WN", ModelError, ["GM[1].beta, GM[1].sigma2, "], "GM(beta=…, sigma2=…)"),
        ("WN(sigma2=1e-300) + RW(gamma2=1e-308)", ModelError, ["double precision"], "unit"),
        ("WN(sigma2=1e-150)", ModelError, ["double precision"], "unit"),
        ("WN(sigma2=1e200)", ModelError, ["double precision"], "unit"),
        ("WN(sigma2=1e140) + RW(gamma2=1e140)", ModelError, ["double precision"], "unit"),
        (WN(sigma2=1.0) + RW(gamma2=0.0), ModelError, ["RW is zero"], "Leave it out"),
        (2 * GM(beta=1.0, sigma2=0.0) + WN(sigma2=1.0), ModelError, ["GM[1], GM[2] is zero"], "Leave it out"),
        ("WN(sigma2=fixed(1.0))", ModelError, ["WN(sigma2=fixed(1.0))", "fixed"], "fixed("),
        ("GM(beta=1.0, sigma2=fixed(1.0)) + WN(sigma2=1.0)", ModelError, ["sigma2 is fixed while beta"], "Fix beta"),
        (DR(omega=1.0), ModelError, ["no noise at some level"], "WN"),
    ],
)
def test_models_that_cannot_be_planned(model, error, facts, advice):
    with raises(error, *facts, advises=[advice]):
        gmwm.plan(model, duration=60.0, rate=RATE)


@pytest.mark.parametrize(
    ("duration", "fact"),
    [(0.0, "positive"), (math.nan, "positive"), ("1h", "number"), (True, "number"), (0.07, "0.08 s (8 samples"),
     (1e12, "2^40")],
)  # fmt: skip
def test_durations_that_cannot_be_planned(duration, fact):
    with raises(OptionError, fact, argument="duration") as caught:
        gmwm.plan(MODELS["walk"], duration=duration, rate=RATE)
    assert caught.value.got is duration
    with raises(OptionError, fact, argument="duration"):
        gmwm.plan(MODELS["walk"], duration=60.0, rate=RATE).at(duration)


def test_a_class_is_not_a_model():
    with raises(ModelError, "WN", argument="model"):
        gmwm.plan(WN, duration=60.0, rate=RATE)


def test_options_that_are_none():
    plan = gmwm.plan(QN(q2=1.0) + WN(sigma2=1.0), duration=60.0, rate=RATE)
    for accuracy in (0.0, -0.1, 0.51, math.nan, "10 %", True):
        with raises(OptionError, 0.5, argument="accuracy"):
            plan.needed(accuracy)
    with raises(OptionError, "'diagonal' or 'optimal'", argument="weighting", got="identity"):
        gmwm.plan(WN(sigma2=1.0), duration=60.0, rate=RATE, weighting="identity")
    with raises(OptionError, "rate", -1):
        gmwm.plan(WN(sigma2=1.0), duration=60.0, rate=-1.0)


def test_duration_and_rate_are_named():
    with pytest.raises(TypeError):
        gmwm.plan(MODELS["walk"], 60.0, RATE)


def lossy(lost, samples=40_000, seed=3):
    rng = np.random.default_rng(seed)
    x = rng.normal(0.0, 2e-3, samples) + np.cumsum(rng.normal(0.0, 1e-5, samples))
    x[lost] = np.nan
    return gmwm.Signal.from_missing(x, RATE, "rad/s", "gyro_x")


def test_a_plan_repeats_the_gaps_of_a_pilot_recording():
    lost = np.zeros(40_000, dtype=bool)
    lost[100:-100:200] = True
    lost[20_000:30_000] = True  # is not filled
    curve = gmwm.wavelet_variance(lossy(lost))
    assert curve.filled > 100
    assert len(curve.segments) >= 2
    model = MODELS["walk"]
    plan = gmwm.plan(model, duration=curve.samples / RATE, rate=RATE, pilot=curve)
    # The errors are those of a fit to the pilot recording.
    design = Design.of(curve)
    weights = np.diag(1 / np.diag(covariance(model, design)))
    exact = np.sqrt(np.diag(sandwich_of(model, design, weights, covariance(model, design)).relative))
    assert list(plan.at(curve.samples / RATE).values()) == pytest.approx(exact.tolist(), rel=1e-9)
    # Four times as long: four repetitions, with half the errors, at the same scales.
    assert list(plan.at(4 * curve.samples / RATE).values()) == pytest.approx((exact / 2).tolist(), rel=1e-4)
    without = gmwm.plan(model, duration=curve.samples / RATE, rate=RATE)
    assert plan.at(200.0)["RW.gamma2"] >= without.at(200.0)["RW.gamma2"]
    assert only(plan.remarks, "plan-gaps").facts["kind"] == "cut"
    assert plan.needed(0.3)["RW.gamma2"] >= without.needed(0.3)["RW.gamma2"]
    assert plan.to_dict()["losses"]["segments"] == list(curve.segments)


def test_filled_samples_count_less():
    lost = np.random.default_rng(1).random(40_000) < 0.1
    lost[:100] = lost[-100:] = False
    curve = gmwm.wavelet_variance(lossy(lost))
    assert curve.segments == ()
    share = curve.filled / curve.samples
    found = gmwm.plan(MODELS["walk"], duration=600.0, rate=RATE, pilot=curve)
    plain = gmwm.plan(MODELS["walk"], duration=600.0, rate=RATE)
    for name, error in plain.at(600.0).items():
        assert found.at(600.0)[name] == pytest.approx(error * math.sqrt(1 + 2.5 * share), rel=1e-3)
    assert only(found.remarks, "plan-gaps").facts["share"] == share


def test_a_pilot_recording_of_short_segments_only_is_an_error():
    lost = np.zeros(40_000, dtype=bool)
    lost[np.arange(40_000) % 40 >= 12] = True
    curve = gmwm.wavelet_variance(lossy(lost), levels=3)
    with raises(OptionError, argument="pilot"):
        gmwm.plan(MODELS["markov"], duration=600.0, rate=RATE, pilot=curve)
