"""Find isolated wrong samples (spikes), and replace them by samples predicted from the others (`gaps.drawing`).

Distances from the median of neighbours beyond θ (local standard deviations) are spikes if many more than a t
distribution explains, hardly more exceed θ / 1.5, and the next samples are normal."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from gmwm.base import _core
from gmwm.base.arrays import FrozenArrays, Vector, freeze, row_medians
from gmwm.base.errors import DataError, OptionError
from gmwm.base.threads import computed_once
from gmwm.measuring.outliers.bursts import NEIGHBOURHOOD
from gmwm.measuring.variance.biweight import NORMAL_QUARTILE
from gmwm.recording.gaps import drawn
from gmwm.recording.resolution import lsb
from gmwm.recording.signals import Signal

APART = 1.5
"""θ over a lower threshold; few residuals are between them. Rates of decisions: docs/validation/tails.md (all here)."""
MORE = 1.6  # largest ratio of residuals beyond θ / 1.5 to beyond θ; it is 2.25 for a tail with infinite variance
CERTAIN = 1e-6  # largest probability, under the bulk, of the number of residuals beyond θ
FALSE = 0.1  # largest expected share of correct samples beyond θ; as many residuals, chosen at random, are kept
LEAST = 4.0  # smallest threshold, in local standard deviations
MOST = 0.1  # largest share of spikes among the samples
RUN = 3
"""Largest number of neighbouring samples that can all be spikes. An encoder error, for example, changes two rates."""
CROWD, NEAR = 6, 10
"""Largest number of spikes within `NEAR` samples on either side; more spikes form a cluster, which is a knock."""
CLEAR = 100  # distance (samples) from a cluster within which no sample is treated as a spike
_REACHES = (3, 12)
"""Numbers of neighbours on each side: the nearest predict best behind a low-pass filter, many in white noise."""
_FEW = 12  # number of spikes below which no residual may be between θ / 2 and θ
_POWER_LAW = 1.25
"""Largest exponent of a power law of sizes below which smaller ones are more frequent. It is 1 for a Cauchy
distribution, and 1.5 for Gaussian sizes of 8 standard deviations (tests/outliers/test_spikes.py)."""
_BULK = 50_000  # number of residuals from which the spread and the tails of the bulk are estimated
_PRECISE = 500_000
"""The same number for a recording with spikes: 0.3 % of samples at 6 standard deviations add 10 % to the variance."""
_BIN, _NONE = 0.25, 0.005
_PASSES, _SETTLED = 5, 0.01
"""Largest number of repetitions of the search, and relative change of the number of spikes at which they end."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Spikes(FrozenArrays):
    """Isolated wrong samples: indices, residuals (local standard deviations), and Σ x² of those not found (`left`)."""

    indices: NDArray[np.int64]
    deviations: Vector
    left: float = 0.0

    def __len__(self) -> int:
        return int(self.indices.size)

    @property
    def largest(self) -> float:
        """Largest deviation; 0 if there are no spikes."""
        return float(np.max(self.deviations, initial=0.0))


def find_spikes(x: Signal) -> Spikes:
    """Find isolated samples of a signal that are certainly wrong, because the tails of its noise do not explain them.

    Parameters
    ----------
    x : Signal

    Raises
    ------
    OptionError
        If `x` is not a Signal.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=20_000)
    >>> x[::400] += 12.0
    >>> spikes = find_spikes(Signal(x, rate=100.0))
    >>> len(spikes), spikes.indices[:3].tolist()
    (50, [0, 400, 800])
    """
    if not isinstance(x, Signal):
        raise OptionError(argument="x", expected="a Signal", got=x)
    return spikes_beside(x, lsb(x.values) or 0.0)


