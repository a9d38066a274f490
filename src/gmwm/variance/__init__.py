"""Wavelet, Allan, Hadamard and total variances of a signal at many averaging times, with confidence limits."""

from gmwm.variance.accumulate import WaveletAccumulator
from gmwm.variance.allan import allan_variance
from gmwm.variance.allan_regression import AllanRegression, avlr
from gmwm.variance.api import wavelet_variance
from gmwm.variance.axes_result import WaveletVariances
from gmwm.variance.clusters import ClusterVariance
from gmwm.variance.hadamard import hadamard_variance
from gmwm.variance.result import WaveletVariance
from gmwm.variance.total import total_variance
from gmwm.variance.transform import dwt, modwt

__all__ = [
    "AllanRegression",
    "ClusterVariance",
    "WaveletAccumulator",
    "WaveletVariance",
    "WaveletVariances",
    "allan_variance",
    "avlr",
    "dwt",
    "hadamard_variance",
    "modwt",
    "total_variance",
    "wavelet_variance",
]
