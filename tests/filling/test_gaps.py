"""Which gaps of a signal are filled, and what the wavelet variance, Allan variance and transforms make of them."""

from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm import Signal
from gmwm.base.time_base import lost_before
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.transform import dwt, modwt
from gmwm.recording.gaps import joined_ranges
from gmwm.theory.processes.model import as_model

RATE = 100.0


def with_gaps(lengths, lost, seed=0):
    """White noise in segments, with a number of samples lost between them."""
    ends = np.cumsum([0, *lengths])
    times = np.concatenate([[0], np.cumsum(np.array(lengths[:-1]) + np.array(lost))]) / RATE + 5.0
    x = np.random.default_rng(seed).normal(size=ends[-1])
    return Signal(x, RATE, "rad/s", "gyro_x", segments=list(pairwise(ends)), starts=times)


def test_lost_samples_are_counted_and_none_where_the_clock_was_set_back():
    segments, starts = [(0, 4000), (4000, 8000), (8000, 12000), (12000, 16000)], [7.0, 47.03, 60.0, 100.02]
    assert lost_before(RATE, segments, starts).tolist() == [3, -2703, 2]
    assert joined_ranges(RATE, segments, starts) == ((0, 8000), (8000, 16000))
    x = np.random.default_rng(1).normal(size=16000)
    filled = Signal(x, RATE, "rad/s", "gyro_x", segments=segments, starts=starts).fill_gaps()
    assert filled.segments == ((0, 8003), (8003, 16005))
    assert filled.filled == 5


@pytest.mark.parametrize(
    ("lengths", "lost", "left"),
    [
        ((5000, 5000), (1,), 1),
        ((5000, 5000), (300,), 1),
        ((5000, 5000), (320,), 2),  # fewer than 16 times the gap on each side
        ((5000, 5000), (-10,), 2),  # the clock was set back
        ((5000, 5000), (0,), 2),
        ((1, 5000), (1,), 2),
        ((5000, 5, 5000), (100, 1), 1),  # a few samples between two gaps
        ((2000, 2000, 2000), (5, 10_000), 2),
        ((200_000, 200_000), (8_000,), 1),
        ((50,) * 40, (10,) * 39, 1),
        ((50,) * 40, (25,) * 39, 40),  # a third is lost
    ],
)
def test_which_gaps_are_filled(lengths, lost, left):
    x = with_gaps(lengths, lost)
    filled = x.fill_gaps()
    assert len(filled.segments) == left
    assert len(filled) == len(x) + filled.filled
    assert filled.filled == (sum(max(g, 0) for g in lost) if left == 1 else filled.filled)
    assert filled.start == x.start
    assert (filled.rate, filled.unit, filled.axis) == (x.rate, x.unit, x.axis)


def test_known_samples_keep_their_times():
    x = with_gaps((3000, 400, 3000, 2000), (7, 1, 5000))
    filled = x.fill_gaps()
    assert filled.filled == 8
    found = dict(zip(np.rint(filled.times() * RATE).tolist(), filled.values.tolist(), strict=True))
    assert [found[k] for k in np.rint(x.times() * RATE).tolist()] == x.values.tolist()


def test_nothing_to_fill_returns_the_signal():
    x = with_gaps((5000, 5000), (100_000,))
    assert x.fill_gaps() is x
    whole = Signal(x.values, RATE)
    assert whole.fill_gaps() is whole


def test_long_scales_are_seen_across_gaps():
    x = with_gaps((200,) * 200, (1,) * 199)
    wv, apart = gmwm.wavelet_variance(x), gmwm.wavelet_variance(x, fill_gaps=False)
    assert (len(wv), len(apart)) == (15, 7)
    assert (wv.filled, wv.samples, wv.segments) == (199, 40_199, ())
    assert "40000 samples and 199 filled ones" in wv.summary()
    assert wv.variance[:10] == pytest.approx(0.5 ** np.arange(1, 11), rel=0.3)
    again = gmwm.WaveletVariance.from_dict(wv.to_dict())
    assert again.filled == 199
    assert again.lower.tolist() == wv.lower.tolist()


def test_limits_degrees_of_freedom_and_covariance_include_the_loss():
    x = with_gaps((90,) * 200, (10,) * 199)
    wv = gmwm.wavelet_variance(x)
    whole = gmwm.wavelet_variance(Signal(x.fill_gaps().values, RATE))
    factor = 1 + 2.5 * 1990 / 19_990
    assert wv.variance.tolist() == whole.variance.tolist()
    assert (wv.segments, wv.filled) == ((), 1990)
    assert wv.degrees_of_freedom == pytest.approx(whole.degrees_of_freedom / factor)
    assert np.all(wv.upper > whole.upper)
    model = as_model("WN(sigma2=1.0)")
    found, plain = covariance(model, Design.of(wv)), covariance(model, Design.of(whole))
    assert found == pytest.approx(factor * plain, rel=1e-12)


@pytest.mark.slow
def test_scatter_of_estimates_is_that_of_the_covariance():
    rng = np.random.default_rng(7)
    rows, n, share = [], 2048, 0.1
    for _ in range(250):
        x = rng.normal(size=n)
        x[20:-20][rng.random(n - 40) < share] = np.nan
        wv = gmwm.wavelet_variance(Signal.from_missing(x, RATE), levels=6)
        rows.append(wv.variance)
    ratio = np.var(rows, axis=0) / np.diag(covariance(as_model("WN(sigma2=1.0)"), Design.of(wv)))
    assert np.all(np.abs(ratio - 1) < 4 * np.sqrt(2 / 250))
    assert np.mean(rows, axis=0) == pytest.approx(0.5 ** np.arange(1, 7), rel=0.02)


@pytest.mark.parametrize(
    "measure",
    [gmwm.allan_variance, gmwm.hadamard_variance, gmwm.total_variance, modwt, dwt, gmwm.psd],
    ids=lambda f: f.__name__,
)
def test_every_measure_takes_gaps(measure):
    x = with_gaps((500,) * 20, (2,) * 19)
    found, wanted = measure(x), measure(Signal(x.fill_gaps().values, RATE, "rad/s", "gyro_x"))
    if hasattr(found, "variance"):
        assert found.variance.tolist() == wanted.variance.tolist()
    elif hasattr(found, "density"):
        assert found.density.tolist() == wanted.density.tolist()
    else:
        assert np.array_equal(found.smooth, wanted.smooth)
