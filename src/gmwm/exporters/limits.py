"""Which numbers of a file are upper limits, of which axes, and what was measured beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gmwm.exporters.reduction import NAMES, Number, Rule, SensorNoise
from gmwm.units import SI_UNIT, noise_unit

_TIME_POWER = {"N": 0.5, "K": -0.5, "B": 0.0}
_MARK = "UPPER LIMIT, not a measured value:"


def upper_limits(sensors: Sequence[SensorNoise], rule: Rule, confidence: float) -> list[str]:
    """What a file is to say of its upper limits, a paragraph each.

    Parameters
    ----------
    sensors : sequence of SensorNoise
    rule : "worst", "mean" or "each"
    confidence : float
        Level of the intervals of the calibration.
    """
    level = 50 + 50 * confidence
    whole: list[str] = []
    mixed: list[str] = []
    for sensor in sensors:
        for symbol in _TIME_POWER:
            if symbol == "B" and not sensor.axes[0].use.flicker:
                continue
            axes: dict[str, Number] = {one.axis: getattr(one, symbol) for one in sensor.axes}
            bounded = [axis for axis, number in axes.items() if number.upper]
            if rule == "each":
                whole += [f"{symbol} of {axis}" for axis in bounded]
            elif getattr(sensor, symbol)[0].upper:
                name = f"{symbol} of the {NAMES[sensor.quantity]}"
                if len(bounded) == len(axes):
                    whole.append(name)
                else:
                    unit = noise_unit(_TIME_POWER[symbol], SI_UNIT[sensor.quantity])[0]
                    mixed.append(f"{_MARK} {name} {_mixed(axes, rule, level, unit)}")
    if not whole:
        return mixed
    it, none = ("it", "it is not") if len(whole) == 1 else ("these", "none is")
    return [
        f"{_MARK} {', '.join(whole)}. The data cannot tell {it} from zero; they only say that {none} larger "
        f"({level:g} %, before inflation).",
        *mixed,
    ]


def _mixed(axes: Mapping[str, Number], rule: Rule, level: float, unit: str) -> str:
    """Of one number for axes of which some are measured and others only bounded: which, and what each has."""
    bounded = {axis: number.value for axis, number in axes.items() if number.upper}
    if rule == "worst":
        # A measured axis that is larger would be the number.
        whose = f"is the upper limit of {max(bounded, key=lambda axis: bounded[axis])}"
    else:
        whose = f"is a root mean square with the upper limit{'s' * (len(bounded) > 1)} of {' and '.join(bounded)}"
    # Zero is what an axis has nothing of, as no flicker noise.
    each = ", ".join(
        f"{axis} {'≤ ' if number.upper else ''}{number.value:.2e}{'' if number.upper else ' (measured)'}"
        for axis, number in axes.items()
        if number.value > 0
    )
    told = f"Axis by axis, before inflation, in {unit}: {each}."
    return f"{whose}, whose data cannot tell it from zero ({level:g} %). {told}"
