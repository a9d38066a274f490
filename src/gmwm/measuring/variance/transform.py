"""Maximal-overlap and decimated discrete wavelet transforms (MODWT and DWT), with their inverses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Integers, Vector, as_vector, as_whole_number
from gmwm.recording.options import one_of
from gmwm.recording.signals import Signal
from gmwm.theory.filters import WaveletFilter, find_filter

Boundary = Literal["periodic", "reflection"]
"""Extension of a signal beyond its ends, either periodic or by its mirror image."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class _Transform(FrozenArrays):
    """Coefficients of a wavelet transform."""

    filter: WaveletFilter
    details: Mapping[int, Vector]
    smooth: Vector
    samples: int
    boundary: Boundary

    @property
    def levels(self) -> int:
        """Number of levels J."""
        return len(self.details)

    def __repr__(self) -> str:
        name, samples = type(self).__name__, self.samples
        return f"{name}({self.filter.name}, {self.levels} levels, {samples} samples, {self.boundary})"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Modwt(_Transform):
    """Maximal-overlap discrete wavelet transform of a signal.

    Attributes
    ----------
    filter : WaveletFilter
        The wavelet filter.
    details : mapping of level j to array
        Wavelet coefficients W_{j,t} = Σ_l h_{j,l} X_{t−l}. Each level has N coefficients, or 2N with reflection.
    smooth : array
        Scaling coefficients V_{J,t} of the last level.
    interior : mapping of level j to slice
        Positions t = L_j − 1 … N − 1 of the coefficients that do not depend on the boundary, because they only use
        X_{t−L_j+1} … X_t. The slice is empty if the filter at level j is longer than the signal.
    levels, samples : int
        Number of levels J, and length N of the signal.
    boundary : "periodic" or "reflection"
        Extension of the signal beyond its ends.
    """

    @property
    def interior(self) -> dict[int, slice]:
        """For each level, the slice of the coefficients that do not depend on the boundary."""
        return {j: slice(min(self.filter.width(j) - 1, self.samples), self.samples) for j in self.details}

    def inverse(self) -> Vector:
        """Reconstruct the signal (N,), up to rounding errors."""
        scaling, wavelet = _maximal_overlap(self.filter)
        values = self.smooth
        for j in range(self.levels, 0, -1):
            values = _core.pyramid_unstep(values, self.details[j], scaling, wavelet, 1 << (j - 1))
        return values[: self.samples].copy()


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Dwt(_Transform):
    """Orthonormal discrete wavelet transform of a signal, with as many coefficients as samples.

    Level j halves the scaling coefficients of level j − 1. If their number is odd, the last one is stored in `extras`.
    The signal can therefore have any length without padding, energy is preserved, and coefficient n of level j ends at
    sample 2^j (n + 1) − 1.

    Attributes
    ----------
    filter : WaveletFilter
        The wavelet filter.
    details : mapping of level j to array
        Wavelet coefficients n = 0, 1, …, which are 2^(j/2) times the maximal-overlap coefficients at t = 2^j (n + 1) −
        1. Level j has floor(N / 2^j) coefficients, or floor(2N / 2^j) with reflection.
    smooth : array
        Scaling coefficients of the last level.
    extras : mapping of level j to float
        Last scaling coefficient of level j − 1, if the number of scaling coefficients at that level is odd.
    interior : mapping of level j to slice
        Positions of the coefficients that do not depend on the boundary, because they only use X_{t−L_j+1} … X_t. The
        slice can be empty.
    levels, samples : int
        Number of levels J, and length N of the signal.
    boundary : "periodic" or "reflection"
        Extension of the signal beyond its ends.
    """

    extras: Mapping[int, float]

    @property
    def interior(self) -> dict[int, slice]:
        """For each level, the slice of the coefficients that do not depend on the boundary."""
        ends = {j: self.samples >> j for j in self.details}
        return {j: slice(min(_first_interior(self.filter, j), end), end) for j, end in ends.items()}

    def inverse(self) -> Vector:
        """Reconstruct the signal (N,), up to rounding errors."""
        values = self.smooth
        for j in range(self.levels, 0, -1):
            values = _undecimate(values, self.details[j], self.filter)
            if j in self.extras:
                values = np.append(values, self.extras[j])
        return values[: self.samples].copy()


