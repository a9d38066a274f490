"""What users of NumPy and pandas pass: recordings, arrays of several columns, bare arrays, ranges, fits, gaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm import Imu, Signal
from gmwm.base.errors import DataError
from tests.helpers import raises

X = np.random.default_rng(1).normal(size=(4000, 2))
IMU = Imu.from_arrays({"gyro_x": X[:, 0] * 1e-3, "gyro_y": X[:, 1] * 1e-3}, rate=100)
CURVES = [gmwm.allan_variance, gmwm.hadamard_variance, gmwm.total_variance, gmwm.wavelet_variance, gmwm.psd]


@pytest.mark.parametrize("curve", CURVES)
def test_a_recording_and_columns_give_a_result_each(curve):
    values = {"psd": "density"}.get(curve.__name__, "variance")
    results, columns = curve(IMU), curve(X, 100.0)
    assert list(results) == ["gyro_x", "gyro_y"]
    assert list(columns) == ["column_0", "column_1"]
    one = curve(IMU["gyro_y"])
    assert np.array_equal(getattr(results["gyro_y"], values), getattr(one, values))
    assert np.array_equal(getattr(columns["column_1"], values), getattr(curve(X[:, 1], 100.0), values))
    assert "gyro_y" in results.summary()
    assert "gyro_y" in repr(results)


@pytest.mark.parametrize("curve", CURVES)
def test_a_bare_array_has_rate_1_and_the_result_says_so(curve):
    result = curve(X[:, 0])
    assert result.rate == 1.0
    if curve is not gmwm.psd:
        assert "rate=1" in repr(result)
        assert "rate=1" in result.summary()


@pytest.mark.parametrize("curve", CURVES[:3])
@pytest.mark.parametrize("clusters", ["octave", "decade", [1, 3, 200]])
def test_segments_are_pooled_by_their_numbers_of_differences(curve, clusters):
    """A gap of unknown length is not filled. The pooled variance is the mean over the differences of both segments."""
    signal = Signal(X[:, 0], 100.0, "rad/s", "gyro_x", segments=((0, 1000), (1000, 4000)))
    pooled = curve(signal, clusters=clusters)
    parts = [curve(X[:1000, 0], 100.0, clusters=clusters), curve(X[1000:, 0], 100.0, clusters=clusters)]
    assert pooled.samples == 4000
    assert pooled.clusters.tolist() == parts[1].clusters.tolist()
    for k, n in enumerate(pooled.clusters.tolist()):
        terms = [(p.counts[j], p.variance[j]) for p in parts for j in np.flatnonzero(p.clusters == n)]
        counts = sum(count for count, _ in terms)
        assert pooled.counts[k] == counts
        assert pooled.variance[k] == pytest.approx(sum(c * v for c, v in terms) / counts, rel=1e-12)
    whole = curve(X[:, 0], 100.0, clusters=clusters)
    assert np.all((pooled.lower < pooled.variance) & (pooled.variance < pooled.upper))
    assert pooled.degrees_of_freedom[0] == pytest.approx(whole.degrees_of_freedom[0], rel=0.01)


@pytest.mark.slow
def test_the_limits_of_pooled_segments_contain_the_truth():
    """White noise of variance 1 in four segments: the 90 % limits of the Allan variance contain 1/n."""
    inside = np.zeros(6)
    edges = (0, 300, 700, 1500, 2000)
    for seed in range(300):
        noise = np.random.default_rng(seed).normal(size=2000)
        signal = Signal(noise, 1.0, segments=tuple(pairwise(edges)))
        curve = gmwm.allan_variance(signal, confidence=0.9)
        truth = 1 / curve.clusters[:6]
        inside += (curve.lower[:6] <= truth) & (truth <= curve.upper[:6])
    assert np.all(np.abs(inside / 300 - 0.9) < 4 * np.sqrt(0.09 / 300))


def test_fit_select_and_rank_take_a_recording():
    fits = gmwm.fit("WN", IMU)
    assert fits["gyro_y"].parameters == gmwm.fit("WN", IMU["gyro_y"]).parameters
    assert gmwm.select("WN + QN", IMU)["gyro_x"].recommended.structure == "WN"
    assert [candidate.structure for candidate in gmwm.rank(["WN", "QN"], X)["column_1"]] == ["WN", "QN"]
    signal = gmwm.simulate_signal(fits["gyro_x"], rate=100, samples=100, rng=1).signal
    assert len(signal) == 100


def test_ranges_and_lists_of_axes():
    signal = Signal(X[:100, 0], 10.0, segments=((0, 40), (40, 100)), starts=(0.0, 5.0))
    part = signal[30:60]
    assert part.values.tolist() == X[30:60, 0].tolist()
    assert (part.segments, part.starts, part.start) == (((0, 10), (10, 30)), (3.0, 5.0), 3.0)
    assert len(signal[-10:]) == 10
    assert list(IMU[["gyro_y"]]) == ["gyro_y"]
    cut = IMU[1000:]
    assert (len(cut), cut["gyro_x"].start) == (3000, 10.0)
    assert np.asarray(IMU[:9]).shape == (9, 2)
    for bad in (slice(0, 10, 2), slice(5, 5), 3):
        with raises(DataError, argument="samples"):
            signal[bad]
    with raises(DataError, argument="axis"):
        IMU[["gyro_q"]]


def test_axes_of_an_array_may_have_numbers():
    imu = Imu.from_arrays({"gyro_1": X[:, 0], "gyro_2": X[:, 1]}, rate=100)
    assert list(imu) == ["gyro_1", "gyro_2"]
    assert imu["gyro_1"].unit == "rad/s"
    bare = Imu({"gyro_1": X[:, 0], "gyro_2": X[:, 1]})
    assert (bare.rate, bare["gyro_2"].unit) == (1.0, "rad/s")
    with raises(DataError, argument="signals", advises=["from_arrays"]):
        Imu(X)
