"""Curves of recordings that come in chunks are those of the recordings in memory."""

import threading
from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.files.formats import parquet
from gmwm.files.readers import interpretation
from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.recording.signals import Signal
from tests.helpers import raises


def in_chunks(x, segments, seed, **options):
    """An accumulator fed with chunks cut anywhere, gaps between the segments."""
    rng = np.random.default_rng(seed)
    made = WaveletAccumulator(100.0, unit="rad/s", axis="gyro_x", **options)
    for k, (first, last) in enumerate(segments):
        if k:
            made.gap()
        cuts = np.sort(rng.integers(first, last + 1, size=rng.integers(0, 5)))
        for part in np.split(x[first:last], cuts - first):
            made.update(part)
    return made


def ranges(lengths):
    edges = np.concatenate([[0], np.cumsum(lengths)])
    return [(int(a), int(b)) for a, b in pairwise(edges)]


def same(found, expected):
    for name in ("levels", "counts"):
        assert np.array_equal(getattr(found, name), getattr(expected, name)), name
    for name in ("variance", "lower", "upper"):
        assert np.allclose(getattr(found, name), getattr(expected, name), rtol=1e-11, atol=0), name
    for name in ("segments", "samples", "rate", "unit", "axis", "confidence"):
        assert getattr(found, name) == getattr(expected, name), name


@pytest.mark.parametrize(
    "lengths",
    [(5000,), (700, 1, 3000), (8, 8), (3, 5, 7, 9), (1, 2, 3, 8), (4000, 7), (40, 1000, 2, 16, 16), (100,) * 30],
)
def test_segments_are_pooled_as_in_memory(lengths):
    x = 9.81 + np.cumsum(np.random.default_rng(1).normal(size=sum(lengths)))
    expected = gmwm.wavelet_variance(Signal(x, 100.0, "rad/s", "gyro_x", segments=ranges(lengths)), fill_gaps=False)
    for seed in range(3):
        found = in_chunks(x, ranges(lengths), seed)
        assert found.lengths == lengths
        assert len(found) == x.size
        same(found.result(), expected)
    assert np.allclose(found.result(0.5).lower, gmwm.wavelet_variance(
        Signal(x, 100.0, segments=ranges(lengths)), confidence=0.5, fill_gaps=False).lower)  # fmt: skip


