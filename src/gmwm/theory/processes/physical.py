"""Coefficients of a process in continuous time, as datasheets state them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Physical:
    """Coefficient of a process in continuous time, as datasheets state it.

    Parameters
    ----------
    symbol : str
        Symbol, for example "N".
    title : str
        Name, for example "white noise density".
    value : float
        Value in (unit of the signal)^`signal_power` · s^`time_power`. Only the slope of a drift can be negative.
    time_power : float
        Exponent of the second in the unit: 1, ½, 0, −½ or −1.
    signal_power : int
        Exponent of the unit of the signal: 1, or 0 for a time, a frequency or a pure number.
    slopes : mapping of parameter name to float
        Derivative ∂ ln|value| / ∂ ln|θ| for each parameter θ on which the value depends.
    """

    symbol: str
    title: str
    value: float
    time_power: float
    signal_power: int = 1
    slopes: Mapping[str, float] = field(default_factory=dict)