def modwt(
    x: Signal | ArrayLike, filter: str | WaveletFilter = "haar", levels: int | None = None,
    boundary: Boundary = "periodic",
) -> Modwt:  # fmt: skip
    """Compute the maximal-overlap discrete wavelet transform of a signal of any length.

    With V_0 = X and the wavelet filter h, W_{j,t} = Σ_l h_l V_{j−1, t−2^(j−1)l} / √2. V_{j,t} is the same sum with the
    scaling filter g. Indices are modulo N. Energy is preserved: Σ X² = Σ_j Σ_t W_{j,t}² + Σ_t V_{J,t}². With reflection
    the signal is extended by its mirror image to 2N samples, and each level has 2N coefficients.

    Parameters
    ----------
    x : Signal, or (N,) array in any unit
        Finite samples.
    filter : str
        Wavelet filter, see `gmwm.filters.find_filter`.
    levels : int, optional
        Number of levels J, at most and by default floor(log2 N).
    boundary : "periodic" or "reflection"
        Extension of the signal beyond its ends.

    Raises
    ------
    DataError
        If `x` has NaN or infinities, gaps, or fewer than 2 samples.
    OptionError
        If an option has an invalid value.

    References
    ----------
    Percival and Walden (2000), Wavelet Methods for Time Series Analysis, chapter 5.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.arange(10.0) ** 2
    >>> transform = modwt(x, "d4", levels=2)
    >>> transform.details[1][transform.interior[1]].round(3)
    array([-0.866, -0.866, -0.866, -0.866, -0.866, -0.866, -0.866])
    >>> bool(np.allclose(transform.inverse(), x))
    True
    """
    values, wavelet_filter, count = _check(x, filter, levels, boundary)
    scaling, wavelet = _maximal_overlap(wavelet_filter)
    smooth, details = _extend(values, boundary), {}
    for j in range(1, count + 1):
        smooth, details[j] = _core.pyramid_step(smooth, scaling, wavelet, 1 << (j - 1))
    return Modwt(filter=wavelet_filter, details=details, smooth=smooth, samples=values.size, boundary=boundary)


def dwt(
    x: Signal | ArrayLike, filter: str | WaveletFilter = "haar", levels: int | None = None,
    boundary: Boundary = "periodic",
) -> Dwt:  # fmt: skip
    """Compute the discrete wavelet transform of a signal of any length.

    With V_0 = X and the wavelet filter h, W_{j,n} = Σ_l h_l V_{j−1, 2n+1−l}. V_{j,n} is the same sum with the scaling
    filter g. Indices are modulo the number of coefficients V_{j−1}. If this number is odd, the last coefficient is
    stored separately. Energy is preserved. With reflection the signal is extended by its mirror image to 2N samples.

    Parameters
    ----------
    x, filter, levels, boundary
        The same as for `modwt`.

    Raises
    ------
    DataError, OptionError
        The same as for `modwt`.

    References
    ----------
    Percival and Walden (2000), Wavelet Methods for Time Series Analysis, chapter 4.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.arange(10.0) ** 2
    >>> transform = dwt(x, "haar")
    >>> [len(transform.details[j]) for j in (1, 2, 3)], transform.extras
    ([5, 2, 1], {2: 102.5...})
    >>> bool(np.allclose(transform.inverse(), x))
    True
    """
    values, wavelet_filter, count = _check(x, filter, levels, boundary)
    smooth, details, extras = _extend(values, boundary), {}, {}
    for j in range(1, count + 1):
        if smooth.size % 2:
            extras[j] = float(smooth[-1])
            smooth = smooth[:-1]
        smooth, details[j] = _decimate(smooth, wavelet_filter)
    return Dwt(
        filter=wavelet_filter, details=details, smooth=smooth, extras=extras, samples=values.size, boundary=boundary
    )


def _check(
    x: Signal | ArrayLike, filter: str | WaveletFilter, levels: int | None, boundary: Boundary
) -> tuple[Vector, WaveletFilter, int]:
    values = x.fill_gaps().whole() if isinstance(x, Signal) else as_vector(x, "x", at_least=2)
    one_of(boundary, "boundary", ("periodic", "reflection"))
    deepest = values.size.bit_length() - 1
    return values, find_filter(filter), as_level_count(levels, deepest, values.size)


def as_level_count(levels: int | None, deepest: int, samples: int) -> int:
    """Check a number of levels, from 1 to the deepest level; None means the deepest level."""
    expected = f"an integer from 1 to {deepest} for {samples} samples"
    return deepest if levels is None else as_whole_number(levels, "levels", 1, deepest, expected=expected)


def _extend(values: Vector, boundary: Boundary) -> Vector:
    return np.concatenate([values, values[::-1]]) if boundary == "reflection" else values


def _maximal_overlap(filter: WaveletFilter) -> tuple[Vector, Vector]:
    return filter.scaling / np.sqrt(2.0), filter.wavelet / np.sqrt(2.0)


def _decimate(values: Vector, filter: WaveletFilter) -> tuple[Vector, Vector]:
    """Compute the next level, Σ_l f_l V_{2n+1−l} with f = g and h, and indices modulo the even length."""
    half = values.size // 2
    smooth, detail = np.zeros(half), np.zeros(half)
    for l, (g, h) in enumerate(zip(filter.scaling, filter.wavelet, strict=True)):  # noqa: E741
        turned = _at_parity(values, l)
        smooth += g * turned
        detail += h * turned
    return smooth, detail


