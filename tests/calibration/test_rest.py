"""The bias at rest: its error from the model, gravity, the spread between recordings, and its rms."""

import math
from dataclasses import replace
from statistics import NormalDist

import numpy as np
import pytest

import gmwm
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.rest import BiasAtRest, gravity_of, reach_of
from gmwm.choosing.datasheets.bias_changes import BiasTerms, Variance
from gmwm.theory.processes import Model
from tests.helpers import raises

RATE = 100.0


def exact_fit(text, samples=100_000):
    """A fit of a model to its own simulation, with the parameters of the simulation."""
    model = Model.parse(text)
    signal = gmwm.Signal(model.simulate(samples, RATE, rng=1), RATE, "rad/s")
    fit = gmwm.fit(model.structure, signal, certify=False)
    return replace(fit, model=model.sorted(RATE), parameters=dict(model.sorted(RATE).parameters))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("WN(sigma2=4e-6)", lambda n: 4e-6 / n),
        # The sum of n values of a walk that starts at zero has the variance γ² Σ k² over k < n.
        ("WN(sigma2=4e-6) + RW(gamma2=4e-10)", lambda n: 4e-6 / n + 4e-10 * (n - 1) * (2 * n - 1) / (6 * n)),
        (
            "GM(beta=1.0, sigma2=4e-6) + WN(sigma2=4e-6)",
            lambda n: 4e-6 / n + 4e-6 / n**2 * sum((n - abs(k)) * math.exp(-abs(k) / RATE) for k in range(-n + 1, n)),
        ),
    ],
)
def test_the_variance_of_the_mean_is_that_of_the_model(text, wanted):
    n = 5000
    found = BiasTerms.of(exact_fit(text)).variance_of_mean(n, n)
    # The mean of the truncated normal distribution adds a share that is small for terms that are seen well.
    assert wanted(n) <= found.value * (1 + 1e-9)
    assert found.value == pytest.approx(wanted(n), rel=0.02)
    assert 0 < found.relative < 0.5


def test_a_gap_makes_no_term_more_precise():
    fit = exact_fit("WN(sigma2=4e-6) + RW(gamma2=4e-10)")
    whole, gaps = BiasTerms.of(fit).variance_of_mean(5000, 5000), BiasTerms.of(fit).variance_of_mean(5000, 10_000)
    assert gaps.value > 1.5 * whole.value


@pytest.mark.slow
def test_the_mean_square_of_the_bias_is_that_of_simulated_walks():
    fit = exact_fit("WN(sigma2=4e-6) + RW(gamma2=4e-10)")
    walks = np.cumsum(np.random.default_rng(1).normal(0, 2e-5, (2000, 3000)), axis=1)
    wanted = np.mean(np.var(walks, axis=1))
    found = BiasTerms.of(fit).variance_over(30.0)
    error = np.std(np.var(walks, axis=1)) / math.sqrt(len(walks))
    assert abs(found.value - wanted) < 4 * error + 0.02 * wanted
    assert BiasTerms.of(exact_fit("WN(sigma2=4e-6)")).variance_over(30.0).value == 0
    # A term with a correlation time below a second is noise.
    assert BiasTerms.of(exact_fit("GM(beta=20.0, sigma2=4e-6) + WN(sigma2=4e-6)")).variance_over(30.0).value == 0


def test_an_estimated_variance_has_the_quantile_of_student():
    def reach(one):
        return reach_of([(0.5, one)], 0.95)

    assert reach(Variance(4.0, 0.0)) == pytest.approx(2 * 1.959964, rel=1e-6)
    assert reach(Variance(4.0, math.sqrt(2 / 5))) == pytest.approx(2 * 2.570582, rel=1e-6)
    assert reach(Variance(4.0, 1e6)) == pytest.approx(2 * 12.7062, rel=1e-5)


def test_tail_areas_of_models_are_averaged():
    near, far = Variance(1.0, 0.0), Variance(100.0, 0.0)
    found = reach_of([(3.0, near), (1.0, far)], 0.95)
    outside = [2 * (1 - NormalDist().cdf(found / math.sqrt(one.value))) for one in (near, far)]
    assert 0.75 * outside[0] + 0.25 * outside[1] == pytest.approx(0.05, rel=1e-6)


# --- gravity ------------------------------------------------------------------------------------------

UPRIGHT = {"gyro_x": 0.01, "accel_x": 0.10, "accel_y": -0.05, "accel_z": -9.85}


def test_the_bias_of_the_upright_axis_needs_no_attitude():
    found = gravity_of(UPRIGHT, CalibrationOptions(gravity=9.81))
    assert found["gyro_x"] == (0.0, 0.0)
    assert found["accel_x"] is None
    assert found["accel_y"] is None
    gravity, error = found["accel_z"]
    assert gravity == pytest.approx(-math.sqrt(9.81**2 - 0.1**2 - 0.05**2))
    # Biases of 0.2 m/s² of the level axes change the gravity along the upright axis by this little.
    for bias in (-0.2, 0.2):
        moved = gravity_of(UPRIGHT | {"accel_x": 0.10 + bias}, CalibrationOptions(gravity=9.81))["accel_z"]
        assert abs(moved[0] - gravity) < 1.5 * error
    assert error < 0.01


@pytest.mark.parametrize(("angle", "known"), [(15.0, True), (25.0, False)])
def test_the_bias_of_a_tilted_unit_is_known_up_to_20_degrees(angle, known):
    level, upright = (9.81 * f(math.radians(angle)) for f in (math.sin, math.cos))
    found = gravity_of({"accel_x": level, "accel_y": 0.0, "accel_z": upright}, CalibrationOptions(gravity=9.81))
    assert (found["accel_z"] is not None) is known


