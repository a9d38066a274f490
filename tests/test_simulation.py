import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm import GM, QN, RW, WN, Model, wavelet_variance
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.units import AXES, STANDARD_GRAVITY
from gmwm.files.readers import read
from gmwm.theory.simulation import models_by_axis, reference_imu, simulate, simulate_signal
from tests.helpers import each, only, raises

WHITE = "WN(sigma2=1e-6)"
FIXED = settings(derandomize=True, deadline=None, max_examples=40)


@FIXED
@given(seed=st.integers(0, 2**40), axes=st.sets(st.sampled_from(AXES), min_size=1))
def test_an_axis_is_the_same_path_whatever_is_simulated_with_it(seed, axes):
    whole = simulate(WHITE, rate=100.0, samples=16, rng=seed)
    part = simulate(dict.fromkeys(axes, WHITE), rate=100.0, samples=16, rng=seed)
    assert set(part.axes) == axes
    for axis in axes:
        assert np.array_equal(part[axis].values, whole[axis].values)


@FIXED
@given(rate=st.floats(1e-3, 1e5), duration=st.floats(1e-3, 1e5).filter(lambda x: x > 0), seed=st.integers(0, 2**32))
def test_duration_and_samples_say_the_same(rate, duration, seed):
    n = round(duration * rate)
    if not 8 <= n <= 10_000:
        return
    by_time = simulate(WHITE, rate=rate, duration=duration, rng=seed)
    by_count = simulate(WHITE, rate=rate, samples=n, rng=seed)
    assert len(by_time) == n
    assert by_time.rate == rate
    assert all(np.array_equal(by_time[axis].values, by_count[axis].values) for axis in AXES)


@FIXED
@given(power=st.integers(-40, 30), seed=st.integers(0, 2**32))
def test_the_path_scales_with_its_model(power, seed):
    truth = WN(sigma2=1.0) + RW(gamma2=0.25) + QN(q2=4.0) + GM(beta=1.0, sigma2=9.0)
    scaled = Model(tuple(p.with_values(**{p.scale_parameter().name: p.scale * 4.0**power}) for p in truth.processes))
    one = simulate({"gyro_x": truth}, rate=10.0, samples=64, rng=seed)["gyro_x"].values
    other = simulate({"gyro_x": scaled}, rate=10.0, samples=64, rng=seed)["gyro_x"].values
    assert other == pytest.approx(one * 2.0**power, rel=1e-9, abs=1e-9 * 2.0**power)


def test_axes_and_seeds_are_independent():
    first, second = (simulate(WHITE, rate=100.0, samples=4096, rng=seed) for seed in (1, 2))
    paths = [imu[axis].values - imu[axis].values.mean() for imu in (first, second) for axis in AXES]
    correlation = np.corrcoef(paths)[np.triu_indices(len(paths), 1)]
    assert np.max(np.abs(correlation)) < 4.5 / np.sqrt(4096)


def test_an_integer_gives_the_same_samples_in_every_version():
    imu = simulate({"gyro_y": WHITE}, rate=100.0, samples=100, rng=1)
    stream = np.random.SeedSequence(1).spawn(6)[1]
    np.testing.assert_array_equal(imu["gyro_y"].values, Model.parse(WHITE).simulate(100, 100.0, stream))
    signal = simulate_signal(WHITE, rate=100.0, samples=100, rng=1).signal
    np.testing.assert_array_equal(signal.values, Model.parse(WHITE).simulate(100, 100.0, 1))


def test_a_generator_may_draw():
    one, other = (simulate(WHITE, rate=100.0, samples=100, rng=np.random.default_rng(4)) for _ in range(2))
    assert all(np.array_equal(one[axis].values, other[axis].values) for axis in one)
    seed = int(one.source.rpartition(" ")[2])
    again = simulate(WHITE, rate=100.0, samples=100, rng=seed)
    assert all(np.array_equal(one[axis].values, again[axis].values) for axis in one)
    generator = np.random.default_rng(4)
    first, second = (simulate_signal(WHITE, rate=100.0, samples=100, rng=generator).signal for _ in range(2))
    np.testing.assert_array_equal(first.values, simulate_signal(WHITE, rate=100.0, samples=100, rng=4).signal.values)
    assert not np.any(first.values == second.values)


