"""ARMA processes next to unit roots against many digits, their closed forms, and the classes of their orders."""

import copy
import math
import pickle
from dataclasses import replace

import mpmath as mp
import numpy as np
import pytest

from gmwm import AR, AR1, ARMA, MA, SARMA, WN, Model, fixed, wavelet_variance
from gmwm.base.errors import ModelError
from gmwm.measuring.covariance import wavelet_covariance
from gmwm.theory.filters import find_filter
from gmwm.theory.processes import every_class, ordered_classes, rational, registry
from gmwm.theory.processes.linear_recursion import CANCELLING
from tests.helpers import codes, each, raises
from tests.oracles import filters as filter_oracle
from tests.oracles import processes as oracle

LEVELS = [1, 2, 3, 5, 8, 12, 17, 23, 30]


def recursion(*roots):
    """Coefficients of the recursion with these roots."""
    return list(-np.real(np.poly(roots))[1:])


def pair(distance, angle):
    z = (1 - distance) * np.exp(1j * angle)
    return z, z.conjugate()


# --- accuracy next to the unit circle -----------------------------------------------------------------

CASES = {
    **{f"AR root {s}(1 - {d})": (AR, {"phi": recursion(s * (1 - d), o)})
       for d in (1e-3, 1e-6, 1e-9) for s, o in ((1, 0.4), (1, -0.7), (-1, 0.4))},
    **{f"pair 1 - {d} at {w}": (AR, {"phi": recursion(*pair(d, w))})
       for d in (1e-3, 1e-6) for w in (0.01, 1.5, 3.0)},
    **{f"MA root {s}(1 - {d})": (MA, {"theta": [-v for v in recursion(s * (1 - d), 0.4)]})
       for d in (1e-3, 1e-6, 1e-9) for s in (1, -1)},
    **{f"both {d}": (ARMA, {"phi": recursion(1 - d, 0.4), "theta": [d / 2 - 1]}) for d in (1e-3, 1e-9)},
    "two roots": (AR, {"phi": recursion(1 - 1e-5, 1 - 3e-5, -0.7)}),
    "pair and root": (ARMA, {"phi": recursion(*pair(1e-6, 0.5), 0.9), "theta": [0.3, 0.2, -0.5, 0.1]}),
    "season": (SARMA, {"phi": [0.4], "sphi": [1 - 1e-9], "stheta": [0.3], "period": 4}),
}  # fmt: skip


@pytest.mark.slow
@each("case", CASES)
def test_shape_and_slopes_keep_their_digits_next_to_the_unit_circle(case):
    family, values = CASES[case]
    one = family(**values, sigma2=1.0)
    theta, process = one.nonlinear, type(one)
    with mp.workdps(oracle.DIGITS):
        exact = [float(oracle.arma(list(map(mp.mpf, theta)), process.full_orders(), j)) for j in LEVELS]
    np.testing.assert_allclose(one.wavelet_variance(LEVELS, 1.0), exact, rtol=1e-12)
    slopes = process.shape_jacobian(theta[None], LEVELS, 1.0)[0]
    for k in range(theta.size):
        with mp.workdps(oracle.DIGITS):
            step, sides = mp.mpf(10) ** -40, []
            for sign in (1, -1):
                moved = list(map(mp.mpf, theta))
                moved[k] += sign * step
                sides.append([oracle.arma(moved, process.full_orders(), j) for j in LEVELS])
            derived = [float((a - b) / (2 * step)) for a, b in zip(*sides, strict=True)]
        # A derivative may pass through zero between levels: by the size of the variance then.
        np.testing.assert_allclose(slopes[:, k], derived, rtol=1e-9, atol=1e-12 * min(exact))


@pytest.mark.parametrize("case", ["AR root 1(1 - 1e-09)", "AR root -1(1 - 1e-09)", "MA root 1(1 - 1e-09)", "season"])
@pytest.mark.parametrize("name", ["haar", "d4", "la8"])
def test_other_filters_keep_their_digits_too(case, name):
    keys = {c.split(" 0.")[0]: c for c in CASES}
    family, values = CASES[keys[case]]
    one, f = family(**values, sigma2=1.0), find_filter(name)
    taps = filter_oracle.orthonormal(list(f.scaling), f.vanishing_moments)
    exact = filter_oracle.arma(taps, list(one.nonlinear), type(one).full_orders(), 25)
    np.testing.assert_allclose(one.wavelet_variance(25, 1.0, name), [float(v) for v in exact], rtol=1e-12)


