"""Shared noise of several axes: exact moments, the test, delays, and what a user sees."""

import json
import pickle
from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm.applications.several import plots
from gmwm.applications.several.cross import LARGEST_LAG_SAMPLES, _delay, _freedom, _UnitNoise, cross
from gmwm.applications.several.matrices import AxisPairs
from gmwm.base.errors import DataError, OptionError
from gmwm.base.statistics import holm
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance import wavelet_variance
from gmwm.recording import batches
from gmwm.showing.plots.figure import description
from gmwm.theory.processes.model import Model
from tests.helpers import code_of, raises

RATE = 50.0


def coefficients(x, level):
    """Haar coefficients by their definition."""
    half = 1 << (level - 1)
    kernel = np.concatenate([np.ones(half), -np.ones(half)]) / 2**level
    return np.convolve(x, kernel, mode="valid")


def signals(n=3000, seed=1, shared=0.5, d=3):
    rng = np.random.default_rng(seed)
    common = rng.standard_normal(n) + np.cumsum(0.05 * rng.standard_normal(n))
    return {f"gyro_{axis}": rng.standard_normal(n) + shared * common for axis in "xyz"[:d]}


@pytest.mark.parametrize("cuts", [(), (700, 1900)])
def test_the_covariance_is_the_mean_product_of_coefficients(cuts):
    x = signals()
    ends = [0, *cuts, 3000]
    ranges = list(pairwise(ends))
    starts = [(a + 5000 * k) / RATE for k, (a, _) in enumerate(ranges)]
    given = {name: gmwm.Signal(v, RATE, "rad/s", name, segments=ranges, starts=starts) for name, v in x.items()}
    found = cross(given)
    for k, level in enumerate(found.levels[:8]):
        parts = [[coefficients(v[a:b], level) for v in x.values()] for a, b in ranges if b - a >= 2**level]
        w = np.concatenate(parts, axis=1)
        expected = w @ w.T / w.shape[1]
        assert np.allclose(found.matrices[k], expected, rtol=1e-9, atol=1e-12 * expected.max())
        r = expected[0, 1] / np.sqrt(expected[0, 0] * expected[1, 1])
        assert found.correlation["gyro_x", "gyro_y"][k] == pytest.approx(r, abs=1e-9)


def test_order_and_units_do_not_matter():
    x = signals()
    one = cross(x, RATE)
    turned = cross(dict(reversed(x.items())), RATE)
    scaled = cross({name: v * unit for (name, v), unit in zip(x.items(), (1e-12, 1.0, 1e9), strict=True)}, RATE)
    for pair in one.pairs:
        assert np.allclose(one.covariance[pair], turned.covariance[pair], rtol=1e-9)
        for name in ("correlation", "pvalues", "degrees_of_freedom"):
            for other in (turned, scaled):
                assert np.allclose(getattr(one, name)[pair], getattr(other, name)[pair], rtol=1e-6, equal_nan=True)


@pytest.mark.parametrize("text", [("WN(1)", "WN(4)"), ("WN(1) + RW(0.01)", "GM(5, 2) + QN(0.3)"), ("FN(1)", "WN(1)")])
def test_the_variance_of_independent_signals_is_exact(text):
    n, levels = 200, 6
    models = [Model.parse(one) for one in text]
    design = Design(np.arange(1, levels + 1), n, RATE)
    found = _freedom(*(_UnitNoise.of(model, design) for model in models), design)
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    for level in range(1, levels + 1):
        half = 1 << (level - 1)
        rows = n - 2 * half + 1
        kernel = np.concatenate([np.ones(half), -np.ones(half)]) / 2**level
        filters = np.array([np.concatenate([np.zeros(k), kernel, np.zeros(rows - 1 - k)]) for k in range(rows)])
        # Rows sum to zero, so covariances up to a constant serve processes without a variance.
        terms = [[p.generalised_covariance(lags.ravel(), RATE) for p in model.processes] for model in models]
        c = [filters @ sum(parts).reshape(n, n) @ filters.T for parts in terms]
        null = np.sum(c[0] * c[1]) / rows**2
        assert found[level - 1] == pytest.approx(c[0][0, 0] * c[1][0, 0] / null, rel=1e-8)


