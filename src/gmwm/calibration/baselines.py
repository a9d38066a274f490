"""Measure the baseline of each calibrated axis, with which a monitor compares later samples."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any

from gmwm._threads import in_threads
from gmwm.batches import Batch, batches, cut, joined
from gmwm.calibration.measurement import clean
from gmwm.calibration.result import AxisCalibration
from gmwm.errors import DataError, ModelError
from gmwm.monitor import Baseline
from gmwm.readers.streams import Stream
from gmwm.signals import Imu, Signal

LONGEST = 1 << 19
"""Largest number of samples for a baseline; the first samples are used: 1.5 h at 100 Hz. The scatter of every chart is
then known to some percent, and a file need not be read completely again."""


def with_baselines(
    done: Mapping[str, AxisCalibration], recordings: Iterable[Any], threads: int | None
) -> dict[str, AxisCalibration]:
    """Add the baseline of each axis that was calibrated from samples.

    Isolated wrong samples and knocks are replaced, as they are for the calibration: a monitor is to report them.

    Parameters
    ----------
    done : mapping of axis to AxisCalibration
    recordings : iterable of Imu, Signal, Stream, or mapping of axis to Signal
        What was calibrated. The baseline of several recordings is that of all of them.
    threads : int or None
        Number of axes that are measured at the same time.
    """
    parts = [_first_samples(recording) for recording in recordings]

    def work(axis: str, found: AxisCalibration) -> AxisCalibration:
        signals = [clean(cut(one[axis], 0, LONGEST)) for one in parts if axis in one]
        if not signals:
            return found
        segments = [values for signal in signals for values in signal.segment_values()]
        try:
            baseline = Baseline.of(found.fit.model, segments, signals[0].rate)
        except (DataError, ModelError):
            return found  # too short, or without a filter: the monitor says so
        return replace(found, baseline=baseline)

    return in_threads(work, done, threads=threads)


def _first_samples(data: Any) -> Mapping[str, Signal]:
    """Return the signals of a recording up to the batch with the last sample of a baseline."""
    if isinstance(data, Imu | Stream):
        parts: list[Batch] = []
        for batch in batches(data):
            parts.append(batch)
            if batch.stop >= LONGEST:
                break
        return joined(parts).signals
    items = {data.axis or "signal": data} if isinstance(data, Signal) else data
    return {axis: item for axis, item in items.items() if isinstance(item, Signal)}
