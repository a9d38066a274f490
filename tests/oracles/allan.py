"""Slow and obvious twins of the Allan family: the definitions in extended precision."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Extended = np.longdouble


def second(p: NDArray[np.longdouble], n: int) -> NDArray[np.longdouble]:
    return p[2 * n :] - 2 * p[n:-n] + p[: -2 * n]


def allan(phase: NDArray[np.float64], n: int, stride: int = 1) -> np.longdouble:
    return np.mean(second(phase.astype(Extended), n)[::stride] ** 2) / (2 * n**2)


def modified(phase: NDArray[np.float64], n: int) -> np.longdouble:
    d = second(phase.astype(Extended), n)
    sums = np.array([d[j : j + n].sum() for j in range(d.size - n + 1)])
    return np.mean(sums**2) / (2 * Extended(n) ** 4)


def hadamard(phase: NDArray[np.float64], n: int, stride: int = 1) -> np.longdouble:
    d = second(phase.astype(Extended), n)
    return np.mean((d[n:] - d[:-n])[::stride] ** 2) / (6 * n**2)


def total(phase: NDArray[np.float64], n: int) -> np.longdouble:
    p = phase.astype(Extended)
    q = np.concatenate([2 * p[0] - p[-2:0:-1], p, 2 * p[-1] - p[-2:0:-1]])
    middle = np.arange(p.size - 1, 2 * p.size - 3)
    return np.mean((q[middle - n] - 2 * q[middle] + q[middle + n]) ** 2) / (2 * n**2)
