"""Linear Gaussian state-space models: variances, autocovariances, spectra and paths from matrices, which are
block-diagonal for sums of processes."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import prod
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Matrix, Vector, as_levels, freeze
from gmwm.base.errors import ModelError
from gmwm.base.lazy import scipy

__all__ = ["StateSpace"]


@dataclass(frozen=True, eq=False)
class StateSpace:
    """A discrete-time linear Gaussian state-space model of one signal with p states, in steps of one sample.

    x_{t+1} = F x_t + w_t, Var w = Q;  y_t = H x_t + v_t, Var v = R;  x_0 has mean m0 and covariance P0.

    Parameters
    ----------
    F : (p, p) array
        Transition matrix over one sample.
    Q : (p, p) array
        Covariance of the process noise per sample.
    H : (1, p) array
        Observation matrix.
    R : (1, 1) array, optional
        Variance of the observation noise; 0 by default.
    m0, P0 : (p,) and (p, p) arrays, optional
        Mean and covariance of the state at t = 0; 0 by default. For stationary states, P0 is the stationary covariance.
    diffuse : (p,) array of bool, optional
        States without a stationary distribution; none by default. A Kalman filter should start them at an unknown
        level. P0 is then only the start of simulations.

    Raises
    ------
    ModelError
        If the shapes do not match, or a value is not finite.

    Examples
    --------
    >>> walk = StateSpace(F=1.0, Q=2.0, H=1.0, diffuse=[True])
    >>> walk.states, walk.haar_variance(3).tolist()
    (1, [0.5, 0.75, 1.375])

    References
    ----------
    Durbin and Koopman (2012), Time Series Analysis by State Space Methods, 2nd ed., chapter 3.
    """

    F: Matrix
    Q: Matrix
    H: Matrix
    R: Matrix
    m0: Vector
    P0: Matrix
    diffuse: NDArray[np.bool_]

    def __init__(
        self, F: ArrayLike, Q: ArrayLike, H: ArrayLike, R: ArrayLike = 0.0, m0: ArrayLike | None = None,
        P0: ArrayLike | None = None, diffuse: ArrayLike | None = None,
    ) -> None:  # fmt: skip
        for name, array in check_matrices(
            ("F", "Q", "H", "R"), F, noise=Q, seen=H, scatter=R, m0=m0, P0=P0, diffuse=diffuse
        ).items():
            object.__setattr__(self, name, array)

    @property
    def states(self) -> int:
        """Number of states p."""
        return int(self.H.size)

    @classmethod
    def sum(cls, parts: Iterable[StateSpace]) -> StateSpace:
        """Return the state space of a sum of independent signals.

        F, Q and P0 are block-diagonal; the variances R of the measurement noise add up.

        Parameters
        ----------
        parts : iterable of StateSpace
            State spaces with p₁, p₂, … states and one output each, all at the same sampling rate.

        Returns
        -------
        StateSpace
            A state space with p₁ + p₂ + … states.
        """
        items = list(parts)
        return cls(
            F=_block_diagonal([s.F for s in items]), Q=_block_diagonal([s.Q for s in items]),
            H=np.concatenate([s.H[0] for s in items]) if items else np.zeros(0), R=sum(float(s.R[0, 0]) for s in items),
            m0=np.concatenate([s.m0 for s in items]) if items else np.zeros(0),
            P0=_block_diagonal([s.P0 for s in items]),
            diffuse=np.concatenate([s.diffuse for s in items]) if items else np.zeros(0),
        )  # fmt: skip

    def __add__(self, other: StateSpace) -> StateSpace:
        return StateSpace.sum((self, other))

    def haar_variance(self, levels: int | ArrayLike) -> Vector:
        """Return the Haar wavelet variance ν_j² (J,), the mean square of the MODWT coefficients, at a cost of O(J p³).

        The mean is included: a drift with the slope ω adds ω²τ²/16 at the scale τ. Diffuse states must cancel in the
        difference of two adjacent block sums, as the unknown level of a random walk does.

        Parameters
        ----------
        levels : int or (J,) array of int
            Number of levels, or the levels.
        """
        return np.asarray(haar_variances([self], levels)[0])

    def block_variance(self, lengths: ArrayLike) -> Vector:
        """Return the variance of the sum of the first m samples, for each of the n numbers m ≥ 0 in `lengths`."""
        sizes, where = np.unique(np.asarray(lengths, dtype=np.int64), return_inverse=True)
        values = np.zeros(sizes.size)
        for k, size in enumerate(sizes):
            if size > 0:
                block = _StateBlock.of(self, int(size))
                values[k] = block.sum_of @ self.P0 @ block.sum_of + block.noise[-1, -1]
        return values[where.ravel()]

    def autocovariance(self, lags: ArrayLike) -> Vector:
        """Return the autocovariance r(k) = H F^|k| P0 Hᵀ + R·1{k = 0} of a stationary state space at `lags` k
        (samples)."""
        distances, where = np.unique(np.abs(np.asarray(lags, dtype=np.int64)), return_inverse=True)
        values = np.empty(distances.size)
        column, reached = self.P0 @ self.H[0], 0
        at = 0
        while at < distances.size:
            column = np.linalg.matrix_power(self.F, int(distances[at]) - reached) @ column
            reached = int(distances[at])
            # Runs of consecutive lags are computed together by repeated doubling.
            run = int(np.argmin(np.append(distances[at:] - reached == np.arange(distances.size - at), False)))
            values[at : at + run] = self.H[0] @ powers(self.F, column, run)
            at += run
        if distances.size and distances[0] == 0:
            values[0] += self.R[0, 0]
        return values[where.ravel()]

    def psd(self, frequencies: ArrayLike, rate: float) -> Vector:
        """Return the two-sided power spectral density Δt (R + |H (zI − F)⁻¹ L|²) with z = exp(2πifΔt) and L Lᵀ = Q.

        Parameters
        ----------
        frequencies : array
            Frequencies f (Hz).
        rate : float
            Sampling rate 1/Δt (Hz).

        Returns
        -------
        array in the shape of `frequencies`
        """
        f = np.asarray(frequencies, dtype=np.float64)
        z = np.exp(2j * np.pi * f.ravel() / rate)
        resolvent = z[:, None, None] * np.eye(self.states) - self.F
        # Row vectors H (zI − F)⁻¹, from the transposed system.
        rows = np.linalg.solve(np.swapaxes(resolvent, 1, 2), np.broadcast_to(self.H.T, (z.size, self.states, 1)))
        density = np.sum(np.abs(rows[:, :, 0] @ _root(self.Q)) ** 2, axis=1) + self.R[0, 0]
        return np.asarray(density / rate, dtype=np.float64).reshape(f.shape)

    def simulate(self, n: int, rng: np.random.Generator, paths: int = 1) -> Matrix:
        """Simulate Gaussian sample paths (paths, n) that start from x_0 ~ (m0, P0); `rng` is a NumPy Generator."""
        states = self.m0 + rng.standard_normal((paths, self.states)) @ _root(self.P0).T
        out = rng.standard_normal((paths, n)) * np.sqrt(self.R[0, 0])
        steps = (1 << 20) // (paths * self.states + 1) + 1
        for first in range(0, n, steps):
            part = out[:, first : first + steps]
            path = rng.standard_normal((part.shape[1], paths, self.states)) @ _root(self.Q).T
            for t in range(len(path)):
                path[t], states = states, states @ self.F.T + path[t]
            part += (path @ self.H[0]).T
        return np.asarray(out)


def check_matrices(
    names: tuple[str, str, str, str], transition: ArrayLike, noise: ArrayLike, seen: ArrayLike, scatter: ArrayLike,
    m0: ArrayLike | None, P0: ArrayLike | None, diffuse: ArrayLike | None,
) -> dict[str, NDArray[Any]]:  # fmt: skip
    """Check the arrays of a linear system. Return them by name, in the required shapes and read-only."""
    h = np.array(seen, dtype=np.float64).reshape(1, -1)
    p = h.size
    f, q, observed, r = names
    shapes: dict[str, tuple[Any, tuple[int, ...]]] = {
        f: (transition, (p, p)), q: (noise, (p, p)), observed: (h, (1, p)), r: (scatter, (1, 1)),
        "m0": (np.zeros(p) if m0 is None else m0, (p,)), "P0": (np.zeros((p, p)) if P0 is None else P0, (p, p)),
    }  # fmt: skip
    matrices: dict[str, NDArray[Any]] = {}
    for name, (values, shape) in shapes.items():
        array = np.array(values, dtype=np.float64)
        if array.size != prod(shape) or not np.all(np.isfinite(array)):
            raise ModelError(
                argument=name, expected=f"finite with shape {shape}, because {observed} has {p} states", got=values
            )
        matrices[name] = freeze(array.reshape(shape))
    mask = np.zeros(p, dtype=np.bool_) if diffuse is None else np.array(diffuse, dtype=np.bool_).reshape(p)
    return {**matrices, "diffuse": freeze(mask)}


def haar_variances(spaces: Sequence[StateSpace], levels: int | ArrayLike) -> Matrix:
    """Return `haar_variance` (n, J) of n state spaces with the same number of states."""
    numbers = as_levels(levels)
    transition, seen = np.array([s.F for s in spaces]), np.array([s.H[0] for s in spaces])
    start, mean = np.array([s.P0 for s in spaces]), np.array([s.m0 for s in spaces])
    noise = np.array([_block_diagonal([s.Q, s.R]) for s in spaces])
    n, p = seen.shape
    result = np.empty((n, numbers.size))
    carry = np.zeros((n, p + 1, p + 1))
    carry[:, p, p] = 1.0
    for level in range(1, int(numbers[-1]) + 1):
        if level > 1:
            # Join a block with the same block that starts from its end.
            carry[:, :p, :p], carry[:, p, :p] = transition, seen
            noise = carry @ noise @ np.swapaxes(carry, 1, 2) + noise
            seen = seen + (seen[:, None, :] @ transition)[:, 0]
            transition = transition @ transition
        at = np.flatnonzero(numbers == level)
        if at.size:
            rise = (seen[:, None, :] @ transition)[:, 0] - seen
            weights = np.concatenate([seen, np.full((n, 1), -1.0)], axis=1)
            scatter = np.einsum("ni,nij,nj->n", weights, noise, weights) + noise[:, p, p]
            moved = np.einsum("ni,nij,nj->n", rise, start, rise) + np.einsum("ni,ni->n", rise, mean) ** 2
            result[:, at[0]] = (moved + scatter) / 4.0**level
    return result


@dataclass(frozen=True, eq=False)
class _StateBlock:
    """m successive samples from the state x: its end transition·x + w, its sum sum_of·x + n, Cov (w, n) = `noise`."""

    transition: Matrix
    sum_of: Vector
    noise: Matrix

    @classmethod
    def of(cls, space: StateSpace, length: int) -> _StateBlock:
        """Return a block of `length` ≥ 1 samples, by repeated squaring."""
        power, result = cls(space.F, space.H[0], _block_diagonal([space.Q, space.R])), None
        while True:
            if length & 1:
                result = power if result is None else power.followed_by(result)
            length >>= 1
            if not length:
                assert result is not None
                return result
            power = power.followed_by(power)

    def followed_by(self, later: _StateBlock) -> _StateBlock:
        """Join this block and a later one, which starts from the end state of this block."""
        p = self.sum_of.size
        # How this block's noise (w, n) enters the joined (w, n).
        carry = np.zeros((p + 1, p + 1))
        carry[:p, :p], carry[p, :p], carry[p, p] = later.transition, later.sum_of, 1.0
        return _StateBlock(
            later.transition @ self.transition,
            self.sum_of + later.sum_of @ self.transition,
            carry @ self.noise @ carry.T + later.noise,
        )


def _block_diagonal(blocks: list[Matrix]) -> Matrix:
    return np.asarray(scipy.linalg.block_diag(np.zeros((0, 0)), *blocks))


def _root(covariance: Matrix) -> Matrix:
    """Return L with L Lᵀ = covariance. The covariance may be singular; the Cholesky algorithm would then fail."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)), dtype=np.float64)


def powers(transition: Matrix, column: Vector, count: int) -> Matrix:
    """Return x, Fx, …, F^(count − 1) x as columns (p, count), for the matrix F and the vector x."""
    columns, power = column[:, None], transition
    while columns.shape[1] < count:
        columns = np.concatenate([columns, power @ columns], axis=1)
        power = power @ power
    return columns[:, :count]
