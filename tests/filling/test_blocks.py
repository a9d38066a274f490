"""A recording with gaps is filled in the same way in whatever parts it arrives."""

from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm import Imu, Signal
from gmwm.measuring.streaming.passes import feed_chunks
from gmwm.recording import batches
from gmwm.recording.batches import Batch, Batches, join_batches
from gmwm.recording.chunks import Chunk
from gmwm.recording.gaps import filled, gaps
from gmwm.recording.gaps.gaps import joined_ranges
from tests.helpers import code_of

RATE = 100.0


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch):
    monkeypatch.setattr(gaps, "BLOCK_SAMPLES", 4096)
    monkeypatch.setattr(gaps, "CONTEXT", 2048)
    monkeypatch.setattr(gaps, "LONGEST_FILLED_SAMPLES", 128)


def recording(seed, size=14_000):
    """Two axes with the same losses: single samples, bursts, gaps at the edges of blocks, and some that stay."""
    rng = np.random.default_rng(seed)
    lost = rng.random(size) < rng.choice([0.002, 0.02, 0.1])
    for first, length in zip(rng.integers(50, size - 1000, 12), rng.integers(2, 200, 12), strict=True):
        lost[first : first + length] = True
    lost[4000 : 4000 + int(rng.integers(1, 100))] = True
    lost[[0, 1, 2, -3, -2, -1]] = False
    first, second = np.cumsum(rng.normal(size=(2, size)), axis=1) * 0.01 + rng.normal(size=(2, size))
    return tuple(
        Signal.from_missing(np.where(lost, np.nan, x), RATE, "rad/s", axis, start=5.0)
        for x, axis in ((first, "gyro_x"), (second, "gyro_y"))
    )


def cut_at(signal, cuts):
    """The signal in batches that end at some samples."""
    whole, edges = Batch({signal.axis: signal}), [0, *cuts, len(signal)]
    return [whole.between(a, b) for a, b in pairwise(edges)]


