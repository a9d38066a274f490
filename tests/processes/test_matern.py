"""The Matérn process against 50 digits, sums over all lags, closed forms, simulation, and in fits."""

import math

import mpmath as mp
import numpy as np
import pytest

from gmwm import GM, MAT, WN, fit
from gmwm.base.errors import MissingTheoryError
from gmwm.measuring.covariance import variances
from gmwm.measuring.covariance.design import Design
from gmwm.theory.filters import HAAR, find_filter
from gmwm.theory.processes import Process, filtered, smooth_autocovariance
from gmwm.theory.processes.model import as_model
from gmwm.theory.processes.smooth_autocovariance import matern
from tests.helpers import each, raises

RATE = 100.0
SMOOTHNESS = [0.1, 0.5, 0.75, 1 - 1e-5, 1.0, 1 + 1e-9, 1.5, 2.3, 7.5, 10.0]


def exact(x, nu):
    """M, 1 − M, x (1 − M)′ and the derivative by ν, in 70 digits."""
    with mp.workdps(70):
        x, nu, step = mp.mpf(x), mp.mpf(nu), mp.mpf(10) ** -22

        def correlation(nu):
            return 2 ** (1 - nu) / mp.gamma(nu) * x**nu * mp.besselk(nu, x)

        by_distance = 2 ** (1 - nu) / mp.gamma(nu) * x ** (nu + 1) * mp.besselk(nu - 1, x)
        by_smoothness = (correlation(nu - step) - correlation(nu + step)) / (2 * step)
        here = correlation(nu)
        return [float(v) for v in (here, 1 - here, by_distance, by_smoothness)]


@pytest.mark.slow
@pytest.mark.parametrize("nu", SMOOTHNESS)
def test_the_correlation_and_its_complement_to_fourteen_digits(nu):
    x = np.array([1e-8, 1e-4, 0.01, 0.3, 1.0, 1.9, 2.1, 4.0, 12.0, 30.0])
    at = matern(x, nu)
    found = np.array([at.correlation, at.lost, at.by_distance, at.by_smoothness]).T
    np.testing.assert_allclose(found, [exact(v, nu) for v in x], rtol=3e-13)


@pytest.mark.parametrize("nu", [1e-3, 20.0, 49.9])
def test_the_ends_of_the_domain(nu):
    x = np.array([0.0, 1e-300, 1e-3, 5.0, 9.0, 11.0, 1e3, 1e300])
    with np.errstate(all="raise", under="ignore"):
        at = matern(x, nu)
    assert np.all(np.diff(at.correlation) <= 0)
    assert at.correlation[0] == 1.0
    np.testing.assert_allclose(at.lost[2:6], [exact(v, nu)[1] for v in x[2:6]], rtol=1e-12)


def polynomial(p):
    """Coefficients of x^0, x^1, … in e^x M(x) at ν = p + ½."""
    f = math.factorial
    return [f(p) * f(2 * p - m) * 2**m / (f(2 * p) * f(p - m) * f(m)) for m in range(p + 1)]


def power_sums(q, n, highest):
    """Σ_{k ≤ n} k^m q^k, m = 0 … `highest`, from (1 − q) S_m = Σ_k [k^m − (k − 1)^m] q^k − n^m q^(n+1)."""
    sums = [(1 - q ** (n + 1)) / (1 - q)]
    for m in range(1, highest + 1):
        lower = sum(mp.binomial(m, i) * (-1) ** (m - i + 1) * (s - (1 if i == 0 else 0)) for i, s in enumerate(sums))
        sums.append((lower - mp.mpf(n) ** m * q ** (n + 1)) / (1 - q))
    return sums


def haar(beta, p, level):
    """ν_j² at ν = p + ½, by its sum over all lags with weights h, 2h − 3k up to h, and k − 2h beyond."""
    with mp.workdps(150):
        beta, h = mp.mpf(beta), 2 ** (level - 1)
        c, q, moments = polynomial(p), mp.exp(-mp.mpf(beta)), []
        for n in (h, 2 * h - 1):
            s = power_sums(q, n, p + 1)
            s[0] -= 1
            moments.append([sum(mp.mpf(a) * beta**m * s[m + d] for m, a in enumerate(c)) for d in (0, 1)])
        (a0, a1), (b0, b1) = moments
        return float((h + 2 * h * a0 - 3 * a1 - 2 * h * (b0 - a0) + (b1 - a1)) / (2 * mp.mpf(h) ** 2))


