"""After the unit was moved: is it still again?"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gmwm._arrays import Vector
from gmwm.monitor.axis import Axis
from gmwm.monitor.stored import numbers, whole
from gmwm.monitor.whitening import Whitener

CALM = 3
"""Number of blocks in a row in which a unit that was moved must be still."""
LOUD = 4.0
"""Ratio of mean squares above which a block is not still: noise of twice its standard deviation."""
SHORTEST = 32
"""Least number of samples in a block; the ratio of still blocks then exceeds LOUD once in 10¹⁰."""


@dataclass(frozen=True)
class Stillness:
    """Samples of the present block, and the number of still blocks before it.

    Attributes
    ----------
    calm : int
    samples : int
        Number of samples since the motion was seen.
    held : mapping of axis to (n,) array
    """

    calm: int = 0
    samples: int = 0
    held: Mapping[str, Vector] = field(default_factory=dict)

    def update(self, parts: Mapping[str, Vector], axes: Mapping[str, Axis], naming: int) -> tuple[int, Stillness, bool]:
        """Add samples of all axes. Returns the number used, the new state, and whether the unit is still."""
        block = max(naming, SHORTEST)
        filled = next(iter(self.held.values())).size if self.held else 0
        used = min(next(iter(parts.values())).size, block - filled)
        held = {
            axis: np.concatenate([self.held[axis], x[:used]]) if self.held else x[:used] for axis, x in parts.items()
        }
        if filled + used < block:
            return used, replace(self, held=held, samples=self.samples + used), False
        calm = self.calm + 1 if all(_still(axes[axis], x) for axis, x in held.items()) else 0
        return used, Stillness(calm, self.samples + used), calm >= CALM

    def broken(self) -> Stillness:
        """The state after a gap."""
        return Stillness(samples=self.samples)

    def to_dict(self) -> dict[str, Any]:
        """The state as numbers and lists."""
        return {"calm": self.calm, "samples": self.samples, "held": {axis: x.tolist() for axis, x in self.held.items()}}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Stillness:
        """Make a state from the result of `to_dict`."""
        held = {axis: numbers(x) for axis, x in content["held"].items()}
        return cls(whole(content["calm"]), whole(content["samples"]), held)


def _still(axis: Axis, x: Vector) -> bool:
    errors = Whitener(axis.gain).update(x)
    return float(np.mean(np.square(errors))) < LOUD * float(axis.settings.ratios[0])
