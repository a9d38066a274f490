"""Wavelet coefficients as matrices, to compare covariances under any filter with."""

import numpy as np


def rows(at):
    """For each level the filter at every place where it fits: (M, N)."""
    result = []
    for j in at.levels.tolist():
        taps, step = at.filter.level_filter(j)[::-1], 1 << j if at.transform == "dwt" else 1
        ends = [t for t in range(taps.size - 1, at.samples) if (t + 1) % step == 0]
        matrix = np.zeros((len(ends), at.samples))
        for row, t in zip(matrix, ends, strict=True):
            row[t - taps.size + 1 : t + 1] = taps
        result.append(matrix)
    return result
