"""Summary of the data that random starting values need."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.filters import HAAR, WaveletFilter

Dominant = Literal["quantization", "white", "markov"]
"""Noise type of the first two levels: their variance falls faster than for white noise, as fast, or more slowly."""


@dataclass(frozen=True, eq=False)
class Occasion:
    """Quantities of the data that the starting values of Algorithms 2 and 3 of the paper use.

    Attributes
    ----------
    total : float, in unit²
        σ̂_T², the sum of the wavelet variances over all levels.
    spread : float, in unit per sample
        (max x − min x)/N.
    dominant : "quantization", "white" or "markov"
        The noise type that dominates the first levels.
    first : (draws,) int array
        1 or 2: the condition of Algorithm 3 for the first autoregression of each draw.
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