@pytest.mark.slow
@each("p", [0, 1, 2, 4, 9])
@each("beta", [1e-8, 1e-4, 0.03, 0.7, 30.0])
def test_down_to_level_twenty_five_at_half_integers(p, beta):
    levels = [1, 2, 3, 7, 12, 18, 25]
    # The fractions in the polynomial are doubles.
    np.testing.assert_allclose(
        MAT.shape(np.array([[beta, p + 0.5]]), levels, 1.0)[0], [haar(beta, p, j) for j in levels], rtol=1e-12
    )


@pytest.mark.slow
@pytest.mark.parametrize("nu", SMOOTHNESS)
def test_any_smoothness_against_the_sum_over_all_lags(nu):
    for beta in (1e-3, 0.2, 3.0):
        with mp.workdps(30):
            r = [mp.mpf(1)] + [
                2 ** (1 - mp.mpf(nu))
                / mp.gamma(nu)
                * (mp.mpf(beta) * k) ** mp.mpf(nu)
                * mp.besselk(nu, mp.mpf(beta) * k)
                for k in range(1, 16)
            ]
            expected = []
            for h in (1, 2, 8):
                total = h + sum(r[k] * (2 * h - 3 * k if k <= h else k - 2 * h) for k in range(1, 2 * h))
                expected.append(float(total / (2 * h * h)))
        np.testing.assert_allclose(MAT.shape(np.array([[beta, nu]]), [1, 2, 4], 1.0)[0], expected, rtol=1e-12)


@pytest.mark.parametrize("name", ["haar", "d4", "la8", "fk14", "mb24", "bl14"])
def test_half_is_a_gauss_markov_process_under_every_filter(name):
    f, beta = find_filter(name), np.array([1e-8, 1e-4, 0.03, 0.5, 4.0])
    rows = np.column_stack([beta, np.full(beta.size, 0.5)])
    size = GM.shape(beta[:, None], 25, 1.0, f)
    np.testing.assert_allclose(MAT.shape(rows, 25, 1.0, f), size, rtol=1e-12)
    slopes = MAT.shape_jacobian(rows, 25, 1.0, f)[:, :, :1] - GM.shape_jacobian(beta[:, None], 25, 1.0, f)
    assert np.all(np.abs(slopes[:, :, 0]) <= 1e-12 * size / beta[:, None])


@pytest.mark.parametrize("name", ["haar", "d4", "la8"])
def test_other_filters_against_all_lags(name):
    f = find_filter(name)
    for beta, nu in ((0.02, 0.3), (0.05, 1.0), (0.5, 2.2)):
        one = MAT(beta, nu, 1.0)
        known = one.generalised_covariance(np.arange(filtered.lags_needed(f, 10)), 1.0)
        dense = filtered.autocovariance_variance(known, f, np.arange(1, 11))
        np.testing.assert_allclose(one.wavelet_variance(10, 1.0, name), dense, rtol=1e-9)


@pytest.mark.parametrize("beta", [1e-6, 1e-3, 0.1])
@pytest.mark.parametrize("nu", [0.1, 1.0, 2.5])
def test_many_lags_are_interpolated_to_all_digits(beta, nu):
    one, some = MAT(beta, nu, 2.0), np.unique(np.geomspace(1, 3e5, 500).astype(int))
    many = np.arange(some[-1] + 1)
    np.testing.assert_allclose(
        one.generalised_covariance(many, 1.0)[some], one.generalised_covariance(some, 1.0), rtol=1e-13
    )
    np.testing.assert_allclose(one.autocovariance(many, 1.0)[some], one.autocovariance(some, 1.0), atol=1e-14)


