"""Curves of recordings that come in pieces: over gaps, all axes at once."""

from gmwm.streaming.driver import stream_variance

__all__ = ["stream_variance"]