@pytest.mark.parametrize("delta", [1e-3, 1e-9])
def test_wavelet_variance_is_the_sum_over_the_filter(delta):
    one = ARMA(phi=recursion(1 - delta, 0.4), theta=[0.3], sigma2=2.0)
    n = 64
    # Of differences from r(0), as a filter that sums to zero takes them.
    r = one._autocovariance(np.arange(n), from_zero=True)
    for level in range(1, 7):
        taps = np.repeat([1.0, -1.0], 2 ** (level - 1)) / 2**level
        matrix = r[np.abs(np.subtract.outer(np.arange(taps.size), np.arange(taps.size)))]
        assert taps @ matrix @ taps == pytest.approx(one.wavelet_variance([level], 1.0)[0], rel=1e-11)


# --- closed forms and smaller processes ---------------------------------------------------------------


@pytest.mark.parametrize("theta", [-0.999, 0.3, 0.9])
def test_a_first_order_moving_average_has_its_closed_form(theta):
    tau = 2.0 ** np.arange(1, 21)
    one = MA(theta=[theta], sigma2=3.0)
    np.testing.assert_allclose(
        one.wavelet_variance(20, 1.0), 3 * ((1 + theta) ** 2 * tau - 6 * theta) / tau**2, rtol=1e-12
    )
    assert one.correlation_time(1.0) == 0.0
    assert one.autocovariance([0, 1, -1, 2, 50], 1.0) == pytest.approx([3 * (1 + theta**2), 3 * theta, 3 * theta, 0, 0])


@pytest.mark.parametrize("phi", [0.999, -0.9, 1 - 1e-9])
def test_a_first_order_autoregression_is_the_one_with_a_name_of_its_own(phi):
    one, other, lags = AR(phi=[phi], sigma2=2.0), AR1(phi=phi, sigma2=2.0), np.arange(50)
    for name in ("haar", "la8"):
        np.testing.assert_allclose(one.wavelet_variance(30, 1.0, name), other.wavelet_variance(30, 1.0, name), 1e-12)
    np.testing.assert_allclose(one.autocovariance(lags, 1.0), other.autocovariance(lags, 1.0), rtol=1e-12)
    frequencies = np.array([0.0, 1e-9, 0.1, 0.5])
    np.testing.assert_allclose(one.psd(frequencies, 1.0), other.psd(frequencies, 1.0), rtol=1e-9)
    assert one.correlation_time(50.0) == pytest.approx(other.correlation_time(50.0), rel=1e-9)
    assert str(Model.parse("AR(1) + WN")) == "AR(1) + WN"


def test_common_factors_drop_out():
    # (1 − 0.5B)(1 − 0.8B) X = (1 − 0.8B) e
    long, short = ARMA(phi=recursion(0.5, 0.8), theta=[-0.8], sigma2=1.0), AR(phi=[0.5], sigma2=1.0)
    np.testing.assert_allclose(long.wavelet_variance(20, 1.0), short.wavelet_variance(20, 1.0), rtol=1e-13)


def test_a_season_is_the_product_written_out():
    short = SARMA(phi=[0.5], theta=[0.4], sphi=[0.8], stheta=[-0.3], period=3, sigma2=1.5)
    long = ARMA(phi=[0.5, 0, 0.8, -0.4], theta=[0.4, 0, -0.3, -0.12], sigma2=1.5)
    np.testing.assert_allclose(short.wavelet_variance(12, 1.0), long.wavelet_variance(12, 1.0), rtol=1e-13)
    f = np.linspace(-0.5, 0.5, 21)
    np.testing.assert_allclose(short.psd(f, 1.0), long.psd(f, 1.0), rtol=1e-12)
    assert short.correlation_time(2.0) == pytest.approx(-3 / math.log(0.8) / 2)


