"""A gap after which the sensor has another offset is not filled. All noise is simulated with NumPy."""

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import Imu, Signal
from gmwm.recording import batches
from gmwm.recording.batches import Batch, join_batches
from gmwm.recording.gaps import fill_gaps, filled, gaps

RATE, N = 100.0, 60_000


def white(rng):
    return rng.normal(size=N)


def wandering(rng):
    """White noise, a Gauss-Markov process of 2 s, and a random walk."""
    pulls = 0.05 * rng.normal(size=N)
    pulls[0] = 0.0
    markov = lfilter([1.0], [1.0, -0.995], pulls)
    return rng.normal(size=N) + markov + np.cumsum(2e-3 * rng.normal(size=N))


def flicker(rng):
    """White noise, and noise of spectral density 1/f."""
    f = np.fft.rfftfreq(2 * N)
    shape = np.concatenate([[0.0], f[1:] ** -0.5])
    drift = np.fft.irfft(np.fft.rfft(rng.normal(size=2 * N)) * shape)[:N]
    return rng.normal(size=N) + 0.05 * drift


def warming(rng):
    return rng.normal(size=N) + 5.0 * np.exp(-np.arange(N) / 6000)


def telegraph(rng):
    """White noise, and a level that jumps by itself about every 3000 samples."""
    return rng.normal(size=N) + np.cumsum(rng.random(N) < 1 / 3000) % 2


def coarse(rng):
    return np.round(0.3 * rng.normal(size=N))


def losses(rng, share=0.005):
    """Lost samples: single ones, and three bursts."""
    lost = rng.random(N) < share
    for first in rng.integers(1000, N - 1000, 3).tolist():
        lost[first : first + 30] = True
    lost[:50] = lost[-50:] = False
    return lost


def signal(x, lost):
    return Signal.from_missing(np.where(lost, np.nan, x), RATE, "rad/s", "gyro_x")


def time_of_cuts(x):
    return [round(start * RATE) for start in x.starts[1:]]


@pytest.mark.slow
@pytest.mark.parametrize("noise", [white, wandering, flicker, warming, telegraph, coarse])
def test_gaps_of_a_sensor_that_runs_through_are_filled(noise):
    """At most one of about 2400 gaps is cut by chance."""
    cut = 0
    for seed in range(8):
        rng = np.random.default_rng([1, seed])
        found = signal(noise(rng), losses(rng)).fill_gaps()
        cut += len(found.segments) - 1
    assert cut <= 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("noise", "size"), [(white, 0.5), (white, 3.0), (wandering, 3.0), (flicker, 1.0), (coarse, 1.0)]
)
def test_a_gap_with_another_offset_behind_it_is_cut(noise, size):
    """In at least 7 of 8 recordings, the cut is at the restart, and there is no other one."""
    right = 0
    for seed in range(8):
        rng = np.random.default_rng([2, seed])
        x, lost = noise(rng), losses(rng)
        at = int(rng.integers(N // 10, N - N // 10))
        lost[at : at + 20] = True
        x[at:] += size
        right += time_of_cuts(signal(x, lost).fill_gaps()) == [int(np.flatnonzero(~lost[at:])[0]) + at]
    assert right >= 7


@pytest.mark.slow
def test_a_restart_does_not_count_as_a_random_walk():
    """The largest scales of the curve are those of the noise: K would be 8 times too large."""
    rng = np.random.default_rng(3)
    kept, through = [], []
    for _ in range(8):
        x, lost = rng.normal(size=N) + np.cumsum(1e-3 * rng.normal(size=N)), losses(rng)
        for at in (20_000, 41_000):
            lost[at : at + 10] = True
            x[at:] += rng.choice([-3.0, 3.0])
        broken = signal(x, lost)
        assert len(broken.fill_gaps().segments) == 3
        kept.append(gmwm.wavelet_variance(broken, levels=12).variance)
        missing = gmwm.recording.gaps.drawn(np.where(lost, 0.0, x), ~lost)
        through.append(gmwm.wavelet_variance(missing, rate=RATE, levels=12).variance)
    levels = np.arange(1, 13)
    lengths = 2.0**levels
    truth = 1 / lengths + 1e-6 * (lengths**2 + 2) / (12 * lengths)
    assert np.mean(kept, axis=0) == pytest.approx(truth, rel=0.2)
    assert np.mean(through, axis=0)[-1] > 10 * truth[-1]


def test_several_restarts_near_each_other_are_all_cut():
    rng = np.random.default_rng(4)
    x, lost = rng.normal(size=N), losses(rng)
    wanted = [20_000, 20_900, 40_000]
    for at, size in zip(wanted, (4.0, -3.0, 2.0), strict=True):
        lost[at - 10 : at] = True
        lost[at : at + 5] = False
        x[at:] += size
    assert time_of_cuts(signal(x, lost).fill_gaps()) == wanted


def two_axes():
    rng = np.random.default_rng(5)
    lost = losses(rng)
    lost[30_000:30_010] = True
    first, second = rng.normal(size=(2, N))
    first[30_000:] += 3.0
    return {
        axis: Signal.from_missing(np.where(lost, np.nan, x), RATE, "rad/s", axis)
        for axis, x in (("gyro_x", first), ("gyro_y", second))
    }


def test_each_axis_is_cut_at_its_own_restarts_unless_the_axes_must_stay_synchronous():
    signals = two_axes()
    assert [len(x.fill_gaps().segments) for x in signals.values()] == [2, 1]
    together = fill_gaps(signals)
    assert together["gyro_x"].segments == together["gyro_y"].segments
    assert len(together["gyro_y"].segments) == 2
    assert gmwm.cross(Imu(signals)).axes == ("gyro_x", "gyro_y")


@pytest.mark.slow
@pytest.mark.parametrize("block", [16_384, 29_865, N])
def test_batches_of_any_size_have_the_cuts_of_each_axis(monkeypatch, block):
    """Also where the restart is the first sample of a block."""
    signals = two_axes()
    monkeypatch.setattr(gaps, "BLOCK_SAMPLES", block)
    whole = Batch(signals)
    size = len(whole)
    parts = [whole.between(k, min(k + 7000, size)) for k in range(0, size, 7000)]
    found = join_batches(list(filled(parts))).signals
    for axis, x in signals.items():
        alone = x.fill_gaps()
        assert found[axis].values.tolist() == alone.values.tolist()
        assert (found[axis].segments, found[axis].filled) == (alone.segments, alone.filled)


@pytest.mark.slow
def test_a_file_has_the_curve_of_memory(tmp_path, monkeypatch):
    Imu(two_axes()).write(tmp_path / "a.csv")
    imu = gmwm.read(tmp_path / "a.csv")
    expected = gmwm.wavelet_variance(imu)
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 5000)
    found = gmwm.stream(tmp_path / "a.csv", chunk=1234).wavelet_variance()
    for axis in imu:
        assert (found[axis].filled, found[axis].segments) == (expected[axis].filled, expected[axis].segments)
        assert found[axis].variance.tolist() == expected[axis].variance.tolist()
