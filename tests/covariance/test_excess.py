"""Relative covariance beyond the model: it enters V, intervals and the test, and survives storage and shortening."""

from dataclasses import replace

import numpy as np
import pytest

from gmwm import RW, WN, fit, wavelet_variance
from gmwm.base.errors import DataError
from gmwm.measuring.covariance import Design, covariance, covariances
from gmwm.measuring.covariance.api import variances
from gmwm.measuring.variance.result import WaveletVariance

MODEL = WN(sigma2=4e-6) + RW(gamma2=1e-10)


@pytest.fixture(scope="module")
def curves():
    wv = wavelet_variance(MODEL.simulate(20_000, 100.0, rng=1), rate=100.0)
    return wv, replace(wv, excess=0.05**2 * np.eye(len(wv)))


@pytest.mark.parametrize("segments", [(), (12_000, 8_000)])
def test_it_adds_the_product_of_the_curve_to_v(curves, segments):
    design = replace(Design.of(curves[0]), segments=segments, levels=np.arange(1, 13))
    excess = 1e-3 * (np.eye(12) + 0.5)
    more, curve = replace(design, excess=excess), MODEL.wavelet_variance(12, 100.0)
    difference = covariance(MODEL, more) - covariance(MODEL, design)
    np.testing.assert_allclose(difference, excess * np.outer(curve, curve), rtol=1e-9)
    np.testing.assert_allclose(variances(MODEL, more), np.diag(covariance(MODEL, more)), rtol=1e-9)


def test_designs_that_differ_only_in_the_excess_share_their_covariance(curves):
    design = replace(Design.of(curves[1]), model_error=0.02)
    bare = replace(design, excess=None, model_error=0.0)
    designs = (design, design.for_weights, bare)
    for found, one in zip(covariances(MODEL, *designs), designs, strict=True):
        np.testing.assert_array_equal(found, covariance(MODEL, one))


def test_intervals_become_wider_and_the_statistic_smaller(curves):
    without, having = (fit("WN + RW", wv, weighting="optimal") for wv in curves)
    assert having.standard_errors["WN.sigma2"] > 2 * without.standard_errors["WN.sigma2"]
    assert having.goodness_of_fit().statistic < without.goodness_of_fit().statistic


def test_it_is_stored_and_shortened(curves):
    again = WaveletVariance.from_dict(curves[1].to_dict())
    np.testing.assert_array_equal(again.excess, curves[1].excess)
    assert again.first(5).excess.shape == (5, 5)
    assert curves[0].to_dict()["excess"] is None


def test_a_matrix_of_another_size_is_refused(curves):
    with pytest.raises(DataError) as error:
        replace(curves[0], excess=np.eye(3))
    assert error.value.argument == "excess"


def test_the_model_error_adds_to_the_diagonal(curves):
    design = Design.of(curves[0])
    curve = MODEL.wavelet_variance(design.levels, 100.0)
    difference = covariance(MODEL, replace(design, model_error=0.05)) - covariance(MODEL, design)
    np.testing.assert_allclose(difference, np.diag((0.05 * curve) ** 2), atol=1e-9 * float(difference.max()))


def test_an_error_common_to_all_levels_does_not_make_zero_a_good_fit(curves):
    wv = replace(curves[0], excess=0.1**2 * np.ones((len(curves[0]), len(curves[0]))))
    found = fit("WN + RW", wv, weighting="optimal")
    assert found.parameters["WN.sigma2"] == pytest.approx(4e-6, rel=0.05)
    assert found.standard_errors["WN.sigma2"] == pytest.approx(0.1 * 4e-6, rel=0.1)
