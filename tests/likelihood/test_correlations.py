"""Autocorrelations of recordings and models, and comparison of models by their predictions."""

from __future__ import annotations

import numpy as np
import pytest
from gmwm.errors import MissingTheoryError, ModelError, OptionError
from gmwm.likelihood import autocorrelation, evaluate
from scipy.linalg import toeplitz
from scipy.signal import lfilter

import gmwm

ARMA = "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=4)"


def recording(samples: int, seed: int) -> np.ndarray:
    noise = 2.0 * np.random.default_rng(seed).standard_normal(samples + 500)
    return lfilter([1.0, 0.5], [1.0, -0.9, 0.3], noise)[500:]


def partial_by_regression(r: np.ndarray) -> np.ndarray:
    """The last coefficient of the best predictor from k values, from the Yule-Walker equations."""
    return np.array([1.0, *(np.linalg.solve(toeplitz(r[:k]), r[1 : k + 1])[-1] for k in range(1, r.size))])


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_an_array_has_one_sample_a_second_if_nothing_else_is_said():
    x = recording(400, 5)
    result = evaluate(["WN", "AR(1)"], x)
    assert list(result) == list(evaluate(["WN", "AR(1)"], x, 1.0).forecasts)
    assert gmwm.fit_ml("AR(1)", x).parameters == gmwm.fit_ml("AR(1)", x, 1.0).parameters
    figure = gmwm.plots.plot_autocorrelation(x, robust=True, model=gmwm.fit_ml("AR(1)", x))
    assert figure.axes[0].get_ylabel() == "Autocorrelation"


def test_theory_agrees_with_the_impulse_response_and_with_yule_walker():
    impulse = np.zeros(2000)
    impulse[0] = 1.0
    response = lfilter([1.0, 0.5], [1.0, -0.9, 0.3], impulse)
    expected = np.array([response[: 2000 - k] @ response[k:] for k in range(13)])
    r = autocorrelation(ARMA, 12)
    assert r == pytest.approx(expected / expected[0], abs=1e-12)
    assert autocorrelation(ARMA, 12, partial=True) == pytest.approx(partial_by_regression(r), abs=1e-10)
    assert autocorrelation("GM(beta=2, sigma2=3)", 2, rate=10.0) == pytest.approx(np.exp([0.0, -0.2, -0.4]))
    assert autocorrelation("WN(sigma2=1)").size == 41


def test_a_recording_agrees_with_theory():
    x = recording(200_000, 1)
    for options in ({}, {"partial": True}, {"robust": True}, {"robust": True, "partial": True}):
        theory = autocorrelation(ARMA, 10, partial=options.get("partial", False))
        assert autocorrelation(x, 10, **options) == pytest.approx(theory, abs=0.015)
    assert autocorrelation(x).size == 54
    gapped = x.copy()
    gapped[::7] = np.nan
    for data in (gapped, gmwm.Signal.from_missing(gapped, 100.0)):
        assert autocorrelation(data, 6) == pytest.approx(autocorrelation(ARMA, 6), abs=0.02)


def test_the_robust_estimate_is_as_precise_and_less_changed_by_outliers():
    theory = autocorrelation(ARMA, 1)[1]
    plain, robust, changed, held = [], [], [], []
    for seed in range(200):
        x = recording(500, seed)
        plain.append(autocorrelation(x, 1)[1])
        robust.append(autocorrelation(x, 1, robust=True)[1])
        x[np.random.default_rng(seed).random(x.size) < 0.01] += 100.0
        changed.append(autocorrelation(x, 1)[1])
        held.append(autocorrelation(x, 1, robust=True)[1])
    assert np.std(robust) < 1.1 * np.std(plain)
    assert np.mean(changed) < 0.3 * theory
    assert np.mean(held) > 0.9 * theory


def test_what_has_no_autocorrelation_is_refused():
    with pytest.raises(MissingTheoryError):
        autocorrelation("RW(gamma2=1)")
    with pytest.raises(ModelError, match="zero"):
        autocorrelation("WN(sigma2=0)")
    for data, options in ((ARMA, {"robust": True}), (np.arange(10.0), {"lags": 10}), (ARMA, {"lags": 0})):
        with pytest.raises(OptionError):
            autocorrelation(data, **options)


def test_predictions_are_those_of_the_recursion():
    x = recording(4000, 3) + 10.0
    result = evaluate(["WN", "ARMA(2,1)", "AR(1)"], x, 1.0, start=0.75)
    assert list(result.forecasts) == ["ARMA(2,1)", "AR(1)", "WN"]
    fit = result["AR(1)"].fit
    phi, mean = fit.parameters["AR(1).phi1"], np.mean(x[:3000])
    errors = (x[3000:] - mean) - phi * (x[2999:-1] - mean)
    assert result["AR(1)"].deviation == pytest.approx(np.sqrt(fit.parameters["AR(1).sigma2"]))
    assert result["AR(1)"].median_error == pytest.approx(np.median(np.abs(errors)))
    assert result["AR(1)"].rms_error == pytest.approx(np.sqrt(np.mean(errors**2)))
    best = result[result.best]
    assert best.rms_error == pytest.approx(2.0, rel=0.05)
    assert best.median_error == pytest.approx(2.0 * 0.6745, rel=0.08)
    assert best.coverage() == pytest.approx(0.95, abs=0.02)
    assert best.score == pytest.approx(-0.5 * np.log(2 * np.pi * np.e * 4.0), abs=0.05)
    assert "median error" in result.summary()


def test_a_walk_and_missing_samples_are_predicted():
    rng = np.random.default_rng(4)
    x = np.cumsum(0.3 * rng.standard_normal(2000)) + rng.standard_normal(2000)
    x[rng.random(x.size) < 0.1] = np.nan
    result = evaluate(["WN", "WN + RW"], gmwm.Signal.from_missing(x, 1.0))
    assert result.best == "WN + RW"
    assert result["WN + RW"].coverage() == pytest.approx(0.95, abs=0.03)


def test_options_of_an_evaluation_are_checked():
    for models, options in ((["WN"], {"start": 1.0}), (["WN"], {"start": 0}), ([], {})):
        with pytest.raises(OptionError):
            evaluate(models, recording(100, 1), 1.0, **options)