def _undecimate(smooth: Vector, detail: Vector, filter: WaveletFilter) -> Vector:
    """Invert `_decimate`, whose matrix is orthonormal, by the transposed matrix."""
    values = np.zeros(2 * smooth.size)
    for l, (g, h) in enumerate(zip(filter.scaling, filter.wavelet, strict=True)):  # noqa: E741
        first = (1 - l) % 2
        values[first::2] += np.roll(g * smooth + h * detail, -((l - 1 + first) // 2))
    return values


def _at_parity(values: Vector, l: int) -> Vector:  # noqa: E741
    """Return V_{2n+1−l} for n = 0, 1, …, with indices modulo the length of V."""
    first = (1 - l) % 2
    return np.roll(values[first::2], (l - 1 + first) // 2)


Transform = Literal["modwt", "dwt"]  # kind of transform: maximal-overlap ("modwt") or decimated ("dwt")


def _first_interior(filter: WaveletFilter, level: int) -> int:
    """Return the smallest index n with 2^j (n + 1) ≥ L_j; this decimated coefficient is free of the boundary."""
    return -(-filter.width(level) >> level) - 1


def coefficient_counts(
    samples: int | Integers, levels: Integers, filter: WaveletFilter, transform: Transform
) -> Integers:
    """Return M_j = N − L_j + 1, the inner coefficients, or every 2^j-th if decimated; ≤ 0 if none."""
    if transform == "modwt":
        return np.asarray(samples - filter.widths(levels) + 1, dtype=np.int64)
    first = np.array([_first_interior(filter, int(j)) for j in levels], dtype=np.int64)
    return np.asarray((samples >> levels) - first, dtype=np.int64)


def pooled_counts(
    lengths: Sequence[int], levels: Integers, filter: WaveletFilter, transform: Transform
) -> tuple[Integers, Vector]:
    """Return M_j = Σ_s M_sj and the edf M_j² / Σ_s (M_sj² / η_sj), η_sj ≥ 1, above M_j / 2^j for many short ones."""
    sizes, times = np.unique(np.asarray(lengths, dtype=np.int64), return_counts=True)
    segment_counts = np.maximum(coefficient_counts(sizes[:, None], levels, filter, transform), 0)
    counts = np.asarray(times @ segment_counts, dtype=np.int64)
    if sizes.size == 1 and times[0] == 1:
        return counts, degrees_of_freedom(counts, levels, transform)
    spread = times @ (segment_counts.astype(np.float64) ** 2 / degrees_of_freedom(segment_counts, levels, transform))
    return counts, np.asarray(counts.astype(np.float64) ** 2 / np.where(counts > 0, spread, 1.0))


def deepest_level(samples: int, filter: WaveletFilter, transform: Transform) -> int:
    """Return the deepest level with a coefficient that only uses samples of the recording; 0 if there is none."""
    level = filter.deepest_level(samples)
    if transform == "dwt":
        while level > 0 and coefficient_counts(samples, np.array([level]), filter, transform)[0] < 1:
            level -= 1
    return level


def degrees_of_freedom(counts: Integers, levels: Integers, transform: Transform) -> Vector:
    """Compute the edf max(M_j / 2^j, 1), or M_j if decimated (Percival 1995); the level −l of a lag counts as 1."""
    return np.maximum(counts / (1.0 if transform == "dwt" else np.ldexp(1.0, np.maximum(levels, 1))), 1.0)


def loss_factor(filled: int, samples: int) -> float:
    """Return the factor 1 + 2.5 p of the covariance for a share p of filled samples: scatter, no information."""
    return 1.0 + 2.5 * filled / samples


def variances(values: Vector, filter: WaveletFilter, transform: Transform, levels: int) -> Vector:
    """Compute the wavelet variances of levels 1 … J: the mean squares of `inner_coefficients`."""
    if transform == "modwt":
        return _core.pyramid_variance(values, *_maximal_overlap(filter), levels)
    return np.array([np.mean(w**2) for w in inner_coefficients(values, filter, transform, levels)])


def inner_coefficients(values: Vector, filter: WaveletFilter, transform: Transform, levels: int) -> list[Vector]:
    """Return the coefficients of levels 1 … J without boundary; decimated ones are scaled by 2^(−j/2) to the others."""
    centred = values - _core.mean(values)
    coefficients = modwt(centred, filter, levels) if transform == "modwt" else dwt(centred, filter, levels)
    inside = coefficients.interior
    size = {j: 1.0 if transform == "modwt" else 2 ** (-j / 2) for j in inside}
    return [size[j] * coefficients.details[j][inside[j]] for j in inside]
