"""Wavelet variances of all axes of a recording that is read in chunks and may have gaps."""

from gmwm.streaming.passes import measured_pairs, stream_variance

__all__ = ["measured_pairs", "stream_variance"]
