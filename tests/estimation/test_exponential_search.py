"""Fits of exponential autocovariances in the kernel equal those of the open search, which takes any process."""

import warnings
from dataclasses import dataclass, replace

import numpy as np
import pytest

import gmwm
from gmwm.base import _core
from gmwm.base.errors import FitWarning
from gmwm.fitting.estimation.branch_and_bound import LIMITS, Search
from gmwm.fitting.estimation.exponential_search import ExponentialSearch, search_of
from gmwm.fitting.estimation.problem import pose
from gmwm.fitting.estimation.solver import follow, model_of, solve
from gmwm.fitting.estimation.weighting import weighting_matrix
from gmwm.theory.processes import AR1, DR, GM, QN, RW, WN, Model, exponential_sum
from tests.helpers import each
from tests.oracles import exponential as twin

RATE = 100.0
H = np.ldexp(1.0, np.arange(30))


def _open(kind):
    """The same process, of which the search does not state the form of its autocovariance."""

    class Open(kind, register=False):
        @classmethod
        def search(cls, samples, rate):
            return tuple(replace(branch, exponential=None) for branch in kind.search(samples, rate))

    return dataclass(frozen=True, repr=False)(Open)


OpenGM, OpenAR1 = _open(GM), _open(AR1)


def _curve(truth, samples, seed):
    return gmwm.wavelet_variance(Model.parse(truth).simulate(samples, RATE, seed), RATE)


CURVES = {
    "reference": _curve(
        "GM(beta=10, sigma2=2e-7) + GM(beta=0.5, sigma2=3e-8) + GM(beta=0.02, sigma2=3e-8) + WN(sigma2=1e-6)"
        " + QN(q2=2e-6) + RW(gamma2=1e-13)", 300_000, 1,
    ),
    "walk": _curve("WN(sigma2=1) + RW(gamma2=1e-3)", 20_000, 2),
    "alternating": _curve("AR1(phi=-0.7, sigma2=1) + AR1(phi=0.99, sigma2=0.1)", 30_000, 3),
    "drift": _curve("WN(sigma2=1) + GM(beta=0.3, sigma2=0.1) + DR(omega=-1e-4)", 50_000, 4),
    "exact": gmwm.WaveletVariance.from_values(
        Model.parse("GM(beta=2, sigma2=1) + WN(sigma2=3)").wavelet_variance(15, RATE),
        100_000, RATE,
    ),
}  # fmt: skip
_GAPS = Model.parse("GM(beta=1, sigma2=1) + WN(sigma2=2)").simulate(40_000, RATE, 5)
CURVES["gaps"] = gmwm.wavelet_variance(
    gmwm.Signal(_GAPS, RATE, segments=((0, 9_000), (9_000, 20_000), (20_000, 20_010), (20_010, 40_000)), filled=30)
)
CURVES["beyond the model"] = replace(
    CURVES["walk"], excess=0.05**2 * (np.eye(len(CURVES["walk"])) + 0.5), model_error=0.03
)


def _quietly(*args, **kwargs):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        return gmwm.fit(*args, **kwargs)


MODELS = {
    "3*GM + WN + QN + RW": lambda gm, ar1: (gm(), gm(), gm(), WN(), QN(), RW()),
    "GM + WN + DR": lambda gm, ar1: (gm(), WN(), DR()),
    "GM + RW": lambda gm, ar1: (gm(beta=0.1), RW()),
    "2*AR1 + WN": lambda gm, ar1: (ar1(), ar1(), WN()),
}


# Where a model is far from the data, the iterated weights end with a change of up to 1e-6, not at a fixed point.
ITERATED = ("3*GM + WN + QN + RW", "2*AR1 + WN")


CASES = [
    (model, weighting, name)
    for model in MODELS
    for weighting in ("identity", "of the data", *(("diagonal", "optimal") if model in ITERATED else ()))
    for name in CURVES
    # The open search of two autoregressions takes seconds on the longest recording.
    if (model, name) != ("2*AR1 + WN", "reference")
]


@pytest.mark.slow
@each(("model", "weighting", "name"), CASES)
def test_both_paths_reach_the_same_optimum(model, weighting, name):
    wv, terms = CURVES[name], MODELS[model]
    weighting = weighting_matrix("diagonal", wv) if weighting == "of the data" else weighting
    ours = _quietly(Model(terms(GM, AR1)), wv, weighting=weighting)
    open_one = _quietly(Model(terms(OpenGM, OpenAR1)), wv, weighting=weighting)
    np.testing.assert_allclose(ours.implied, open_one.implied, rtol=1e-12)
    # The covariances of the two paths, which iterated weights use, differ by rounding errors.
    close = 1e-11 if isinstance(weighting, str) else 1e-12
    # The objective of exact data is the square of rounding errors.
    exact = float(wv.variance @ ours.weighting_matrix @ wv.variance) * 1e-26
    assert ours.objective == pytest.approx(open_one.objective, rel=close, abs=exact)
    if name != "exact":  # there, rounding errors decide what a superfluous term acts as
        assert ours.diagnostics.acts_as == open_one.diagnostics.acts_as
    # White noise and a Gauss-Markov term that acts as white noise are equal to rounding errors.
    assert len(ours.diagnostics.not_supported) == len(open_one.diagnostics.not_supported)
    # Both bounds are valid; how far each search went beyond the gap is decided by rounding.
    assert ours.lower_bound == pytest.approx(open_one.lower_bound, rel=LIMITS.certified_gap, abs=exact)


