"""A Kalman filter that estimates the slow noise of an array from the differences of its signals.

Differences B x (B 1 = 0) of signals x of the same axis do not depend on the motion. w₀ are the weights with sum 1 that
minimise the white noise of w₀ᵀ x, which is independent of the differences. The filter estimates the noise b_p of each
other process from B x. The fused signal is ŝ = w₀ᵀ x − Σ_p c_p B b̂_p with c_p = w₀ᵀ Σ_p Bᵀ (B Σ_p Bᵀ)⁺, because c_p B
b_p is the best linear prediction of w₀ᵀ b_p."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.applications.several.state_space import factor
from gmwm.base.arrays import Matrix, Vector
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace

BLOCK_SAMPLES = 256
"""Number of consecutive samples that are filtered by one matrix product."""


@dataclass(frozen=True, eq=False)
class DifferenceFilter:
    """A Kalman filter with constant gain for signals x_t: ξ_t = A ξ_{t−1} + K B x_t, ŝ_t = w₀ᵀ x_t − C ξ_t."""

    weights: Vector  # (d,) w₀
    differences: Matrix  # (d − 1, d) B
    # A (n, n), K (n, d − 1): transition matrix and gain
    A: Matrix
    K: Matrix
    C: Vector  # (n,) row that predicts the noise of w₀ᵀ x_t from the states

    @classmethod
    def static(cls, weights: Vector) -> DifferenceFilter:
        """Return a filter without states, which computes the weighted sum of the signals."""
        d = weights.size
        empty = np.zeros((0, 0))
        return cls(weights, np.zeros((d - 1, d)), A=empty, K=np.zeros((0, d - 1)), C=np.zeros(0))

    @property
    def memory(self) -> int:
        """Time constant (samples) of the slowest state of the filter."""
        slowest = float(np.max(np.abs(np.linalg.eigvals(self.A)), initial=0.0))
        return int(min(np.ceil(1 / max(1 - slowest, 1e-12)), 2**62))

    def to_dict(self) -> dict[str, Any]:
        """Return the matrices as lists."""
        return {"w0": self.weights.tolist(), "B": self.differences.tolist(), "A": self.A.tolist(),
                "K": self.K.tolist(), "C": self.C.tolist()}  # fmt: skip

    def run(self, x: Matrix) -> Vector:
        """Return the fused signal (N,) of the samples (d, N) of one segment. The mean of the differences over the first
        time constant of the filter is subtracted first, so that the initial transient is small. This changes the result
        only by a constant."""
        base = self.weights @ x
        if not self.C.size:
            return np.asarray(base)
        z = self.differences @ x
        z = z - z[:, : max(self.memory, 1)].mean(axis=1, keepdims=True)
        return np.asarray(base - self._correction(z))

    def _correction(self, z: Matrix) -> Vector:
        """Return C ξ_t (N,) for differences (d − 1, N), computed block by block."""
        count, n = z.shape[1], self.C.size
        blocks = -(-count // BLOCK_SAMPLES)
        padded = np.zeros((blocks * BLOCK_SAMPLES, z.shape[0]))
        padded[:count] = z.T
        rows = padded.reshape(blocks, -1)
        power, drive, out = np.eye(n), [], []
        for _ in range(BLOCK_SAMPLES):
            drive.append(power @ self.K)
            power = self.A @ power
            out.append(self.C @ power)
        # Response of the output at each sample of a block to the input at each earlier sample of the block.
        impulse = np.array([self.C @ matrix for matrix in drive])
        within = np.zeros((BLOCK_SAMPLES, BLOCK_SAMPLES, z.shape[0]))
        for lag in range(BLOCK_SAMPLES):
            within[np.arange(lag, BLOCK_SAMPLES), np.arange(BLOCK_SAMPLES - lag)] = impulse[lag]
        inputs = rows @ np.concatenate(drive[::-1], axis=1).T
        states = np.zeros((blocks, n))
        for k in range(1, blocks):
            states[k] = power @ states[k - 1] + inputs[k - 1]
        return np.asarray((rows @ within.reshape(BLOCK_SAMPLES, -1).T + states @ np.array(out).T).ravel()[:count])


@dataclass(frozen=True, eq=False)
class ArrayNoise:
    """Noise of an array: processes at unit scale, and the covariance matrix of each between the d signals."""

    processes: tuple[Process, ...]  # the P processes at unit scale
    sigmas: Matrix  # (P, d, d) covariance matrix of each process
    rate: float  # Hz

    @property
    def spaces(self) -> list[StateSpace]:
        """The state spaces of the processes at unit scale."""
        return [process.state_space(self.rate) for process in self.processes]

    @property
    def white(self) -> Matrix:
        # So that the covariance matrix has an inverse.
        """Covariance (d, d) of the white measurement noise of one sample, with a small diagonal matrix."""
        d = self.sigmas.shape[-1]
        total = sum((space.R[0, 0] * sigma for space, sigma in zip(self.spaces, self.sigmas, strict=True)),
                    np.zeros((d, d)))  # fmt: skip
        ridge = 1e-10 * float(np.trace(total if np.any(total) else self.sigmas.sum(axis=0))) / d
        return np.asarray(total + ridge * np.eye(d))

    def filter(self) -> DifferenceFilter:
        """Return the Kalman filter on the differences of the signals."""
        from scipy.linalg import block_diag, null_space

        white = self.white
        d = len(white)
        inverse = np.linalg.solve(white, np.ones(d))
        weights = inverse / inverse.sum()
        differences = null_space(np.ones((1, d))).T
        seen = [self._observed_parts(space, sigma, differences, weights=weights)
                for space, sigma in zip(self.spaces, self.sigmas, strict=True) if space.states]  # fmt: skip
        if not sum(part[0].shape[0] for part in seen):
            return DifferenceFilter.static(weights)
        F, Q = (block_diag(*(part[k] for part in seen)) for k in (0, 1))
        H, C = np.concatenate([part[2] for part in seen], axis=1), np.concatenate([part[3] for part in seen])
        R = differences @ white @ differences.T
        ahead = _steady(F, Q, H, R)
        K = np.linalg.solve(H @ ahead @ H.T + R, H @ ahead).T
        return DifferenceFilter(weights, differences, A=(np.eye(len(F)) - K @ H) @ F, K=K, C=C)

    @staticmethod
    def _observed_parts(
        space: StateSpace, sigma: Matrix, differences: Matrix, *, weights: Vector
    ) -> tuple[Matrix, Matrix, Matrix, Vector]:
        """Return F, Q and H of one process as it appears in the differences, and its part of the row C."""
        root = factor(differences @ sigma @ differences.T)
        eye = np.eye(root.shape[1])
        regression = weights @ sigma @ differences.T @ np.linalg.pinv(root).T if root.size else np.zeros(0)
        parts = [np.kron(space.F, eye), np.kron(space.Q, eye), np.kron(space.H, root), np.kron(space.H[0], regression)]
        F, Q, H, C = (np.asarray(part, dtype=np.float64) for part in parts)
        return F, Q, H, C

    def fused_space(self, filter: DifferenceFilter) -> StateSpace:
        """Return the state space of the fused signal of an array at rest, for any difference filter. Random walks z
        make the filter states ξ non-stationary. They are therefore written as ξ = G z + e, where G is the steady-state
        response to a constant z. The remainder e is stationary: e_t = A e_{t−1} − A G w_{t−1} + K B n_t, with the
        increments w of z and all other noise n."""
        from scipy.linalg import block_diag

        parts = [(space, factor(sigma)) for space, sigma in zip(self.spaces, self.sigmas, strict=True) if space.states]
        F = block_diag(*(np.kron(space.F, np.eye(root.shape[1])) for space, root in parts))
        Q = block_diag(*(np.kron(space.Q, np.eye(root.shape[1])) for space, root in parts))
        H = np.concatenate([np.kron(space.H, root) for space, root in parts], axis=1)
        walk = np.concatenate([np.repeat(space.diffuse, root.shape[1]) for space, root in parts])
        gain = filter.K @ filter.differences
        response = np.linalg.solve(np.eye(filter.C.size) - filter.A, gain @ H) * walk
        p, n, d = len(F), filter.C.size, filter.weights.size
        white = self.white
        # The state vector contains the noise states, e, and the white noise of this sample, which enters the output and
        # e.
        stationary = gain @ (H * ~walk)
        transition = np.zeros((p + n + d, p + n + d))
        transition[:p, :p], transition[p : p + n, :p], transition[p : p + n, p : p + n] = F, stationary @ F, filter.A
        carry = np.concatenate([np.eye(p), stationary - filter.A @ response, np.zeros((d, p))])
        other = np.concatenate([np.zeros((p, d)), gain, np.eye(d)])
        noise = carry @ Q @ carry.T + other @ white @ other.T
        seen = np.concatenate([filter.weights @ H - filter.C @ response, -filter.C, filter.weights])
        stays = np.concatenate([~walk, np.ones(n + d, bool)])
        start = np.zeros_like(noise)
        start[np.ix_(stays, stays)] = _stationary(transition[np.ix_(stays, stays)], noise[np.ix_(stays, stays)])
        return StateSpace(F=transition, Q=noise, H=seen, P0=start)

    def static(self, weights: Vector, levels: NDArray[np.int64]) -> Vector:
        """Return the wavelet variance (J,) of a weighted sum of the signals."""
        scales = np.einsum("a,pab,b->p", weights, self.sigmas, weights)
        shapes = np.array([process.wavelet_variance(levels, self.rate) for process in self.processes])
        return np.asarray(scales @ shapes)


def wavelet_variance(noise: ArrayNoise, filter: DifferenceFilter, levels: NDArray[np.int64]) -> Vector:
    """Return the wavelet variance (J,) of the fused signal of an array at rest."""
    return noise.fused_space(filter).haar_variance(levels) if filter.C.size else noise.static(filter.weights, levels)


def _steady(F: Matrix, Q: Matrix, H: Matrix, R: Matrix) -> Matrix:
    """Return the steady-state covariance of the predicted state, by the doubling algorithm for the Riccati recursion
    (Anderson and Moore 1979, Optimal Filtering, section 6.7)."""
    a, g, p = F.T.copy(), H.T @ np.linalg.solve(R, H), Q.copy()
    eye = np.eye(len(F))
    for _ in range(64):
        inner = np.linalg.solve(eye + g @ p, np.concatenate([a, g], axis=1))
        first, second = inner[:, : len(F)], inner[:, len(F) :]
        added = a.T @ p @ first
        g, a, p = g + a @ second @ a.T, a @ first, p + (added + added.T) / 2
        if np.linalg.norm(added) <= 1e-14 * np.linalg.norm(p):
            break
    return p


def _stationary(transition: Matrix, noise: Matrix) -> Matrix:
    """Return the stationary covariance P that solves P = A P Aᵀ + W, computed by doubling."""
    p, a = noise, transition
    for _ in range(64):
        added = a @ p @ a.T
        p, a = p + added, a @ a
        if np.linalg.norm(added) <= 1e-15 * np.linalg.norm(p):
            break
    return (p + p.T) / 2
