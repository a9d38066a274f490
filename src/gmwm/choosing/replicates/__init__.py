"""Compare several recordings of one unit: test of equality, spread between recordings, and a model for a filter."""

from gmwm.choosing.replicates.result import RecordingNumber, Replicates

__all__ = ["RecordingNumber", "Replicates"]
