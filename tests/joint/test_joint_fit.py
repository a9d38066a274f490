"""A model of several signals at once: estimates, errors, tests, state space, what a user sees."""

import json
import pickle

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm.applications.several import fit_joint
from gmwm.applications.several.plots import plot_joint
from gmwm.applications.several.search import _derivatives, joint_terms
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.showing.plots.figure import description

RATE = 100.0
AXES = ("gyro_x", "gyro_y", "gyro_z")
CORRELATION = np.array([[1.0, 0.6, 0.2], [0.6, 1.0, -0.3], [0.2, -0.3, 1.0]])


def signals(seed=1, n=8192, correlation=CORRELATION, markov=0.0):
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(correlation + 1e-12 * np.eye(3))
    x = rng.standard_normal((3, n)) + np.cumsum(0.03 * root @ rng.standard_normal((3, n)), axis=1)
    if markov:
        phi = np.exp(-markov / RATE)
        start = rng.standard_normal(1)
        slow = lfilter([np.sqrt(1 - phi**2)], [1, -phi], rng.standard_normal(n), zi=phi * start)[0]
        x += np.outer([1.0, -1.0, 0.5], slow)
    return dict(zip(AXES, x, strict=True))


@pytest.fixture(scope="module")
def fitted():
    return fit_joint("WN + shared(RW)", signals(), RATE)


def test_the_estimates_lie_within_their_errors(fitted):
    for term, truth in (("WN", np.eye(3)), ("RW", 9e-4 * CORRELATION)):
        error = fitted.standard_errors[term]
        free = error > 0
        assert np.all(np.abs(fitted.covariances[term] - truth)[free] < 4 * error[free])
    low, high = fitted.correlation_interval("RW", 0.999)
    assert np.all((low <= CORRELATION + 1e-9) & (high >= CORRELATION - 1e-9))
    assert fitted.goodness_of_fit().pvalue > 0.001
    assert fitted.shared("RW").pvalue < 1e-6
    assert fitted.shared("RW").df == 3
    assert fitted.lower_bound == pytest.approx(fitted.objective, rel=1e-8)


def test_independent_noise_is_not_shared():
    found = fit_joint("shared(WN) + shared(RW)", signals(2, correlation=np.eye(3)), RATE)
    assert found.shared("RW").pvalue > 0.001
    assert found.shared("WN").pvalue > 0.001
    assert np.all(np.abs(found.correlation["WN"] - np.eye(3)) < 0.06)


def test_order_and_units_do_not_matter(fitted):
    x = signals()
    turned = fit_joint("shared(RW) + WN", dict(reversed(x.items())), RATE)
    assert turned.objective == pytest.approx(fitted.objective, rel=1e-6)
    assert np.allclose(turned.covariances["RW"][::-1, ::-1], fitted.covariances["RW"], rtol=1e-5, atol=1e-8)
    for unit in (1e-12, 1e9):
        scaled = fit_joint("WN + shared(RW)", {axis: unit * v for axis, v in x.items()}, RATE)
        assert scaled.objective == pytest.approx(fitted.objective, rel=1e-6)
        assert np.allclose(scaled.covariances["RW"], unit**2 * fitted.covariances["RW"], rtol=1e-5)
    mixed = fit_joint("WN + shared(RW)", {axis: 10.0**k * v for k, (axis, v) in enumerate(x.items())}, RATE)
    assert np.allclose(mixed.correlation["RW"], fitted.correlation["RW"], atol=1e-5)


def test_own_terms_are_the_fits_of_single_signals():
    x = signals(3, correlation=np.eye(3))
    found = fit_joint("WN + RW", x, RATE)
    for axis, values in x.items():
        wv = gmwm.wavelet_variance(values, RATE, levels=int(found.levels[-1]))
        alone = gmwm.fit("WN + RW", wv, weighting="optimal")
        scale = np.array(list(alone.parameters.values()))
        at = AXES.index(axis)
        mine = np.array([found.covariances["WN"][at, at], found.covariances["RW"][at, at]])
        # Under joint weights the cross-covariances add a little, of chance only.
        assert np.allclose(mine, scale, rtol=0.15)


@pytest.mark.slow
def test_a_common_process_has_loadings():
    found = fit_joint("common(GM) + WN + RW", signals(4, n=1 << 15, correlation=np.eye(3), markov=2.0), RATE)
    loadings = found.loadings["GM"]
    assert np.linalg.matrix_rank(found.covariances["GM"], tol=1e-9) == 1
    assert np.allclose(loadings / loadings[0], [1.0, -1.0, 0.5], atol=0.25)
    assert found.parameters["GM.beta"] == pytest.approx(2.0, abs=4 * found.parameter_errors["GM.beta"])
    assert found.lower_bound is None
    whole = fit_joint("shared(GM) + WN + RW", signals(4, n=1 << 15, correlation=np.eye(3), markov=2.0), RATE)
    assert whole.objective < found.objective * 1.3
    assert whole.correlation["GM"][0, 1] < -0.7


