"""Paragraphs of the head of a file: terms included in N and K, datasheet values, and dependence on the horizon."""

from __future__ import annotations

from typing import TYPE_CHECKING

from gmwm.base.text import duration_text
from gmwm.base.units import SI_UNIT, datasheet_units, noise_unit
from gmwm.choosing.datasheets.effective import Use, noise_in_use
from gmwm.choosing.datasheets.entry import significant
from gmwm.showing.exporters.reduction import AxisNoise, Number, SensorNoise, counted_as
from gmwm.showing.exporters.two_states import apart, two_states

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.showing.exporters.base import Noise

HORIZONS = (0.1, 1.0, 10.0, 100.0)
"""Horizons (s) for which the head lists N and K."""
FAR, NEARER = 0.2, 2.0
"""The head states the errors of N and K and of two Gauss-Markov states if N and K are much worse. The relative error of
N and K in the Allan deviation must be at least FAR, and at least NEARER times the error of two states. Both limits are
conventions (tests/exporters/test_two_states.py)."""
ALIKE = 5e-3
"""If N or K of the file differs from the datasheet by more than this relative amount, the head states both values."""
_POWERS = {"N": 0.5, "K": -0.5}


def models(noise: Noise, calibration: Calibration) -> list[str]:
    """Return a sentence for each axis: its model, the terms in N and K, and the datasheet values if they differ."""
    lines = []
    for sensor in noise.sensors:
        for one in sensor.axes:
            parts = [f"{number}: {', '.join(terms)}" for number, terms in counted_as(one.fit, one.use).items()
                     if number and terms]  # fmt: skip
            counts = f" ({'; '.join(parts)})" if parts else ""
            lines.append(f"Model of {one.axis}: {one.fit.model.structure}{counts}.{_beside(one, sensor, calibration)}")
    return lines


def _beside(one: AxisNoise, sensor: SensorNoise, calibration: Calibration) -> str:
    """Return a sentence with N and K of the datasheet and of the file (before inflation), or "" if they agree."""
    sheet = calibration.datasheets[one.axis]
    texts: dict[str, list[str]] = {"Table": [], "here": []}
    differs = False
    for symbol, power in _POWERS.items():
        unit, factor = _unit(sensor, power)
        number: Number = getattr(one, symbol)
        entry = sheet.get(symbol)
        measured = entry is not None and entry.value > 0 and not entry.upper_only
        if number.upper or entry is None or not measured:
            differs = differs or (measured != (not number.upper and number.value > 0))
        else:
            differs = differs or abs(number.value / entry.value - 1) > ALIKE
        in_table = entry.text() if entry is not None else "none"
        texts["Table"].append(f"{symbol} {in_table}")
        mark = "<= " if number.upper else ""
        texts["here"].append(f"{symbol} {mark}{significant(factor * number.value, 3)} {unit}")
    if not differs:
        return ""
    shown = "; ".join(f"{where}: {', '.join(each)}" for where, each in texts.items())
    return f" {shown}, with the terms above at the horizon of {one.use.horizon:g} s."


def _unit(sensor: SensorNoise, power: float) -> tuple[str, float]:
    """Return the datasheet unit for a power of time, and the factor from the SI unit to it."""
    si = noise_unit(power, SI_UNIT[sensor.quantity])[0]
    return next(iter(datasheet_units(si).items()))


def sweep(noise: Noise) -> list[str]:
    """Return sentences with N and K (SI, before inflation) at horizons from 0.1 s to 100 s, for the axes of the
    file."""
    lines = []
    for sensor in noise.sensors:
        si = [noise_unit(power, SI_UNIT[sensor.quantity])[0] for power in _POWERS.values()]
        for one in (sensor.worst,) if noise.options.axes == "worst" else sensor.axes:
            found = {horizon: _measured(one, horizon) for horizon in HORIZONS}
            if len(set(found.values())) == 1:
                lines.append(
                    f"Horizon sweep of {one.axis}: N and K are the same at horizons of 0.1 s to 100 s."
                    f"{_two_states(one)}"
                )
                continue
            each = [f"{horizon:g} s: N {white}, K {walk}" for horizon, (white, walk) in found.items()]
            lines.append(f"Horizon sweep of {one.axis} (N {si[0]}, K {si[1]}): {'; '.join(each)}.{_two_states(one)}")
    return lines


def _two_states(one: AxisNoise) -> str:
    """Return a sentence with the errors of N and K and of two Gauss-Markov states, or "" if these are not much
    better."""
    found = two_states(one.fit, one.use.horizon)
    if found is None or found.error_of_walk < max(FAR, NEARER * found.error):
        return ""
    return (
        f" From {duration_text(found.low, 3)} to {duration_text(found.high, 3)}, the Allan deviation of N and K is "
        f"{apart(found.error_of_walk)} the Allan deviation of the model. With two Gauss-Markov states, it is "
        f"{apart(found.error)} the Allan deviation of the model: for a filter with two states, use the format "
        "state-space."
    )


def _measured(one: AxisNoise, horizon: float) -> tuple[str, str]:
    """Return N and K at a horizon as text, or "none" if the model has no such noise at this horizon."""
    known: dict[tuple[float, str], tuple[str, str]] = one.fit.__dict__.setdefault("_swept", {})
    key = horizon, one.use.flicker
    if key not in known:
        entries = noise_in_use(one.fit, Use(horizon, one.use.flicker), 0.95)
        shown = [entries[symbol] for symbol in ("N_eff", "K_eff")]
        white, walk = (f"{e.value:.3g}" if e.value > 0 and not e.upper_only else "none" for e in shown)
        known[key] = white, walk
    return known[key]
