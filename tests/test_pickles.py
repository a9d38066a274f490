"""Every public result survives pickling and deep copies, as it goes to another process and comes back."""

import copy
import pickle
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from inspect import isclass

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.calibration.summary_text import summary
from gmwm.measuring.covariance.design import Design
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from tests.helpers import each

RATE = 100.0
MODEL = "GM(beta=2.0, sigma2=0.5) + WN(sigma2=1.0)"
AXES = ("gyro_x", "gyro_y", "gyro_z")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """One of each, by name of its class."""
    simulated = gmwm.simulate(dict.fromkeys(AXES, MODEL), rate=RATE, duration=60.0, rng=1, components=True)
    imu = simulated.imu
    signal = gmwm.simulate_signal(MODEL, rate=RATE, samples=6000, rng=1)
    x = signal.signal
    fit, likely = gmwm.fit("GM + WN", x), gmwm.fit_ml("GM + WN", x)
    ranking = gmwm.rank(["WN", "GM + WN"], x)
    calibration = gmwm.calibrate(imu, within="GM + WN")
    folder = tmp_path_factory.mktemp("fleet")
    for unit in ("a", "b"):
        imu.write(folder / f"{unit}.csv")
    accumulator = gmwm.WaveletAccumulator(rate=RATE)
    accumulator.update(x.values)
    spectrum = gmwm.spectrum.SpectrumAccumulator(RATE)
    spectrum.update(x.values)
    space = fit.model.state_space(RATE)
    found = [
        imu, simulated, signal, x, fit, likely, ranking, ranking[0], calibration, accumulator, space, fit.model,
        fit.goodness_of_fit(), fit.wic(), fit.bootstrap(draws=20), fit.datasheet(), fit.sandwich, fit.wavelet_variance,
        fit.diagnostics.start, fit.model.continuous(RATE), likely.smooth(x), likely.residuals(x),
        gmwm.allan_variance(x), gmwm.avlr(x), gmwm.contamination(x), gmwm.inspect(imu), gmwm.filters.find_filter("d4"),
        gmwm.estimation.Sampled(draws=10, rng=1), gmwm.plan(MODEL, duration=60.0, rate=RATE),
        gmwm.psd(x), gmwm.psd(imu), spectrum, gmwm.agree([calibration, calibration]), gmwm.wavelet_variance(imu),
        gmwm.fleet(folder, folder / "out", within="GM + WN", workers=1),
    ]  # fmt: skip
    return {type(one).__name__: one for one in found}


NAMES = (
    "Agreement", "AllanRegression", "Bootstrap", "Calibration", "Candidate", "ClusterVariance", "ContinuousStateSpace",
    "Criterion", "Datasheet", "Fit", "Fleet", "GoodnessOfFit", "Imu", "Inspection", "LikelihoodFit", "Model", "Plan",
    "PowerSpectra", "PowerSpectrum", "Ranking", "Residuals", "Sampled", "Sandwich", "Signal", "SimulatedImu",
    "SimulatedSignal", "SpectrumAccumulator", "Start", "StateSpace", "Tracks", "Verdict", "WaveletAccumulator",
    "WaveletFilter", "WaveletVariance", "WaveletVariances",
)  # fmt: skip


def test_every_result_of_the_package_is_sent():
    public = {name for name in gmwm.__all__ if isclass(one := getattr(gmwm, name)) and is_dataclass(one)}
    processes = {name for name in public if issubclass(getattr(gmwm, name), Process)}
    assert public - processes - set(NAMES) == set()


def same(one, other):
    """Whether two are alike in every field, to the last bit."""
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and one.shape == other.shape and one.tobytes() == other.tobytes()
    if is_dataclass(one):
        return all(same(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, Mapping):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if isinstance(one, tuple | list):
        return len(one) == len(other) and all(same(a, b) for a, b in zip(one, other, strict=True))
    if isinstance(one, pl.DataFrame):
        return one.equals(other)
    if isinstance(one, gmwm.WaveletAccumulator):
        return same(one.to_dict(), other.to_dict())
    if isinstance(one, gmwm.spectrum.SpectrumAccumulator):
        return same(one.result(), other.result())
    return one == other or (one != one and other != other)


@pytest.mark.slow
@pytest.mark.parametrize("way", ["pickle", "copy"])
@pytest.mark.parametrize("name", NAMES)
def test_a_result_comes_back_as_it_went(results, name, way):
    one = results[name]
    again = pickle.loads(pickle.dumps(one)) if way == "pickle" else copy.deepcopy(one)
    # A filter of the table is one object.
    assert (again is one) == (name == "WaveletFilter")
    assert same(again, one)
    assert repr(again) == repr(one)


@pytest.mark.slow
@each("name", NAMES)
def test_comparing_a_result_with_a_copy_raises_nothing(results, name):
    one = results[name]
    assert one == one
    assert (one == copy.deepcopy(one)) in (True, False)


@pytest.mark.slow
def test_a_plan_that_came_back_goes_on(results):
    plan = results["Plan"]
    again = pickle.loads(pickle.dumps(plan))
    assert again.summary() == plan.summary()
    assert not again.durations.flags.writeable
    assert not any(curve.flags.writeable for curve in again.errors.values())
    with pytest.raises(TypeError):
        again.errors["WN.sigma2"] = again.durations


def test_a_test_of_fit_can_be_kept_in_a_set(results):
    one = results["GoodnessOfFit"]
    assert {one, one} == {one}


def test_a_calibration_that_came_back_says_the_same(results):
    assert summary(pickle.loads(pickle.dumps(results["Calibration"]))) == summary(results["Calibration"])


def test_names_in_a_copy_are_still_told(results):
    fit = pickle.loads(pickle.dumps(results["Fit"]))
    with pytest.raises(KeyError, match=r"no parameter 'foo', only GM\.beta, GM\.sigma2, WN\.sigma2"):
        fit.parameters["foo"]


@pytest.mark.parametrize("name", ["haar", "la8"])
def test_a_filter_stays_the_same_object(name):
    """Otherwise the exact theory of the Haar filter is not used, and fits take a hundred times as long."""
    design = Design.of(gmwm.wavelet_variance(np.random.default_rng(1).normal(size=256), 100.0, filter=name))
    for again in (pickle.loads(pickle.dumps(design)), copy.deepcopy(design)):
        assert again.filter is find_filter(name)
