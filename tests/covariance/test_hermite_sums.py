"""V of robust estimates of processes that oscillate, against sums lag by lag."""

from __future__ import annotations

import numpy as np
import pytest

import gmwm
from gmwm import OSC, WN
from gmwm.base import _core
from gmwm.base.errors import MissingTheoryError
from gmwm.measuring.covariance import covariance, filtered, gaussian
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.robust import hermite_weights
from tests.covariance.test_lag_sums import exponentials, oracle

WEIGHTS = hermite_weights(0.6)[1:] / 2


def design(samples, levels, **options):
    return Design(np.arange(1, levels + 1), samples=samples, rate=1.0, efficiency=0.6, **options)


def error(found, expected):
    size = np.sqrt(np.diag(expected))
    return np.max(np.abs(found - expected) / np.outer(size, size))


CASES = {
    "lasting": {"amplitudes": [1.0], "decays": [complex(1e-9, 1.2)]},
    "period of four": {"amplitudes": [1.0 + 0.3j], "decays": [complex(1e-6, np.pi / 2)], "white": 1e-3},
    "slow": {"amplitudes": [1 + 1e-3j], "decays": [complex(1e-6, 6e-6)]},
    "slowest": {"amplitudes": [1.0], "decays": [complex(1e-9, 1e-7)]},
    "alternating": {"amplitudes": [1.0, 1.0], "decays": [complex(1e-7, np.pi), complex(1e-4, 0.3)]},
    "all": {
        "amplitudes": [1.0, 1.0, 0.5 + 0.1j, 2.0, 0.3, 0.4 - 0.1j],
        "decays": [0.3, 0.02, complex(1e-3, 0.7), complex(1e-6, 0.3), complex(0.2, np.pi), complex(1e-4, 0.003)],
        "white": 0.1, "walk": 1e-4, "spikes": [0.3, 0.2, -0.1],
    },
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_powers_against_sums_in_many_digits(name):
    samples, levels = 150, np.arange(1, 7)
    variance, powers = _core.hermite_sums(levels, samples, False, exponentials(**CASES[name]).kernel, WEIGHTS)
    with oracle.mpmath.workdps(oracle.DIGITS):
        k = np.array(oracle.Terms(**CASES[name]).running_sum(2 * samples), dtype=object)
        own = {j: oracle._coefficients(k, 0, 2 ** (j - 1), 2 ** (j - 1)) for j in levels.tolist()}
        expected = []
        for coarse in levels.tolist():
            for fine in range(1, coarse + 1):
                h, g = 2 ** (fine - 1), 2 ** (coarse - 1)
                u = np.arange(2 * g - samples, samples - 2 * h + 1)
                n = samples - np.maximum(u, 0) - np.maximum(2 * h - 1, 2 * g - 1 - u)
                squares = (oracle._coefficients(k, u, h, g) ** 2 / (own[fine] * own[coarse])).astype(float)
                expected.append(n @ (squares**2 * np.polyval(WEIGHTS[::-1], squares)))
    np.testing.assert_allclose(variance, [float(own[j]) for j in levels.tolist()], rtol=1e-9)
    coarser, finer = np.tril_indices(levels.size)
    own_sums = np.sqrt(np.array(expected)[coarser == finer])
    assert np.max(np.abs(powers - expected) / (own_sums[coarser] * own_sums[finer])) < 1e-9
    np.testing.assert_array_equal(
        _core.hermite_sums(levels, samples, True, exponentials(**CASES[name]).kernel, WEIGHTS)[1],
        powers[coarser == finer],
    )


BESIDE = "WN(sigma2=0.5) + RW(gamma2=1e-6) + FN(b2=1e-3) + QN(q2=0.1)"


@pytest.mark.slow
@pytest.mark.parametrize("frequency", [1e-6, 1e-4, 1 / 256, 0.0311, 0.25, 0.49])
@pytest.mark.parametrize("quality", [1e2, 1e6])
def test_every_quality_against_sums_over_all_lags(frequency, quality):
    noise = gmwm.Model.parse(f"OSC(frequency={frequency!r}, quality={quality}, sigma2=1.0) + {BESIDE}").sorted(1.0)
    whole = design(20_000, 13)
    assert gaussian.knows(noise, whole)
    assert error(gaussian.covariance(noise, whole), filtered.covariance(noise, whole)) < 1e-8
    np.testing.assert_allclose(
        gaussian.ratio_variances(noise, whole), filtered.ratio_variances(noise, whole), rtol=1e-6
    )


def test_a_few_oscillations_and_roots_near_the_unit_circle():
    text = (
        "OSC(frequency=0.0311, quality=1e5, sigma2=1.0) + OSC(frequency=0.211, quality=300.0, sigma2=1.0) + "
        "AR(phi=[0.6, -0.99998], sigma2=0.1) + GM(beta=0.002, sigma2=2.0)"
    )
    noise, whole = gmwm.Model.parse(text).sorted(1.0), design(20_000, 13)
    assert error(gaussian.covariance(noise, whole), filtered.covariance(noise, whole)) < 1e-8


def test_the_length_is_limited_only_beside_an_oscillation_that_lasts():
    short, lasting = (OSC(frequency=0.0311, quality=quality, sigma2=1.0) + WN(1.0) for quality in (1e2, 1e8))
    assert np.all(np.isfinite(gaussian.ratio_variances(short, design(2**28, 8))))
    with pytest.raises(MissingTheoryError, match="at most 67108864 samples"):
        covariance(lasting, design(2**27, 8))


def test_strides_against_the_definition():
    samples, strides = 256, (1, 1, 2, 4, 8, 16)
    text = "OSC(frequency=0.0311, quality=1e3, sigma2=1.0) + WN(sigma2=0.5) + GM(beta=0.3, sigma2=1.0)"
    noise = gmwm.Model.parse(text).sorted(1.0)
    lags = np.abs(np.subtract.outer(range(samples), range(samples)))
    known = sum(process.autocovariance(lags, 1.0) for process in noise.processes)
    found = gaussian.variances(noise, design(samples, 6, strides=strides))
    for j, stride in enumerate(strides):
        half = 2**j
        taps = np.concatenate([np.ones(half), -np.ones(half)]) / (2 * half)
        every = np.array([np.pad(taps, (t, samples - 2 * half - t)) for t in range(samples - 2 * half + 1)])
        c = every @ known @ every.T
        squares = c**2 / np.outer(np.diag(c), np.diag(c))
        terms = np.outer(np.diag(c), np.diag(c)) * squares * np.polyval(hermite_weights(0.6)[::-1], squares)
        # V_jj is the mean over all offsets of the coefficients.
        used = [np.arange(offset, len(c), stride) for offset in range(stride)]
        own = [terms[np.ix_(u, u)].sum() / u.size**2 for u in used]
        assert min(own) * (1 - 1e-9) <= found[j] <= max(own) * (1 + 1e-9)
        assert stride > 1 or found[j] == pytest.approx(own[0], rel=1e-9)
