"""Parameters of a process in continuous time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Physical:
    """A continuous-time value of a process, as in datasheets.

    Parameters
    ----------
    symbol : str
        Symbol, for example "N".
    title : str
        Name, for example "white noise density".
    value : float
        Value in (unit of the signal)^`signal_power` · s^`time_power`. Only values such as the slope of a drift can be
        negative.
    time_power : float
        1, ½, 0, −½ or −1.
    signal_power : int
        1, or 0 for a time or a frequency.
    slopes : mapping of parameter name to float
        ∂ ln|value| / ∂ ln|θ| for each parameter on which the value depends.
    """

    symbol: str
    title: str
    value: float
    time_power: float
    signal_power: int = 1
    slopes: Mapping[str, float] = field(default_factory=dict)
