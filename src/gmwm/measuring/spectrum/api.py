"""Estimate the power spectral density of a signal, also of a recording that is read in chunks, in bounded memory."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Vector, as_rate, as_vector, require_rate
from gmwm.base.errors import DataError, OptionError
from gmwm.base.threads import OneAtATime, one_at_a_time
from gmwm.measuring.axis_results import by_axis, rate_of_array
from gmwm.measuring.spectrum.peaks import find_peaks
from gmwm.measuring.spectrum.result import PowerSpectra, PowerSpectrum
from gmwm.measuring.spectrum.welch import Detrend, Periodograms, degrees_of_freedom, one_sided_density, periodograms
from gmwm.recording.batches import require_following
from gmwm.recording.options import as_confidence, one_of
from gmwm.recording.repairs.moving_average import moving_average
from gmwm.recording.signals import Imu, Signal

ENOUGH_BLOCKS = 15
"""Number of blocks that makes shorter ones needless: standard error 27 %, and means over frequencies as precise."""
BUFFERED_SAMPLES = 1 << 18  # number of samples that are buffered before they are processed


@dataclass(frozen=True, eq=False)
class _PeriodogramSums:
    """Sums over the blocks of one length; `pairs` counts overlaps, `first` and `last` are their first samples."""

    sums: Periodograms
    pairs: int = 0
    first: int = -1
    last: int = -1

    @property
    def blocks(self) -> int:
        return self.sums.blocks

    def followed_by(self, later: _PeriodogramSums, half: int) -> _PeriodogramSums:
        if not later.blocks:
            return self
        if not self.blocks:
            return later
        pairs = self.pairs + later.pairs + (later.first - self.last == half)
        return _PeriodogramSums(self.sums.plus(later.sums), pairs, self.first, later.last)


class SpectrumAccumulator(OneAtATime):
    """Accumulator of the power spectral density of a recording that does not fit into memory or is still growing.

    Blocks begin at multiples of half their length, counted from the beginning of the recording, so the result does not
    depend on how the recording is split. Parts can be accumulated separately, with `start` as the number of the first
    sample, and merged in order. Call `gap()` between two chunks if samples are missing: no block extends across a gap.

    Unless `length` is given, the block length is the largest power of two, up to 2^16 samples, for which there are at
    least 15 blocks.

    Parameters
    ----------
    rate, start, unit, axis
        The same as for `gmwm.variance.WaveletAccumulator`.
    length, detrend
        The same as for `gmwm.psd`.

    Raises
    ------
    OptionError
        If an option has an invalid value.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=10_000)
    >>> live = SpectrumAccumulator(rate=100.0)
    >>> for chunk in np.array_split(x, 7):
    ...     live.update(chunk)
    >>> live.result()
    PowerSpectrum(unnamed, 18 blocks of 1024 samples, 10000 samples at 100 Hz, 0 lines, 0 bumps)
    """

    def __init__(
        self, rate: float, *, length: int | None = None, detrend: Detrend = "constant", start: int = 0, unit: str = "",
        axis: str = "",
    ) -> None:  # fmt: skip
        self.rate, self.unit, self.axis = as_rate(rate), unit, axis
        self.length, self.start = checked_length(length), start
        one_of(detrend, "detrend", ("constant", "linear"))
        self.detrend = detrend
        # Lengths that are chosen automatically: 2^5 to 2^16 samples, 11 min at 100 Hz, which take 1 MB of memory.
        powers = range(16, 4, -1)
        lengths = [1 << power for power in powers] if self.length is None else [self.length]
        # Sums by length of the blocks, the longest first.
        self._sums = {n: _PeriodogramSums(Periodograms.none(n)) for n in lengths}
        self._segments: list[int] = []
        self._open = False
        # The samples that blocks across either end of this part need.
        self._head, self._tail = np.empty(0), np.empty(0)
        self._waiting: list[Vector] = []
        self._size = 0

    @one_at_a_time
    def __len__(self) -> int:
        """Return the number of samples so far."""
        return sum(self._segments) + self._size

    @property
    def stop(self) -> int:
        """Index of the next sample in the recording; missing samples in gaps are not counted."""
        return self.start + len(self)

    @property
    @one_at_a_time
    def lengths(self) -> tuple[int, ...]:
        """Lengths of the segments between gaps so far."""
        self._fold()
        return tuple(self._segments)

    @one_at_a_time
    def update(self, chunk: ArrayLike) -> None:
        """Add a `chunk` of samples (n,), one or more; raise DataError, and keep the others, if one is not finite."""
        x = as_vector(chunk, "chunk", at_least=0)
        if not x.size:
            return
        large = x.size >= BUFFERED_SAMPLES
        if large:
            self._fold()
        # A small chunk is copied, because its owner may change it before it is processed.
        self._waiting.append(x if large else x.copy())
        self._size += x.size
        if self._size >= BUFFERED_SAMPLES:
            self._fold()

    @one_at_a_time
    def gap(self) -> None:
        """Mark a gap where samples are missing, so that the next sample begins a new segment."""
        self._fold()
        self._open, self._tail = False, np.empty(0)

    @one_at_a_time
    def merge(self, following: SpectrumAccumulator) -> SpectrumAccumulator:
        """Merge this part with the part that directly follows it, into a new accumulator.

        Raises OptionError if `following` does not begin where this part ends, or was made with other options."""
        require_following(self, following, "rate", "length", "detrend", "unit")
        self._fold()
        following._fold()
        return self._join(following)

    @one_at_a_time
    def beside(self, other: SpectrumAccumulator) -> SpectrumAccumulator:
        """Return an accumulator of this recording and an independent recording `other`, with the same options.

        No block has samples of both. The result has the sampling rate of this recording."""
        self.gap()
        other.gap()
        return self._join(other)

    @one_at_a_time
    def result(self, confidence: float = 0.95) -> PowerSpectrum:
        """Return the power spectral density so far, with limits at the level `confidence`; more samples may follow.

        Raises DataError if no segment without a gap is as long as one block."""
        self._fold()
        longest = max(self._segments, default=0)
        # Smallest number of samples without a gap, three blocks of the shortest length.
        least = 64 if self.length is None else self.length
        lengths = [n for n, sums in self._sums.items() if sums.blocks >= ENOUGH_BLOCKS]
        length = max(lengths) if lengths else max(self._sums, key=lambda n: (self._sums[n].blocks, n))
        sums = self._sums[length]
        if longest < least or not sums.blocks:
            raise DataError(
                f"a spectrum needs at least {least} samples without a gap; got {longest}", argument="x", got=longest
            )
        density, freedom = (
            one_sided_density(sums.sums, length, self.rate),
            degrees_of_freedom(sums.sums, sums.pairs, length),
        )
        spectrum = PowerSpectrum(
            frequencies=np.arange(length // 2 + 1, dtype=np.float64) * (self.rate / length),
            density=density, degrees_of_freedom=freedom, rate=self.rate, samples=len(self),
            length=length, blocks=sums.blocks, unit=self.unit, axis=self.axis, confidence=confidence,
            average=moving_average(density, float(np.median(freedom))),
        )  # fmt: skip
        lines, bumps = find_peaks(spectrum)
        return replace(spectrum, lines=lines, bumps=bumps)

    def __repr__(self) -> str:
        return f"SpectrumAccumulator({self.axis or 'unnamed'}, {len(self)} samples at {self.rate:g} Hz)"

    @property
    def _reach(self) -> int:
        """Number of samples at each end of this part that blocks across the end can contain."""
        return max(self._sums) - 1

    def _fold(self) -> None:
        """Process the buffered samples."""
        if not self._size:
            return
        fresh = self._waiting[0] if len(self._waiting) == 1 else np.concatenate(self._waiting)
        first = self.start + sum(self._segments)
        self._waiting, self._size = [], 0
        values = np.concatenate([self._tail, fresh]) if self._tail.size else fresh
        self._add(values, first, after=self._tail.size)
        if not self._open:
            self._segments.append(0)
        self._open = True
        self._segments[-1] += fresh.size
        if len(self._segments) == 1 and self._head.size < self._reach:
            self._head = np.concatenate([self._head, fresh[: self._reach - self._head.size]])
        self._tail = values[-self._reach :].copy()

    def _add(self, values: Vector, boundary: int, *, after: int, crossing: bool = False) -> None:
        """Add blocks that end at or after sample `boundary` (values[after]); `crossing` excludes those after it."""
        begin = boundary - after
        for n, sums in list(self._sums.items()):
            half = n // 2
            first = -(-max(begin, boundary - n + 1) // half) * half
            stop = after + n - 1 if crossing else values.size
            part = periodograms(values[first - begin : stop], n, self.detrend)
            if part.blocks:
                fresh = _PeriodogramSums(part, part.blocks - 1, first, first + (part.blocks - 1) * half)
                self._sums[n] = sums.followed_by(fresh, half)
            if self._sums[n].blocks >= ENOUGH_BLOCKS:
                break
        self._drop_shorter()

    def _drop_shorter(self) -> None:
        """Remove the sums for lengths that are shorter than the longest length with enough blocks."""
        enough = max((n for n, sums in self._sums.items() if sums.blocks >= ENOUGH_BLOCKS), default=0)
        self._sums = {n: sums for n, sums in self._sums.items() if n >= enough}

    def _join(self, following: SpectrumAccumulator) -> SpectrumAccumulator:
        """Return the accumulator of both parts. It shares their arrays, which never change."""
        joint = SpectrumAccumulator(
            self.rate, length=self.length, detrend=self.detrend, start=self.start, unit=self.unit,
            axis=self.axis or following.axis,
        )  # fmt: skip
        lengths = [n for n in self._sums if n in following._sums]
        joint._sums = {n: self._sums[n] for n in lengths}
        if not following._segments:
            joint._sums = dict(self._sums)
        joint._segments, joint._open = list(self._segments), self._open
        joint._head, joint._tail = self._head, self._tail
        if not following._segments:
            return joint
        if self._open:
            joint._add(np.concatenate([self._tail, following._head]), self.stop, after=self._tail.size, crossing=True)
        joint._sums = {n: sums.followed_by(following._sums[n], n // 2) for n, sums in joint._sums.items()}
        joint._drop_shorter()
        if self._open:
            joint._segments[-1] += following._segments[0]
        else:
            joint._segments.append(following._segments[0])
        joint._segments += following._segments[1:]
        joint._open = following._open
        if len(self._segments) <= self._open:
            joint._head = np.concatenate([self._head, following._head])[: self._reach]
        unbroken = self._open and following._open and len(following._segments) == 1
        joint._tail = np.concatenate([self._tail, following._tail])[-self._reach :] if unbroken else following._tail
        return joint


def checked_length(length: int | None) -> int | None:
    """Check the length of the blocks, None or an even number of at least 8, and return it."""
    if length is None:
        return None
    if isinstance(length, bool) or not isinstance(length, int | np.integer) or length < 8 or length % 2:
        raise OptionError(argument="length", expected="an even number of samples from 8", got=length)
    return int(length)


@by_axis(lambda spectra: PowerSpectra(spectra=spectra), threaded=True)
def psd(
    x: Imu | Signal | ArrayLike, rate: float | None = None, *, length: int | None = None, detrend: Detrend = "constant",
    confidence: float = 0.95, fill_gaps: bool = True,
) -> PowerSpectrum:  # fmt: skip
    """Estimate the power spectral density of a signal, or of each axis of a recording, and find lines and bumps in it.

    The method is Welch's. The recording is divided into K blocks of L samples that overlap by one half. The mean is
    subtracted from each block k, and the density is the mean of the periodograms with a Hann window w,

    Ŝ(f) = 2 / (K f_s Σ w_t²) Σ_k |Σ_t w_t x_{k,t} e^{−2πi f t / f_s}|²,

    at the sampling rate f_s. It has about 1.9 K degrees of freedom. Values at neighbouring frequencies are nearly
    independent, so their mean, which plots and the summary show, is as precise as the density from shorter blocks.

    A **line** is a significant peak that is a few frequencies wide, or whose frequency is at least 60 times its width.
    A **bump** is a wider significant peak, such as a resonance. A peak is significant if it is significantly above the
    medians of the densities on both of its sides. The probability of any false line or bump in a recording of noise
    with a monotone spectrum is at most 1 %. `PowerSpectrum.detectable_amplitude` is the smallest amplitude of a line
    that is found. Lines below 12 times the frequency spacing f_s / L are not found, and a resonance that is narrower
    than twice the spacing cannot be distinguished from a line.

    Parameters
    ----------
    x : Imu, Signal, or (N,) array in any unit
        Finite samples, at least 64 without a gap. No block extends across a gap that is not filled.
    rate : float
        Sampling rate (Hz); leave it out for an Imu or a Signal.
    length : int, optional
        Length L of the blocks (samples), an even number from 8. By default it is the largest power of two, up to 65536,
        for which there are at least 15 blocks.
    detrend : "constant" or "linear"
        Trend that is subtracted from each block: its mean, or a straight line.
    confidence : float
        Confidence level of the limits, from 0.5 to below 1.
    fill_gaps : bool
        Whether to fill the gaps of a Signal that are short compared with the samples around them, see
        `Signal.fill_gaps`.

    Returns
    -------
    PowerSpectrum, or PowerSpectra for an Imu
        Frequencies, density (unit²/Hz, one-sided), limits, lines and bumps; for an Imu a mapping of axis to
        PowerSpectrum.

    Raises
    ------
    DataError
        If the signal contains NaN or infinities, or its longest segment has fewer than 64 samples, or fewer than
        `length`.
    OptionError
        If an option has an invalid value, or `rate` contradicts the rate of the Signal.

    References
    ----------
    Welch (1967), The use of fast Fourier transform for the estimation of power spectra, IEEE Transactions on Audio and
    Electroacoustics 15, 70-73. Harris (1978), On the use of windows for harmonic analysis with the discrete Fourier
    transform, Proceedings of the IEEE 66, 51-83.

    Examples
    --------
    >>> import numpy as np
    >>> rng, t = np.random.default_rng(1), np.arange(2**17) / 100.0
    >>> spectrum = psd(rng.normal(size=t.size) + 0.1 * np.sin(2 * np.pi * 7.3 * t), rate=100.0)
    >>> [line.described() for line in spectrum.lines]
    ['7.30036 ± 0.0003 Hz, amplitude 0.0964 ± 0.004 u']
    >>> bool(abs(np.sum(spectrum.density) * 100.0 / spectrum.length - 1.005) < 0.01)  # the variance
    True
    """
    as_confidence(confidence)
    segments: list[Vector]
    if isinstance(x, Signal):
        require_rate(rate, x.rate)
        signal = x.fill_gaps() if fill_gaps else x
        segments, rate, unit, axis = signal.segment_values(), x.rate, x.unit, x.axis
    else:
        segments, unit, axis = [as_vector(cast(ArrayLike, x), "x")], "", ""
    accumulator = SpectrumAccumulator(rate_of_array(rate), length=length, detrend=detrend, unit=unit, axis=axis)
    for segment in segments:
        accumulator.gap()
        accumulator.update(segment)
    return accumulator.result(confidence)
