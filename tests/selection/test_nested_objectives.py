"""A model that contains another never has a larger objective, under the one Ω of a ranking."""

from __future__ import annotations

from pathlib import Path

import pytest

import gmwm
from gmwm import OSC
from gmwm.choosing.selection.api import select_within
from gmwm.choosing.selection.ranking import RankingOptions
from gmwm.choosing.selection.structure import structure_of
from gmwm.theory.processes.parameter import Fixed

DATA = Path(__file__).parents[2].parent / "shared" / "data"
UNITS = {"gyro": "deg/s", "accel": "g"}
GENERAL = "3*GM + WN + QN + RW + DR"
NOISE = 1e-9
"""Objectives that differ by less (relative) are one."""


def steps_up(ranking):
    """Pairs of a model and a part of it that has the smaller objective, and how many pairs there were."""
    known = [(structure_of(c.model), c) for c in ranking]
    pairs = [(whole, part) for a, whole in known for b, part in known if b < a]
    wrong = [
        f"{whole.structure}: {whole.fit.objective} > {part.fit.objective} of {part.structure}"
        for whole, part in pairs
        if whole.fit.objective > part.fit.objective * (1 + NOISE)
    ]
    return wrong, len(pairs)


@pytest.mark.slow
@pytest.mark.parametrize("weighting", ["optimal", "diagonal"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_on_simulated_recordings(seed, weighting):
    truth = gmwm.Model.parse("GM(beta=5.0, sigma2=1.0) + GM(beta=0.05, sigma2=0.3) + WN(sigma2=4.0) + RW(gamma2=1e-7)")
    ranking = gmwm.select(GENERAL, truth.simulate(30_000, 100.0, rng=seed), 100.0, weighting=weighting)
    wrong, pairs = steps_up(ranking)
    # Of 4·2⁴ sums, the empty one too: Σ over a ≤ b of one is (10·3⁴) pairs; less the equal ones and the empty one's.
    assert pairs == 10 * 3**4 - 64 - 63
    assert wrong == []


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
@pytest.mark.parametrize("weighting", ["optimal", "diagonal"])
def test_a_candidate_has_the_objective_of_a_fit_by_itself(weighting):
    truth = gmwm.Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=4.0) + QN(q2=1.0)")
    wv = gmwm.wavelet_variance(truth.simulate(30_000, 100.0, rng=4), 100.0)
    ranking = gmwm.select("2*GM + WN + QN + RW", wv, weighting=weighting)
    for candidate in ranking:
        alone = gmwm.fit(candidate.model, wv, weighting=ranking.weighting_matrix)
        assert candidate.fit.objective == pytest.approx(alone.objective, rel=1e-5)
        assert candidate.fit.objective >= alone.lower_bound * (1 - 1e-6)


def test_terms_of_fixed_power_may_leave_nothing_to_estimate():
    """Two oscillators have too much power in the spectrum, so that all other terms of a candidate are zero."""
    fixed = [
        OSC(frequency=Fixed(frequency), quality=Fixed(quality), sigma2=Fixed(1.0))
        for frequency, quality in ((5.8, 300.0), (2.7, 2000.0))
    ]
    wv = gmwm.WaveletVariance.from_values(
        0.8 * gmwm.Model(tuple(fixed)).wavelet_variance(12, rate=100.0), samples=200_000, rate=100.0
    )
    free = OSC(frequency=Fixed(3.5), quality=Fixed(50.0))
    ranking = select_within("GM + WN + RW", wv, RankingOptions(), required=(free, *fixed))
    assert all(candidate.fit.objective > 0 for candidate in ranking)


@pytest.mark.slow
@pytest.mark.skipif(not DATA.exists(), reason="the recordings of shared/data are not here")
@pytest.mark.parametrize(("number", "weighting"), [(1, "diagonal"), (3, "optimal")])
def test_on_all_axes_of_real_recordings(number, weighting):
    imu = gmwm.read(DATA / f"adis16405_static_{number}.parquet", rate=100, units=UNITS)
    assert len(list(imu)) == 6
    for axis in imu:
        wrong, pairs = steps_up(gmwm.select(GENERAL, imu[axis], weighting=weighting))
        assert pairs == 683, axis
        assert wrong == [], axis
