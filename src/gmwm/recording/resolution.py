"""Estimate the quantization step of an axis, and its noise before rounding, from a part of its samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gmwm.base.arrays import Integers, Vector
from gmwm.base.lazy import scipy


@dataclass(frozen=True)
class StepSearch:
    """Limits at which values lie on a grid of steps (tests/test_inspection.py, tests/test_rounding.py)."""

    enough: int = 20_000
    """Samples that are used, so that each value of a coarse output occurs often (tests/test_inspection.py)."""
    distinct_share: float = 0.9
    """Largest share of distinct values among the samples for which a quantization step is searched."""
    uneven: float = 0.05
    """Largest deviation of differences from multiples of the step, in steps (tests/test_inspection.py)."""
    whole: float = 1e-3  # largest distance of a value from a whole count, in counts
    samples_of_value: int = 20
    """Least mean number of samples per value in the middle half, so that no value is missing between two."""
    regular: float = 0.35
    """Relative spread of distances of one step written with few digits; steps of 1.5 as 1 and 2 have 0.33."""
    fine: float = 1.0
    """Spread of the output, in steps, at which Sheppard's correction is exact to 1e-8 of the step²."""
    near_maximum: float = 0.5
    """Log-likelihood below the maximum of standard deviations that agree equally; the largest is used."""
    least_probability: float = 1e-9
    """Smallest probability of a value, so that a single wrong value does not determine the result."""


LIMITS = StepSearch()


_DUST, _LARGEST_DUST, _BETWEEN = 1e-9, 1e-5, 1e3
"""Distance over range of float64 rounding; its maximum if the next is `_BETWEEN` times it (tests/test_rounding.py)."""
_MEAN_OF, _CANCELS, _LEAST_NOISE = 16, 0.5, 0.02
"""Number of neighbours whose mean is tested for a counter; largest variance of this mean, relative to white noise; and
smallest mean square of the differences of neighbours (steps²)."""
_SPREADS = np.geomspace(0.05, 1.25, 60)
"""Standard deviations before rounding, in steps, that are compared. The result is within 3 % of the best value."""
_PLACES = np.linspace(-0.75, 0.75, 31)
"""Means before rounding, in steps from the output's mean, which rounding moves by at most half a step."""


class Sample:
    """Keeps every 2^k-th sample of a record of any length: 20 000 to 40 000 samples if the record has as many."""

    def __init__(self) -> None:
        self._kept = np.empty(0)
        self.count, self._stride = 0, 1  # samples of the record

    def update(self, values: Vector) -> None:
        """Add the next samples."""
        before, self.count = self.count, self.count + values.size
        while self.count > 2 * LIMITS.enough * self._stride:
            self._kept, self._stride = self._kept[::2], 2 * self._stride
        part = values[-before % self._stride :: self._stride]
        if part.size:
            self._kept = np.concatenate([self._kept, part])

    def values(self) -> Vector:
        """Return the selected samples."""
        return self._kept


def lsb(values: Vector) -> float | None:
    """Return the quantization step, the spacing of a regular grid of all values, if they repeat; otherwise None."""
    sample = Sample()
    sample.update(values)
    return step_of(sample.values())


def step_of(sample: Vector) -> float | None:
    """Return the spacing of a regular grid of all values, or None; with few digits, distances alternate, and their mean
    in the middle half is the step."""
    levels, counts = np.unique(sample, return_counts=True)
    levels, counts = _without_rounding(levels, counts)
    if levels.size < 2 or levels.size > LIMITS.distinct_share * sample.size:
        return None
    lattice, usual = _lattice(levels), _usual_distance(levels, counts.astype(np.float64))
    if usual is not None and (lattice is None or usual > (1 + 2 * LIMITS.uneven) * lattice):
        return float(f"{usual:.9g}")
    return lattice


def _without_rounding(levels: Vector, counts: Integers) -> tuple[Vector, Integers]:
    """Join levels that differ only by float64 rounding, as differences of a counter times a count's size."""
    steps = np.diff(levels)
    if levels.size < 3:
        return levels, counts
    # The range without wrong samples, which can have any size.
    below = np.cumsum(counts) / np.sum(counts)
    reach = float(np.subtract(*levels[np.searchsorted(below, [0.99, 0.01])]))
    above = np.min(steps[steps > _LARGEST_DUST * reach], initial=np.inf)
    # Joined levels are few, because rounding makes several levels of each.
    most_levels = LIMITS.distinct_share * levels.size
    if levels.size - np.count_nonzero(steps <= max(_DUST * reach, above / _BETWEEN)) > most_levels:
        return levels, counts
    ordered = np.sort(steps)
    dust = int(np.searchsorted(ordered, _DUST * reach, side="right"))
    most = int(np.searchsorted(ordered, _LARGEST_DUST * reach, side="right"))
    if dust < most:
        ratios = ordered[dust + 1 : most + 1] / ordered[dust:most]
        wide = np.flatnonzero(ratios > _BETWEEN)
        dust += int(wide[-1]) + 1 if wide.size else 0
    if not dust or levels.size - dust > most_levels:
        return levels, counts
    begins = np.flatnonzero(np.concatenate([[True], steps > ordered[dust - 1]]))
    sums = np.add.reduceat(counts, begins)
    return np.add.reduceat(levels * counts, begins) / sums, sums