def test_independent_noise_is_not_shared_and_shared_noise_is():
    assert not cross(signals(shared=0.0, n=20_000), RATE).shared
    found = cross(signals(n=20_000), RATE)
    assert {one.axes for one in found.shared} == set(found.pairs)
    assert found.shared[0].pvalue == min(one.pvalue for one in found.shared)
    assert all(one.lower < one.correlation < one.upper and one.pvalue <= found.size for one in found.shared)
    assert [code_of(remark) for remark in found.remarks] == ["noise-shared:cross"]
    assert np.linalg.eigvalsh(found.matrices).min() >= -1e-9 * found.matrices.max()


def test_outliers_of_two_axes_are_not_shared_noise_of_a_robust_estimate():
    x = signals(shared=0.0, n=20_000, d=2, seed=2)
    for v in x.values():
        v[1000::2000] += 7.0
    assert cross(x, RATE).shared
    assert not cross(x, RATE, robust=True).shared


@pytest.mark.parametrize("delay", [-3, -1, 1, 2])
def test_a_delay_is_found(delay):
    rng = np.random.default_rng(5)
    common = rng.standard_normal(20_010)
    a, b = (rng.standard_normal(20_000) + common[5 + k : 20_005 + k] for k in (0, -delay))
    found = cross({"a": a, "b": b}, RATE)
    assert found.delays["b", "a"] == delay
    assert [remark.subject for remark in found.remarks if remark.code == "axis-delayed"] == ["b" if delay > 0 else "a"]


@pytest.mark.parametrize(
    ("lag", "peak", "far", "delay"),
    [
        (2, 0.06, 0.0, 2),
        (2, 0.04, 0.0, 0),
        (3, 0.5, 0.15, 3),
        (3, 0.5, 0.25, 0),
        (4, 0.5, 0.0, 0),
        (-1, 0.06, 0.02, -1),
    ],
)
def test_a_delay_is_a_clear_peak_at_three_samples_at_most(lag, peak, far, delay):
    """From 10 000 coefficients: the peak gains 5 standard errors, 0.05, and the rest is below 0.4 of it."""
    correlation = np.zeros(2 * LARGEST_LAG_SAMPLES + 1)
    correlation[[LARGEST_LAG_SAMPLES + lag, 0]] = peak, far
    assert _delay(correlation, 10_000) == delay


def test_a_line_with_a_phase_is_no_delay():
    rng, t = np.random.default_rng(6), np.arange(20_000)
    x = {name: rng.standard_normal(t.size) + np.sin(0.9 * t + phase) for name, phase in (("a", 0.0), ("b", 1.8))}
    found = cross(x, RATE)
    assert found.shared
    assert not found.delays


def test_intervals_and_p_values_are_missing_where_there_are_too_few_coefficients():
    found = cross(signals(n=3000), RATE)
    few = found.degrees_of_freedom["gyro_x", "gyro_y"] <= 3
    assert few.any()
    for values in (found.lower, found.upper, found.pvalues):
        assert np.array_equal(np.isnan(values["gyro_x", "gyro_y"]), few)
    assert found.tests == 3 * np.count_nonzero(~few)


@pytest.mark.slow
def test_what_a_user_sees(tmp_path):
    imu = gmwm.simulate("WN(sigma2=4e-8)", rate=RATE, samples=3000, rng=1)
    found = gmwm.cross(imu)
    assert len(found.pairs) == 15
    assert json.loads(json.dumps(found.to_dict()))["pairs"]["gyro_x gyro_y"]["delay"] == 0
    assert found.to_polars().shape == (15 * found.levels.size, 10)
    assert pickle.loads(pickle.dumps(found)).summary() == found.summary()
    found.plot(path=tmp_path / "cross.png")
    assert (tmp_path / "cross.png").stat().st_size > 10_000
    panels = description(plots.plot_cross)(found).panels
    assert [panel.title for panel in panels][:2] == ["Gyroscope X, Y", "Gyroscope X, Z"]
    assert repr(found).startswith("CrossCovariance(gyro_x, ")


