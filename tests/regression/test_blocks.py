"""Block means on the clock of a recording, against loops over samples."""

import numpy as np
import pytest

from gmwm.measuring.regression.blocks import BlockClock

RATE = 10.0
SEGMENTS = ((0, 37), (37, 100), (100, 131))
STARTS = (0.0, 5.0, 20.0)
"""The second segment begins 13 samples after the end of the first, the third 87 after the end of the second."""


def places():
    """Place of each sample on the clock, in samples."""
    starts = np.repeat(STARTS, [b - a for a, b in SEGMENTS])
    within = np.concatenate([np.arange(b - a) for a, b in SEGMENTS])
    return np.round(starts * RATE).astype(int) + within


def clock(length):
    return BlockClock.of(RATE, SEGMENTS, STARTS, length=length)


@pytest.mark.parametrize("length", [1, 4, 16, 64])
def test_means_and_counts_are_those_of_a_loop(length):
    values = np.random.default_rng(1).normal(size=131)
    own = clock(length)
    block = places() // length
    counts = np.bincount(block, minlength=own.blocks)
    assert own.blocks == block[-1] + 1
    assert own.counts.tolist() == counts.tolist()
    sums = np.bincount(block, weights=values, minlength=own.blocks)
    assert np.allclose(own.means(values), sums / np.maximum(counts, 1))
    assert own.present().tolist() == (2 * counts >= length).tolist()
    assert own.whole().tolist() == (counts == length).tolist()


def test_a_line_in_time_is_interpolated_exactly():
    line = 3.0 + 0.25 * places()
    for length in (1, 4, 16):
        own = clock(length)
        means = 3.0 + 0.25 * ((np.arange(own.blocks) + 0.5) * length - 0.5)
        assert np.allclose(own.interpolate(means, 0, 131), line)
        assert np.allclose(own.interpolate(means, 30, 50), line[30:50])


def test_knocks_hardly_change_clipped_means():
    rng = np.random.default_rng(2)
    x = rng.normal(size=65536)
    own = BlockClock.of(RATE, ((0, x.size),), (0.0,), length=64)
    assert np.array_equal(own.means(x, clipped=True), own.means(x))
    knocked = x.copy()
    knocked[1000:1005] += 1e4
    assert np.max(np.abs(own.means(knocked) - own.means(x))) > 100
    assert np.max(np.abs(own.means(knocked, clipped=True) - own.means(x))) < 1.5


def test_a_long_recording_has_at_least_4096_blocks_and_long_gaps_cost_no_memory():
    assert BlockClock.of(100.0, ((0, 10_000_000),), (0.0,)).length == 2048
    assert BlockClock.of(100.0, ((0, 5000),), (0.0,)).length == 1
    far = BlockClock.of(100.0, ((0, 5000), (5000, 10_000)), (0.0, 1e7))
    assert far.blocks < 1 << 18


def test_blocks_within_blocks_keep_the_means_and_the_size_of_a_cycle():
    n = 1 << 12
    fine, coarse = (BlockClock.of(RATE, ((0, n),), (0.0,), length=length) for length in (4, 256))
    cycle = np.sin(2 * np.pi * np.arange(n) / (n / 2))
    found = coarse.onto(coarse.means(cycle), fine)
    assert np.allclose(found.reshape(16, -1).mean(axis=1), coarse.means(cycle))
    exact = fine.means(cycle)
    assert found @ exact / (exact @ exact) == pytest.approx(1, abs=0.003)


def test_blocks_within_blocks_follow_a_line_across_gaps():
    line = 3.0 + 0.25 * places()
    own = clock(16).onto(clock(16).means(line), clock(4))
    assert own.size == clock(4).blocks
    assert np.all(np.isfinite(own))
    # A block of 16 samples may have half of them: its mean is then 4 samples off its centre, or 1.0 on the line, and
    # the spline overshoots.
    assert np.allclose(own, 3.0 + 0.25 * (np.arange(own.size) * 4 + 1.5), atol=1.3)
