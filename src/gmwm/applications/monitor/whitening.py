"""Compute the standardised innovations of a signal with the Kalman filter of its model, chunk by chunk.

With a constant gain K they are a fixed filter's output, zeros F and poles Φ = F − K H. The exact transient is e_t = ε_t
+ H Φᵗ B u, with a known prior of u (diffuse for levels), by recursive least squares per sample, so chunks have no
effect. Durbin and Koopman (2012), Time Series Analysis by State Space Methods, chapter 5; de Jong (1991), Annals of
Statistics 19, 1073-1083."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import ModelError
from gmwm.base.remarks import Remark
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import approximation_remarks
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.validation import require_values
from gmwm.theory.statespace import StateSpace


def whole(value: Any) -> int:
    """Check that a value is a whole number, and return it."""
    if type(value) is not int or abs(value) > 1 << 62:  # sample numbers are 64-bit integers
        raise ValueError(f"expected a whole number; got {value!r:.50}")
    return value


def require_scale(axis: str, variance: float) -> None:
    """Raise a ValueError if squares of the innovations of an axis, relative to their variance, would overflow."""
    if not 1e-100 < variance < 1e100:
        raise ValueError(f"the innovations of {axis} must have a variance from 1e-100 to 1e100; got {variance:.3g}")


def wholes(values: Any, like: Sequence[int]) -> tuple[int, ...]:
    """Check that `values` contains whole numbers and has the length of `like`, and return the numbers."""
    if len(values) != len(like):
        raise ValueError(f"expected {len(like)} whole numbers; got {len(values)}")
    return tuple(map(whole, values))


def number(value: Any) -> float:
    """Check that a value is a number, and return it as a float."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 1e100:
        raise ValueError(f"expected a number; got {value!r:.50}")
    return float(value)


def numbers(values: Any) -> Vector:
    """Check that values are finite numbers, and return them as an array (n,)."""
    return np.array([number(value) for value in values], dtype=np.float64)


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
        require_values(model, "the monitor", "Write the values into the model, or calibrate a recording.")
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


FRAME_SAMPLES = 1024  # number of samples (a frame) for which the response to the initial state is computed in one step
DIFFUSE_INFORMATION = 1e-12
"""Prior information on a diffuse level over that of a sample. It agrees with the limit of zero to 12 digits."""