@each(("gm", "moved"), [(gm, moved) for gm in (GM, OpenGM) for moved in (-1.5, -0.3, 0.3, 1.5)])
def test_an_optimum_is_followed_however_far_other_weights_move_it(gm, moved):
    # Iterated weights converge slowly, or not at all, if each step ends before the optimum for its weights.
    wv = CURVES["drift"]
    search = search_of(pose(gm() + WN() + DR(), wv, weighting_matrix("diagonal", wv)))
    best = search.optimum(certify=False).best
    ((branch, u),) = best.places
    followed = search.follow([(branch, u + moved)])
    assert followed.places[0][1] == pytest.approx(u, abs=1e-9)
    assert followed.objective == pytest.approx(best.objective, rel=1e-12)


@each("gm", [GM, OpenGM])
def test_fits_begin_at_the_values_of_a_model_unless_one_is_zero(gm):
    wv = CURVES["reference"]
    weights = weighting_matrix("diagonal", wv)
    found = solve(pose(3 * gm() + WN() + QN() + RW(), wv, weights), certify=False)
    model = model_of(pose(3 * gm() + WN() + QN() + RW(), wv, weights), found, None)
    near = follow(pose(model, wv, weights))
    assert near.nodes == 0 < found.nodes
    assert near.objective == pytest.approx(found.objective, rel=1e-9)
    terms = [p.with_scale(0.0) if k == 0 else p for k, p in enumerate(model.processes)]
    assert follow(pose(Model(tuple(terms)), wv, weights)).objective == pytest.approx(found.objective, rel=1e-9)


def test_the_kernel_is_used_where_the_search_states_an_exponential_and_the_filter_is_haar():
    wv = CURVES["walk"]
    matrix = weighting_matrix("diagonal", wv)
    assert type(search_of(pose(GM() + WN(), wv, matrix))) is ExponentialSearch
    assert type(search_of(pose(OpenGM() + WN(), wv, matrix))) is Search
    other = gmwm.wavelet_variance(np.random.default_rng(1).normal(size=1000), RATE, filter="d4")
    assert type(search_of(pose(GM() + WN(), other, weighting_matrix("diagonal", other)))) is Search


def test_shapes_in_the_kernel_are_those_of_the_twin():
    decays = np.concatenate([np.geomspace(1e-200, 0.9, 60), np.geomspace(0.9, 1e4, 60)])
    np.testing.assert_allclose(exponential_sum.gm_shape(decays, H), twin.gm_shape(decays, H), rtol=2e-14)
    np.testing.assert_allclose(exponential_sum.gm_slope(decays, H), twin.gm_slope(decays, H), rtol=2e-12)
    coefficients = np.concatenate([-np.exp(-np.geomspace(1e-8, 30, 60)), [0.0], np.exp(-np.geomspace(1e-8, 30, 60))])
    np.testing.assert_allclose(exponential_sum.ar1_shape(coefficients, H), twin.ar1_shape(coefficients, H), rtol=2e-14)
    np.testing.assert_allclose(
        exponential_sum.ar1_slope(coefficients, H), twin.ar1_slope(coefficients, H), rtol=2e-12, atol=1e-300
    )


def test_the_kernel_refuses_what_does_not_fit_together():
    numbers, root = np.ones(3), np.eye(3)
    branch = np.array([[0.0, 1.0, 1e-3, 1e-8, 1.0, 0.0, 0.0]])
    with pytest.raises(ValueError, match="length of the target"):
        _core.ExponentialSearch(
            numbers, np.ones((1, 2)), root, 0.0, numbers, branch, 1.0, False, np.ones(8), np.ones(2)
        )
    with pytest.raises(ValueError, match="branch"):
        _core.ExponentialSearch(
            numbers, np.ones((1, 3)), root, 0.0, numbers, branch[:, :5].copy(), 1.0, False, np.ones(8), np.ones(2)
        )
    search = _core.ExponentialSearch(
        numbers, np.ones((1, 3)), root, 0.0, numbers, branch, 1.0, False, np.ones(8), np.ones(2)
    )
    with pytest.raises(ValueError, match="no such branch"):
        search.follow(np.array([1]), np.array([0.5]), False)
    rows, owner = np.ones((2, 3)), np.zeros(2, dtype=np.int64)
    with pytest.raises(ValueError, match="as many owners"):
        _core.WeightedTable(root, numbers, owner, np.arange(3.0), np.ones(1), rows, rows, rows[:1], 2.0, 12)
    with pytest.raises(ValueError, match="one after the other"):
        _core.WeightedTable(root, numbers, owner + 1, np.arange(2.0), np.ones(1), rows, rows, rows[:1], 2.0, 12)
    table = _core.WeightedTable(root, numbers, owner, np.arange(2.0), np.ones(1), rows, rows, rows[:1], 2.0, 12)
    with pytest.raises(ValueError, match="on the curve"):
        search.solve(table, 1, 10, np.array([1.5]))
    with pytest.raises(ValueError, match="levels and the branches"):
        search.solve(table, 0, 10, np.empty(0))
    with pytest.raises(ValueError, match="out must have"):
        _core.exponential_shapes(numbers, numbers, np.empty((3, 2)))
