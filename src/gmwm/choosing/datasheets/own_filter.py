"""Prediction error of the Kalman filter that holds the full model of a noise, the least of all linear filters."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from gmwm.base.errors import GmwmError
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace


def smallest_error(processes: Iterable[Process], rate: float, samples: int) -> float | None:
    """Return the mean square error of the steady-state filter of the full model for the mean of n samples, without
    sinusoids and ramps; None without a state space or a solution of the Riccati equation in double precision."""
    from scipy.linalg import LinAlgError, solve_discrete_are

    noises = [p for p in processes if p.scale > 0 and p.line(rate) is None]
    try:
        noises = [p for p in noises if p.has("psd") or not is_ramp(p, rate)]
        space = StateSpace.sum([p.state_space(rate) for p in noises])
    except GmwmError:
        return None
    measured = float(space.R[0, 0])
    if space.states == 0:
        return measured / samples
    # Variance of the measurement noise that is added to a model without any, relative to the variance of its
    # innovations. The Riccati equation cannot be solved without it.
    floor = 1e-8 * (measured + float((space.H @ space.Q @ space.H.T)[0, 0]))
    try:
        before = solve_discrete_are(space.F.T, space.H.T, space.Q, np.array([[measured + floor]]))
    except (LinAlgError, ValueError):
        return None
    start = StateSpace(space.F, space.Q, space.H, space.R, m0=space.m0, P0=(before + before.T) / 2)
    error = float(start.block_variance([samples])[0]) / samples**2
    return error if math.isfinite(error) and error > 0 else None
