"""The log-likelihood against whole covariance matrices, fifty digits and statsmodels; what it must not depend on."""

import mpmath as mp
import numpy as np
import pytest
from statsmodels.tsa.statespace.initialization import Initialization
from statsmodels.tsa.statespace.kalman_filter import KalmanFilter

from gmwm import Model, Signal
from gmwm.base import _core
from gmwm.base.errors import DataError, MissingTheoryError
from gmwm.fitting.likelihood.problem import LikelihoodProblem, as_record
from gmwm.fitting.likelihood.system import assemble, require_state
from gmwm.theory.processes import every_class
from tests.helpers import each, raises
from tests.oracles import gaussian as oracle
from validation.likelihood import concentrated

RATE = 100.0

STATIONARY = (
    "WN(sigma2=2.0)",
    "QN(q2=3.0)",
    "GM(beta=3.0, sigma2=2.0)",
    "GM(beta=0.01, sigma2=2.0)",
    "AR1(phi=0.95, sigma2=1.0)",
    "AR1(phi=-0.7, sigma2=1.0)",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0)",
    "MA(1, theta1=0.9, sigma2=1.0)",
    "MA(2, theta1=0.6, theta2=0.3, sigma2=1.0)",
    "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1.0)",
    "SARMA(1, 1, 1, 1, 4, phi1=0.5, theta1=0.2, sphi1=0.6, stheta1=0.3, sigma2=1.0)",
    "SIN(frequency=7.0, power=3.0) + WN(sigma2=1.0)",
    "GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0)",
    "2*GM(beta=[0.5, 20.0], sigma2=[2.0, 0.5]) + WN(sigma2=1.0) + QN(q2=0.5)",
    "2*GM(beta=[0.5, 20.0], sigma2=[2.0, 0.5])",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0)",
    "AR1(phi=-0.7, sigma2=1.0) + WN(sigma2=1.0)",
    "OSC(frequency=0.3, quality=4.0, sigma2=2.0) + WN(sigma2=1.0)",
)
WANDERING = (
    "RW(gamma2=0.3)",
    "RW(gamma2=1e-4) + WN(sigma2=1.0)",
    "GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
    "QN(q2=2.0) + RW(gamma2=0.1)",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + RW(gamma2=0.1)",
    "DR(omega=0.1) + WN(sigma2=1.0)",
    "DR(omega=0.1) + GM(beta=3.0, sigma2=2.0) + RW(gamma2=0.1)",
)
MISSING = {
    "none": [],
    "scattered": [3, 4, 17, 60, 61, 62, 101],
    "leading": list(range(9)),
    "trailing": list(range(110, 120)),
    "long": [*range(25, 90), 119],
    "steady": list(range(28, 120, 29)),
}


def parsed(text):
    """A model; "2*GM(beta=[…], …)" is short for two terms."""
    return Model.parse(text.replace("2*GM(beta=[0.5, 20.0], sigma2=[2.0, 0.5])",
                                    "GM(beta=0.5, sigma2=2.0) + GM(beta=20.0, sigma2=0.5)"))  # fmt: skip


def record(model, missing, samples=120, seed=1):
    x = 0.7 + model.simulate(samples, RATE, rng=seed)
    x[missing] = np.nan
    return x


@pytest.mark.slow
@each("missing", MISSING.values())
@each("mean", [None, 0.3])
@each("text", [*STATIONARY, *WANDERING])
def test_it_is_that_of_the_multivariate_normal(text, mean, missing):
    model = parsed(text)
    held = Model.parse(text.replace("omega=0.1", "omega=fixed(0.1)")) if "DR" in text else model
    x = record(model, missing)
    expected = oracle.loglikelihood(held, x, RATE, mean=mean)
    assert model.loglikelihood(x, RATE, mean=mean) == pytest.approx(expected, rel=1e-10)


@each("missing", MISSING.values())
@each("mean", [None, 0.3])
@each("text", [t for t in WANDERING if "DR" in t])
def test_a_free_slope_of_a_drift_is_at_its_best(text, mean, missing):
    model = Model.parse(text)
    x = record(model, missing)
    value, level = LikelihoodProblem(model, as_record(x, RATE), mean).value(model)
    assert value == pytest.approx(oracle.loglikelihood(model, x, RATE, mean=mean), rel=1e-10)
    slope = float(level.values[level.labels.index("DR")])
    values = [
        oracle.loglikelihood(Model.parse(text.replace("omega=0.1", f"omega=fixed({w!r})")), x, RATE, mean=mean)
        for w in (slope, slope * (1 - 1e-3), slope * (1 + 1e-3))
    ]
    assert value == pytest.approx(values[0], rel=1e-10)
    assert values[0] > max(values[1:])


def test_every_process_with_a_state_space_is_among_them():
    there = {p.name.partition("(")[0] for t in (*STATIONARY, *WANDERING) for p in parsed(t).processes}
    for name, process in every_class().items():
        if process._derives("state_space"):
            assert name.partition("(")[0] in there, name


