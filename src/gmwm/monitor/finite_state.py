"""Models with a finite state for the monitor: power-law noise becomes a sum of Gauss-Markov processes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Matrix
from gmwm.errors import ModelError
from gmwm.likelihood.system import is_ramp
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.statespace import StateSpace

LONGEST = 22
"""Scale 2^LONGEST (samples) up to which the Gauss-Markov processes follow the wavelet variance."""
STEP = 2
"""The correlation times grow by 2^STEP. A factor of 4 leaves 1 % of ripple in the wavelet variance of flicker noise
(tests/monitor/test_whitening.py)."""
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
    replaced : tuple of str
        Labels of the terms that Gauss-Markov processes replace.
    misfit : float
        Largest relative difference of the wavelet variances of the terms and their replacements.
    """

    space: StateSpace
    moving: NDArray[np.bool_]
    slope: float
    replaced: tuple[str, ...]
    misfit: float

    @classmethod
    def of(cls, model: Model, rate: float) -> Finite:
        """The finite state of a model with values.

        Raises
        ------
        ModelError
            If a parameter has no value, or all noise is zero.
        """
        missing = [name for name, value in model.parameters.items() if value is None]
        if missing:
            raise ModelError(
                f"the monitor of {model} needs a value for {', '.join(missing)}",
                advice="Write the values into the model, or calibrate a recording.",
            )
        spaces: list[StateSpace] = []
        slope, misfit, replaced = 0.0, 0.0, []
        for label, process in zip(model.terms, model.processes, strict=True):
            if process.scale == 0:
                continue
            if is_ramp(process, rate):
                slope += float(process.mean(np.array([1.0]))[0])
            elif not process.has("state_space"):
                ladder, error = _ladder(process, rate)
                spaces.append(ladder)
                replaced.append(label)
                misfit = max(misfit, error)
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
        return cls(joined, moving, slope, tuple(replaced), misfit=misfit)


def _line(process: Process, rate: float) -> StateSpace:
    """A line whose amplitude and phase change slowly, with the power of the process."""
    space = process.state_space(rate)
    decay = math.exp(-1.0 / (COHERENCE * rate))
    return StateSpace(F=decay * space.F, Q=(1.0 - decay**2) * space.P0, H=space.H, R=space.R, P0=space.P0)


def _ladder(process: Process, rate: float) -> tuple[StateSpace, float]:
    """White noise and Gauss-Markov processes with the wavelet variance of a process, and the largest relative error."""
    from scipy.optimize import nnls

    wanted = process.wavelet_variance(LONGEST, rate)
    lags = 2.0 ** np.arange(-1.0, LONGEST + 2 * STEP + 1, STEP)
    decays = np.exp(-1.0 / lags)
    parts = [StateSpace(F=0.0, Q=0.0, H=0.0, R=1.0)]
    parts += [StateSpace(F=decay, Q=1.0 - decay**2, H=1.0, P0=1.0) for decay in decays]
    design: Matrix = np.array([part.haar_variance(LONGEST) for part in parts]).T
    scale = np.max(design, axis=0)
    weights, _ = nnls(design / scale / wanted[:, None], np.ones(LONGEST), maxiter=1000)
    weights = weights / scale
    error = float(np.max(np.abs(design @ weights / wanted - 1.0)))
    chosen = [_scaled(part, weight) for part, weight in zip(parts, weights.tolist(), strict=True) if weight > 0]
    return StateSpace.sum(chosen), error


def _scaled(space: StateSpace, factor: float) -> StateSpace:
    return StateSpace(
        F=space.F, Q=factor * space.Q, H=space.H, R=factor * space.R, P0=factor * space.P0, diffuse=space.diffuse
    )
