"""What a process says of itself in continuous time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Physical:
    """One number of a process in continuous time, as datasheets tell it.

    Parameters
    ----------
    symbol : str
        Its symbol, "N".
    title : str
        What it is, "white noise density".
    value : float
        In (unit of the signal)^`signal_power` · s^`time_power`; with a sign only where its process has one.
    time_power : float
        1, ½, 0, −½ or −1.
    signal_power : int
        1, or 0 for a time.
    slopes : mapping of parameter name to float
        ∂ ln|value| / ∂ ln|θ| of each parameter that it depends on.
    """

    symbol: str
    title: str
    value: float
    time_power: float
    signal_power: int = 1
    slopes: Mapping[str, float] = field(default_factory=dict)
