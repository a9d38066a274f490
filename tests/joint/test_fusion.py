"""The virtual sensor of an array: weights, prediction, what a user sees."""

import json
import pickle

import numpy as np
import pytest

import gmwm
from gmwm.applications.several import fuse
from gmwm.applications.several.fusion import best_weights
from gmwm.applications.several.fusion_result import ArrayNoise, wavelet_variance
from gmwm.applications.several.matrices import wavelet_matrices
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.files.readers import read_array
from tests.helpers import code_of
from validation.study_fusion import exact, simulated, units


def array(seed=1, n=8192):
    return simulated(np.random.default_rng(seed), 4, n)


def test_the_weights_are_the_best_ones():
    rng = np.random.default_rng(1)
    root = rng.standard_normal((5, 5))
    gamma = root @ root.T
    for nonnegative in (False, True):
        weights = best_weights(gamma, nonnegative=nonnegative)
        assert weights.sum() == pytest.approx(1)
        assert not nonnegative or weights.min() >= 0
        # No other weights with sum 1 are better.
        for _ in range(200):
            other = rng.dirichlet(np.ones(5)) if nonnegative else weights + 0.1 * rng.normal(size=5)
            assert weights @ gamma @ weights <= (other / other.sum()) @ gamma @ (other / other.sum()) + 1e-12
    assert (best_weights(gamma) < 0).any()


def test_the_matrices_are_those_of_cross_and_of_the_simulation():
    x = array(n=1 << 15)
    found = wavelet_matrices({k: gmwm.Signal(v, 1.0) for k, v in x.items()})
    assert np.allclose(found.values, gmwm.cross(x, 1.0).matrices, rtol=1e-12)
    truth = exact(4, found.tau)
    assert np.allclose(found.values[:8], truth[:8], atol=0.06 * truth[:8].max(axis=(1, 2), keepdims=True))


def test_the_weights_between_two_levels_and_at_a_level():
    x = array()
    gamma = gmwm.cross(x, 1.0).matrices
    assert np.allclose(fuse(x, 1.0, horizon=64.0)["gyro_x"].weights, best_weights(gamma[5]))
    between = fuse(x, 1.0, horizon=2.0**6.25)["gyro_x"].weights
    assert np.allclose(between, best_weights(0.75 * gamma[5] + 0.25 * gamma[6]))


def test_order_and_units_do_not_matter():
    x = array()
    one = fuse(x, 1.0, horizon=100.0)["gyro_x"]
    turned = fuse(dict(reversed(x.items())), 1.0, horizon=100.0)["gyro_x"]
    assert np.allclose(one.weights, turned.weights[::-1], atol=1e-9)
    assert np.allclose(one.variance, turned.variance)
    for unit in (1e-12, 1e9):
        scaled = fuse({name: unit * v for name, v in x.items()}, 1.0, horizon=100.0)["gyro_x"]
        assert np.allclose(one.weights, scaled.weights, atol=1e-9)
        assert np.allclose(one.variance * unit**2, scaled.variance)


def test_the_motion_is_not_changed():
    x = array()
    virtual = fuse(x, 1.0, horizon=100.0)
    motion = 1e3 * np.sin(np.arange(8192) / 50)
    still, moving = virtual.apply(x, 1.0), virtual.apply({name: v + motion for name, v in x.items()}, 1.0)
    assert np.allclose(moving["gyro_x"].values - still["gyro_x"].values, motion)
    one = virtual["gyro_x"]
    assert np.allclose(gmwm.wavelet_variance(still["gyro_x"]).variance * one.optimism, one.variance)


@pytest.mark.slow
def test_the_prediction_holds_in_other_recordings():
    # The tolerance of 10 % is the one of docs/validation/fusion.md, which has 1000 recordings.
    found = [fuse(array(seed, 4096), 1.0, horizon=256.0)["gyro_x"] for seed in range(60)]
    gamma = exact(4, found[0].tau)
    achieved = np.mean([np.einsum("a,jab,b->j", one.weights, gamma, one.weights) for one in found], axis=0)
    predicted = np.mean([one.variance for one in found], axis=0)
    plain = np.mean([one.variance / one.optimism for one in found], axis=0)
    assert np.all(np.abs(achieved / predicted - 1)[:9] < 0.1)
    assert achieved[7] / plain[7] > 1.08


