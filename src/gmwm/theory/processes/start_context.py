"""Summary of the data from which random starting values are drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gmwm.theory.filters import HAAR, WaveletFilter

Dominant = Literal["quantization", "white", "markov"]
"""Noise type that dominates the first two levels. From level 1 to level 2 the wavelet variance falls faster than for
white noise ("quantization"), as fast ("white"), or more slowly ("markov")."""


@dataclass(frozen=True, eq=False)
class Occasion:
    """Quantities of the data for Algorithms 2 and 3 of Balamuta et al. (see `Sampled`): `total` is σ̂_T², the sum of
    the wavelet variances over all levels, `spread` is (max x − min x)/N, `dominant` the noise type of the first levels,
    and `first` (draws,) the condition, 1 or 2, of Algorithm 3 for the first autoregression of each draw."""

    total: float
    spread: float
    dominant: Dominant
    first: NDArray[np.int64]
    levels: NDArray[np.int64]
    samples: int
    rate: float
    filter: WaveletFilter = HAAR
