"""Intervals that determine nothing, and values that a recording cannot show."""

import math

import pytest

from gmwm.choosing.datasheets import Entry
from gmwm.choosing.datasheets.limits import WIDEST_INTERVAL, plausible

RATE, SAMPLES = 100.0, 360_000
DURATION = SAMPLES / RATE


def entry(unit, value, low, high, **more):
    return Entry(symbol="x", title="x", value=value, low=low, high=high, unit=unit, **more)


@pytest.mark.parametrize("unit", ["rad/s/√Hz", "rad/s/√s", "rad/s", "m/s²"])
def test_a_wide_interval_of_a_strength_is_a_limit(unit):
    kept = entry(unit, 1.0, 0.4, 0.4 * WIDEST_INTERVAL)
    assert plausible(kept, RATE, SAMPLES) == kept
    wide = plausible(entry(unit, 1.0, 0.4, 0.41 * WIDEST_INTERVAL), RATE, SAMPLES)
    assert (wide.low, wide.high, wide.upper_only) == (0.0, 0.41 * WIDEST_INTERVAL, True)
    assert wide.text("si").startswith("≤ ")


@pytest.mark.parametrize(
    ("unit", "value", "low", "high"),
    [("Hz", 1.0, 5.8e-47, 5.2e48), ("1", 3.0, 3.7e-220, 3.7e220), ("s", 10.0, 4.3e-75, 5.9e69),
     ("Hz", 3.0, 0.031, 49e3), ("Hz", 70.0, 60.0, 80.0), ("s", 2 * DURATION, DURATION, 3 * DURATION),
     ("1", 1e7, 0.9e7, 1.1e7)],
)  # fmt: skip
def test_a_time_or_frequency_that_a_recording_cannot_show_is_not_determined(unit, value, low, high):
    found = plausible(entry(unit, value, low, high), RATE, SAMPLES)
    assert (found.high, found.upper_only) == (math.inf, True)
    assert found.text() == "not determined"


def test_intervals_end_where_physics_does():
    assert plausible(entry("Hz", 20.0, 10.0, 80.0), RATE, SAMPLES).high == RATE / 2
    assert plausible(entry("s", 1000.0, 800.0, 4000.0), RATE, SAMPLES).high == DURATION
    assert plausible(entry("s", 0.02, 0.005, 0.04), RATE, SAMPLES).low == 1 / RATE
    assert plausible(entry("1", 5000.0, 3000.0, 9000.0), RATE, SAMPLES, resonance=2.0).high == 2.0 * DURATION


def test_limits_and_held_numbers_stay():
    for found in (entry("s", 1e9, 0.0, 1e12, upper_only=True), entry("Hz", 1e9, 1e9, 1e9, held=True),
                  entry("u", 1.0, None, None), entry("rad/s²", -1.0, -30.0, 28.0)):  # fmt: skip
        assert plausible(found, RATE, SAMPLES) is found