def test_recordings_of_units_are_fused_axis_by_axis():
    rng = np.random.default_rng(3)
    units = [
        gmwm.Imu.from_arrays({"gyro_x": rng.normal(size=3000), "accel_z": s * rng.normal(size=3000)}, 100.0)
        for s in (1.0, 2.0, 3.0)
    ]
    virtual = fuse(units, horizon=0.1)
    assert list(virtual.axes) == ["gyro_x", "accel_z"]
    assert virtual["accel_z"].members == ("accel_z[0]", "accel_z[1]", "accel_z[2]")
    fused = virtual.apply(units)
    assert fused.axes == ("gyro_x", "accel_z")
    assert fused["accel_z"].unit == "m/s²"
    named = fuse(dict(zip("abc", units, strict=True)), horizon=0.1)
    assert np.array_equal(named["gyro_x"].weights, virtual["gyro_x"].weights)
    with pytest.raises(DataError, match=r"gyro_x\[a\]"):
        named.apply(units)
    assert list(fuse({"left": rng.normal(size=500), "right": rng.normal(size=500)}, 1.0, horizon=4).axes) == ["virtual"]


def test_gaps_stay_gaps():
    ranges, starts = [(0, 1500), (1500, 3000)], [0.0, 200.0]
    x = {
        f"gyro_x[{k}]": gmwm.Signal(np.random.default_rng(k).normal(size=3000), 100.0, segments=ranges, starts=starts)
        for k in range(3)
    }
    fused = fuse(x, horizon=0.1).apply(x)["gyro_x"]
    assert fused.segments == tuple(ranges)
    assert fused.starts == tuple(starts)


@pytest.mark.slow
def test_what_a_user_sees(tmp_path):
    virtual = fuse(array(n=1 << 15), 1.0, horizon=2048.0)
    assert json.loads(json.dumps(virtual.to_dict()))["axes"]["gyro_x"]["weights"].keys() == array(n=8).keys()
    assert virtual.to_polars().shape == (15, 7)
    assert list(virtual) == ["gyro_x"]
    assert pickle.loads(pickle.dumps(virtual)).summary() == virtual.summary()
    virtual.plot(path=tmp_path / "virtual.png")
    assert (tmp_path / "virtual.png").stat().st_size > 10_000
    assert repr(virtual) == "VirtualSensor(gyro_x: 4 units, for a scale of 34 min)"
    shared = np.random.default_rng(4).normal(size=4000)
    both = {"a": shared, "b": 2 * shared + np.random.default_rng(5).normal(size=4000)}
    assert [remark.code for remark in fuse(both, 1.0, horizon=4.0).remarks] == ["weights-negative"]
    assert not fuse(both, 1.0, horizon=4.0, nonnegative=True).remarks


@pytest.mark.parametrize(
    ("x", "argument"),
    [
        ({"gyro_x[0]": np.arange(50.0)}, "x"),
        (np.ones((2, 50)), "x"),
        ({}, "x"),
        ({"gyro_x": np.arange(50.0), "gyro_y": np.arange(50.0)}, "x"),
        ({"gyro_x[0]": np.arange(50.0), "gyro_x": np.arange(50.0)}, "x"),
        ({"a": np.random.default_rng(1).normal(size=50), "b": np.random.default_rng(1).normal(size=50)}, "x"),
        ({"a": gmwm.Signal(np.arange(50.0), 1.0, "rad/s"), "b": gmwm.Signal(np.arange(50.0), 1.0, "m/s²")}, "x"),
    ],
)
def test_arrays_that_cannot_be_fused_are_refused(x, argument):
    with pytest.raises(DataError) as error:
        fuse(x, 1.0, horizon=4.0)
    assert error.value.argument == argument


def test_a_kalman_filter_is_nearly_best_at_all_scales():
    white, walk = units(4)
    levels = np.arange(1, 16)
    noise = ArrayNoise((gmwm.WN(sigma2=1.0), gmwm.RW(gamma2=1.0)), np.array([white, walk]), 1.0)
    found = wavelet_variance(noise, noise.filter(), levels)
    best = 1 / np.linalg.inv(exact(4, 2.0**levels)).sum(axis=(1, 2))
    # The table of the theory: within 4 % of the best static weights of each scale.
    assert np.all(found / best < 1.04)
    assert np.all(found / best > 0.97)


