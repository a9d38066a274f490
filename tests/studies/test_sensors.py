"""The simulated sensors of validation/sensors.py have the Allan deviation and the N that their truth states."""

from __future__ import annotations

import ast
import math
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from scipy import signal

from tests.helpers import each
from validation import filter_truth, sensors

SLACK = {"knocks", "spikes", "quantized-coarse", "lines", "warm-up", "drift"}
"""Kinds whose output is not that of the truth's N, by intent."""


def allan_variance(x: sensors.Array, n: int) -> float:
    sums = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    return float(np.mean(((sums[2 * n :] - 2 * sums[n:-n] + sums[: -2 * n]) / n) ** 2) / 2)


@pytest.mark.parametrize("module", [sensors, filter_truth])
def test_they_do_not_use_the_package(module: ModuleType) -> None:
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    modules = {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    modules |= {name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names}
    assert not [name for name in modules if name and name.startswith("gmwm")]


def test_the_filter_of_white_noise_and_a_walk_has_their_numbers() -> None:
    sensor = sensors.Sensor(N=2.0, rate=50.0, duration=1e3, K=0.3)
    truth = sensor.truth()
    assert (truth.filter_N, truth.filter_K) == pytest.approx((2.0, 0.3), rel=1e-3)
    # A line of 0.6 Hz adds to the prediction error; one of 0.1 Hz is followed, and one of 20 Hz averages out.
    for frequency, adds in ((0.6, True), (0.1, False), (20.0, False)):
        assert (sensor.truth(lines=[(frequency, 1.0)]).filter_N > 2.001) == adds
    assert sensor.truth(slope=0.1).filter_K > 0.32


@pytest.mark.slow
def test_the_truth_of_a_filter_predicts_best() -> None:
    """The stated error is the error of a simulated filter, and other filters are worse."""
    rng = np.random.default_rng(5)
    sensor = sensors.Sensor(N=1.0, rate=20.0, duration=2e5, gm=((0.2, 20.0),), B=0.1)
    x, truth = sensor.white(rng) + sensor.slow(rng), sensor.truth()
    sums = np.concatenate([[0.0], np.cumsum(x)])
    future = (sums[20:] - sums[:-20]) / 20

    def error(q: float) -> float:
        g = 2 * q / (q + math.sqrt(q**2 + 4))
        past = signal.lfilter([g], [1, g - 1], x)
        return float(np.mean((future[2001:] - past[2000:-20]) ** 2))

    best = truth.filter_K / truth.filter_N / 20
    stated = truth.filter_N**2 * (1 + best * 20) + truth.filter_K**2 / 3
    assert stated == pytest.approx(error(best), rel=0.02)
    assert error(best) < min(error(0.5 * best), error(2 * best))


@pytest.mark.slow
@each("kind", sorted(set(sensors.KINDS) - SLACK))
def test_the_allan_deviation_is_that_of_the_truth(kind: str) -> None:
    # The standard error of a ratio at averaging times of 1 s is about √(1.5 s/T)/2: 1 % for half an hour. The limit of
    # 3 % is four standard errors of the mean of two.
    ratios = []
    for repeat in range(2):
        found = sensors.KINDS[kind](np.random.default_rng([20, repeat]))
        truth = found.truth
        made = sensors.Sensor(
            N=truth.N, rate=found.rate, duration=found.samples.size / found.rate, gm=truth.gm, K=truth.K or 0.0,
            B=truth.B or 0.0,
        )  # fmt: skip
        n = round(found.rate)
        ratios.append(allan_variance(found.samples, n) / float(made.allan_variance(np.array([n / found.rate]))[0]))
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("kind", ["quantized-fine", "quantized-coarse"])
def test_the_rounded_output_has_the_white_noise_of_the_truth(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # Without a slow part the output is white, so N is its standard deviation; it is known to 1 ‰.
    monkeypatch.setattr(sensors.Sensor, "slow", lambda self, rng: np.full(self.count, rng.uniform() * self.sigma))
    for repeat in range(4):
        found = sensors.KINDS[kind](np.random.default_rng([21, repeat]))
        assert np.std(found.samples) / np.sqrt(found.rate) == pytest.approx(found.truth.N, rel=0.01)


@pytest.mark.slow
def test_flicker_noise_has_a_flat_allan_variance() -> None:
    x = [sensors.flicker(2**15, np.random.default_rng(k)) for k in range(40)]
    found = np.array([[allan_variance(one, n) for n in (16, 64, 256)] for one in x]) / sensors.BIAS
    assert np.abs(found.mean(axis=0) - 1) == pytest.approx(0, abs=0.03)


def test_the_lowest_point_includes_all_terms() -> None:
    sensor = sensors.Sensor(N=2.0, rate=10.0, duration=1e5, K=0.3)
    # N²/τ + K²τ/3 is lowest at τ = √3 N/K, where it is 2NK/√3.
    assert sensor.lowest() == pytest.approx(math.sqrt(2 * 2.0 * 0.3 / math.sqrt(3) / sensors.BIAS), rel=1e-5)


def test_two_recordings_are_of_one_sensor() -> None:
    one, other = sensors.pair(20.0, np.random.default_rng(1))
    assert one.truth == other.truth
    assert one.samples.size == other.samples.size == 2000
    assert not np.array_equal(one.samples, other.samples)
