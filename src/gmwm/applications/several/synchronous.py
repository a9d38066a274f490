"""Check that signals were sampled together, and select axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from gmwm.base.arrays import as_rate, as_vector
from gmwm.base.axis_names import AXES, axis_quantity
from gmwm.base.errors import DataError, OptionError
from gmwm.base.units import SI_UNIT
from gmwm.recording.gaps import fill_gaps
from gmwm.recording.signals import Imu, Signal


def synchronous_signals(x: Any, rate: float | None, *, fill: bool = True) -> dict[str, Signal]:
    """Return the signals by name, after a check that they are synchronous. With `fill`, short gaps are filled."""
    x = x.signals if isinstance(x, Imu) else x
    if not isinstance(x, Mapping):
        raise DataError(argument="x", expected="a recording, or a mapping of names to signals", got=x)
    signals: dict[str, Signal] = {}
    for name, item in x.items():
        if not isinstance(item, Signal):
            # As in `Imu.from_arrays`, arrays of the axes of an IMU are in SI units. "gyro_x[2]" is an axis of unit 2.
            axis = name.partition("[")[0].strip()
            unit = SI_UNIT[axis_quantity(axis)] if axis in AXES else ""
            item = Signal(as_vector(item, name), as_rate(rate), unit, name)
        elif rate is not None and as_rate(rate) != item.rate:
            raise DataError(f"rate={rate:g} contradicts the rate of {name}, {item.rate:g} Hz", argument="rate")
        signals[name] = item
    if len(signals) < 2:
        raise DataError(argument="x", expected="at least two signals", got=list(signals))
    first, *others = signals
    reference = signals[first]
    for name in others:
        other = signals[name]
        for what, same in (
            ("rate", other.rate == reference.rate),
            ("length", other.values.size == reference.values.size),
            ("gaps", other.segments == reference.segments),
        ):
            if not same:
                raise DataError(
                    f"{first} and {name} differ in their {what}", argument="x",
                    advice="Pass signals that were sampled together.",
                )  # fmt: skip
    return fill_gaps(signals) if fill else signals


def chosen_names(names: Sequence[str], axes: str | Sequence[str] | None) -> list[str]:
    """Return the names of the signals that `axes` selects by name or by sensor; all by default."""
    if axes is None:
        return list(names)
    selection = [axes] if isinstance(axes, str) else list(axes)
    chosen = [name for name in names if any(name == choice or name.startswith(f"{choice}_") for choice in selection)]
    missing = [
        choice for choice in selection if not any(name == choice or name.startswith(f"{choice}_") for name in chosen)
    ]
    if missing or len(chosen) < 2:
        raise OptionError(argument="axes", expected=f"two or more of {', '.join(names)}", got=axes)
    return chosen
