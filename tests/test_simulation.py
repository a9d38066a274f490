import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm import GM, QN, RW, WN, Model, wavelet_variance
from gmwm.errors import ModelError, OptionError
from gmwm.signals import AXES
from gmwm.simulation import models_by_axis, reference_imu, simulate
from gmwm.units import STANDARD_GRAVITY

WHITE = "WN(sigma2=1e-6)"
FIXED = settings(derandomize=True, deadline=None, max_examples=40)


@FIXED
@given(seed=st.integers(0, 2**40), axes=st.sets(st.sampled_from(AXES), min_size=1))
def test_an_axis_is_the_same_path_whatever_is_simulated_with_it(seed, axes):
    whole = simulate(WHITE, rate=100.0, samples=16, seed=seed)
    part = simulate(dict.fromkeys(axes, WHITE), rate=100.0, samples=16, seed=seed)
    assert set(part.axes) == axes
    for axis in axes:
        assert np.array_equal(part[axis].values, whole[axis].values)


@FIXED
@given(rate=st.floats(1e-3, 1e5), duration=st.floats(1e-3, 1e5).filter(lambda x: x > 0), seed=st.integers(0, 2**32))
def test_duration_and_samples_say_the_same(rate, duration, seed):
    n = round(duration * rate)
    if not 8 <= n <= 10_000:
        return
    by_time = simulate(WHITE, rate=rate, duration=duration, seed=seed)
    by_count = simulate(WHITE, rate=rate, samples=n, seed=seed)
    assert len(by_time) == n
    assert by_time.rate == rate
    assert all(np.array_equal(by_time[axis].values, by_count[axis].values) for axis in AXES)


@FIXED
@given(power=st.integers(-40, 40), seed=st.integers(0, 2**32))
def test_the_path_scales_with_its_model(power, seed):
    truth = WN(sigma2=1.0) + RW(gamma2=0.25) + QN(q2=4.0) + GM(beta=1.0, sigma2=9.0)
    scaled = Model(tuple(p.with_values(**{p.scale_parameter().name: p.scale * 4.0**power}) for p in truth.processes))
    one = simulate({"gyro_x": truth}, rate=10.0, samples=64, seed=seed)["gyro_x"].values
    other = simulate({"gyro_x": scaled}, rate=10.0, samples=64, seed=seed)["gyro_x"].values
    assert other == pytest.approx(one * 2.0**power, rel=1e-9, abs=1e-9 * 2.0**power)


def test_axes_and_seeds_are_independent():
    first, second = (simulate(WHITE, rate=100.0, samples=4096, seed=seed) for seed in (1, 2))
    paths = [imu[axis].values - imu[axis].values.mean() for imu in (first, second) for axis in AXES]
    correlation = np.corrcoef(paths)[np.triu_indices(len(paths), 1)]
    assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(4096)


def test_the_paths_have_the_wavelet_variance_of_their_models():
    truth = reference_imu()
    imu = simulate(truth, rate=100.0, samples=2**17, seed=11)
    for axis, model in truth.items():
        wv = wavelet_variance(imu[axis], confidence=1 - 1e-6)
        expected = model.wavelet_variance(wv.levels, 100.0)
        # Long scales have few degrees of freedom, and the chi-square rule is rough there.
        short = wv.degrees_of_freedom > 30
        assert np.all((wv.lower < expected) & (expected < wv.upper) | ~short)


def test_gravity():
    def means(**options):
        imu = simulate(WHITE, rate=100.0, samples=1000, seed=1, **options)
        return {axis: float(np.mean(imu[axis].values)) for axis in AXES}

    for chosen in ("accel_z", "accel_x", None):
        for axis, mean in means(gravity=chosen).items():
            assert mean == pytest.approx(STANDARD_GRAVITY if axis == chosen else 0.0, abs=1e-3)
    assert means() == means(gravity="accel_z")


