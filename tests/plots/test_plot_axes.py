import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.showing.plots.axes import (
    limits_near,
    limits_of,
    number_text,
    one_tick_form,
    power_ticks,
    time_axis,
    value_axis,
)
from gmwm.showing.plots.figure import Figure, Panel

exponents = st.floats(-24, 24)
profile = settings(derandomize=True, max_examples=150, deadline=None)


@pytest.mark.slow
@profile
@given(low=exponents, decades=st.floats(0, 24))
def test_ticks_lie_inside_the_limits_in_order_and_there_are_at_least_two(low, decades):
    limits = limits_of(np.array([10**low, 10 ** (low + decades)]))
    ticks, minor = power_ticks(limits)
    positions = [tick.value for tick in ticks]
    assert 2 <= len(positions) <= 9
    assert positions == sorted(set(positions))
    assert all(limits[0] <= value <= limits[1] for value in (*positions, *minor))
    assert len({tick.label for tick in ticks}) == len(ticks)


@pytest.mark.slow
@profile
@given(values=st.lists(exponents, min_size=1, max_size=8))
def test_limits_hold_all_values_and_at_least_a_decade(values):
    shown = 10 ** np.array(values)
    low, high = limits_of(shown)
    assert low < shown.min() <= shown.max() < high
    assert high / low > 9.99


@pytest.mark.slow
@profile
@given(values=st.lists(st.floats(-6, 6), min_size=2, max_size=8), scale=st.floats(-12, 12))
def test_limits_scale_with_the_data(values, scale):
    shown, factor = 10 ** np.array(values), 10**scale
    around = [shown * 1e-5, shown * 1e5]
    plain = limits_near(shown, around, reach=10.0)
    np.testing.assert_allclose(
        limits_near(shown * factor, [a * factor for a in around], reach=10.0),
        np.multiply(plain, factor),
        rtol=1e-9,
    )


@profile
@given(exponent=st.floats(-30, 30))
def test_a_deep_tail_moves_the_border_by_the_reach_at_most(exponent):
    core = np.array([1e-3, 1.0])
    free = limits_near(core, [], reach=10.0)
    low, high = limits_near(core, [np.array([10.0**exponent])], reach=10.0)
    assert free[0] / 13 < low <= free[0] * 1.001
    assert free[1] / 1.001 <= high < free[1] * 13


def test_values_without_a_place_do_not_count():
    assert limits_of(np.array([0.0, -1.0, np.nan, np.inf, 3.0])) == limits_of(np.array([3.0]))


def test_nothing_to_draw_gives_an_axis_without_ticks():
    axis = value_axis(limits_of(np.zeros(3)), "y")
    assert axis.ticks == axis.minor == axis.grid == ()


def test_labels_of_one_axis_have_one_style():
    plain = [tick.label for tick in power_ticks((0.005, 20000.0))[0]]
    powers = [tick.label for tick in power_ticks((5e-6, 2.0))[0]]
    short = [tick.label for tick in power_ticks((4e-5, 6e-4))[0]]
    assert plain == ["0.01", "0.1", "1", "10", "100", "1000", "10000"]
    assert powers == ["10⁻⁵", "10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]
    assert short == ["5×10⁻⁵", "10⁻⁴", "2×10⁻⁴", "5×10⁻⁴"]


def test_long_axes_are_thinned():
    ticks, _ = power_ticks((1e-22, 1e3))
    assert len(ticks) <= 7


def test_the_time_axis_has_the_dyadic_grid_and_minutes():
    times = 2.0 ** np.arange(1, 21) / 250.0
    axis = time_axis(np.concatenate([times, times]), "Scale τ (s)")
    np.testing.assert_array_equal(axis.grid, times)
    assert [tick.label for tick in axis.ticks] == ["0.01", "0.1", "1", "10", "100", "1000"]
    assert [(tick.value, tick.label) for tick in axis.opposite] == [
        (60.0, "1 min"),
        (600.0, "10 min"),
        (3600.0, "1 h"),
    ]


def test_two_sampling_rates_share_the_grid_of_the_labels():
    times = np.concatenate([2.0 ** np.arange(1, 15) / 250.0, 2.0 ** np.arange(1, 15) / 100.0])
    axis = time_axis(times, "τ")
    assert axis.grid == tuple(tick.value for tick in axis.ticks)


@profile
@given(value=st.floats(1e-30, 1e30))
def test_numbers_in_words_keep_three_digits(value):
    text = number_text(value)
    powers = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
    mantissa, _, power = text.partition("×10")
    back = float(mantissa) * 10.0 ** int(power.translate(powers) or 0)
    assert abs(back / value - 1) < 6e-3


def test_a_figure_has_one_form_of_tick_labels():
    axes = [value_axis((1e-2, 1.0), "error"), value_axis((1e-5, 1.0), "error"), value_axis((1e-2, 1.0), "ratio")]
    x = time_axis(np.array([1.0, 10.0]), "τ (s)")
    mixed = one_tick_form(Figure((tuple(Panel(x, axis, ()) for axis in axes),)))
    labels = [[tick.label for tick in panel.y.ticks] for panel in mixed.panels]
    assert "10⁻²" in labels[0]
    assert not any("." in label for label in labels[0] + labels[1])
    assert labels[2] == ["0.01", "0.02", "0.05", "0.1", "0.2", "0.5", "1"]  # another quantity has its own form