def test_the_paths_have_the_wavelet_variance_of_their_models():
    truth = reference_imu()
    imu = simulate(truth, rate=100.0, samples=2**17, rng=11)
    for axis, model in truth.items():
        wv = wavelet_variance(imu[axis], confidence=1 - 1e-6)
        expected = model.wavelet_variance(wv.levels, 100.0)
        # Long scales have few degrees of freedom, and the chi-square rule is rough there.
        short = wv.degrees_of_freedom > 30
        assert np.all((wv.lower < expected) & (expected < wv.upper) | ~short)


def test_gravity():
    def means(**options):
        imu = simulate(WHITE, rate=100.0, samples=1000, rng=1, **options)
        return {axis: float(np.mean(imu[axis].values)) for axis in AXES}

    for chosen in ("accel_z", "accel_x", None):
        for axis, mean in means(gravity=chosen).items():
            assert mean == pytest.approx(STANDARD_GRAVITY if axis == chosen else 0.0, abs=1e-3)
    assert means() == means(gravity="accel_z")


@pytest.mark.parametrize("step", [1e-5, 0.01, 0.25, 0.3, 7.0])
def test_resolution_rounds_every_sample(step):
    options = {"rate": 100.0, "samples": 500, "rng": 1}
    model = WN(sigma2=100 * step**2)
    exact = simulate({"gyro_x": model, "gyro_y": model}, **options)
    rounded = simulate({"gyro_x": model, "gyro_y": model}, resolution={"gyro_x": step}, **options)
    assert np.array_equal(rounded["gyro_y"].values, exact["gyro_y"].values)
    values = rounded["gyro_x"].values
    assert values / step == pytest.approx(np.rint(values / step), abs=1e-9)
    assert np.max(np.abs(values - exact["gyro_x"].values)) <= step / 2 * (1 + 1e-9)


def test_rounded_to_a_decimal_is_short_in_a_file():
    imu = simulate(WHITE, rate=100.0, samples=500, rng=1, resolution={"gyro": 1e-5})
    assert max(len(repr(value)) for value in imu["gyro_x"].values.tolist()) <= len("-0.01234")


def test_units_remarks_and_source_say_what_it_is():
    imu = simulate({"gyro": WHITE, "accel_y": "QN(q2=1e-6)"}, rate=50.0, duration=1, rng=7)
    assert imu.axes == ("gyro_x", "gyro_y", "gyro_z", "accel_y")
    assert (imu["gyro_z"].unit, imu["accel_y"].unit, imu["accel_y"].axis) == ("rad/s", "m/s²", "accel_y")
    assert only(imu.remarks, "file-content:simulated", "accel_y").facts == {
        "case": "simulated",
        "model": "QN(q2=1e-06)",
        "seed": 7,
    }
    assert "seed 7" in imu.source


# --- latent processes -------------------------------------------------------------------------------


@FIXED
@given(
    seed=st.integers(0, 2**40),
    order=st.permutations(["WN(sigma2=2)", "GM(beta=1, sigma2=9)", "GM(beta=0.1, sigma2=1)"]),
)
def test_latent_processes_add_up_to_the_last_bit(seed, order):
    model = Model.parse(" + ".join(order))
    made = simulate_signal(model, rate=10.0, samples=64, rng=seed)
    assert np.array_equal(sum(made[term].values for term in made), made.signal.values)
    assert np.array_equal(made.signal.values, model.simulate(64, 10.0, seed))
    drawn = model.simulate_terms(64, 10.0, seed)
    assert set(made.components) == set(model.terms)
    assert all(np.array_equal(made[term].values, drawn[term]) for term in model.terms)


