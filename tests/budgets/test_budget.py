"""Error budgets against closed forms, an integration in plain NumPy, and the spread of drawn parameters."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.applications.navigation import Budget, budget
from gmwm.applications.navigation.api import EARTH_RADIUS_M, BudgetAxis, mean_squares, navigation
from gmwm.base.errors import MissingTheoryError, ModelError, OptionError
from gmwm.base.text import round_text
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.theory.processes import Model
from tests.helpers import only, raises

RATE = 100.0
G = 9.80665
DEG = 180 / math.pi


def one(axis, text, duration, rest=0.0):
    return budget({axis: text}, duration, rate=RATE, rest=rest)


# --- closed forms, for times far below the Schuler period ------------------------------------------------


def test_white_noise_of_a_gyroscope():
    n, t = 1e-4, 60.0
    found = one("gyro_y", f"WN(sigma2={n**2 * RATE})", t)
    assert found["tilt_y"].error[-1] == pytest.approx(DEG * n * math.sqrt(t), rel=2e-3)
    assert found["velocity_x"].error[-1] == pytest.approx(G * n * math.sqrt(t**3 / 3), rel=2e-3)
    assert found["position_x"].error[-1] == pytest.approx(G * n * math.sqrt(t**5 / 20), rel=2e-3)
    # At 45° latitude the rotation of the Earth couples the axes, by 0.4 % of an angle in 60 s.
    assert found["north_y"].error[-1] == pytest.approx(
        DEG * n / math.sqrt(t) / (7.292115e-5 * math.cos(math.radians(45))), rel=2e-3
    )


def test_random_walk_of_a_gyroscope_and_of_an_accelerometer():
    k, t = 1e-6, 60.0
    found = one("gyro_x", f"RW(gamma2={k**2 / RATE})", t)
    assert found["tilt_x"].error[-1] == pytest.approx(DEG * k * math.sqrt(t**3 / 3), rel=2e-3)
    assert found["velocity_y"].error[-1] == pytest.approx(G * k * math.sqrt(t**5 / 20), rel=2e-3)
    found = one("accel_z", f"RW(gamma2={k**2 / RATE})", t)
    assert found["velocity_z"].error[-1] == pytest.approx(k * math.sqrt(t**3 / 3), rel=2e-3)
    assert found["position_z"].error[-1] == pytest.approx(k * math.sqrt(t**5 / 20), rel=2e-3)


CONSTANT = "SIN(frequency=1e-9, power=1e-6)"
"""A bias that does not change in hours. The phase of a sinusoid is random, so that it is not known at the start."""


def test_an_unknown_constant_bias():
    t = 60.0
    found = one("accel_x", CONSTANT, t)
    assert found["velocity_x"].error[-1] == pytest.approx(1e-3 * t, rel=1e-3)
    assert found["position_x"].error[-1] == pytest.approx(1e-3 * t**2 / 2, rel=1e-3)
    assert found["level_x"].error[-1] == pytest.approx(DEG * 1e-3 / G, rel=1e-3)


def test_a_rest_removes_a_constant_bias():
    for axis, name in (
        ("gyro_z", "heading"),
        ("gyro_y", "position_x"),
        ("accel_z", "position_z"),
        ("accel_x", "position_x"),
    ):
        before, after = (one(axis, CONSTANT, 60.0, rest=rest)[name].error[-1] for rest in (0.0, 60.0))
        assert after < 0.02 * before, axis


def test_levelling_leaves_the_tilt_of_a_constant_bias():
    found = budget({"gyro_y": "WN(sigma2=1e-20)", "accel_x": CONSTANT}, 10.0, rate=RATE, rest="30s")
    assert found["tilt_y"].error == pytest.approx(np.full(found.times.size, DEG * 1e-3 / G), rel=1e-3)


@pytest.mark.parametrize("rest", [0.0, 60.0])
def test_all_slow_noise_of_one_curve_has_the_same_start(rest):
    k = 1e-4
    texts = (f"RW(gamma2={k**2 / RATE})", f"GM(beta=1e-6, sigma2={k**2 / 2e-6})")
    white = "WN(sigma2=1e-4) + "
    for axis, names in (("accel_x", ("tilt_y", "level_x", "position_x")), ("gyro_y", ("tilt_y", "north_y"))):
        walk, markov = (
            budget({"gyro_y": "WN(sigma2=1e-24)", axis: white + text}, 60.0, rate=RATE, rest=rest) for text in texts
        )
        for name in names:
            if rest or (axis, name) != ("accel_x", "tilt_y"):  # without a rest, the level is known exactly
                assert markov[name].error == pytest.approx(walk[name].error, rel=1e-3), (axis, name)


def test_a_long_rest_is_as_good_as_the_filter_with_n_and_k():
    # The filter forgets what is older than N/K = 10 s, and the mean of a rest does not.
    n, k, t = 1e-3, 1e-4, 60.0
    text = f"WN(sigma2={n**2 * RATE}) + RW(gamma2={k**2 / RATE})"
    short, long = (one("gyro_z", text, t, rest=rest)["heading"].error[-1] for rest in (60.0, 3600.0))
    # The variance of the steady-state filter is N K, and the walk and the white noise of the next t seconds add to it.
    best = DEG * math.sqrt(n * k * t**2 + k**2 * t**3 / 3 + n**2 * t)
    assert long == pytest.approx(best, rel=0.01)
    assert short == pytest.approx(best, rel=0.02)


def test_white_noise_of_a_rest_adds_to_the_angle():
    n, t, rest = 1e-4, 60.0, 30.0
    found = one("gyro_z", f"WN(sigma2={n**2 * RATE})", t, rest=rest)
    assert found["heading"].error[-1] == pytest.approx(DEG * n * math.sqrt(t + t**2 / rest), rel=1e-3)


def test_quantization_noise_stays_an_angle():
    found = one("gyro_z", "QN(q2=1e-8)", 100.0)
    assert np.allclose(found["heading"].error, DEG * 1e-4 * math.sqrt(2) / RATE, rtol=1e-9)


def test_a_drift_and_a_line():
    found = one("gyro_z", "DR(omega=1e-9)", 100.0)
    assert found["heading"].error[-1] == pytest.approx(DEG * 1e-9 * RATE * 100.0**2 / 2, rel=1e-3)
    found = one("gyro_z", "SIN(frequency=0.1, power=1e-8)", 5.0)
    # Half a turn of a random phase: ∫ = A/(πf) cos(phase), A²/2 = power.
    assert found["heading"].error[-1] == pytest.approx(DEG * 1e-4 / (math.pi * 0.1), rel=1e-3)


def test_the_schuler_oscillation_bounds_a_constant_accelerometer_bias():
    half = math.pi * math.sqrt(EARTH_RADIUS_M / G)
    found = budget({"accel_x": CONSTANT}, half, rate=1.0, rest=0.0)["position_x"]
    # p = (b/ω²)(1 − cos ωt): twice b R/g after half a period of 84 minutes, nearly half of a parabola at its quarter.
    assert found.error[-1] == pytest.approx(2 * 1e-3 * EARTH_RADIUS_M / G, rel=0.02)


def test_flicker_noise_starts_at_zero_or_is_old():
    b2 = 1e-10
    heading = one("gyro_z", f"FN(b2={b2})", 1000.0)["heading"]
    rates = heading.error / heading.times / DEG
    # Independent Gauss-Markov processes that start at zero have ∫∫ min(s, t) … = B² t² (4 ln 2)/(2π): σ = 0.664 B t.
    assert rates == pytest.approx(np.full(rates.size, 0.664 * math.sqrt(b2)), rel=0.01)
    # After a rest of the same length: the difference of two adjacent means, whose variance is twice the Allan variance.
    motion = navigation("gyro_z", G, math.radians(45))
    (square,) = mean_squares(gmwm.FN(b2=b2), RATE, motion, [6000], rest=6000)[:, 2]
    allan = 2 * math.log(2) / math.pi * b2
    assert square == pytest.approx(60.0**2 * 2 * allan, rel=0.02)


def test_the_label_of_slow_noise_does_not_change_the_budget():
    # Gauss-Markov processes with a variance of B² ln r/π each, at correlation times of the ratio r, are flicker noise.
    b2, ratio = 1e-10, 4.0
    variance = b2 * math.log(ratio) / math.pi
    ladder = " + ".join(f"GM(beta={ratio**-k}, sigma2={variance})" for k in range(-3, 9))
    texts = (f"FN(b2={b2})", ladder)
    flicker, markov = (budget({"gyro_z": text}, 60.0, rate=RATE)["heading"].error[-1] for text in texts)
    assert markov == pytest.approx(flicker, rel=0.02)
    flicker, markov = (budget({"gyro_z": text}, 60.0, rate=RATE, rest=0.0)["heading"].error[-1] for text in texts)
    assert markov == pytest.approx(flicker, rel=0.02)


# --- an integration in plain NumPy ----------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("rest", [0, 20])
def test_simulated_channels_have_the_errors_of_the_budget(rest):
    rate, runs, seconds = 20.0, 1500, 60
    rng = np.random.default_rng(7)
    gyro = markov(rng, 0.05, 1e-8 if rest else 0.0, rate, runs, (seconds + rest) * 20)
    if not rest:  # all slow noise is zero at the start
        decay = math.exp(-0.05 / rate)
        for k in range(1, gyro.shape[1]):
            gyro[:, k] = decay * gyro[:, k - 1] + math.sqrt(1e-8 * (1 - decay**2)) * rng.standard_normal(runs)
    gyro += 1e-4 * rng.standard_normal(gyro.shape)
    accel = np.cumsum(1e-5 * rng.standard_normal(gyro.shape), axis=1) + 1e-2 * rng.standard_normal(gyro.shape)
    noise = {"gyro_y": "GM(beta=0.05, sigma2=1e-8) + WN(sigma2=1e-8)", "accel_x": "RW(gamma2=1e-10) + WN(sigma2=1e-4)"}
    bias = bias_of_filter(gyro[:, : rest * 20], noise["gyro_y"], rate)
    theta = -bias_of_filter(accel[:, : rest * 20], noise["accel_x"], rate) / G
    v, p = np.zeros(runs), np.zeros(runs)
    for k in range(rest * 20, gyro.shape[1]):
        middle = theta + (gyro[:, k] - bias - v / EARTH_RADIUS_M) / rate / 2
        rise = G * np.sin(middle) + accel[:, k] * np.cos(middle)
        theta += (gyro[:, k] - bias - v / EARTH_RADIUS_M) / rate
        p += v / rate + rise / rate**2 / 2
        v += rise / rate
    found = budget(noise, float(seconds), rate=rate, rest=float(rest))
    for name, values in (("tilt_y", DEG * theta), ("velocity_x", v), ("position_x", p)):
        # The relative standard error of a root mean square is 1/√(2 runs) = 1.8 %.
        assert found[name].error[-1] == pytest.approx(np.sqrt(np.mean(values**2)), rel=4 / math.sqrt(2 * runs)), name


def bias_of_filter(rest, model, rate):
    """The estimate of a Kalman filter of white noise and a random walk, with the N and K of a model, from (runs, n)."""
    numbers = filter_numbers(Model.parse(model).processes, rate)
    white, walk = numbers.N**2 * rate, numbers.K**2 / rate
    bias, variance = np.zeros(len(rest)), math.inf
    for sample in rest.T:
        gain = 1.0 if math.isinf(variance) else variance / (variance + white)
        bias, variance = bias + gain * (sample - bias), gain * white + walk
    return bias


def markov(rng, beta, sigma2, rate, runs, samples):
    decay = math.exp(-beta / rate)
    out = np.empty((runs, samples))
    out[:, 0] = math.sqrt(sigma2) * rng.standard_normal(runs)
    for k in range(1, samples):
        out[:, k] = decay * out[:, k - 1] + math.sqrt(sigma2 * (1 - decay**2)) * rng.standard_normal(runs)
    return out


# --- terms and intervals --------------------------------------------------------------------------------


def test_terms_add_up_by_squares():
    found = budget(
        {"gyro_x": "WN(sigma2=1e-6) + GM(beta=0.1, sigma2=1e-9)", "accel_y": "WN(sigma2=1e-4)"}, 30.0, rate=RATE
    )
    for growth in found.growths.values():
        assert np.sqrt(sum(part**2 for part in growth.terms.values())) == pytest.approx(growth.error, rel=1e-9)
        assert growth.certain
    assert set(found["position_y"].terms) == {"gyro_x WN", "gyro_x GM", "accel_y WN"}


@pytest.fixture(scope="module")
def fits():
    rng = np.random.default_rng(5)
    x = 1e-3 * rng.standard_normal(60_000) + markov(rng, 0.5, 1e-8, RATE, 1, 60_000)[0]
    return {"gyro_x": gmwm.fit("WN + GM", gmwm.Signal(x, RATE, "rad/s", "gyro_x"))}


@pytest.mark.slow
def test_intervals_are_those_of_drawn_parameters(fits):
    fit = fits["gyro_x"]
    found = budget(fits, 60.0, level=0.9)["tilt_x"]
    rng = np.random.default_rng(1)
    names = list(fit.standard_errors)
    theta = np.array([fit.parameters[name] for name in names])
    relative = fit.covariance / np.outer(theta, theta)
    drawn = theta * np.exp(rng.multivariate_normal(np.zeros(len(names)), relative, 200))
    motion, gain = navigation("gyro_x", G, math.radians(45)), BudgetAxis.of("gyro_x", fit, None).gain
    errors = []
    for values in drawn:
        model = fit.model.with_values(dict(zip(names, map(float, values), strict=True)))
        errors.append(
            math.sqrt(sum(mean_squares(p, RATE, motion, [6000], rest=6000, gain=gain)[0, 0] for p in model.processes))
        )
    spread = np.std(np.log(errors))
    width = math.log(found.high[-1] / found.low[-1]) / (2 * 1.6448536)
    # The standard error of a standard deviation of 200 draws is 5 %.
    assert width == pytest.approx(spread, rel=0.2)
    assert found.low[-1] < found.error[-1] < found.high[-1]


def test_a_fit_and_a_calibration_have_budgets(fits):
    fit = fits["gyro_x"]
    found = fit.budget("60s")
    assert isinstance(found, Budget)
    assert found["tilt_x"].error == pytest.approx(budget(fits, 60.0)["tilt_x"].error)
    assert only(found.remarks, "budget-axes-missing").facts["axes"][0] == "gyro_y"
    long = fit.budget("1h")
    assert only(long.remarks, "budget-extrapolated").subject == "gyro_x"
    text = found.summary()
    assert "After 60 s" in text
    assert "95 % interval" in text
    assert "gyro_x GM" in text
    for shown in (text, budget(fits, 36e3).summary(), found.compare(found, ("the unit of Monday", "the other unit"))):
        assert max(map(len, shown.splitlines())) <= 80


def test_documents_frames_and_comparisons(fits):
    found, other = budget(fits, 60.0), budget({"gyro_x": "WN(sigma2=1e-6)"}, 60.0, rate=RATE)
    content = json.loads(json.dumps(found.to_dict()))
    assert content["growth"]["tilt_x"]["unit"] == "deg"
    assert content["growth"]["tilt_x"]["error"] == found["tilt_x"].error.tolist()
    assert found.to_polars().height == found.times.size * len(found)
    text = found.compare(other, ("unit", "datasheet"))
    assert "tilt about x" in text
    assert f"{other['tilt_x'].error[-1] / found['tilt_x'].error[-1]:.2f}" in text
    with raises(OptionError, argument="other"):
        found.compare(budget({"gyro_x": "WN(sigma2=1e-6)"}, 30.0, rate=RATE))
    with raises(OptionError, argument="other"):
        found.compare(budget({"gyro_z": "WN(sigma2=1e-6)"}, 60.0, rate=RATE))


def test_an_upper_limit_is_stated_everywhere_in_the_same_way(fits):
    found = budget(fits, 60.0)
    tilt = found["tilt_x"]
    limit = replace(tilt, low=np.zeros_like(tilt.low), high=4 * tilt.error)
    limited = replace(found, growths={"tilt_x": limit})
    text = f"≤ {round_text(4 * float(tilt.error[-1]), 3)}"
    after, *_, growth = (line for line in limited.summary().splitlines() if text in line)
    assert f"tilt {text} deg" in after
    assert growth.split()[2:4] == text.split()
    assert limited.summary().count(text) == 3
    assert limit.to_dict()["upper_only"][-1]
    frame = limited.to_polars()
    assert (frame["upper_only"] == (frame["error"] == "tilt_x")).all()
    assert not any(found["tilt_x"].to_dict()["upper_only"])


@pytest.mark.parametrize(
    ("noise", "options", "error", "argument"),
    [
        ({}, {}, OptionError, "noise"),
        ({"gyro": "WN(sigma2=1)"}, {}, OptionError, "axis"),
        ({"gyro_x": "WN(sigma2=1)"}, {"rate": None}, OptionError, "rate"),
        ({"gyro_x": "WN(sigma2=1)"}, {"duration": "soon"}, OptionError, "duration"),
        ({"gyro_x": "WN(sigma2=1)"}, {"duration": -1.0}, OptionError, "duration"),
        ({"gyro_x": "WN(sigma2=1)"}, {"duration": 1e-3}, OptionError, "duration"),
        ({"gyro_x": "WN(sigma2=1)"}, {"rest": -1.0}, OptionError, "rest"),
        ({"gyro_x": "WN(sigma2=1)"}, {"latitude": 90.0}, OptionError, "latitude"),
        ({"gyro_x": "WN(sigma2=1)"}, {"gravity": 0.0}, OptionError, "gravity"),
        ({"gyro_x": "WN(sigma2=1)"}, {"level": 1.0}, OptionError, "level"),
    ],
)
def test_bad_input_is_named(noise, options, error, argument):
    given = {"duration": 60.0, "rate": RATE, **options}
    with raises(error, argument=argument):
        budget(noise, given.pop("duration"), **given)


def test_models_without_values_or_states_are_refused():
    with raises(ModelError, "WN.sigma2"):
        budget({"gyro_x": "WN"}, 60.0, rate=RATE)
    with raises(MissingTheoryError, "gyro_x", "PL"):
        budget({"gyro_x": Model.parse("PL(alpha=2.5, nu2=1.0)")}, 60.0, rate=RATE)


def test_short_durations_have_times_of_whole_samples():
    found = one("gyro_x", "WN(sigma2=1e-6)", 0.02)
    assert found.times[-1] == 0.02
    assert found.times[0] >= 0.01
    assert one("gyro_x", "WN(sigma2=1e-6)", 0.01).times.tolist() == [0.01]
