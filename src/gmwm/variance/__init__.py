"""Measuring: variances of a signal at many scales, with limits."""

from gmwm.variance.estimate import wavelet_variance
from gmwm.variance.result import WaveletVariance

__all__ = ["WaveletVariance", "wavelet_variance"]
