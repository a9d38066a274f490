"""The state-space form of several signals with shared noise, in discrete and in continuous time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, freeze
from gmwm.base.documents import plain
from gmwm.theory.continuous_statespace import ContinuousStateSpace
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace


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
    diffuse: NDArray[np.bool_]
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
    diffuse: NDArray[np.bool_]
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
