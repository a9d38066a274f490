"""Several fits or curves drawn one after another on the same axes: names, colours, one legend and axes for all."""

import pytest
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

import gmwm
from gmwm.base.errors import OptionError
from gmwm.showing.plots.fit import named_panel
from tests.helpers import raises

RATE = 100.0


def curve(size, samples=4000, unit="rad/s"):
    return gmwm.wavelet_variance(gmwm.Signal(gmwm.WN(sigma2=size).simulate(samples, RATE, rng=1), RATE, unit, "gyro_x"))


@pytest.fixture(scope="module")
def fits():
    return gmwm.fit("WN", curve(1e-6)), gmwm.fit("WN", curve(1e-2, 40_000))


def entries(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def colours(ax, label):
    return {to_hex(line.get_color()) for line in ax.lines if line.get_label() in (label, f"{label}, model")}


def test_two_fits_differ_in_colour_and_share_a_legend_and_axes(fits):
    monday, tuesday = fits
    ax = Figure().add_subplot()
    monday.plot(ax=ax, label="monday", view="wavelet")
    tuesday.plot(ax=ax, label="tuesday", view="wavelet")
    assert entries(ax) == ["monday", "monday, model", "95 % limits, any noise", "tuesday", "tuesday, model"]
    assert len(colours(ax, "monday")) == len(colours(ax, "tuesday")) == 1
    assert colours(ax, "monday") != colours(ax, "tuesday")
    low, high = ax.get_ylim()
    for fit in fits:
        assert low < fit.wavelet_variance.variance.min()
        assert fit.wavelet_variance.variance.max() < high
        assert ax.get_xlim()[0] < fit.wavelet_variance.tau[0] < fit.wavelet_variance.tau[-1] < ax.get_xlim()[1]
    assert len(ax.child_axes) == 1


def test_a_colour_is_used_for_data_band_model_and_terms(fits):
    panel = named_panel(fits[0], label="monday", color="#D55E00")
    assert {line.stroke.colour for line in panel.lines} == {band.colour for band in panel.bands} == {"#d55e00"}
    assert panel.labels == ("monday", "monday, model", "95 % limits, any noise")
    ax = Figure().add_subplot()
    fits[0].plot(ax=ax, color="red", decomposition=True)
    assert entries(ax) == ["gyro_x", "gyro_x, model", "95 % limits, any noise", "gyro_x, WN"]


def test_curves_have_names_too():
    ax = Figure().add_subplot()
    curve(1e-6).plot(ax=ax, label="monday")
    curve(1e-4).plot(ax=ax, label="tuesday", color="k")
    assert entries(ax) == ["monday", "95 % limits, any noise", "tuesday"]
    assert colours(ax, "tuesday") == {"#000000"}


def test_another_unit_and_a_wrong_colour_are_refused(fits):
    ax = Figure().add_subplot()
    fits[0].plot(ax=ax, label="monday")
    with raises(OptionError, "same quantity and unit", argument="ax"):
        fits[1].plot(ax=ax, label="tuesday", view="wavelet")
    with raises(OptionError, argument="color"):
        fits[1].plot(label="tuesday", color="no colour")