def test_theory_is_that_of_many_digits():
    one = ARMA(phi=recursion(0.9999, *pair(0.01, 0.3)), theta=[0.5], sigma2=1.0)
    pairs, early = oracle.exponentials(tuple(map(mp.mpf, one.nonlinear)), type(one).full_orders(), 50)
    lags = np.array([0, 1, 2, 7, 100, 12345, 200000])
    exact = np.array([float(mp.re(sum(a * root ** int(k) for a, root in pairs))) for k in lags])
    assert not early
    np.testing.assert_allclose(one.autocovariance(lags, 1.0), exact, rtol=1e-11)
    np.testing.assert_allclose(one.autocovariance(-lags[::-1], 1.0), exact[::-1], rtol=1e-11)
    k = np.arange(1, 300)
    r = one.autocovariance(k, 1.0)
    sums = [n * exact[0] + 2 * float((n - k[: n - 1]) @ r[: n - 1]) for n in (1, 2, 3, 40, 300)]
    np.testing.assert_allclose(-2 * one.running_sum_covariance([1, 2, 3, 40, 300], 1.0), sums, rtol=1e-12)


# --- simulation and what is estimated ------------------------------------------------------------------


WANDERING = AR(phi=recursion(1 - 1e-7, *pair(1e-3, 0.5), 0.3), sigma2=2.0)
SEASONAL = SARMA(phi=[0.5], theta=[0.4], sphi=[0.9], period=4, sigma2=2.0)


@pytest.mark.parametrize("process", [WANDERING, SEASONAL], ids=str)
def test_paths_start_stationary(process):
    paths = process.simulate(12, 1.0, 3, paths=4000)
    lags = np.arange(12)
    for start in (0, 5):
        products = paths[:, start : start + 1] * paths[:, start:]
        error = products.std(axis=0) / math.sqrt(len(paths))
        r = process.autocovariance(lags[: 12 - start], 1.0)
        assert np.all(np.abs(products.mean(axis=0) - r) <= 4 * error)
    # What a step adds is far smaller than what there is: it has to be right by itself.
    steps = np.diff(paths, axis=1)
    exact = 2 * (process.autocovariance([0], 1.0) - process.autocovariance([1], 1.0))
    assert steps.var() == pytest.approx(exact[0], rel=4 * math.sqrt(2 / 4000))


@pytest.mark.slow
def test_the_covariance_of_estimates_is_what_they_scatter_by():
    model, draws = ARMA(phi=recursion(*pair(0.1, 0.4)), theta=[0.3], sigma2=1.0) + WN(sigma2=2.0), 1500
    paths = model.simulate(512, 1.0, 8, paths=draws)
    estimates = np.array([wavelet_variance(path, 1.0, levels=6).variance for path in paths])
    centred = estimates - estimates.mean(axis=0)
    products = centred[:, :, None] * centred[:, None, :]
    error = products.std(axis=0) / math.sqrt(draws)
    assert np.all(np.abs(products.mean(axis=0) - wavelet_covariance(model, 512, 1.0, levels=6)) <= 4 * error)


# --- the classes ---------------------------------------------------------------------------------------


def test_classes_are_made_once_and_kept_out_of_the_registry():
    assert AR.of(3) is AR.of(3) is type(AR(3))
    assert AR.of(3) is not AR.of(2)
    assert AR.of(3)().of(2) is AR.of(2)
    assert [p.name for p in ARMA.of(2, 1).parameters] == ["phi1", "phi2", "theta1", "sigma2"]
    assert not any(name in registry for name in (*ordered_classes, "AR(3)"))
    assert {"AR(2)", "MA(1)", "GM"} <= set(every_class())
    assert isinstance(AR(2), AR)


@pytest.mark.parametrize(
    ("one", "text"),
    [
        (AR(2), "AR(2)"),
        (AR(phi=[1.4, -0.6], sigma2=1.0), "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0)"),
        (AR(2, phi1=0.5, sigma2=fixed(1.0)), "AR(2, phi1=0.5, sigma2=fixed(1.0))"),
        (AR(phi=[None, fixed(0.3)]), "AR(2, phi2=fixed(0.3))"),
        (AR(phi=np.array([0.25])), "AR(1, phi1=0.25)"),
        (MA(1), "MA(1)"),
        (ARMA(2, 1), "ARMA(2,1)"),
        (ARMA(phi=[0.5], theta=[0.25, 0.1]), "ARMA(1, 2, phi1=0.5, theta1=0.25, theta2=0.1)"),
        (SARMA(1, 0, 1, 0, period=12), "SARMA(1,0,1,0,12)"),
        (SARMA(1, 0, 1, 0, 12), "SARMA(1,0,1,0,12)"),
        (SARMA(phi=[0.5], stheta=[0.2], period=7), "SARMA(1, 0, 0, 1, 7, phi1=0.5, stheta1=0.2)"),
    ],
    ids=str,
)
def test_one_process_in_all_its_forms(one, text):
    assert str(one) == repr(one) == text
    assert Model.parse(str(one)).processes == (one,)
    assert Model.parse(f"{text.lower()} + WN").processes[0] == one
    for same in (pickle.loads(pickle.dumps(one)), copy.copy(one), copy.deepcopy(one), replace(one), one.with_values()):
        assert same == one
        assert type(same) is type(one)
        assert hash(same) == hash(one)
    assert replace(one, sigma2=9.0).values["sigma2"] == 9.0
    structure = Model((one,)).structure
    assert Model.parse(structure).processes == (type(one)(),)


