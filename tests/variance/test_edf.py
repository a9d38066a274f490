"""Degrees of freedom against the published constants, and against seeded simulations."""

import numpy as np
import pytest

from gmwm.base import _core
from gmwm.base.errors import OptionError
from gmwm.measuring.axis_results import chi_square_limits
from gmwm.measuring.variance.allan import total_degrees_of_freedom, total_variance
from gmwm.measuring.variance.noise_type import degrees_of_freedom
from tests.helpers import raises

# Greenhall and Riley (2003): 1/edf = (a0 - a1/r)/r for many samples a cluster and r = M/S clusters, by (α, d).
MODIFIED = {
    (2, 1): (2 / 3, 1 / 3), (2, 2): (7 / 9, 1 / 2), (2, 3): (22 / 25, 2 / 3),
    (1, 1): (0.840, 0.345), (1, 2): (0.997, 0.616), (1, 3): (1.141, 0.843),
    (0, 1): (1.079, 0.368), (0, 2): (1.033, 0.607), (0, 3): (1.184, 0.848),
    (-1, 2): (1.048, 0.534), (-1, 3): (1.180, 0.816),
    (-2, 2): (1.302, 0.535), (-2, 3): (1.175, 0.777),
    (-3, 3): (1.194, 0.703), (-4, 3): (1.489, 0.702),
}  # fmt: skip
UNMODIFIED = {
    (0, 1): (2 / 3, 1 / 6), (0, 2): (2 / 3, 1 / 3), (0, 3): (7 / 9, 1 / 2),
    (-1, 2): (0.852, 0.375), (-1, 3): (0.997, 0.617),
    (-2, 2): (1.079, 0.368), (-2, 3): (1.033, 0.607),
    (-3, 3): (1.053, 0.553), (-4, 3): (1.302, 0.535),
}  # fmt: skip
# Flicker PM: 1/edf = (a0 - a1/r)/r / (b0 + b1 ln m)², by d.
FLICKER_PM = {2: (790.0, 410.0, 15.23, 12.0), 3: (9950.0, 6520.0, 47.8, 40.0)}
M = 10_000


def overlapping(alpha, d, r, *, modified=False):
    points = r * M + (M * (d + 1) if modified else M * d + 1) - 1
    return degrees_of_freedom(
        np.array([alpha]), np.array([M]), points, order=d, overlapping=True, modified=modified
    )[0]  # fmt: skip


@pytest.mark.parametrize("r", [4, 10, 60])
@pytest.mark.parametrize(("table", "modified"), [(MODIFIED, True), (UNMODIFIED, False)], ids=["modified", "unmodified"])
def test_published_constants(table, modified, r):
    for (alpha, d), (a0, a1) in table.items():
        expected = r / (a0 - a1 / r)
        assert overlapping(alpha, d, r, modified=modified) == pytest.approx(expected, rel=2e-3), (alpha, d)


@pytest.mark.parametrize("r", [4, 10, 60])
@pytest.mark.parametrize("d", FLICKER_PM)
def test_published_constants_of_flicker_pm(d, r):
    a0, a1, b0, b1 = FLICKER_PM[d]
    expected = (b0 + b1 * np.log(M)) ** 2 * r / (a0 - a1 / r)
    assert overlapping(1, d, r) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("d", [2, 3])
def test_published_white_pm(d):
    a0, a1 = {2: (35 / 18, 1), 3: (231 / 100, 3 / 2)}[d]
    points = 40 * M + M * d
    assert overlapping(2, d, 40) == pytest.approx((points - M * d) / (a0 - a1 / 40), rel=1e-3)


# Simulations: the edf 2 E(V)²/Var(V) of R records has a relative standard error of about √(8/R) or a little more for
# few degrees of freedom; five of them are allowed.
R, N = 1000, 400
SIZES = np.array([1, 2, 5, 20, 100])


def records(alpha):
    generator = np.random.default_rng(100 + alpha)
    white = generator.normal(size=(R, N + 1))
    if alpha == 2:
        return white
    rate = white if alpha == 0 else np.cumsum(white, axis=1)
    return np.cumsum(rate, axis=1)


def simulated(kernel, alpha):
    values = np.array([[kernel(p, int(n)) for n in SIZES] for p in records(alpha)])
    return 2 * values.mean(axis=0) ** 2 / values.var(axis=0)


