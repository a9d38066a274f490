"""Standardised innovations: white and normal at the truth; their tests against statsmodels and direct sums."""

import numpy as np
import pytest
from scipy.stats import chi2, jarque_bera, kstest
from statsmodels.stats.diagnostic import acorr_ljungbox
from statsmodels.tsa.stattools import acf

from gmwm import Model, fit_ml
from gmwm.base.errors import OptionError
from gmwm.fitting.likelihood import Residuals
from gmwm.fitting.likelihood.problem import LikelihoodProblem, as_record
from tests.helpers import raises

RATE = 100.0
MODEL = Model.parse("GM(beta=2.0, sigma2=2.0) + WN(sigma2=1.0) + RW(gamma2=1e-3)")


def of(values, **more):
    return Residuals(
        model=MODEL, values=np.array(values, dtype=float), rate=RATE, times=np.arange(len(values)) / RATE, **more
    )


@pytest.mark.parametrize(
    "text",
    [
        "GM(beta=2.0, sigma2=2.0) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
        "AR(2, phi1=1.4, phi2=-0.6, sigma2=4.0)",
        "MA(1, theta1=0.9, sigma2=1e-6) + RW(gamma2=1e-9)",
    ],
)
@pytest.mark.parametrize("gaps", [False, True])
def test_they_are_white_and_normal_at_the_truth(text, gaps):
    model = Model.parse(text)
    x = 9.81 + model.simulate(20_000, RATE, rng=1)
    if gaps:
        x[[*range(0, 20_000, 53), *range(500, 900)]] = np.nan
    found = model.residuals(x, RATE)
    assert found.estimated == 0
    np.testing.assert_array_equal(np.isnan(found.values), np.isnan(x))
    assert kstest(found.observed, "norm").pvalue > 1e-3
    assert found.ljung_box().p_value > 1e-3
    assert found.normality().p_value > 1e-3
    assert found.ljung_box().degrees_of_freedom == found.ljung_box().lags == found.usual_lags


def test_a_wrong_model_is_seen():
    x = MODEL.simulate(20_000, RATE, rng=2)
    assert Model.parse("WN(sigma2=3.0)").residuals(x, RATE).ljung_box().p_value < 1e-12
    heavy = np.random.default_rng(3).standard_t(4, 20_000)
    found = Model.parse("WN(sigma2=2.0)").residuals(heavy, RATE)
    assert found.normality().p_value < 1e-12
    assert found.ljung_box().p_value > 1e-3


def test_squares_of_residuals_and_variances_are_the_likelihood():
    x = MODEL.simulate(3000, RATE, rng=4)
    at = LikelihoodProblem(MODEL, as_record(x, RATE))
    z = MODEL.residuals(x, RATE).values
    # The information of the level counts beside them.
    value, level = at.value(MODEL)
    scaled = Model.parse("GM(beta=2.0, sigma2=4.0) + WN(sigma2=2.0) + RW(gamma2=2e-3)")
    half = at.value(scaled)[0]
    # Twice the variances: each of the N − 1 contrasts loses ½ log 2, and half of the squares comes back.
    assert half - value == pytest.approx(0.25 * np.sum(z**2) - 0.5 * (x.size - 1) * np.log(2), rel=1e-9)
    assert level.labels == ("RW",)


def test_autocorrelation_and_ljung_box_are_those_of_statsmodels():
    x = MODEL.simulate(2000, RATE, rng=5)
    found = MODEL.residuals(x, RATE)
    np.testing.assert_allclose(found.acf(40), acf(found.values, nlags=40, fft=False), atol=1e-12)
    for taken in (0, 3):
        theirs = acorr_ljungbox(found.values, lags=[7, 25], model_df=taken)
        for lags, row in zip((7, 25), theirs.itertuples(), strict=True):
            check = of(found.values, estimated=taken).ljung_box(lags)
            assert check.statistic == pytest.approx(row.lb_stat, rel=1e-10)
            assert check.p_value == pytest.approx(row.lb_pvalue, rel=1e-8)
            assert (check.lags, check.degrees_of_freedom) == (lags, lags - taken)


def test_pairs_with_a_missing_sample_do_not_count():
    z = np.random.default_rng(6).standard_normal(300)
    z[[0, 5, 6, *range(100, 180), 299]] = np.nan
    seen = z[np.isfinite(z)] - np.nanmean(z)
    centred = np.where(np.isfinite(z), z - np.nanmean(z), 0.0)
    direct = [sum(centred[t] * centred[t - k] for t in range(k, 300)) / np.sum(seen**2) for k in range(11)]
    np.testing.assert_allclose(of(z).acf(10), direct, atol=1e-13)


