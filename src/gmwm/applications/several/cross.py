"""Test whether signals share noise, by their wavelet cross-covariance; also as an addition to a calibration."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.several.matrices import (
    AxisPairs,
    chosen_names,
    measure,
    moment_of,
    pairs_of,
    product_moment,
    synchronous_signals,
    units_of,
)
from gmwm.applications.several.result import CrossCovariance, SharedNoise
from gmwm.applications.several.search import sum_model
from gmwm.base.arrays import Vector, freeze
from gmwm.base.errors import DataError, GmwmError
from gmwm.base.lazy import scipy
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.statistics import holm
from gmwm.base.threads import in_threads
from gmwm.calibration.additions import RecordingAddition
from gmwm.calibration.findings import TEST_SIZE
from gmwm.calibration.recording_findings import pairs_facts
from gmwm.files.readers.streams import Stream
from gmwm.measuring.covariance.api import variances
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.regression.least_squares import haar
from gmwm.measuring.streaming.passes import AxisCurves, unit_of
from gmwm.measuring.variance.accumulate import WaveletAccumulator
from gmwm.measuring.variance.biweight import require_robust
from gmwm.measuring.variance.open_segments import exact_levels, held_samples
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batch, Batches
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.gaps import fill_gaps, filled
from gmwm.recording.options import as_confidence, as_size
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import Model

Pair = tuple[str, str]


class Curves(NamedTuple):
    """Wavelet variances and cross-covariances of several axes."""

    own: Mapping[str, WaveletVariance]  # wavelet variance of each axis
    moments: Mapping[Pair, Vector]  # cross-covariances γ̂_j of each pair
    first: Mapping[str, Signal]  # the first batch of samples of each axis, or the whole signals


def streamed_curves(stream: Stream, axes: Sequence[str], *, robust: bool, efficiency: float) -> Curves:
    """Return wavelet variances of axes and cross-covariances of all pairs, of axes scaled to similar size. Robust ones
    depend on scales, so axes are measured first, then sums and differences, in up to four passes."""
    pairs, signs = pairs_of(list(axes)), (1.0, -1.0) if robust else (1.0,)
    sums = {f"{a} {sign:+g} {b}": (a, b, sign) for a, b in pairs for sign in signs}
    count, held = exact_levels(len(axes) + len(sums)), held_samples(len(axes) + len(sums))
    curves = {
        name: AxisCurves(
            WaveletAccumulator(
                stream.rate, held=held, exact=count, unit="" if name in sums else unit_of(stream, name), axis=name,
                robust=robust,
            ),
            stream.source,
            efficiency=efficiency,
        )
        for name in (*axes, *sums)
    }  # fmt: skip
    source = _SumReader(stream, axes, sums)
    if not robust:
        source.measure(curves)
        measured = in_threads(lambda _, curve: curve.classical(), curves)
    else:
        measured = _robust(source, {axis: curves[axis] for axis in axes})
        source.scale = units_of(measured)
        measured |= _robust(source, {name: curves[name] for name in sums})
    singles = {axis: measured[axis] for axis in axes}
    moments = {
        (a, b): moment_of(
            [measured[f"{a} {sign:+g} {b}"].variance for sign in signs], singles, source.scale, pair=(a, b)
        )
        for a, b in pairs
    }
    return Curves(singles, moments, fill_gaps(source.first))


def _robust(source: _SumReader, curves: Mapping[str, AxisCurves]) -> dict[str, WaveletVariance]:
    """Return robust wavelet variances, from one or two passes over the recording."""
    source.measure(curves)
    if again := {name: curve for name, curve in curves.items() if curve.begin_again()}:
        source.measure(again)
    return dict(in_threads(lambda _, curve: curve.robust(), curves))


class _SumReader:
    """Reads a recording in batches, and adds its axes and their sums to accumulators of wavelet variances."""

    def __init__(self, stream: Stream, axes: Sequence[str], sums: Mapping[str, tuple[str, str, float]]) -> None:
        self._batches, self._axes, self._sums = Batches(stream), axes, sums
        self.scale: dict[str, float] = {}
        self.first: dict[str, Signal] = {}

    def measure(self, curves: Mapping[str, AxisCurves]) -> None:
        """Add all batches to the accumulators, with short gaps filled."""
        for batch in filled(map(self._chosen, self._batches), together=True):
            self._add(batch, curves)
            del batch  # frees memory before the next batch is read

    def _add(self, batch: Batch, curves: Mapping[str, AxisCurves]) -> None:
        def add(name: str, curve: AxisCurves) -> None:
            a, b, sign = self._sums.get(name, (name, "", 0.0))
            signal = batch.signals[a]
            if b:
                values = self.scale[a] * signal.values + sign * self.scale[b] * batch.signals[b].values
                signal = replace(signal, values=values)
            curve.update(signal, batch.continues_on(a))

        in_threads(add, curves)

    def _chosen(self, batch: Batch) -> Batch:
        """Return the chosen axes of a batch. The first batch determines the scale factors."""
        signals = {axis: batch.signals[axis] for axis in self._axes}
        if not self.first:
            self.first = signals
            self.scale = {axis: _size(signal.values) for axis, signal in signals.items()}
        return Batch(signals, batch.first, batch.continues)


def _size(values: Vector) -> float:
    """Return the reciprocal of the RMS difference between neighbouring samples, or 1 if this is 0."""
    size = float(np.sqrt(np.mean(np.diff(values) ** 2))) if values.size > 1 else 0.0
    return 1 / size if size > 0 else 1.0


LARGEST_DELAY_SAMPLES = 3  # largest delay (samples) that can be found
LARGEST_LAG_SAMPLES = 12
"""Largest lag (samples) of the correlations. A sinusoid is correlated at all lags, delayed broadband noise is not."""
GAIN_IN_ERRORS = 5.0
"""Smallest gain of correlation by a delay, in standard errors. tests/joint/test_cross.py pins this module."""


def delays_of(signals: Mapping[str, Signal]) -> AxisPairs[int]:
    """Return the delay d (samples) of each pair (a, b) in which b lags: correlations at fine scales are small or
    negative, and those of samples d apart larger."""
    longest = max(next(iter(signals.values())).segments, key=lambda ends: ends[1] - ends[0])
    first, last = longest[0], min(longest[1], longest[0] + (1 << 20))
    delays: dict[tuple[str, str], int] = {}
    for level in (1, 2):  # a delay hardly changes the correlation at coarser levels
        count = last - first - (1 << level)
        if count < 64 * LARGEST_LAG_SAMPLES:
            break
        values = {name: signal.values[first:last] for name, signal in signals.items()}
        w = {name: haar(x - x.mean(), level) for name, x in values.items()}
        for pair in pairs_of(list(signals)):
            if delay := _delay(_correlations(w[pair[0]], w[pair[1]]), count):
                delays.setdefault(pair, delay)
    return AxisPairs(delays)


def _delay(correlation: Vector, count: int) -> int:
    """Return the delay that correlations at lags up to `LARGEST_LAG_SAMPLES` show, or 0 if they show none."""
    size = np.abs(correlation)
    near = size[LARGEST_LAG_SAMPLES - LARGEST_DELAY_SAMPLES : LARGEST_LAG_SAMPLES + LARGEST_DELAY_SAMPLES + 1]
    delay = int(np.argmax(near)) - LARGEST_DELAY_SAMPLES
    peak = LARGEST_LAG_SAMPLES + delay
    if size[peak] - size[LARGEST_LAG_SAMPLES] <= GAIN_IN_ERRORS / np.sqrt(count):
        return 0
    offsets = np.arange(1, LARGEST_DELAY_SAMPLES + 1)
    uneven = np.abs(correlation[peak + offsets] - correlation[peak - offsets]).max()
    far = np.concatenate([size[: peak - LARGEST_DELAY_SAMPLES - 2], size[peak + LARGEST_DELAY_SAMPLES + 3 :]]).max()
    # Far from the delay, and in its asymmetry around it, the correlation is at most 0.4 of that at the delay.
    return delay if max(uneven, far) <= 0.4 * size[peak] else 0


def _correlations(a: Vector, b: Vector) -> Vector:
    """Return the correlations of a at sample t and b at sample t + lag, for lags up to `LARGEST_LAG_SAMPLES`."""
    a = a[LARGEST_LAG_SAMPLES:-LARGEST_LAG_SAMPLES]
    products, squares = np.correlate(b, a, "valid"), b * b
    change = np.cumsum(squares[a.size :] - squares[: -a.size])
    power = float(a @ a) * (squares[: a.size].sum() + np.concatenate([np.zeros(1), change]))
    return np.where(power > 0, products / np.sqrt(np.where(power > 0, power, 1.0)), 0.0)


LEAST_FREEDOM = 3.0
"""Degrees of freedom above which a level is tested. With fewer, the statistic has no Student distribution."""
LEAST_FREEDOM_ROBUST = 8.0
"""The same for robust estimates. With 3, the 5 % test would reject 6 to 11 % (docs/validation/cross.md)."""


def cross(
    x: Imu | Stream | Mapping[str, Signal | ArrayLike], rate: float | None = None, *,
    axes: str | Sequence[str] | None = None, robust: bool = False, efficiency: float = 0.6, size: float = 0.05,
    confidence: float = 0.95,
) -> CrossCovariance:  # fmt: skip
    """Estimate the correlation of the noise of several axes at each scale, and test whether it is 0.

    The estimate of the cross-covariance at level j is the mean product of the Haar wavelet coefficients W_a and W_b of
    two axes,

        γ̂_j = Σ_t W_{a,j,t} W_{b,j,t} / M_j = (ν̂²_{a+b,j} − ν̂²_{a−b,j}) / 4,   r_j = γ̂_j / (ν̂_{a,j} ν̂_{b,j}).

    where M_j is the number of coefficients and ν̂² is a wavelet variance. If two signals share no noise, Var γ̂_j = Σ_u
    n(u) C_a(u) C_b(u) / M_j² for noise of any distribution. C(u) is the autocovariance of the coefficients at lag u,
    and n(u) is the number of pairs of coefficients with this lag. For each signal, C follows from the mixture of all
    processes with the highest likelihood, without drifts and sinusoids. With η_j = ν_a² ν_b² / Var γ̂_j degrees of
    freedom,

        r_j √(η_j − 1) / √(1 − r_j²)

    has approximately a Student distribution with η_j − 1 degrees of freedom. The p-values of all levels and pairs are
    adjusted by Holm's method. Levels with η_j ≤ 3 (robust estimate: η_j ≤ 8) are not tested.

    Parameters
    ----------
    x : Imu, Stream, or mapping of name to Signal or (N,) array
        Two or more signals that were sampled together, with the same rate, length and gaps. A Stream is read with
        bounded memory, once for classical estimates and up to four times for robust ones.
    rate : float
        Sampling rate (Hz); only for plain arrays.
    axes : str or sequence of str, optional
        The signals to use, such as "gyro" or ["gyro_x", "accel_z"]; all by default.
    robust : bool
        Whether to use robust estimates of ν²_{a+b} and ν²_{a−b}. Outliers that occur in both axes are then not treated
        as shared noise. The variance of the robust γ̂ is exact only if the spectra of the two axes have the same shape.
    efficiency : float
        Efficiency of the robust estimate; see `wavelet_variance`.
    size : float
        Significance level of the tests of all levels and pairs together.
    confidence : float
        Confidence level of the intervals of the correlations, tanh(artanh r ± z / √(η − 2)), with z the normal
        quantile.

    Raises
    ------
    DataError
        If there are fewer than two signals, if they differ in rate, length or gaps, or if `wavelet_variance` cannot use
        one of them.
    OptionError
        If an option has a value that is not allowed.

    References
    ----------
    Whitcher, Guttorp and Percival (2000), Wavelet analysis of covariance with application to atmospheric time series,
    JGR 105, 14941-14962; Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal of
    Statistics 6, 65-70. The measured rates of false alarms and the coverage of the intervals are in
    docs/validation/cross.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> table = rng.normal(size=20_000)
    >>> found = cross({axis: rng.normal(size=20_000) + 0.3 * table for axis in "xyz"}, rate=100.0)
    >>> f"{found.correlation['x', 'y'][0]:.2f}", len(found.shared) > 3
    ('0.09', True)
    """
    require_robust(robust, efficiency)
    size = as_size(size)
    as_confidence(confidence)
    curves = _curves(x, rate, axes, robust=robust, efficiency=efficiency)
    result = cross_covariance(curves, robust=robust, efficiency=efficiency, size=size, confidence=confidence)
    return replace(result, delays=delays_of(curves.first))


def cross_covariance(
    measured_curves: Curves, *, robust: bool, efficiency: float, size: float, confidence: float
) -> CrossCovariance:
    """Test the cross-covariances of all pairs as `cross` does. The returned object contains no delays."""
    curves, moments, _ = measured_curves
    names = list(curves)
    design = Design.of(next(iter(curves.values())))
    models = {name: _UnitNoise.of(mixture(wv.variance, wv.degrees_of_freedom, design, random=True)[1], design)
              for name, wv in curves.items()}  # fmt: skip
    freedom = {(a, b): _freedom(models[a], models[b], design) for a, b in moments}
    correlation = {
        (a, b): np.clip(gamma / np.sqrt(curves[a].variance) / np.sqrt(curves[b].variance), -1.0, 1.0)
        for (a, b), gamma in moments.items()
    }
    least = LEAST_FREEDOM_ROBUST if robust else LEAST_FREEDOM
    # Levels that are not tested have the value NaN.
    enough = {pair: np.where(eta > least, eta, np.nan) for pair, eta in freedom.items()}
    adjusted = np.split(holm(np.concatenate([_pvalues(correlation[p], enough[p]) for p in moments])), len(moments))
    pvalues = dict(zip(moments, adjusted, strict=True))
    limits = {pair: _limits(correlation[pair], enough[pair], confidence) for pair in moments}
    first = curves[names[0]]
    return CrossCovariance(
        axes=tuple(names), units={name: wv.unit for name, wv in curves.items()}, levels=first.levels, rate=first.rate,
        samples=first.samples, variance={name: wv.variance for name, wv in curves.items()},
        covariance=AxisPairs(moments), correlation=AxisPairs(correlation),
        lower=AxisPairs({pair: low for pair, (low, _) in limits.items()}),
        upper=AxisPairs({pair: high for pair, (_, high) in limits.items()}), degrees_of_freedom=AxisPairs(freedom),
        pvalues=AxisPairs(pvalues), delays=AxisPairs({}), size=size, confidence=confidence,
        efficiency=efficiency if robust else None,
    )  # fmt: skip


def _curves(
    x: Imu | Stream | Mapping[str, Signal | ArrayLike], rate: float | None, axes: str | Sequence[str] | None, *,
    robust: bool, efficiency: float,
) -> Curves:  # fmt: skip
    """Estimate the wavelet variances and cross-covariances of the chosen signals."""
    if isinstance(x, Stream):
        chosen = chosen_names(x.axes, axes)
        streamed = streamed_curves(x, chosen, robust=robust, efficiency=efficiency)
        units_of(streamed.own)  # raises an error if the variance of a level is 0
        return streamed
    signals = synchronous_signals(x, rate)
    signals = {name: signals[name] for name in chosen_names(tuple(signals), axes)}
    curves = {name: measure(signal, robust, efficiency) for name, signal in signals.items()}
    unit = units_of(curves)
    moments = {pair: product_moment(signals, curves, unit, pair=pair) for pair in pairs_of(list(signals))}
    return Curves(curves, moments, signals)


class _UnitNoise(NamedTuple):
    """Noise model of one signal, its wavelet variance (J,) with geometric mean 1, for precision, and Var ν̂² (J,)."""

    model: Model
    curve: Vector
    variances: Vector

    @classmethod
    def of(cls, model: Model, design: Design) -> _UnitNoise:
        unit = math.exp(float(np.mean(np.log(model.wavelet_variance(design.levels, design.rate)))))
        model = Model(tuple(process.with_scale(process.scale / unit) for process in model.processes))
        return cls(model, model.wavelet_variance(design.levels, design.rate), variances(model, _gaussian(design)))


def _gaussian(design: Design) -> Design:
    """Return a copy of a design for classical estimates of Gaussian signals."""
    return replace(design, efficiency=None, excess=None, model_error=0.0)


def _freedom(first: _UnitNoise, second: _UnitNoise, design: Design) -> Vector:
    """Return the degrees of freedom η_j (J,) of the correlation of two signals that share no noise."""
    plain = _gaussian(design)
    both = sum_model((*first.model.processes, *second.model.processes))
    # Var ν̂² of the sum of independent signals contains the mixed term 4 Σ n C_a C_b / M².
    total = variances(both, plain)
    null = (total - first.variances - second.variances) / 4
    if design.efficiency is not None:
        null *= variances(both, replace(plain, efficiency=design.efficiency)) / total
    return np.asarray(first.curve * second.curve / null)


def _pvalues(correlation: Vector, freedom: Vector) -> Vector:
    """Return two-sided p-values (J,) of the hypothesis of zero correlation, from Student's distribution."""
    with np.errstate(divide="ignore", invalid="ignore"):
        score = np.abs(correlation) * np.sqrt((freedom - 1) / (1 - correlation**2))
        return np.asarray(2 * scipy.special.stdtr(freedom - 1, -score))


