"""Wavelet variance of a recording that is read in chunks, in bounded memory."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from gmwm.base.arrays import Vector, as_rate, joined
from gmwm.base.errors import DataError, OptionError
from gmwm.base.kinds import Document
from gmwm.base.threads import one_at_a_time
from gmwm.measuring.axis_results import chi_square_limits
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.biweight import EFFICIENCY, biweight, require_robust
from gmwm.measuring.variance.coefficients import require_digits
from gmwm.measuring.variance.open_segments import EXACT_LEVELS, MOST_LEVELS, SegmentedAccumulator
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.measuring.variance.rise import RiseSums, ThinnedValues
from gmwm.measuring.variance.robust import RobustVariances, robust_variances, unrejected
from gmwm.measuring.variance.second_pass import SecondPass, sum_request
from gmwm.measuring.variance.segment_state import LARGEST_SUM, SegmentState, as_count
from gmwm.measuring.variance.sketch import SKETCH_COLLECTOR, Counts, SketchCoefficients, Sketches
from gmwm.recording.batches import require_following
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.signals import Signal


class WaveletAccumulator(SegmentedAccumulator):
    """Accumulator of the Haar wavelet variance of a recording that does not fit into memory or is still growing.

    Levels up to `exact` use every coefficient. Higher levels use the coefficients that end at multiples of τ/64,
    counted from the beginning of the recording. This raises the variance of the estimate by 0.1 % for white noise, and
    does not change it for a random walk or a Gauss-Markov process. The increase is larger for quantization noise, but
    that noise never dominates at these scales. The attribute `strides` of the result has the distances between the
    coefficients, and the covariance of the result takes them into account.

    The result does not depend on how the recording is split. Parts can be accumulated separately, with `start` as the
    number of the first sample, and merged in order. Call `gap()` between two chunks if samples are missing: no
    coefficient extends across a gap, and the coefficients of all segments are pooled, as in `wavelet_variance`.

    Parameters
    ----------
    rate, levels : float, int
        Sampling rate (Hz), and number of levels J, by default all that have a coefficient.
    exact : int
        Number of levels that use every coefficient, from 6 to 24. The accumulator takes 16 · 2^exact bytes, and some MB
        for samples that are not processed yet.
    start, unit, axis : int, str, str
        Index of the first sample in the recording, and unit and name of the signal.
    robust : bool
        Whether to support robust results. Fine histograms of the coefficients then take some 64 kB per level, and the
        run time is four times as long. Robust results have a relative error of 1e-4, or 5e-3 at a level with so many
        outliers that only the median is defined. `second_pass` makes them exact.
    held : int, optional
        Largest number of samples that are stored, 2^exact − 1 by default. Up to this number, all results equal the
        results of `wavelet_variance`, to the last bit. Each stored sample takes 8 bytes.

    Raises
    ------
    OptionError
        If an option has an invalid value.

    Examples
    --------
    >>> rng = np.random.default_rng(1)
    >>> x = rng.normal(size=10_000)
    >>> live = WaveletAccumulator(rate=100.0)
    >>> for chunk in np.array_split(x, 7):
    ...     live.update(chunk)
    >>> live.result()
    WaveletVariance(unnamed, haar, 13 levels, 10000 samples at 100 Hz)
    >>> left, right = WaveletAccumulator(rate=100.0), WaveletAccumulator(rate=100.0, start=3_000)
    >>> left.update(x[:3_000])
    >>> right.update(x[3_000:])
    >>> bool(np.allclose(left.merge(right).result().variance, live.result().variance, rtol=1e-12))
    True
    """

    def __init__(
        self, rate: float, *, levels: int | None = None, exact: int = EXACT_LEVELS, start: int = 0, unit: str = "",
        axis: str = "", robust: bool = False, held: int | None = None,
    ) -> None:  # fmt: skip
        collector = SKETCH_COLLECTOR if robust else None
        super().__init__(MOST_LEVELS if levels is None else levels, exact, start, collector, held=held)
        self.rate, self.unit, self.axis, self.robust = as_rate(rate), unit, axis, bool(robust)
        self._thinned = ThinnedValues()

    @one_at_a_time
    def merge(self, following: WaveletAccumulator) -> WaveletAccumulator:
        """Merge this part with the part that directly follows it, into a new accumulator.

        Raises OptionError if `following` does not begin where this part ends, or was made with other options."""
        require_following(self, following, "rate", "exact", "levels", "unit", "robust")
        joint = self._copy()
        joint.axis = self.axis or following.axis
        joint._append(following)
        joint._thinned = joint._thinned.join(following._thinned)
        return joint

    @one_at_a_time
    def result(
        self, confidence: float = 0.95, *, robust: bool = False, efficiency: float = EFFICIENCY
    ) -> WaveletVariance:
        """Compute the classical or robust wavelet variance of the samples so far; more samples may follow.

        For at most `held` samples, the result equals the result of `wavelet_variance`, to the last bit. For more
        samples, a robust result is computed from histograms of the coefficients. It does not contain the slope of the
        recording, so a fitted drift has no sign. `second_pass` then gives the exact robust result with the slope.

        Parameters
        ----------
        confidence, robust, efficiency
            The same as for `wavelet_variance`.

        Raises
        ------
        DataError
            If there are fewer than 8 samples without a gap.
        OptionError
            If an option has an invalid value, or the accumulator was made without `robust=True`.
        """
        require_robust(robust, efficiency)
        if robust:
            self._require_counts()
        self._require_samples()
        if self.holds_all:
            wv = wavelet_variance(
                self._signal(), levels=min(self.levels, max(self.lengths).bit_length() - 1), robust=robust,
                efficiency=efficiency, confidence=confidence, fill_gaps=False,
            )  # fmt: skip
            return replace(wv, rise=self.rise)
        if not robust:
            return self._curve(confidence)
        return self._curve(confidence, robust_variances(self._sketches(), efficiency), efficiency)

    @one_at_a_time
    def second_pass(self, efficiency: float = EFFICIENCY, *, start: int | None = None) -> SecondPass:
        """Create a second pass over the same samples, which computes the exact robust wavelet variance.

        This accumulator must contain the whole recording. It does not change. Errors are the same as for `result`.

        Parameters
        ----------
        efficiency : float
            The same as for `wavelet_variance`.
        start : int, optional
            Index of the first sample, if the second pass processes a part of the recording and is merged later; by
            default the first sample of the recording.

        Examples
        --------
        >>> x = np.random.default_rng(1).normal(size=50_000)
        >>> x[::500] = 1e3
        >>> first = WaveletAccumulator(rate=100.0, robust=True)
        >>> first.update(x)
        >>> second = first.second_pass()
        >>> for chunk in np.array_split(x, 7):
        ...     second.update(chunk)
        >>> from gmwm import wavelet_variance
        >>> in_memory = wavelet_variance(x, rate=100.0, robust=True)
        >>> bool(np.allclose(second.result().variance[:14], in_memory.variance[:14], rtol=1e-9))
        True
        """
        biweight(efficiency)
        self._require_counts()
        record = self._copy()
        sketched = record._sketches()
        request = sum_request(sketched, robust_variances(sketched, efficiency), efficiency)
        winsorised = record._thinned.winsorised_rise(self.start, record.lengths)
        return SecondPass(
            record, request, winsorised=winsorised, start=self.start if start is None else start, efficiency=efficiency
        )

    def _sketches(self) -> SketchCoefficients:
        """Return the sketches so far; raise DataError if there are fewer than 8 samples without a gap."""
        self._fold()
        reach = self._variances()[1].size
        sketches: Sketches = self._all_statistics()
        return SketchCoefficients.of(sketches, reach)

    def _curve(
        self, confidence: float = 0.95, robust: RobustVariances | None = None, efficiency: float | None = None,
        slope: float | None = None,
    ) -> WaveletVariance:  # fmt: skip
        """Return the result for the samples so far, with classical variances or with the robust variances `found`."""
        self._fold()
        variance, counts = self._variances()
        lengths = self.lengths
        classical, diagnostics = variance, {}
        if robust is not None:
            variance, diagnostics = robust.variance, {"robust": dict(robust.diagnostics)}
        wv = WaveletVariance(
            levels=np.arange(1, counts.size + 1, dtype=np.int64), variance=variance, lower=variance, upper=variance,
            counts=counts, rate=self.rate, samples=sum(lengths), unit=self.unit, axis=self.axis, confidence=confidence,
            slope=self._slope() if robust is None else slope, segments=lengths if len(lengths) > 1 else (),
            filled=self.filled, rise=self.rise, strides=_strides(self.exact, counts.size), robust=robust is not None,
            efficiency=efficiency, diagnostics=diagnostics,
        )  # fmt: skip
        if robust is not None and efficiency is not None:
            freedom = wv.degrees_of_freedom / efficiency
            if (lost := unrejected(robust, classical, freedom, efficiency)) is not None:
                diagnostics["robust"]["unrejected"] = lost[0]
                wv = replace(wv, excess=lost[1])
        lower, upper = chi_square_limits(variance, wv.degrees_of_freedom, confidence)
        return replace(wv, lower=lower, upper=upper)

    @one_at_a_time
    def to_dict(self) -> dict[str, Any]:
        """Return the whole state as numbers, strings and arrays, for pickle, `numpy.savez`, or (as lists) JSON."""
        self._fold()
        sketches: Any = self._statistics if self.robust else Sketches()
        return {
            "rate": self.rate, "levels": self.levels, "exact": self.exact, "start": self.start, "unit": self.unit,
            "axis": self.axis, "squares": self._squares, "counts": self._counts,
            "lengths": np.array(self._lengths, dtype=np.int64), "rises": self._rises, "filled": self.filled,
            "line": np.array(self._line),
            "robust": self.robust, "every": self._thinned.every, "some": self._thinned.values,
            "some_first": self._thinned.first,
            **dict(zip(("bins", "resolutions"), sketches.to_arrays(), strict=True)),
            **({} if self._first is None else self._first.arrays("first_")),
            **({} if self._last is None else self._last.arrays("last_")),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> WaveletAccumulator:
        """Restore an accumulator from the result of its `to_dict`; raise ReadError if `values` is not such a state."""
        with Document("state of an accumulator", "Save the state again with `to_dict()`.").reading():
            result = cls(
                float(values["rate"]), levels=int(values["levels"]), exact=int(values["exact"]),
                start=int(values["start"]), unit=str(values["unit"]), axis=str(values["axis"]),
                robust=bool(values["robust"]),
            )  # fmt: skip
            result._squares = np.array(values["squares"], dtype=np.float64).reshape(result.levels)
            result._counts = np.array(values["counts"], dtype=np.int64).reshape(result.levels)
            if not np.all((result._squares >= 0) & (result._squares < LARGEST_SUM**2)) or np.any(result._counts < 0):
                raise ValueError("sums of squares and counts must be finite and not negative")
            result._lengths = [as_count(length) for length in values["lengths"]]
            result._rises = float(values["rises"])
            result.filled, result._line = as_count(values["filled"]), RiseSums(*map(float, values["line"]))
            if result.robust:
                result._statistics = Sketches.from_arrays(values["bins"], values["resolutions"])
            thinned = np.array(values["some"], dtype=np.float64)
            result._thinned = ThinnedValues(as_count(values["every"], 1), as_count(values["some_first"]), thinned)
            result._first = SegmentState.restore("first_", result.exact, result.levels, values)
            result._last = SegmentState.restore("last_", result.exact, result.levels, values)
            result._count = as_count(sum(result._lengths) + sum(part.count for part in result._open()))
        return result

    def __getstate__(self) -> dict[str, Any]:
        return self.to_dict()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(WaveletAccumulator.from_dict(state).__dict__)

    def __repr__(self) -> str:
        return f"WaveletAccumulator({self.axis or 'unnamed'}, {len(self)} samples at {self.rate:g} Hz)"

    def part(self, start: int, held: int | None = None) -> WaveletAccumulator:
        """Create an empty accumulator with the same options, but `held`, for the part from sample `start` on."""
        return WaveletAccumulator(
            self.rate, levels=self.levels, exact=self.exact, start=start, unit=self.unit, axis=self.axis,
            robust=self.robust, held=held,
        )  # fmt: skip

    def _copy(self) -> WaveletAccumulator:
        """Return a copy of the accumulator, which shares the data of closed segments, because they never change."""
        copy = self.part(self.start, self.held)
        copy._take_state(self)
        copy._thinned = self._thinned
        return copy

    def _require_usable(self, x: Vector) -> None:
        if self.robust and x.size:
            require_digits(x)

    def _grow(self, x: Vector) -> None:
        """Add samples to the open segment."""
        if self.robust:
            self._thinned = self._thinned.join(ThinnedValues.of(x, self.stop))
        super()._grow(x)

    def _require_counts(self) -> None:
        """Raise an error if the accumulator was made without `robust=True`."""
        if not self.robust:
            raise OptionError(
                "a robust variance needs the counts of all coefficients, which this accumulator does not keep",
                argument="robust",
                advice="Make the accumulator with {--robust=yes}.",
            )

    def _signal(self) -> Signal:
        """Return all samples so far as a Signal; this requires that all of them are stored."""
        values = self._held.segments()
        ends = np.cumsum([0, *map(len, values)]).tolist()
        return Signal(
            joined(values), self.rate, unit=self.unit, axis=self.axis, segments=list(pairwise(ends)),
            filled=self.filled,
        )  # fmt: skip

    def _require_samples(self) -> None:
        """Raise an error if there are fewer than 8 samples without a gap."""
        longest = max(self.lengths, default=0)
        if longest < MINIMUM_SAMPLES:
            raise DataError(
                f"a wavelet variance needs at least {MINIMUM_SAMPLES} samples without a gap; got {longest} so far",
                got=longest,
                advice="Record longer, or read more samples before you call `result()`.",
            )

    def _variances(self) -> tuple[Vector, Counts]:
        """Return the variances and the numbers of coefficients of the levels that have coefficients."""
        self._require_samples()
        squares, counts = self._sums()
        reach = int(np.argmin(np.append(counts > 0, False)))
        return squares[:reach] / counts[:reach], counts[:reach].copy()

    def _slope(self) -> float:
        """Return the mean rise per sample; several segments are weighted by the squares of their lengths."""
        parts = self._open()
        weights = sum(float(n) ** 2 for n in (*self._lengths, *(part.count for part in parts)))
        return (self._rises + sum(float(part.count) ** 2 * part.rise for part in parts)) / weights


def _strides(exact: int, levels: int) -> tuple[int, ...]:
    """Return the distance (samples) between the coefficients of each level; () if all levels use every coefficient."""
    if levels <= exact:
        return ()
    return (*(1 for _ in range(exact)), *((1 << level) // 64 for level in range(exact + 1, levels + 1)))