@pytest.mark.parametrize("step", [1e-5, 0.01, 0.25, 0.3, 7.0])
def test_resolution_rounds_every_sample(step):
    options = {"rate": 100.0, "samples": 500, "seed": 1}
    model = WN(sigma2=100 * step**2)
    exact = simulate({"gyro_x": model, "gyro_y": model}, **options)
    rounded = simulate({"gyro_x": model, "gyro_y": model}, resolution={"gyro_x": step}, **options)
    assert np.array_equal(rounded["gyro_y"].values, exact["gyro_y"].values)
    values = rounded["gyro_x"].values
    assert values / step == pytest.approx(np.rint(values / step), abs=1e-9)
    assert np.max(np.abs(values - exact["gyro_x"].values)) <= step / 2 * (1 + 1e-9)


def test_rounded_to_a_decimal_is_short_in_a_file():
    imu = simulate(WHITE, rate=100.0, samples=500, seed=1, resolution={"gyro": 1e-5})
    assert max(len(repr(value)) for value in imu["gyro_x"].values.tolist()) <= len("-0.01234")


def test_units_notes_and_source_say_what_it_is():
    imu = simulate({"gyro": WHITE, "accel_y": "QN(q2=1e-6)"}, rate=50.0, duration=1, seed=7)
    assert imu.axes == ("gyro_x", "gyro_y", "gyro_z", "accel_y")
    assert (imu["gyro_z"].unit, imu["accel_y"].unit, imu["accel_y"].axis) == ("rad/s", "m/s²", "accel_y")
    assert "accel_y is simulated: QN(q2=1e-06)" in imu.notes
    assert "seed 7" in imu.notes[-1]
    assert "seed 7" in imu.source


def test_models_by_axis():
    assert models_by_axis(WN(sigma2=1.0)) == dict.fromkeys(AXES, Model((WN(sigma2=1.0),)))
    chosen = models_by_axis({"accel_x": "RW(gamma2=1.0)", "accel": WHITE})
    assert list(chosen) == list(AXES[3:])
    assert str(chosen["accel_x"]) == "RW(gamma2=1.0)"


@pytest.mark.parametrize(
    ("arguments", "error", "says"),
    [
        ({"models": {}}, OptionError, "models must map axes"),
        ({"models": {"gyro_w": WHITE}}, OptionError, "gyro_w"),
        ({"models": 3}, OptionError, "models"),
        ({"models": {"gyro_x": "WN"}}, ModelError, "gyro_x: .*WN.sigma2"),
        ({"models": {"gyro_x": "GM(sigma2=1.0) + WN"}}, ModelError, "GM.beta, WN.sigma2"),
        ({"rate": -1.0}, OptionError, "rate"),
        ({"samples": None}, OptionError, "neither"),
        ({"duration": 1.0}, OptionError, "one of them"),
        ({"samples": 7}, OptionError, "at least 8"),
        ({"samples": 10.5}, OptionError, "integer"),
        ({"samples": None, "duration": float("nan")}, OptionError, "duration"),
        ({"samples": None, "duration": 1e-9}, OptionError, "at least 8"),
        ({"seed": -1}, OptionError, "seed"),
        ({"seed": 1.5}, OptionError, "seed"),
        ({"seed": True}, OptionError, "seed"),
        ({"resolution": {"gyro_x": 0.0}}, OptionError, "resolution"),
        ({"resolution": {"gyros": 1.0}}, OptionError, "gyros"),
        ({"gravity": "gyro_x"}, OptionError, "gravity"),
    ],
)
def test_errors(arguments, error, says):
    given_arguments = {"models": WHITE, "rate": 100.0, "samples": 100, "seed": 1, **arguments}
    with pytest.raises(error, match=says):
        simulate(given_arguments.pop("models"), **given_arguments)


def test_the_reference_is_a_whole_unit():
    truth = reference_imu()
    assert tuple(truth) == AXES
    for axis, model in truth.items():
        assert model.is_complete
        assert Model.parse(str(model)) == model
        # Sorted as results are, so that the names of truth and estimate agree.
        assert model.sorted(100.0) == model
        assert any(name.startswith("WN") for name in model.names), axis