def _limits(correlation: Vector, freedom: Vector, confidence: float) -> tuple[Vector, Vector]:
    """Return the confidence limits (J,) of correlations, from Fisher's transformation."""
    with np.errstate(divide="ignore", invalid="ignore"):
        half = scipy.special.ndtri(0.5 + confidence / 2) / np.sqrt(freedom - 2)
        middle = np.arctanh(correlation)
        return np.tanh(middle - half), np.tanh(middle + half)


MOST_BLOCK_MEANS = 1 << 20
"""Largest number of block means. The test then takes less than 5 % of the time of a calibration (0.32 s of 16.8 s)."""


def shared_noise(
    signals: Mapping[str, Signal] | Iterable[tuple[str, Signal]], *, size: float = 0.05, threads: int | None = None
) -> tuple[SharedNoise, ...]:
    """Return the scales at which two axes share noise (`cross`), by p-value.

    Beyond `MOST_BLOCK_MEANS`, means of 2^k samples are tested, without the k finest scales. Linear trends are removed,
    as unrelated drifts correlate at the largest scales. Axes without noise at a scale are left out. Gaps of a mapping
    are filled."""
    try:
        means, k = dict[str, Signal](), 0
        pairs_of_axes = synchronous_signals(signals, None).items() if isinstance(signals, Mapping) else signals
        for axis, signal in pairs_of_axes:
            k = max(0, (len(signal) - 1).bit_length() - MOST_BLOCK_MEANS.bit_length() + 1)
            means[axis] = block_means(signal, k)
        means = _detrended(synchronous_signals(means, None, fill=False), threads)
        curves = in_threads(lambda _, signal: measure(signal, False, 0.6), means, threads=threads)
        curves = {axis: wv for axis, wv in curves.items() if np.all(wv.variance > 0)}
        unit = units_of(curves)
        pairs = {" and ".join(pair): pair for pair in pairs_of(list(curves))}
        if not pairs:
            return ()
        products = in_threads(lambda _, pair: product_moment(means, curves, unit, pair=pair), pairs, threads=threads)
        moments = {pair: products[name] for name, pair in pairs.items()}
        result = cross_covariance(Curves(curves, moments, {}), robust=False, efficiency=0.6, size=size, confidence=0.95)
    except GmwmError:
        return ()  # for example, there are too few samples without a gap; the calibration reports this
    return tuple(replace(noise, level=noise.level + k) for noise in result.shared)


