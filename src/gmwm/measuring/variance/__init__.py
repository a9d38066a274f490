"""Wavelet, Allan, Hadamard and total variances of a signal at many averaging times, with confidence limits."""

from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.measuring.variance.allan import allan_variance, hadamard_variance, total_variance
from gmwm.measuring.variance.allan_regression import AllanRegression, avlr
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.clusters import ClusterVariance
from gmwm.measuring.variance.result import WaveletVariance, WaveletVariances
from gmwm.measuring.variance.transform import dwt, modwt

__all__ = [
    "AllanRegression", "ClusterVariance", "WaveletAccumulator", "WaveletVariance", "WaveletVariances", "allan_variance",
    "avlr", "dwt", "hadamard_variance", "modwt", "total_variance", "wavelet_variance",
]  # fmt: skip
