"""A fit is read back from JSON to the last bit; values that are not a fit are refused."""

import json

import numpy as np
import pytest

import gmwm
from gmwm import Fit, WaveletVariance
from gmwm.base.errors import ReadError
from tests.helpers import each, raises

MODELS = {
    "GM + WN + RW": "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6) + RW(gamma2=1e-10)",
    "2*GM + WN": "GM(beta=8.0, sigma2=3e-6) + GM(beta=0.1, sigma2=2e-6) + WN(sigma2=1e-6)",
    "WN(sigma2=fixed(4e-6)) + DR": "WN(sigma2=4e-6) + DR(omega=-3e-7)",
    "AR1 + QN": "AR1(phi=0.97, sigma2=1e-6) + QN(q2=1e-5)",
}


def through_json(fit):
    return Fit.from_dict(json.loads(json.dumps(fit.to_dict(), allow_nan=False)))


@pytest.fixture(scope="module")
def fits():
    found = {}
    for seed, (wanted, truth) in enumerate(MODELS.items()):
        x = gmwm.Model.parse(truth).simulate(50_000, 100.0, rng=seed)
        wv = gmwm.wavelet_variance(gmwm.Signal(x, 100.0, "rad/s", "gyro_x"))
        found[wanted] = gmwm.fit(wanted, wv, weighting="optimal")
    return found


@pytest.mark.parametrize("wanted", MODELS)
def test_every_field_comes_back(fits, wanted):
    fit = fits[wanted]
    back = through_json(fit)
    assert back.to_dict() == fit.to_dict()
    assert back.model.processes == fit.model.processes
    assert back.model.fixed_names == fit.model.fixed_names
    assert back.parameters == fit.parameters
    assert list(back.parameters) == list(fit.parameters)
    assert back.diagnostics == fit.diagnostics
    assert (back.objective, back.lower_bound, back.relaxed_bound) == (
        fit.objective,
        fit.lower_bound,
        fit.relaxed_bound,
    )
    for name in ("implied", "weighting_matrix"):
        assert np.array_equal(getattr(back, name), getattr(fit, name))
        assert not getattr(back, name).flags.writeable


@pytest.mark.parametrize("wanted", MODELS)
def test_what_follows_from_it_is_the_same(fits, wanted):
    fit = fits[wanted]
    back = through_json(fit)
    assert back.gap == fit.gap
    assert back.confidence_intervals() == fit.confidence_intervals()
    assert back.goodness_of_fit().pvalue == fit.goodness_of_fit().pvalue
    assert back.summary() == fit.summary()


def test_a_sign_and_a_held_value_stay(fits):
    back = through_json(fits["WN(sigma2=fixed(4e-6)) + DR"])
    assert back.parameters["DR.omega"] < 0
    assert back.model.fixed_names == {"WN.sigma2"}


def test_without_a_certificate_and_with_terms_that_are_zero():
    x = gmwm.Model.parse("WN(sigma2=4e-6)").simulate(5000, 100.0, rng=2)
    with pytest.warns(gmwm.errors.FitWarning):
        fit = gmwm.fit("GM + WN + QN", x, rate=100.0, certify=False)
    back = through_json(fit)
    assert back.lower_bound is None
    assert back.gap is None
    assert back.diagnostics == fit.diagnostics
    assert back.undetermined == fit.undetermined


def test_robust_diagnostics_come_back():
    x = gmwm.Model.parse("WN(sigma2=4e-6)").simulate(5000, 100.0, rng=2)
    fit = gmwm.fit("WN", x, rate=100.0, robust=True, efficiency=0.8)
    wv = through_json(fit).wavelet_variance
    assert (wv.robust, wv.efficiency) == (True, 0.8)
    assert wv.remarks == fit.wavelet_variance.remarks
    assert wv.to_dict() == fit.wavelet_variance.to_dict()


def test_published_values_have_no_slope():
    fit = gmwm.fit("WN", WaveletVariance.from_values([0.5, 0.25, 0.12], samples=1000, rate=100.0))
    assert through_json(fit).wavelet_variance.slope is None


def broken(values, **changes):
    return {name: value for name, value in {**values, **changes}.items() if value is not ...}


