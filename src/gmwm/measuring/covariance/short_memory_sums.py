"""Sums over lags for a model of one process with fixed shape and short memory and of other processes, from few nodes.

Near a kink (a lag at which the covariance is not smooth), every lag within the memory of such a process is a term of
the sum. There are a million terms for 19 levels and a memory of a thousand samples. The sum of squares for the model is

    Σ n (s C + D)² = s² Σ n C² + 2 s Σ n C D + Σ n D²,

where n is the number of pairs of coefficients at a lag, C the covariance of the process for scale coefficient 1, s its
scale coefficient, and D the covariance of the other processes. The first sum is one number for each pair of levels. In
the second sum, D is smooth between the kinks. It is interpolated between Chebyshev nodes on intervals [d, 2d] of the
distance d from a kink, so that n C is replaced by one weight for each node.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector
from gmwm.measuring.covariance.design import Design
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.haar_covariance import WANDERING, WHITE, LagGrid, Pieces

ORDER = 16
"""Number of nodes in an interval [d, 2d]. For a function with a singularity at 0, the relative error of the
interpolation is 5.8⁻¹⁶ = 6e-13 (Trefethen 2013, Approximation Theory and Approximation Practice, chapter 8)."""
EVERY_RATE = (2.0**-964, 2.0)
"""Range of decay rates (per sample) of the other processes for which the sums are valid. It covers all rates that
occur."""


@dataclass(frozen=True, eq=False)
class ShapeSums:
    """Sums over lags for a process with scale coefficient 1, one for each pair of levels; see the module docstring.

    Attributes
    ----------
    levels : list of int
        Levels j.
    at : LagGrid
        Nodes at which the covariance D of the other processes is needed.
    pieces : tuple of arrays
        Groups of these nodes; see `LagGrid`.
    weight : (nodes,) array
        Weights of the nodes, for which Σ n C D is the sum of weight times D.
    starts : (pairs,) int array
        First node of each pair.
    first, second : (pairs,) arrays
        Σ n C and Σ n C².
    known : dict
        Cached sums Σ n C D for processes with scale coefficient 1, by class and shape.
    """

    levels: list[int]
    at: LagGrid
    pieces: Pieces
    weight: Vector
    starts: NDArray[np.int64]
    first: Vector
    second: Vector
    known: dict[Any, Vector] = field(default_factory=dict)

    def mixed(self, others: Sequence[Process], rate: float) -> Vector:
        """Compute Σ n C D (pairs,), where D is the covariance of the processes `others`."""
        total, moving = np.zeros(self.starts.size), np.zeros(self.weight.size)
        decays: list[float] = []
        factors: list[float] = []
        other = False
        for process in others:
            if has_fixed_shape(process):
                total += process.scale * self._of_shape(process, rate)
            elif (part := exponential_part(process, rate)) is not None:
                factors.append(part[0])
                decays.append(part[1])
            else:
                moving += process.coefficient_covariance(self.at, rate)
                other = True
        if decays:
            at, factor = self.at, np.array(factors)
            total += _core.exponential_node_sums(
                [], np.array(decays), factor, self.weight, self.starts, at.fine, at.coarse, at.lag, self.pieces
            )[0]
        return total + self._sum(moving) if other else total

    def _of_shape(self, process: Process, rate: float) -> Vector:
        """Return Σ n C D for the shape of a process, and cache it."""
        key = (type(process), tuple(process.nonlinear.tolist()))
        if key not in self.known:
            standard = type(process).standard(process.nonlinear)
            self.known[key] = self._sum(standard.coefficient_covariance(self.at, rate))
        return self.known[key]

    def _sum(self, covariance: Vector) -> Vector:
        return np.asarray(np.add.reduceat(self.weight * covariance, self.starts))


def has_fixed_shape(process: Process) -> bool:
    """Return whether every parameter that changes the shape of the process is fixed."""
    return all(process.is_fixed(p.name) for p in process.nonlinear_parameters())


def exponential_part(process: Process, rate: float) -> tuple[float, float] | None:
    """Return the variance and the decay λ of an autocovariance e^(−λ|k|), if the process has one; otherwise None.

    The class that defines `coefficient_covariance` must define `exponential_part` too, because a subclass may have
    another covariance.
    """
    kind = next(kind for kind in type(process).__mro__ if "coefficient_covariance" in vars(kind))
    if "exponential_part" not in vars(kind) or has_fixed_shape(process):
        return None
    part: tuple[float, float] | None = vars(kind)["exponential_part"](process, rate)
    return part if part is not None and WANDERING <= part[1] <= WHITE else None


def shape_sums(process: Process, design: Design, *, diagonal: bool) -> ShapeSums:
    """Return the sums for a process whose shape is fixed, at least for the levels of a design.

    Models with the same process share the sums.
    """
    place = _places(
        type(process), tuple(process.nonlinear.tolist()), design.samples, rate=design.rate, diagonal=diagonal
    )
    levels = design.levels.tolist()
    found = place[0] if place else None
    if found is None or found.levels[: len(levels)] != levels:
        found = _shape_sums(process, design, diagonal)
        place[:] = [found]
    return found


@lru_cache(maxsize=6)
def _places(
    kind: type[Process], nonlinear: tuple[float, ...], samples: int, *, rate: float, diagonal: bool
) -> list[ShapeSums]:
    """Return the list that caches the sums of a process; it is empty before the first request.

    The levels are not a part of the key, because sums for more levels contain those for the first levels.
    """
    return []


def _shape_sums(process: Process, design: Design, diagonal: bool) -> ShapeSums:
    standard = type(process).standard(process.nonlinear)
    starts, fine, coarse, lag, weight, _ = _core.covariance_lags(
        design.levels, design.samples, *EVERY_RATE, False, diagonal, process.memory(design.rate) or 0
    )
    covariance = standard.coefficient_covariance(LagGrid(fine, coarse, lag), design.rate)
    weight = weight * covariance
    first = np.add.reduceat(weight, starts)
    covariance *= weight
    second = np.add.reduceat(covariance, starts)
    del covariance
    begins, sizes = _pieces(lag, fine, coarse, starts)
    kept = np.minimum(sizes, ORDER)
    places = np.concatenate([[0], np.cumsum(kept)])
    new_lag, new_weight = np.empty(places[-1]), np.empty(places[-1])
    lengths = np.flatnonzero(np.bincount(sizes))
    patterns = np.searchsorted(lengths, sizes)
    offsets = []
    for length in lengths.tolist():
        chosen = np.flatnonzero(sizes == length)
        old = begins[chosen, None] + np.arange(length)
        new = places[chosen, None] + np.arange(min(length, ORDER))
        if length <= ORDER:
            offsets.append(np.arange(length, dtype=np.float64))
            new_lag[new], new_weight[new] = lag[old], weight[old]
        else:
            nodes, shares = _interpolation(length)
            offsets.append(nodes - nodes[0])
            new_lag[new], new_weight[new] = lag[begins[chosen], None] + nodes, weight[old] @ shares
    # Intervals without covariance of the process are left out, but each pair keeps at least one interval.
    first_of_pair = np.searchsorted(begins, starts)
    used = np.logical_or.reduceat(new_weight != 0, places[:-1])
    used[first_of_pair] = True
    nodes_used = np.repeat(used, kept)
    pieces: Pieces = (
        np.cumsum(np.append(0, kept[used]))[:-1], patterns[used],
        np.cumsum([0, *(own.size for own in offsets)]), np.concatenate(offsets),
    )  # fmt: skip
    at = LagGrid(
        np.repeat(fine[begins], kept)[nodes_used], np.repeat(coarse[begins], kept)[nodes_used], new_lag[nodes_used],
        pieces=pieces,
    )  # fmt: skip
    return ShapeSums(
        levels=design.levels.tolist(), at=at, pieces=pieces, weight=new_weight[nodes_used],
        starts=np.cumsum(np.append(0, nodes_used))[places[first_of_pair]], first=first, second=second,
    )  # fmt: skip


def _pieces(
    lag: Vector, fine: Vector, coarse: Vector, starts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first node and the number of nodes of each interval, in ascending order.

    A node without neighbours is an interval of its own.
    """
    ends = np.append(starts[1:], lag.size)
    offsets = np.arange(3.0)
    corners = (coarse[starts, None, None] * offsets[:, None] - fine[starts, None, None] * offsets).reshape(-1, 9)
    places = np.empty(corners.shape, dtype=np.int64)
    for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        places[k] = start + np.searchsorted(lag[start:end], corners[k])
    inside = places < ends[:, None]
    kink = np.zeros(lag.size + 1, dtype=np.bool_)
    kink[places[inside][lag[places[inside]] == corners[inside]]] = True
    new = np.ones(lag.size + 1, dtype=np.bool_)
    new[1:-1] = np.diff(lag) != 1.0
    new[starts] = True
    new |= kink
    new[1:] |= kink[:-1]
    begins = np.flatnonzero(new)
    sizes = np.diff(begins)
    # Most intervals are short and need no division. A loop over all of them would take longer than the sums.
    long = np.flatnonzero(sizes > ORDER)
    pieces = [np.stack([begins[:-1], sizes], axis=1)[sizes <= ORDER]]
    for begin, end in zip(begins[long].tolist(), begins[long + 1].tolist(), strict=True):
        left, right = begin > 0 and kink[begin - 1], kink[end]
        pieces.append(np.array(_doubled(begin, end, bool(left), bool(right))))
    found = np.concatenate(pieces)
    found = found[np.argsort(found[:, 0])]
    return found[:, 0], found[:, 1]


