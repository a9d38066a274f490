"""Stationarity, coordinates, roots and squared modulus of polynomials 1 − a₁z − … − a_n z^n.

Several polynomials of the same degree are given as the rows of an array of coefficients a.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.theory.filters import HAAR, WaveletFilter


def coordinates(rows: Matrix) -> Matrix:
    """Compute artanh of the partial autocorrelations (rows, n) by the backward Durbin-Levinson recursion; NaN if a
    modulus is at least 1, because the polynomial then has a zero with |z| ≤ 1.

    >>> coordinates(np.array([[0.5], [1.0]])).round(4).tolist()
    [[0.5493], [nan]]
    """
    rows = np.ascontiguousarray(rows, dtype=np.float64)
    out = np.empty(rows.shape)
    _core.arma_coordinates(rows, out)
    return out


def at_coordinates(z: NDArray[Any]) -> NDArray[Any]:
    """Compute the coefficients a (rows, n) from `coordinates` z. The function is analytic, so z can be complex."""
    partial = np.tanh(z)
    rows = np.empty_like(partial)
    for n in range(partial.shape[1]):
        k = partial[:, n : n + 1]
        rows[:, :n] = rows[:, :n] - k * rows[:, :n][:, ::-1]
        rows[:, n] = partial[:, n]
    return np.asarray(rows)


def roots(a: Vector) -> NDArray[np.complex128]:
    """Compute the n roots λ of λ^n = a₁λ^(n−1) + … + a_n. All |λ| < 1 if the autoregression is stationary."""
    return np.asarray(np.roots(np.concatenate(([1.0], -np.asarray(a)))), dtype=np.complex128)


def clearance(rows: Matrix) -> Vector:
    """Compute half the minimum modulus (rows,) of each polynomial on |z| = 1; 0 for a polynomial with a zero inside."""
    # Number of points on the half circle at which the modulus is evaluated, in addition to the angles of the roots.
    grid = 256
    rows = np.asarray(rows, dtype=np.float64)
    inside = np.all(np.isfinite(coordinates(rows)), axis=1)
    result = np.zeros(len(rows))
    if np.any(inside):
        good = rows[inside]
        companion = np.zeros((len(good), rows.shape[1], rows.shape[1]))
        companion[:, 0] = good
        companion[:, np.arange(1, rows.shape[1]), np.arange(rows.shape[1] - 1)] = 1.0
        near = np.angle(np.linalg.eigvals(companion)) / (2.0 * np.pi)
        cycles = np.concatenate([near, np.broadcast_to(np.linspace(0.0, 0.5, grid + 1), (len(good), grid + 1))], 1)
        result[inside] = 0.5 * np.sqrt(np.min(squared_size(good[:, None, :], cycles), axis=1))
    return result


def squared_size(rows: NDArray[np.float64], cycles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute |1 − Σ a_i z^i|² at z = exp(−2πi·cycles) for rows of coefficients, as 1 − Σ a_i c^i + Σ a_i (c^i − z^i)
    with the nearer c of ±1, which is accurate for zeros near c."""
    cycles = np.ascontiguousarray(cycles, dtype=np.float64)
    turns_of = _turns if cycles.size < 10_000 else _turns.__wrapped__  # the cache is for small grids
    behind, turns = turns_of(cycles.tobytes(), cycles.shape, rows.shape[-1])
    real = np.where(behind, _at_one(rows, -1.0), _at_one(rows, 1.0))
    imaginary = np.zeros(real.shape)
    for i, (sine, cosine) in enumerate(turns, 1):
        # c^i (1 − e^(−iδi)) = c^i (2 sin² + 2i sin cos) of δi/2
        weight = rows[..., i - 1] * np.where(behind, (-1.0) ** i, 1.0)
        real = real + 2.0 * weight * sine * sine
        imaginary = imaginary + 2.0 * weight * sine * cosine
    return np.asarray(real * real + imaginary * imaginary)


@lru_cache(maxsize=8)
def _turns(
    cycles: bytes, shape: tuple[int, ...], order: int
) -> tuple[NDArray[np.bool_], list[tuple[NDArray[np.float64], NDArray[np.float64]]]]:
    """Return whether −1 is nearer to z than 1, and sin and cos of δi/2 for i = 1 … `order`, with the angle δ to the
    nearer one. The densities of one process, moved by each parameter, are computed at the same frequencies."""
    turned = np.frombuffer(cycles).reshape(shape)
    turned = turned - np.round(turned)
    behind = np.abs(turned) > 0.25
    angle = 2.0 * np.pi * (turned - np.where(behind, np.copysign(0.5, turned), 0.0))
    return behind, [(np.sin(0.5 * i * angle), np.cos(0.5 * i * angle)) for i in range(1, order + 1)]


def _at_one(rows: NDArray[np.float64], c: float) -> NDArray[np.float64]:
    """Compute 1 − Σ a_i c^i by compensated summation, which is accurate even if the result is tiny."""
    total, error = np.ones(rows.shape[:-1]), np.zeros(rows.shape[:-1])
    for i in range(rows.shape[-1]):
        term = -rows[..., i] * c ** (i + 1)
        added = total + term
        back = added - total
        error = error + ((total - (added - back)) + (term - back))
        total = added
    return np.asarray(total + error)


@lru_cache(maxsize=64)
def odd_lags(filter: WaveletFilter) -> Vector:
    """Return the autocorrelations of the scaling filter at the lags 1, 3, 5, …; those at the lags 2, 4, … are zero."""
    if filter is HAAR:
        return freeze(np.empty(0))
    both = np.correlate(filter.scaling, filter.scaling, "full")
    return freeze(np.ascontiguousarray(both[filter.length :: 2]))