@pytest.mark.parametrize("gravity", ["accel_z", None])
def test_a_recording_is_the_same_with_its_latent_processes(gravity):
    options = {"rate": 100.0, "samples": 200, "rng": 8, "gravity": gravity, "resolution": {"accel_x": 0.01}}
    alone = simulate(reference_imu(), **options)
    made = simulate(reference_imu(), **options, components=True)
    assert made.imu.remarks == alone.remarks
    assert tuple(made) == AXES
    for axis, one in made.axes.items():
        assert np.array_equal(made.imu[axis].values, alone[axis].values)
        assert np.array_equal(one.signal.values, alone[axis].values)
        assert one.offset == (STANDARD_GRAVITY if axis == gravity else 0.0)
        total = one.offset + sum(path.values for path in made.components[axis].values())
        if axis == "accel_x":
            assert one.resolution == 0.01
            assert np.max(np.abs(total - one.signal.values)) <= 0.005 * (1 + 1e-9)
        else:
            assert np.array_equal(total, one.signal.values)


def test_latent_processes_are_signals_with_the_variance_of_their_terms():
    made = simulate(
        {"gyro_x": "2*GM(beta=0.5, sigma2=4e-7) + WN(sigma2=1e-6)"}, rate=100.0, samples=2**16, rng=3, components=True
    )
    one = made["gyro_x"]
    assert (one["WN"].unit, one["WN"].axis, one["WN"].rate) == ("rad/s", "gyro_x WN", 100.0)
    for term, expected in one.model.decomposition(8, 100.0).items():
        wv = wavelet_variance(one[term], levels=8, confidence=1 - 1e-6)
        assert np.all((wv.lower < expected) & (expected < wv.upper))


def test_what_was_simulated_can_be_pickled_and_says_what_it_is():
    made = simulate({"gyro_x": WHITE}, rate=100.0, samples=50, rng=3, components=True)
    again = pickle.loads(pickle.dumps(made))
    assert repr(again) == repr(made)
    assert repr(made).endswith("; gyro_x = WN)")
    assert np.array_equal(again["gyro_x"]["WN"].values, made["gyro_x"]["WN"].values)
    with raises(DataError, argument="axis", expected="one of gyro_x", got="gyro_y"):
        made["gyro_y"]
    with raises(DataError, argument="term", expected="one of WN", got="RW"):
        made["gyro_x"]["RW"]
    with pytest.raises(TypeError):
        made.axes["gyro_x"] = None


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_latent_processes_come_back_from_a_file_to_the_last_bit(tmp_path, suffix):
    made = simulate(reference_imu(), rate=100.0, samples=100, rng=5, components=True)
    path = tmp_path / f"parts{suffix}"
    columns = made.write_components(path)
    assert len(columns) == sum(len(model.terms) for model in reference_imu().values())
    for axis, term in (("gyro_z", "GM[2]"), ("accel_z", "QN")):
        column = f"{axis} {term} [{made.imu[axis].unit}]"
        assert column in columns
        assert np.array_equal(read(path, columns={axis: column})[axis].values, made[axis][term].values)


def test_a_plain_signal_has_plain_columns(tmp_path):
    made = simulate_signal("AR1(phi=0.9, sigma2=1) + WN(sigma2=1)", rate=1.0, samples=10, rng=1)
    assert made.write_components(tmp_path / "parts.csv") == ("AR1", "WN")
    with raises(OptionError, ".csv", ".parquet", argument="path", got=str(tmp_path / "parts.txt")):
        made.write_components(tmp_path / "parts.txt")
    assert [path.name for path in tmp_path.iterdir()] == ["parts.csv"]


def test_a_signal_is_rounded_and_its_parts_are_not():
    exact, rounded = (simulate_signal(WN(sigma2=1.0), rate=1.0, samples=50, rng=1, resolution=r) for r in (None, 0.5))
    assert np.array_equal(rounded.signal.values, np.rint(exact.signal.values * 2) / 2)
    assert np.array_equal(rounded["WN"].values, exact["WN"].values)
    assert (exact.resolution, rounded.resolution) == (None, 0.5)


@pytest.mark.parametrize(
    ("arguments", "error", "facts"),
    [
        ({"model": "WN"}, ModelError, {"subject": "", "example": "WN(sigma2=…)"}),
        ({"rate": 0.0}, OptionError, {"argument": "rate", "got": 0.0}),
        ({"samples": None}, OptionError, {"argument": "duration", "got": None}),
        ({"rng": -1}, OptionError, {"argument": "rng", "got": -1}),
        ({"resolution": -1.0}, OptionError, {"argument": "resolution", "got": -1.0, "subject": ""}),
    ],
)
def test_errors_of_a_signal(arguments, error, facts):
    given_arguments = {"model": WHITE, "rate": 100.0, "samples": 100, "rng": 1, **arguments}
    with raises(error, **facts):
        simulate_signal(given_arguments.pop("model"), **given_arguments)


