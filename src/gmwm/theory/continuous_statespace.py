"""Convert state-space models from discrete to continuous time, and back with steps of any length.

Each block of a sum of processes is discretised separately, so that a slow process next to a fast one stays accurate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Booleans, Integers, Matrix, Vector, as_rate
from gmwm.base.lazy import scipy
from gmwm.theory.statespace import StateSpace, check_matrices

__all__ = ["ContinuousStateSpace"]

_ROUNDING = 1e-9
"""Relative size that counts as zero; the matrix functions have errors of 1e-12 (tests/test_continuous.py)."""


@dataclass(frozen=True, eq=False)
class ContinuousStateSpace:
    """A continuous-time linear Gaussian state-space model of one signal with p states.

    dx/dt = A x + w and y = H x + v, where x are the states, y is the signal, w is white noise of spectral density Qc,
    and v is white noise of spectral density Rc. The mean of v over a time Δt thus has the variance Rc/Δt. The states
    are the same as in the discrete model. In the units below, u is the unit of y.

    Parameters
    ----------
    A : (p, p) array
        System matrix, in 1/s.
    Qc : (p, p) array
        Two-sided spectral density of the process noise, in u²/s: a random walk has the variance Qc t after a time t.
    H : (1, p) array
        Observation matrix.
    Rc : (1, 1) array, optional
        Two-sided spectral density of the observation noise, in u²/Hz: N² of angle or velocity random walk. Default 0.
    m0, P0, diffuse : optional
        Initial states, as in `StateSpace`.
    terms : tuple of str
        Term of the model to which each state belongs.
    left_out : tuple of str
        Terms without a continuous-time model in these states, for example quantization noise.

    Raises
    ------
    ModelError
        If the shapes do not match, or a value is not finite.

    Examples
    --------
    >>> import gmwm
    >>> model = gmwm.Model.parse("GM(beta=0.5, sigma2=4.0) + WN(sigma2=3.0)")
    >>> smooth = model.continuous(rate=100.0)
    >>> smooth.A, smooth.Qc, smooth.Rc
    (array([[-0.5]]), array([[4.]]), array([[0.03]]))
    >>> smooth.discrete(rate=2.0).R
    array([[0.06]])
    """

    A: Matrix
    Qc: Matrix
    H: Matrix
    Rc: Matrix
    m0: Vector
    P0: Matrix
    diffuse: Booleans
    terms: tuple[str, ...]
    left_out: tuple[str, ...]

    def __init__(
        self, A: ArrayLike, Qc: ArrayLike, H: ArrayLike, Rc: ArrayLike = 0.0, m0: ArrayLike | None = None,
        P0: ArrayLike | None = None, diffuse: ArrayLike | None = None, terms: tuple[str, ...] = (),
        left_out: tuple[str, ...] = (),
    ) -> None:  # fmt: skip
        arrays = check_matrices(("A", "Qc", "H", "Rc"), A, noise=Qc, seen=H, scatter=Rc, m0=m0, P0=P0, diffuse=diffuse)
        for name, value in {**arrays, "terms": tuple(terms), "left_out": tuple(left_out)}.items():
            object.__setattr__(self, name, value)

    @property
    def states(self) -> int:
        """Number of states p."""
        return int(self.H.size)

    @classmethod
    def of(cls, space: StateSpace, rate: float) -> ContinuousStateSpace | None:
        """Convert a discrete state space to continuous time. Return None if no continuous model corresponds to it.

        A = f ln F, where f is the rate. Q = ∫₀^Δt e^(As) Qc e^(Aᵀs) ds is solved for Qc, which must be a covariance.

        Parameters
        ----------
        space : StateSpace
        rate : float
            Sampling rate f = 1/Δt (Hz) of `space`.
        """
        rate = as_rate(rate)
        matrices = _driven(space, rate) if space.states else (space.F, space.Q)
        if matrices is None:
            return None
        return cls(*matrices, space.H, space.R / rate, space.m0, space.P0, space.diffuse)

    @classmethod
    def sum(cls, parts: Mapping[str, ContinuousStateSpace | None]) -> ContinuousStateSpace:
        """Return the state space of a sum of independent signals. `parts` has the state space of each term; None is
        left out."""
        spaces = {term: part for term, part in parts.items() if part is not None}
        # The sum of discrete state spaces also makes the block-diagonal matrices needed here.
        s = StateSpace.sum(StateSpace(c.A, c.Qc, c.H, c.Rc, c.m0, c.P0, c.diffuse) for c in spaces.values())
        terms = tuple(term for term, part in spaces.items() for _ in range(part.states))
        left_out = tuple(term for term, part in parts.items() if part is None)
        return cls(s.F, s.Q, s.H, s.R, s.m0, s.P0, s.diffuse, terms, left_out)

    def discrete(self, rate: float) -> StateSpace:
        """Discretise the model with steps of Δt = 1/rate: F = e^(AΔt), Q = ∫₀^Δt e^(As) Qc e^(Aᵀs) ds, R = Rc/Δt.

        y is the mean of the signal over a step, in which the states are treated as constant. Use steps that are short
        compared with the correlation times.

        Parameters
        ----------
        rate : float
            Steps per second (Hz). With the rate of the recording, the result is the original discrete model.

        References
        ----------
        Van Loan, C. F. (1978), Computing integrals involving the matrix exponential, IEEE Transactions on Automatic
        Control 23, 395-404.

        Examples
        --------
        >>> import gmwm
        >>> walk = gmwm.Model.parse("RW(gamma2=2.0)").continuous(rate=100.0)
        >>> walk.discrete(rate=10.0).Q
        array([[20.]])
        """
        rate = as_rate(rate)
        transition, noise = np.zeros_like(self.A), np.zeros_like(self.Qc)
        for block in _blocks((self.A != 0) | (self.Qc != 0)):
            at = np.ix_(block, block)
            transition[at], noise[at] = _step(self.A[at], self.Qc[at], 1.0 / rate)
        return StateSpace(transition, noise, self.H, self.Rc * rate, self.m0, self.P0, self.diffuse)


def _driven(space: StateSpace, rate: float) -> tuple[Matrix, Matrix] | None:
    """Return A and Qc, or None if there is no continuous model."""
    p, noisy = space.states, bool(np.any(space.Q))
    values = np.linalg.eigvals(space.F)
    # Eigenvalues that are zero or negative have no real logarithm: quantization noise, AR1 with φ < 0.
    if np.any(np.abs(values) < np.finfo(float).tiny) or np.any((values.imag == 0) & (values.real <= 0)):
        return None
    if p == 1:
        decay = np.log(space.F)
        return rate * decay, rate * space.Q / scipy.special.exprel(2.0 * decay)
    if noisy and not _keeps_its_range(space):
        return None
    a = rate * np.real(scipy.linalg.logm(space.F))
    if not noisy:
        return a, np.zeros((p, p))
    turn = np.kron(a, np.eye(p)) + np.kron(np.eye(p), a)
    # ∫₀^Δt e^(turn s) ds is the upper right block of the exponential of [[turn, I], [0, 0]] Δt.
    system = np.zeros((2 * p * p, 2 * p * p))
    system[: p * p, : p * p], system[: p * p, p * p :] = turn, np.eye(p * p)
    gain = scipy.linalg.expm(system / rate)[: p * p, p * p :]
    density = np.linalg.solve(gain, space.Q.ravel()).reshape(p, p)
    density = (density + density.T) / 2
    spectrum = np.linalg.eigvalsh(density / _sizes(space.Q) / rate)
    return (a, density) if spectrum[0] >= -_ROUNDING * np.max(np.abs(spectrum)) else None


def _keeps_its_range(space: StateSpace) -> bool:
    """Return whether F maps the range of Q into itself, as continuous noise spreads within a step."""
    root = np.sqrt(np.diag(_sizes(space.Q)))
    scaled = space.F * root / root[:, None]
    size, axes = np.linalg.eigh(space.Q / _sizes(space.Q))
    reached = axes[:, size > _ROUNDING * size[-1]]
    moved = scaled @ reached
    return bool(np.linalg.norm(moved - reached @ (reached.T @ moved)) <= _ROUNDING * np.linalg.norm(moved))


def _sizes(covariance: Matrix) -> Matrix:
    """Return the products s_i s_j of standard deviations, with 1 for 0, to make a covariance dimensionless."""
    deviations = np.sqrt(np.diag(covariance))
    deviations = np.where(deviations > 0, deviations, 1.0)
    return np.asarray(np.outer(deviations, deviations), dtype=np.float64)


def _blocks(linked: Booleans) -> list[Integers]:
    """Return the indices of the states of each block of coupled states."""
    reach = linked | linked.T | np.eye(len(linked), dtype=np.bool_)
    for _ in range(len(linked).bit_length()):
        reach = reach @ reach
    return [np.flatnonzero(row) for row in np.unique(reach, axis=0)]


def _step(a: Matrix, density: Matrix, dt: float) -> tuple[Matrix, Matrix]:
    """Return F and Q of one block for a step of `dt` (s)."""
    p = len(a)
    if p == 1:
        return np.exp(a * dt), dt * density * scipy.special.exprel(2.0 * a * dt)
    # Van Loan's exponential contains e^(−A dt), which can be very large: take a short step and double it.
    halvings = max(0, int(np.frexp(np.linalg.norm(a) * dt)[1]))
    size = float(np.max(np.abs(density))) or 1.0
    exponential = scipy.linalg.expm(np.block([[-a, density / size], [np.zeros((p, p)), a.T]]) * np.ldexp(dt, -halvings))
    transition = exponential[p:, p:].T
    noise = size * (transition @ exponential[:p, p:])
    for _ in range(halvings):
        noise = noise + transition @ noise @ transition.T
        transition = transition @ transition
    return transition, (noise + noise.T) / 2
