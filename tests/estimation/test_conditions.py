"""Fits to recordings at known conditions: an oracle for the criterion, and a simulator apart from the package."""

import json

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import nnls
from scipy.signal import lfilter

import gmwm
from gmwm.base.errors import ModelError, OptionError
from gmwm.fitting.estimation.varies import Varies
from gmwm.measuring.covariance import wavelet_covariance
from tests.helpers import raises

N = 1 << 14
RATES = (0.0, 50.0, 100.0, 200.0)


def drawn(rng, rate, markov=False, walk=4e-6):
    """White noise with variance 1 + (rate/100)², a random walk, and a Gauss-Markov process; on a constant rate."""
    x = np.sqrt(1 + (rate / 100) ** 2) * rng.normal(size=N) + np.sqrt(walk) * np.cumsum(rng.normal(size=N)) + rate
    if markov:
        phi = np.exp(-1 / 40)
        x = x + lfilter([1.0], [1.0, -phi], np.sqrt(0.3 * (1 - phi**2)) * rng.normal(size=N))
    return x


def recordings(rng, **kind):
    return {rate: gmwm.Signal(drawn(rng, rate, **kind), 1.0, axis="gyro_z") for rate in RATES}


@pytest.fixture(scope="module")
def data():
    return recordings(np.random.default_rng(1))


@pytest.fixture(scope="module")
def found(data):
    return gmwm.fit("WN + RW", data, varies={"WN": "1 + rate**2"})


@pytest.mark.slow
def test_the_estimate_is_that_of_least_squares_under_its_own_weights(data, found):
    curves = [gmwm.wavelet_variance(signal) for signal in data.values()]
    roots = []
    for curve, model in zip(curves, found.models.values(), strict=True):
        eta = curve.degrees_of_freedom
        implied = model.wavelet_variance(curve.levels, 1.0)
        scale = (eta * curve.variance / implied + 1000) / (eta + 1000)
        roots.append(np.diag(1 / (scale * np.sqrt(np.diag(wavelet_covariance(model, N, 1.0))))))
    root = block_diag(*roots)
    white = [gmwm.WN(sigma2=1.0).wavelet_variance(curve.levels, 1.0) for curve in curves]
    walk = [gmwm.RW(gamma2=1.0).wavelet_variance(curve.levels, 1.0) for curve in curves]
    square = [rate**2 * one for rate, one in zip(RATES, white, strict=True)]
    columns = root @ np.column_stack([np.concatenate(part) for part in (white, square, walk)])
    size = np.linalg.norm(columns, axis=0)
    best, left = nnls(columns / size, root @ np.concatenate([curve.variance for curve in curves]))
    names = ("WN.sigma2 (1)", "WN.sigma2 (rate^2)", "RW.gamma2")
    assert [found.estimates[name].value for name in names] == pytest.approx((best / size).tolist(), rel=1e-6)
    assert found.objective == pytest.approx(left**2, rel=1e-6)
    assert found.lower_bound == found.objective


@pytest.mark.slow
def test_intervals_cover_and_tests_have_their_size():
    rng = np.random.default_rng(2)
    truth = {"WN.sigma2 (1)": 1.0, "WN.sigma2 (rate^2)": 1e-4, "RW.gamma2": 4e-6}
    covers, fits, constants = [], [], []
    for _ in range(15):
        one = gmwm.fit("WN + RW", recordings(rng), varies={"WN": "1 + rate**2"}, certify=False)
        covers.append([low <= truth[n] <= high for n in truth for low, high in [one.estimates[n].interval()]])
        fits.append(one.pvalue)
        still = {rate: gmwm.Signal(drawn(rng, 0.0), 1.0) for rate in RATES}
        constants.append(gmwm.fit("WN + RW", still, varies={"WN": "1 + rate**2"}, certify=False).pvalue_constant)
    assert np.all(np.mean(covers, axis=0) > 0.72)  # 11 of 15; probability below 0.1 % at 95 %
    for pvalues in (fits, constants):
        assert sum(p < 0.05 for p in pvalues) <= 3  # probability 0.5 % at a size of 5 %


@pytest.mark.slow
def test_a_shape_is_shared_and_proven(data):
    rng = np.random.default_rng(3)
    one = gmwm.fit("GM + WN", recordings(rng, markov=True, walk=0.0), varies={"WN": "1 + rate^2"})
    low, high = one.estimates["GM.beta"].interval()
    assert low < 1 / 40 < high
    assert one.objective * (1 - 1e-3) <= one.lower_bound <= one.objective
    models = list(one.models.values())
    assert {model.parameters["GM.beta"] for model in models} == {one.estimates["GM.beta"].value}
    assert one.pvalue_constant < 1e-6