def spikes_beside(x: Signal, step: float) -> Spikes:
    """Return the result of `find_spikes` for a signal with a known quantization step, or 0."""
    values = x.values
    none = Spikes(indices=np.empty(0, dtype=np.int64), deviations=np.empty(0))
    if values.size < 4 * _REACHES[-1]:
        return none
    scale, length, tail, _ = _bulk(values, x.rate, step, most=_BULK, right=None, reach=_REACHES[0])
    if not scale.min() > 0:
        return none
    # A spike differs from the mean of its two neighbours by its size, or by half of its size next to another spike. The
    # middle one of three equal spikes does not differ from its neighbours, so they are candidates too.
    candidates = _core.bent_samples(values, 0.5 * LEAST * scale, length)
    deviation = np.abs(_core.neighbour_residuals(values, values, candidates, _REACHES[0]))
    deviation /= _at(candidates, scale, length)
    threshold = _threshold(deviation, values.size, tail)
    spikes = candidates[deviation >= threshold]
    if not 0 < spikes.size <= MOST * values.size:
        return none
    # Repeat without the spikes, which shift medians, hide the middle of a pulse, and add to the tails.
    for _ in range(_PASSES):
        filled, right = _interpolate(values, spikes)
        marked = np.zeros(values.size, dtype=np.bool_)
        marked[candidates] = marked[_core.bent_samples(filled, 0.5 * LEAST * scale, length)] = True
        candidates = np.flatnonzero(marked)
        reach = _best_reach(filled, right)
        scale, length, tail, usual = _bulk(filled, x.rate, step, most=_PRECISE, right=right, reach=reach)
        if not scale.min() > 0:
            return none
        limit = _at(candidates, scale, length)
        deviations = np.abs(_core.neighbour_residuals(values, filled, candidates, reach)) / limit
        threshold = _threshold(deviations, values.size, tail, FALSE)
        clear = np.flatnonzero(_clear(candidates, _in_crowds(candidates[deviations >= threshold], values.size)))
        spiky = clear[_surplus(deviations[clear], threshold, values.size, usual)]
        before, spikes, deviation, limit = spikes.size, candidates[spiky], deviations[spiky], limit[spiky]
        if abs(spikes.size - before) <= _SETTLED * before:
            break
    isolated = _returns(values, filled, spikes, np.minimum(threshold, deviation) * limit)
    left = _squares_left(deviation[isolated], limit[isolated], _smallest_certain(spikes.size, values.size, usual))
    return Spikes(indices=spikes[isolated], deviations=deviation[isolated], left=left)


def repaired(x: Signal, spikes: Spikes) -> Signal:
    """Replace spikes by samples drawn from their conditional distribution given all other samples, with a fixed seed.

    Without spikes, `x` itself is returned.

    Parameters
    ----------
    x : Signal
    spikes : Spikes
        Result of `find_spikes`.

    Raises
    ------
    DataError
        If a spike is beyond the end of the signal.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=20_000)
    >>> x[::400] += 12.0
    >>> signal = Signal(x, rate=100.0)
    >>> clean = repaired(signal, find_spikes(signal))
    >>> f"{x.std():.1f}, {clean.values.std():.1f}"
    '1.2, 1.0'
    """
    if not len(spikes):
        return x
    if spikes.indices.max() >= len(x):
        raise DataError(argument="spikes", expected="spikes of this signal", got=int(spikes.indices.max()))
    right = np.ones(len(x), dtype=np.bool_)
    right[spikes.indices] = False
    return replace(x, values=drawn(x.values, right))


def _best_reach(values: Vector, right: NDArray[np.bool_]) -> int:
    """Return the number of neighbours on each side whose median predicts a sample best."""
    places, _ = _sample_places(values.size, _BULK)
    places = places[right[places]]
    errors = [np.median(np.abs(_core.neighbour_residuals(values, values, places, reach))) for reach in _REACHES]
    return _REACHES[int(np.argmin(errors))]


