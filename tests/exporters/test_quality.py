"""The sentences of a file on how well its numbers predict, against formulas of this file."""

import math
import re

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import lfilter

from gmwm.choosing.datasheets.effective import Use, claim, true_times
from gmwm.choosing.datasheets.filter_numbers import FilterPrediction, best_gain, smallest_error
from gmwm.showing.exporters import quality
from gmwm.showing.exporters.quality import TIMES, Quality, predictions, qualities
from gmwm.showing.exporters.reduction import Number, axis_noise, sensor_noise
from gmwm.theory.processes import Model

from .conftest import RATE, words


def axis_of(calibration, axis, horizon=1.0):
    quantity = axis.partition("_")[0]
    return axis_noise(axis, calibration.axes[axis], quantity=quantity, use=Use(horizon), level=0.95)


def own_qualities(axis):
    return qualities(axis, axis.N.value, axis.K.value)


@pytest.mark.parametrize("samples", [1, 20, 3000])
def test_white_noise_and_a_walk_lose_nothing(samples):
    processes = Model.parse("WN(sigma2=1.0) + RW(gamma2=1e-5)").processes
    prediction = FilterPrediction.of(processes, RATE, samples)
    least = smallest_error(processes, RATE, samples)
    assert prediction.error(best_gain(prediction))[0] == pytest.approx(least, rel=1e-6)


@pytest.mark.parametrize("time", [0.5, 15.0, 300.0])
def test_the_smallest_error_is_that_of_the_kalman_filter(time):
    """White noise and a Gauss-Markov state: its steady state, and the prediction of the mean, as scalars."""
    phi, samples = math.exp(-1 / (time * RATE)), 600
    phi_, drive = np.array([[phi]]), np.array([[1e-2 * (1 - phi**2)]])
    before = float(solve_discrete_are(phi_, np.eye(1), drive, np.eye(1))[0, 0])
    ahead = np.array([(phi ** np.arange(k, samples) / phi**k).sum() for k in range(samples)])  # noise of step k
    q = 1e-2 * (1 - phi**2)
    exact = (ahead[0] ** 2 * before + q * np.sum(ahead[1:] ** 2) + samples) / samples**2
    processes = Model.parse(f"GM(beta={1 / time!r}, sigma2=1e-2) + WN(sigma2=1.0)").processes
    assert smallest_error(processes, RATE, samples) == pytest.approx(exact, rel=1e-6)


def test_a_model_without_white_noise_has_a_smallest_error():
    processes = Model.parse("MA(1, theta1=0.2, sigma2=1.0) + FN(b2=1e-3)").processes
    assert smallest_error(processes, RATE, 100) == pytest.approx(1.2**2 / 100, rel=0.15)


def test_no_state_space_gives_no_loss():
    assert smallest_error(Model.parse("PL(alpha=2.5, nu2=1.0) + WN(sigma2=1.0)").processes, RATE, 10) is None


def test_quality_is_loss_and_claim(units):
    axis = axis_of(units["gauss-markov"], "gyro_z")
    at = dict(zip(TIMES, own_qualities(axis), strict=True))
    assert at[1.0].claim == pytest.approx(1.0, abs=0.01)
    assert 1.0 <= at[1.0].loss < at[10.0].loss < at[60.0].loss
    assert at[60.0].loss > 1.2
    assert at[60.0].claim > 1.5
    assert all(each.loss == pytest.approx(1, abs=2e-3) for each in own_qualities(axis_of(units["quantized"], "gyro_x")))


def test_the_file_states_them_and_names_the_remedy(units):
    text = words(units["gauss-markov"].export())
    assert "Predictions over 1, 10, 60 s: error over the full model's; stated over real error" in text
    found = re.search(r"Gyroscopes: error (.*?); stated (.*?); right", text)
    axes = [axis_of(units["gauss-markov"], f"gyro_{k}") for k in "xyz"]
    # The ratios are those of the values in the file, for each axis, and not those of each axis with its own N and K.
    white, walk = (max(getattr(axis, symbol).value for axis in axes) for symbol in "NK")
    of_file = [qualities(axis, white, walk) for axis in axes]
    losses = [max(each[k].loss for each in of_file) for k in range(3)]
    assert [float(x) for x in found[1].split(", ")] == pytest.approx(losses, abs=0.006)
    for k, ratio in enumerate(found[2].split(", ")):
        claims = [each[k].claim for each in of_file]
        ends = [float(x) for x in ratio.split("-")]
        assert (ends[0], ends[-1]) == pytest.approx((min(claims), max(claims)), abs=0.006)
    assert "-" in found[2]
    # The truth of the worst axis, and a filter with it states its error.
    bias = re.search(r"right up to .*? use N (\S+), sigma (\S+), T (\S+) s \((\w+)\)\.", text)
    fit = units["gauss-markov"].axes[bias[4]].fit
    (term,) = (process for process in fit.model.processes if process.name == "GM")
    assert float(bias[2]) == pytest.approx(math.sqrt(term.value("sigma2")), rel=0.03)
    assert float(bias[3]) == pytest.approx(1 / term.value("beta"), rel=0.03)
    assert "Filters with Gauss-Markov states" in text
    assert "Filters with Gauss-Markov states" not in words(units["quantized"].export())


