"""Find faults of a logger in the samples of a recording, and undo those that can be undone safely: repeated values,
frozen or interpolated samples, and words that wrapped around."""

from gmwm.recording.repairs.beginning import without_jumps
from gmwm.recording.repairs.patterns import axes_with_two_levels
from gmwm.recording.repairs.repaired import only_axes, repaired

__all__ = ["axes_with_two_levels", "only_axes", "repaired", "without_jumps"]