def test_large_scales_take_strides_in_each_segment():
    lengths = (40_000, 9_000, 70_000)
    x = np.random.default_rng(2).normal(size=sum(lengths))
    found = in_chunks(x, ranges(lengths), 1, exact=10).result()
    all_of_them = gmwm.wavelet_variance(Signal(x, 100.0, segments=ranges(lengths)), fill_gaps=False)
    assert found.strides == (*(1,) * 10, *(2 ** (j - 6) for j in range(11, 17)))
    assert np.array_equal(found.counts[:10], all_of_them.counts[:10])
    assert np.allclose(found.variance[:10], all_of_them.variance[:10], rtol=1e-11, atol=0)
    taken = sum(((n - 2**12) // 2**6 + 1) for n in lengths)
    assert found.counts[11] == taken
    # The strided estimates know the same but for a thousandth of the variance.
    error = np.sqrt(2 / all_of_them.degrees_of_freedom[10:])
    assert np.all(np.abs(found.variance[10:] / all_of_them.variance[10:] - 1) < 0.2 * error)
    assert np.allclose(found.degrees_of_freedom, all_of_them.degrees_of_freedom)


def test_a_result_in_between_changes_nothing():
    x = np.random.default_rng(3).normal(size=4000)
    asked, left = WaveletAccumulator(100.0), WaveletAccumulator(100.0)
    for k in range(0, 4000, 500):
        for one in (asked, left):
            if k == 2000:
                one.gap()
                one.gap()
            one.update(x[k : k + 500])
        asked.result()
    same(asked.result(), left.result())


def test_a_drift_keeps_its_sign_over_gaps():
    rng = np.random.default_rng(4)
    for slope in (3e-3, -3e-3):
        x = slope * np.arange(9000) + rng.normal(size=9000)
        found = in_chunks(x, ranges((3000, 2000, 4000)), 1, exact=8).result()
        assert found.slope == pytest.approx(slope, rel=0.1)


def test_too_little_is_an_error():
    made = WaveletAccumulator(100.0)
    with raises(DataError, 8):
        made.result()
    for _ in range(3):
        made.update(np.arange(7.0))
        made.gap()
    with raises(DataError, 7):
        made.result()
    with raises(OptionError, argument="exact", got=2):
        WaveletAccumulator(100.0, exact=2)


MODELS = {"gyro": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel": "WN(sigma2=2e-5)"}


@pytest.fixture
def recording(tmp_path):
    path = tmp_path / "six.parquet"
    gmwm.simulate(MODELS, rate=100.0, samples=30_000, rng=5).write(path)
    return path


@pytest.mark.slow
def test_a_file_in_one_pass_is_the_file_in_memory(recording, monkeypatch):
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 3000)
    monkeypatch.setattr(parquet, "TABLE_ROWS", 4096)
    imu = gmwm.read(recording)
    told = []
    curves = gmwm.stream(recording).wavelet_variance(exact=15, done=told.append)
    assert list(curves) == list(imu.axes)
    for axis, found in curves.items():
        same(found, gmwm.wavelet_variance(imu[axis]))
    assert told == sorted(told)
    assert told[-1] == 30_000
    assert len(told) >= 30_000 / 4096
    one = gmwm.stream(recording).wavelet_variance(levels=5, confidence=0.9, threads=1)["accel_z"]
    expected = gmwm.wavelet_variance(imu["accel_z"], levels=5, confidence=0.9)
    same(one, expected)


@pytest.mark.slow
def test_a_file_with_gaps(tmp_path):
    k = np.arange(20_000)
    time = (k + 300 * (k >= 6000) + 5 * (k >= 6003)) * 0.01
    x = np.random.default_rng(6).normal(size=(k.size, 2))
    np.savetxt(tmp_path / "a.csv", np.column_stack([time, x]), "%.9g", ",", header="time,gyro_x,gyro_z", comments="")
    curves = gmwm.stream(tmp_path / "a.csv", units={"gyro": "deg/s"}).wavelet_variance()
    imu = gmwm.read(tmp_path / "a.csv", units={"gyro": "deg/s"})
    assert (curves["gyro_z"].segments, curves["gyro_z"].filled) == ((), 305)
    for axis in imu.axes:
        same(curves[axis], gmwm.wavelet_variance(imu[axis]))


@pytest.mark.slow
def test_what_is_wrong_in_the_file_ends_the_pass_and_its_threads(tmp_path):
    x = np.random.default_rng(7).normal(size=300_000)
    (tmp_path / "a.csv").write_text("gyro_x [rad/s]\n" + "".join(f"{v:.3f}\n" for v in x) + "broken\n0.1\n")
    with raises(ReadError, "line 300002", code="row-invalid"):
        gmwm.stream(tmp_path / "a.csv", 100.0, chunk=5000).wavelet_variance()

    def interrupt(samples):
        raise KeyboardInterrupt

    np.save(tmp_path / "b.npy", x)
    with pytest.raises(KeyboardInterrupt):
        gmwm.stream(tmp_path / "b.npy", 100.0, ["gyro_x"], {"gyro": "deg/s"}).wavelet_variance(done=interrupt)
    for thread in threading.enumerate():
        if thread is not threading.main_thread() and "ThreadPool" in thread.name:
            thread.join(5.0)
            assert not thread.is_alive()


def test_a_fit_of_a_pass(recording):
    """The result is one like any other: fits, intervals and all."""
    curve = gmwm.stream(recording).wavelet_variance(exact=9)["gyro_x"]
    assert curve.strides[-1] > 1
    found = gmwm.fit("WN + RW", curve)
    truth = gmwm.Model.parse(MODELS["gyro"]).parameters
    assert found.parameters["WN.sigma2"] == pytest.approx(truth["WN.sigma2"], rel=0.1)
    assert np.all(np.isfinite(list(found.standard_errors.values())))
