"""Classical or robust: what the test of contamination says of clean, spoilt and rounded recordings."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Severity, texts
from gmwm.measuring.outliers import Verdict, contamination
from tests.helpers import codes, only, raises

RATE = 100.0
MODEL = "GM(beta=0.5, sigma2=0.1) + WN(sigma2=1.0)"


def clean(samples: int = 50_000, seed: int = 1, text: str = MODEL) -> np.ndarray:
    return gmwm.Model.parse(text).simulate(samples, RATE, rng=seed)


def knocked(samples: int = 50_000) -> np.ndarray:
    x = clean(samples)
    x[samples // 2 : samples // 2 + 200] += 20 * np.random.default_rng(2).standard_normal(200)
    return x


def measured(x: np.ndarray, efficiency: float = 0.6) -> tuple[gmwm.WaveletVariance, gmwm.WaveletVariance]:
    return gmwm.wavelet_variance(x, RATE), gmwm.wavelet_variance(x, RATE, robust=True, efficiency=efficiency)


@pytest.mark.slow
@pytest.mark.parametrize(
    "text", [MODEL, "WN(sigma2=1.0) + RW(gamma2=1e-4)", "QN(q2=1.0)", "WN(sigma2=1.0) + DR(omega=1e-2)"]
)
@pytest.mark.parametrize("efficiency", [0.6, 0.9])
def test_clean_recordings_are_clean(text: str, efficiency: float) -> None:
    for seed in range(10):
        verdict = contamination(clean(20_000, seed, text), RATE, efficiency=efficiency, size=0.01)
        assert not verdict.contaminated
        assert verdict.tested.sum() >= 8


@pytest.mark.slow
def test_of_true_nulls_as_many_are_rejected_as_stated() -> None:
    # With nothing put up with the size is nearly the stated one: levels have little to do with each other.
    found = [contamination(clean(8192, seed), RATE, size=0.2, tolerance=0.0).exceeds for seed in range(250)]
    assert 0.2 - 4 * 0.025 - 0.03 < np.mean(found) < 0.2 + 4 * 0.025


@pytest.mark.parametrize("efficiency", [0.6, 0.9])
def test_knocks_are_found_where_they_are(efficiency: float) -> None:
    verdict = contamination(knocked(), RATE, comparisons=6, efficiency=efficiency)
    assert verdict.contaminated
    assert verdict.pvalue < 1e-6
    # Of white noise for two seconds: felt by the finest levels, not by those beyond its length.
    assert verdict.exceeding[:4].all()
    assert not verdict.exceeding[10:].any()
    remark = only(verdict.remarks, "outliers-found:test")
    assert remark.severity is Severity.BIASED
    assert [tau.value for tau in remark.facts["taus"]] == verdict.tau[verdict.exceeding].tolist()
    assert remark.facts["tau"].value == verdict.tau[np.argmax(np.where(verdict.exceeding, verdict.excess, -1.0))]
    assert remark.facts["p"] == verdict.pvalue
    assert verdict.summary() == "\n".join(texts(verdict.remarks))


def test_the_verdict_is_consistent_in_itself() -> None:
    for x in (clean(), knocked()):
        verdict = contamination(x, RATE, comparisons=3)
        tested = verdict.tested
        share = verdict.size / 3 / tested.sum()
        assert np.array_equal(verdict.exceeding[tested], verdict.pvalues[tested] <= share)
        assert verdict.contaminated == verdict.exceeding.any()
        assert verdict.pvalue == pytest.approx(min(1.0, 3 * tested.sum() * verdict.pvalues[tested].min()))
        assert np.isnan(verdict.pvalues[~tested]).all()
        assert set(verdict.left_out) == set(verdict.levels[~tested].tolist())


def test_a_pair_says_what_its_recording_says() -> None:
    x = knocked()
    pair = contamination(measured(x), comparisons=6)
    signal = contamination(gmwm.Signal(x, RATE, axis="gyro_x", unit="rad/s"), comparisons=6)
    assert pair.to_dict() == replace(signal, axis="", bursts=None).to_dict()
    assert signal.to_dict()["remarks"] == [remark.to_dict() for remark in signal.remarks]
    assert pair.bursts is None
    assert signal.bursts is not None
    assert signal.bursts.found
    assert signal.remarks == tuple(remark.about("gyro_x") for remark in pair.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_units_change_nothing(scale: float) -> None:
    one, other = contamination(knocked(), RATE), contamination(scale * knocked(), RATE)
    assert other.pvalues == pytest.approx(one.pvalues, rel=1e-3, nan_ok=True)
    assert codes(other.remarks) == codes(one.remarks)
    assert np.array_equal(other.exceeding, one.exceeding)


def test_coarse_steps_are_left_out_and_raise_no_alarm() -> None:
    x = clean(text="WN(sigma2=1.0) + RW(gamma2=1e-4)")
    for step, ruled in ((1.0, 0), (2.0, 4), (4.0, 15)):
        verdict = contamination(step * np.rint(x / step), RATE)
        assert not verdict.contaminated
        assert list(verdict.left_out.values()).count("rounded") == ruled
    assert verdict.pvalue == 1
    assert codes(verdict.remarks) == ["outliers-not-tested:test"]
    # What the test would say if the steps were not seen: that they are left out is what keeps it from a false alarm.
    classical, robust = measured(4.0 * np.rint(x / 4.0))
    assert contamination((classical, replace(robust, diagnostics={}))).contaminated


def test_the_steps_of_an_angle_are_seen_at_the_level_that_shows_them() -> None:
    # A mean rate of half a step an interval: neighbours seldom agree, every second one does.
    angle = np.cumsum(np.random.default_rng(11).standard_normal(20_000) / 4 + 0.5)
    verdict = contamination(np.diff(np.rint(angle)), RATE)
    assert not verdict.contaminated
    rounded = list(verdict.left_out.values()).count("rounded")
    assert rounded > 0
    assert only(verdict.remarks, "outliers-not-tested:levels").facts["count"] == rounded


def test_rounding_makes_the_robust_one_larger() -> None:
    verdict = contamination(clean(text="QN(q2=1.0)"), RATE)
    assert verdict.lighter[:3].all()
    remark = only(verdict.remarks, "robust-too-large:larger")
    assert [tau.value for tau in remark.facts["taus"]] == verdict.tau[verdict.lighter].tolist()
    assert remark.facts["share"] == -verdict.excess[verdict.lighter].min()
    assert not contamination(clean(), RATE).lighter.any()


def test_recordings_that_cannot_be_tested_say_why() -> None:
    few, nothing = contamination(clean(40), RATE), contamination(np.zeros(1000), RATE)
    assert not few.contaminated
    assert few.pvalue == 1
    assert set(few.left_out.values()) == {"few"}
    assert only(few.remarks, "outliers-not-tested:test").facts["reason"] == "few"
    assert set(nothing.left_out.values()) == {"nothing"}
    assert only(nothing.remarks, "outliers-not-tested:test").facts["reason"] == "nothing"
    assert not contamination(np.arange(5000.0), RATE).contaminated


def test_so_many_outliers_that_no_robust_variance_is_left_are_found() -> None:
    x = clean()
    x[::10] *= 1e4
    verdict = contamination(x, RATE)
    assert "mad" in measured(x)[1].diagnostics["robust"]["outcome"]
    assert verdict.contaminated


def test_a_model_may_be_given() -> None:
    given, found = contamination(clean(), RATE, model=MODEL), contamination(clean(), RATE)
    assert given.standard_errors == pytest.approx(found.standard_errors, rel=0.1, nan_ok=True)
    assert not np.array_equal(given.standard_errors, found.standard_errors)


def test_there_and_back_through_json() -> None:
    for x in (clean(), knocked(), np.zeros(100)):
        verdict = contamination(x, RATE)
        text = json.dumps(verdict.to_dict(), allow_nan=False)
        again = Verdict.from_dict(json.loads(text))
        assert again.to_dict() == verdict.to_dict()
        assert again.remarks == verdict.remarks
        assert again.levels.dtype == np.int64
    with raises(gmwm.errors.OptionError, argument="left_out", got="bad weather"):
        Verdict.from_dict(verdict.to_dict() | {"left_out": {"1": "bad weather"}})


def test_wrong_arguments_are_named() -> None:
    classical, robust = measured(clean(1000))
    other = measured(clean(2000))
    for wrong in (
        (robust, classical),
        (classical, classical),
        (classical, robust, robust),
        classical,
        (classical, 3.0),
    ):
        with raises(gmwm.errors.DataError, argument="x"):
            contamination(wrong)
    with raises(gmwm.errors.DataError, argument="x"):
        contamination((classical, other[1]))
    pair = tuple(gmwm.wavelet_variance(clean(1000), RATE, filter="d4", robust=wanted) for wanted in (False, True))
    with raises(gmwm.errors.OptionError, "Haar MODWT"):
        contamination(pair)
    with raises(gmwm.errors.OptionError, argument="rate", got=50.0):
        contamination((classical, robust), rate=50.0)
    for name, value in {"size": 0.0, "comparisons": 0, "tolerance": -0.1}.items():
        with raises(gmwm.errors.OptionError, argument=name, got=value):
            contamination((classical, robust), **{name: value})
