"""Charts and thresholds: run lengths against simulation, coefficients against convolution, independence of cuts."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import toeplitz

from gmwm.applications.monitor.charts import (
    BLOCKS_OF_LEVEL,
    NOISE,
    Charts,
    ChartSettings,
    differences,
    level_threshold,
    noise_run_length,
    noise_threshold,
    shape_factor,
    spike_limit,
    white_shape,
    window,
)
from gmwm.base.documents import plain

Array = NDArray[np.float64]
SETTINGS = ChartSettings.of_model(rate=1.5)
RATIOS = [ratio for _, _, ratio in NOISE]


def run_length(steps: Any, threshold: float, alarms: int) -> tuple[float, float]:
    """Mean number of increments between alarms of a chart, and its standard error, by a plain loop over many charts."""
    sums, counts, total = np.zeros(200), 0, 0
    while counts < alarms:
        sums = np.maximum(sums + steps(sums.size), 0.0)
        over = sums > threshold
        counts, total = counts + int(over.sum()), total + sums.size
        sums[over] = 0.0
    return total / counts, total / counts / np.sqrt(counts)


@pytest.mark.slow
@pytest.mark.parametrize("length", [100.0, 1000.0])
def test_level_charts_have_the_wanted_run_length(length: float) -> None:
    rng = np.random.default_rng(1)
    mean, error = run_length(lambda n: rng.standard_normal(n) - 0.5, level_threshold(length), 2000)
    assert abs(mean / length - 1) < 0.03 + 4 * error / mean


@pytest.mark.slow
@pytest.mark.parametrize("shape", [1.5, 5.6])
@pytest.mark.parametrize("ratio", RATIOS)
def test_noise_charts_have_the_wanted_run_length(shape: float, ratio: float) -> None:
    rng, length = np.random.default_rng(2), 1e4

    def steps(n: int) -> Array:
        y = rng.gamma(shape, 1 / shape, n)
        return np.asarray(shape * (y * (1 - 1 / ratio) - np.log(ratio)))

    mean, error = run_length(steps, noise_threshold(length, shape, ratio), 500)
    assert abs(mean / length - 1) < 0.03 + 4 * error / mean


@pytest.mark.parametrize("shape", [1.5, 2.6, 5.6])
@pytest.mark.parametrize("ratio", RATIOS)
def test_thresholds_of_long_runs_follow_from_those_of_short_ones(shape: float, ratio: float) -> None:
    for length in (1e4, 1e6, 1e8):
        h = noise_threshold(length, shape, ratio)
        assert abs(noise_run_length(h, shape, ratio, cells=300) / length - 1) < 0.04


@pytest.mark.parametrize("sums", [2, 4, 8])
@pytest.mark.parametrize("ratio", RATIOS)
def test_the_exponential_of_a_noise_chart_is_a_martingale_in_the_long_run(sums: int, ratio: float) -> None:
    # ln E exp(Σ l) grows by 0 with each block, from the eigenvalues of the covariance of the coefficients.
    shape = white_shape({2: 1, 4: 2, 8: 3}[sums])
    half = np.repeat([1.0, -1.0], sums // 2)
    rho = np.correlate(half, half, "full")[sums - 1 :] / sums

    def growth(k: float) -> float:
        found = []
        for blocks in (12, 24):
            size = blocks * BLOCKS_OF_LEVEL * sums
            values = np.linalg.eigvalsh(toeplitz(np.pad(rho, (0, size - sums))))
            steps = np.log1p(-2 * k * (1 - 1 / ratio) * values / (BLOCKS_OF_LEVEL * sums))
            found.append(-0.5 * float(np.sum(steps)) - blocks * k * float(np.log(ratio)))
        return (found[1] - found[0]) / 12

    assert abs(growth(shape * shape_factor(sums, ratio))) < 0.01 * abs(growth(shape))


def test_a_spike_is_as_rare_as_stated() -> None:
    assert spike_limit(1 / 0.05) == pytest.approx(1.959964, abs=1e-6)


@pytest.mark.parametrize("m", [2, 4, 8])
def test_coefficients_are_differences_of_neighbouring_means(m: int) -> None:
    x = np.random.default_rng(3).standard_normal(50)
    half = np.repeat([1.0, -1.0], m // 2)
    np.testing.assert_allclose(differences(x, m), np.convolve(x, half, "valid"), atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("level", [1, 2, 3, 5])
def test_the_scatter_of_mean_squares_is_that_of_white_noise(level: int) -> None:
    base, m = window(level)
    runs, blocks = 2000, 20
    x = np.random.default_rng(level).standard_normal((runs, (blocks * BLOCKS_OF_LEVEL * m + m - 1) << base))
    sums = x.reshape(runs, -1, 1 << base).sum(axis=2)
    y = np.array([np.mean(differences(row, m) ** 2) for row in sums]) / 2**level
    k = blocks * white_shape(level)
    assert np.mean(y) == pytest.approx(1, abs=4 / np.sqrt(runs * k))
    assert np.var(y) * k == pytest.approx(1, abs=4 * np.sqrt(2.2 / runs))


def test_few_sums_keep_most_of_the_information() -> None:
    # Coefficients at every sample have 1.5 degrees of freedom in 2^j samples, for long scales.
    assert white_shape(8) == pytest.approx(0.928 * 1.5 * BLOCKS_OF_LEVEL, rel=1e-3)


@pytest.mark.slow
def test_alarms_do_not_depend_on_cuts_and_json() -> None:
    rng = np.random.default_rng(4)
    e = rng.standard_normal(12_000)
    e[5000:7000] *= 1.6
    e[9000:9500] += 1.5
    e[11_000] = 12.0

    def passed(cuts: NDArray[np.int64]) -> tuple[list[Any], Any]:
        charts, found = Charts(SETTINGS, 1e6, 100, 6000), []
        for part in np.split(e, cuts):
            found += charts.update(part)
            state = json.loads(json.dumps(plain(charts.save())))
            charts = Charts(SETTINGS, 1e6, 100, 6000)
            charts.load(state)
        return sorted(found), plain(charts.save())

    whole, end = passed(np.array([], dtype=np.int64))
    assert {alarm.family for alarm in whole} == {"noise up", "level", "spike"}
    for cuts in (np.sort(rng.integers(0, e.size, 60)), np.arange(1, 400), np.array([5000, 5000, 5001])):
        found, left = passed(cuts)
        assert found == whole
        assert {k: v for k, v in left.items() if k != "recent"} == {k: v for k, v in end.items() if k != "recent"}


def test_one_wrong_sample_is_a_spike_and_no_jump() -> None:
    e = np.random.default_rng(5).standard_normal(4000)
    e[2000] = 1e6
    charts = Charts(SETTINGS, 1e7, 100, 6000)
    assert {alarm.family for alarm in charts.update(e)} == {"spike"}


@pytest.mark.slow
def test_a_chart_rests_longer_while_a_fault_lasts() -> None:
    e = 0.3 * np.random.default_rng(6).standard_normal(200_000)
    charts = Charts(SETTINGS, 1e7, 100, 6000)
    times = [alarm.sample for alarm in sorted(charts.update(e)) if alarm[1:4] == ("noise down", 1, -1)]
    steps = np.diff(times)
    assert steps[0] < 300
    assert 6000 <= steps[-1] < 6200
    assert len(times) < 50