@pytest.mark.parametrize(
    ("changes", "fact"),
    [
        ({"model": ...}, "'model'"),
        ({"wavelet_variance": ...}, "'wavelet_variance'"),
        ({"wavelet_variance": None}, "None"),
        ({"model": "WN + XY"}, "XY"),
        ({"model": "WN(sigma2=1.0)"}, "parameters"),
        ({"implied": [1.0]}, "levels"),
        ({"implied": "abc"}, "abc"),
        ({"weighting_matrix": [[1.0]]}, "weighting matrix"),
        ({"decomposition": {}}, "decomposition"),
        ({"objective": None}, "null"),
    ],
)
def test_values_that_are_not_a_fit_are_refused(fits, changes, fact):
    values = fits["GM + WN + RW"].to_dict()
    with raises(ReadError, fact):
        Fit.from_dict(broken(values, **changes))


@pytest.mark.parametrize("name", ["variance", "lower", "upper", "counts"])
@pytest.mark.parametrize("change", [lambda one: one[:1], lambda one: [one], lambda one: [*one, one[-1]]])
def test_a_curve_has_one_number_for_each_level(fits, name, change):
    values = fits["GM + WN + RW"].to_dict()
    curve = values["wavelet_variance"]
    with raises(ReadError, name):
        Fit.from_dict({**values, "wavelet_variance": {**curve, name: change(curve[name])}})


@pytest.mark.slow
@each("number", [1e308, -1e200, 10**400])
@each("name", ["model_error", "rate", "variance", "samples", "filled", "rise"])
def test_a_number_whose_square_overflows_is_refused(fits, name, number):
    values = fits["GM + WN + RW"].to_dict()
    curve = values["wavelet_variance"]
    changed = [*curve[name][:-1], number] if name == "variance" else number
    with raises(ReadError):
        Fit.from_dict({**values, "wavelet_variance": {**curve, name: changed}})


def with_one(numbers, value):
    """Replace the last of some numbers, or the number."""
    return [*numbers[:-1], value] if isinstance(numbers, list) else value


ABSURD = {
    "samples": [0, -1, 1e400, 10**30],
    "rate": [0, -1.0, float("nan")],
    "counts": [0, -1, 10**18],
    "levels": [0, -1, 63],
    "variance": [-1e-300, float("nan")],
    "lower": [-1.0, float("nan")],
    "upper": [-1.0, float("nan")],
    "filled": [-1, 10**30, 10**7],
    "efficiency": [0.0, 1.0, 0.5],
    "confidence": [0, 1, -1],
    "model_error": [-0.1, float("nan")],
    "segments": [[0], [-1, 10], [10**20], [1] * 10, [2999]],
    "strides": [[0] * 40, [-1], [10**30] * 40],
    "excess": [[[1.0]], "x"],
}


@each(("name", "value"), [(name, value) for name, values in ABSURD.items() for value in values])
def test_a_curve_that_no_recording_has_is_refused(fits, name, value):
    values = fits["GM + WN + RW"].to_dict()
    curve = values["wavelet_variance"]
    with raises(ReadError):
        Fit.from_dict({**values, "wavelet_variance": {**curve, name: with_one(curve[name] or value, value)}})


@pytest.mark.parametrize(
    "change",
    [
        lambda matrix: -matrix,
        lambda matrix: matrix * np.nan,
        lambda matrix: matrix + np.triu(np.ones_like(matrix), 1) * matrix.max(),
        lambda matrix: matrix - 2 * np.diag(np.diag(matrix)[:1].tolist() + [0.0] * (len(matrix) - 1)),
        lambda matrix: np.sqrt(np.outer(np.diag(matrix), np.diag(matrix))) * (2 - np.eye(len(matrix))),
    ],
)
def test_weights_that_are_no_covariance_are_refused(fits, change):
    values = fits["GM + WN + RW"].to_dict()
    matrix = np.array(values["weighting_matrix"])
    with raises(ReadError, "weighting_matrix"):
        Fit.from_dict({**values, "weighting_matrix": change(matrix).tolist()})


@pytest.mark.parametrize("name", ["implied", "decomposition"])
def test_a_negative_variance_of_a_model_is_refused(fits, name):
    values = fits["GM + WN + RW"].to_dict()
    part = values[name]
    wrong = with_one(part, -1.0) if name == "implied" else {**part, "WN": with_one(part["WN"], -1.0)}
    with raises(ReadError, name):
        Fit.from_dict({**values, name: wrong})


@pytest.mark.parametrize("values", [[], "text", 3, None, {}])
def test_other_things_are_refused(values):
    with raises(ReadError, "fit", advises=["to_dict()"]):
        Fit.from_dict(values)
