"""The overview of a recording that is read in chunks: every extreme is kept, gaps too, in bounded memory."""

import numpy as np
import pytest

import gmwm
from gmwm.applications.app.workspace import SCREEN_COLUMNS, Overview, overview, shown_times
from gmwm.recording.chunks import Chunk


@pytest.mark.parametrize("size", [1000, 7919])
def test_it_has_the_extremes_of_the_recording_wherever_it_is_cut(tmp_path, size):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=1.0)", "accel_z": "RW(gamma2=1.0)"}, rate=100.0, samples=50_000, rng=1)
    path = tmp_path / "a.parquet"
    imu.write(path)
    done = []
    found = overview(gmwm.stream(path, chunk=size), done.append)
    assert done[-1] == 50_000
    assert len(found) <= 2 * SCREEN_COLUMNS
    for axis in imu:
        values, shown = imu[axis].values, found[axis].values
        width = round(2 * imu.rate / found.rate)
        parts = [values[k : k + width] for k in range(0, values.size, width)]
        np.testing.assert_array_equal(shown[::2], [part.min() for part in parts])
        np.testing.assert_array_equal(shown[1::2], [part.max() for part in parts])


def test_gaps_stay_gaps():
    found = Overview(["gyro_x"], 1.0)
    for segment, start in enumerate((0.0, 10_000.0)):
        found.update(Chunk({"gyro_x": np.arange(5000.0)}, first=5000 * segment, segment=segment, start=start))
    imu = found.result("a.csv")
    width = 2 / imu.rate
    (first, second) = imu["gyro_x"].starts
    assert first == 0.0
    assert abs(second - 10_000.0) < width
    assert len(imu.segments) == 2
    assert abs(imu.segments[0][1] / imu.rate - 5000.0) <= width


def test_its_memory_does_not_depend_on_the_length():
    found = Overview(["gyro_x"], 100.0)
    for k in range(200):
        found.update(Chunk({"gyro_x": np.full(10_000, float(k))}, first=10_000 * k, segment=0, start=100.0 * k))
    shape = found.least.shape
    assert shape == (1, SCREEN_COLUMNS)
    values = found.result("a.csv")["gyro_x"].values
    assert (values.min(), values.max()) == (0.0, 199.0)


def test_a_recording_in_memory_is_drawn_as_it_is():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=1.0)"}, rate=100.0, samples=1000, rng=1)
    assert overview(imu, lambda n: pytest.fail("nothing is read")) is imu


@pytest.mark.parametrize("marked", [None, {}, {"selections": []}, {"xaxis.range[0]": 1}])
def test_other_changes_of_a_figure_mark_no_span(marked):
    assert shown_times(marked) is None