@pytest.mark.parametrize("alpha", [2, 0, -2])
@pytest.mark.parametrize(
    ("kernel", "options"),
    [
        (_core.second_differences, {"order": 2, "overlapping": True}),
        (lambda p, n: _core.second_differences(p, n, n), {"order": 2, "overlapping": False}),
        (_core.third_differences, {"order": 3, "overlapping": True}),
        (lambda p, n: _core.third_differences(p, n, n), {"order": 3, "overlapping": False}),
        (_core.moving_second_differences, {"order": 2, "overlapping": True, "modified": True}),
    ],
    ids=["allan", "allan side by side", "hadamard", "hadamard side by side", "modified"],
)
def test_simulated_records(kernel, options, alpha):
    expected = degrees_of_freedom(np.full(SIZES.size, alpha), SIZES, N + 1, **options)
    error = np.abs(simulated(kernel, alpha) / expected - 1)
    # Where the phase is averaged over few samples the theory's noise is a little smoother than that of samples.
    small = (SIZES > 1) & (SIZES < 5) & options.get("modified", False) & (alpha == -2)
    assert np.all(error < 5 * np.sqrt(8 / R) + 0.1 * small), error


@pytest.mark.parametrize("alpha", [2, 0, -2])
def test_simulated_records_of_the_total_variance(alpha):
    expected = total_degrees_of_freedom(np.full(SIZES.size, alpha), SIZES, N + 1)
    error = np.abs(simulated(_core.reflected_second_differences, alpha) / expected - 1)
    assert np.all(error < 5 * np.sqrt(8 / R)), error


@pytest.mark.parametrize("alpha", [2, 0, -2])
def test_limits_of_the_total_variance_are_those_of_the_allan_variance(alpha):
    # The share of records whose limits miss the expected Allan variance, at a quarter of the record.
    n, inside = N // 4, 0
    truth = np.mean([_core.second_differences(p, n) / (N + 1 - 2 * n) / (2 * n**2) for p in records(alpha)])
    freedom = total_degrees_of_freedom(np.array([alpha]), np.array([n]), N + 1)
    bias = {2: -4 / 3, 0: 0.0, -2: 0.75}[alpha]
    for p in records(alpha)[:300]:
        value = np.array([_core.reflected_second_differences(p, n) / (N - 1) / (2 * n**2)])
        low, high = chi_square_limits(value / (1 - bias / 4), freedom, 0.9)
        inside += low[0] <= truth <= high[0]
    assert 0.9 - 5 * np.sqrt(0.09 / 300) < inside / 300 < 0.9 + 5 * np.sqrt(0.09 / 300)


def test_total_has_more_freedom_than_allan_at_long_times():
    n = np.array([100, 150, 200])
    allan = degrees_of_freedom(np.zeros(3, dtype=int), n, 401, order=2, overlapping=True)
    assert np.all(total_degrees_of_freedom(np.zeros(3, dtype=int), n, 401) > 1.2 * allan)
    assert total_variance(np.random.default_rng(3).normal(size=400), 1.0, clusters=[399]).degrees_of_freedom[0] >= 1


def test_one_by_one_or_together():
    alphas = np.array([2, 1, 0, -1, -2, 0, 1, 2, -2, -1])
    sizes = np.array([1, 2, 3, 10, 33, 34, 60, 100, 150, 200])
    for modified in (False, True):
        together = degrees_of_freedom(alphas, sizes, 1001, order=2, overlapping=True, modified=modified)
        alone = [
            degrees_of_freedom(alphas[k : k + 1], sizes[k : k + 1], 1001, order=2, overlapping=True, modified=modified)[
                0
            ]
            for k in range(alphas.size)
        ]
        np.testing.assert_allclose(together, alone, rtol=1e-12)


def test_flicker_pm_of_very_long_clusters_does_not_cancel():
    sizes = 10 ** np.arange(2, 8)
    values = [
        degrees_of_freedom(np.array([1]), np.array([n]), 10 * n + 1, order=2, overlapping=True)[0]
        for n in sizes.tolist()
    ]
    growth = np.diff(np.sqrt(values)) / np.log(10)
    # √edf is linear in ln n.
    np.testing.assert_allclose(growth, growth[-1], rtol=0.05)


def test_limits_are_quantiles():
    from scipy.stats import chi2

    freedom = np.array([1.0, 5.5, 300.0])
    low, high = chi_square_limits(np.ones(3), freedom, 0.9)
    np.testing.assert_allclose(low, freedom / chi2.ppf(0.95, freedom), rtol=1e-10)
    np.testing.assert_allclose(high, freedom / chi2.ppf(0.05, freedom), rtol=1e-10)
    with raises(OptionError, 0.5, argument="confidence"):
        chi_square_limits(np.ones(3), freedom, 1.0)