@dataclass(frozen=True, eq=False)
class Gain:
    """Constant-gain Kalman filter of a model."""

    finite: Finite
    # transition matrix, observation row and process noise of the model with its level
    F: Matrix
    H: Vector
    Q: Matrix
    P: Matrix  # (p, p) steady-state covariance of the predicted state; 0 for a constant level
    S: float  # variance of an innovation, in the squared unit of the signal
    phi: Matrix  # (p, p) Φ = F − K H, with the constant gain K
    # (p, m) B at the first sample: diffuse states, then the initial uncertainty of the others in excess of P.
    start: Matrix
    diffuse: int  # number of diffuse columns of `start`

    @classmethod
    def of(cls, finite: Finite) -> Gain:
        """Compute the constant-gain filter of a state-space model."""
        space = finite.space
        F, H, Q = np.array(space.F), np.array(space.H[0]), np.array(space.Q)
        p = H.size
        moving = finite.moving
        scale = float(H @ Q @ H) + float(space.R[0, 0])
        # Otherwise, quantization noise and averages with a zero on the unit circle have no stable filter.
        R = max(float(space.R[0, 0]), 1e-8 * scale)
        P = np.zeros((p, p))
        at = np.ix_(moving, moving)
        if np.any(moving):
            try:
                P[at] = scale * _riccati(F[at], H[moving], Q[at] / scale, R / scale)
            except np.linalg.LinAlgError as error:
                raise ModelError("the Kalman filter of the model has no constant gain") from error
        S = float(H @ P @ H) + R
        K = F @ P @ H / S
        K[~moving] = 0.0
        stationary = moving & ~space.diffuse
        beyond = (space.P0 - P)[np.ix_(stationary, stationary)]
        values, vectors = np.linalg.eigh(0.5 * (beyond + beyond.T))
        mask = values > 1e-9 * max(float(np.max(values, initial=0.0)), 1e-300)
        columns = np.zeros((p, int(np.count_nonzero(mask))))
        columns[stationary] = vectors[:, mask] * np.sqrt(values[mask])
        levels = np.eye(p)[:, space.diffuse] * math.sqrt(S)
        start = np.concatenate([levels, columns], axis=1)
        phi = F - np.outer(K, H)
        return cls(finite, F, H, Q, P=P, S=S, phi=phi, start=start, diffuse=levels.shape[1])

    @cached_property
    def sections(self) -> Matrix:
        """Second-order sections (k, 6) of the linear filter that computes innovations from the signal."""
        moving = self.finite.moving
        if not np.any(moving):
            return np.array([[1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
        at = np.ix_(moving, moving)
        return _sections(np.linalg.eigvals(self.F[at]), np.linalg.eigvals(self.phi[at]))

    @cached_property
    def responses(self) -> Matrix:
        """Responses H Φⁱ/√S (p, FRAME) of standardised innovations to the initial state, for i = 0 … FRAME − 1."""
        rows = np.empty((FRAME_SAMPLES, self.H.size))
        rows[0] = self.H / math.sqrt(self.S)
        for k in range(1, FRAME_SAMPLES):
            rows[k] = rows[k - 1] @ self.phi
        return np.ascontiguousarray(rows.T)

    @cached_property
    def frame_step(self) -> Matrix:
        """Φ^FRAME, the transition over one frame."""
        return np.linalg.matrix_power(self.phi, FRAME_SAMPLES)

    def after_gap(self, samples: int) -> Matrix:
        """Return B (p, m) after a gap: a factor of the covariance that missing samples add to the predicted state."""
        P, power = self.P.copy(), self.P.copy()
        for _ in range(samples):
            power = self.F @ power @ self.F.T + self.Q
        values, vectors = np.linalg.eigh(0.5 * (power - P + (power - P).T))
        mask = values > 1e-12 * self.S
        return np.asarray(vectors[:, mask] * np.sqrt(values[mask]))

    def step_response(self, samples: int) -> Vector:
        """Return the standardised innovations (n,) that a jump of the signal by 1 causes."""
        response = np.ones(samples)
        _core.second_order_sections(self.sections, np.zeros((len(self.sections), 2)), response)
        return np.asarray(response / math.sqrt(self.S))

    def magnitude(self, cycles: float) -> float:
        """Return the amplitude of standardised innovations for a unit sinusoid at a frequency (cycles per sample)."""
        z = np.exp(-2j * np.pi * cycles) ** np.arange(3)
        return float(np.prod(np.abs(self.sections[:, :3] @ z) / np.abs(self.sections[:, 3:] @ z))) / math.sqrt(self.S)


def _sections(zeros: NDArray[Any], poles: NDArray[Any]) -> Matrix:
    """Return second-order sections with the given zeros and the same number of poles. The poles nearest to the unit
    circle come last, each pair with the nearest zeros, so that no section has a large gain."""
    pairs = _roots(zeros)
    rows = []
    for pole in _roots(poles):
        nearest = min(range(len(pairs)), key=lambda k: abs(pairs[k][0] - pole[0]))
        rows.append([*_polynomial(pairs.pop(nearest)), *_polynomial(pole)])
    return np.array(rows[::-1])


def _roots(roots: NDArray[Any]) -> list[tuple[complex, complex]]:
    """Group roots in conjugate or real pairs, the largest first; a root at 0 completes an odd number of real roots."""
    real = sorted(roots.real[np.abs(roots.imag) < 1e-12].tolist(), key=abs, reverse=True)
    real += [0.0] * (len(real) % 2)
    pairs = [(z, z.conjugate()) for z in roots[roots.imag >= 1e-12].tolist()]
    pairs += [(a, b) for a, b in zip(real[::2], real[1::2], strict=True)]
    return sorted(pairs, key=lambda pair: abs(pair[0]), reverse=True)


def _polynomial(roots: tuple[complex, complex]) -> list[float]:
    """Return the coefficients of (1 − r z)(1 − s z) for two roots r and s."""
    first, second = roots
    return [1.0, -(first + second).real, (first * second).real]


def _riccati(F: Matrix, H: Vector, Q: Matrix, R: float) -> Matrix:
    """Return the steady-state covariance of the predicted state, by doubling (Anderson 1978, Second-order convergent
    algorithms for the steady-state Riccati equation, Int. J. Control 28, 295-306) for the filtered state: its noise H w
    + v is never small, unlike v."""
    eye = np.eye(H.size)
    seen, common = H @ F, Q @ H
    variance = float(H @ common) + R
    A = (F - np.outer(common, seen) / variance).T
    G, X = np.outer(seen, seen) / variance, Q - np.outer(common, common) / variance
    for _ in range(60):
        inner = np.linalg.solve(eye + G @ X, np.concatenate([A, G], axis=1))
        W, V = inner[:, : H.size], inner[:, H.size :]
        more = A.T @ X @ W
        G = G + A @ V @ A.T
        A = A @ W
        X = X + 0.5 * (more + more.T)
        if np.max(np.abs(more)) <= 1e-15 * np.max(np.abs(X)):
            break
    return np.asarray(F @ X @ F.T + Q)


class Whitener:
    """Computes the standardised innovations of one axis from chunks of any size."""

    STATE = ("sections", "origin", "count", "drifted", "columns", "power", "information", "moments")

    def __init__(self, gain: Gain) -> None:
        self.gain = gain
        self.drifted = 0  # samples since the beginning, to subtract a drift of known slope
        self.restart()

    def restart(self) -> None:
        """Restart the filter with an unknown level."""
        self.sections = np.zeros((len(self.gain.sections), 2))
        self.origin: float | None = None
        self._settle(self.gain.start, self.gain.diffuse)

    def _settle(self, start: Matrix, diffuse: int) -> None:
        self.count = 0  # samples since the least-squares estimation of u started
        m = start.shape[1]
        self.columns = m
        self.power = np.ascontiguousarray(start)  # Φ^(FRAME k) B for the present frame k
        self.information = np.diag([DIFFUSE_INFORMATION] * diffuse + [1.0] * (m - diffuse)) if m else np.zeros((0, 0))
        self.moments = np.zeros(m)

    def update(self, x: Vector) -> Vector:
        """Return the standardised innovations (n,) of the next samples (n,), which are in the unit of the model."""
        if not x.size:
            return np.zeros(0)
        slope = self.gain.finite.slope
        if slope:
            x = x - slope * np.arange(self.drifted, self.drifted + x.size)
        self.drifted += x.size
        if self.origin is None:
            self.origin = float(x[0])
        out = np.array(x - self.origin, dtype=np.float64)
        self.sections = self.sections.copy()
        _core.second_order_sections(self.gain.sections, self.sections, out)
        out /= math.sqrt(self.gain.S)
        if self.columns:
            power, information, self.moments, self.count = _core.subtract_initial_state(
                # The sample that first determines a diffuse level has an innovation of infinite variance, which is not
                # used. A mean square of 1e-6 is 1/60 of the variance in a mean of 2^14 samples.
                self.gain.responses, self.gain.frame_step, 1e-3 / DIFFUSE_INFORMATION, 1e-6, self.power,
                self.information, self.moments, self.count, out
            )  # fmt: skip
            m = self.columns = self.moments.size
            self.power, self.information = power.reshape(self.gain.H.size, m), information.reshape(m, m)
        return out

    def gap(self, samples: int | None) -> bool:
        """Continue after missing samples, None if their number is unknown; return whether the level is still known."""
        # The level is unknown after a longer gap.
        short = samples is not None and samples <= 1000 and self.origin is not None
        added = self.gain.after_gap(samples) if samples is not None and short else np.zeros((self.gain.H.size, 0))
        # Noise of less than 1 % of an innovation's variance is ignored, so that lost samples do not hide slow changes.
        noise = float(np.sum((self.gain.H @ added) ** 2)) / self.gain.S
        if samples is None or not short or (self.columns and noise > 0.01):
            self.drifted += samples or 0
            self.restart()
            return False
        self.sections = self.sections.copy()
        for _ in range(samples):
            # Insert the sample that the filter predicts, so that its innovation is zero.
            predicted = np.zeros(1)
            _core.second_order_sections(self.gain.sections, self.sections.copy(), predicted)
            _core.second_order_sections(self.gain.sections, self.sections, -predicted)
        self.drifted += samples
        if noise > 0.01:
            self._settle(added, 0)
        return True

    def save(self) -> dict[str, Any]:
        """Return the state. Its arrays are never modified in place."""
        return {name: getattr(self, name) for name in self.STATE}

    def load(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `save`."""
        self.sections = np.array([numbers(row) for row in state["sections"]]).reshape(len(self.gain.sections), 2)
        self.origin = None if state["origin"] is None else number(state["origin"])
        self.count, self.drifted = whole(state["count"]), whole(state["drifted"])
        m = self.columns = whole(state["columns"])
        self.power = numbers([value for row in state["power"] for value in row]).reshape(self.gain.H.size, m)
        self.information = numbers([value for row in state["information"] for value in row]).reshape(m, m)
        self.moments = numbers(state["moments"]).reshape(m)
        if np.any(np.linalg.eigvalsh(self.information) <= 0):
            raise ValueError("the information of the filter must be positive definite")