@pytest.mark.parametrize("level", [False, True])
@pytest.mark.parametrize("decay", [1e-9, 1e-7, 1e-4, 5.0])
def test_slow_processes_without_white_noise_keep_their_digits(decay, level):
    model = Model.parse(f"GM(beta={decay * RATE!r}, sigma2=3.0)")
    x = model.simulate(40, RATE, rng=4)
    beta = mp.mpf(decay * RATE) / RATE
    exact = oracle.precise(lambda k: 3 * mp.exp(-beta * k), x.tolist(), level=level)
    got = model.loglikelihood(x, RATE, mean=None if level else 0.0)
    # λ itself is known to the rounding of e^(−λ) only, which is what F holds.
    assert abs(got - exact) <= (1e-12 + 4e-16 / decay) * abs(exact)


def test_two_slow_processes_without_white_noise_keep_most_of_theirs():
    decays, scales = (1e-6, 1e-3), (2.0, 1.0)
    model = Model.parse(" + ".join(f"GM(beta={d * RATE!r}, sigma2={s})" for d, s in zip(decays, scales, strict=True)))
    x = model.simulate(40, RATE, rng=5)
    exact = oracle.precise(
        lambda k: sum(s * mp.exp(-mp.mpf(d) * k) for d, s in zip(decays, scales, strict=True)), x.tolist(), level=False
    )
    assert abs(model.loglikelihood(x, RATE, mean=0.0) - exact) < 1e-8 * abs(exact)


def statsmodels(model, x, mean):
    """The log-likelihood by statsmodels, with unknown levels by its exact diffuse start."""
    space = model.state_space(RATE)
    p, extra = space.states, int(mean is None and not space.diffuse.any())
    F, Q, H = np.eye(p + extra), np.zeros((p + extra,) * 2), np.ones((1, p + extra))
    F[:p, :p], Q[:p, :p], H[:, :p] = space.F, space.Q, space.H
    kalman = KalmanFilter(
        k_endog=1, k_states=p + extra, design=H[:, :, None], transition=F[:, :, None],
        selection=np.eye(p + extra)[:, :, None], state_cov=Q[:, :, None], obs_cov=space.R[:, :, None],
        tolerance=0.0,
    )  # fmt: skip
    start = Initialization(p + extra)
    known = np.flatnonzero(~space.diffuse)
    if known.size:
        # Stationary states come first here, so that they are one block.
        assert np.array_equal(known, np.arange(known.size))
        block = np.ix_(known, known)
        start.set((0, known.size), "known", constant=np.zeros(known.size), stationary_cov=space.P0[block])
    if known.size < p + extra:
        start.set((known.size, p + extra), "diffuse")
    kalman.initialize(start)
    kalman.bind(np.asfortranarray((x - (mean or 0.0))[None, :]))
    kalman.loglikelihood_burn = 0
    return float(kalman.loglike())


@each("gaps", [False, True])
@each("mean", [None, 0.3])
@each(
    "text",
    [
        "GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0)",
        "GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
        "2*GM(beta=[0.5, 20.0], sigma2=[2.0, 0.5]) + WN(sigma2=1.0) + QN(q2=0.5)",
        "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0)",
        "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1.0)",
    ],
)
def test_it_is_that_of_statsmodels(text, mean, gaps):
    model = parsed(text)
    x = record(model, [*range(700, 900), *range(0, 5000, 37)] if gaps else [], samples=5000)
    got, theirs = model.loglikelihood(x, RATE, mean=mean), statsmodels(model, x, mean)
    assert abs(got - theirs) <= 1e-8, (got, theirs)
    assert got == pytest.approx(theirs, rel=1e-11)


@pytest.mark.parametrize("decay", [0.02, 0.3])
def test_it_is_that_of_the_yardstick_of_the_studies(decay):
    model = Model.parse(f"GM(beta={decay * RATE}, sigma2=2.0) + WN(sigma2=1.0)")
    x = model.simulate(3000, RATE, rng=2)
    value, scale = concentrated(x, decay, 2.0)
    best = Model.parse(f"GM(beta={decay * RATE}, sigma2={2 * scale!r}) + WN(sigma2={scale!r})")
    expected = -0.5 * x.size * (value + np.log(2 * np.pi) + 1)
    assert best.loglikelihood(x, RATE, mean=0.0) == pytest.approx(expected, rel=1e-12)


@pytest.mark.slow
@each("interruptions", [0, 29, 4000])
@each(
    "text",
    [
        "WN(sigma2=2.0)",
        "GM(beta=3.0, sigma2=2.0)",
        "MA(2, theta1=0.6, theta2=0.3, sigma2=1.0)",
        "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0)",
        "GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
        "2*GM(beta=[0.5, 20.0], sigma2=[2.0, 0.5]) + WN(sigma2=1.0) + QN(q2=0.5)",
    ],
)
def test_gains_that_are_kept_give_what_those_worked_out_anew_give(text, interruptions):
    model = parsed(text)
    system = assemble(model, RATE)
    x = model.simulate(5000, RATE, rng=3)
    if interruptions:
        x[interruptions - 1 :: interruptions] = np.nan
    series = np.vstack([x, np.ones_like(x)])
    good, count, settled, logs, cross = _core.kalman_innovations(*system.matrices, series, np.empty(0))
    assert good
    assert count == np.count_nonzero(np.isfinite(x))
    assert settled > 1000 or interruptions == 29
    expected_logs, sums = textbook(system, series)
    size = np.sqrt(np.outer(np.diag(sums), np.diag(sums)))
    np.testing.assert_array_less(np.abs(cross.reshape(2, 2) - sums), 1e-11 * size)
    assert abs(logs - expected_logs) < 1e-11 * x.size


