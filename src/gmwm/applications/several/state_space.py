"""State-space form of several signals with shared noise, in discrete and continuous time, and their smoother.

The unknown levels are coefficients with a flat prior, of a constant filtered with the same gains; walks start at 0.
Durbin and Koopman (2012), Time Series Analysis by State Space Methods, sections 4.4 and 5.7."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Booleans, Matrix, Vector, freeze
from gmwm.base.documents import plain
from gmwm.base.errors import DataError, OptionError
from gmwm.fitting.likelihood.problem import Record, as_record
from gmwm.fitting.likelihood.system import LEVEL
from gmwm.fitting.likelihood.tracks import BIAS, RATES_ALIKE, Tracks, wanders
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model
from gmwm.theory.statespace import StateSpace

if TYPE_CHECKING:
    from gmwm.applications.several.joint_fit import JointFit


class _Matrices:
    """Common methods of state spaces with the matrices `MATRICES`."""

    MATRICES: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        for name in self.MATRICES:
            freeze(getattr(self, name))

    def to_dict(self) -> dict[str, Any]:
        """Return the matrices as lists."""
        return {name: plain(value) for name, value in vars(self).items()}


@dataclass(frozen=True, kw_only=True, eq=False)
class JointStateSpace(_Matrices):
    """Discrete-time linear Gaussian state-space model of d signals with p states and a time step of one sample.

    x_{t+1} = F x_t + w_t, Var w = Q;  y_t = H x_t + v_t, Var v = R.

    Attributes
    ----------
    F, Q, P0 : (p, p) arrays
        Transition matrix, covariance of the process noise per sample, and initial covariance of the states.
    H : (d, p) array
        Observation matrix. It contains factors of the covariance matrices of the terms, so the states of different
        columns are independent.
    R : (d, d) array
        Covariance of the measurement noise of one sample; it is not diagonal if the signals share white noise.
    diffuse : (p,) array of bool
        Mask of the states without a stationary distribution.
    axes : tuple of str
        Names of the signals.
    terms : tuple of str
        Name of the term to which each state belongs.
    """

    MATRICES = ("F", "Q", "H", "R", "P0", "diffuse")
    F: Matrix
    Q: Matrix
    H: Matrix
    R: Matrix
    P0: Matrix
    diffuse: Booleans
    axes: tuple[str, ...]
    terms: tuple[str, ...]

    def along(self, weights: ArrayLike) -> StateSpace:
        """Return the state space of the sum of the signals with `weights` (d,)."""
        w = np.asarray(weights, dtype=np.float64)
        return StateSpace(F=self.F, Q=self.Q, H=w @ self.H, R=w @ self.R @ w, P0=self.P0, diffuse=self.diffuse)


@dataclass(frozen=True, kw_only=True, eq=False)
class JointContinuousStateSpace(_Matrices):
    """Continuous-time linear Gaussian state-space model of d signals with p states.

    dx/dt = A x + w with w white of spectral density Qc; y = H x + v with v white of spectral density Rc.

    Attributes
    ----------
    A, Qc, P0 : (p, p) arrays
        System matrix, two-sided spectral density of the process noise, and initial covariance of the states.
    H : (d, p) array
        Observation matrix.
    Rc : (d, d) array
        Two-sided spectral density of the measurement noise, in unit²/Hz.
    diffuse : (p,) array of bool
        Mask of the states without a stationary distribution.
    axes, terms : tuple of str
        Names of the signals, and the name of the term to which each state belongs.
    left_out : tuple of str
        Terms that have no continuous-time model and are not part of the matrices.
    """

    MATRICES = ("A", "Qc", "H", "Rc", "P0", "diffuse")
    A: Matrix
    Qc: Matrix
    H: Matrix
    Rc: Matrix
    P0: Matrix
    diffuse: Booleans
    axes: tuple[str, ...]
    terms: tuple[str, ...]
    left_out: tuple[str, ...]

    def along(self, weights: ArrayLike) -> ContinuousStateSpace:
        """Return the continuous-time model of the sum of the signals with `weights` (d,)."""
        w = np.asarray(weights, dtype=np.float64)
        return ContinuousStateSpace(
            A=self.A, Qc=self.Qc, H=w @ self.H, Rc=w @ self.Rc @ w, P0=self.P0, diffuse=self.diffuse, terms=self.terms,
            left_out=self.left_out,
        )  # fmt: skip

    def discrete(self, rate: float) -> JointStateSpace:
        """Return the discrete-time model at a `rate` (Hz), without the terms in `left_out`."""
        space = self.along(np.zeros(len(self.axes))).discrete(rate)
        return JointStateSpace(
            F=space.F, Q=space.Q, H=self.H, R=self.Rc * rate, P0=self.P0, diffuse=self.diffuse, axes=self.axes,
            terms=self.terms,
        )  # fmt: skip


def factor(sigma: Matrix) -> Matrix:
    """Return L (d, r) with L Lᵀ = Σ, where r is the rank of Σ. The largest entry of each column is positive."""
    values, vectors = np.linalg.eigh(sigma)
    # Other eigenvalues get no state (tests/joint/test_joint_fit.py).
    mask = values > 1e-6 * max(float(values.sum()), 0.0)
    out = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, mask][:, ::-1]
    return np.asarray(out * np.sign(out[np.argmax(np.abs(out), axis=0), np.arange(out.shape[1])]))


def discrete(
    processes: Sequence[Process], sigmas: Matrix, rate: float, *, axes: tuple[str, ...], labels: Sequence[str]
) -> JointStateSpace:
    """Return the discrete-time state space of all terms: blocks F_p ⊗ I, Q_p ⊗ I, H_p ⊗ L_p and R = Σ_p R_p Σ_p."""
    parts = [(process.state_space(rate), factor(sigma)) for process, sigma in zip(processes, sigmas, strict=True)]
    d = len(axes)
    noise = sum((space.R[0, 0] * sigma for (space, _), sigma in zip(parts, sigmas, strict=True)), np.zeros((d, d)))
    return JointStateSpace(**_kronecker(parts, d, ("F", "Q")), R=noise, axes=axes, terms=_terms(parts, labels))


def continuous(
    processes: Sequence[Process], sigmas: Matrix, rate: float, *, axes: tuple[str, ...], labels: Sequence[str]
) -> JointContinuousStateSpace:
    """Return the continuous-time state space of all terms, with the blocks of `discrete`."""
    spaces = {label: process.continuous(rate) for label, process in zip(labels, processes, strict=True)}
    terms = [(label, space, sigma) for (label, space), sigma in zip(spaces.items(), sigmas, strict=True) if space]
    parts = [(space, factor(sigma)) for _, space, sigma in terms]
    d = len(axes)
    return JointContinuousStateSpace(
        **_kronecker(parts, d, ("A", "Qc")), axes=axes, terms=_terms(parts, [label for label, _, _ in terms]),
        Rc=sum((space.Rc[0, 0] * sigma for _, space, sigma in terms), np.zeros((d, d))),
        left_out=tuple(label for label, space in spaces.items() if not space),
    )  # fmt: skip


def _kronecker(parts: Sequence[tuple[Any, Matrix]], d: int, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the block-diagonal matrices with the given names, and P0, H and the mask of diffuse states."""
    from scipy.linalg import block_diag

    wide = [(space, root) for space, root in parts if space.states and root.size]
    out: dict[str, Any] = {name: np.zeros((0, 0)) for name in (*names, "P0")}
    if wide:
        for name in out:
            out[name] = block_diag(*(np.kron(getattr(space, name), np.eye(root.shape[1])) for space, root in wide))
    out["H"] = np.concatenate([np.zeros((d, 0)), *(np.kron(space.H, root) for space, root in wide)], axis=1)
    masks = [np.repeat(space.diffuse, root.shape[1]) for space, root in wide]
    return out | {"diffuse": np.concatenate([np.zeros(0, bool), *masks])}