@pytest.mark.parametrize(
    ("times", "sentence"),
    [
        ((1.0, 10.0), "; right up to 10 s. For longer predictions, set the horizon"),
        ((1.0, 200.0), "; right up to 200 s. Accelerometers"),
        ((10.0, 300.0), "; right from 10 s up to 300 s. Acc"),
        ((10.0, math.inf), "; right from 10 s. Acc"),
        ((math.inf, math.inf), "; right at no time. Acc"),
        ((1.0, math.inf), ""),
    ],
)
def test_the_file_says_at_which_times_the_numbers_hold(units, monkeypatch, times, sentence):
    monkeypatch.setattr("gmwm.showing.exporters.quality.true_times", lambda *_: times)
    text = words(units["quantized"].export())
    assert ("; right" in text) == ("; right" in sentence)
    assert sentence in text


def test_numbers_of_a_long_horizon_hold_at_long_times(units):
    axis = axis_of(units["gauss-markov"], "gyro_z", horizon=10.0)
    since, until = true_times([axis.fit], axis.N.value, axis.K.value)
    assert 1 < since <= 10 <= until


def test_n_and_k_hold_while_the_stated_error_is_0_8_to_1_3_times_the_real_one(units):
    """The real error of the filter is a quadratic form of its weights, with the covariance of WN + GM."""
    axis = axis_of(units["gauss-markov"], "gyro_z")
    processes = {process.name: process for process in axis.fit.model.processes}
    phi, s2 = math.exp(-processes["GM"].value("beta") / RATE), processes["GM"].value("sigma2")
    white = processes["WN"].value("sigma2")
    r, q = axis.N.value**2 * RATE, axis.K.value**2 / RATE
    before = (q + math.sqrt(q * q + 4 * q * r)) / 2
    gain = before / (before + r)

    def ratio(seconds):
        n = round(seconds * RATE)
        old = -gain * (1 - gain) ** np.arange(round(20 / gain))[::-1]
        weights = np.r_[old, np.full(n, 1 / n)]
        real = white * weights @ weights + s2 * weights @ (2 * lfilter([1], [1, -phi], weights) - weights)
        ahead = (1 - gain) * before + q * sum((n - k) ** 2 for k in range(n)) / n**2
        return math.sqrt((ahead + r / n) / real)

    until = true_times([axis.fit], axis.N.value, axis.K.value)[1]
    assert ratio(until) == pytest.approx(claim(axis.fit, axis.N.value, axis.K.value, until), rel=0.02)
    assert 0.8 <= ratio(until) <= 1.3 < ratio(2.5 * until)


@pytest.mark.parametrize(("loss", "advised"), [(1.15, False), (1.3, True)])
def test_a_loss_of_20_per_cent_over_a_minute_advises_more_states(units, monkeypatch, loss, advised):
    monkeypatch.setattr(quality, "qualities", lambda *_: (Quality(1.0, 1.0), Quality(1.0, 1.0), Quality(loss, 1.0)))
    sensor = sensor_noise(units["quantized"], "gyro", rule="worst", inflation=1.0, use=Use())
    assert ("Gauss-Markov states" in predictions([sensor], 1.0)[-1]) is advised


def test_inflated_numbers_have_the_same_quality(units):
    plain, inflated = (
        [
            line
            for line in words(units["quantized"].export(inflation=x)).split(". ")
            if re.match("Predictions over|Gyroscopes: error|Acc.*: error", line)
        ]
        for x in (1.0, 10.0)
    )
    assert plain == [line.replace(", before inflation", "") for line in inflated]
    assert ", before inflation" in inflated[0]
    assert Number(1.0, False).scaled(2.0) == Number(2.0, False)
