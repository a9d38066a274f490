"""Constants of the plots that decide what is drawn: each value changes the figure at its limit and not before it."""

import math
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.applications.fleets.plot import HALF_STRIP, _height_axis, plot_fleet
from gmwm.applications.fleets.statistics import fleet_statistics
from gmwm.recording.signals import Imu, Signal
from gmwm.showing.plots.allan import _axis_with, allan_panel, avlr_panel
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.fit import fit_panel
from gmwm.showing.plots.likelihood import tracks_figure
from gmwm.showing.plots.results import plan_panel
from gmwm.showing.plots.series import plot_recording, signal_panel
from gmwm.showing.plots.spectrum import spectrum_panel

NOISE = np.random.default_rng(4).normal(size=4000)


def test_an_axis_is_extended_to_a_reading_point_by_a_factor_of_20_at_most():
    panel = allan_panel({"curve": gmwm.allan_variance(NOISE, 100.0)})
    low, high = panel.y.limits
    assert _axis_with(panel, [np.array(19 * high)]).limits[1] > 19 * high
    assert _axis_with(panel, [np.array(low / 19)]).limits[0] < low / 19
    for height in (21 * high, low / 21):
        assert _axis_with(panel, [np.array(height)]).limits == (low, high)


def test_a_fitted_line_is_drawn_a_factor_of_5_beyond_its_range():
    found = gmwm.avlr(NOISE, 100.0, terms=("N",))
    line = found["N"]
    (drawn,) = [mark for mark in avlr_panel(found, guides=False).lines if mark.x.size == 2]
    ends = min(line.first, line.reading_time) / 5, max(line.last, line.reading_time) * 5
    np.testing.assert_allclose(drawn.x, ends)


@pytest.mark.parametrize(("lines", "curves"), [(2, 2), (3, 1)])
def test_up_to_two_lines_have_a_curve_each(lines, curves, wv):
    model = " + ".join(["WN(sigma2=1e-6)", *(f"SIN(frequency={k}.0, power=1e-7)" for k in range(1, lines + 1))])
    curve = gmwm.WaveletVariance.from_values(
        gmwm.Model.parse(model).wavelet_variance(12, 100.0), samples=100_000, rate=100.0, unit="rad/s"
    )
    fixed = model.replace("frequency=", "frequency=fixed(").replace(".0,", ".0),")
    drawn = [
        label for label in fit_panel(gmwm.fit(fixed, curve)).labels if label.startswith(("line ", f"{lines} lines"))
    ]
    assert len(drawn) == curves


def test_oscillations_have_their_frequency_in_a_plot_of_one_axis_and_one_curve_in_a_plot_of_several():
    peaks = " + ".join(f"OSC(frequency=fixed({f}), quality=fixed(20.0), sigma2=1e-7)" for f in (0.564, 10.2))
    model = f"WN(sigma2=1e-6) + {peaks} + SIN(frequency=fixed(3.0), power=1e-7)"
    curve = gmwm.WaveletVariance.from_values(
        gmwm.Model.parse(model).wavelet_variance(12, 100.0), samples=100_000, rate=100.0, unit="rad/s"
    )
    fit = gmwm.fit(model, curve)
    alone, shared = fit_panel(fit), fit_panel(fit, alone=False, view="wavelet")
    names = {label.partition(":")[0] for label in alone.labels}
    assert {"oscillation 0.564 Hz", "oscillation 10.2 Hz", "line 3 Hz"} <= names
    assert set(shared.labels[-3:]) == {"WN", "Oscillations", "Lines"}
    both = sum(np.asarray(fit.decomposition[f"OSC[{k}]"]) for k in (1, 2))
    np.testing.assert_allclose(shared["Oscillations"].y, both)
    dashes = {line.stroke.dash for line in shared.lines if line.label in ("WN", "Oscillations", "Lines")}
    assert len(dashes) == 3


