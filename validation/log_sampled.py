"""Maximum likelihood of a record that is sampled logarithmically: a few hundred block means in place of all samples.

The idea of Nikolic, Furgale, Melzer and Siegwart: noise of inertial sensors acts on time scales that lie decades
apart, so the exact likelihood of the integrated signal at instants whose distances grow by powers of two holds much
of what a long record knows, at a cost that hardly grows with its length. The text of their paper was not at hand, and
the rest is ours: how many instants there are of each distance, that the distances grow from the beginning to the end
of the record, the unknown offset of the sensor, the covariances, and the search. It shares no code with
`gmwm.fit_ml`.

Nikolic, J., Furgale, P., Melzer, A. and Siegwart, R. (2016), Maximum likelihood identification of inertial sensor
noise model parameters, IEEE Sensors Journal 16(1), 163-176.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.linalg.lapack import dpotri
from scipy.optimize import minimize

import gmwm
from gmwm.theory.processes.base import Process

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

EACH = 64
"""Blocks of each length."""

FAINT = 1e-6
"""Share of the variance of first differences that counts as zero; of a random walk, at the end of the record."""

FLAT = 5e-3
"""Slope of the log likelihood by the logarithm of a parameter that counts as none."""

UNSEEN = 0.1
"""A variance below this share of its own standard error counts as zero."""


@dataclass(frozen=True)
class Blocks:
    """Means over neighbouring blocks, whose lengths are powers of two.

    Parameters
    ----------
    starts, lengths : (n,) int array
        First sample and number of samples of each block.
    means : (n,) array
    """

    starts: NDArray[np.int64]
    lengths: NDArray[np.int64]
    means: Vector


def log_sampling(x: Vector, each: int = EACH) -> Blocks:
    """Divide a record into `each` blocks of 1 sample, as many of 2, 4 …, and so on to its end.

    The means are what the running sum at the instants between the blocks tells: angle increments of a gyroscope over
    growing times. What is left at the end and shorter than a block is not used.

    >>> log_sampling(np.arange(10.0), each=2)
    Blocks(starts=array([0, 1, 2, 4, 6]), lengths=array([1, 1, 2, 2, 4]), means=array([0. , 1. , 2.5, 4.5, 7.5]))
    """
    octaves = math.floor(math.log2(x.size / each + 1)) + 1
    lengths = np.repeat(2 ** np.arange(octaves), each)
    lengths = lengths[np.cumsum(lengths) <= x.size]
    starts = np.cumsum(lengths) - lengths
    sums = np.add.reduceat(x[: int(starts[-1] + lengths[-1])] - x.mean(), starts)
    return Blocks(starts, lengths, sums / lengths + x.mean())


class BlockLikelihood:
    """The Gaussian likelihood of all differences of block means, exact, for sums of WN, QN, RW and GM.

    An unknown offset drops out of the differences, as does where a random walk begins.
    """

    def __init__(self, processes: tuple[Process, ...], blocks: Blocks, rate: float) -> None:
        self.processes, self.blocks, self.rate = processes, blocks, rate
        starts, lengths = blocks.starts, blocks.lengths
        self._products = np.outer(lengths, lengths).astype(np.float64)
        # From the last sample of one block to the first of the other.
        later = np.maximum.outer(starts, starts)
        self._gaps = (later - np.minimum.outer(starts + lengths, starts + lengths) + 1.0).clip(min=0.0)

    def part(self, process: Process, parameters: Vector) -> tuple[Matrix, list[Matrix]]:
        """Covariance of block means (n, n), and its derivatives by the logarithm of each parameter."""
        if isinstance(process, gmwm.GM):
            return self._markov(*parameters)
        whole = parameters[0] * self._linear(process)
        return whole, [whole]

    def _linear(self, process: Process) -> Matrix:
        lengths = self.blocks.lengths.astype(np.float64)
        if isinstance(process, gmwm.WN):
            return np.diag(1 / lengths)
        if isinstance(process, gmwm.QN):
            # The sum over a block is the difference of the errors at its ends.
            ones = np.ones(lengths.size - 1)
            return (2 * np.eye(lengths.size) - np.diag(ones, 1) - np.diag(ones, -1)) / self._products
        if isinstance(process, gmwm.RW):
            # From the first sample on, Cov(x_s, x_t) = min(s, t): on the mean, where the earlier block has its middle.
            middles = self.blocks.starts + (lengths + 1) / 2
            inside = np.diag((lengths**2 - 1) / (6 * lengths))
            return np.asarray(np.minimum.outer(middles, middles) - inside)
        raise TypeError(f"the likelihood of block means knows WN, QN, RW and GM, got {process!r}")

    def _markov(self, beta: float, marginal: float) -> tuple[Matrix, list[Matrix]]:
        """Σ φ^|s−t| over two blocks a gap g apart is φ^g A A', A = (1 − φ^L)/(1 − φ); over one block, by doubling."""
        decay, lengths = beta / self.rate, self.blocks.lengths.astype(np.float64)
        reach = np.expm1(-decay * lengths) / math.expm1(-decay)
        slope = lengths / np.expm1(np.minimum(decay * lengths, 700.0)) - 1 / math.expm1(decay)  # ∂ log A / ∂λ
        whole = marginal * np.exp(-decay * self._gaps) * (np.outer(reach, reach) / self._products)
        bent = whole * (decay * (np.add.outer(slope, slope) - self._gaps))
        inside, bend = _own_sums(decay, int(lengths.max()).bit_length())
        octave = np.log2(lengths).astype(np.int64)
        np.fill_diagonal(whole, marginal * inside[octave] / lengths**2)
        np.fill_diagonal(bent, marginal * decay * bend[octave] / lengths**2)
        return whole, [bent, whole]

    def evaluate(self, logs: Vector) -> tuple[float, Vector, Matrix]:
        """Log likelihood, its gradient and average information by the logarithms of all parameters.

        With P = C⁻¹ − C⁻¹1(1ᵀC⁻¹1)⁻¹1ᵀC⁻¹ and C_i = ∂C/∂log θ_i: ℓ = −½[(n − 1) log 2π + log|C| + log 1ᵀC⁻¹1 + yᵀPy],
        ∂ℓ = −½[tr PC_i − yᵀPC_iPy]; the average of observed and expected information is ½ yᵀPC_iPC_jPy.
        """
        parts, at = [], 0
        for process in self.processes:
            count = len(process.parameters)
            parts.append(self.part(process, np.exp(logs[at : at + count])))
            at += count
        y, n = self.blocks.means, self.blocks.means.size
        factor = cholesky(np.sum([whole for whole, _ in parts], axis=0), lower=True)
        lower, _ = dpotri(factor, lower=True)
        inverse = np.tril(lower) + np.tril(lower, -1).T
        ones = inverse.sum(axis=1)
        total = float(ones.sum())
        projection = inverse - np.outer(ones, ones) / total
        residual = projection @ (y - y.mean())
        determinant = 2 * float(np.log(np.diag(factor)).sum()) + math.log(total)
        value = -0.5 * ((n - 1) * math.log(2 * math.pi) + determinant + float((y - y.mean()) @ residual))
        derivatives = [matrix for _, bent in parts for matrix in bent]
        pulled = np.array([matrix @ residual for matrix in derivatives])
        traces = np.array([np.vdot(projection, matrix) for matrix in derivatives])
        return value, 0.5 * (pulled @ residual - traces), 0.5 * pulled @ projection @ pulled.T


