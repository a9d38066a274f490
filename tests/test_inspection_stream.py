"""`inspect` of a stream gives the same result as for the recording in memory."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm.measuring.inspection.axis_statistics import AxisStatistics
from gmwm.measuring.inspection.time_grid import Extent
from gmwm.recording.signals import Imu
from tests.helpers import codes, raises

RATE = 100.0


def written(folder, values, stamps):
    path = folder / "static.csv"
    names = ["time [s]", *(f"gyro_{axis} [rad/s]" for axis in "xyz"), *(f"accel_{axis} [m/s2]" for axis in "xyz")]
    table = np.column_stack([stamps, values])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9f")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("chunk", [997, 1_000_000])
def test_a_stream_is_looked_at_as_the_recording(tmp_path, chunk):
    rng = np.random.default_rng(1)
    values = rng.normal(0, [1e-3] * 3 + [1e-2] * 3, (40_000, 6))
    values[:, 5] += 9.81
    values[12_345:12_350, [0, 4]] += 0.5  # a knock
    values[23_456:, 1] += 2e-3  # a step
    values[-1, 2] += 1  # in the last block
    values[:, 3] = np.round(values[:, 3] / 0.01) * 0.01  # coarse
    values[5000:8000, 5] += rng.normal(0, 0.06, 3000)  # motion
    stamps = np.arange(40_000) / RATE + 3.0
    stamps[31_003:] += 7.0
    path = written(tmp_path, values, stamps)
    whole, chunked = gmwm.inspect(gmwm.read(path)), gmwm.inspect(gmwm.stream(path, chunk=chunk))
    assert len(whole.knocks) == 2
    assert len(whole.steps) == 1
    assert not whole.static
    assert whole.segments == 2
    a, b = whole.to_dict(), chunked.to_dict()
    assert [k["time"] for k in a["knocks"]] == [k["time"] for k in b["knocks"]]
    assert codes(whole.remarks) == codes(chunked.remarks)
    assert {"gaps", "recording-moved:moved", "knocks", "level-steps:clear"} <= {*codes(whole.remarks)}
    assert_alike(a, b)


def assert_alike(a, b):
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_alike(a[key], b[key])
    elif isinstance(a, list):
        assert len(a) == len(b)
        for one, other in zip(a, b, strict=True):
            assert_alike(one, other)
    elif isinstance(a, float):
        assert b == pytest.approx(a, rel=1e-9)
    else:
        assert a == b


@pytest.mark.parametrize("segments", [((0, 5000),), ((0, 37), (37, 2001), (2001, 2400), (2400, 5000))])
def test_however_it_is_cut(segments):
    rng = np.random.default_rng(2)
    x = rng.normal(size=5000)
    x[[3, 2000, 2399, 4990]] += 40
    extent = Extent(RATE, segments, tuple(first / RATE + k for k, (first, _) in enumerate(segments)))
    whole = AxisStatistics(extent, 0.0)
    whole.update(x)
    for cuts in ([1], [999, 1000, 1001], sorted(rng.integers(0, 5000, 60).tolist())):
        parted = AxisStatistics(extent, 0.0)
        for part in np.split(x, cuts):
            parted.update(part)
        for a, b in zip(whole.outliers(), parted.outliers(), strict=True):
            np.testing.assert_array_equal(a, b)
        for of in ("all", "differences", "windows", "calm", "steps"):
            np.testing.assert_allclose(getattr(parted, of).means, getattr(whole, of).means, rtol=1e-9, atol=1e-12)
            np.testing.assert_allclose(getattr(parted, of).variances(), getattr(whole, of).variances(), rtol=1e-9)
            np.testing.assert_array_equal(getattr(parted, of).counts, getattr(whole, of).counts)
        for (first, a), (again, b) in zip(whole.levels(), parted.levels(), strict=True):
            assert first == again
            np.testing.assert_array_equal(a, b)


def test_moments_are_those_of_numpy():
    rng = np.random.default_rng(3)
    x = 1e3 + rng.normal(size=5000)
    parted = AxisStatistics(Extent(RATE, ((0, 2100), (2100, 5000)), (0.0, 30.0)), 0.0)
    parted.update(x)
    assert parted.all.means[0] == pytest.approx(x.mean(), rel=1e-14)
    assert parted.all.variances()[0] == pytest.approx(x.var(), rel=1e-9)
    steps = np.delete(np.diff(x), 2099)
    assert parted.differences.means[0] == pytest.approx(np.mean(steps**2), rel=1e-12)


def test_what_is_no_recording():
    with raises(gmwm.errors.OptionError, "Signal", argument="recording", advises=["Imu({"]):
        gmwm.inspect(gmwm.Signal(np.arange(10.0), RATE, "rad/s", "gyro_x"))
    assert isinstance(gmwm.inspect(Imu.from_arrays({"gyro_x": np.arange(100.0)}, RATE)), gmwm.inspection.Inspection)