def textbook(system, series):
    """Σ log S and Σ v vᵀ/S by the recursion as it is printed, no step left out."""
    F, Q, H, R, P = system.matrices
    a, sums, logs = np.zeros((len(series), H.size)), np.zeros((len(series),) * 2), 0.0
    for values in series.T:
        M = P @ H
        S = H @ M + R
        if np.isfinite(values[0]):
            v = values - a @ H
            sums += np.outer(v, v) / S
            logs += np.log(S)
            a, P = a + np.outer(v, M / S), P - np.outer(M, M) / S
        a, P = a @ F.T, F @ P @ F.T + Q
    return logs, sums


@each("text", [*STATIONARY, *WANDERING])
def test_an_offset_changes_nothing(text):
    model = parsed(text)
    x = 1e-3 * model.simulate(400, RATE, rng=6)
    small = model.with_values(
        {f"{t}.{p.scale_parameter().name}": p.value_from(1e-6 * p.scale) for t, p in zip(model.terms, model.processes,
                                                                                         strict=True)}
    )  # fmt: skip
    here = small.loglikelihood(x, RATE)
    # The samples themselves lose digits on so large a number: 1e-15 of 9.81 over 1e-3.
    assert small.loglikelihood(9.81 + x, RATE) == pytest.approx(here, rel=1e-9)


@each("mean", [None, 0.0])
@each("factor", [1e-9, 1e-3, 1e6])
@each("text", [*STATIONARY, *WANDERING])
def test_another_unit_takes_its_logarithm_off_each_contrast(text, factor, mean):
    model = parsed(text)
    x = model.simulate(300, RATE, rng=7)
    scaled = model.with_values({
        f"{t}.{p.scale_parameter().name}": p.value_from(factor**2 * p.scale)
        for t, p in zip(model.terms, model.processes, strict=True)
    })  # fmt: skip
    contrasts = x.size - (mean is None or "RW" in text)
    expected = model.loglikelihood(x, RATE, mean=mean) - contrasts * np.log(factor)
    assert scaled.loglikelihood(factor * x, RATE, mean=mean) == pytest.approx(expected, rel=1e-10)


@each("missing", MISSING.values())
@each("text", [*STATIONARY, *(t for t in WANDERING if "DR" not in t)])
def test_time_may_run_backwards(text, missing):
    model = parsed(text)
    x = record(model, missing)
    backwards = model.loglikelihood(x[::-1].copy(), RATE)
    assert backwards == pytest.approx(model.loglikelihood(x, RATE), rel=1e-9)


def test_the_order_of_terms_and_missing_samples_at_the_ends_change_nothing():
    one = Model.parse("GM(beta=0.5, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)")
    other = Model.parse("RW(gamma2=1e-3) + WN(sigma2=1.0) + GM(beta=0.5, sigma2=0.5)")
    x = one.simulate(2000, RATE, rng=8)
    here = one.loglikelihood(x, RATE)
    assert other.loglikelihood(x, RATE) == pytest.approx(here, rel=1e-12)
    padded = np.r_[np.full(500, np.nan), x, np.full(700, np.nan)]
    assert one.loglikelihood(padded, RATE) == pytest.approx(here, rel=1e-12)


@pytest.mark.parametrize(
    "text", ["PL(alpha=2.5, nu2=1.0)", "FGN(hurst=0.3, sigma2=1.0)", "MAT(beta=1.0, nu=6.0, sigma2=1.0)"]
)
def test_values_without_a_state_space_are_refused(text):
    with raises(MissingTheoryError, text.partition("(")[0], "state space"):
        Model.parse(text).loglikelihood(np.random.default_rng(1).standard_normal(50), RATE)


def test_the_error_for_a_process_of_a_user_names_the_missing_method():
    class Mine:
        name = "MINE"

        def has(self, theory):
            return theory == "autocovariance"

    with raises(MissingTheoryError, "MINE", "state_space", advises=["Define it"]):
        require_state(Mine())


@pytest.mark.parametrize(("missing", "refused"), [(9_999_000, False), (10_100_000, True)])
def test_gaps_that_need_too_much_memory_are_refused(missing, refused):
    values = np.random.default_rng(1).standard_normal(200)
    signal = Signal(values, RATE, segments=((0, 100), (100, 200)), starts=(0.0, (100 + missing) / RATE))
    if refused:
        with raises(DataError, missing, 200, advises=["signal.longest()"]):
            as_record(signal, None)
    else:
        assert as_record(signal, None).values.size == 200 + missing
