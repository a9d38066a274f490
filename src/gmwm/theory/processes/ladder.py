"""State spaces of power-law noise and Matérn processes, as sums of Gauss-Markov processes.

Correlation times differ by factors of 8. |ω|^(−α), 0 < α < 2, mixes the spectra of all reciprocal times b:

    ∫ s²(b) 2b/(b² + ω²) db/b ∝ |ω|^(−α)   for   s²(b) ∝ b^(1−α).

(β² + ω²)^(−p), 0 < p < 1, mixes 1/(b² + ω²) with b² = β² (1 + g) over g > 0. The trapezoidal rule in ln b or ln g has
the relative error 2 exp(−π²/h) for steps h, as the integrand is analytic up to ±π/2 (Trefethen and Weideman 2014, SIAM
Review 56, 385-458). Processes faster than sampling add up to white noise, slower than the recording to one. Their
variances are geometric series, so all are smooth in α and smoothness."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.remarks import Quantity, Remark
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.processes.self_similar import over_exponent, unit_factor
from gmwm.theory.statespace import StateSpace

if TYPE_CHECKING:
    from gmwm.theory.processes.base import Process
    from gmwm.theory.processes.model import Model

STEP = math.log(8.0)
"""Step of ln b; a factor of 8 leaves a ripple of 0.6 % in flicker noise (tests/processes/test_ladder.py)."""
FASTEST_RATE = 4.0  # largest b in 1/sample: faster processes are treated as white noise
LADDER_OCTAVES = 22  # the state space of power-law noise approximates the Allan deviation up to 2^BAND samples
SMOOTHEST = 5.0  # Largest smoothness of a Matérn process. A larger one has more states, which are nearly collinear.


@lru_cache(maxsize=256)
def power_law(epsilon: float) -> tuple[StateSpace, ContinuousStateSpace]:
    """Return discrete and continuous state spaces of power-law noise, ν_1² = 1, at 1 Hz, for ε = `epsilon` = α − 1.

    In discrete time, GM processes are averaged over each interval, as the noise is; the noise within is one more state,
    and F is diagonal. In continuous time, white noise replaces the fastest: a discretisation samples states."""
    alpha = 1.0 + epsilon
    # The slowest time is at least 2^(BAND + 5) samples, so that it is a random walk over 2^BAND.
    count = 1 + math.ceil((math.log(FASTEST_RATE) + (LADDER_OCTAVES + 5) * math.log(2.0)) / STEP)
    b = FASTEST_RATE * np.exp(-STEP * np.arange(count))
    # The density of the mixture at which the Allan variance is 2 n^ε is κ α(1 + α)/Γ(2 − α). At the ends, α = 0 and 2,
    # the factors α and 2 − α cancel with those of the geometric series.
    size = float(unit_factor(np.asarray(epsilon))) * (1.0 + alpha) / math.gamma(3.0 - alpha)
    s2 = 0.5 * size * alpha * (2.0 - alpha) * STEP * b ** (1.0 - alpha)
    series = float(over_exponent(np.asarray(alpha - 2.0), np.asarray(STEP)))
    s2[-1] = 0.5 * size * alpha * STEP * b[-1] ** (1.0 - alpha) / series
    white = (
        size * (2.0 - alpha) * STEP * FASTEST_RATE**-alpha / float(over_exponent(np.asarray(alpha), np.asarray(STEP)))
    )
    # Largest b (1/sample) of the processes in the continuous-time model. White noise replaces faster processes, whose
    # samples would add too much noise because they are not averaged over the sampling interval.
    fast = b > 0.1
    slow, power = b[~fast], s2[~fast]
    density = white + float(np.sum(2.0 * s2[fast] / b[fast]))
    smooth = ContinuousStateSpace(
        A=np.diag(-slow), Qc=np.diag(2.0 * slow * power), H=np.ones(slow.size), Rc=density, P0=np.diag(power)
    )
    return _average(b, s2, white), smooth


def _average(b: Vector, s2: Vector, white: float) -> StateSpace:
    """Return the state space of GM processes averaged over unit intervals, and `white` noise."""
    decay, lost = np.exp(-b), -np.expm1(-b)
    mean = lost / b
    direct = 2.0 * (b - lost) / b**2 - mean**2
    # b (1/sample) of a series for the variance of interval means, with a relative error below 1e-8.
    near = b < 1e-2
    direct[near] = b[near] * (2.0 / 3.0 - b[near] * (0.5 - b[near] * (7.0 / 30.0 - b[near] / 12.0)))
    within, shared = float(s2 @ direct), s2 * lost**2 / b
    # x' = e^(−b) x + w and mean = c x + v, Cov(w, v) = shared. Of w, v explains shared/within, and the state
    # x + e^b shared/within v follows with the same decay.
    carried = shared / (within or 1.0) / decay
    count = b.size
    noise, start = np.zeros((count + 1, count + 1)), np.zeros((count + 1, count + 1))
    noise[:count, :count] = np.diag(-s2 * np.expm1(-2.0 * b)) - np.outer(shared, shared) / (within or 1.0)
    start[:count, :count] = np.diag(s2)
    turn = np.append(carried, 1.0)
    for matrix in (noise, start):
        matrix += within * np.outer(turn, turn)
    return StateSpace(
        F=np.diag(np.append(decay, 0.0)), Q=noise, H=np.append(mean, 1.0 - float(mean @ carried)), R=white, P0=start
    )


@lru_cache(maxsize=256)
def matern(unit: float, nu: float) -> ContinuousStateSpace:
    """Return the state space of a Matérn process of variance 1, at 1 Hz, β = `unit` per sample, ν up to `SMOOTHEST`.

    (β² + ω²)^(−ν−½) is a mixture of GM processes, 0 < p ≤ 1, times factors 1/(β² + ω²), each GM driven by the one
    before. It is exact for ν = ½, 3/2, 5/2, …"""
    from scipy.linalg import solve_continuous_lyapunov

    chain = max(0, math.ceil(nu - 0.5))
    p = nu + 0.5 - chain
    top = max((FASTEST_RATE / unit) ** 2 - 1.0, 1.0)
    step = 2.0 * STEP
    g = top * np.exp(-step * np.arange(1 + math.ceil(math.log(top / 0.02) / step)))
    # The weights of the mixture at the nodes g, up to a common factor.
    sine = math.sin(math.pi * p) / math.pi
    weight = sine * step * g ** (1.0 - p)
    # `last` is the weight of all smaller g. sin πp/(e^(h(1 − p)) − 1) has the limit π/h for p = 1, where g is 0.
    last = g[-1] ** (1.0 - p) * (step * sine / math.expm1(step * (1.0 - p)) if p < 1.0 else 1.0)
    b = unit * np.sqrt(1.0 + np.append(g, 0.0))
    drive = np.append(weight, last)
    # Processes have drive/(b² + ω²), and the white noise the sum of drive/b² over faster ones.
    white = sine * step * g[0] ** -p / math.expm1(step * p) if p < 1.0 else 0.0
    # For p = 1, sin πp is a rounding error.
    able = drive > 1e-12 * last
    b, drive = b[able], drive[able]
    count = b.size + chain
    a, density, seen = np.zeros((count, count)), np.zeros((count, count)), np.zeros(count)
    a[: b.size, : b.size] = np.diag(-b)
    density[: b.size, : b.size] = np.diag(drive * unit**2)
    for k in range(b.size, count):
        a[k, k] = -unit
        a[k, (slice(0, b.size) if k == b.size else k - 1)] = unit
    if chain:
        density[b.size, b.size] = white * unit**2
        seen[-1] = 1.0
    else:
        seen[:] = 1.0
    start = solve_continuous_lyapunov(a, -density)
    # The faster processes are white at the samples: the variance of each is drive β²/2b.
    # b is nearly β √g.
    remainder = 0.0
    if not chain and p != 1.0:
        remainder = 0.5 * unit * sine * step * math.pow(float(g[0]), 0.5 - p) / math.expm1(step * (p - 0.5))
    total = float(seen @ start @ seen) + remainder
    return ContinuousStateSpace(
        A=a, Qc=density / total, H=seen, Rc=remainder / total, P0=(start + start.T) / (2.0 * total)
    )


def start_at_zero(process: Process, rate: float) -> StateSpace:
    """Return a state space that starts at zero, as a walk does, so that slow noise of one curve starts alike.
    Oscillations (unknown phase) and noise without poles (no slow part) start stationary."""
    space = process.state_space(rate)
    if not process.scale or process.oscillation() is not None or not np.any(np.linalg.eigvals(space.F)):
        return space
    if process.stationary or not process.approximate:
        return StateSpace(F=space.F, Q=space.Q, H=space.H, R=space.R, P0=np.zeros_like(space.P0), m0=space.m0)
    # The last state is the noise within the first sampling interval. The rest of P0 is the variance of the processes.
    within = space.P0[:, -1]
    size = float(within[-1]) or 1.0
    return StateSpace(F=space.F, Q=space.Q, H=space.H, R=space.R, P0=np.outer(within, within) / size)


@lru_cache(maxsize=256)
def state_space_error(process: Process, rate: float) -> float:
    """Return the largest relative error of the state space's Allan deviation at 1, 2, 4, …, 2^22 samples."""
    if not process.approximate or process.scale == 0:
        return 0.0
    implied = 2.0 * process.state_space(rate).haar_variance(LADDER_OCTAVES + 1)
    error = float(
        np.max(np.abs(np.sqrt(implied / process.allan_variance(2 ** np.arange(LADDER_OCTAVES + 1), rate)) - 1.0))
    )
    # Relative error of the Allan deviation below which a state space counts as exact.
    return error if error > 1e-9 else 0.0


def approximation_remarks(model: Model, rate: float, axis: str = "") -> tuple[Remark, ...]:
    """Return a remark on the terms whose state space is an approximation, with the largest error."""
    named = model.by_term.items()
    errors = {term: error for term, process in named if (error := state_space_error(process, rate))}
    if not errors:
        return ()
    # The numbers are rounded, so that axes with the same approximation share one remark.
    share = Quantity(float(f"{100.0 * max(errors.values()):.2g}"), "%")
    longest = Quantity(float(f"{2.0**LADDER_OCTAVES / rate:.3g}"), "s")
    return (Remark.of("approximated", axis, case="states", terms=tuple(errors), error=share, longest=longest),)
