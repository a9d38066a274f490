"""The state-space form of several signals with shared noise, in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, freeze
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace

RANK = 1e-6
"""An eigenvalue of a covariance matrix below this share of the trace is treated as zero and gets no state
(tests/joint/test_joint_fit.py)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointStateSpace:
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

    F: Matrix
    Q: Matrix
    H: Matrix
    R: Matrix
    P0: Matrix
    diffuse: NDArray[np.bool_]
    axes: tuple[str, ...]
    terms: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("F", "Q", "H", "R", "P0", "diffuse"):
            freeze(getattr(self, name))

    def along(self, weights: ArrayLike) -> StateSpace:
        """Return the state space of a weighted sum of the signals.

        Parameters
        ----------
        weights : (d,) array
            Weight of each signal.
        """
        w = np.asarray(weights, dtype=np.float64)
        return StateSpace(F=self.F, Q=self.Q, H=w @ self.H, R=w @ self.R @ w, P0=self.P0, diffuse=self.diffuse)

    def to_dict(self) -> dict[str, Any]:
        """Return the matrices as lists."""
        matrices = {name: getattr(self, name).tolist() for name in ("F", "Q", "H", "R", "P0", "diffuse")}
        return {**matrices, "axes": list(self.axes), "terms": list(self.terms)}


@dataclass(frozen=True, kw_only=True, eq=False)
class JointContinuousStateSpace:
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

    A: Matrix
    Qc: Matrix
    H: Matrix
    Rc: Matrix
    P0: Matrix
    diffuse: NDArray[np.bool_]
    axes: tuple[str, ...]
    terms: tuple[str, ...]
    left_out: tuple[str, ...]

    def __post_init__(self) -> None:
        for name in ("A", "Qc", "H", "Rc", "P0", "diffuse"):
            freeze(getattr(self, name))

    def along(self, weights: ArrayLike) -> ContinuousStateSpace:
        """Return the continuous-time model of a weighted sum of the signals.

        Parameters
        ----------
        weights : (d,) array
            Weight of each signal.
        """
        w = np.asarray(weights, dtype=np.float64)
        return ContinuousStateSpace(
            A=self.A, Qc=self.Qc, H=w @ self.H, Rc=w @ self.Rc @ w, P0=self.P0, diffuse=self.diffuse, terms=self.terms,
            left_out=self.left_out,
        )  # fmt: skip

    def discrete(self, rate: float) -> JointStateSpace:
        """Return the discrete-time state space of all terms: blocks F_p ⊗ I, Q_p ⊗ I, H_p ⊗ L_p and R = Σ_p R_p Σ_p."""
        space = self.along(np.zeros(len(self.axes))).discrete(rate)
        return JointStateSpace(
            F=space.F, Q=space.Q, H=self.H, R=self.Rc * rate, P0=self.P0, diffuse=self.diffuse, axes=self.axes,
            terms=self.terms,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return the matrices as lists."""
        matrices = {name: getattr(self, name).tolist() for name in ("A", "Qc", "H", "Rc", "P0", "diffuse")}
        return {**matrices, "axes": list(self.axes), "terms": list(self.terms), "left_out": list(self.left_out)}


def factor(sigma: Matrix) -> Matrix:
    """Return L (d, r) with L Lᵀ = Σ, where r is the rank of Σ. The largest entry of each column is positive."""
    values, vectors = np.linalg.eigh(sigma)
    kept = values > RANK * max(float(values.sum()), 0.0)
    out = (vectors * np.sqrt(np.maximum(values, 0.0)))[:, kept][:, ::-1]
    return np.asarray(out * np.sign(out[np.argmax(np.abs(out), axis=0), np.arange(out.shape[1])]))


def discrete(
    processes: Sequence[Process], sigmas: Matrix, rate: float, *, axes: tuple[str, ...], labels: Sequence[str]
) -> JointStateSpace:
    """Return the discrete-time state space of all terms: blocks F_p ⊗ I, Q_p ⊗ I, H_p ⊗ L_p and R = Σ_p R_p Σ_p."""
    parts = [(process.state_space(rate), factor(sigma)) for process, sigma in zip(processes, sigmas, strict=True)]
    d = len(axes)
    return JointStateSpace(
        **_kronecker(parts, d, ("F", "Q")),
        R=sum((space.R[0, 0] * sigma for (space, _), sigma in zip(parts, sigmas, strict=True)), np.zeros((d, d))),
        axes=axes,
        terms=_terms(parts, labels),
    )


def continuous(
    processes: Sequence[Process], sigmas: Matrix, rate: float, *, axes: tuple[str, ...], labels: Sequence[str]
) -> JointContinuousStateSpace:
    """Return the continuous-time state space of all terms, with the blocks of `discrete`."""
    made = {label: process.continuous(rate) for label, process in zip(labels, processes, strict=True)}
    known = [
        (label, space, sigma) for (label, space), sigma in zip(made.items(), sigmas, strict=True) if space is not None
    ]
    parts = [(space, factor(sigma)) for _, space, sigma in known]
    d = len(axes)
    return JointContinuousStateSpace(
        **_kronecker(parts, d, ("A", "Qc")),
        Rc=sum((space.Rc[0, 0] * sigma for _, space, sigma in known), np.zeros((d, d))),
        axes=axes,
        terms=_terms(parts, [label for label, _, _ in known]),
        left_out=tuple(label for label, space in made.items() if space is None),
    )


def _kronecker(parts: Sequence[tuple[Any, Matrix]], d: int, names: tuple[str, ...]) -> dict[str, Any]:
    """Return the block-diagonal matrices with the given names, and P0, H and the mask of diffuse states."""
    from scipy.linalg import block_diag

    wide = [(space, root) for space, root in parts if space.states and root.size]
    out: dict[str, Any] = {
        name: block_diag(*(np.kron(getattr(space, name), np.eye(root.shape[1])) for space, root in wide))
        if wide
        else np.zeros((0, 0))
        for name in (*names, "P0")
    }
    out["H"] = np.concatenate([np.zeros((d, 0)), *(np.kron(space.H, root) for space, root in wide)], axis=1)
    out["diffuse"] = np.concatenate(
        [np.zeros(0, bool), *(np.repeat(space.diffuse, root.shape[1]) for space, root in wide)]
    )
    return out


def _terms(parts: Sequence[tuple[Any, Matrix]], labels: Sequence[str]) -> tuple[str, ...]:
    return tuple(
        label for (space, root), label in zip(parts, labels, strict=True) for _ in range(space.states * root.shape[1])
    )
