"""Wavelet coefficients and autocorrelation: each point at its time, and limits that hold."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.measuring.variance import dwt, modwt
from gmwm.showing.plots import plot_autocorrelation, plot_coefficients
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.likelihood import signal_autocorrelation_panel
from tests.helpers import raises

RATE = 50.0


@pytest.mark.parametrize("transformed", [modwt, dwt])
@pytest.mark.parametrize("filter", ["haar", "d4"])
def test_a_pulse_is_drawn_where_it_happened(transformed, filter):
    x = np.zeros(1024)
    x[601] = 1.0
    figure = description(plot_coefficients)(transformed(x, filter), RATE, levels=[2, 4])
    for (panel,), level in zip(figure.rows, (2, 4), strict=True):
        (line,) = panel.lines
        found = line.x[np.argmax(np.abs(line.y))]
        assert abs(found - 601 / RATE) <= 2**level / RATE
        assert line.x[0] >= 0
        assert line.x[-1] <= 1024 / RATE


def test_only_levels_that_have_coefficients_are_drawn():
    transform = modwt(np.random.default_rng(1).normal(size=256), "d4")
    known = [j for j, inside in transform.interior.items() if inside.start < inside.stop]
    assert len(description(plot_coefficients)(transform, RATE).rows) == len(known) < transform.levels
    with raises(OptionError, "levels", str(known[-1])):
        plot_coefficients(transform, RATE, levels=[transform.levels])


def test_autocorrelation_of_white_noise_is_within_its_limits_so_often():
    inside = []
    for seed in range(40):
        panel = signal_autocorrelation_panel(gmwm.Signal(np.random.default_rng(seed).normal(size=2000), RATE), 50)
        (band,) = panel.bands
        inside.append(np.mean((panel.lines[-1].y > band.lower) & (panel.lines[-1].y < band.upper)))
    assert abs(np.mean(inside) - 0.95) < 4 * np.sqrt(0.05 * 0.95 / 2000)


def test_autocorrelation_leaves_out_pairs_across_a_gap():
    values = np.tile([1.0, -1.0], 100)
    signal = gmwm.Signal.from_missing(np.where(np.arange(200) % 10 < 9, values, np.nan), RATE)
    r = signal_autocorrelation_panel(signal, 4).lines[-1].y
    assert np.all(np.sign(r) == [-1, 1, -1, 1])
    with raises(OptionError, "lags"):
        plot_autocorrelation(signal, 180)


def test_an_autocorrelation_is_drawn_beside_the_robust_one_and_the_model():
    law = gmwm.Model.parse("ARMA(phi=[0.7], theta=[0.4], sigma2=1.0)")
    x = law.simulate(3000, 1.0, rng=1)
    x[::100] += 20.0
    panel = signal_autocorrelation_panel(gmwm.Signal(x, rate=1.0), 20, robust=True, model=law)
    curves = {mark.label: mark.y for mark in panel.marks if hasattr(mark, "y")}
    assert curves["Model: ARMA(1,1)"][0] == pytest.approx(0.82, abs=0.01)
    assert curves["Observed"][0] < curves["Observed, robust"][0] < 0.85
    assert panel.y.limits[1] > 0.82
    partial = signal_autocorrelation_panel(gmwm.Signal(x, rate=1.0), partial=True)
    assert partial.y.label == "Partial autocorrelation"