def test_the_predicted_variance_of_a_filter_is_exact():
    rng = np.random.default_rng(1)
    processes = (gmwm.WN(sigma2=1.0), gmwm.GM(beta=0.05, sigma2=1.0), gmwm.RW(gamma2=1.0))
    roots = rng.standard_normal((3, 3, 3))
    sigmas = np.array([root @ root.T for root in roots]) * np.array([1.0, 0.5, 1e-4])[:, None, None]
    noise = ArrayNoise(processes, sigmas, 1.0)
    filter = ArrayNoise(processes, sigmas[:, ::-1, ::-1], 1.0).filter()  # made for another noise
    # The transfer function of the filter, on a grid of frequencies.
    f = np.concatenate([np.geomspace(1e-7, 0.5, 20_000)])
    z = np.exp(2j * np.pi * f)
    eye = np.eye(len(filter.A))
    inner = np.linalg.solve(eye - filter.A / z[:, None, None], np.broadcast_to(filter.K, (f.size, *filter.K.shape)))
    response = filter.weights - np.einsum("n,fnd->fd", filter.C, inner) @ filter.differences
    density = [np.ones_like(f), (1 - np.exp(-0.1)) / np.abs(1 - np.exp(-0.05) / z) ** 2, 1 / np.abs(1 - 1 / z) ** 2]
    shape = np.array([np.einsum("fa,ab,fb->f", response.conj(), sigma, response).real for sigma in sigmas])
    whole = np.sum(np.array(density) * shape, axis=0)
    for level in (1, 4, 8):
        half = 2 ** (level - 1)
        haar = np.sin(np.pi * f * half) ** 4 / (half * np.sin(np.pi * f)) ** 2
        expected = 2 * np.trapezoid(haar * whole, f)
        assert wavelet_variance(noise, filter, np.array([level]))[0] == pytest.approx(expected, rel=1e-3)


@pytest.mark.slow
def test_a_filter_runs_in_blocks_as_sample_by_sample():
    x = np.array(list(array(n=700).values())) + np.array([[5.0], [-3.0], [2.0], [100.0]])
    filter = fuse(array(n=1 << 14), 1.0, model="WN + shared(RW)")["gyro_x"].filter
    z = filter.differences @ x
    z = z - z[:, : filter.memory].mean(axis=1, keepdims=True)
    state, expected = np.zeros(filter.C.size), []
    for t in range(700):
        state = filter.A @ state + filter.K @ z[:, t]
        expected.append(filter.weights @ x[:, t] - filter.C @ state)
    assert np.allclose(filter.run(x), expected, rtol=0, atol=1e-12)


@pytest.mark.slow
def test_a_kalman_filter_keeps_the_motion_and_its_promise():
    virtual = fuse(array(n=1 << 15), 1.0)
    one = virtual["gyro_x"]
    assert one.model == "shared(WN) + shared(RW)"
    assert one.pvalue > 0.01
    motion = 1e3 * np.sin(np.arange(1 << 15) / 50)
    other = array(seed=9, n=1 << 15)
    still = virtual.apply(other, 1.0)["gyro_x"].values
    moving = virtual.apply({name: v + motion for name, v in other.items()}, 1.0)["gyro_x"].values
    assert np.allclose(moving - still, motion)
    found = gmwm.wavelet_variance(still, 1.0).variance[:11]
    assert np.all(np.abs(np.log(found / one.variance[:11])) < 3 * np.sqrt(2 / one.seen[:11]) + 0.05)
    assert "Kalman filter" in virtual.summary()
    assert json.loads(json.dumps(virtual.to_dict()))["axes"]["gyro_x"]["filter"]["w0"]
    static = fuse(array(n=1 << 15), 1.0, horizon=1024.0, model="WN + shared(RW)")
    assert static["gyro_x"].filter is None
    assert static["gyro_x"].gain[9] > 1.05


@pytest.mark.slow
def test_a_model_that_does_not_fit_is_reported():
    virtual = fuse(array(n=1 << 14), 1.0, model="WN")
    assert [code_of(remark) for remark in virtual.remarks] == ["model-rejected:array"]


def test_rounding_is_part_of_the_model_if_no_other_fits():
    model = {"gyro_x": "QN(q2=2.5e-7) + WN(sigma2=6e-7)"}
    units = [gmwm.simulate(model, rate=100.0, samples=20_000, rng=k) for k in (1, 2)]
    found = fuse(units)["gyro_x"]
    assert found.model.endswith("+ QN")
    assert found.pvalue > 0.01


def test_no_negative_weights_need_a_horizon():
    with pytest.raises(OptionError):
        fuse(array(n=512), 1.0, nonnegative=True)


@pytest.mark.parametrize("horizon", [0.0, -1.0, np.inf, "60s", True, 1.0, 9000.0, 4096.0])
def test_horizons_that_the_recording_does_not_allow_are_refused(horizon):
    with pytest.raises(OptionError) as error:
        fuse(array(), 1.0, horizon=horizon)
    assert error.value.argument == "horizon"


@pytest.mark.parametrize("style", ["gyro_{a}[{k}]", "imu{k}.gyro_{a} [rad/s]", "w{a}_{k}", "gyro{k}_{a}_rad_s"])
def test_columns_with_numbers_are_units(tmp_path, style):
    rng = np.random.default_rng(1)
    names = [style.format(a=a, k=k) for k in (2, 10, 1) for a in "xyz"]
    table = rng.normal(size=(64, 9))
    path = tmp_path / "array.csv"
    rows = np.column_stack([np.arange(64) / 100, table])
    np.savetxt(path, rows, delimiter=",", header=",".join(["time", *names]), comments="")
    units = read_array(path, units={"gyro": "rad/s"})
    assert list(units) == ["1", "2", "10"]
    assert all(unit.axes == ("gyro_x", "gyro_y", "gyro_z") for unit in units.values())
    assert np.allclose(units["10"]["gyro_y"].values, table[:, 4])