@pytest.mark.slow
def test_the_derivatives_are_those_of_the_objective():
    problem = fit_joint("shared(GM) + WN", signals(4, markov=2.0), RATE).settled.problem
    u = np.array([np.log(0.02)])
    gradient, _ = _derivatives(problem, u, problem.solve(u, gap=1e-11))
    step = 1e-4
    high, low = (problem.solve(u + s, gap=1e-11).objective for s in (step, -step))
    assert gradient[0] == pytest.approx((high - low) / (2 * step), rel=1e-4)


def test_the_state_space_has_the_fitted_covariances(fitted):
    space = fitted.state_space()
    assert space.H.shape == (3, 3)
    assert space.terms == ("RW",) * 3
    rng = np.random.default_rng(1)
    for weights in (*np.eye(3), rng.normal(size=3)):
        expected = np.einsum("a,jab,b->j", weights, fitted.implied, weights)
        assert np.allclose(space.along(weights).haar_variance(fitted.levels), expected, rtol=1e-9)
        assert fitted.models["gyro_x"].wavelet_variance(fitted.levels, RATE) == pytest.approx(fitted.implied[:, 0, 0])
    whole = fitted.continuous()
    assert np.allclose(whole.H @ whole.Qc @ whole.H.T, fitted.covariances["RW"] * RATE)
    assert np.allclose(whole.Rc, fitted.covariances["WN"] / RATE)
    discrete = whole.discrete(RATE)
    for name in ("F", "Q", "H", "R", "P0"):
        assert np.allclose(getattr(discrete, name), getattr(space, name), rtol=1e-12)
    assert (discrete.axes, discrete.terms) == (space.axes, space.terms)
    weights = rng.normal(size=3)
    expected = np.einsum("a,jab,b->j", weights, fitted.implied, weights)
    assert np.allclose(whole.along(weights).discrete(RATE).haar_variance(fitted.levels), expected, rtol=1e-9)
    assert whole.to_dict().keys() == {"A", "Qc", "H", "Rc", "P0", "diffuse", "axes", "terms", "left_out"}


@pytest.mark.slow
def test_the_continuous_form_of_slow_noise_has_its_covariances():
    """A Gauss-Markov term sampled at another rate has the covariance matrix and the correlation time of the fit."""
    found = fit_joint("WN + shared(GM) + QN", signals(4, markov=2.0), RATE)
    whole = found.continuous()
    assert whole.left_out == ("QN",)
    start = whole.H @ whole.P0 @ whole.H.T
    assert np.allclose(start, found.covariances["GM"], rtol=1e-9, atol=1e-12)
    assert np.allclose(np.diag(whole.A), -found.parameters["GM.beta"], rtol=1e-9)
    slower = whole.discrete(10.0)
    assert np.allclose(np.diag(slower.F), np.exp(-found.parameters["GM.beta"] / 10), rtol=1e-9)


def test_a_singular_matrix_has_limits_on_one_side():
    found = fit_joint("WN + shared(RW)", signals(5, correlation=np.ones((3, 3))), RATE)
    low, high = found.correlation_interval("RW")
    assert np.all(high[np.triu_indices(3, 1)] == 1)
    assert np.all(low > 0.5)


@pytest.mark.slow
def test_what_a_user_sees(fitted, tmp_path):
    assert json.loads(json.dumps(fitted.to_dict()))["terms"]["RW"]["covariance"][0][0] > 0
    assert "correlation of RW" in fitted.summary()
    assert pickle.loads(pickle.dumps(fitted)).summary() == fitted.summary()
    assert repr(fitted) == "JointFit(gyro_x, gyro_y, gyro_z: WN + shared(RW))"
    fitted.plot(path=tmp_path / "joint.png")
    assert (tmp_path / "joint.png").stat().st_size > 10_000
    titles = [panel.title for panel in description(plot_joint)(fitted).panels]
    assert titles[:3] == ["Gyroscope X", "Gyroscope X, Y", "Gyroscope Y"]
    with pytest.raises(OptionError):
        fitted.shared("GM")


