"""Measure the baselines of a monitor from a reference recording."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm.applications.monitor.baseline import Baseline
from gmwm.applications.monitor.setup import check_rate, chunks_of, common_rate, models_of
from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError

if TYPE_CHECKING:
    from gmwm.files.readers.streams import Stream
    from gmwm.recording.signals import Imu

LONGEST = 1 << 21
"""Only this number of samples at the beginning of a reference recording is used."""


def baselines(
    calibration: Mapping[str, Any], recording: Imu | Stream, axes: Sequence[str] | None = None
) -> dict[str, Baseline]:
    """Measure the baseline of each axis for `Monitor`, from a recording of a healthy sensor at rest.

    `calibrate` calls this function with the calibrated recording.

    Parameters
    ----------
    calibration : Calibration, or mapping of axis to Fit or Model
        The noise models. recording : Imu or Stream The reference recording. Its first 2.1 million samples are used.
    axes : sequence of str, optional
        The axes; all axes of the calibration by default.

    Returns
    -------
    mapping of axis to Baseline

    Raises
    ------
    DataError
        If the recording does not have an axis, or is too short.
    OptionError
        If the sampling rate differs from the rate of the calibration.

    Examples
    --------
    >>> from gmwm import Model, simulate
    >>> model = "WN(sigma2=1e-6) + RW(gamma2=1e-14)"
    >>> quiet = simulate({"gyro_x": model}, rate=100.0, samples=60_000, rng=1)
    >>> found = baselines({"gyro_x": model}, quiet)["gyro_x"]
    >>> found.ratios[:3].round(1).tolist(), found.equal
    ([1.0, 1.0, 1.0], 1)
    """
    models = models_of(calibration, axes)
    missing = [axis for axis in models if axis not in recording.axes]
    if missing:
        raise DataError(
            f"the reference has no {missing[0]}; it has {', '.join(recording.axes)}",
            argument="reference",
            advice="Choose the axes to monitor with {--axis}.",
        )
    rate = common_rate(calibration, recording.rate)
    check_rate(recording.rate, rate)
    parts: dict[str, list[list[Vector]]] = {axis: [] for axis in models}
    segment, total = -1, 0
    for chunk in chunks_of(recording):
        for axis, found in parts.items():
            if chunk.segment != segment:
                found.append([])
            found[-1].append(chunk.values[axis])
        segment, total = chunk.segment, total + len(chunk)
        if total >= LONGEST:
            break
    return {
        axis: Baseline.of(models[axis], [np.concatenate(part) for part in found], rate) for axis, found in parts.items()
    }