@each(
    ("call", "facts", "expected"),
    [
        (lambda: AR(), ("AR(p)", "phi=[…]"), {"got": ()}),
        (lambda: AR(0), ("AR(p)",), {"argument": "p", "got": 0}),
        (lambda: MA(0), ("MA(q)",), {"argument": "q", "got": 0}),
        (lambda: AR(-1), ("whole number from 0", "got -1"), {"argument": "p"}),
        (lambda: AR(2.0), ("whole number from 0", "got 2.0"), {"argument": "p"}),
        (lambda: AR(True), ("whole number from 0", "got True"), {"argument": "p"}),
        (lambda: AR(64), ("AR(64)", "63"), {"reach": 64}),
        (lambda: SARMA(0, 0, 6, 0, 12), ("63",), {"reach": 72}),
        (lambda: ARMA(2, 0), ("at least 1", "got 2 and 0"), {"simpler": "AR(2)"}),
        (lambda: ARMA(0, 3), ("got 0 and 3",), {"simpler": "MA(3)"}),
        (lambda: SARMA(2, 1, 0, 0, 12), ("P or Q", "at least 1", "got 0 and 0"), {"simpler": "ARMA(2, 1)"}),
        (lambda: SARMA(1, 0, 1, 0), ("got 4 orders",), {"got": (1, 0, 1, 0)}),
        (lambda: SARMA(1, 0, 1, 0, 1), ("whole number from 2",), {"argument": "period", "got": 1}),
        (lambda: SARMA(1, 0, 1, 0, 12, period=12), ("given twice",), {"argument": "period"}),
        (lambda: AR(2, phi=[0.1]), ("AR(2)", "p = 2", "phi has 1 values"), {"argument": "p", "got": 2}),
        (lambda: AR.of(2)(3), ("AR(2)", "(2,)"), {"got": (3,)}),
        (lambda: AR(phi=0.4), ("phi of AR", "list"), {"argument": "phi", "got": 0.4, "first": "phi1"}),
        (lambda: AR(phi=[0.5], phi1=0.4), ("AR(1).phi1", "given twice"), {"argument": "phi1"}),
        (lambda: AR(2, phi3=0.1), ("AR(2)", "phi1, phi2, sigma2"), {"argument": "phi3"}),
        (lambda: AR(phi=[1.4, -0.3]), ("AR(2)", "stationary", "phi = (1.4, -0.3)", "0.880367"), {"argument": "phi"}),
        (lambda: AR(phi=[1.0]), ("the modulus 1",), {"argument": "phi", "advises": ("random walk",)}),
        (
            lambda: MA(theta=[2.0]),
            ("MA(1)", "invertible", "the modulus 0.5"),
            {"argument": "theta", "advises": ("zero inverted",)},
        ),
        (lambda: SARMA(0, 0, 1, 0, 4, sphi1=-1.5), ("stationary", "sphi = "), {"argument": "sphi"}),
        (lambda: AR(phi=[0.5]).with_values(phi1=1.5), ("stationary",), {"argument": "phi"}),
        (lambda: AR(2) + AR(2), ("AR(2)",), {"count": 2, "instead": "ARMA(4,2)"}),
        (lambda: 3 * MA(1), ("MA(1)",), {"count": 3, "instead": "MA(1)"}),
        (lambda: SARMA(1, 0, 1, 0, 4) * 2, ("SARMA(1,0,1,0,4)",), {"count": 2, "instead": "SARMA(1,0,1,0,4)"}),
    ],
)
def test_what_is_no_process_says_why(call, facts, expected):
    with raises(ModelError, *facts, **expected):
        call()