def test_files_and_topics_are_units(tmp_path):
    rng = np.random.default_rng(1)
    for name in ("left", "right"):
        gmwm.Imu.from_arrays({"gyro_x": rng.normal(size=64)}, 100.0).write(tmp_path / f"{name}.csv")
    files = [tmp_path / "left.csv", tmp_path / "right.csv"]
    assert list(read_array(files)) == ["left", "right"]
    with pytest.raises(ReadError) as error:
        read_array(files[0])
    assert error.value.code == "no-array"
    with pytest.raises(OptionError):
        read_array([files[0], files[0]])


def test_arrays_of_the_axes_of_an_imu_have_si_units():
    rng = np.random.default_rng(3)
    x = {f"{axis}[{k}]": rng.normal(size=4000) for axis in ("gyro_x", "accel_z") for k in range(3)}
    virtual = gmwm.fuse(x, rate=100.0, horizon=1.0)
    assert (virtual["gyro_x"].unit, virtual["accel_z"].unit) == ("rad/s", "m/s²")
    figure = virtual.plot()
    assert any("rad/s" in axes.get_ylabel() for axes in figure.axes)
    nameless = gmwm.fuse({str(k): rng.normal(size=4000) for k in range(3)}, rate=100.0, horizon=1.0)
    assert [nameless[axis].unit for axis in nameless.axes] == [""]


@pytest.mark.slow
def test_a_recording_in_motion_has_a_remark():
    """No model of noise describes motion: the test rejects the best one."""
    rng = np.random.default_rng(1)
    motion = 0.05 * np.sin(np.arange(8000) / 500)
    found = fuse({f"gyro_x[{k}]": motion + 1e-3 * rng.normal(size=8000) for k in range(3)}, 100.0)
    assert "model-rejected:array" in [code_of(remark) for remark in found.remarks]


def test_weights_for_a_range_of_scales():
    """They minimise the mean of the variance over that of the average, and lie between those of the ends."""
    x = array(n=1 << 14)
    gamma = wavelet_matrices({name: gmwm.Signal(values, 1.0) for name, values in x.items()}).values
    ranged = fuse(x, 1.0, horizon=(4.0, 512.0))["gyro_x"]
    target = sum(gamma[k] / gamma[k].mean() for k in range(1, 9))
    np.testing.assert_allclose(ranged.weights, best_weights(target))
    ends = [fuse(x, 1.0, horizon=scale)["gyro_x"] for scale in (4.0, 512.0)]
    inside = slice(1, 9)
    mean = [np.mean(virtual.measured[inside] / ranged.average[inside]) for virtual in (ranged, *ends)]
    assert mean[0] < min(mean[1:])
    assert "for scales of 4 s to 8.5 min" in repr(fuse(x, 1.0, horizon=(4.0, 512.0)))


def test_weights_of_vaccaro_and_zaki():
    """With an infinite horizon, the weights are those of the random walks alone."""
    rng, shares = np.random.default_rng(3), np.array([1.0, 2.0, 4.0])
    x = {f"gyro_x[{k}]": np.cumsum(s * rng.normal(size=1 << 14)) + 30 * rng.normal(size=1 << 14)
         for k, s in enumerate(shares)}  # fmt: skip
    weights = fuse(x, 1.0, horizon=np.inf, model="WN + RW")["gyro_x"].weights
    np.testing.assert_allclose(weights, shares**-2 / np.sum(shares**-2), atol=0.05)


def test_a_signal_that_can_be_left_out():
    rng = np.random.default_rng(4)
    x = {f"gyro_x[{k}]": size * rng.normal(size=1 << 14) for k, size in enumerate((1.0, 1.0, 10.0))}
    virtual = fuse(x, 1.0, horizon=8.0)
    np.testing.assert_allclose(
        virtual["gyro_x"].without, [np.sqrt(2.01 / 1.01), np.sqrt(2.01 / 1.01), 1.0025], atol=0.06
    )
    assert "deviation without it" in virtual.summary()
    assert virtual.to_dict()["axes"]["gyro_x"]["without"]["gyro_x[2]"] < 1.02


@pytest.mark.parametrize("horizon", [(4.0, 2.0), (4.0,), (4.0, np.inf), (4.0, 1e6), (4.1, 4.2)])
def test_ranges_that_are_refused(horizon):
    with pytest.raises(OptionError) as error:
        fuse(array(), 1.0, horizon=horizon)
    assert error.value.argument == "horizon"
