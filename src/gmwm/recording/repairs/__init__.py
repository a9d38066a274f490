"""Find faults of a logger in the samples of a recording, and undo those that can be undone safely: repeated values,
frozen or interpolated samples, and words that wrapped around."""

from gmwm.recording.repairs.jumps import without_jumps
from gmwm.recording.repairs.repaired import repaired

__all__ = ["repaired", "without_jumps"]