def count_of(values: Vector) -> float | None:
    """Return the size of a count if values are counts with float64 rounding, as differences of a counter; else None.

    >>> count_of(np.diff(0.1 * np.random.default_rng(0).integers(0, 9, 1000).cumsum()))
    0.1
    """
    sample = Sample()
    sample.update(values)
    levels, counts = np.unique(sample.values(), return_counts=True)
    joined, _ = _without_rounding(levels, counts)
    step = step_of(sample.values()) if joined.size < levels.size else None
    if step is None or np.max(np.abs(joined / step - np.rint(joined / step))) > LIMITS.whole:
        return None
    return step


def is_counter(runs: list[Vector], step: float) -> bool:
    """Return whether values (runs without outliers) are differences of a counter, such as an angle in counts.

    Its rounding error cancels in means of neighbours: their variance is at most half of white noise's.

    >>> angle = np.cumsum(np.random.default_rng(0).normal(0.3, 0.2, 20_000))
    >>> is_counter([np.diff(np.round(angle))], 1.0)
    True
    """
    parts = [run[: run.size - run.size % _MEAN_OF].reshape(-1, _MEAN_OF) for run in runs if run.size >= 2 * _MEAN_OF]
    if not parts:
        return False
    single = np.mean([np.mean(np.diff(part.ravel()) ** 2) for part in parts])
    means = np.mean([np.mean(np.diff(part.mean(axis=1)) ** 2) for part in parts])
    return bool(single > _LEAST_NOISE * step**2 and _MEAN_OF * means < _CANCELS * single)


def _usual_distance(levels: Vector, counts: Vector) -> float | None:
    """Return the mean distance of neighbouring values in the middle half; None if irregular, or too few."""
    below = np.cumsum(counts) / np.sum(counts)
    middle = (below > 0.25) & (below - counts / np.sum(counts) < 0.75)
    level = levels[middle]
    if level.size < 4 or np.sum(counts[middle]) < LIMITS.samples_of_value * level.size:
        return None
    steps = np.diff(level)
    # Larger distances are gaps between two parts of a recording with different means.
    steps = steps[steps <= 1.6 * np.quantile(steps, 0.75)]
    usual = float(np.mean(steps))
    return usual if float(np.std(steps)) <= LIMITS.regular * usual else None


def _lattice(levels: Vector) -> float | None:
    steps = np.diff(levels)
    # Values that differ only by the rounding of float64 are equal.
    steps = steps[steps > 1e-12 * np.max(np.abs(levels))]
    if steps.size == 0 or _is_float32_rounding(levels, float(np.min(steps))):
        return None
    step = float(np.min(steps))
    multiples = steps / step
    if np.max(np.abs(multiples - np.round(multiples))) > LIMITS.uneven:
        return None
    # The step from the whole range has a smaller rounding error than a single difference.
    exact = float(np.sum(steps) / np.sum(np.round(multiples)))
    return float(f"{exact:.9g}")


def _is_float32_rounding(levels: Vector, step: float) -> bool:
    """Return whether a step is the spacing of float32 numbers of this size, not one of a sensor."""
    largest = np.float32(np.max(np.abs(levels)))
    single = bool(np.all(levels == levels.astype(np.float32)))
    return single and step <= float(np.spacing(largest))


def before_rounding(runs: list[Vector], step: float) -> float:
    """Return the noise's standard deviation before rounding to a step, from runs of samples without outliers.

    Over several steps, rounding adds step²/12 (Sheppard's correction). Otherwise it is the maximum likelihood of
    Gaussian noise for the counts of all runs, each with its mean. Runs of equal samples, if under half, are held
    values, left out.

    >>> rng = np.random.default_rng(0)
    >>> runs = [np.round(rng.normal(0.3, 0.25, 256)) for _ in range(20)]
    >>> round(float(np.std(runs)), 2), round(before_rounding(runs, 1.0), 2)
    (0.41, 0.23)
    """
    varied = [run for run in runs if run.size > 1 and np.any(run != run[0])]
    used = varied if 2 * len(varied) > len(runs) else [run for run in runs if run.size > 1]
    if not used:
        return 0.0
    usual = float(np.median([np.var(run / step) for run in used]))
    if usual >= LIMITS.fine**2:
        return float(np.sqrt(usual - 1 / 12)) * step
    total = np.zeros(_SPREADS.size)
    for run in used:
        total += _log_likelihood(run / step)
    return float(_SPREADS[np.flatnonzero(total >= np.max(total) - LIMITS.near_maximum)[-1]]) * step


def _log_likelihood(values: Vector) -> Vector:
    """Return the log-likelihood of rounded values (in steps) for each of `_SPREADS`, maximised over the mean."""
    start = values[0]
    cells, counts = np.unique(np.round(values - start), return_counts=True)
    means = np.mean(values - start) + _PLACES
    upper = (cells + 0.5 - means[:, None]) / _SPREADS[:, None, None]
    probability = scipy.special.ndtr(upper) - scipy.special.ndtr(upper - 1 / _SPREADS[:, None, None])
    return np.asarray(np.max(np.log(np.maximum(probability, LIMITS.least_probability)) @ counts, axis=1))
