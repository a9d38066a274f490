"""The shortest recording that can be calibrated, and where its limits come from."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError
from gmwm.calibration.findings import LEAST_SCALES, LEAST_SCALES_FOR_USE
from gmwm.choosing.selection.ranking import SLOW
from gmwm.fitting.estimation.goodness import usable_levels
from tests.helpers import raises

WHITE = "WN(sigma2=1.0)"
TWO = "WN(sigma2=1.0) + RW(gamma2=0.05)"
"""The two terms have the same wavelet variance near a scale of 16 samples."""


def signal(model, samples, seed):
    return gmwm.simulate_signal(model, rate=100.0, samples=samples, rng=seed, unit="rad/s").signal


def samples_for(scales):
    """Samples of the shortest signal with this number of usable scales."""
    return next(n for n in 2 ** np.arange(3, 12) if np.sum(usable_levels(gmwm.wavelet_variance(white(n)))) == scales)


@cache
def white(samples):
    return signal(WHITE, int(samples), 0)


def recognised(text, scales, recordings, least):
    """Whether the selection recommends the true model for at least so many recordings. Ends when this is decided."""
    samples, truth = int(samples_for(scales)), gmwm.Model.parse(text)
    right = 0
    for seed in range(recordings):
        ranking = gmwm.select(SLOW, gmwm.wavelet_variance(signal(text, samples, seed)))
        right += ranking.recommended.model.structure == truth.structure
        if right == least or seed + 1 - right > recordings - least:
            break
    return right == least


@pytest.mark.slow
def test_the_least_number_of_scales_is_that_at_which_white_noise_is_recognised():
    assert not recognised(WHITE, LEAST_SCALES - 1, 40, least=38)
    assert recognised(WHITE, LEAST_SCALES, 40, least=38)


@pytest.mark.slow
def test_two_terms_are_recognised_from_the_scales_that_a_usable_calibration_needs():
    assert not recognised(TWO, LEAST_SCALES_FOR_USE - 1, 30, least=18)
    assert recognised(TWO, LEAST_SCALES_FOR_USE, 30, least=20)


@pytest.mark.parametrize("samples", [9, 63])
def test_a_recording_of_fewer_scales_is_refused(samples):
    imu = gmwm.simulate({"gyro_x": WHITE}, rate=100.0, samples=samples, rng=1)
    scales = int(np.sum(usable_levels(gmwm.wavelet_variance(imu["gyro_x"]))))
    assert scales < LEAST_SCALES
    with raises(DataError, "gyro_x", f"{samples} samples", LEAST_SCALES, argument="data", got=samples,
                advises=["gmwm.fit"]):  # fmt: skip
        gmwm.calibrate(imu)


def test_the_limit_is_64_samples():
    assert samples_for(LEAST_SCALES) == 64
    imu = gmwm.simulate({"gyro_x": WHITE}, rate=100.0, samples=64, rng=1)
    assert gmwm.calibrate(imu, "WN")["gyro_x"].model.structure == "WN"


def test_a_short_axis_does_not_stop_the_others():
    found = gmwm.calibrate({"gyro_x": white(4096), "gyro_y": white(32)}, "WN")
    assert list(found) == ["gyro_x"]
    with raises(DataError, "32 samples", argument="axis", got="gyro_y"):
        found["gyro_y"]


def test_random_losses_that_cannot_be_filled_end_the_calibration():
    rng = np.random.default_rng(2)
    kept = np.flatnonzero(rng.random(4000) > 0.4)
    begins = [0, *(np.flatnonzero(np.diff(kept) > 1) + 1).tolist()]
    gaps = {"segments": tuple(pairwise([*begins, kept.size])), "starts": tuple((kept[begins] / 100.0).tolist())}
    lossy = gmwm.Signal(rng.normal(0, 1e-3, kept.size), 100.0, "rad/s", axis="gyro_x", **gaps)
    with raises(DataError, f"{len(begins) - 1} gaps", "128", argument="data"):
        gmwm.calibrate(lossy)


def test_a_model_can_be_fitted_to_a_short_curve():
    curve = gmwm.wavelet_variance(white(16))
    assert gmwm.fit("WN", curve).parameters["WN.sigma2"] > 0


def test_seconds_do_not_show_how_the_bias_changes():
    for samples, usable in ((512, False), (1024, True)):
        x = np.random.default_rng(1).normal(0, 1e-3, samples)
        verdicts = gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", axis="gyro_x"), "WN + RW").number_verdicts["gyro_x"]
        assert verdicts["N"].usability.value == "use"
        assert (verdicts["K"].usability.value != "do not use") == usable