def _doubled(begin: int, end: int, left: bool, right: bool) -> list[tuple[int, int]]:
    """Divide the nodes `begin` … `end` − 1 into intervals whose lengths double with the distance from a kink.

    `left` and `right` tell whether there is a kink at this end. Returns the first node and the number of nodes of each
    interval.
    """
    if end - begin <= ORDER:
        return [(begin, end - begin)]
    if left and right:
        middle = (begin + end) // 2
        return _doubled(begin, middle, True, False) + _doubled(middle, end, False, True)
    if not left and not right:
        return [(k, 1) for k in range(begin, end)]
    cuts = [0]
    while cuts[-1] < end - begin:
        cuts.append(min(2 * cuts[-1] if len(cuts) > 1 else ORDER, end - begin))
    if left:
        return [(begin + a, b - a) for a, b in pairwise(cuts)]
    return [(end - b, b - a) for a, b in pairwise(cuts)][::-1]


@lru_cache(maxsize=4096)
def _interpolation(length: int) -> tuple[Vector, Matrix]:
    """Return Chebyshev nodes between 0 and length − 1, and the matrix (length, ORDER) that interpolates to integers."""
    angle = (np.arange(ORDER) + 0.5) * math.pi / ORDER
    x = -np.cos(angle)
    sign = np.where(np.arange(ORDER) % 2, -1.0, 1.0) * np.sin(angle)
    t = 2 * np.arange(length) / (length - 1) - 1
    apart = t[:, None] - x
    exact = apart == 0
    share = sign / np.where(exact, 1.0, apart)
    share = np.where(exact.any(axis=1, keepdims=True), exact, share)
    return (x + 1) * (length - 1) / 2, share / share.sum(axis=1, keepdims=True)
