"""Curves of recordings that come in chunks: over gaps, all axes at once."""

from gmwm.streaming.passes import measured_pairs, stream_variance

__all__ = ["measured_pairs", "stream_variance"]
