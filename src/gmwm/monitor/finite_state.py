"""Models with a finite state for the monitor: lines change slowly, and a constant level is a state."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm.errors import ModelError
from gmwm.likelihood.system import is_ramp
from gmwm.processes.base import Process
from gmwm.processes.ladder import approximated
from gmwm.processes.model import Model
from gmwm.remarks import Remark
from gmwm.statespace import StateSpace

COHERENCE = 300.0
"""Correlation time (s) of the amplitude and the phase of a line. A choice: lines of machines and of the mains drift."""


@dataclass(frozen=True, eq=False)
class Finite:
    """A model with a finite state.

    Attributes
    ----------
    space : StateSpace
        The state space of the terms and of the level, if no term has a diffuse level.
    moving : (p,) array of bool
        States with process noise; the others are constant levels.
    slope : float
        Drift per sample (u).
    remarks : tuple of Remark
        Remarks on terms whose state space is an approximation.
    """

    space: StateSpace
    moving: NDArray[np.bool_]
    slope: float
    remarks: tuple[Remark, ...]

    @classmethod
    def of(cls, model: Model, rate: float) -> Finite:
        """The finite state of a model with values.

        Raises
        ------
        ModelError
            If a parameter has no value, or all noise is zero.
        MissingTheoryError
            If a term has no state-space form.
        """
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
        return cls(joined, moving, slope, approximated(model, rate))


def _line(process: Process, rate: float) -> StateSpace:
    """A line whose amplitude and phase change slowly, with the power of the process."""
    space = process.state_space(rate)
    decay = math.exp(-1.0 / (COHERENCE * rate))
    return StateSpace(F=decay * space.F, Q=(1.0 - decay**2) * space.P0, H=space.H, R=space.R, P0=space.P0)