def _terms(parts: Sequence[tuple[Any, Matrix]], labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(
        label for (space, root), label in zip(parts, labels, strict=True) for _ in range(space.states * root.shape[1])
    )


@dataclass(frozen=True, eq=False)
class _FilterStep:
    """Matrices of one step of the filter, for the m signals that are observed at this sample."""

    before: Matrix  # (p, p) covariance P of the states before the step
    seen: Matrix  # (m, p) rows H of the observed signals
    precision: Matrix  # (m, m) inverse S⁻¹ of the covariance of the innovations
    rest: Matrix  # (p, p) F − F K H, with K the Kalman gain
    information: Matrix  # (p, p) Hᵀ S⁻¹ H
    weight: Matrix  # (p, m) Hᵀ S⁻¹
    gain: Matrix  # (p, m) F K
    after: Matrix = field(repr=False)  # (p, p) covariance of the states before the next step


def smooth_joint(
    fit: JointFit, x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None = None
) -> dict[str, Tracks]:
    """Estimate the latent processes of the signals of a joint fit; see `JointFit.smooth`."""
    records = _records(fit, x, rate)
    space, models = fit.state_space(), fit.models
    values = np.column_stack([record.values - record.centre for record in records.values()])
    smoother = _Smoother(space, values)
    slow = {
        term
        for term, process in zip(fit.terms, fit.settled.problem.processes(fit.settled.estimate.u), strict=True)
        if wanders(process, fit.rate)
    }
    return {axis: _tracks(smoother, space, k, record=records[axis], model=models[axis], slow=slow)
            for k, axis in enumerate(fit.axes)}  # fmt: skip


def _records(fit: JointFit, x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None) -> dict[str, Record]:
    """Return the data of each axis of a fit."""
    signals = x.signals if isinstance(x, Imu) else dict(x)
    if missing := [axis for axis in fit.axes if axis not in signals]:
        raise DataError(argument="x", expected=f"the axes {', '.join(fit.axes)} of the fit", got=missing)
    default = fit.rate if rate is None else rate
    records = {
        axis: as_record(item, None if isinstance(item, Signal) else default)
        for axis in fit.axes
        for item in [signals[axis]]
    }
    for axis, record in records.items():
        if not math.isclose(record.rate, fit.rate, rel_tol=RATES_ALIKE):
            raise OptionError(
                argument="rate", expected=f"{fit.rate:g}, the rate of the fit (Hz)", got=record.rate,
                advice="Fit the model to data with this rate.",
            )  # fmt: skip
        if record.values.size != records[fit.axes[0]].values.size:
            raise DataError(
                f"{fit.axes[0]} and {axis} differ in their length", argument="x",
                advice="Pass signals that were sampled together.",
            )  # fmt: skip
    return records


def _tracks(
    smoother: _Smoother, space: JointStateSpace, k: int, *, record: Record, model: Model, slow: set[str]
) -> Tracks:
    """Return the estimated latent processes of signal number k."""
    states = {term: np.array([label_of == term for label_of in space.terms]) for term in dict.fromkeys(space.terms)}
    rows = {term: space.H[k] * mine for term, mine in states.items() if np.any(space.H[k] * mine)}
    terms = list(rows)
    # As for one signal, the unknown level is part of the random walk, and reported separately without one.
    level = next((term for term in terms if np.any(space.diffuse & states[term])), LEVEL)
    nothing = np.zeros(space.H.shape[1])
    rows.setdefault(level, nothing)
    rows[BIAS] = sum((rows[term] for term in terms if term in slow), nothing)
    tracks = {label: smoother.track(row, k if label in (level, BIAS) else None) for label, row in rows.items()}
    for label in (level, BIAS):
        tracks[label][0][:] += record.centre
    if white := [term for term in model.terms if term not in terms]:
        # Mean and variance (N,) of white noise, what other terms leave; 0 and the model's for missing samples.
        mean, variance = smoother.track(space.H[k], k)
        present = np.isfinite(record.values)
        noise = np.where(present, record.values, 0.0) - np.where(present, mean + record.centre, 0.0)
        tracks[white[0]] = noise, np.where(present, variance, space.R[k, k])
    order = [label for label in (*model.terms, LEVEL, BIAS) if label in tracks]
    return Tracks(
        kind="smooth", model=model, rate=record.rate, unit=record.unit, axis=record.axis, times=record.times,
        data=record.values.copy(), mean={label: tracks[label][0] for label in order},
        error={label: np.sqrt(np.maximum(tracks[label][1], 0.0)) for label in order},
    )  # fmt: skip


class _Smoother:
    """Smoothed states of a recording (N, d), and of a signal with the constant value 1 for each axis."""

    def __init__(self, space: JointStateSpace, values: Matrix) -> None:
        self._space = space
        n, d = values.shape
        p = space.H.shape[1]
        present = np.isfinite(values)
        # The data and a constant for each signal are columns that are filtered together.
        y = np.concatenate([np.where(present, values, 0.0)[:, :, None], np.broadcast_to(np.eye(d), (n, d, d))], axis=2)
        start = np.array(space.P0)
        start[space.diffuse] = start[:, space.diffuse] = 0.0
        gains, which = self._gains(start, present)
        means, innovations = np.empty((n, p, 1 + d)), []
        state, products = np.zeros((p, 1 + d)), np.zeros((1 + d, 1 + d))
        for t in range(n):
            means[t] = state
            g = gains[which[t]]
            v = y[t][present[t]] - g.seen @ state
            innovations.append(v)
            products += v.T @ g.precision @ v
            state = space.F @ state + g.gain @ v
        self._means, self._which = means, which
        self._variances, self._places = self._backward(gains, innovations)
        information = products[1:, 1:]
        self._spread = np.linalg.inv(information)
        self._levels = self._spread @ products[1:, 0]

    def track(self, row: Vector, level: int | None) -> tuple[Vector, Vector]:
        """Return the mean and variance (N,) of a weighted sum of states, plus the level of one signal."""
        seen = np.einsum("p,tpk->tk", row, self._means)
        slopes = -seen[:, 1:]
        if level is not None:
            slopes[:, level] += 1.0
        variances = np.array([row @ variance @ row for variance in self._variances])[self._places]
        return seen[:, 0] + slopes @ self._levels, variances + np.einsum("ta,ab,tb->t", slopes, self._spread, slopes)

    def _gains(self, start: Matrix, present: np.ndarray) -> tuple[list[_FilterStep], np.ndarray]:
        """Return the distinct gains, and the index of the gain of each sample. It ends at a constant covariance."""
        gains: list[_FilterStep] = []
        which = np.empty(len(present), dtype=np.int64)
        covariance, settled = start, False
        for t, mask in enumerate(present):
            complete = bool(np.all(mask))
            if not (settled and complete):
                gains.append(self._gain(covariance, mask))
                change = np.max(np.abs(gains[-1].after - covariance), initial=0.0)
                # The covariance is constant (tests/joint/test_smoothing.py).
                settled = complete and bool(change <= 1e-14 * np.max(np.abs(covariance), initial=0.0))
                covariance = gains[-1].after
            which[t] = len(gains) - 1
        return gains, which

    def _gain(self, before: Matrix, mask: np.ndarray) -> _FilterStep:
        space = self._space
        seen, noise = space.H[mask], space.R[np.ix_(mask, mask)]
        scatter = seen @ before @ seen.T + noise
        precision = np.linalg.inv(scatter)
        gain = space.F @ before @ seen.T @ precision
        closed = space.F - gain @ seen
        after = closed @ before @ closed.T + gain @ noise @ gain.T + space.Q
        weight = seen.T @ precision
        return _FilterStep(
            before=before, seen=seen, precision=precision, rest=closed, information=weight @ seen, weight=weight,
            gain=gain, after=(after + after.T) / 2,
        )  # fmt: skip

    def _backward(self, gains: list[_FilterStep], innovations: list[Matrix]) -> tuple[list[Matrix], np.ndarray]:
        """Replace the filtered means by smoothed ones. Return the distinct covariances, and their index by sample."""
        p, columns = self._means.shape[1:]
        r, information = np.zeros((p, columns)), np.zeros((p, p))
        variances: list[Matrix] = []
        places = np.empty(len(innovations), dtype=np.int64)
        last, settled = -1, False
        for t in range(len(innovations) - 1, -1, -1):
            g = gains[self._which[t]]
            r = g.weight @ innovations[t] + g.rest.T @ r
            if not (settled and self._which[t] == last):
                new = g.information + g.rest.T @ information @ g.rest
                change = np.max(np.abs(new - information), initial=0.0)
                settled = self._which[t] == last and bool(change <= 1e-14 * np.max(np.abs(new), initial=0.0))
                information, last = (new + new.T) / 2, int(self._which[t])
                variances.append(g.before - g.before @ information @ g.before)
            places[t] = len(variances) - 1
            self._means[t] += g.before @ r
        return variances, places
