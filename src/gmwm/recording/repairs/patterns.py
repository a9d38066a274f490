"""Recognise patterns in values: words that overflowed, which are undone; resampling by straight lines; and noise that
switches between two levels (popcorn noise, random telegraph noise)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from gmwm.base.arrays import Matrix, Vector, row_medians
from gmwm.base.remarks import Remark
from gmwm.recording.repairs.repeats import Mask
from gmwm.recording.resolution import lsb

_BITS = range(8, 33)  # lengths of words (bits)
_REACH = 0.025  # largest distance of a value from the end of the word, as a share of the range of the word
_UNLIKELY = 1e-6  # largest probability that values at random distances all look like wrapped ones
_GAP = 10.0
"""Distance of values around the end over the expected one, exponential if continuous: exceeded with p = 5e-5."""
_CONTINUOUS = 8.0
"""Largest median change at a wrap over that of neighbours (tests/recording/test_repairs.py)."""


def modulus_of(values: Vector) -> tuple[float, float] | None:
    """Return the range 2^b (unit of the axis) of a word that wrapped, and the median of the more frequent side, or
    None. Values are at both ends of the word, and moved by 2^b they continue without gap or overlap, unlike wrong
    samples."""
    lowest, highest = float(np.min(values)), float(np.max(values))
    reach = 2 * _REACH * (highest - lowest)
    if np.any((values[:_FEWEST] > lowest + reach) & (values[:_FEWEST] < highest - reach)):
        return None
    upper = values > (lowest + highest) / 2
    rare = upper if np.mean(upper) <= 0.5 else ~upper
    far, near = values[rare], values[~rare]
    if far.size < 2 or max(np.ptp(far), np.ptp(near)) > reach:
        return None
    step = lsb(near)
    if step is None:
        return None
    bits = math.floor(math.log2((highest - lowest) / step + 0.5)) + 1  # the range is at most 2^b − 1 steps
    modulus = math.ldexp(step, bits)
    above = bool(far[0] > near[0])
    depth = near.min() - (far - modulus) if above else far + modulus - near.max()
    gap, reach = float(np.min(depth)), float(np.max(depth))
    visits = int(np.count_nonzero(np.diff(rare) & rare[1:])) + bool(rare[0])
    excess = float(np.mean(depth)) - gap
    if (
        bits not in _BITS
        or reach > _REACH * modulus
        or (2 * reach / modulus) ** min(far.size, 100) > _UNLIKELY
        or gap > 1.5 * step + _GAP * excess / visits
    ):
        return None
    changes = np.abs(np.diff(unwrapped(values, modulus, middle := float(np.median(near)))))
    jumps = float(np.median(changes[np.diff(rare)]))
    return (modulus, middle) if jumps <= _CONTINUOUS * float(np.median(changes)) + 2 * step else None


def unwrapped(values: Vector, modulus: float, middle: float) -> Vector:
    """Return values that are at most half a range away from the middle."""
    turns = np.rint((values - middle) / modulus)
    return np.asarray(np.where(turns == 0, values, values - turns * modulus))


_MOST, _FEWEST = 1 << 17, 4096  # largest and smallest number of samples that are used
_LINE, _PEAKS = 30.0, 4
"""Height of a line in the squares' periodogram over its surroundings, in < 1 of 10⁸ of noise; and examined lines."""
_BLOCK, _PHASES, _EXACT = 256, 32, 0.05
"""Length of the blocks to which straight lines are fitted, number of phases, and largest variance of the residual at
the best phase, relative to that at the median phase and to the noise (tests/recording/test_resampled.py)."""
_RATES = (0.05, 0.95)  # smallest and largest relative rate that is recognised


