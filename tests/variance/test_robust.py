"""The robust wavelet variance: laws, then its slow twin, then what is promised where there is no root."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import gmwm
from gmwm.base import _core
from gmwm.base.errors import DataError
from gmwm.measuring.variance.biweight import biweight
from gmwm.measuring.variance.coefficients import HaarCoefficients, PlainCoefficients
from gmwm.measuring.variance.robust import SAMPLED_COEFFICIENTS, robust_variance, robust_variances
from tests.helpers import each, only, raises
from tests.oracles import haar
from tests.oracles import robust as twin

deterministic = settings(derandomize=True, deadline=None, max_examples=25)
seeds = st.integers(0, 2**31)


def rng(seed=0):
    return np.random.default_rng(seed)


def white(n, seed=0):
    return rng(seed).standard_normal(n)


def measured(x, **options):
    return gmwm.wavelet_variance(x, 1.0, robust=True, **options)


def outcomes(wv):
    return wv.diagnostics["robust"]["outcome"]


# --- constants --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("efficiency", "c"),
    [
        (0.3, 3.504776), (0.5, 4.060125), (0.6, 4.400278), (0.8, 5.448855), (0.9, 6.583979), (0.95, 7.878544),
        (0.99, 11.808196),
    ],
)  # fmt: skip
def test_cut_offs_are_the_published_ones(efficiency, c):
    assert biweight(efficiency).c == pytest.approx(c, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("efficiency", [0.3, 0.37, 0.6, 0.9, 0.99])
def test_constants_in_forty_digits(efficiency):
    from mpmath import mp, mpf

    tuning = biweight(efficiency)
    with mp.workdps(40):
        c = mpf(tuning.c)

        def mean(function):
            return 2 * mp.quad(lambda r: function(r) * mp.npdf(r), [0, c / 2, c])

        a = mean(lambda r: r**2 * (1 - (r / c) ** 2) ** 4)
        slope = mean(lambda r: 2 * r**2 * (1 - (r / c) ** 2) ** 3 * (1 - 5 * (r / c) ** 2))
        square = mean(lambda r: r**4 * (1 - (r / c) ** 2) ** 8)
        assert abs(tuning.a / a - 1) < 1e-14
        assert abs(slope**2 / (2 * (square - a**2)) - efficiency) < 1e-13


@pytest.mark.parametrize("efficiency", [0.29, 0.991, 1.0, 0.0, -1.0, math.nan, "high", None, [0.6]])
def test_other_efficiencies_are_refused(efficiency):
    with raises(gmwm.errors.OptionError, "from 0.3 to 0.99", argument="efficiency"):
        measured(white(100), efficiency=efficiency)


# --- laws -------------------------------------------------------------------------------------------


@deterministic
@given(seeds, st.integers(-40, 40))
def test_scaling_by_a_power_of_two_is_exact(seed, power):
    x = white(3000, seed)
    np.testing.assert_array_equal(
        measured(np.ldexp(x, power)).variance, np.ldexp(measured(x).variance, 2 * power)
    )  # fmt: skip


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_scaling(scale):
    x = np.round(3 * white(50_000)) + 1e-3 * np.arange(50_000)
    np.testing.assert_allclose(measured(scale * x).variance, scale**2 * measured(x).variance, rtol=1e-9)


@deterministic
@given(seeds, st.floats(-1e4, 1e4))
def test_sign_direction_and_offset_change_nothing(seed, offset):
    x = white(2000, seed)
    expected = measured(x).variance
    for other in (-x, x[::-1].copy(), x + offset):
        np.testing.assert_allclose(measured(other).variance, expected, rtol=1e-8)


@deterministic
@given(seeds, st.sampled_from([0.3, 0.6, 0.9, 0.99]))
def test_the_root_is_a_falling_one(seed, efficiency):
    x = rng(seed).standard_t(3, size=5000)
    tuning = biweight(efficiency)
    found = robust_variances(source := HaarCoefficients(x, 11), efficiency)
    for k, outcome in enumerate(found.diagnostics["outcome"]):
        w = source.sample(k, x.size)
        cubed, fourth = _core.biweight_sums(w, tuning.c**2 * float(found.variance[k]))
        value, slope = tuning.criterion(cubed, fourth, float(w.size))
        # The coarsest levels hold too few swings to have a root each time.
        assert outcome == "root" or (outcome == "mad" and k >= 7)
        if outcome == "root":
            assert abs(value) < 1e-11
            assert slope < 0


def test_the_same_input_gives_the_same_output():
    x = white(300_000)
    np.testing.assert_array_equal(measured(x).variance, measured(x).variance)


def test_high_efficiency_is_nearly_classical():
    x = white(200_000)
    classical, robust = gmwm.wavelet_variance(x, 1.0), measured(x, efficiency=0.99)
    np.testing.assert_allclose(robust.variance[:8], classical.variance[:8], rtol=0.01)


@pytest.mark.parametrize("efficiency", [0.6, 0.9])
def test_efficiency_is_what_it_is_called(efficiency):
    # Of uncorrelated coefficients: 600 estimates of their variance, and its classical one.
    draws = rng(5).standard_normal((600, 2000))
    robust = np.array([robust_variance(w, efficiency) for w in draws])
    ratio = np.mean(draws**2, axis=1).var() / robust.var()
    assert ratio == pytest.approx(efficiency, rel=4 * math.sqrt(2 * (1 - efficiency) / 600) * 1.5)
    assert robust.mean() == pytest.approx(1, abs=4 * robust.std() / math.sqrt(600) + 1e-3)


# --- the slow twin ----------------------------------------------------------------------------------


def spoilt(n):
    x = white(n)
    places = rng(1).choice(n, n // 200, replace=False)
    x[places] += 1000 * rng(2).choice([-1, 1], places.size)
    return x


SIGNALS = {
    "white": white(10_000),
    "walk": np.cumsum(white(10_000)),
    "drift": white(10_000) + 1e-3 * np.arange(10_000),
    "heavy tails": rng(3).standard_t(1.5, size=10_000),
    "outliers": spoilt(10_000),
    "coarse": np.round(0.7 * white(10_000)),
    "coarse, in g": 9.81 + 0.0033 * np.round(0.7 * white(10_000) + np.cumsum(0.01 * white(10_000, 1))),
    "sine": np.sin(0.01 * np.arange(10_000)) + 0.01 * white(10_000),
    "one sample more than 2^13": white(8193),
}


@pytest.mark.slow
@each("efficiency", [0.3, 0.9])
@each("name", SIGNALS)
def test_twin(name, efficiency):
    x = SIGNALS[name]
    levels = x.size.bit_length() - 1
    tuning, found = biweight(efficiency), robust_variances(HaarCoefficients(x, levels), efficiency)
    for k in range(levels):
        w = np.asarray(haar.coefficients(x, k + 1), dtype=np.float64)
        if w.size > 2:
            assert found.variance[k] == pytest.approx(twin.variance(w, tuning.c, tuning.a), rel=1e-9), k + 1
    assert max(found.diagnostics["passes"]) <= 12


def test_large_signals_take_three_passes_at_most():
    n = 1 << 19
    x = white(n) + np.cumsum(1e-3 * white(n, 1))
    found = robust_variances(HaarCoefficients(x, 18))
    tuning = biweight(0.6)
    assert set(found.diagnostics["outcome"]) == {"root"}
    assert max(found.diagnostics["passes"]) <= 3
    source = HaarCoefficients(x, 18)
    for k in (0, 4, 9, 17):
        w = source.sample(k, n)
        cubed, fourth = _core.biweight_sums(w, tuning.c**2 * float(found.variance[k]))
        assert abs(tuning.criterion(cubed, fourth, float(w.size))[0]) < 1e-10


@pytest.mark.slow
@deterministic
@given(seeds, st.integers(3, 3 * SAMPLED_COEFFICIENTS), st.sampled_from([0.4, 0.6, 0.9]))
def test_plain_coefficients_take_the_same_root(seed, size, efficiency):
    w = rng(seed).standard_t(4, size=size)
    tuning = biweight(efficiency)
    assert robust_variance(w, efficiency) == pytest.approx(twin.variance(w, tuning.c, tuning.a), rel=1e-9)


def test_plain_coefficients_are_those_of_haar():
    x = white(30_000)
    source = HaarCoefficients(x, 12)
    arrays = [np.asarray(haar.coefficients(x, j), dtype=np.float64) for j in range(1, 13)]
    plain = robust_variances(PlainCoefficients(arrays, [0.0] * 12), 0.6)
    np.testing.assert_allclose(plain.variance, robust_variances(source, 0.6).variance, rtol=1e-10)


# --- outliers ---------------------------------------------------------------------------------------


def test_one_per_cent_of_outliers_and_their_size():
    n = 200_000
    clean = white(n)
    places = rng(1).choice(n, n // 100, replace=False)
    signs = rng(2).choice([-1.0, 1.0], places.size)

    def spoilt_by(size):
        x = clean.copy()
        x[places] = size * signs
        return x

    near, far = measured(spoilt_by(1e3)).variance[:3], measured(spoilt_by(1e6)).variance[:3]
    np.testing.assert_allclose(near, measured(clean).variance[:3], rtol=0.2)
    np.testing.assert_allclose(far, near, rtol=1e-6)
    assert gmwm.wavelet_variance(spoilt_by(1e3), 1.0).variance[0] > 1000


def test_one_huge_outlier():
    x = white(100_000)
    expected = measured(x).variance[:8]
    x[50_000] = 1e8
    np.testing.assert_allclose(measured(x).variance[:8], expected, rtol=0.02)


@pytest.mark.parametrize("share", [0.35, 0.5])
def test_beyond_its_breakdown_it_is_the_median(share):
    w = white(100_000)
    count = round(share * w.size)
    w[:count] = 1e6
    rng(1).shuffle(w)
    expected = (np.median(np.abs(w)) / 0.6744897501960817) ** 2
    assert robust_variance(w, 0.6) == pytest.approx(expected, rel=1e-12)
    found = robust_variances(PlainCoefficients([w], [0.0]), 0.6)
    assert found.diagnostics["outcome"] == ["mad"]


@pytest.mark.parametrize(("efficiency", "share"), [(0.6, 0.26), (0.8, 0.42), (0.9, 0.56)])
def test_breakdown_is_where_the_words_say(efficiency, share):
    # Far outliers add nothing to mean ρ: it falls short of a where (1 - share) of its largest value does.
    tuning, w = biweight(efficiency), white(50_000)
    largest = max(twin.mean_rho(w, s, tuning.c) for s in np.linspace(0.1, 1.0, 100))
    assert 1 - tuning.a / largest == pytest.approx(share, abs=0.01)
    if share < 0.45:
        for part, outcome in ((share - 0.02, "root"), (share + 0.02, "mad")):
            spoilt = np.where(np.arange(w.size) < part * w.size, 1e6, w)
            found = robust_variances(PlainCoefficients([spoilt], [0.0]), efficiency)
            assert found.diagnostics["outcome"] == [outcome]


def test_pulled_down_as_the_words_say():
    w = white(400_000)
    w[: w.size // 10] = 1e6
    assert robust_variance(w, 0.6) == pytest.approx(0.79, abs=0.01)


def test_outliers_do_not_turn_the_slope():
    x = white(10_000) + 1e-3 * np.arange(10_000)
    x[:40] = 1e4
    assert gmwm.wavelet_variance(x, 1.0).slope < 0
    assert measured(x).slope == pytest.approx(1e-3, rel=0.1)


# --- where there is no root -------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0.0, 9.81, -1e-12])
def test_a_constant_is_zero(value):
    wv = measured(np.full(5000, value))
    assert np.all(wv.variance == 0)
    assert set(outcomes(wv)) == {"zero"}


@pytest.mark.parametrize("unit", [1.0, 0.0033, 1e-9])
@pytest.mark.parametrize("offset", [0.0, 9.81])
def test_coarse_quantisation(unit, offset):
    # A standard deviation of 0.3 units: three quarters of the coefficients of level 1 are zero.
    x = offset + unit * np.round(0.3 * white(50_000))
    wv = measured(x)
    zeros = wv.diagnostics["robust"]["zeros"]
    difference = np.diff(np.round(0.3 * white(50_000)))
    assert zeros[0] == np.count_nonzero(difference == 0) / difference.size > 0.5
    assert outcomes(wv)[0] == "zero"
    assert wv.variance[0] == wv.lower[0] == wv.upper[0] == 0
    assert outcomes(wv)[5:] == ["root"] * (len(wv) - 5)
    np.testing.assert_allclose(wv.variance[5:8], gmwm.wavelet_variance(x, 1.0).variance[5:8], rtol=0.05)
    assert 1 in only(wv.remarks, "robust-too-large:zero").facts["levels"]
    assert wv.remarks[0].text() in wv.summary()


def test_a_root_though_most_are_zero():
    # 55 % zeros, the rest one step of a coarse quantizer up or down: the MAD is 0, but the rest decides.
    w = np.where(rng(1).random(50_000) < 0.55, 0.0, np.sign(white(50_000)))
    found = robust_variances(PlainCoefficients([w], [0.0]), 0.6)
    assert found.diagnostics["outcome"] == ["root"]
    tuning = biweight(0.6)
    assert twin.mean_rho(w, float(found.variance[0]), tuning.c) == pytest.approx(tuning.a, rel=1e-9)


@pytest.mark.slow
def test_near_one_half_of_zeros():
    # The sample may see more zeros than all coefficients hold; the twin looks at all.
    tuning = biweight(0.9)
    for seed in range(12):
        w = np.where(rng(seed).random(50_000) < 0.499, 0.0, np.sign(white(50_000, seed)))
        if 2 * np.count_nonzero(w) > w.size:
            assert robust_variance(w, 0.9) == pytest.approx(twin.variance(w, tuning.c, tuning.a), rel=1e-9)


@pytest.mark.parametrize("scale", [1e-200, 1e-170, 1e-150, 1e130])
def test_the_ends_of_double_precision(scale):
    # Where the classical variance underflows to zero the robust one does; it is never a NaN.
    x = scale * white(5000)
    robust, classical = measured(x).variance, gmwm.wavelet_variance(x, 1.0).variance
    assert np.all(np.isfinite(robust))
    np.testing.assert_allclose(robust[:6], classical[:6], rtol=0.2, atol=1e-307)


@pytest.mark.parametrize("samples", [8, 64, 1024, 1025])
def test_one_or_two_coefficients_are_classical(samples):
    x = white(samples)
    wv, classical = measured(x), gmwm.wavelet_variance(x, 1.0)
    few = classical.counts <= 2
    assert few.any()
    np.testing.assert_allclose(wv.variance[few], classical.variance[few], rtol=1e-13)
    assert [outcome == "mean" for outcome in outcomes(wv)] == few.tolist()


def test_a_drift_alone():
    # All coefficients of a level are one number: the root lies above its square by c² times a constant.
    wv = measured(0.25 * np.arange(4096))
    h = 2.0 ** (wv.levels - 1)
    ratio = wv.variance / (0.25 * h / 2) ** 2
    np.testing.assert_allclose(ratio[:-1], ratio[0], rtol=1e-6)


def test_bad_signals_are_refused_as_by_the_classical():
    for bad in ([1.0] * 7, [np.nan] * 100, [1.0] * 99 + [np.inf], np.zeros((10, 3, 2))):
        with pytest.raises(gmwm.errors.DataError):
            measured(bad)


# --- the result -------------------------------------------------------------------------------------


def test_limits_take_the_efficiency():
    from scipy.stats import chi2

    wv = measured(white(4096), efficiency=0.8)
    eta = 0.8 * np.maximum(wv.counts / wv.scales, 1)
    np.testing.assert_allclose(wv.degrees_of_freedom, eta)
    np.testing.assert_allclose(wv.lower, eta * wv.variance / chi2.ppf(0.975, eta), rtol=1e-9)
    np.testing.assert_allclose(wv.upper, eta * wv.variance / chi2.ppf(0.025, eta), rtol=1e-9)


def test_result_says_what_it_is_and_survives_json():
    import json

    wv = measured(white(4096))
    assert (wv.robust, wv.efficiency) == (True, 0.6)
    assert "robust" in repr(wv)
    assert "robust, efficiency 0.6" in wv.summary()
    again = gmwm.WaveletVariance.from_dict(json.loads(json.dumps(wv.to_dict())))
    assert again.to_dict() == wv.to_dict()
    assert again.remarks == wv.remarks
    classical = gmwm.wavelet_variance(white(4096), 1.0)
    assert (classical.robust, classical.efficiency, classical.remarks) == (False, None, ())


def test_an_efficiency_belongs_to_robust_estimates():
    for ask in (
        lambda efficiency: gmwm.wavelet_variance(np.arange(50.0), 1.0, efficiency=efficiency),
        lambda efficiency: gmwm.covariance.wavelet_covariance("WN(sigma2=1.0)", 50, 1.0, efficiency=efficiency),
    ):
        for efficiency in (0.8, 7.0):
            with raises(gmwm.errors.OptionError, argument="efficiency", advises=("robust=True",)):
                ask(efficiency)
        assert np.all(np.isfinite(getattr(ask(0.6), "variance", 1.0)))


@pytest.mark.parametrize("samples", [3105250.5, "1000", True, -1, math.nan])
def test_a_length_is_a_whole_number(samples):
    with raises(gmwm.errors.DataError, "whole number", argument="samples"):
        gmwm.WaveletVariance.from_values([3.0, 2.0], samples, 100.0)


def test_a_length_may_be_written_with_an_exponent():
    assert gmwm.WaveletVariance.from_values([3.0, 2.0], 3e6, 100.0).samples == 3_000_000


def test_from_values():
    wv = measured(white(4096), efficiency=0.9)
    same = gmwm.WaveletVariance.from_values(wv.variance, 4096, 1.0, robust=True, efficiency=0.9)
    np.testing.assert_allclose(same.lower, wv.lower)
    assert gmwm.WaveletVariance.from_values([1.0], 4096, 1.0, robust=True).efficiency == 0.6
    with raises(gmwm.errors.OptionError, argument="efficiency", advises=("robust=True",)):
        gmwm.WaveletVariance.from_values([1.0], 4096, 1.0, efficiency=0.9)
    with raises(gmwm.errors.OptionError, "from 0.3 to 0.99", argument="efficiency"):
        gmwm.WaveletVariance.from_values([1.0], 4096, 1.0, robust=True, efficiency=2.0)


# --- the kernel's door ------------------------------------------------------------------------------


def test_kernel_refuses_what_would_crash():
    total = _core.running_sum(white(100))
    with pytest.raises(ValueError, match=r"^limit "):
        _core.biweight_sums(total, 0.0)
    with pytest.raises(ValueError, match=r"^level "):
        _core.haar_biweight_sums(total, np.ones(7), 1)
    with pytest.raises(ValueError, match="every"):
        _core.haar_biweight_sums(total, np.ones(3), 0)
    for level in (0, 7, 63):
        with pytest.raises(ValueError, match=r"^level "):
            _core.haar_sample(total, level, 10)
        with pytest.raises(ValueError, match=r"^level "):
            _core.haar_between(total, level, 0.0, 1.0)


# --- values beside which the others have no digits -----------------------------------------------------


@pytest.mark.parametrize("value", [1e17, -3.4e38, 1e155, 1e300])
def test_a_value_that_takes_all_digits_is_refused(value):
    x = white(20_000)
    x[7000] = value
    with raises(DataError, 7000, got=value):
        measured(x)
    live = gmwm.WaveletAccumulator(rate=1.0, robust=True)
    live.update(white(1000))
    with raises(DataError, got=value):
        live.update(x)
    assert len(live) == 1000
    for k in range(6990, 7010):
        live.update(x[k : k + 1])
    with raises(DataError, got=value):
        live.result(robust=True)


def test_large_outliers_and_offsets_are_not_refused():
    x = white(20_000)
    clean = measured(x).variance
    assert measured(x + 1e9).variance == pytest.approx(clean, rel=1e-4)
    x[7000] = 1e9
    assert measured(x).variance[:6] == pytest.approx(clean[:6], rel=0.02)
    assert measured(np.where(np.arange(20_000) == 7000, 1e20, 0.0)).variance[:3].tolist() == [0, 0, 0]


@pytest.mark.parametrize("power", [-165, -160, -158, -155, -154, -150, -140, 140, 150])
def test_data_near_the_ends_of_double_precision(power):
    x = np.random.default_rng(5).normal(size=4000)
    variance = gmwm.wavelet_variance(x * 10.0**power, rate=100.0, robust=True).variance
    assert np.all(np.isfinite(variance))
    if power > -150:  # below, the variance itself has few digits
        np.testing.assert_allclose(
            variance / 10.0**power / 10.0**power, gmwm.wavelet_variance(x, rate=100.0, robust=True).variance, rtol=0.3
        )
