"""The wavelet variance of a record that comes in pieces: memory is bounded, and how it is cut changes nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Vector, as_rate, as_vector
from gmwm.errors import DataError, OptionError, ReadError
from gmwm.signals import MINIMUM_SAMPLES
from gmwm.variance.biweight import EFFICIENCY, require_robust
from gmwm.variance.limits import chi_square_limits
from gmwm.variance.result import WaveletVariance
from gmwm.variance.robust import robust_variances
from gmwm.variance.sketch import Sketches
from gmwm.variance.stretch import Stretch

EXACT = 14
"""Levels of which every coefficient is taken, by default."""
LEAST_EXACT = 6
"""Where a scale has 64 samples, every τ/64-th coefficient is every one."""
DEEPEST = 44
"""Levels that can be kept: 2^44 samples are 500 years at 1 kHz."""
FOLD = 1 << 18
"""Samples that are gathered before they are worked on."""


class WaveletAccumulator:
    """The Haar wavelet variance of a record that is too long for memory, or not yet at its end.

    Levels up to `exact` take every coefficient; each further one takes those that end at multiples of τ/64, counted
    from the beginning of the record. Of white noise that raises the variance of the estimate by 0.1 %, of a random walk
    or a Gauss-Markov process by nothing; where quantization noise rules such a scale it costs more, but at these scales
    it never does. The result says so in `strides`, and its covariance is that of these coefficients.

    Parts of a record may be measured apart and put together in order, cut anywhere: `start` says where a part begins.
    `gap()` between two chunks says that samples are missing there: no coefficient reaches over a gap, and those of all
    stretches are taken together, as `wavelet_variance` does for a Signal with segments.

    Parameters
    ----------
    rate : float
        Samples per second (Hz).
    levels : int, optional
        Number of levels J; all that have a coefficient by default.
    exact : int
        Levels of which every coefficient is taken, 6 to 24: memory is 16 · 2^exact bytes, and some MB of
        samples that wait.
    start : int
        Number of the first sample in the record, for a part of it.
    unit, axis : str
        Of the values, for the result.
    robust : bool
        Whether to keep what the robust variance needs as well: counts of |W| in fine bins, some 64 kB a level. Robust
        results are then those of all coefficients to 1e-4 (5e-3 at a level with so many outliers that only the
        median is left), and take four times as long.

    Raises
    ------
    OptionError
        If an option is not one of those it may be.

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
        self,
        rate: float,
        *,
        levels: int | None = None,
        exact: int = EXACT,
        start: int = 0,
        unit: str = "",
        axis: str = "",
        robust: bool = False,
    ) -> None:
        self.rate, self.unit, self.axis, self.robust = as_rate(rate), unit, axis, bool(robust)
        self.exact = _whole(exact, "exact", LEAST_EXACT, 24)
        self.levels = DEEPEST if levels is None else _whole(levels, "levels", 1, DEEPEST)
        self.start = _whole(start, "start", 0, 1 << 62)
        # The first stretch, if a gap has ended it; sums of those between; and the one that goes on.
        self._first: Stretch | None = None
        self._squares, self._counts = np.zeros(self.levels), np.zeros(self.levels, dtype=np.int64)
        self._sketches = Sketches()
        self._lengths: list[int] = []
        self._rises = 0.0
        self._last: Stretch | None = None
        self._waiting = np.empty(0)
        self._size = 0

    def __len__(self) -> int:
        """Samples so far."""
        return sum(self.lengths)

    @property
    def stop(self) -> int:
        """Number in the record of the sample to come; those that are missing in a gap do not count."""
        return self.start + len(self)

    @property
    def lengths(self) -> tuple[int, ...]:
        """Lengths of the stretches between gaps so far."""
        first = () if self._first is None else (self._first.count,)
        going = self._size + (0 if self._last is None else self._last.count)
        return (*first, *self._lengths, *((going,) if going else ()))

    def update(self, chunk: ArrayLike) -> None:
        """Take the samples (n,) that follow, one or many.

        Raises
        ------
        DataError
            If a value is NaN or infinite; the samples before stay as they are, and none of the chunk is taken.
        """
        x = as_vector(chunk, "chunk", at_least=0)
        if self._size + x.size > FOLD:
            self._fold()
        if x.size > FOLD:
            self._grow(x)
        elif x.size:
            if self._waiting.size == 0:
                self._waiting = np.empty(FOLD)
            self._waiting[self._size : self._size + x.size] = x
            self._size += x.size

    def gap(self) -> None:
        """Samples are missing here: those that follow begin a stretch of their own."""
        self._fold()
        if self._last is None:
            return
        if self._first is None and not self._lengths:
            self._first = self._last
        else:
            self._close(self._last)
        self._last = None

    def merge(self, following: WaveletAccumulator) -> WaveletAccumulator:
        """A new accumulator of this part and the one that follows it at once.

        Raises
        ------
        OptionError
            If the other does not begin where this one ends, or was not made alike.
        """
        if not isinstance(following, WaveletAccumulator):
            raise OptionError(f"following must be a WaveletAccumulator, got {type(following).__name__}")
        for name in ("rate", "exact", "levels", "unit", "robust"):
            if getattr(self, name) != getattr(following, name):
                raise OptionError(
                    f"both parts must have the same {name}, got {getattr(self, name)!r} and "
                    f"{getattr(following, name)!r}"
                )
        if following.start != self.stop:
            raise OptionError(
                f"the following part must begin with sample {self.stop}, where this one ends; it begins with "
                f"{following.start}: pass start= when it is made"
            )
        following._fold()
        joint = self._copy()
        joint.axis = self.axis or following.axis
        for part, ended in ((following._first, True), (following._last, False)):
            if part is not None:
                joint._last = part if joint._last is None else joint._last.followed_by(part)
            if ended and following._first is not None:
                joint.gap()
                joint._squares += following._squares
                joint._counts += following._counts
                joint._sketches = joint._sketches.merge(following._sketches)
                joint._lengths += following._lengths
                joint._rises += following._rises
        return joint

    def result(
        self, confidence: float = 0.95, *, robust: bool = False, efficiency: float = EFFICIENCY
    ) -> WaveletVariance:
        """The wavelet variance so far, the classical or the robust one; more samples may follow.

        A robust one knows no slope, so that a drift that is fitted to it has no sign.

        Parameters
        ----------
        confidence : float
            Level of the limits.
        robust, efficiency : bool, float
            As for `wavelet_variance`.

        Raises
        ------
        DataError
            If there are fewer than 8 samples without a gap.
        OptionError
            If an option is not one of those it may be, or robust results were not planned for.
        """
        require_robust(robust, efficiency)
        if robust and not self.robust:
            raise OptionError(
                "a robust variance needs the counts of all coefficients; make the accumulator with robust=True"
            )
        self._fold()
        parts, lengths = [part for part in (self._first, self._last) if part is not None], self.lengths
        longest = max(lengths, default=0)
        if longest < MINIMUM_SAMPLES:
            raise DataError(
                f"a wavelet variance needs at least {MINIMUM_SAMPLES} samples without a gap, got {longest} so far"
            )
        squares, counts = self._squares.copy(), self._counts.copy()
        for part in parts:
            own = part.sums(self.levels)
            squares, counts = squares + own[0], counts + own[1]
        reach = int(np.argmin(np.append(counts > 0, False)))
        numbers = np.arange(1, reach + 1, dtype=np.int64)
        variance, taken = squares[:reach] / counts[:reach], counts[:reach].copy()
        diagnostics: dict[str, Any] = {}
        if robust:
            sketches = self._sketches
            for part in parts:
                sketches = sketches.merge(part.all_sketches())
            found = robust_variances(sketches.coefficients(reach), efficiency)
            variance, diagnostics["robust"] = found.variance, found.diagnostics
        wv = WaveletVariance(
            numbers, variance, variance, variance, taken, self.rate, sum(lengths), self.unit, self.axis,
            confidence=confidence, slope=None if robust else self._slope(parts),
            segments=lengths if len(lengths) > 1 else (), strides=_strides(self.exact, reach),
            robust=robust, efficiency=efficiency if robust else None, diagnostics=diagnostics,
        )  # fmt: skip
        lower, upper = chi_square_limits(variance, wv.degrees_of_freedom, confidence)
        return replace(wv, lower=lower, upper=upper)

    # --- state ----------------------------------------------------------------------------------------

    def to_dict(self) -> dict[str, Any]:
        """The whole state as plain numbers, texts and arrays: what pickle, NumPy's savez and JSON of lists can hold."""
        self._fold()
        return {
            "rate": self.rate, "levels": self.levels, "exact": self.exact, "start": self.start, "unit": self.unit,
            "axis": self.axis, "squares": self._squares, "counts": self._counts,
            "lengths": np.array(self._lengths, dtype=np.int64), "rises": self._rises, "robust": self.robust,
            **dict(zip(("bins", "resolutions"), self._sketches.to_arrays(), strict=True)),
            **({} if self._first is None else self._first.arrays("first_")),
            **({} if self._last is None else self._last.arrays("last_")),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> WaveletAccumulator:
        """The accumulator whose `to_dict` gave `values`.

        Raises
        ------
        ReadError
            If they are not those of an accumulator.
        """
        try:
            made = cls(
                float(values["rate"]), levels=int(values["levels"]), exact=int(values["exact"]),
                start=int(values["start"]), unit=str(values["unit"]), axis=str(values["axis"]),
                robust=bool(values["robust"]),
            )  # fmt: skip
            made._squares = np.array(values["squares"], dtype=np.float64).reshape(made.levels)
            made._counts = np.array(values["counts"], dtype=np.int64).reshape(made.levels)
            made._lengths = [int(length) for length in values["lengths"]]
            made._rises = float(values["rises"])
            made._sketches = Sketches.from_arrays(values["bins"], values["resolutions"])
            made._first = Stretch.restored("first_", made.exact, values)
            made._last = Stretch.restored("last_", made.exact, values)
        except KeyError as error:
            raise ReadError(f"not an accumulator's state: it has no {error.args[0]!r}") from error
        except (TypeError, ValueError) as error:
            raise ReadError(f"not an accumulator's state: {error}") from error
        return made

    def __getstate__(self) -> dict[str, Any]:
        return self.to_dict()

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(WaveletAccumulator.from_dict(state).__dict__)

    def __repr__(self) -> str:
        return f"WaveletAccumulator({self.axis or 'unnamed'}, {len(self)} samples at {self.rate:g} Hz)"

    # --- inside ---------------------------------------------------------------------------------------

    def _copy(self) -> WaveletAccumulator:
        """Another of the same state; what a stretch holds is never changed, so both may have it."""
        self._fold()
        made = WaveletAccumulator(
            self.rate,
            levels=self.levels,
            exact=self.exact,
            start=self.start,
            unit=self.unit,
            axis=self.axis,
            robust=self.robust,
        )
        made._first, made._last, made._rises = self._first, self._last, self._rises
        made._squares, made._counts = self._squares.copy(), self._counts.copy()
        made._lengths, made._sketches = list(self._lengths), self._sketches
        return made

    def _fold(self) -> None:
        """Work on the samples that wait."""
        if self._size:
            x, self._size = self._waiting[: self._size], 0
            self._grow(x)

    def _grow(self, x: Vector) -> None:
        """Take samples into the stretch that goes on."""
        for k in range(0, x.size, 4 * FOLD):
            part = x[k : k + 4 * FOLD]
            if self._last is None:
                self._last = Stretch.of(part, self.stop, self.exact, self.levels, self.robust)
            else:
                self._last = self._last.grown(part)

    def _close(self, stretch: Stretch) -> None:
        """Keep the sums of a stretch that has an end."""
        squares, counts = stretch.sums(self.levels)
        self._squares += squares
        self._counts += counts
        if self.robust:
            self._sketches = self._sketches.merge(stretch.all_sketches())
        self._lengths.append(stretch.count)
        self._rises += float(stretch.count) ** 2 * stretch.rise

    def _slope(self, parts: list[Stretch]) -> float:
        """Mean rise in a sample, of several stretches by the squares of their lengths."""
        weights = sum(float(n) ** 2 for n in (*self._lengths, *(part.count for part in parts)))
        return (self._rises + sum(float(part.count) ** 2 * part.rise for part in parts)) / weights


def _strides(exact: int, levels: int) -> tuple[int, ...]:
    """At every how many samples each level has a coefficient; () where all levels have all."""
    if levels <= exact:
        return ()
    return (*(1 for _ in range(exact)), *((1 << level) // 64 for level in range(exact + 1, levels + 1)))


def _whole(value: int, name: str, least: int, most: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not least <= value <= most:
        raise OptionError(f"{name} must be a whole number from {least} to {most}, got {value!r}")
    return int(value)
