"""Nodes at which covariances of Haar coefficients are summed over lags, and these covariances, both cached.

Between kinks, a Gauss rule for sums over integers needs few nodes; near a kink, every lag is a node."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import NEGLIGIBLE_EXPONENT, Integers, Vector
from gmwm.measuring.covariance.design import Design
from gmwm.theory.processes import haar_covariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.haar_covariance import WANDERING, LagGrid

MOST_NODES = 400_000
"""Largest number of cached nodes, 14 MB: 2 to 15 sets for 19 levels without a memory."""
SLOWEST_DECAYS = 20.0
"""Decay rates times samples below this do not change the nodes: the kernel divides lags up to 40 / rate at most."""
MOST_CACHED = 1_050_000  # largest number of values that are cached for the shapes of a grid that are not fixed


_COVARIANCES = {
    "coefficient_covariance", "autocovariance", "generalised_covariance", "running_sum_covariance", "exponential_sum",
}  # fmt: skip
"""Methods that define the covariance of a process."""


def lags(
    present: list[Process], design: Design, *, diagonal: bool, decays_of: float | None = None, stride: int = 1
) -> tuple[LagGrid, Vector, Integers]:
    """Return the nodes of the sums over lags, in steps of `stride` samples, their weights, and the first node of each
    pair. `decays_of` is the sampling rate (Hz), if it differs from the rate of the design."""
    rate = design.rate if decays_of is None else decays_of
    # Strides larger than 1 are even, so an alternating covariance does not alternate at multiples of a stride.
    decays = [(decay if stride == 1 else abs(decay) * stride) for process in present for decay in process.decays(rate)]
    sizes = [abs(decay) for decay in decays if decay != 0]  # a root that rounds to 1 needs no nodes of its own
    memory = -(-max((process.memory(rate) or 0 for process in present), default=0) // stride)
    # The range of rates and the memory are rounded outwards, so that all iterations of a fit and most candidates of a
    # selection use the same nodes. A smaller lower end adds few nodes, and so does an upper end above 1/16. The nodes
    # are the same for all lower ends below `SLOWEST_DECAYS` over the number of samples, and for upper ends above 1/4.
    ends = (0.0, 0.0)
    if sizes:
        high = math.ceil(math.log2(max(sizes)))
        high_end = 2.0 ** (high if high <= -4 else -2)
        low_end = max(2.0 ** (4 * math.floor(math.log2(min(sizes)) / 4)), SLOWEST_DECAYS / design.samples)
        ends = min(low_end, high_end), high_end
    unit = 1 << max(memory.bit_length() - 3, 0)
    levels = tuple(design.levels.tolist())
    key = design.samples, ends, any(decay < 0 for decay in decays), diagonal, -(-memory // unit) * unit
    # Recordings of one length share the nodes, also with fewer levels.
    return _grids.get(levels, key).first(len(levels), diagonal=diagonal)


_Key = tuple[int, tuple[float, float], bool, bool, int]
"""Samples, range of decay rates, whether a covariance alternates, whether only the diagonal is needed, and memory."""


@dataclass(frozen=True, eq=False)
class _Grid:
    """Nodes of the sums over lags for all pairs of some levels, their weights, and the first node of each pair."""

    levels: tuple[int, ...]
    at: LagGrid
    weight: Vector
    starts: Integers

    def first(self, levels: int, *, diagonal: bool) -> tuple[LagGrid, Vector, Integers]:
        """Return the nodes, weights and starts for the first levels, whose pairs come first."""
        pairs = levels if diagonal else levels * (levels + 1) // 2
        if pairs == self.starts.size:
            return self.at, self.weight, self.starts
        end = int(self.starts[pairs])
        return self.at.first(end), self.weight[:end], self.starts[:pairs]


class _Grids:
    """The grids that were used last, at most `MOST_NODES` nodes together."""

    def __init__(self) -> None:
        self._kept: dict[_Key, _Grid] = {}
        self._lock = threading.Lock()

    def get(self, levels: tuple[int, ...], key: _Key) -> _Grid:
        """Return a grid for at least these levels, as the first ones."""
        with self._lock:
            found = self._kept.pop(key, None)
            if found is not None:
                self._kept[key] = found
        if found is None or found.levels[: len(levels)] != levels:
            samples, ends, alternating, diagonal, memory = key
            (starts, fine, coarse, lag, weight, odd), pieces = _core.covariance_nodes(
                np.array(levels, dtype=np.int64), samples, *ends, alternating, diagonal, memory
            )
            at = LagGrid(fine, coarse, lag, odd if odd.size else None, pieces=pieces)
            found = _Grid(levels, at, weight, starts)
            # Memory (samples) up to which nodes are cached: 46 MB at most for 19 levels, 6 MB without a memory.
            if key[-1] <= 1024:
                with self._lock:
                    self._kept.pop(key, None)
                    self._kept[key] = found
                    while len(self._kept) > 1 and sum(grid.weight.size for grid in self._kept.values()) > MOST_NODES:
                        del self._kept[next(iter(self._kept))]
        return found

    def clear(self) -> None:
        """Forget all grids."""
        with self._lock:
            self._kept.clear()


_grids = _Grids()


def alternates(present: list[Process], rate: float) -> bool:
    """Return whether the covariance of a process changes its sign at every lag."""
    return any(decay < 0 for process in present for decay in process.decays(rate))


def coefficient_covariance(present: list[Process], at: LagGrid, rate: float) -> Vector:
    """Compute 2^(j+k) Cov(W_j, W_k) of the sum of the processes at the nodes."""
    return total_at(*shapes_at(present, at, rate), at)


def total_at(shapes: list[Vector], scales: list[float], at: LagGrid) -> Vector:
    """Compute the sum of the shapes, each multiplied by its scale."""
    total = np.zeros_like(at.lag)
    for shape, scale in zip(shapes, scales, strict=True):
        total += scale * shape
    return total


def product_sums(
    present: list[Process], at: LagGrid, weight: Vector, starts: Integers, rate: float
) -> tuple[Vector, Vector]:
    """Compute Σ n Cov and Σ n Cov² over the nodes of pairs of levels, exponentials pair by pair to save memory."""
    parts = [None if at.pieces is None else _exponential_part(process, rate) for process in present]
    exponential = [part for part in parts if part is not None]
    shapes, scales = shapes_at([p for p, part in zip(present, parts, strict=True) if part is None], at, rate)
    factors = np.array([*scales, *(variance for variance, _ in exponential)], dtype=np.float64)
    decays = [decay for _, decay in exponential]
    grid, count = at if at.whole is None else at.whole, weight.size
    known = all(decay in grid.recent for decay in decays)
    if at.pieces is None or known:
        return _core.node_sums([*shapes, *(_kept(grid, decay)[:count] for decay in decays)], factors, weight, starts)
    grid.recent.update(dict.fromkeys(decays))
    _forget(grid)
    return _core.exponential_node_sums(
        shapes, np.array(decays), factors, weight, starts, at.fine, at.coarse, at.lag, at.pieces
    )  # fmt: skip


def _kept(at: LagGrid, decay: float) -> Vector:
    """Return the covariances for the autocovariance e^(−λ|k|) with λ = `decay`, and cache them."""
    shape = at.recent.pop(decay, None)
    if shape is None:
        shape = haar_covariance.exponential(at, decay)
    at.recent[decay] = shape
    _forget(at)
    return shape


def _forget(at: LagGrid) -> None:
    """Remove the shapes that were not used recently."""
    for old in list(at.recent)[: -max(MOST_CACHED // at.lag.size, 1)]:
        at.recent.pop(old, None)


def shapes_at(present: list[Process], at: LagGrid, rate: float) -> tuple[list[Vector], list[float]]:
    """Return the covariances at the nodes, as shapes and factors; for many nodes, their sum is the only shape."""
    if at.whole is not None:
        shapes, scales = shapes_at(present, at.whole, rate)
        return [shape[: at.lag.size] for shape in shapes], scales
    # Nodes up to which covariances of fixed shapes are cached, at 8 bytes each.
    if at.lag.size > 2_000_000:
        total = np.zeros_like(at.lag)
        for process in present:
            total += process.coefficient_covariance(at, rate)
        return [total], [1.0]
    shapes, scales = [], []
    for process in present:
        # Shapes do not depend on scales: compared models share fixed ones, and fits, covariances and limits others.
        fixed = process.shape_is_fixed
        if not fixed and at.lag.size > MOST_CACHED // 2:
            shapes.append(process.coefficient_covariance(at, rate))
            scales.append(1.0)
            continue
        kept = at.known if fixed else at.recent
        key = (type(process), tuple(process.nonlinear.tolist()), rate)
        shape = kept.pop(key, None)
        if shape is None:
            shape = type(process).standard(process.nonlinear).coefficient_covariance(at, rate)
        kept[key] = shape
        if not fixed:
            _forget(at)
        shapes.append(shape)
        scales.append(process.scale)
    return shapes, scales


def _exponential_part(process: Process, rate: float) -> tuple[float, float] | None:
    """Return the variance and the decay λ of an autocovariance e^(−λ|k|), if the process has one; otherwise None."""
    terms = None if process.shape_is_fixed else exponential_sum(process, rate)
    if (
        terms is None
        or terms.decays.size != 1
        or terms.decays[0].imag
        or terms.white
        or terms.walk
        or terms.spikes.size
    ):
        return None
    decay = float(terms.decays[0].real)
    return (float(terms.amplitudes[0].real), decay) if WANDERING <= decay <= NEGLIGIBLE_EXPONENT else None


def exponential_sum(process: Process, rate: float) -> ExponentialSum | None:
    """Return the sum of exponentials of the class that defines the covariance: a subclass may have another one."""
    kind = next(kind for kind in type(process).__mro__ if _COVARIANCES & vars(kind).keys())
    terms: ExponentialSum | None = vars(kind).get("exponential_sum", Process.exponential_sum)(process, rate)
    return terms
