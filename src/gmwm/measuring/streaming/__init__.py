"""Compute wavelet variances and spectra of recordings that are read in batches, in one process or in several."""

from gmwm.measuring.streaming.passes import AxisCurves, measured_curves, stream_psd, stream_variance

__all__ = ["AxisCurves", "measured_curves", "stream_psd", "stream_variance"]
