"""Sizes that overflow, and arguments that are missing, are refused by the kernels. `python -m tests.fuzz.kernels` tries
many more."""

import numpy as np
import pytest

from gmwm.base import _core

HUGE = (2**60, 2**63 - 1, 2**63, 2**64 - 1)


@pytest.mark.parametrize("size", HUGE)
def test_products_of_sizes_do_not_overflow(size):
    with pytest.raises(ValueError, match="end within"):
        _core.haar_block_squares(np.zeros(64), size, np.zeros((2, 3)))
    with pytest.raises(ValueError, match="reach"):
        _core.neighbour_residuals(np.zeros(64), np.zeros(64), np.zeros(1, dtype=np.int64), size)


@pytest.mark.parametrize("period", [0, 1025, 2**40, 2**63, 2**64 - 1])
def test_seasons_are_bounded(period):
    with pytest.raises(ValueError, match="1024 coefficients"):
        _core.arma_autocovariance([1, 0, 1, 1, period], np.zeros(3), np.zeros(1, dtype=np.int64), False, np.zeros(1))


def test_a_table_is_needed():
    process = (1.0, 0.0, np.empty(0), np.empty((4, 0)), np.empty(0, dtype=np.uint8))
    with pytest.raises(ValueError, match="None"):
        _core.lag_sums(np.array([1, 2]), 100, False, process, [(None, 1.0)])