def as_one(parts, axis):
    return join_batches(list(parts)).signals[axis]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_cut_anywhere(seed):
    rng = np.random.default_rng([1, seed])
    x = recording(seed)[0]
    whole = x.fill_gaps()
    assert whole.filled > 0
    # Anywhere, at gaps, and in parts far smaller than a block.
    begins = [first for first, _ in x.segments[1:]]
    at_gaps = rng.choice(begins, min(len(begins), 20), replace=False).tolist()
    for cuts in (rng.integers(1, len(x), 5).tolist(), at_gaps, range(700, len(x), 700), [4096, 8192], [4095, 4097]):
        found = as_one(filled(cut_at(x, sorted(set(cuts)))), "gyro_x")
        assert found.values.tolist() == whole.values.tolist()
        assert (found.segments, found.filled) == (whole.segments, whole.filled)
        np.testing.assert_allclose(found.starts, whole.starts, rtol=0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_known_samples_keep_their_places_and_the_inspection_knows_the_gaps_that_stay(seed):
    x = recording(seed)[0]
    whole = x.fill_gaps()
    assert len(whole) == len(x) + whole.filled
    known = dict(zip(np.rint(whole.times() * RATE).tolist(), whole.values.tolist(), strict=True))
    assert len(known) == len(whole)
    assert [known[k] for k in np.rint(x.times() * RATE).tolist()] == x.values.tolist()
    assert len(joined_ranges(RATE, x.segments, x.starts)) == len(whole.segments)


@pytest.mark.slow
def test_each_axis_is_filled_as_it_would_be_alone():
    signals = recording(3)
    both = list(filled([Batch({x.axis: x for x in signals})]))
    for x in signals:
        assert as_one(both, x.axis).values.tolist() == x.fill_gaps().values.tolist()


def test_samples_without_short_gaps_do_not_wait():
    x = np.random.default_rng(1).normal(size=20_000)
    for segments, starts in (((), ()), (((0, 9000), (9000, 20_000)), (0.0, 1e4))):
        signal = Signal(x, RATE, axis="gyro_x", segments=segments, starts=starts)
        parts = cut_at(signal, [3000, 9000, 9500])
        found = list(filled(parts))
        assert all(a is b for a, b in zip(found, parts, strict=True))
    late = Signal(x, RATE, axis="gyro_x", segments=((0, 15_000), (15_000, 20_000)), starts=(0.0, 150.01))
    found = filled(parts := cut_at(late, [5000, 14_000]))
    assert next(found) is parts[0]
    assert next(found) is parts[1]
    assert as_one(filled(parts), "gyro_x").values.tolist() == late.fill_gaps().values.tolist()


def test_gaps_of_unknown_length_stay():
    x = np.random.default_rng(1).normal(size=20_000)
    signal = Signal(x, RATE, axis="gyro_x", segments=((0, 9000), (9000, 20_000)))
    assert not signal.gaps_known
    assert signal.fill_gaps() is signal
    assert gmwm.wavelet_variance(signal).segments == (9000, 11_000)
    assert "gaps-filled:filled" not in {code_of(remark) for remark in gmwm.inspect(Imu({"gyro_x": signal})).remarks}


@pytest.mark.slow
@pytest.mark.parametrize("robust", [False, True])
def test_a_file_has_the_curve_of_memory_in_batches_of_any_size(tmp_path, monkeypatch, robust):
    signals = {x.axis: x for x in recording(5)}
    Imu(signals).write(tmp_path / "a.csv")
    imu = gmwm.read(tmp_path / "a.csv")
    expected = gmwm.wavelet_variance(imu, robust=robust)
    for size in (1 << 21, 4096, 333):
        monkeypatch.setattr(batches, "BATCH_SAMPLES", size)
        found = gmwm.stream(tmp_path / "a.csv", chunk=1234).wavelet_variance(robust=robust)
        for axis in signals:
            assert (found[axis].filled, found[axis].segments) == (expected[axis].filled, expected[axis].segments)
            assert found[axis].variance.tolist() == expected[axis].variance.tolist()
            assert found[axis].lower.tolist() == expected[axis].lower.tolist()


@pytest.mark.slow
def test_a_calibration_is_the_same_from_memory_and_from_chunks(tmp_path, monkeypatch):
    Imu({x.axis: x for x in recording(6)}).write(tmp_path / "a.csv")
    expected = gmwm.calibrate(gmwm.read(tmp_path / "a.csv"), within="WN + RW")
    assert "gaps-filled:filled" in {code_of(remark) for remark in expected.recording_remarks}
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 7000)
    found = gmwm.calibrate(gmwm.stream(tmp_path / "a.csv", chunk=501), within="WN + RW")
    assert found.to_dict() == expected.to_dict()


@pytest.mark.slow
def test_a_recording_that_is_iterated_twice_is_filled_in_the_same_way():
    x = recording(7)[0]
    source = Batches(Imu({"gyro_x": x}))
    one, two = (as_one(filled(source), "gyro_x").values.tolist() for _ in range(2))
    assert one == two


@pytest.mark.slow
def test_a_recording_that_is_watched_shows_long_scales_across_gaps():
    x = recording(8)[0]
    chunks = [
        Chunk({"gyro_x": x.values[k : min(k + 100, last)]}, k, number, start + (k - first) / RATE)
        for number, ((first, last), start) in enumerate(zip(x.segments, x.starts, strict=True))
        for k in range(first, last, 100)
    ]
    live = gmwm.WaveletAccumulator(RATE)
    feed_chunks(chunks, {"gyro_x": live})
    found, expected = live.result(), gmwm.wavelet_variance(x)
    assert (found.filled, found.segments, len(found)) == (expected.filled, expected.segments, len(expected))
    assert found.variance[:10] == pytest.approx(expected.variance[:10], rel=0.1)