def block_means(signal: Signal, k: int) -> Signal:
    """Return the means of blocks of 2^k samples. The samples after the last whole block of a segment are dropped."""
    if k == 0:
        return signal
    size = 1 << k
    weight = np.full(size, 1 / size)
    parts: list[Vector] = []
    for values in signal.segment_values():
        count = values.size >> k
        if count >= MINIMUM_SAMPLES:
            parts.append(values[: count << k].reshape(count, size) @ weight)
    if not parts:
        raise DataError("every segment is too short")
    ends = np.cumsum([0, *(part.size for part in parts)]).tolist()
    values = freeze(np.concatenate(parts))
    segments = list(pairwise(ends))
    return Signal(values, signal.rate / size, signal.unit, signal.axis, segments=segments, filled=signal.filled >> k)


def _detrended(signals: Mapping[str, Signal], threads: int | None) -> dict[str, Signal]:
    """Subtract a line from each of the signals, which are synchronous: one slope, and the mean of each segment. Means
    often change at a gap, and a line through such changes would be a ramp that all axes share."""
    segments = next(iter(signals.values())).segments
    time = np.concatenate([np.arange(end - begin) - (end - begin - 1) / 2 for begin, end in segments])

    def of_axis(_: str, signal: Signal) -> Signal:
        values = np.concatenate([part - part.mean() for part in signal.segment_values()])
        values -= time * (float(time @ values) / float(time @ time))
        return replace(signal, values=freeze(values))

    return in_threads(of_axis, signals, threads=threads)


