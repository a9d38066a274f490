"""The relative error of a model: planted in exact curves, and absent where the model is right."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaincc

from gmwm import fit, wavelet_variance
from gmwm.fitting.estimation.model_error import (
    COARSE_TEST_SIZE,
    JUDGED_FREEDOM,
    LARGEST_MODEL_ERROR,
    Distance,
    RelativeMisfit,
    having_error,
    implausible_levels,
    model_error,
    nearly_fitted,
    relative_misfit,
)
from gmwm.measuring.covariance import Design, covariance
from gmwm.theory.processes.model import Model

RATE = 100.0
TRUTH = Model.parse("WN(sigma2=4e-6) + GM(beta=0.2, sigma2=2e-7)")
FREE = Model.parse("WN + GM")


@pytest.fixture(scope="module")
def recording():
    return wavelet_variance(TRUTH.simulate(400_000, RATE, rng=1), rate=RATE)


@pytest.fixture(scope="module")
def exact(recording):
    """A long recording, its expected curve and a root of its exact covariance."""
    long = replace(recording, samples=4_000_000)
    return long, TRUTH.wavelet_variance(long.levels, RATE), np.linalg.cholesky(covariance(TRUTH, Design.of(long)))


@pytest.fixture
def drawn(exact):
    """Curves from the exact covariance, with a planted error; no level is far below its expectation."""
    (long, curve, root), rng = exact, np.random.default_rng(5)

    def one(error=0.0):
        off = 1 + error * rng.standard_normal(curve.size)
        values = curve * off + root @ rng.standard_normal(curve.size) * off
        return replace(long, variance=np.maximum(values, curve / 20))

    return one


@pytest.mark.slow
def test_the_planted_error_is_found(drawn):
    planted, freedom = 0.05, None
    found = []
    for _ in range(20):
        general = nearly_fitted(FREE, drawn(planted), "optimal")
        freedom = Distance.of(general).freedom
        found.append(model_error(general))
    # The relative standard error of a deviation from k squares is 1 / √(2k).
    error = planted / np.sqrt(2 * freedom)
    assert np.std(found) < 2 * error
    assert np.mean(found) == pytest.approx(planted, abs=3 * error / np.sqrt(20) + 0.1 * planted)


@pytest.mark.slow
def test_the_true_model_has_none(drawn):
    general = [nearly_fitted(FREE, drawn(), "optimal") for _ in range(20)]
    found = [model_error(one) for one in general]
    # The estimate is above zero if the statistic exceeds its mean: in 44 % of curves.
    assert 2 <= sum(value > 0 for value in found) <= 15
    # Far below the standard error of the coarse levels, 26 % and more.
    assert max(found) < 0.03
    distances = map(Distance.of, general)
    assert sum(gammaincc(one.freedom / 2, one.statistic(0.0) / 2) < 0.05 for one in distances) <= 4


def test_the_statistic_is_that_of_the_goodness_of_fit_test(recording):
    one = fit(FREE, recording, weighting="optimal")
    assert Distance.of(one).statistic(0.0) == pytest.approx(one.goodness_of_fit().statistic, rel=0.02)
    assert Distance.of(one).freedom == one.goodness_of_fit().df


def test_with_its_error_the_statistic_is_its_expectation(drawn):
    found = Distance.of(nearly_fitted(FREE, drawn(0.03), "optimal"))
    assert found.statistic(found.error()) == pytest.approx(found.freedom, rel=1e-3)
    assert found.statistic(0.0) > found.statistic(0.03) > found.statistic(0.5)


def test_a_model_that_says_nothing_has_the_largest_error(recording):
    one = nearly_fitted(Model.parse("RW"), recording, "diagonal")
    assert model_error(one) == LARGEST_MODEL_ERROR


@pytest.mark.slow
def test_a_poor_first_fit_does_not_decide_the_error(drawn):
    general = [nearly_fitted(FREE, drawn(0.2), "optimal") for _ in range(6)]
    # Precise levels that are 20 % off mislead the weights of the first fit; the later fits have the error in V.
    assert max(Distance.of(one).error() for one in general) > 0.4
    assert max(map(model_error, general)) < 0.4


def test_a_model_with_as_many_parameters_as_levels_has_none():
    short = wavelet_variance(TRUTH.simulate(20, RATE, rng=1), rate=RATE)
    one = nearly_fitted(Model.parse("WN + QN + RW + DR"), short, "diagonal")
    assert Distance.of(one).freedom <= 0
    assert model_error(one) == 0.0


def test_the_error_adds_to_other_excess(recording):
    size = len(recording)
    once = having_error(replace(recording, excess=0.01 * np.ones((size, size))), 0.3)
    np.testing.assert_allclose(Design.of(once).added, 0.01 + 0.09 * np.eye(size))
    assert having_error(once, 0.4).model_error == 0.4


# --- the relative misfit ------------------------------------------------------------------------------


def off_by(recording, factors):
    """A fit whose data are its curve divided by factors."""
    one = fit(FREE, recording, weighting="optimal")
    wv = recording
    return replace(one, wavelet_variance=replace(wv, variance=one.implied / factors))


def test_the_misfit_is_exact_on_constructed_curves(recording):
    eta = recording.degrees_of_freedom
    judged = eta > JUDGED_FREEDOM
    factors = np.where(judged, 1.3, 50.0)
    factors[2] = 0.5
    found = relative_misfit(off_by(recording, factors))
    np.testing.assert_allclose(found.distance, factors - 1, rtol=1e-9)
    np.testing.assert_allclose(found.error, np.sqrt(2 / eta))
    np.testing.assert_array_equal(found.judged, judged)
    assert found.largest == pytest.approx(np.sqrt(0.25 - 2 / eta[2]))
    assert found.tau == recording.tau[2]
    squares = (factors[judged] - 1) ** 2 - 2 / eta[judged]
    assert found.rms == pytest.approx(np.sqrt(squares.mean()))
    again = RelativeMisfit.from_dict(found.to_dict())
    assert again.to_dict() == found.to_dict()


def test_a_curve_on_its_data_has_no_misfit(recording):
    found = relative_misfit(off_by(recording, np.ones(len(recording))))
    assert (found.largest, found.rms) == (0.0, 0.0)


def test_the_model_error_does_not_hide_the_misfit(recording):
    one = off_by(recording, np.full(len(recording), 1.2))
    having = replace(one, wavelet_variance=having_error(one.wavelet_variance, 0.5))
    assert relative_misfit(having).largest == relative_misfit(one).largest


def test_a_level_without_variance_has_no_distance(recording):
    one = off_by(recording, np.ones(len(recording)))
    empty = one.implied.copy()
    empty[0] = 0.0
    found = relative_misfit(replace(one, wavelet_variance=replace(one.wavelet_variance, variance=empty)))
    assert not found.judged[0]
    assert found.largest == 0.0


# --- coarse levels ------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("structure", ["WN", "RW", "WN + RW"])
def test_recordings_of_the_model_are_rarely_implausible(structure):
    rng, samples, runs, size = np.random.default_rng(7), 4000, 400, 0.05
    values = {"WN": (1.0, 0.0), "RW": (0.0, 1.0), "WN + RW": (1.0, 0.05)}[structure]
    text = {"WN": "WN(sigma2=1)", "RW": "RW(gamma2=1)", "WN + RW": "WN(sigma2=1) + RW(gamma2=0.0025)"}[structure]
    model = Model.parse(text)
    base = fit(structure, wavelet_variance(model.simulate(samples, RATE, rng=1), rate=RATE), weighting="diagonal")
    hits = 0
    for _ in range(runs):
        x = values[0] * rng.normal(size=samples) + values[1] * np.cumsum(rng.normal(size=samples))
        wv = wavelet_variance(x, rate=RATE)
        known = replace(base, model=model, wavelet_variance=wv, implied=model.wavelet_variance(wv.levels, RATE))
        hits += bool(implausible_levels(known, size).any())
    # Nominal 5 %, with a standard error of 1.1 %.
    assert hits / runs <= size + 0.025


def test_a_coarse_level_far_above_or_below_is_implausible(recording):
    coarse = np.flatnonzero(recording.degrees_of_freedom <= JUDGED_FREEDOM)
    for factor in (100.0, 0.01):
        factors = np.ones(len(recording))
        factors[coarse[0]] = factor
        factors[0] = 10.0  # The goodness-of-fit test sees this level.
        found = implausible_levels(off_by(recording, factors), COARSE_TEST_SIZE)
        np.testing.assert_array_equal(np.flatnonzero(found), coarse[:1])
    assert not implausible_levels(off_by(recording, np.ones(len(recording)))).any()


def test_without_coarse_levels_none_is_implausible(recording):
    one = off_by(recording, np.full(len(recording), 100.0))
    fine = replace(one.wavelet_variance, samples=1 << 40)
    assert not implausible_levels(replace(one, wavelet_variance=fine)).any()