@pytest.mark.parametrize(
    ("x", "rate", "argument"),
    [
        ({"a": np.ones(50)}, RATE, "x"),
        (np.ones(50), RATE, "x"),
        ({"a": np.arange(50.0), "b": np.arange(60.0)}, RATE, "x"),
        ({"a": np.ones(50), "b": np.random.default_rng(1).normal(size=50)}, RATE, "x"),
        ({"a": np.array([1.0, np.nan]), "b": np.ones(2)}, RATE, "a"),
        ({"a": gmwm.Signal(np.arange(50.0), 10.0), "b": np.ones(50)}, RATE, "rate"),
    ],
)
def test_signals_that_cannot_be_compared_are_refused(x, rate, argument):
    with pytest.raises(DataError) as error:
        cross(x, rate)
    assert error.value.argument == argument


def test_options_are_checked():
    for options in ({"size": 0.0}, {"size": "x"}, {"confidence": 0.2}, {"efficiency": 0.9}):
        with pytest.raises(OptionError):
            cross(signals(), RATE, **options)


def test_pairs_do_not_depend_on_the_order():
    pairs = AxisPairs({("a", "b"): 1, ("a", "c"): 2})
    assert pairs["b", "a"] == pairs["a", "b"] == 1
    assert ("c", "a") in pairs
    assert pairs.get(("b", "c")) is None
    with pytest.raises(DataError):
        pairs["b", "c"]


def test_holm():
    rng = np.random.default_rng(1)
    p = rng.random(20) ** 2
    adjusted = holm(p)
    order = np.argsort(p)
    expected = np.maximum.accumulate([min(1.0, (20 - k) * p[place]) for k, place in enumerate(order)])
    assert np.allclose(adjusted[order], expected)
    assert holm([]).size == 0
    # A test that was not made does not count.
    some = np.insert(p, [3, 20], np.nan)
    assert np.array_equal(holm(some), np.insert(adjusted, [3, 20], np.nan), equal_nan=True)


def test_the_curves_are_those_of_the_wavelet_variance():
    x = signals()
    found = cross(x, RATE)
    for name, values in x.items():
        assert np.allclose(found.variance[name], wavelet_variance(values, RATE).variance)


@pytest.mark.slow
@pytest.mark.parametrize("robust", [False, True])
def test_a_stream_has_the_covariances_of_memory(tmp_path, monkeypatch, robust):
    """Also with lost samples, in batches of any size, and where coarse levels use a part of the coefficients."""
    rng = np.random.default_rng(8)
    n = 20_000
    table = np.cumsum(0.05 * rng.normal(size=n))
    kept = rng.random(n) > 0.01
    kept[9000:12_500] = False
    shares = {"gyro_x": 1.0, "gyro_y": -0.5, "gyro_z": 0.1}
    x = {axis: rng.normal(size=n) + share * table for axis, share in shares.items()}
    text = np.column_stack([np.arange(n) / 100, *x.values()])[kept]
    head = "time [s],gyro_x,gyro_y,gyro_z"
    np.savetxt(tmp_path / "a.csv", text, delimiter=",", fmt="%.9g", header=head, comments="")
    units = {"gyro": "rad/s"}
    expected = gmwm.cross(gmwm.read(tmp_path / "a.csv", units=units), robust=robust)
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 5000)
    found = gmwm.cross(gmwm.stream(tmp_path / "a.csv", units=units, chunk=777), robust=robust)
    assert (found.axes, found.units, found.samples) == (expected.axes, expected.units, expected.samples)
    for pair in expected.covariance:
        np.testing.assert_allclose(found.covariance[pair], expected.covariance[pair], rtol=1e-8, atol=1e-10)
        np.testing.assert_allclose(found.pvalues[pair], expected.pvalues[pair], rtol=1e-6)
    two = gmwm.cross(gmwm.stream(tmp_path / "a.csv", units=units), axes=["gyro_x", "gyro_z"], robust=robust)
    np.testing.assert_allclose(
        two.covariance["gyro_x", "gyro_z"], expected.covariance["gyro_x", "gyro_z"], rtol=1e-8, atol=1e-10
    )
    with raises(OptionError, argument="axes"):
        gmwm.cross(gmwm.stream(tmp_path / "a.csv", units=units), axes="gyro_x")