def test_an_unknown_gravity_is_the_range_on_earth():
    gravity, error = gravity_of(UPRIGHT, CalibrationOptions())["accel_z"]
    assert abs(gravity) == pytest.approx(9.806, abs=1e-3)
    assert error == pytest.approx(0.016, abs=2e-3)


def test_a_known_tilt_gives_every_axis():
    found = gravity_of(UPRIGHT, CalibrationOptions(gravity=9.81, tilt=0.1))
    assert found["accel_x"] == (0.0, pytest.approx(9.81 * math.radians(0.1) / math.sqrt(3)))
    assert found["accel_z"][0] == -9.81
    assert found["accel_z"][1] < 1e-4


@pytest.mark.parametrize(
    "means",
    [
        {"accel_x": 7.0, "accel_y": 0.0, "accel_z": 7.0},
        {"accel_x": 4.0, "accel_y": 0.0, "accel_z": 8.9},
        {"accel_x": 0.0, "accel_y": 0.0, "accel_z": 0.0},
        {"accel_z": 9.8},
    ],
)
def test_an_attitude_that_is_not_known_well_enough_gives_no_bias(means):
    assert set(gravity_of(means, CalibrationOptions()).values()) == {None}


@pytest.mark.parametrize(("argument", "value"), [("gravity", 1.0), ("gravity", True), ("tilt", -1.0), ("tilt", "x")])
def test_options_are_checked(argument, value):
    with raises(gmwm.errors.OptionError, argument=argument, got=value):
        CalibrationOptions(**{argument: value})


# --- calibrations ------------------------------------------------------------------------------------


def unit(seed, bias=0.0, samples=30_000):
    rng = np.random.default_rng(seed)
    arrays = {
        "gyro_x": bias + rng.normal(0, 1e-3, samples),
        "accel_x": 0.05 + rng.normal(0, 5e-3, samples),
        "accel_y": -0.02 + rng.normal(0, 5e-3, samples),
        "accel_z": 9.83 + rng.normal(0, 5e-3, samples),
    }
    return gmwm.Imu.from_arrays(arrays, rate=RATE)


@pytest.mark.slow
def test_a_calibration_has_the_bias_and_keeps_it(tmp_path):
    imu = unit(1, bias=0.02)
    found = gmwm.calibrate(imu, "WN + RW", gravity=9.81, axes=["gyro_x", "accel_x", "accel_z"])
    gyro, level, upright = (found.rest[axis] for axis in ("gyro_x", "accel_x", "accel_z"))
    assert gyro.low < 0.02 < gyro.high
    assert 5e-6 < gyro.error < 2e-5
    assert level.bias is None
    assert upright.bias == pytest.approx(9.83 - math.sqrt(9.81**2 - 0.05**2 - 0.02**2), abs=1e-3)
    assert next(entry.symbol for entry in level.entries) == "mean"
    found.save(tmp_path / "calibration.json")
    again = gmwm.Calibration.load(tmp_path / "calibration.json")
    assert again.rest == found.rest
    assert again.settings.gravity == 9.81
    text = found.summary(details=True)
    assert "bias (deg/h)" in text
    assert "tilt unknown" in text
    levelled = gmwm.calibrate(imu, "WN + RW", tilt=0.1, axes="accel_x").rest["accel_x"]
    assert levelled.bias == pytest.approx(0.05, abs=1e-3)
    assert levelled.bias_error == pytest.approx(9.806 * math.radians(0.1) / math.sqrt(3), rel=0.01)


@pytest.mark.slow
def test_a_knock_does_not_move_the_bias():
    imu = unit(2)
    values = {axis: imu[axis].values.copy() for axis in imu.axes}
    values["gyro_x"][10_000:10_050] += 1.0
    plain, knocked = (
        gmwm.calibrate(one, "WN + RW", axes="gyro_x").rest["gyro_x"]
        for one in (imu, gmwm.Imu.from_arrays(values, rate=RATE))
    )
    assert np.mean(values["gyro_x"]) > 1e-3
    assert abs(knocked.mean - plain.mean) < plain.error


@pytest.mark.slow
def test_several_recordings_have_a_turn_on_spread():
    biases = np.random.default_rng(4).normal(0, 1e-3, 5)
    found = gmwm.calibrate([unit(10 + k, bias) for k, bias in enumerate(biases)], "WN + RW", axes="gyro_x")
    rest = found.rest["gyro_x"]
    assert rest.recordings == 5
    assert rest.turn_on == pytest.approx(np.std(biases, ddof=1), rel=0.05)
    assert rest.turn_on_low < 1e-3 < rest.turn_on_high
    assert rest.low < np.mean(biases) < rest.high
    assert rest.error == pytest.approx(np.std(biases, ddof=1) / math.sqrt(5), rel=0.05)
    assert "turn-on (deg/h)" in found.summary(details=True)


def test_the_document_has_the_bias_without_gravity():
    one = BiasAtRest(
        mean=9.83, error=1e-3, low=9.828, high=9.832, gravity=9.806, gravity_error=0.016, recordings=1, rms=0.0,
        rms_low=0.0, rms_high=0.0, duration=60.0, level=0.95, unit="m/s²",
    )  # fmt: skip
    content = one.to_dict()
    assert content["bias"] == pytest.approx(0.024)
    assert content["bias_error"] == pytest.approx(math.hypot(1e-3, 0.016))
    assert BiasAtRest.from_dict(content) == one
    low, high = one.interval
    assert high - 0.024 == pytest.approx(math.hypot(0.002, 1.96 * 0.016), rel=1e-3)
    assert 0.024 - low == pytest.approx(high - 0.024)
