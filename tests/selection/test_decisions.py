"""The limits at which the selection of a model decides one way or the other."""

from types import SimpleNamespace

import numpy as np
import pytest

import gmwm
from gmwm.choosing.selection import api
from gmwm.choosing.selection.fast_part import acts_as_filter, process_of, with_shape_error
from gmwm.choosing.selection.structure import without_drift
from gmwm.fitting.estimation import fit as fitted
from gmwm.measuring.spectrum.short_memory import SpectralShape

RATE = 100.0


@pytest.mark.parametrize(
    ("pvalue", "best", "rejected"),
    [(0.0045, 0.5, True), (0.0055, 0.5, False), (0.001, 0.0105, True), (0.001, 0.0095, False), (None, 0.5, False)],
)
def test_a_candidate_is_rejected_below_half_a_per_cent_if_the_best_one_fits_ten_times_better(pvalue, best, rejected):
    candidate, other = SimpleNamespace(pvalue=pvalue), SimpleNamespace(pvalue=best)
    assert api._is_rejected(candidate, other) == rejected


@pytest.mark.parametrize(("difference", "equivalent"), [(3.8, True), (4.2, False)])
def test_a_candidate_within_four_standard_errors_of_the_best_one_is_tested(monkeypatch, difference, equivalent):
    wv = gmwm.wavelet_variance(gmwm.GM(beta=1.0, sigma2=1.0).simulate(4096, RATE, rng=1), RATE)
    ranking = gmwm.rank(["GM + WN", "WN"], wv)
    best, simple = ranking.best, ranking["WN"]
    assert best is not simple
    wic = SimpleNamespace(value=best.wic.value + difference)
    candidates = [best, SimpleNamespace(**{n: getattr(simple, n) for n in vars(simple)}, structure="WN")]
    candidates[1].wic, candidates[1].same_as = wic, None
    monkeypatch.setattr(api, "difference_error", lambda *_: 1.0)
    monkeypatch.setattr(api, "as_good", lambda *_, **__: True)
    monkeypatch.setattr(api, "_is_rejected", lambda *_: False)
    explored = SimpleNamespace(weights=None, wavelet=None)
    chosen = list(api._equivalent(candidates, explored, confidence=0.95, draws=500, seed=0))
    assert (1 in chosen) == equivalent


@pytest.mark.parametrize(("pvalue", "chosen"), [(0.001, [1]), (0.3, [0])])
def test_a_rejected_model_with_the_smallest_criterion_is_not_the_best_one(monkeypatch, pvalue, chosen):
    wv = gmwm.wavelet_variance(gmwm.GM(beta=1.0, sigma2=1.0).simulate(4096, RATE, rng=1), RATE)
    ranking = gmwm.rank(["GM + WN", "WN"], wv)
    simple, best = (SimpleNamespace(**vars(ranking[name]), structure=name) for name in ("WN", "GM + WN"))
    simple.pvalue, best.pvalue = pvalue, 0.9
    monkeypatch.setattr(api, "difference_error", lambda *_: 1.0)
    monkeypatch.setattr(api, "as_good", lambda *_, **__: True)
    explored = SimpleNamespace(weights=None, wavelet=None)
    assert list(api._equivalent([simple, best], explored, confidence=0.95, draws=500, seed=0)) == chosen


@pytest.mark.parametrize(("share", "felt"), [(0.09, False), (0.11, True)])
def test_a_drift_is_felt_from_a_tenth_of_the_longest_scale_on(share, felt):
    model = gmwm.Model.parse("WN + DR")
    wv = gmwm.wavelet_variance(gmwm.WN(sigma2=1.0).simulate(4096, RATE, rng=1), RATE)
    unit = gmwm.DR(omega=1.0).wavelet_variance(wv.levels[-1:], RATE)[0]
    rising = SimpleNamespace(
        levels=wv.levels, rate=wv.rate, filter=wv.filter, variance=wv.variance,
        rise=float(np.sqrt(share * wv.variance[-1] / unit)),
    )  # fmt: skip
    assert (without_drift(model, [rising]) == model) == felt


@pytest.mark.parametrize(("samples", "fast"), [(2.9, True), (3.1, False)])
def test_a_process_of_up_to_three_samples_may_be_a_filter(samples, fast):
    fit = SimpleNamespace(wavelet_variance=SimpleNamespace(rate=RATE))
    assert acts_as_filter(gmwm.GM(beta=RATE / samples, sigma2=1.0), fit) == fast


def test_the_covariance_of_a_shape_is_doubled_because_its_order_was_selected():
    def curve(phi):
        """The wavelet variance of an AR(1) process with the density 1 at frequency 0."""
        return gmwm.AR1(phi=phi, sigma2=(1 - phi) ** 2).wavelet_variance(6, RATE)

    shape = SpectralShape(
        phi=np.array([0.6]), theta=np.array([]), innovation=1.0, covariance=np.array([[1e-4]]), misfit=1.0
    )
    wv = gmwm.WaveletVariance.from_values(curve(0.6), samples=10_000, rate=RATE)
    process = process_of(shape)
    wider = with_shape_error(wv, fitted(process, wv), shape, process)
    slope = (np.log(curve(0.6 + 1e-5)) - np.log(curve(0.6 - 1e-5))) / 2e-5
    np.testing.assert_allclose(wider.excess, 2.0 * 1e-4 * np.outer(slope, slope), rtol=1e-5)
