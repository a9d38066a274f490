"""A drift is not inferred from inside short segments if the recording as a whole does not rise."""

import numpy as np
import pytest

import gmwm
from gmwm.choosing.selection.structure import without_drift
from tests.helpers import codes

RATE, SEGMENT, LOST = 100.0, 2000, 9000


def recording(drift, walk, seed, segments=40):
    """White noise, a random walk and a drift, known during 20 s of every 110 s."""
    rng = np.random.default_rng(seed)
    k = np.arange(segments * (SEGMENT + LOST))
    x = rng.normal(size=k.size) + walk * np.cumsum(rng.normal(size=k.size)) + drift * k
    return gmwm.Signal.from_missing(np.where(k % (SEGMENT + LOST) < SEGMENT, x, np.nan), RATE, "rad/s", "gyro_x", 1e9)


def test_the_rise_is_that_of_the_whole_recording():
    x = recording(1e-4, 0.0, 1)
    wv = gmwm.wavelet_variance(x)
    assert wv.rise == pytest.approx(np.polyfit(x.times() * RATE - 1e11, x.values, 1)[0], rel=1e-6)
    assert wv.rise == pytest.approx(1e-4, rel=1e-3)
    assert gmwm.WaveletVariance.from_dict(wv.to_dict()).rise == wv.rise
    parts = [gmwm.WaveletAccumulator(RATE, start=start) for start in (0, 3 * SEGMENT + 500)]
    parts[0].feed(gmwm.Signal(x.values[:6500], RATE, segments=(*x.segments[:3], (6000, 6500)), starts=x.starts[:4]))
    rest = [(max(a, 6500) - 6500, b - 6500) for a, b in x.segments[3:]]
    starts = (x.starts[3] + 5.0, *x.starts[4:])
    parts[1].feed(gmwm.Signal(x.values[6500:], RATE, segments=rest, starts=starts), continues=True)
    assert parts[0].merge(parts[1]).result().rise == pytest.approx(wv.rise, rel=1e-12)


def test_no_rise_without_gaps_or_if_their_lengths_are_not_known():
    x = recording(1e-4, 0.0, 1)
    assert gmwm.wavelet_variance(x.longest()).rise is None
    assert gmwm.wavelet_variance(gmwm.Signal(x.values, RATE, segments=x.segments)).rise is None


@pytest.mark.parametrize("seed", range(6))
def test_a_walk_is_no_drift(seed):
    wv = gmwm.wavelet_variance(recording(0.0, 0.02, seed))
    general = gmwm.Model.parse("WN + FN + RW + DR")
    assert without_drift(general, [wv]).structure == "WN + FN + RW"
    assert all("DR" not in one.model.structure for one in gmwm.select("WN + RW + DR", wv).candidates)


@pytest.mark.slow
def test_a_drift_of_the_whole_recording_stays_a_candidate():
    wv = gmwm.wavelet_variance(recording(3e-4, 0.0, 1))
    general = gmwm.Model.parse("WN + RW + DR")
    assert without_drift(general, [wv]) is general
    calibration = gmwm.calibrate(recording(3e-4, 0.0, 1), "WN + RW + DR")
    assert calibration["gyro_x"].parameters["DR.omega"] == pytest.approx(3e-4, rel=0.1)
    assert "drift:drift" in codes(calibration.remarks)