@computed_once(2)
def _sample_places(samples: int, most: int) -> tuple[NDArray[np.int64], int]:
    """Return positions at a regular distance (stride), about `most` of them, and this distance."""
    stride = max(1, samples // most)
    # Vary the offset within each stride, so that a period of the signal is not sampled at one phase.
    places = np.arange(0, samples - stride + 1, stride)
    return freeze(places + (places // stride * 7919) % stride), stride


def _bulk(
    values: Vector, rate: float, step: float, *, most: int, right: NDArray[np.bool_] | None, reach: int
) -> tuple[Vector, int, float, float]:
    """Return the local spread of residuals by block, the block length, and a lower limit and an estimate of the tails'
    degrees of freedom. About `most` residuals are used, for the tails of samples that are `right`."""
    places, stride = _sample_places(values.size, most)
    residual = _core.neighbour_residuals(values, values, places, reach)
    # Quantiles of rounded values would not show tails; a triangular dither of two steps makes a density.
    residual = np.abs(residual + step * _dither(residual.size))
    piece = min(max(round(NEIGHBOURHOOD * rate / stride), 128), residual.size)
    count = residual.size // piece
    local = row_medians(residual[: count * piece].reshape(count, piece)) / NORMAL_QUARTILE
    local = np.maximum(local, np.median(local))
    relative = residual[: count * piece] / np.repeat(np.maximum(local, np.finfo(np.float64).tiny), piece)
    local = np.sqrt(np.maximum(local**2 - step**2 / 6, step**2 / 12))
    if not local.min() > 0:
        return local, values.size, np.inf, np.inf
    if right is not None:
        relative = relative[right[places[: count * piece]]]
    return local, piece * stride, *_freedom(relative)


@computed_once(2)
def _dither(size: int) -> Vector:
    """Return random numbers of a triangular distribution from −1 to 1, the same for all axes."""
    return freeze(np.random.default_rng(0).triangular(-1.0, 0.0, 1.0, size))


def _at(places: NDArray[np.int64], scale: Vector, length: int) -> Vector:
    """Return the standard deviation at some positions, from that of each block; the last one has the remainder."""
    return np.asarray(scale[np.minimum(places // length, scale.size - 1)])


def _freedom(relative: Vector) -> tuple[float, float]:
    """Return the t distribution's freedom at which the ratio of the 90 % quantile to the median of absolute values is
    three standard errors above the measured one, and at the measured one."""
    from scipy.special import stdtrit

    grid = np.geomspace(1.0, 1000.0, 200)
    expected = stdtrit(grid, 0.95) / stdtrit(grid, 0.75)
    error = 1.5 / np.sqrt(relative.size)  # of the ratio; 1.2 for independent residuals of Gaussian noise
    middle, high = np.quantile(relative, [0.5, 0.9])
    ratio = float(high / middle) if middle > 0 else np.inf
    least, likely = np.interp([-ratio * (1 + 3.0 * error), -ratio], -expected, grid).tolist()
    return least, likely


def _threshold(deviation: Vector, samples: int, freedom: float, false: float = 1.0) -> float:
    """Return the smallest θ beyond which at most the share `false` may be correct; infinity without spikes."""
    # Not from scipy.stats, whose import takes as long as the search for spikes on six axes.
    from scipy.special import bdtrc, ndtr, pdtrc

    ordered = np.sort(deviation[deviation >= LEAST / 2])[::-1]
    ks = np.arange(1, np.count_nonzero(ordered >= LEAST) + 1)
    if not ks.size:
        return np.inf
    theta = ordered[ks - 1]
    beyond = np.searchsorted(-ordered, -theta / APART, side="right")
    double = np.searchsorted(-ordered, -theta / 2, side="right")
    expected = samples * _beyond(theta, freedom)
    # Residuals that Gaussian noise explains are not counted, because small spikes are among its tails.
    gaussian = np.minimum(samples * 2 * ndtr(-theta / APART), beyond - ks)
    good = (pdtrc(ks - 1, expected) <= CERTAIN) & (expected <= false * ks) & (beyond - gaussian <= MORE * ks)
    good &= np.where(ks < _FEW, double == ks, bdtrc(ks - 1, beyond - gaussian.astype(np.int64), APART**-3.0) <= CERTAIN)
    return float(theta[good][-1]) if np.any(good) else np.inf


def _beyond(deviation: Vector, freedom: float) -> Vector:
    """Return the probability that a residual of the bulk exceeds each of the deviations."""
    from scipy.special import stdtr, stdtrit

    return np.asarray(2 * stdtr(freedom, -deviation * (stdtrit(freedom, 0.75) / NORMAL_QUARTILE)))


def _surplus(deviation: Vector, threshold: float, samples: int, freedom: float) -> NDArray[np.bool_]:
    """Select residuals beyond the bulk, at random (fixed seed), so that the number of the others agrees with it: near
    the threshold, spikes resemble its tails. In each bin as many as exceed the bulk are chosen, far beyond all. Bins
    below the threshold follow until one has no clear surplus."""
    chosen = np.zeros(deviation.size, dtype=np.bool_)
    if not np.isfinite(threshold) or not deviation.size:
        return chosen
    from scipy.special import stdtrit

    rng, high = np.random.default_rng(0), np.inf
    # Beyond this deviation, the bulk has no residual, or there is none at all.
    scale = NORMAL_QUARTILE / stdtrit(freedom, 0.75)
    end = min(-float(stdtrit(freedom, _NONE / (2 * samples))) * scale, float(np.max(deviation)) + _BIN)
    low = threshold + _BIN * math.ceil(max(end - threshold, 0.0) / _BIN)
    # the smallest residual that can be replaced
    while low >= 3.0:
        here = np.flatnonzero((deviation >= low) & (deviation < high))
        expected = samples * float(np.subtract(*_beyond(np.array([low, high]), freedom)))
        surplus = here.size - expected
        if np.isinf(high) or surplus > 2 * np.sqrt(expected) + 1:
            chosen[rng.permutation(here)[: round(surplus)]] = True
        elif low < threshold or low == high:  # equal where a bin is below the resolution of the deviations
            break
        next_low = max(threshold, float(np.max(deviation[deviation < low], initial=0.0)))
        low, high = low - _BIN * max(math.floor((low - next_low) / _BIN), 1), low
        high = min(high, low + _BIN)
    return chosen


def _smallest_certain(count: int, samples: int, freedom: float) -> float:
    """Return the deviation beyond which the share `FALSE` of `count` residuals is expected from the bulk."""
    grid = np.arange(LEAST, 50.0, _BIN / 5)
    return float(grid[np.argmax(samples * _beyond(grid, freedom) <= FALSE * count)])


def _squares_left(deviation: Vector, limit: Vector, certain: float) -> float:
    """Return Σ x² of wrong samples too small to be found, from the `deviation` of the others (unit `limit`).

    Their density above the smallest, or just beyond `certain`, continues below: constant, or linear to zero if it falls
    by three standard errors (similar sizes, hidden by the noise), or by a power law like Cauchy's (Hill 1975)."""
    if deviation.size < _FEW:
        return 0.0
    least = min(float(np.min(deviation)), APART * certain)
    width = (APART - 1) / 2 * least
    near, far = (int(count) for count in np.histogram(deviation, least + width * np.arange(3))[0])
    exponent = 1 / float(np.mean(np.log(np.maximum(deviation / least, 1.0 + 1e-9))))
    flatness = 2 - exponent if exponent < _POWER_LAW else 3.0
    squares = (near + far) / (2 * width) * least**3 / flatness
    rise = (far - near - 3 * math.sqrt(far + near)) / width**2
    if rise > 0:
        edge = max(near / width - rise * width / 2, 0.0)
        below = min(edge / rise, least)
        squares = min((edge - rise * below / 2) * below * float(np.mean(deviation**2)), squares)
    return squares * float(np.mean(limit**2))


def _in_crowds(at: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
    """Return those of the ascending positions that are in a cluster or in a long run."""
    from scipy.special import bdtrc

    if not at.size:
        return at
    # Clusters and runs up to these sizes can occur by chance: larger ones occur in one of a hundred recordings.
    share, rare = at.size / samples, 0.01 / at.size
    crowd = max(CROWD, int(np.argmax(bdtrc(np.arange(2 * NEAR + 1), 2 * NEAR, share) <= rare)))
    run = max(RUN, int(np.ceil(np.log(rare) / np.log(share))))
    near = np.searchsorted(at, at + NEAR, side="right") - np.searchsorted(at, at - NEAR) - 1
    begins = np.concatenate([[0], np.flatnonzero(np.diff(at) > 1) + 1])
    lengths = np.diff(np.append(begins, at.size))
    return at[(near > crowd) | (np.repeat(lengths, lengths) > run)]


def _clear(at: NDArray[np.int64], crowded: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return a mask of the positions that are far from every cluster."""
    close = np.searchsorted(crowded, at + CLEAR, side="right") > np.searchsorted(crowded, at - CLEAR)
    return np.asarray(~close)


def _returns(values: Vector, filled: Vector, at: NDArray[np.int64], limit: Vector) -> NDArray[np.bool_]:
    """Return whether the signal returns after each position. A step differs from the samples before it only."""
    last = values.size - 1
    steps = np.arange(1, 6)
    before = np.median(filled[np.maximum(at[:, None] - steps, 0)], axis=1)
    after = np.median(filled[np.minimum(at[:, None] + steps, last)], axis=1)
    apart = np.minimum(np.abs(values[at] - before), np.abs(values[at] - after))
    return np.asarray(apart > 0.5 * limit)


def _interpolate(values: Vector, at: NDArray[np.int64]) -> tuple[Vector, NDArray[np.bool_]]:
    """Interpolate the values at some ascending positions from all others. Return also a mask of the others."""
    good = np.ones(values.size, dtype=np.bool_)
    good[at] = False
    filled = values.copy()
    # The nearest other sample on each side of a run of positions; at an end of the signal, the one on its other side.
    begins = np.flatnonzero(np.diff(at, prepend=-2) > 1)
    sizes = np.diff(np.append(begins, at.size))
    before, after = at[begins] - 1, at[begins] + sizes
    before, after = np.where(before < 0, after, before), np.where(after == values.size, before, after)
    slope = (values[after] - values[before]) / np.maximum(after - before, 1)
    filled[at] = np.repeat(slope, sizes) * (at - np.repeat(before, sizes)) + np.repeat(values[before], sizes)
    return filled, good
