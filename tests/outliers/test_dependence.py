"""A robust curve that depends on its efficiency has too many outliers; of clean and knocked recordings it does not."""

import numpy as np
import pytest

from gmwm import wavelet_variance
from gmwm.measuring.outliers import contamination, dependence, other_efficiency
from gmwm.measuring.outliers.ratio_test import Dependence

RATE = 100.0


def compared(x, efficiency=0.6):
    classical, robust = wavelet_variance(x, RATE), wavelet_variance(x, RATE, robust=True, efficiency=efficiency)
    other = wavelet_variance(x, RATE, robust=True, efficiency=other_efficiency(efficiency))
    return dependence(robust, other, contamination((classical, robust), comparisons=6))


@pytest.mark.slow
@pytest.mark.parametrize("efficiency", [0.6, 0.9])
def test_gaussian_noise_does_not_depend_on_it(efficiency):
    found = [compared(np.random.default_rng(seed).standard_normal(30_000), efficiency) for seed in range(30)]
    assert sum(one is not None for one in found) <= 2


def test_isolated_wrong_samples_do():
    rng = np.random.default_rng(1)
    x = rng.standard_normal(60_000)
    x += 10 * (rng.random(x.size) < 0.05) * rng.choice([-1, 1], x.size)
    found = compared(x)
    assert found is not None
    assert (found.efficiency, found.other_efficiency) == (0.6, 0.9)
    assert abs(np.log(found.other_value / found.value)) > 0.1
    assert Dependence.from_dict(found.to_dict()) == found


def test_a_constant_has_no_level_to_compare():
    assert compared(np.zeros(1000)) is None