def test_coefficients_that_are_not_all_given_are_not_judged():
    assert AR(2, phi1=1.9).values["phi1"] == 1.9
    assert AR(phi=[fixed(1.9), None]).is_fixed("phi1")


# --- polynomials ---------------------------------------------------------------------------------------


def test_coordinates_are_finite_where_all_roots_are_inside_and_only_there():
    rng = np.random.default_rng(4)
    for n in (1, 2, 3, 6):
        rows = rng.standard_normal((300, n)) * np.array([1.2, 0.5, 0.3, 0.2, 0.2, 0.2])[:n]
        inside = np.array([np.abs(rational.roots(row)).max() < 1 for row in rows])
        assert 30 < inside.sum() < 300
        z = rational.coordinates(rows)
        assert np.array_equal(np.all(np.isfinite(z), axis=1), inside)
        np.testing.assert_allclose(rational.at_coordinates(z[inside]), rows[inside], rtol=1e-9, atol=1e-12)


def test_rows_that_are_not_stationary_are_nan_and_the_others_what_they_are_alone():
    rows = np.array([[1.4, -0.6], [1.4, -0.3], [0.2, 0.1], [0.0, 1.0]])
    with np.errstate(all="raise"):
        shapes, slopes = AR.of(2).shape(rows, 5, 1.0), AR.of(2).shape_jacobian(rows, 5, 1.0)
    assert np.array_equal(np.isnan(shapes).all(axis=1), [False, True, False, True])
    assert np.array_equal(np.isnan(slopes).all(axis=(1, 2)), [False, True, False, True])
    assert np.array_equal(shapes[[0]], AR.of(2).shape(rows[[0]], 5, 1.0))
    assert np.array_equal(AR.of(2).room(rows)[:, 0] > 0, [True, False, True, False])


@pytest.mark.parametrize("roots", [(0.9, -0.5), pair(1e-4, 0.123), (1 - 1e-6, 0.3, -0.2)])
def test_no_coefficient_leaves_its_room(roots):
    row = np.array([recursion(*roots)])
    room = rational.clearance(row)[0]
    assert room > 0
    for k in range(row.size):
        for sign in (1, -1):
            moved = row.copy()
            moved[0, k] += sign * room
            assert np.all(np.isfinite(rational.coordinates(moved)))


@pytest.mark.parametrize(("distance", "expected"), [(0.9 * CANCELLING, ["roots:cancel"]), (1.1 * CANCELLING, [])])
def test_roots_nearly_cancel_below_a_distance(distance, expected):
    # The root of 1 − φB is φ, and that of 1 + θB is −θ.
    process = ARMA(1, 1, phi1=0.5, theta1=-(0.5 + distance), sigma2=1.0)
    assert codes(process.remarks("ARMA(1,1)", samples=10_000, rate=1.0)) == expected


def test_coefficients_near_cancelling_roots_are_poorly_known():
    # The standard error of φ is √((1 − φ²)/N) (1 + φθ)/|φ + θ|, and |φ + θ| is the distance of the roots.
    near, far = (ARMA(1, 1, phi1=0.5, theta1=-(0.5 + d), sigma2=1.0) for d in (CANCELLING, 0.3))
    information = [_information(process) for process in (near, far)]
    errors = [math.sqrt(np.linalg.inv(one)[0, 0]) for one in information]
    assert errors[0] > 5 * errors[1]


def _information(process):
    """Information on φ and θ in one sample of an ARMA(1,1) (Brockwell and Davis 1991, example 8.8.3)."""
    phi, theta = process.phi1, process.theta1
    cross = 1 / (1 + phi * theta)
    return np.array([[1 / (1 - phi**2), cross], [cross, 1 / (1 - theta**2)]])


def test_the_search_starts_within_the_limits_of_the_partial_autocorrelations():
    samples, period = 100_000, 12
    ends = np.tanh(SARMA.of(2, 1, 1, 1, period).scan(samples, 1.0))
    assert ends[:, 0] == pytest.approx([-0.98661, -0.98661, -0.96403, -0.98661, -0.96403], abs=1e-5)
    first, seasonal = (1 - 1 / samples, 1 - period / samples)
    assert ends[:, 1] == pytest.approx([first, 0.98661, 0.96403, seasonal, 0.96403], abs=1e-5)