def _own_sums(decay: float, octaves: int) -> tuple[Vector, Vector]:
    """S = Σ Σ φ^|s−t| over blocks of 1, 2, 4 … samples, and ∂S/∂λ: S(2L) = 2 S(L) + 2 φ A(L)², all of one sign."""
    sums, bends = [1.0], [0.0]
    for octave in range(octaves - 1):
        length = 2.0**octave
        across = math.exp(-decay) * (math.expm1(-decay * length) / math.expm1(-decay)) ** 2
        slope = length / math.expm1(min(decay * length, 700.0)) - 1 / math.expm1(decay)
        bends.append(2 * bends[-1] + 2 * across * (2 * slope - 1))
        sums.append(2 * sums[-1] + 2 * across)
    return np.array(sums), np.array(bends)


@dataclass(frozen=True)
class LogSampled:
    """Parameters by name where the likelihood of block means is largest; 0 where a term is not seen."""

    parameters: Mapping[str, float]
    loglikelihood: float
    blocks: int
    evaluations: int


def most_likely_blocks(start: gmwm.Model, x: Vector, rate: float, *, each: int = EACH, most: int = 80) -> LogSampled:
    """Maximum of the likelihood of log-sampled block means, sought in the logarithms by a quasi-Newton method.

    Parameters
    ----------
    start : Model
        With all its values, of WN, QN, RW and GM. A variance of zero starts where it is barely felt.
    x : (N,) array
        The record.
    rate : float
        Samples per second (Hz).
    each : int
        Blocks of each length.
    most : int
        Steps after which the search ends in any case.
    """
    likelihood = BlockLikelihood(start.processes, log_sampling(x, each), rate)
    low, high = _bounds(start, x, rate)
    is_variance = np.array([not name.endswith("beta") for name in start.names])
    values = np.array([value or 0.0 for value in start.parameters.values()])
    at = np.clip(np.log(np.maximum(values, 1e-300)), low + np.where(is_variance, math.log(1000), 0.0), high)

    def criterion(logs: Vector) -> tuple[float, Vector]:
        inside = np.clip(logs, low, high)
        value, gradient, _ = likelihood.evaluate(inside)
        # Beyond the ends it rises as a parabola.
        beyond = logs - inside
        return float(beyond @ beyond) - value, 2 * beyond - np.where(beyond == 0, gradient, 0.0)

    _, _, information = likelihood.evaluate(at)
    first = np.linalg.inv(information + 0.3 * np.eye(at.size))
    options = {"gtol": FLAT, "hess_inv0": (first + first.T) / 2, "maxiter": most}
    found = minimize(criterion, at, jac=True, method="BFGS", options=options)
    at = np.clip(found.x, low, high)
    value, _, information = likelihood.evaluate(at)
    unseen = is_variance & (np.diag(information) < UNSEEN**2)
    estimate = dict(zip(start.names, np.where(unseen, 0.0, np.exp(at)).tolist(), strict=True))
    parameters = {name: value or 0.0 for name, value in start.with_values(estimate).sorted(rate).parameters.items()}
    return LogSampled(parameters, value, likelihood.blocks.means.size, int(found.nfev) + 2)


def _bounds(model: gmwm.Model, x: Vector, rate: float) -> tuple[Vector, Vector]:
    """Ends of the logarithms: variances down to what cannot be seen, β from a random walk to white noise."""
    scale = float(np.mean(np.diff(x) ** 2)) / 2
    low, high = [], []
    for process in model.processes:
        if isinstance(process, gmwm.GM):
            low.append(0.1 * rate / x.size)
            high.append(10 * rate)
        low.append(FAINT * scale / (x.size if isinstance(process, gmwm.RW) else 1))
        high.append(1e6 * scale)
    return np.log(low), np.log(high)
