"""Welch's estimate itself: against SciPy, Parseval, pieces, gaps, limits."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import welch

from gmwm import Imu, Signal, psd
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.spectrum import PowerSpectra, PowerSpectrum, SpectrumAccumulator
from gmwm.measuring.spectrum.api import BUFFERED_SAMPLES
from tests.helpers import raises

RATE = 100.0


def walk(n: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.normal(size=n) + 0.01 * np.cumsum(rng.normal(size=n)) + 9.8


def same(found: PowerSpectrum, expected: PowerSpectrum) -> None:
    assert (found.length, found.blocks, found.samples) == (expected.length, expected.blocks, expected.samples)
    np.testing.assert_allclose(found.density, expected.density, rtol=1e-11)
    np.testing.assert_allclose(found.degrees_of_freedom, expected.degrees_of_freedom, rtol=1e-9)
    assert [round(line.frequency, 9) for line in found.lines] == [round(line.frequency, 9) for line in expected.lines]


@pytest.mark.slow
@pytest.mark.parametrize("detrend", ["constant", "linear"])
@pytest.mark.parametrize("length", [None, 1000, 4096, 8])
def test_it_is_welch_of_scipy(length, detrend):
    x = walk(50_000)
    found = psd(x, RATE, length=length, detrend=detrend)
    frequencies, density = welch(x, RATE, "hann", found.length, detrend=detrend)
    np.testing.assert_allclose(found.frequencies, frequencies, rtol=1e-14)
    np.testing.assert_allclose(found.density, density, rtol=1e-9 if detrend == "linear" else 1e-12, atol=1e-25)


def test_the_integral_is_the_variance():
    x = np.random.default_rng(2).normal(size=200_000)
    found = psd(x, RATE)
    # The Hann window weights the samples, so the integral differs from the variance by its own error only.
    assert np.sum(found.density) * RATE / found.length == pytest.approx(x.var(), rel=0.01)
    one = psd(x[:1024], RATE, length=1024)
    window = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(1024) / 1024)
    windowed = (x[:1024] - x[:1024].mean()) * window
    # Parseval: exact, with the window's own power.
    assert np.sum(one.density) * RATE / 1024 == pytest.approx(np.sum(windowed**2) / np.sum(window**2), rel=1e-12)


def test_length_follows_the_recording():
    lengths = {n: psd(np.random.default_rng(n).normal(size=n), RATE) for n in (64, 300, 5000, 130_000)}
    assert [(n, found.length) for n, found in lengths.items()] == [(64, 32), (300, 32), (5000, 512), (130_000, 8192)]
    assert lengths[130_000].blocks == 30


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_cut_anywhere(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(70, 200_000))
    x = walk(n, seed) + 0.2 * np.sin(2 * np.pi * 0.123 * np.arange(n))
    whole = psd(x, RATE)
    cuts = np.sort(rng.integers(0, n, size=5))
    pieces = SpectrumAccumulator(RATE)
    for piece in np.split(x, cuts):
        pieces.update(piece)
    same(pieces.result(), whole)
    parts = []
    for start, piece in zip((0, *cuts), np.split(x, cuts), strict=True):
        part = SpectrumAccumulator(RATE, start=int(start))
        part.update(piece)
        parts.append(pickle.loads(pickle.dumps(part)))
    left = parts[0]
    for part in parts[1:]:
        left = left.merge(part)
    same(left.result(), whole)
    right = parts[-1]
    for part in reversed(parts[:-1]):
        right = part.merge(right)
    same(right.result(), whole)


@pytest.mark.parametrize("seed", range(6))
def test_cut_anywhere_with_gaps(seed):
    rng = np.random.default_rng(100 + seed)
    n = int(rng.integers(5_000, 100_000))
    x = walk(n, seed)
    gaps = np.unique(rng.integers(1, n, size=int(rng.integers(1, 6))))
    edges = [0, *gaps.tolist(), n]
    signal = Signal(x, RATE, segments=list(pairwise(edges)))
    whole = psd(signal)
    cut = int(rng.integers(1, n))
    left, right = SpectrumAccumulator(RATE), SpectrumAccumulator(RATE, start=cut)
    for part, first, last in ((left, 0, cut), (right, cut, n)):
        inner = [g for g in gaps.tolist() if first < g < last]
        for begin, end in zip([first, *inner], [*inner, last], strict=True):
            part.update(x[begin:end])
            if end in gaps:
                part.gap()
    same(left.merge(right).result(), whole)


def test_no_block_crosses_a_gap():
    x = np.concatenate([np.zeros(3000), np.full(3000, 1e6)]) + np.random.default_rng(1).normal(size=6000)
    signal = Signal(x, RATE, segments=[(0, 3000), (3000, 6000)])
    assert np.all(psd(signal).density < 1.0)
    assert len(psd(signal, length=512).frequencies) == 257
    # 512 begin at multiples of 256: 10 in the first segment, from 3072 on 10 in the second one.
    assert psd(signal, length=512).blocks == 20


def test_large_recordings_take_the_same_way():
    x = walk(BUFFERED_SAMPLES + 1000)
    pieces = SpectrumAccumulator(RATE)
    for piece in np.array_split(x, 1000):
        pieces.update(piece)
    same(pieces.result(), psd(x, RATE))


def test_a_chunk_may_be_changed_after_update():
    x, buffer = walk(2000), np.empty(500)
    live = SpectrumAccumulator(RATE)
    for piece in np.split(x, 4):
        buffer[:] = piece
        live.update(buffer)
    same(live.result(), psd(x, RATE))


def test_merge_refuses_what_does_not_fit():
    one, other = SpectrumAccumulator(RATE), SpectrumAccumulator(RATE, start=5)
    one.update(np.ones(3))
    with raises(OptionError, 3, 5):
        one.merge(other)
    with raises(OptionError, "rate"):
        one.merge(SpectrumAccumulator(50.0, start=3))
    with raises(OptionError, argument="length"):
        SpectrumAccumulator(RATE, length=9)


@pytest.mark.slow
def test_limits_cover():
    rng, covered = np.random.default_rng(3), []
    for _ in range(40):
        found = psd(rng.normal(size=8192), RATE)
        inside = (found.lower < 2 / RATE) & (found.upper > 2 / RATE)
        covered.append(inside[2:-1].mean())
    # The true density is 2 σ²/f_s. 40 × 1022 nearly independent values.
    assert np.mean(covered) == pytest.approx(0.95, abs=0.006)


def test_degrees_of_freedom_fall_with_a_knock():
    x = np.random.default_rng(4).normal(size=32768)
    quiet = psd(x, RATE)
    assert quiet.degrees_of_freedom[5] == pytest.approx(2 * 15**2 / (15 + 2 * 14 / 36))
    knocked = x.copy()
    knocked[10_000:10_200] *= 100
    assert psd(knocked, RATE).degrees_of_freedom[5] < 5


def test_mapping_of_axes():
    imu = Imu.from_arrays({"gyro_x": walk(1000), "accel_z": walk(1000, 2)}, rate=RATE)
    found = psd(imu)
    assert isinstance(found, PowerSpectra)
    assert list(found) == ["gyro_x", "accel_z"]
    assert (found["gyro_x"].axis, found["gyro_x"].unit) == ("gyro_x", "rad/s")
    np.testing.assert_array_equal(found["accel_z"].density, psd(imu["accel_z"]).density)
    assert pickle.loads(pickle.dumps(found)).to_dict() == found.to_dict()
    assert "gyro_x" in found.summary()
    with raises(DataError, "gyro_y"):
        found["gyro_y"]


def test_round_trip_and_frame():
    x = walk(20_000) + np.sin(2 * np.pi * 0.2 * np.arange(20_000))
    found = psd(x, RATE)
    again = PowerSpectrum.from_dict(found.to_dict())
    assert again.to_dict() == found.to_dict()
    assert again.lines == found.lines
    frame = found.to_polars()
    assert frame.columns == ["frequency", "density", "lower", "upper", "degrees_of_freedom"]
    assert frame.height == len(found)
    assert "line: 20.0002 ±" in found.summary()
    assert "<pre>" in found._repr_html_()


def test_smoothed_keeps_lines_and_the_integral():
    n = 100_000
    x = walk(n) + np.sin(2 * np.pi * 0.2 * np.arange(n))
    found = psd(x, RATE)
    smooth = found.smoothed()
    assert len(smooth) < 300
    # Around the line every frequency is kept.
    near, own = (np.abs(one.frequencies - 20.0) < 4 * RATE / found.length for one in (smooth, found))
    np.testing.assert_array_equal(smooth.density[near], found.density[own])
    assert smooth.degrees_of_freedom.max() > 20 * found.degrees_of_freedom.max()
    assert smooth.lines == found.lines
    with raises(DataError, "smoothed"):
        smooth.smoothed()


def test_errors():
    with raises(DataError, 64, 63):
        psd(np.ones(63), RATE)
    with raises(DataError, 512, 500):
        psd(np.ones(500), RATE, length=512)
    with raises(OptionError, "100 Hz", argument="rate"):
        psd(Signal(np.ones(100), RATE), 50.0)
    with raises(DataError, "NaN"):
        psd(np.full(100, np.nan), RATE)
    with raises(OptionError, argument="power"):
        psd(walk(1000), RATE).detectable_amplitude(1.0, power=1.0)
    for value in (1.0, 0.1, 1e9 / 3):
        constant = psd(np.full(20_000, value), RATE)
        assert constant.lines == constant.bumps == ()
        assert np.all(constant.density == 0)