def test_terms():
    terms = joint_terms("common(RW) + 2*GM + shared(GM(beta=fixed(1e-3))) + WN + RW")
    assert [term.label for term in terms] == ["common(RW)", "GM[1]", "GM[2]", "shared(GM)", "WN", "RW"]
    assert [term.branch is None for term in terms] == [True, False, False, True, True, True]
    assert [term.label for term in joint_terms("2*shared(GM) + shared(WN + RW)")] == ["GM[1]", "GM[2]", "WN", "RW"]


@pytest.mark.parametrize(
    "model", ["WN + VN", "WN + DR", "SIN + WN", "WN + WN", "common(WN", "WN(sigma2=fixed(1.0)) + RW", "AR(2) + WN"]
)
def test_models_that_cannot_be_joint_are_refused(model):
    with pytest.raises(ModelError):
        fit_joint(model, signals(n=512), RATE)


def test_data_and_options_are_checked():
    x = signals(n=512)
    for options in ({"axes": "accel"}, {"axes": ["gyro_x"]}, {"levels": [99]}, {"levels": []}):
        with pytest.raises(OptionError):
            fit_joint("WN", x, RATE, **options)
    with pytest.raises(DataError):
        fit_joint("WN + RW + 2*GM", signals(n=64), RATE)
    with pytest.raises(DataError):
        fit_joint("WN", {f"a{k}": np.random.default_rng(k).normal(size=64) for k in range(13)}, RATE)
    assert fit_joint("WN", x, RATE, axes="gyro", levels=5).levels.tolist() == [1, 2, 3, 4, 5]
    with pytest.raises(ModelError):
        fit_joint("common(WN)", x, RATE)


def test_weights_that_do_not_converge_are_taken_from_the_data():
    rng = np.random.default_rng(3)
    root = np.linalg.cholesky(0.5 * np.eye(3) + 0.5)
    phi = np.exp(-0.02)
    slow = lfilter([np.sqrt(1 - phi**2)], [1, -phi], root @ rng.standard_normal((3, 30_000)), axis=1)
    own = rng.standard_normal((3, 30_000)) + np.diff(rng.uniform(-1, 1, (3, 30_001)), axis=1)
    x = own + 0.7 * slow + 0.3 * root @ np.cumsum(0.03 * rng.standard_normal((3, 30_000)), axis=1)
    found = fit_joint("common(RW) + GM + WN + QN", dict(zip(AXES, x, strict=True)), RATE)
    assert not found.converged
    assert "did not converge" in found.summary()
    assert found.goodness_of_fit().pvalue < 1e-6
    walk = np.diag(found.covariances["RW"])
    assert np.all((walk > 2e-5) & (walk < 4e-4))  # 8.1e-5


def test_the_residual_of_independent_wishart_matrices_has_the_stated_variance():
    """The formula in `misfit`, with η = 12 coefficients of three signals."""
    rng = np.random.default_rng(1)
    x = rng.standard_normal((40_000, 12, 3))
    apart = np.einsum("nta,ntb->nab", x, x) / 12 - np.eye(3)
    residual = 6 * np.einsum("nab,nba->n", apart, apart)
    assert np.mean(residual) == pytest.approx(6, abs=0.1)
    assert np.var(residual) == pytest.approx(12 + 3 * (18 + 15 + 5) / 12, rel=0.06)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ("GM + shared(RW", '"(" at character 12 without ")"'),
        ("shared(RW)) + WN", '")" at character 11 without "("'),
        ("GM + shared RW", "shared needs parentheses"),
        ("shared(common(RW))", "common(…) cannot be inside another term"),
        ("GM + foo", 'the model "GM + foo" is wrong'),
        ("GM + ", "is empty"),
        ("2*shared(RW)", "shared(RW) twice"),
    ],
)
def test_a_wrong_model_is_named_with_its_place(model, words):
    with pytest.raises(ModelError) as caught:
        joint_terms(model)
    assert words in str(caught.value)
    assert caught.value.advice


def test_the_summary_has_units_and_writes_an_absent_term_as_zero():
    truth = {"gyro_x": "WN(sigma2=1e-6)", "gyro_y": "WN(sigma2=1e-6) + GM(beta=5.0, sigma2=1e-6)"}
    found = fit_joint("GM + WN", gmwm.simulate(truth, rate=100.0, samples=60_000, rng=1))
    lines = [line.split() for line in found.summary().splitlines()]
    (row,) = (line for line in lines if line[:1] == ["GM.sigma2"])
    assert row[-1] == "(rad/s)²"
    assert (row[1] == "0") == (found.covariances["GM"][0, 0] < 1e-9 * found.covariances["GM"][1, 1])
    assert "1/s (standard error" in found.summary()