def lot(units, factor=1.05):
    """A fleet of one axis, whose intervals end at this factor above the values."""
    N = 1e-4 * np.exp(0.01 * np.random.default_rng(units).normal(size=units))
    table = pl.DataFrame({
        "unit": [f"{k}.csv" for k in range(units)], "axis": ["gyro_x"] * units, "status": ["calibrated"] * units,
        "model": ["WN"] * units, "N": N, "N_low": 0.95 * N, "N_high": factor * N, "N_unit": ["rad/s/√Hz"] * units,
    })  # fmt: skip
    return SimpleNamespace(table=table, statistics=fleet_statistics(table))


def test_many_units_are_a_curve_of_400_points():
    (curve,) = [
        line for line in description(plot_fleet)(lot(450)).panels[0].lines if line.label == "Units, sorted by value"
    ]
    assert curve.x.size == 400
    assert np.ptp(curve.x) == pytest.approx(2 * HALF_STRIP)


def test_an_interval_extends_the_axis_by_a_factor_of_3_at_most():
    (panel,) = description(plot_fleet)(lot(12, factor=50.0)).panels
    highest = max(np.nanmax(line.y) for line in panel.lines if line.label.startswith("Unit, "))
    assert 3 * highest < panel.y.limits[1] < 6 * highest


def test_values_within_a_factor_of_4_have_a_linear_axis():
    assert _height_axis(np.array([1.0, 3.9]), "N", signed=False).linear == math.inf
    assert _height_axis(np.array([1.0, 4.1]), "N", signed=False).linear == 0.0


@pytest.mark.slow
def test_the_curves_of_a_plan_go_to_twice_its_duration_at_least_and_100_times_at_most():
    easy = gmwm.plan("WN(sigma2=1.0)", duration=600.0, rate=100.0)
    hard = gmwm.plan("WN(sigma2=1.0) + RW(gamma2=1e-8)", duration=600.0, rate=100.0)
    for plan, factor in ((easy, 2.0), (hard, 100.0)):
        (line,) = [line for line in plan_panel(plan, accuracy=0.02).lines if line.label.startswith("WN")]
        assert line.x[-1] == pytest.approx(factor * 600.0)
        beyond = line.x[line.x >= 600.0]
        # Eight points for each decade.
        assert np.log10(beyond[1] / beyond[0]) == pytest.approx(1 / 8, rel=0.3)


@pytest.mark.parametrize(("samples", "symbol"), [(60, "circle"), (61, None)])
def test_up_to_60_samples_have_a_symbol_each(samples, symbol):
    (line,) = signal_panel(Signal(NOISE[:samples], 100.0)).lines
    assert line.stroke.symbol == symbol


@pytest.mark.parametrize(("factor", "labels"), [(900.0, 1), (1100.0, 2)])
def test_axes_within_a_factor_of_1000_share_a_power_of_ten(factor, labels):
    values = NOISE[:1000] - NOISE[:1000].mean()
    imu = Imu.from_arrays({"gyro_x": values, "gyro_y": values / factor}, 100.0)
    assert len({panel.y.label.rpartition("(")[2] for panel in description(plot_recording)(imu).panels}) == labels


def test_limits_extend_the_axis_of_a_spectrum_by_a_factor_of_5_at_most():
    spectrum = gmwm.psd(Signal(NOISE, 100.0, "rad/s"))
    data = spectrum_panel(spectrum)["Spectrum"].y
    model = gmwm.Model.parse("GM(beta=1e-4, sigma2=1e6)")
    assert spectrum_panel(spectrum, model=model).y.limits[1] == pytest.approx(5 * np.nanmax(data), rel=0.5)


@pytest.mark.parametrize(("level", "less"), [(40.0, False), (70.0, True)])
def test_a_track_of_50_times_its_span_is_drawn_without_its_level(level, less):
    model = gmwm.Model.parse("GM(beta=0.2, sigma2=4e-8) + WN(sigma2=4e-6)")
    made = gmwm.simulate_signal(model, rate=100.0, samples=4000, rng=5, unit="rad/s").signal
    tracks = model.smooth(made)
    low, high = (edge(end) for edge, end in zip((np.min, np.max), tracks.band("bias", 0.95), strict=True))
    moved = model.smooth(Signal(made.values + level * (high - low) - low, 100.0, "rad/s"))
    (panel,) = tracks_figure(moved, ["bias"], record=False).panels
    assert (", less " in panel.title) is less
