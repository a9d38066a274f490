"""Detect when a unit that was moved is at rest again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gmwm.applications.monitor.axis import MonitoredAxis
from gmwm.applications.monitor.stored import numbers, whole
from gmwm.applications.monitor.whitening import Whitener
from gmwm.base.arrays import Vector
from gmwm.base.documents import plain_fields


@dataclass(frozen=True)
class Stillness:
    """State of the detection: samples of the present block, and number of blocks without motion before it."""

    calm: int = 0  # number of consecutive blocks without motion
    samples: int = 0  # number of samples since the motion was detected
    held: Mapping[str, Vector] = field(default_factory=dict)  # samples of the present block

    def update(
        self, parts: Mapping[str, Vector], axes: Mapping[str, MonitoredAxis], naming: int
    ) -> tuple[int, Stillness, bool]:
        """Add samples of all axes. Return the number of used samples, the new state, and whether the unit rests."""
        block = max(naming, 32)  # without motion, the ratio below exceeds its limit once in 10¹⁰ blocks
        filled = next(iter(self.held.values())).size if self.held else 0
        used = min(next(iter(parts.values())).size, block - filled)
        held = {
            axis: np.concatenate([self.held[axis], x[:used]]) if self.held else x[:used] for axis, x in parts.items()
        }
        if filled + used < block:
            return used, replace(self, held=held, samples=self.samples + used), False
        for axis, x in held.items():
            errors, usual = Whitener(axes[axis].gain).update(x), float(axes[axis].settings.ratios[0])
            if not float(np.mean(np.square(errors))) < 4.0 * usual:
                return used, Stillness(0, self.samples + used), False
        return used, Stillness(self.calm + 1, self.samples + used), self.calm + 1 >= 3

    def broken(self) -> Stillness:
        """Return the state after a gap."""
        return Stillness(samples=self.samples)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as numbers and lists."""
        return plain_fields(self, "calm samples held")

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Stillness:
        """Create a state from the result of `to_dict`."""
        held = {axis: numbers(x) for axis, x in content["held"].items()}
        return cls(whole(content["calm"]), whole(content["samples"]), held)
