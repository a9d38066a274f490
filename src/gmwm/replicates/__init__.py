"""Several recordings of one unit: whether they are equal, how much they differ, and the model for a filter."""

from gmwm.replicates.result import RecordingNumber, Replicates

__all__ = ["RecordingNumber", "Replicates"]
