"""Models, data and options that cannot be fitted raise errors that name the cause."""

import numpy as np
import pytest

import gmwm
from gmwm import DR, GM, WN, WaveletVariance, fixed
from gmwm.base.errors import FitWarning
from tests.helpers import each, raises

X = np.random.default_rng(1).normal(size=1000)
WV = gmwm.wavelet_variance(X, 100.0)


@each(
    ("model", "data", "options", "error", "facts"),
    [
        (
            "4*GM + WN + QN + RW + DR",
            X[:600],
            {"rate": 100.0},
            gmwm.errors.ModelError,
            ("12 free parameters", "9 levels"),
        ),
        (
            "GM(beta=fixed(1.0), sigma2=fixed(1.0))",
            WV,
            {},
            gmwm.errors.ModelError,
            ("GM(beta=fixed(1.0), sigma2=fixed(1.0))", "fixed"),
        ),
        ("GM(sigma2=fixed(1.0)) + WN", WV, {}, gmwm.errors.ModelError, ("beta", "sigma2", "fixed")),
        ("GM + AR1", WV, {}, gmwm.errors.ModelError, ("AR1",)),
        ("WN + WN", WV, {}, gmwm.errors.ModelError, ("WN",)),
        ("XY + WN", WV, {}, gmwm.errors.ModelError, ("XY",)),
        ("WN", X, {"rate": -250.0}, gmwm.errors.OptionError, ("rate", -250)),
        ("WN", WV, {"rate": 250.0}, gmwm.errors.OptionError, ("rate", 100, 250)),
        ("WN", WV, {"weighting": "optmal"}, gmwm.errors.OptionError, ("weighting", "'diagonal'", "'optmal'")),
        ("WN", WV, {"weighting": np.ones(4)}, gmwm.errors.OptionError, ("weighting", "9 x 9", "(4,)")),
        ("WN", WV, {"weighting": np.full(9, np.nan)}, gmwm.errors.OptionError, ("weighting", "9 of 9", "finite")),
        ("WN", WV, {"weighting": ["a"] * 9}, gmwm.errors.OptionError, ("weighting", "numbers", "'a'")),
        ("WN", WV, {"efficiency": 0.8}, gmwm.errors.OptionError, ("efficiency",)),
        ("WN", X, {"rate": 100.0, "efficiency": 7.0}, gmwm.errors.OptionError, ("efficiency",)),
        ("WN", WV, {"weighting": -np.eye(9)}, gmwm.errors.OptionError, ("weighting", "positive definite")),
        ("WN", WV, {"weighting": np.ones((9, 9))}, gmwm.errors.OptionError, ("weighting", "positive definite")),
        ("WN", WV, {"weighting": np.triu(np.ones((9, 9)))}, gmwm.errors.OptionError, ("weighting", "symmetric")),
        ("WN", np.full(100, 3.0), {"rate": 1.0}, gmwm.errors.ModelError, ("constant",)),
        ("WN", np.append(X, np.nan), {"rate": 1.0}, gmwm.errors.DataError, ("1 of 1001 values are NaN", 1000)),
        ("WN", X[:5], {"rate": 1.0}, gmwm.errors.DataError, (8, 5)),
        ("WN", X.reshape(2, -1), {"rate": 1.0}, gmwm.errors.DataError, ("(2, 500)",)),
        ("WN", ["a"] * 10, {"rate": 1.0}, gmwm.errors.DataError, ("real numbers",)),
    ],
)
def test_refused(model, data, options, error, facts):
    with raises(error, *facts):
        gmwm.fit(model, data, **options)


def test_a_level_without_variance_cannot_be_weighed_by_the_data():
    wv = WaveletVariance.from_values([0.0, 0.1, 0.05, 0.02], samples=1000, rate=10.0)
    with raises(gmwm.errors.DataError, "zero at level 1,", advises=["more bits"]):
        gmwm.fit(WN(), wv)
    assert gmwm.fit(WN(), wv, weighting="identity").parameters["WN.sigma2"] > 0


def test_gaps_are_never_glued():
    signal = gmwm.Signal(X, 100.0, segments=((0, 400), (400, 1000)))
    alone = [gmwm.wavelet_variance(piece, 100.0, levels=8).variance[0] for piece in signal.segment_values()]
    fit = gmwm.fit(WN(), signal)
    assert fit.wavelet_variance.variance[0] == pytest.approx((399 * alone[0] + 599 * alone[1]) / 998, rel=1e-12)
    allan = gmwm.allan_variance(signal)
    assert allan.variance[0] == pytest.approx(2 * fit.wavelet_variance.variance[0], rel=1e-12)
    assert gmwm.fit(WN(), signal.longest()).wavelet_variance.samples == 600


def test_held_and_free_terms_of_one_kind_mix():
    with pytest.warns(FitWarning):
        fit = gmwm.fit(GM(beta=fixed(2.0)) + GM() + WN() + DR(), WV)
    assert 2.0 in fit.parameters.values()


@pytest.mark.parametrize("factor", [1e-90, 1e90])
def test_beyond_the_range_of_doubles(factor):
    with raises(gmwm.errors.DataError, "double precision"):
        gmwm.fit("GM + WN", X * factor, 100.0)


def test_masked_values_are_not_data():
    with raises(gmwm.errors.DataError, "1 masked"):
        gmwm.fit("WN", np.ma.array(X, mask=[True] + [False] * 999), 100.0)