def test_an_unknown_process_is_named():
    with raises(ModelError, "VN"):
        simulate_signal("WN(sigma2=1) + VN", rate=100.0, samples=100, rng=1)


def test_models_by_axis():
    assert models_by_axis(WN(sigma2=1.0)) == dict.fromkeys(AXES, Model((WN(sigma2=1.0),)))
    chosen = models_by_axis({"accel_x": "RW(gamma2=1.0)", "accel": WHITE})
    assert list(chosen) == list(AXES[3:])
    assert str(chosen["accel_x"]) == "RW(gamma2=1.0)"


@each(
    ("arguments", "argument", "got"),
    [
        ({"models": {}}, "models", {}),
        ({"models": {"gyro_w": WHITE}}, "models", "gyro_w"),
        ({"models": 3}, "models", 3),
        ({"rate": -1.0}, "rate", -1.0),
        ({"samples": None}, "duration", None),
        ({"duration": 1.0}, "duration", 1.0),
        ({"samples": 7}, "samples", 7),
        ({"samples": 10.5}, "samples", 10.5),
        ({"samples": None, "duration": -1.0}, "duration", -1.0),
        ({"samples": None, "duration": math.inf}, "duration", math.inf),
        ({"samples": None, "duration": 1e-9}, "duration", 1e-9),
        ({"rng": -1}, "rng", -1),
        ({"rng": 1.5}, "rng", 1.5),
        ({"rng": True}, "rng", True),
        ({"resolution": {"gyro_x": 0.0}}, "resolution", 0.0),
        ({"resolution": {"gyros": 1.0}}, "resolution", "gyros"),
        ({"gravity": "gyro_x"}, "gravity", "gyro_x"),
    ],
)
def test_errors(arguments, argument, got):
    given_arguments = {"models": WHITE, "rate": 100.0, "samples": 100, "rng": 1, **arguments}
    with raises(OptionError, argument=argument, got=got):
        simulate(given_arguments.pop("models"), **given_arguments)


def test_the_reference_is_a_whole_unit():
    truth = reference_imu()
    assert tuple(truth) == AXES
    for axis, model in truth.items():
        assert model.is_complete
        assert Model.parse(str(model)) == model
        # Sorted as results are, so that the names of truth and estimate agree.
        assert model.sorted(100.0).processes == model.processes
        assert any(name.startswith("WN") for name in model.names), axis


def test_a_recording_needs_at_least_8_samples():
    with raises(OptionError, "0 samples", "at least 8", advises=["duration="]):
        simulate(WHITE, rate=100.0, duration=1e-9, rng=1)
    with raises(OptionError, "at least 8"):
        simulate(WHITE, rate=100.0, samples=7, rng=1)
    with raises(OptionError, argument="duration", advises=["duration=", "samples="]) as both:
        simulate(WHITE, rate=100.0, duration=1.0, samples=100, rng=1)
    with raises(OptionError, argument="duration", advises=["duration=", "samples="]) as neither:
        simulate(WHITE, rate=100.0, rng=1)
    assert both.value.message != neither.value.message
    with raises(OptionError, argument="duration") as undefined:
        simulate(WHITE, rate=100.0, duration=math.nan, rng=1)
    assert math.isnan(undefined.value.got)


@pytest.mark.parametrize(
    ("model", "names", "example"),
    [("WN", "WN.sigma2", "WN(sigma2=…)"), ("GM(sigma2=1.0) + WN", "GM.beta, WN.sigma2", "GM(beta=…, sigma2=1)")],
)
def test_a_model_needs_all_its_values(model, names, example):
    with raises(ModelError, "gyro_x: ", names, subject="gyro_x", example=example, advises=[example]):
        simulate({"gyro_x": model}, rate=100.0, samples=100, rng=1)
    with raises(OptionError, subject="gyro_x", argument="resolution"):
        simulate({"gyro_x": WHITE}, rate=100.0, samples=100, rng=1, resolution={"gyro": -1.0})
