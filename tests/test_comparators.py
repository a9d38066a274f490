"""The estimators that the wavelet moments are compared with: each against a slow twin, and the study of them all."""

from __future__ import annotations

import doctest
import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import multivariate_normal

import gmwm
from validation import comparators, comparison_words, log_sampled, study_comparison
from validation.__main__ import main
from validation.comparators import allan_covariance, allan_points, slopes, vaccaro_zaki
from validation.log_sampled import BlockLikelihood, log_sampling, most_likely_blocks

pytestmark = pytest.mark.slow

RATE = 100.0
MIXTURE = gmwm.Model.parse(
    "GM(beta=20.0, sigma2=3.0) + GM(beta=0.5, sigma2=2.0) + WN(sigma2=1.5) + QN(q2=0.7) + RW(gamma2=0.02)"
)


@pytest.mark.parametrize("module", [comparators, log_sampled])
def test_examples_run(module) -> None:
    found = doctest.testmod(module)
    assert found.attempted > 0
    assert found.failed == 0


def covariance_of_samples(model: gmwm.Model, samples: int) -> np.ndarray:
    """Of a record whose random walk starts from 0, term by term."""
    t = np.arange(samples)
    away = np.abs(t[:, None] - t)
    total = np.zeros((samples, samples))
    for process in model.processes:
        values = process.values
        if process.name == "GM":
            total += values["sigma2"] * np.exp(-values["beta"] / RATE * away)
        elif process.name == "RW":
            total += values["gamma2"] * (1 + np.minimum(t[:, None], t))
        elif process.name == "QN":
            total += values["q2"] * (2.0 * (away == 0) - (away == 1))
        else:
            total += values["sigma2"] * np.eye(samples)
    return total


@pytest.mark.parametrize("samples", [8, 13, 37, 64, 100])
def test_allan_variances_covary_as_quadratic_forms_do(samples: int) -> None:
    noise, walk = 1.3, 0.07
    truth = gmwm.WN(sigma2=noise) + gmwm.RW(gamma2=walk)
    scatter = covariance_of_samples(truth, samples)
    forms, n = [], 1
    while samples // n >= 2:
        count = samples // n - 1
        rows = np.zeros((count, samples))
        for k in range(count):
            rows[k, k * n : (k + 1) * n], rows[k, (k + 1) * n : (k + 2) * n] = -1 / n, 1 / n
        forms.append(rows.T @ rows / (2 * count))
        n *= 2
    x = np.random.default_rng(1).normal(size=samples)
    np.testing.assert_allclose(allan_points(x), [x @ form @ x for form in forms], rtol=1e-11)
    means = truth.allan_variance(2 ** np.arange(len(forms)), RATE)
    np.testing.assert_allclose([np.trace(form @ scatter) for form in forms], means, rtol=1e-11)
    slow = [[2 * np.trace(one @ scatter @ other @ scatter) for other in forms] for one in forms]
    np.testing.assert_allclose(allan_covariance(noise, walk, samples), slow, rtol=1e-11)


def test_vaccaro_and_zaki_centre_on_the_truth_and_scatter_as_they_say() -> None:
    recordings = 300
    truth = gmwm.WN(sigma2=4e-6) + gmwm.RW(gamma2=1e-9)
    found = [vaccaro_zaki(truth.simulate(5000, RATE, np.random.default_rng(seed))) for seed in range(recordings)]
    exact = np.array([4e-6, 1e-9])
    estimates = np.array([(each.noise, each.walk) for each in found]) / exact
    errors = np.sqrt([np.diag(each.covariance) for each in found]) / exact
    spread = estimates.std(axis=0, ddof=1)
    assert np.all(np.abs(estimates.mean(axis=0) - 1) < 4 * spread / recordings**0.5)
    assert np.all(np.abs(spread / np.median(errors, axis=0) - 1) < 4 / (2 * recordings) ** 0.5)


def test_vaccaro_and_zaki_settle_whatever_the_unit_and_without_a_walk() -> None:
    x = np.random.default_rng(5).normal(size=2000)
    found, small = vaccaro_zaki(x), vaccaro_zaki(1e-6 * x)
    assert found.iterations < 200
    assert abs(found.walk) < 4 * found.covariance[1, 1] ** 0.5
    assert small.noise == pytest.approx(1e-12 * found.noise, rel=1e-6)


def test_block_means_have_the_density_of_a_gaussian_vector() -> None:
    x = MIXTURE.simulate(300, RATE, np.random.default_rng(0))
    blocks = log_sampling(x, each=16)
    assert blocks.lengths[[0, -1]].tolist() == [1, 16]
    means = np.array([np.eye(300)[s : s + n].mean(axis=0) for s, n in zip(blocks.starts, blocks.lengths, strict=True)])
    np.testing.assert_allclose(blocks.means, means @ x, rtol=1e-12)
    apart = np.diff(means, axis=0)
    dense = multivariate_normal(cov=apart @ covariance_of_samples(MIXTURE, 300) @ apart.T).logpdf(apart @ x)
    likelihood = BlockLikelihood(MIXTURE.processes, blocks, RATE)
    at = np.log(list(MIXTURE.parameters.values()))
    value, gradient, information = likelihood.evaluate(at)
    assert value == pytest.approx(dense, rel=1e-10)
    steps = 1e-5 * np.eye(at.size)
    slopes_there = [(likelihood.evaluate(at + s)[0] - likelihood.evaluate(at - s)[0]) / 2e-5 for s in steps]
    np.testing.assert_allclose(gradient, slopes_there, rtol=1e-5, atol=1e-5)
    assert np.all(np.linalg.eigvalsh(information) > 0)