def slower_rate(values: Vector) -> float:
    """Return the slower log's rate relative to this one; 0 if not resampled. Straight lines make the variance of second
    differences periodic with q < 1, and describe values without residual."""
    x = values[: _MOST + 2]  # `_MOST` second differences, a power of two, are transformed three times as fast
    if x.size < _FEWEST:
        return 0.0
    squares = np.diff(x, 2) ** 2
    squares = np.minimum(squares, 20 * np.mean(squares))
    power = np.abs(np.fft.rfft(squares - np.mean(squares))) ** 2
    size = power.size // 64
    # The mean nearby without the line is the median over ln 2.
    nearby = np.repeat(row_medians(power[: 64 * size].reshape(size, 64)), 64) / np.log(2)
    height = np.divide(power[: nearby.size], nearby, out=np.zeros(nearby.size), where=nearby > 0)
    height[:4] = 0.0
    high = np.flatnonzero(height > _LINE)
    lines = [k / squares.size for k in high[np.argsort(-height[high])][:_PEAKS].tolist()]
    shares = sorted(share for line in lines for share in (line, 1 - line) if _RATES[0] < share < _RATES[1])
    for first in (0, x.size // 2):
        fits = _are_straight(x[first : first + _BLOCK], shares)
        shares = [share for share, straight in zip(shares, fits, strict=True) if straight]
    return shares[0] if shares else 0.0


def _are_straight(block: Vector, shares: Sequence[float]) -> list[bool]:
    """Return for each of the rates `shares` whether straight lines between samples at this rate describe a block."""
    if not shares:
        return []
    # A line does not change a quantile of the density, and the slower log has the lower part of the frequencies.
    window = np.hanning(_BLOCK)
    density = np.abs(np.fft.rfft((block - block[0]) * window)) ** 2 / float(window @ window)
    noise = float(np.quantile(density, 0.8)) / np.log(5)
    variances = _residual_variances(block - block[0], np.array(shares))
    fits = np.min(variances, axis=1) < _EXACT * np.minimum(noise, np.median(variances, axis=1))
    return [bool(each) for each in fits]


def _residual_variances(block: Vector, shares: Vector) -> Matrix:
    """Return the variance that straight lines with corners at (k − phase) / share leave, for each share and phase."""
    at = np.arange(block.size)[:, None, None] * shares[:, None] + np.arange(_PHASES) / _PHASES
    corners = np.floor(at)
    # Least squares by Givens rotations, for all of them at once. A sample is on the line between two corners, so that
    # later rotations need only two rows of the triangle: their elements, and the rotated data.
    (first, beside, of_first), (second, of_second) = np.zeros((3, *at.shape[1:])), np.zeros((2, *at.shape[1:]))
    squares = np.zeros(at.shape[1:])
    for k, value in enumerate(block.tolist()):
        if k:
            new = corners[k] > corners[k - 1]
            first, of_first = np.where(new, second, first), np.where(new, of_second, of_first)
            beside, second, of_second = np.where(new, 0.0, [beside, second, of_second])
        later = at[k] - corners[k]
        first, (beside, of_first), (later, rest) = _rotate(first, 1 - later, [beside, of_first], [later, value])
        second, (of_second,), (rest,) = _rotate(second, later, [of_second], [rest])
        squares += rest**2
    return np.asarray(squares / np.maximum(block.size - corners[-1] - 2, 1))


def _rotate(
    first: Matrix, second: Matrix, row: Sequence[Matrix], other: Sequence[Matrix | float]
) -> tuple[Matrix, list[Matrix], list[Matrix]]:
    """Rotate two rows so that the first element of the `other` becomes zero; return the first element of the row, and
    the further elements of both."""
    length = np.hypot(first, second)
    cosine = np.divide(first, length, out=np.ones_like(length), where=length > 0)
    sine = np.divide(second, length, out=np.zeros_like(length), where=length > 0)
    turned = [cosine * x + sine * y for x, y in zip(row, other, strict=True)]
    return length, turned, [cosine * y - sine * x for x, y in zip(row, other, strict=True)]


_LENGTHS = (16, 64, 256, 1024)  # numbers of samples whose means are sorted into two levels
_TOGETHER = 128  # number of means from which a slow drift is subtracted together
_APART = 5.0
"""Least distance of two levels over the spread at one; Gaussian noise has 2.7 (tests/recording/test_repairs.py)."""
_SHARE = 0.005  # smallest share of the time at the rarer level
_BETWEEN = 0.5  # largest number of means in the middle third between the levels, relative to those at the rarer level
_CHANGES = 16  # smallest number of changes of the level
_PARTS = 8
"""Number of parts of the recording, in more than half of which the rarer level must occur. Otherwise the unit moved."""
_LASTS = 1.5  # smallest mean duration of the rarer level, in means. A shorter one is a wrong sample


class TwoLevels(NamedTuple):
    """Two levels of an axis: their distance, the share of time at the rarer one, and its mean duration (samples)."""

    size: float
    share: float
    duration: float


def two_levels_of(values: Vector) -> TwoLevels | None:
    """Return the two levels between which the mean of an axis switches; None if it does not."""
    for length in _LENGTHS:
        count = values.size // length
        if count < _TOGETHER:
            break
        means = values[: count * length].reshape(count, length) @ np.full(length, 1 / length)
        rows = means[: count - count % _TOGETHER].reshape(-1, _TOGETHER)
        for x in (means, (rows - row_medians(rows)[:, None]).ravel()):
            split = _split(x)
            if split is not None and (levels := _levels(x, split, length)) is not None:
                # The mean of a coarse output can only be at multiples of a step.
                return levels if levels.size > (lsb(values) or 0.0) else None
    return None


def _split(x: Vector) -> float | None:
    """Return the value between two classes of smallest inner variance (Otsu 1979); None if their means are near."""
    ordered = np.sort(x)
    n, k = x.size, np.arange(1, x.size)
    sums = np.cumsum(ordered - ordered[n // 2])
    below, above = sums[:-1] / k, (sums[-1] - sums[:-1]) / (n - k)
    between = k * (n - k) * (above - below) ** 2
    at = int(np.argmax(between))
    within = float(np.var(ordered)) - float(between[at]) / n**2
    distance = float(above[at] - below[at])
    return float((ordered[at] + ordered[at + 1]) / 2) if distance > _APART * np.sqrt(max(within, 0.0)) > 0 else None


def _levels(x: Vector, split: float, length: int) -> TwoLevels | None:
    """Return the two levels of means on both sides of a value, if they are levels and not the tails of noise."""
    upper: Mask = x > split
    rare = upper if np.mean(upper) < 0.5 else ~upper
    low, high = float(np.median(x[~upper])), float(np.median(x[upper]))
    middle = np.abs(x - (low + high) / 2) < (high - low) / 6
    changes = int(np.count_nonzero(np.diff(rare)))
    count, runs = int(np.count_nonzero(rare)), max(changes / 2, 1.0)
    lasting: Mask = rare[1:] & rare[:-1]  # single means can cross by noise after one jump
    if (
        count < _SHARE * x.size
        or np.count_nonzero(np.diff(lasting)) < _CHANGES
        or count < _LASTS * runs
        or np.count_nonzero(middle) > _BETWEEN * count
        or sum(bool(np.any(part)) for part in np.array_split(lasting, _PARTS)) <= _PARTS / 2
        or _are_pulses(x, rare)
    ):
        return None
    return TwoLevels(high - low, count / x.size, length * count / runs)


def _are_pulses(x: Vector, rare: Mask) -> bool:
    """Return whether rarer means are pulses: both signs, different sizes, or too regular, as of a thermostat. Distances
    of random levels are sums of two exponentials (tests/outliers/test_pulses.py)."""
    share = float(np.mean(rare))
    gaps = np.diff(np.flatnonzero(np.diff(rare.astype(np.int8)) == 1))
    # The coefficient of variation of n distances has a standard error of 1/√n. For rare levels, it is nearly 1.
    random = math.hypot(share, 1 - share) if share > 0.1 else 1.0
    if gaps.size and np.std(gaps) < random * min(0.6, 1 - 2.5 / math.sqrt(gaps.size)) * np.mean(gaps):
        return True
    if share > 0.1:
        return False
    common = float(np.median(x[~rare]))
    size = float(np.median(x[rare])) - common
    if np.count_nonzero((x - common) / size < -0.5) > 0.2 * np.count_nonzero(rare):
        return True
    inside = np.append(rare[1:], False) & np.append(False, rare[:-1]) & rare
    return bool(np.count_nonzero(inside) >= _PARTS and _spread(x[inside]) > 3 * _spread(x[~rare]))


def _spread(x: Vector) -> float:
    return float(np.median(np.abs(x - np.median(x))))


def axes_with_two_levels(remarks: Iterable[Remark]) -> frozenset[str]:
    """Return the axes that remarks name as switching between two levels."""
    return frozenset(
        remark.subject for remark in remarks if remark.code == "heavy-tails" and remark.facts["case"] == "levels"
    )
