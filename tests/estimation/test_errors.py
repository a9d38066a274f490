"""What cannot be fitted is refused in words that say what to do."""

import numpy as np
import pytest

import gmwm
from gmwm import DR, GM, WN, WaveletVariance, fixed
from gmwm.errors import DataError, FitWarning, ModelError, OptionError

X = np.random.default_rng(1).normal(size=1000)
WV = gmwm.wavelet_variance(X, 100.0)


@pytest.mark.parametrize(
    ("model", "data", "options", "error", "words"),
    [
        (
            "4*GM + WN + QN + RW + DR",
            X[:600],
            {"rate": 100.0},
            ModelError,
            "12 parameters .* only 9 levels",
        ),
        ("GM(beta=fixed(1.0), sigma2=fixed(1.0))", WV, {}, ModelError, "nothing to estimate"),
        ("GM(sigma2=fixed(1.0)) + WN", WV, {}, ModelError, "beta .*hold .* or free sigma2"),
        ("GM + AR1", WV, {}, ModelError, "AR1"),
        ("WN + WN", WV, {}, ModelError, "WN"),
        ("XY + WN", WV, {}, ModelError, "XY"),
        ("WN", X, {}, OptionError, "rate"),
        ("WN", X, {"rate": -250.0}, OptionError, "sampling interval"),
        ("WN", WV, {"rate": 250.0}, OptionError, "contradicts"),
        ("WN", WV, {"weighting": "optmal"}, OptionError, "'diagonal'"),
        (
            "WN",
            WV,
            {"weighting": np.ones(4)},
            OptionError,
            r"vector of 9 or a 9 x 9 matrix, got shape \(4,\)",
        ),
        ("WN", WV, {"weighting": np.full(9, np.nan)}, OptionError, "weighting must be finite, 9 of its 9"),
        ("WN", WV, {"weighting": ["a"] * 9}, OptionError, "weighting must be numbers"),
        ("WN", WV, {"efficiency": 0.8}, OptionError, "pass robust=True too"),
        ("WN", X, {"rate": 100.0, "efficiency": 7.0}, OptionError, "pass robust=True too"),
        ("WN", WV, {"weighting": -np.eye(9)}, OptionError, "positive definite"),
        ("WN", WV, {"weighting": np.ones((9, 9))}, OptionError, "positive definite"),
        ("WN", WV, {"weighting": np.triu(np.ones((9, 9)))}, OptionError, "symmetric"),
        ("WN", np.full(100, 3.0), {"rate": 1.0}, ModelError, "constant"),
        ("WN", np.append(X, np.nan), {"rate": 1.0}, DataError, "1 NaN .* index 1000"),
        ("WN", X[:5], {"rate": 1.0}, DataError, "at least 8"),
        ("WN", X.reshape(2, -1), {"rate": 1.0}, DataError, "one-dimensional"),
        ("WN", ["a"] * 10, {"rate": 1.0}, DataError, "real numbers"),
    ],
)
def test_refused(model, data, options, error, words):
    with pytest.raises(error, match=words):
        gmwm.fit(model, data, **options)


def test_a_level_without_variance_cannot_be_weighed_by_the_data():
    wv = WaveletVariance.from_values([0.0, 0.1, 0.05, 0.02], samples=1000, rate=10.0)
    with pytest.raises(DataError, match="zero at level 1"):
        gmwm.fit(WN(), wv)
    assert gmwm.fit(WN(), wv, weighting="identity").parameters["WN.sigma2"] > 0


def test_gaps_are_never_glued():
    signal = gmwm.Signal(X, 100.0, segments=((0, 400), (400, 1000)))
    alone = [gmwm.wavelet_variance(piece, 100.0, levels=8).variance[0] for piece in signal.segment_values()]
    fit = gmwm.fit(WN(), signal)
    assert fit.wavelet_variance.variance[0] == pytest.approx((399 * alone[0] + 599 * alone[1]) / 998, rel=1e-12)
    with pytest.raises(DataError, match=r"2 segments of .*longest"):
        gmwm.allan_variance(signal)
    assert gmwm.fit(WN(), signal.longest()).wavelet_variance.samples == 600


def test_held_and_free_terms_of_one_kind_mix():
    with pytest.warns(FitWarning):
        fit = gmwm.fit(GM(beta=fixed(2.0)) + GM() + WN() + DR(), WV)
    assert 2.0 in fit.parameters.values()


@pytest.mark.parametrize("factor", [1e-90, 1e90])
def test_beyond_the_range_of_doubles(factor):
    with pytest.raises(DataError, match="double precision"):
        gmwm.fit("GM + WN", X * factor, 100.0)


def test_masked_values_are_not_data():
    with pytest.raises(DataError, match="1 masked"):
        gmwm.fit("WN", np.ma.array(X, mask=[True] + [False] * 999), 100.0)
