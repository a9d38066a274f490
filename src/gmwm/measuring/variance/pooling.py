"""Pool the wavelet variances of several recordings of one unit into one curve."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector
from gmwm.base.errors import DataError
from gmwm.measuring.axis_results import chi_square_limits
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.measuring.variance.transform import pooled_counts
from gmwm.theory.filters import find_filter

Number = TypeVar("Number", np.float64, np.int64)
SAME_RATE_DIFFERENCE = 1e-3
"""Largest relative difference of rates: clocks differ by 1e-5, and 1e-3 changes the wavelet variance by ≤ 0.3 %."""


def pool(curves: Mapping[str, WaveletVariance]) -> WaveletVariance:
    """Pool recordings of one unit like segments, ν̂_j² = Σ_r M_rj ν̂_rj² / Σ_r M_rj, in attribute `recordings`."""
    names, items = list(curves), list(curves.values())
    first = items[0]
    if len(items) == 1:
        return first
    _require_alike(curves)
    lengths = tuple(n for wv in items for n in (wv.segments or (wv.samples,)))
    levels = max(items, key=len).levels[: _reach(items)]
    total, _ = pooled_counts(lengths, levels, find_filter(first.filter), first.transform)
    shares = [_counts(wv, levels) / total for wv in items]
    samples = sum(wv.samples for wv in items)
    rate = sum(wv.samples * wv.rate for wv in items) / samples
    curve = replace(
        first,
        levels=levels.copy(),
        variance=np.sum([_pad(share * _pad(wv.variance, levels.size), levels.size)
                         for wv, share in zip(items, shares, strict=True)], axis=0),
        counts=np.sum([_pad(wv.counts, levels.size) for wv in items], axis=0),
        lower=np.zeros(levels.size),
        upper=np.zeros(levels.size),
        rate=rate,
        samples=samples,
        axis=first.axis if len({wv.axis for wv in items}) == 1 else "",
        segments=lengths,
        filled=sum(wv.filled for wv in items),
        strides=_strides(items, levels.size),
        slope=_mean([wv.slope for wv in items], items),
        rise=_mean([wv.rise for wv in items], items),
        excess=_excess(items, shares),
        diagnostics={},
        regression=None,
        recordings={name: replace(wv, rate=rate) for name, wv in zip(names, items, strict=True)},
    )  # fmt: skip
    lower, upper = chi_square_limits(curve.variance, curve.degrees_of_freedom, first.confidence)
    return replace(curve, lower=lower, upper=upper)


def without(wv: WaveletVariance, name: str) -> WaveletVariance:
    """Return the pooled curve of all recordings except one, with at most as many levels as the pooled curve of all."""
    others = pool({other: curve for other, curve in wv.recordings.items() if other != name})
    return others.first(min(len(others), len(wv)))


def _require_alike(curves: Mapping[str, WaveletVariance]) -> None:
    (first, curve), *others = curves.items()
    for name, other in others:
        for what, value, other_value in (
            ("unit", curve.unit or "none", other.unit or "none"),
            ("filter", curve.filter, other.filter),
            ("transform", curve.transform, other.transform),
            ("estimator", _estimator(curve), _estimator(other)),
        ):
            if value != other_value:
                raise _differ(what, f"{value} in recording {first}", f"{other_value} in recording {name}")
        if abs(other.rate / curve.rate - 1) > SAME_RATE_DIFFERENCE:
            rates = f"{curve.rate:g} Hz in recording {first}", f"{other.rate:g} Hz in recording {name}"
            raise _differ("sampling rate", *rates)


def _estimator(wv: WaveletVariance) -> str:
    return f"robust with efficiency {wv.efficiency:g}" if wv.robust else "classical"


def _differ(what: str, value: str, other: str) -> DataError:
    return DataError(
        f"the recordings differ in their {what}: {value}, {other}", argument="data",
        advice="Use each recording by itself.",
    )  # fmt: skip


def _reach(items: list[WaveletVariance]) -> int:
    """Return the number of pooled levels: the longest curve's, up to one that another lacks (e.g. by a regression), as
    a covariance of segments needs all long enough ones."""
    levels = max(items, key=len).levels
    reach = levels.size
    for wv in items:
        if len(wv) < reach and _counts(wv, levels)[len(wv)] > 0:
            reach = len(wv)
    return reach


def _counts(wv: WaveletVariance, levels: NDArray[np.int64]) -> Vector:
    """Return the number of coefficients (J,) that the length of a recording allows at each level."""
    counts, _ = pooled_counts(wv.segments or (wv.samples,), levels, find_filter(wv.filter), wv.transform)
    return np.asarray(counts, dtype=np.float64)


def _pad(values: NDArray[Number], levels: int) -> NDArray[Number]:
    """Return the values of the first levels, with zeros for levels that a recording does not have."""
    return np.concatenate([values, np.zeros(levels, dtype=values.dtype)])[:levels]


def _strides(items: list[WaveletVariance], levels: int) -> tuple[int, ...]:
    """Return, for each level, the largest distance between coefficients in any recording."""
    if not any(wv.strides for wv in items):
        return ()
    every = [np.concatenate([np.array(wv.strides, dtype=np.int64), np.ones(levels, dtype=np.int64)])[:levels]
             for wv in items]  # fmt: skip
    return tuple(np.max(every, axis=0).tolist())


def _mean(values: list[float | None], items: list[WaveletVariance]) -> float | None:
    """Return the mean over the recordings, weighted by their lengths; None if a recording has no value."""
    defined = [value for value in values if value is not None]
    if len(defined) < len(values):
        return None
    return float(np.average(defined, weights=[wv.samples for wv in items]))


def _excess(items: list[WaveletVariance], shares: list[Vector]) -> Matrix | None:
    """Return the `excess` of the pooled curve; a recording without `excess` counts as zero."""
    if all(wv.excess is None for wv in items):
        return None
    size = shares[0].size
    total = np.zeros((size, size))
    for wv, share in zip(items, shares, strict=True):
        if wv.excess is not None:
            reach = min(len(wv), size)
            total[:reach, :reach] += wv.excess[:reach, :reach] * np.outer(share, share)[:reach, :reach]
    return total