def test_blocks_of_single_samples_have_the_likelihood_of_the_record() -> None:
    x = MIXTURE.simulate(200, RATE, np.random.default_rng(1))
    blocks = log_sampling(x, each=200)
    assert np.all(blocks.lengths == 1)
    value, _, _ = BlockLikelihood(MIXTURE.processes, blocks, RATE).evaluate(np.log(list(MIXTURE.parameters.values())))
    # An exact diffuse start counts log 2π for the sample that it spends on the level, the density of differences not.
    assert value - 0.5 * np.log(2 * np.pi) == pytest.approx(MIXTURE.loglikelihood(x, RATE), rel=1e-9)


def test_the_search_over_block_means_ends_at_a_maximum_and_says_what_it_does_not_see() -> None:
    truth = gmwm.GM(beta=2.0, sigma2=1e-6) + gmwm.WN(sigma2=4e-6)
    x = truth.simulate(20_000, RATE, np.random.default_rng(2))
    found = most_likely_blocks(truth, x, RATE)
    likelihood = BlockLikelihood(truth.processes, log_sampling(x), RATE)
    value, gradient, _ = likelihood.evaluate(np.log(list(found.parameters.values())))
    assert value == pytest.approx(found.loglikelihood)
    assert np.max(np.abs(gradient)) < 2 * log_sampled.FLAT
    assert value > likelihood.evaluate(np.log(list(truth.parameters.values())))[0]
    scaled = most_likely_blocks(truth.with_values({"GM.sigma2": 1e6, "WN.sigma2": 4e6}), 1e6 * x, RATE)
    assert scaled.parameters["GM.sigma2"] == pytest.approx(1e12 * found.parameters["GM.sigma2"], rel=1e-3)
    # Of a walk that is not there the likelihood is largest at zero in half of all records, or in a few more.
    start = gmwm.WN(sigma2=1.0) + gmwm.RW(gamma2=1e-5)
    records = np.random.default_rng(3).normal(size=(20, 1000))
    walks = [most_likely_blocks(start, white, RATE).parameters["RW.gamma2"] for white in records]
    assert 6 <= walks.count(0.0) <= 18


def test_slopes_are_read_where_they_are_told() -> None:
    truth = gmwm.QN(q2=1e-5) + gmwm.WN(sigma2=1e-8) + gmwm.RW(gamma2=1e-12)
    x = truth.simulate(200_000, RATE, np.random.default_rng(4))
    found = slopes(x, RATE, truth, told=True)
    assert set(found) == {"QN.q2", "WN.sigma2", "RW.gamma2"}
    assert found["QN.q2"] == pytest.approx(1e-5, rel=0.05)
    # Not even told: an array and its Allan deviation give the same.
    read = gmwm.avlr(x, RATE, terms=("Q",))
    assert slopes(x, RATE, gmwm.Model.parse("QN"))["QN.q2"] == pytest.approx(read["Q"].coefficient ** 2 * RATE**2)


def test_processes_are_matched_with_the_true_ones() -> None:
    truth = gmwm.Model.parse("GM(beta=10.0, sigma2=3.0) + GM(beta=0.1, sigma2=1.0) + WN(sigma2=2.0)").sorted(RATE)
    slow = {"GM[1].beta": 4000.0, "GM[1].sigma2": 0.0, "GM[2].beta": 0.2, "GM[2].sigma2": 1.0, "WN.sigma2": 2.0}
    fast = {"GM[1].beta": 5.0, "GM[1].sigma2": 3.0, "GM[2].beta": 1e-9, "GM[2].sigma2": 0.0, "WN.sigma2": 0.0}
    white = slow | {"GM[1].sigma2": 0.5, "WN.sigma2": 1.5}
    one, same, other = (study_comparison._errors(truth, found, 10_000) for found in (slow, white, fast))
    assert one == same
    assert one["GM[1].beta"] == one["GM[1].sigma2"] == -np.inf
    assert one["GM[2].beta"] == pytest.approx(np.log(2))
    assert one["WN.sigma2"] == 0
    assert other["GM[1].beta"] == pytest.approx(-np.log(2))
    assert other["GM[2].sigma2"] == other["WN.sigma2"] == -np.inf


def test_methods_stand_as_they_should(tmp_path: Path) -> None:
    assert main(["comparison", "--reduced", "--output", str(tmp_path)]) == 0
    result = json.loads((tmp_path / "comparison.json").read_text(encoding="utf-8"))
    text = (tmp_path / "comparison.md").read_text(encoding="utf-8")
    assert text.startswith("# Comparison of estimators")
    assert study_comparison.table(result).count("\n### ") == 2
    assert (tmp_path / "comparison.svg").stat().st_size > 10_000
    standing = {(row["model"], row["samples"], row["method"]): row for row in result["methods"]}
    for (model, _, method), row in standing.items():
        assert row["time"] > 0
        if method == "GMWM optimal":
            assert 0.5 < row["over_likelihood"] < 2, row
        assert (method == "Vaccaro-Zaki") <= (model == "WN + RW")
    for row in result["rows"]:
        # White noise is seen in every recording by whoever fits a model.
        if row["parameter"] == "WN.sigma2" and not row["method"].startswith("slopes"):
            assert row["zero"] == 0, row
            assert row["rmse"] < 0.5, row
    words = comparison_words.verdict(result, "WN + RW")
    assert "has the smallest errors" in words
