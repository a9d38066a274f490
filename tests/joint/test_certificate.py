"""The lower bound of a joint fit: below every fit, close to the best one, and safe between the nodes of its table."""

import time
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from gmwm.applications.several import fit_joint
from gmwm.applications.several.certificate import LARGEST_GAP, Prover
from gmwm.applications.several.search import descend
from gmwm.base.errors import OptionError
from tests.helpers import raises
from tests.joint.test_joint_fit import RATE, signals


@pytest.fixture(scope="module")
def problem():
    x = dict(list(signals(4, markov=2.0).items())[:2])
    return fit_joint("shared(GM) + WN + RW", x, RATE).settled.problem


def test_the_table_bounds_the_error_of_its_cubics(problem):
    prover = Prover(problem)
    (curve,) = prover.curves
    weights = prover.own.mean(axis=0)
    share = np.random.default_rng(1).random(curve.nodes.size - 1)
    u = curve.nodes[:-1] + share * np.diff(curve.nodes)
    exact = curve.kind.shape(curve.branch.values(u), problem.design.levels, problem.design.rate)
    exact /= (exact @ weights)[:, None]
    t = share[:, None]
    bernstein = np.stack([(1 - t) ** 3, 3 * t * (1 - t) ** 2, 3 * t**2 * (1 - t), t**3], axis=1)
    cubic = np.sum(bernstein * curve.controls, axis=1)
    assert np.all(np.abs(cubic - exact) <= curve.margin)
    assert np.max(curve.margin / exact) < 1e-5


@pytest.mark.slow
def test_the_bound_of_an_interval_is_below_every_fit_in_it(problem):
    prover = Prover(problem)
    (curve,) = prover.curves
    ends = np.linspace(0.0, curve.length[-1], 9)
    for low, high in pairwise(ends):
        bound, _ = prover.bound(((low, high),), 0.0)
        inside = curve.at(np.linspace(low, high, 15))
        best = min(problem.solve(np.array([u])).objective for u in inside)
        assert bound <= best * (1 + 1e-9)
        assert bound > 0.5 * best


@pytest.mark.slow
def test_the_proof_closes_and_no_scan_finds_a_better_fit(problem):
    proof = Prover(problem).prove(descend(problem, np.array([problem.limits[1][0] - 1.0])))
    scanned = min(problem.solve(np.array([u])).objective for u in np.linspace(*np.concatenate(problem.limits), 60))
    assert proof.lower_bound >= proof.best.objective * (1 - 1.001 * LARGEST_GAP)
    assert proof.lower_bound <= proof.best.objective <= scanned * (1 + 1e-9)
    assert proof.relaxed_bound <= proof.lower_bound


@pytest.mark.slow
def test_a_fit_with_a_proof():
    x = dict(list(signals(4, markov=2.0).items())[:2])
    found = fit_joint("shared(GM) + WN + RW", x, RATE, certify=True)
    plain = fit_joint("shared(GM) + WN + RW", x, RATE)
    assert plain.lower_bound is None
    assert found.objective <= plain.objective * (1 + 1e-9)
    assert found.objective * (1 - 1.001 * LARGEST_GAP) <= found.lower_bound <= found.objective
    assert "No other parameters" in found.summary()


@pytest.mark.slow
def test_a_proof_ends_at_its_time_limit_and_says_that_it_proves_nothing():
    x = dict(zip("xy", np.random.default_rng(4).normal(size=(2, 8000)), strict=True))
    slow = lfilter([1.0], [1.0, -0.98], np.random.default_rng(5).normal(size=8000))
    x = {axis: values + share * slow for (axis, values), share in zip(x.items(), (0.3, -0.2), strict=True)}
    begin = time.process_time()
    short = fit_joint("shared(GM) + WN", x, RATE, certify=1e-9)
    assert time.process_time() - begin < 30
    assert 0 <= short.lower_bound < short.objective
    assert not short.proved
    assert "does not prove" in short.summary()
    assert not short.to_dict()["proved"]
    whole = fit_joint("shared(GM) + WN", x, RATE, certify=True)
    assert whole.proved
    assert "does not prove" not in whole.summary()
    with raises(OptionError, argument="certify"):
        fit_joint("shared(GM) + WN", x, RATE, certify=-1.0)
