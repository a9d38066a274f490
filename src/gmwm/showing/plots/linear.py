"""Linear axes: ticks at multiples of 1, 2 or 5, the unit of time axes, and powers of ten in labels."""

from __future__ import annotations

import math

from gmwm.showing.plots.axes import power_text
from gmwm.showing.plots.figure import Axis, Tick

# Name of a unit of time, its length (s), and the longest time axis that is shown in this unit (s).
_TIMES = (
    ("µs", 1e-6, 2e-4), ("ms", 1e-3, 0.2), ("s", 1.0, 300.0), ("min", 60.0, 10800.0), ("h", 3600.0, 4 * 86400.0),
    ("d", 86400.0, math.inf),
)  # fmt: skip
_PLAIN = (0.1, 1e4)
"""Range of the largest value of an axis for which the label has no power of ten. Pinned by
tests/plots/test_plot_series.py."""


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
    return "0" if value == 0 else f"{value:.{decimals}f}".replace("-", "−")


def even_axis(low: float, high: float, label: str, *, margin: float, at_most: int = 8) -> Axis:
    """Return a linear axis from `low` to `high`, extended on each side by the fraction `margin` of this range."""
    # If all values are equal, the axis is extended by a tenth of the value.
    room = margin * (high - low) or 0.1 * abs(high) or 1.0
    limits = (low - room, high + room)
    ticks = even_ticks(limits, at_most)
    return Axis(label, limits, ticks, grid=tuple(tick.value for tick in ticks), linear=math.inf)


def time_unit(seconds: float) -> tuple[str, float]:
    """Return the unit of a time axis of this duration, and the length of the unit (s).

    >>> time_unit(20.0), time_unit(7200.0), time_unit(86400.0)
    (('s', 1.0), ('min', 60.0), ('h', 3600.0))
    """
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
    """Return the exponent of the power of ten in the label of an axis with values up to `largest`. The exponent is a
    multiple of three.

    >>> power_of(0.0123), power_of(9.8), power_of(2.5e6), power_of(0.0)
    (-3, 0, 6, 0)
    """
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