@pytest.mark.parametrize(("beta", "nu"), [(1e-6, 2.2), (0.01, 1.0), (0.3, 0.2), (5.0, 3.0)])
def test_sums_up_to_any_lag(beta, nu):
    one, n = MAT(beta, nu, 2.0), np.array([1, 2, 3, 60, 64, 65, 70, 128, 1000, 4096])
    levels = 1 + np.array([0, 1, 6, 7, 12])
    np.testing.assert_allclose(
        one.allan_variance(2 ** (levels - 1), 1.0), 2 * one.wavelet_variance(levels, 1.0), rtol=1e-12
    )
    np.testing.assert_allclose(
        one.running_sum_covariance(n, 1.0), Process.running_sum_covariance(one, n, 1.0), rtol=1e-12
    )
    far = one.allan_variance(np.array([10**9, 4 * 10**9]), 1.0) * [1, 4]
    if beta > 1e-3:
        assert far[1] == pytest.approx(far[0], rel=1e-6)


def test_lags_on_the_edges_of_octaves():
    known = smooth_autocovariance.spread_places(64, 4)
    lags = np.array([0, 1, 63, 64, 65, 127, 128, 129, 256, 257, 1023, 1024])
    np.testing.assert_allclose(smooth_autocovariance.spread(np.sqrt(known), lags, 64), np.sqrt(lags), rtol=1e-14)


def test_the_correlation_time_is_where_a_share_of_one_over_e_is_left():
    for nu in (1e-3, 0.1, 0.5, 1.7, 30.0):
        time = MAT(beta=2.0, nu=nu, sigma2=3.0).correlation_time(RATE)
        assert matern(np.array([2.0 * time]), nu).correlation[0] == pytest.approx(math.exp(-1), rel=1e-9)
    assert MAT(beta=2.0, nu=0.5).correlation_time(RATE) == pytest.approx(0.5, rel=1e-12)
    assert MAT(beta=2.0).correlation_time(RATE) is None


def test_no_density():
    assert not MAT.has("psd")


@pytest.mark.slow
@pytest.mark.parametrize(("beta", "nu", "n"), [(0.5, 2.5, 2000), (5.0, 0.2, 2000), (1.0, 1.0, 200)])
def test_paths_have_the_autocovariance(beta, nu, n):
    one = MAT(beta, nu, 2.0)
    paths = one.simulate(n, RATE, 7, paths=600)
    for lag in (0, 1, 30, 190):
        products = paths[:, 5] * paths[:, 5 + lag]
        error = products.std() / math.sqrt(len(paths))
        assert abs(products.mean() - one.autocovariance([lag], RATE)[0]) <= 4 * error
    # Smooth paths: their differences are far smaller than they are.
    differences = np.mean(np.diff(paths) ** 2, axis=1)
    error = differences.std() / math.sqrt(len(paths))
    assert abs(differences.mean() - 4 * one.wavelet_variance(1, RATE)[0]) <= 4 * error


def test_what_cannot_be_simulated_says_so():
    slow = MAT(1e-5, 1.3, 1.0)
    with raises(MissingTheoryError, "10000 samples", advises=("beta", "nu")):
        slow.simulate(10_000, RATE, 1)
    assert slow.simulate(100, RATE, 1).shape == (100,)
    assert MAT(1e-5, 0.4, 1.0).simulate(1000, RATE, 1).shape == (1000,)


def test_the_covariance_of_its_wavelet_variance_is_that_of_a_gauss_markov_process():
    design = Design(np.arange(1, 12), 3000, RATE)
    expected = variances(as_model(GM(2.0, 1.0) + WN(0.1)), design)
    np.testing.assert_allclose(variances(as_model(MAT(2.0, 0.5, 1.0) + WN(0.1)), design), expected, rtol=1e-6)


@pytest.mark.slow
def test_fit():
    truth = MAT(beta=0.5, nu=1.3, sigma2=1.0) + WN(0.5)
    found = fit(MAT() + WN(), truth.simulate(2**14, RATE, 2), rate=RATE)
    limits = found.confidence_intervals(level=0.9999)
    for name, value in truth.parameters.items():
        assert limits[name][0] <= value <= limits[name][1]
    assert HAAR.name == found.wavelet_variance.filter