@pytest.mark.slow
def test_the_order_of_the_conditions_changes_nothing(data, found):
    other = gmwm.fit("RW + WN", dict(reversed(data.items())), varies={"WN": "rate**2 + 1"})
    for name, one in found.estimates.items():
        assert other.estimates[name].value == pytest.approx(one.value, rel=1e-8)
        assert other.estimates[name].error == pytest.approx(one.error, rel=1e-6)


def test_without_functions_the_conditions_are_repetitions(data):
    twice = gmwm.fit("WN + RW", {1.0: data[0.0], 2.0: data[0.0]})
    once = gmwm.fit("WN + RW", data[0.0])
    assert twice.estimates["WN.sigma2"].value == pytest.approx(once.parameters["WN.sigma2"], rel=1e-6)
    assert twice.estimates["WN.sigma2"].error == pytest.approx(once.standard_errors["WN.sigma2"] / np.sqrt(2), rel=1e-6)
    assert twice.pvalue_constant is None


def test_hats_are_one_value_for_each_plateau():
    rng = np.random.default_rng(4)
    data = {t: gmwm.Signal(s * rng.normal(size=N), 1.0) for t, s in ((-20.0, 2.0), (20.0, 1.0), (60.0, 3.0))}
    one = gmwm.fit("WN", data, varies={"WN": "hats(-20, 20, 60)"})
    for t, s in ((-20, 2.0), (20, 1.0), (60, 3.0)):
        assert one.estimates[f"WN.sigma2 (hat at {t})"].value == pytest.approx(s**2, rel=0.05)
    half = one.at(0.0).parameters["WN.sigma2"]
    assert half == pytest.approx((one.at(-20.0).parameters["WN.sigma2"] + one.at(20.0).parameters["WN.sigma2"]) / 2)
    with raises(OptionError, argument="condition"):
        one.at(61.0)


def test_a_held_term_and_recordings_of_different_lengths(data):
    short = data | {50.0: data[50.0].values[: N // 4]}
    model = "WN + RW(gamma2=fixed(4e-6))"
    one = gmwm.fit(model, short, 1.0, varies={"WN": "1 + rate**2"}, weighting="optimal")
    assert set(one.estimates) == {"WN.sigma2 (1)", "WN.sigma2 (rate^2)"}
    assert len(one.curves[50.0]) == len(one.curves[0.0]) - 2


@pytest.mark.slow
def test_the_text_the_document_and_the_picture(found, tmp_path):
    assert "WN.sigma2 (rate^2)" in found.summary()
    assert "p < 0.001" in found.summary()
    assert json.loads(json.dumps(found.to_dict()))["estimates"]["RW.gamma2"]["acts_as"] is None
    found.plot(path=tmp_path / "fit.png")
    assert (tmp_path / "fit.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("model", "varies", "kind"),
    [
        ("WN + RW", {"GM": "1"}, OptionError),
        ("WN + RW", {"WN": "exp(rate)"}, OptionError),
        ("WN + RW", {"WN": "1 + rate", "RW": "1 + speed"}, OptionError),
        ("WN + RW", {"WN": "hats(2, 1)"}, OptionError),
        ("GM + WN", {"GM": "1 + rate"}, OptionError),
        ("WN + RW", {"WN": "1 + rate + rate^2 + rate^3 + rate^4"}, ModelError),
        ("AR(2) + WN", {"WN": "1 + rate"}, ModelError),
    ],
)
def test_what_cannot_vary_is_one_error(data, model, varies, kind):
    with raises(kind):
        gmwm.fit(model, data, varies=varies)


def test_negative_functions_and_other_options_are_errors(data):
    with raises(ModelError, "negative at -1"):
        gmwm.fit("WN", {-1.0: data[0.0], 1.0: data[0.0]}, varies={"WN": "1 + rate"})
    with raises(OptionError, argument="varies"):
        gmwm.fit("WN", data[0.0], varies={"WN": "1"})
    with raises(OptionError, argument="against"):
        gmwm.fit("WN", data, against="time")
    with raises(OptionError, argument="data"):
        gmwm.fit("WN", {0.0: data[0.0]})


def test_functions_are_read():
    varied = Varies.parse("1 + abs(rate) + rate**2")
    assert varied.condition == "rate"
    conditions = np.array([[-2.0], [0.0], [3.0]])
    assert varied.means(conditions, "WN").tolist() == [[1, 1, 1], [2, 0, 3], [4, 0, 9]]
    bins = np.array([[0.0, 2.0], [-2.0, -2.0], [3.0, 3.0]])
    assert varied.means(bins, "WN")[:, 0].tolist() == [1, 1, 2]
