"""The picture of a monitor as data: signals, events, and charts that reach their threshold."""

from __future__ import annotations

import numpy as np
import pytest

from gmwm import Model, Monitor
from gmwm.applications.monitor import Trace
from gmwm.applications.monitor.plot import plot_trace
from gmwm.base.errors import DataError
from gmwm.recording.chunks import Chunk
from gmwm.showing.plots.figure import description

MODEL = Model.parse("WN(sigma2=1e-6) + RW(gamma2=1e-14)")
EPOCH = 1.7e9


def traced(n: int = 40_000) -> Trace:
    trace = Trace(Monitor({"gyro_x": MODEL}, 1e5, rate=100.0, baseline=None))
    x = MODEL.simulate(n, 100.0, rng=1)
    x[n // 2 :] += 0.005
    trace.update(Chunk({"gyro_x": x}, first=0, segment=0, start=EPOCH))
    trace.finish()
    return trace


def test_the_picture_shows_signal_event_and_charts() -> None:
    trace = traced()
    (event,) = trace.events
    figure = description(plot_trace)(trace)
    ((signal, charts),) = figure.rows
    assert signal is not None
    assert charts is not None
    assert signal.x.label == "Time since the first sample, at 1700000000 s (min)"
    band = signal["Signal less its median"]
    assert signal.y.label == "deg/s"  # the unit of the events
    assert np.nanmax(band.upper) > np.degrees(0.005)  # type: ignore[union-attr]
    assert np.nanmin(signal["Event"].x) == pytest.approx((event.time - EPOCH) / 60.0)
    level = charts["Level"]
    assert level.y.max() >= 1.0  # type: ignore[union-attr]
    assert charts["Noise down"].y.max() < 1.0  # type: ignore[union-attr]
    times, extremes = trace.signal("gyro_x")
    assert times[0] == EPOCH
    assert len(times) <= 2048
    assert np.all(extremes[:, 0] <= extremes[:, 1])


def test_a_monitor_without_samples_is_not_drawn() -> None:
    with pytest.raises(DataError):
        description(plot_trace)(Trace(Monitor({"gyro_x": MODEL}, 1e5, rate=100.0, baseline=None)))
