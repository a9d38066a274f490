"""Detect when a unit that was moved is at rest again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gmwm.applications.monitor.axis import Axis
from gmwm.applications.monitor.stored import numbers, whole
from gmwm.applications.monitor.whitening import Whitener
from gmwm.base.arrays import Vector

CALM = 3
"""A unit is at rest again after this number of consecutive blocks without motion."""
LOUD = 4.0
"""A block contains motion if the mean square of its innovations exceeds the expected one by this factor. The standard
deviation is then twice the expected one."""
SHORTEST = 32
"""Smallest number of samples in a block. Without motion, the ratio of mean squares then exceeds LOUD once in 10¹⁰
blocks."""


@dataclass(frozen=True)
class Stillness:
    """State of the detection: samples of the present block, and number of blocks without motion before it."""

    calm: int = 0  # number of consecutive blocks without motion
    samples: int = 0  # number of samples since the motion was detected
    held: Mapping[str, Vector] = field(default_factory=dict)  # samples of the present block

    def update(self, parts: Mapping[str, Vector], axes: Mapping[str, Axis], naming: int) -> tuple[int, Stillness, bool]:
        """Add samples of all axes. Return the number of used samples, the new state, and whether the unit rests."""
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
        """Return the state after a gap."""
        return Stillness(samples=self.samples)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as numbers and lists."""
        return {"calm": self.calm, "samples": self.samples, "held": {axis: x.tolist() for axis, x in self.held.items()}}

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Stillness:
        """Create a state from the result of `to_dict`."""
        held = {axis: numbers(x) for axis, x in content["held"].items()}
        return cls(whole(content["calm"]), whole(content["samples"]), held)


def _still(axis: Axis, x: Vector) -> bool:
    errors = Whitener(axis.gain).update(x)
    return float(np.mean(np.square(errors))) < LOUD * float(axis.settings.ratios[0])
