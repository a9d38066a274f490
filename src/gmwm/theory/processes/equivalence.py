"""Find a simple process that the data cannot distinguish from a given process."""

from __future__ import annotations

import numpy as np

from gmwm.base.arrays import Integers, Matrix
from gmwm.theory.filters import HAAR, WaveletFilter
from gmwm.theory.processes.base import Process, registry


def likeness(
    process: Process, name: str, levels: Integers, rate: float, filter: WaveletFilter = HAAR,
    matrix: Matrix | None = None,
) -> Process | None:  # fmt: skip
    """Return the process `name` whose wavelet variance is closest to the wavelet variance ν² of `process`, such as a
    random walk for a Gauss-Markov process that is slower than the recording. Its scale coefficient is c = sᵀΩν² / sᵀΩs,
    where s is its wavelet variance for scale coefficient 1; without `matrix` Ω, all levels have the same weight
    relative to their variance. None if `name` is not registered, has shape parameters, or is zero at all levels.

    >>> from gmwm.processes import GM
    >>> walk = likeness(GM(beta=1e-9, sigma2=1.0), "RW", np.arange(1, 13), rate=100.0)
    >>> f"{walk.name} {walk.scale:.3g}"
    'RW 2e-11'
    """
    kind = registry.get(name)
    if kind is None or kind.nonlinear_parameters():
        return None
    variance = process.wavelet_variance(levels, rate, filter)
    shape = kind.standard().wavelet_variance(levels, rate, filter)
    if not np.any(shape > 0):
        return None
    if matrix is None:
        scale = float(np.mean(variance[shape > 0] / shape[shape > 0]))
    else:
        # Scale by the square root of the diagonal of Ω, because Ω may be of the order of 1e300.
        root = np.sqrt(np.diag(matrix))
        share = matrix / np.outer(root, root)
        seen, target = root * shape, root * variance
        scale = float(seen @ share @ target / (seen @ share @ seen))
    return kind().with_scale(max(scale, 0.0))
