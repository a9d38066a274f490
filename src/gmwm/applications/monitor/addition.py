"""The baselines of a monitor as an addition to a calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gmwm.applications.monitor.baseline import Baseline
from gmwm.base.errors import DataError, ModelError
from gmwm.calibration.additions import AxisAddition

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit
    from gmwm.recording.signals import Signal


class BaselineAddition(AxisAddition):
    """The baseline of each axis: statistics of the innovations of its model in the recording."""

    name = "baseline"
    # 1.5 h at 100 Hz. With these samples, the standard deviation of every chart statistic is known to a few per cent.
    beginning = 1 << 19

    def of_axis(self, fit: Fit, beginnings: Sequence[Signal]) -> Baseline | None:
        """Measure the baseline; None if the samples are too few, or if the model has no Kalman filter."""
        segments = [values for signal in beginnings for values in signal.segment_values()]
        try:
            return Baseline.of(fit.model, segments, beginnings[0].rate)
        except (DataError, ModelError):
            return None  # the monitor reports it

    def to_dict(self, value: Baseline) -> dict[str, Any]:
        """Return a baseline as numbers and lists for JSON."""
        return value.to_dict()

    def from_dict(self, content: Mapping[str, Any]) -> Baseline:
        """Restore a baseline from the result of `to_dict`."""
        return Baseline.from_dict(content)