class SharedNoiseAddition(RecordingAddition):
    """The scales at which two axes of a recording share noise."""

    def needs(self, axes: Sequence[str]) -> bool:
        """Return whether there are at least two axes."""
        return len(axes) > 1

    def of_recording(
        self, signals: Iterable[tuple[str, Signal]], *, threads: int | None = None
    ) -> tuple[SharedNoise, ...]:
        """Test all pairs of axes."""
        return shared_noise(signals, threads=threads)

    def remarks(self, finding: Sequence[SharedNoise], axes: Collection[str], size: float) -> Iterator[Remark]:
        """Yield one remark if any of these axes share noise at this significance level. Axes with remaining motion or
        knocks must be left out. These affect several axes at once without being shared noise."""
        pairs = [pair for pair in finding if pair.pvalue <= size and set(pair.axes) <= set(axes)]
        # 5 % change the error of a sum by 2.5 %. Values repeated by a logger correlate by 1 to 2 % by chance.
        pairs = [pair for pair in pairs if abs(pair.correlation) > 0.05]
        if pairs:
            pairs.sort(key=lambda pair: -abs(pair.correlation))
            strongest = pairs[0]
            first, second = strongest.axes
            names = tuple(dict.fromkeys("/".join(pair.axes) for pair in pairs))
            # At longer scales, few values decide the correlation, and N and K hardly depend on them.
            largest = {"/".join(pair.axes): pair.correlation for pair in reversed(pairs) if pair.tau <= 100}
            yield Remark.of(
                "noise-shared", case="calibration", **pairs_facts(names),
                correlations=tuple(largest.get(name, 0.0) for name in names),
                first=first, second=second, correlation=strongest.correlation, tau=Quantity(strongest.tau, "s"),
                size=TEST_SIZE,
            )  # fmt: skip
