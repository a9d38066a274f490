"""Common parts of the Allan, Hadamard and total variances: the phase of a signal and the cluster sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base import _core
from gmwm.base.arrays import Vector, as_vector, require_finite, require_rate
from gmwm.base.errors import DataError, OptionError
from gmwm.base.units import find_unit
from gmwm.measuring.axis_results import rate_of_array
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.options import one_of
from gmwm.recording.signals import Signal

Clusters: TypeAlias = Literal["octave", "decade", "all"]
"""Name of a choice of cluster sizes: 1, 2, 4, 8, …; 1, 2, 4, 10, 20, 40, 100, …; or every size."""
Data: TypeAlias = Literal["rate", "phase"]  # kind of the samples: the rate (as from an IMU), or its integral, the phase
Progress: TypeAlias = Callable[[int, int], object]
"""Function that is called with the number of finished cluster sizes and the number of all cluster sizes."""


TOO_LARGE = "the signal is too large: its squares and sums overflow double precision"
SCALE_DOWN = "Pass the signal in a larger unit."


@dataclass(frozen=True, eq=False)
class Phase:
    """Phase of a recording minus a straight line, in the rate's unit times samples; `octaves` are sums of squared
    second differences at 1, 2, 4, … samples, if computed."""

    values: Vector
    rate: float
    samples: int
    unit: str = ""
    axis: str = ""
    data: Data = "rate"
    octaves: Vector | None = None

    @property
    def intervals(self) -> int:
        """Number of sampling intervals of the recording, one less than the number of phase values."""
        return int(self.values.size) - 1


def phase_of(x: Any, rate: float | None, data: Data, *, straighten: bool = False, octaves: bool = False) -> Phase:
    """Compute the phase: running sum of the centred rate, or the given phase without a line. `straighten` removes a
    line from the rate too, against rounding in third differences."""
    one_of(data, "data", ("rate", "phase"))
    if isinstance(x, Signal):
        require_rate(rate, x.rate)
        values, rate, unit, axis = x.fill_gaps().whole(), x.rate, x.unit, x.axis
    else:
        values, rate, unit, axis = as_vector(x, "x", finite=data == "phase"), rate_of_array(rate), "", ""
    if values.size < MINIMUM_SAMPLES:
        raise DataError(
            f"the signal must have at least {MINIMUM_SAMPLES} samples; got {values.size}", argument="x", got=values.size
        )
    sums = None
    with np.errstate(over="ignore", invalid="ignore"):
        if data == "phase":
            unit = _rate_unit(unit)
            phase = (values - values[0]) * rate
            phase = phase - np.arange(phase.size) * (phase[-1] / (phase.size - 1))  # a line through both ends
        elif octaves:
            phase, sums = _core.octave_second_differences(values, values.size.bit_length() - 1)
        else:
            phase = _core.running_sum(_without_slope(values) if straighten else values)
    if not np.isfinite(phase[-1]):
        require_finite(values, "x")
        raise DataError(TOO_LARGE, argument="x", advice=SCALE_DOWN)
    return Phase(values=phase, rate=rate, samples=values.size, unit=unit, axis=axis, data=data, octaves=sums)


def _rate_unit(unit: str) -> str:
    """Return the unit of the rate that corresponds to a unit of the phase."""
    if not unit:
        return ""
    rate_unit = find_unit(f"{unit}/s")
    return rate_unit.name if rate_unit else f"{unit}/s"


def _without_slope(values: Vector) -> Vector:
    """Subtract from the rate its mean and its least-squares slope; a constant rate becomes exactly zero."""
    n = values.size
    centred = values - _core.mean(values)
    time = np.arange(n, dtype=np.float64)
    time -= (n - 1) / 2
    # Σ time² = n (n² − 1)/12.
    time *= inner_product(time, centred) * 12 / (n * (float(n) * n - 1))
    centred -= time
    return centred


def cluster_sizes(clusters: Clusters | ArrayLike, largest: int, usual: int | None = None) -> NDArray[np.int64]:
    """Return the requested cluster sizes, up to `largest`, in ascending order. Names include sizes up to `usual`.

    >>> cluster_sizes("decade", 300)
    array([  1,   2,   4,  10,  20,  40, 100, 200])
    """
    if isinstance(clusters, str):
        top = largest if usual is None else usual
        if clusters == "all":
            return np.arange(1, top + 1, dtype=np.int64)
        if clusters == "octave":
            return np.int64(1) << np.arange(top.bit_length(), dtype=np.int64)
        if clusters == "decade":
            each = [m * 10**e for e in range(len(str(top))) for m in (1, 2, 4)]
            return np.array([n for n in each if n <= top], dtype=np.int64)
        raise OptionError(argument="clusters", expected="octave, decade, all or a list of integers", got=clusters)
    sizes: NDArray[Any] = np.asarray(clusters)
    if sizes.ndim != 1 or sizes.size == 0 or sizes.dtype.kind not in "iu":
        raise OptionError(
            argument="clusters", expected="a list of integers (samples)", got=clusters,
            advice="A cluster of n samples has the averaging time n / rate.",
        )  # fmt: skip
    low, high = sizes.min(), sizes.max()
    if low < 1 or high > largest or np.any(np.diff(sizes.astype(np.int64)) <= 0):
        raise OptionError(
            argument="clusters", expected=f"ascending integers from 1 to {largest} for this recording", got=clusters,
        )  # fmt: skip
    return np.asarray(sizes, dtype=np.int64)


def mean_squares(
    kernel: Callable[[int], float], clusters: NDArray[np.int64], counts: NDArray[np.int64], progress: Progress | None
) -> Vector:
    """Divide the sums of squares of `kernel` by the numbers of terms; Ctrl-C stops between two sizes."""
    sums = np.empty(clusters.size)
    for k, n in enumerate(clusters.tolist()):
        if progress is not None:
            progress(k, clusters.size)
        sums[k] = kernel(n)
    if progress is not None:
        progress(clusters.size, clusters.size)
    if not np.all(np.isfinite(sums)):
        raise DataError(TOO_LARGE, argument="x", advice=SCALE_DOWN)
    return np.asarray(sums / counts)


def inner_product(a: Vector, b: Vector) -> float:
    """Compute Σ a_i b_i without BLAS, whose threads wait for each other: ten times as long on a busy machine."""
    return float(np.einsum("i,i->", a, b))
