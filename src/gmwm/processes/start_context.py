"""What starting values are drawn by: the data in a few numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.filters import HAAR, WaveletFilter

Dominant = Literal["quantization", "white", "markov"]
"""What the first two levels look like: a fall faster than that of white noise, as fast, or slower."""


@dataclass(frozen=True, eq=False)
class Occasion:
    """The data as the starting values of the paper's Algorithms 2 and 3 see them.

    Attributes
    ----------
    total : float, in unit²
        σ̂_T², the sum of the wavelet variances over all levels.
    spread : float, in unit per sample
        (max x − min x)/N.
    dominant : "quantization", "white" or "markov"
        What dominates the first levels.
    first : (draws,) int array
        1 or 2: the condition of Algorithm 3 with which the first autoregression of each draw begins.
    levels : (J,) int array
    samples : int
        Length N of the record.
    rate : float
        Samples per second (Hz).
    filter : WaveletFilter
    """

    total: float
    spread: float
    dominant: Dominant
    first: NDArray[np.int64]
    levels: NDArray[np.int64]
    samples: int
    rate: float
    filter: WaveletFilter = HAAR
