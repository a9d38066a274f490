"""Intervals averaged over models include those of the recommended model, and leave the other fits as they are."""

import pytest

import gmwm
from gmwm.calibration.averaging import weighted_candidates


@pytest.fixture(scope="module")
def calibration():
    truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-12) + GM(beta=1.0, sigma2=1e-8)"}
    imu = gmwm.simulate(truth, rate=100.0, samples=100_000, rng=3)
    return gmwm.calibrate(imu, "2*GM + WN + RW")


@pytest.mark.slow
def test_an_averaged_interval_contains_that_of_the_recommended_model(calibration):
    found, fit = calibration.axes["gyro_x"], calibration["gyro_x"]
    alone = fit.confidence_intervals()
    assert found.intervals != alone
    for name, (low, high) in alone.items():
        assert found.intervals[name][0] <= low
        assert high <= found.intervals[name][1]


@pytest.mark.slow
def test_the_fits_of_the_other_models_keep_their_exact_intervals(calibration):
    ranking = calibration.rankings["gyro_x"]
    others = [candidate.fit for _, candidate in weighted_candidates(ranking) if not candidate.recommended]
    again = gmwm.select("2*GM + WN + RW", calibration["gyro_x"].wavelet_variance)
    fits = {candidate.structure: candidate.fit for candidate in again}
    assert others
    for fit in others:
        assert fit.confidence_intervals() == fits[fit.model.structure].confidence_intervals()
