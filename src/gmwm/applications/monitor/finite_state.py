"""State-space models for the monitor, with sinusoids that change slowly and with the constant level as a state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ModelError
from gmwm.base.remarks import Remark
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import approximation_remarks
from gmwm.theory.processes.model import Model
from gmwm.theory.statespace import StateSpace


@dataclass(frozen=True, eq=False)
class Finite:
    """State-space form of a model for the monitor."""

    # State space of all terms. It includes a state for the constant level if no term has a diffuse level.
    space: StateSpace
    # (p,) mask of the states that are not constant: False only for the state of the constant level
    moving: NDArray[np.bool_]
    slope: float  # slope of the drifts, in the unit of the signal per sample
    remarks: tuple[Remark, ...]  # remarks on terms whose state space is an approximation

    @classmethod
    def of(cls, model: Model, rate: float) -> Finite:
        """Return the state-space form of a model with values."""
        missing = [name for name, value in model.parameters.items() if value is None]
        if missing:
            raise ModelError(
                f"the monitor of {model} needs a value for {', '.join(missing)}",
                advice="Write the values into the model, or calibrate a recording.",
            )
        spaces: list[StateSpace] = []
        slope = 0.0
        for process in model.processes:
            if process.scale == 0:
                continue
            if is_ramp(process, rate):
                slope += float(process.mean(np.array([1.0]))[0])
            elif process.line(rate) is not None:
                spaces.append(_line(process, rate))
            else:
                spaces.append(process.state_space(rate))
        if not any(np.any(space.Q) or np.any(space.R) for space in spaces):
            raise ModelError(f"{model} has no noise", advice="Add white noise, or another term that is not zero.")
        level = not any(np.any(space.diffuse) for space in spaces)
        if level:
            spaces.append(StateSpace(F=1.0, Q=0.0, H=1.0, diffuse=[True]))
        joined = StateSpace.sum(spaces)
        moving = np.ones(joined.states, dtype=np.bool_)
        if level:
            moving[-1] = False
        return cls(joined, moving, slope, approximation_remarks(model, rate))


def _line(process: Process, rate: float) -> StateSpace:
    """Return the state space of a sinusoid of slowly changing amplitude and phase, with the power of the process."""
    space = process.state_space(rate)
    # Correlation time (s), a choice: disturbances of machines and of mains drift slowly.
    decay = math.exp(-1.0 / (300.0 * rate))
    return StateSpace(F=decay * space.F, Q=(1.0 - decay**2) * space.P0, H=space.H, R=space.R, P0=space.P0)