@pytest.mark.slow
def test_the_test_has_its_distribution_where_samples_are_missing():
    checks = []
    for seed in range(400):
        rng = np.random.default_rng(seed)
        checks.append(of(np.where(rng.random(2000) < 0.5, np.nan, rng.normal(size=2000))).ljung_box(30))
    # Mean 30 and variance 60 of a chi-square.
    assert abs(np.mean([check.statistic for check in checks]) - 30) < 4 * np.sqrt(60 / 400)
    assert abs(np.mean([check.p_value < 0.05 for check in checks]) - 0.05) < 4 * np.sqrt(0.05 * 0.95 / 400)
    every_other = np.random.default_rng(1).normal(size=2000)
    every_other[::2] = np.nan
    assert of(every_other).ljung_box(30).degrees_of_freedom == 15


def test_normality_is_scipy_s():
    z = np.random.default_rng(7).standard_gamma(5.0, 500)
    expected = jarque_bera(z)
    check = of(z).normality()
    assert check.statistic == pytest.approx(expected.statistic, rel=1e-12)
    assert check.p_value == pytest.approx(expected.pvalue, rel=1e-8)


def test_quantiles_lie_on_a_line():
    z = np.random.default_rng(8).standard_normal(100_000)
    expected, seen = of(z).quantiles()
    assert np.all(np.diff(expected) > 0)
    assert np.all(np.diff(seen) >= 0)
    assert (seen[0], seen[-1]) == (z.min(), z.max())
    inner = np.abs(expected) < 2
    assert np.max(np.abs(seen - expected)[inner]) < 0.03


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*of its correlation times:gmwm.errors.FitWarning")
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_estimates_take_as_many_degrees_of_freedom_as_they_have_shapes():
    # An autoregression shows at short lags: both of its coefficients, but not its variance.
    model = Model.parse("AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0)")
    found = fit_ml("AR(2)", model.simulate(20_000, RATE, rng=9), RATE)
    degrees = found.residuals(model.simulate(20_000, RATE, rng=9)).ljung_box(40).degrees_of_freedom
    assert degrees == pytest.approx(38, abs=0.1)
    # A slow process is estimated from lags of which the test sees but a few.
    slow = Model.parse("GM(beta=0.1, sigma2=0.5) + WN(sigma2=1.0)")
    x = slow.simulate(20_000, RATE, rng=10)
    found = fit_ml("GM + WN", x, RATE)
    residuals = found.residuals(x)
    assert 42 < residuals.ljung_box(43).degrees_of_freedom < 43
    assert 40.9 < residuals.ljung_box(43).degrees_of_freedom + np.sum(residuals.spent) < 46
    assert np.all(residuals.spent >= 0)
    with raises(OptionError, "3 estimated parameters", argument="lags", got=3):
        residuals.ljung_box(3)


@pytest.mark.slow
def test_the_test_of_a_fit_rejects_as_often_as_it_says():
    model = Model.parse("AR1(phi=0.5, sigma2=1.0)")
    draws = 300
    values = []
    for x in model.simulate(1000, RATE, np.random.default_rng(11), draws):
        values.append(fit_ml("AR1", x, RATE, start=model).residuals(x).ljung_box(6))
    # With one parameter to six lags it matters which of the two distributions it is.
    assert np.mean([c.degrees_of_freedom for c in values]) == pytest.approx(5, abs=0.05)
    assert kstest([c.statistic for c in values], chi2(5).cdf).pvalue > 1e-3
    assert kstest([c.statistic for c in values], chi2(6).cdf).pvalue < 1e-2


def test_a_summary_and_plain_numbers_say_the_same():
    x = MODEL.simulate(2000, RATE, rng=12)
    found = MODEL.residuals(x, RATE)
    plain, white = found.to_dict(), found.ljung_box()
    assert plain["ljung_box"] == {"lags": white.lags, "statistic": white.statistic, "p_value": white.p_value}
    assert plain["mean"] == pytest.approx(np.mean(found.values))
    assert plain["standard_deviation"] == pytest.approx(np.std(found.values))
    assert f"{white.statistic:.1f} on {white.lags} degrees of freedom" in found.summary()
    assert repr(found) == "Residuals(GM + WN + RW, 2000 samples)"


@pytest.mark.parametrize("lags", [0, 2000, 2.5, True])
def test_lags_are_counted(lags):
    found = MODEL.residuals(MODEL.simulate(2000, RATE, rng=13), RATE)
    with raises(OptionError, "from 1 to 1999", argument="lags", got=lags):
        found.acf(lags)


def test_a_negative_number_of_estimated_parameters_is_refused():
    with raises(OptionError, "at least 0", argument="estimated", got=-1):
        MODEL.residuals(MODEL.simulate(200, RATE, rng=14), RATE, estimated=-1)
