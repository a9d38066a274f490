"""Limits, ticks and grid lines of logarithmic and linear axes, and the format of their numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.text import with_minus
from gmwm.showing.plots.figure import Axis, Figure, Panel, Tick, drawable

_POWERS = tuple("⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SUPERSCRIPT = str.maketrans("-0123456789", "".join(_POWERS))

_DURATIONS = (
    (60.0, "1 min"), (600.0, "10 min"), (3600.0, "1 h"), (6 * 3600.0, "6 h"),
    (86400.0, "1 d"), (10 * 86400.0, "10 d"), (100 * 86400.0, "100 d"),
)  # fmt: skip

MANY_DECADES = 2.5
"""Decades above which only powers of ten are labelled, otherwise 2 and 5 too (tests/plots/test_plot_axes.py)."""
EMPTY = (1.0, 10.0)  # Limits of an axis without data. Such an axis has no ticks.


def number_text(value: float, digits: int = 3) -> str:
    """Format a number with `digits` significant digits, and with a power of ten if it is not in 0.001 … 10 000.

    >>> number_text(0.0123456), number_text(7.1123e-7), number_text(0.0), number_text(2.0e6)
    ('0.0123', '7.11×10⁻⁷', '0', '2×10⁶')
    """
    if value == 0 or not math.isfinite(value):
        return f"{value:g}"
    mantissa, _, exponent = f"{value:.{digits - 1}e}".partition("e")
    power = int(exponent)
    if -3 <= power <= 3:
        return with_minus(f"{float(f'{value:.{digits}g}'):g}")
    return with_minus(f"{float(mantissa):g}×10{str(power).translate(_SUPERSCRIPT)}")


def limits_of(values: Vector, *, margin: float = 0.05) -> tuple[float, float]:
    """Return limits of a logarithmic axis, at least a decade, around positive values with a relative `margin`."""
    shown = drawable(values)
    if not np.any(np.isfinite(shown)):
        return EMPTY
    low, high = math.log10(np.nanmin(shown)), math.log10(np.nanmax(shown))
    spread = max(margin * (high - low), (1.0 - (high - low)) / 2, 0.08)
    return 10 ** (low - spread), 10 ** (high + spread)


def limits_near(core: Vector, around: Iterable[Vector], *, reach: float) -> tuple[float, float]:
    """Return limits around the values `core`, extended by at most a factor `reach` to include the values `around`, so
    that the limit at the longest scale, or a very small term, does not determine the scale of the whole plot."""
    core = drawable(core)
    if not np.any(np.isfinite(core)):
        core = np.concatenate([drawable(values) for values in around] or [core])
        return limits_of(core)
    low, high = float(np.nanmin(core)), float(np.nanmax(core))
    stretched = [np.clip(drawable(values), low / reach, high * reach) for values in around]
    return limits_of(np.concatenate([core, *stretched]))


def power_ticks(limits: tuple[float, float], *, at_most: int = 7) -> tuple[tuple[Tick, ...], tuple[float, ...]]:
    """Return labelled ticks at powers of ten (and 2, 5 if short), at most `at_most`, and unlabelled positions."""
    low, high = math.log10(limits[0]), math.log10(limits[1])
    decades = range(math.floor(low), math.ceil(high) + 1)
    if high - low < MANY_DECADES:
        major = [m * 10.0**e for e in decades for m in (1, 2, 5)]
        minor = [m * 10.0**e for e in decades for m in (3, 4, 6, 7, 8, 9)]
    else:
        inside = [e for e in decades if low <= e <= high]
        step = math.ceil(len(inside) / at_most)
        labelled = [e for e in inside if e % step == 0]
        major = [10.0**e for e in labelled]
        minor = [10.0**e for e in inside if e % step]
        if step == 1:
            minor = [m * 10.0**e for e in decades for m in range(2, 10)]
    major = [value for value in major if limits[0] <= value <= limits[1]]
    minor = [value for value in minor if limits[0] <= value <= limits[1]]
    ticks = zip(major, _tick_texts(major), strict=True)
    return tuple(Tick(value, text) for value, text in ticks), tuple(minor)


def _tick_texts(values: Sequence[float]) -> list[str]:
    """Return the labels of ticks: plain numbers if all are between 0.001 and 10 000, otherwise powers of ten."""
    if all(0.999e-3 <= value <= 1.001e4 for value in values):
        return [f"{value:.6g}" for value in values]
    return [power_text(value) for value in values]


def one_tick_form(figure: Figure) -> Figure:
    """Return the figure with powers of ten on all logarithmic axes of a quantity, if one of them needs such."""
    ticks = [(panel.y.label, tick.label) for panel in figure.panels if panel.y.linear == 0 for tick in panel.y.ticks]
    powers = {label for label, text in ticks if text[:2] == "10" and text[2:3] in _POWERS}

    def renamed(panel: Panel | None) -> Panel | None:
        if panel is None or panel.y.linear or panel.y.label not in powers:
            return panel
        ticks = tuple(Tick(tick.value, tick.label and power_text(tick.value)) for tick in panel.y.ticks)
        return replace(panel, y=replace(panel.y, ticks=ticks))

    return replace(figure, rows=tuple(tuple(map(renamed, row)) for row in figure.rows))


def power_text(value: float) -> str:
    """Format a number with one digit and a power of ten, for example 10⁻³ or 2×10⁶."""
    mantissa, _, exponent = f"{value:.0e}".partition("e")
    power = "10" + str(int(exponent)).translate(_SUPERSCRIPT)
    return power if mantissa == "1" else f"{mantissa}×{power}"


def time_axis(times: Vector, label: str) -> Axis:
    """Return an axis in seconds for all scales, with dyadic grid lines, and minutes and hours at the top."""
    limits = limits_of(times, margin=0.03)
    ticks, _ = power_ticks(limits)
    scales = np.unique(times)
    # Curves with two sampling rates have two sets of dyadic scales. Grid lines for both would be confusing.
    one_grid = bool(np.all(scales[1:] > 1.9 * scales[:-1]))
    grid = scales.tolist() if one_grid else [tick.value for tick in ticks]
    above = [Tick(value, text) for value, text in _DURATIONS if limits[0] <= value <= limits[1]]
    return Axis(label, limits, ticks, grid=tuple(grid), opposite=thin_ticks(above, limits, 0.1))


def thin_ticks(ticks: Sequence[Tick], limits: tuple[float, float], share: float) -> tuple[Tick, ...]:
    """Return only those ticks whose distance from the previous one is at least the fraction `share` of the axis."""
    distant: list[Tick] = []
    least = (limits[1] / limits[0]) ** share
    for tick in ticks:
        if not distant or tick.value >= least * distant[-1].value:
            distant.append(tick)
    return tuple(distant)


def quiet(axis: Axis) -> Axis:
    """Return the axis without label and tick labels, for a panel beside a panel that shows the same axis."""
    return replace(axis, label="", ticks=tuple(Tick(tick.value, "") for tick in axis.ticks))


def value_axis(limits: tuple[float, float], label: str) -> Axis:
    """Return a vertical logarithmic axis with grid lines at the labelled ticks."""
    ticks, minor = ((), ()) if limits == EMPTY else power_ticks(limits)
    return Axis(label, limits, ticks, minor, grid=tuple(tick.value for tick in ticks))


def signed_axis(values: Vector, label: str, *, linear: float, even: float, least: float = 0.0) -> Axis:
    """Return an axis that is linear up to `linear` and logarithmic beyond, or linear if all values are ≤ `even`."""
    shown = np.append(values[np.isfinite(values)], [0.0, least, -least])
    low, high = float(shown.min()), float(shown.max())
    high = high if low < high else linear
    size = max(-low, high)
    if size <= even:
        room = 0.08 * (high - low)
        limits, reach = (low - room, high + room), math.inf
        step = 10.0 ** math.floor(math.log10(size))
        step = next(s for s in (0.2 * step, 0.5 * step, step, 2 * step, 5 * step) if (limits[1] - limits[0]) / s <= 8)
        places = [k * step for k in range(math.floor(low / step), math.ceil(high / step) + 1)]
    else:
        # The linear part has the length of one decade.
        decades = sum(1 + math.log10(max(abs(end) / linear, 1.0)) for end in (low, high) if end)
        limits, reach = (_beyond(low, -1, 0.06 * decades, linear), _beyond(high, 1, 0.06 * decades, linear)), linear
        # An axis with many decades in total has labels at powers of ten only, even if one side has few decades.
        reached = max(map(abs, limits))
        # Like `MANY_DECADES`; the linear part counts as one decade on each side (tests/plots/test_plot_ranking.py).
        if decades >= 5.0:
            reached = max(reached, linear * 10**MANY_DECADES)
        far = [tick.value for tick in power_ticks((linear, reached), at_most=4 if low and high else 7)[0]]
        places = sorted({0.0, linear, -linear, *far, *(-value for value in far)})
    inside = [value for value in places if limits[0] <= value <= limits[1]]
    ticks = tuple(Tick(value, with_minus(f"{value:g}")) for value in inside)
    return Axis(label, limits, ticks, grid=tuple(inside), linear=reach)


def _beyond(end: float, side: int, decades: float, linear: float) -> float:
    """Return the end of a signed axis, extended by `decades` decades; `side` is −1 or +1."""
    return end * 10**decades if abs(end) > linear else end + side * decades * linear


# Name of a unit of time, its length (s), and the longest time axis that is shown in this unit (s).
_TIMES = (
    ("µs", 1e-6, 2e-4), ("ms", 1e-3, 0.2), ("s", 1.0, 300.0), ("min", 60.0, 10800.0), ("h", 3600.0, 4 * 86400.0),
    ("d", 86400.0, math.inf),
)  # fmt: skip
_PLAIN = (0.1, 1e4)
"""Largest values whose axis label has no power of ten (tests/plots/test_plot_series.py)."""


def even_ticks(limits: tuple[float, float], at_most: int = 8) -> tuple[Tick, ...]:
    """Return as many ticks as possible, but at most `at_most`, at multiples of 1, 2 or 5 times a power of ten.

    >>> [tick.label for tick in even_ticks((-0.31, 0.52), at_most=5)]
    ['−0.2', '0', '0.2', '0.4']
    """
    low, high = limits
    power = math.floor(math.log10((high - low) / at_most))
    choices = [m * 10.0**p for p in (power, power + 1) for m in (1, 2, 5)]
    step = next(s for s in choices if math.floor(high / s) - math.ceil(low / s) + 1 <= at_most)
    decimals = max(0, -math.floor(math.log10(step) + 1e-9))
    places = range(math.ceil(low / step), math.floor(high / step) + 1)
    return tuple(Tick(k * step, number_at(k * step, decimals)) for k in places)


def number_at(value: float, decimals: int) -> str:
    """Format a number with a fixed number of decimals and a typographic minus sign. Zero has no decimals.

    >>> number_at(-0.25, 2), number_at(0.0, 2)
    ('−0.25', '0')
    """
    return "0" if value == 0 else with_minus(f"{value:.{decimals}f}")


def even_axis(low: float, high: float, label: str, *, margin: float, at_most: int = 8) -> Axis:
    """Return a linear axis from `low` to `high`, extended on each side by the fraction `margin` of this range."""
    # If all values are equal, the axis is extended by a tenth of the value.
    room = margin * (high - low) or 0.1 * abs(high) or 1.0
    limits = (low - room, high + room)
    ticks = even_ticks(limits, at_most)
    return Axis(label, limits, ticks, grid=tuple(tick.value for tick in ticks), linear=math.inf)


def time_unit(seconds: float) -> tuple[str, float]:
    """Return the unit of a time axis of this duration, and the length of the unit (s)."""
    return next((unit, size) for unit, size, longest in _TIMES if seconds <= longest)


def elapsed_axis(
    low: float, high: float, span: float, *, since: str = "the first sample", at_most: int = 10
) -> tuple[Axis, float]:
    """Return a time axis from `low` to `high` (s) in the unit that suits `span` (s), and the length of its unit (s)."""
    unit, size = time_unit(span)
    return even_axis(low / size, high / size, f"Time since {since} ({unit})", margin=0.01, at_most=at_most), size


def scaled_axis(low: float, high: float, largest: float, *, name: str, unit: str) -> tuple[Axis, float]:
    """Return an axis from `low` to `high` in `unit` times a power of ten that suits `largest`, and this power."""
    scale = 10.0 ** power_of(largest)
    label = scaled_unit(unit, power_of(largest))
    return even_axis(low / scale, high / scale, f"{name} ({label})" if name else label, margin=0.06, at_most=5), scale


def power_of(largest: float) -> int:
    """Return the exponent, a multiple of three, in the label of an axis up to `largest`."""
    if largest == 0 or _PLAIN[0] <= largest < _PLAIN[1]:
        return 0
    return 3 * math.floor(math.log10(largest) / 3)


def scaled_unit(unit: str, power: int) -> str:
    """Return a unit with a power of ten in front of it.

    >>> scaled_unit("rad/s", -3), scaled_unit("", -3), scaled_unit("mg", 0)
    ('10⁻³ rad/s', '10⁻³ × unit of the data', 'mg')
    """
    if not unit:
        return f"{power_text(10.0**power)} × unit of the data" if power else "unit of the data"
    return f"{power_text(10.0**power)} {unit}" if power else unit
