"""Regress all axes of a recording on its conditions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError, GmwmError, OptionError
from gmwm.base.threads import in_threads
from gmwm.base.units import si_unit
from gmwm.measuring.regression.against import TEMPERATURE, Asked, CovariateTerm
from gmwm.measuring.regression.api import effect_of, regress_axis, without
from gmwm.measuring.regression.blocks import BlockClock, usual_length
from gmwm.measuring.regression.covariates import Covariates
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.streaming.passes import curves_of, measure, show_batches
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.biweight import EFFICIENCY
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batch, Segments, Streamed, batches
from gmwm.recording.signals import Imu, Signal


@dataclass(frozen=True, eq=False)
class Seen:
    """Times (`clock`), temperature (°C) and sums over blocks of `length` clipped samples of a recording that was read
    once; `curves`: wavelet variances with the conditions' effect."""

    recording: Streamed
    clock: Signal
    temperature: Vector | None
    length: int
    sums: Mapping[str, Vector]
    curves: Mapping[str, WaveletVariance]

    @classmethod
    def of(cls, recording: Streamed, length: int, *, curves: bool = False, threads: int | None = None) -> Seen:
        """Read a recording in blocks of `length` samples and, with `curves`, its wavelet variances."""
        segments, parts = Segments(), list[Vector]()
        sums = {axis: np.zeros(0) for axis in recording.axes}
        measured = curves_of(recording, recording.axes, robust=False) if curves else {}

        def see(batch: Batch) -> None:
            segments.update(batch)
            if batch.temperature is not None:
                parts.append(batch.temperature)
            clock = BlockClock.of(recording.rate, tuple(segments.ranges), tuple(segments.starts), length=length)
            part = clock.part(batch.first, batch.stop)
            for axis, signal in batch.signals.items():
                added = part.sums(signal.values, clipped=True)
                added[: sums[axis].size] += sums[axis]
                sums[axis] = added

        measure(show_batches(batches(recording), see), measured, threads)
        temperature = np.concatenate(parts) if parts else None
        count = segments.ranges[-1][1]
        values = np.zeros(count) if temperature is None else temperature
        like = Signal(values, recording.rate, segments=segments.ranges, starts=segments.starts)
        classical = in_threads(lambda _, stream: stream.classical(), measured, threads=threads)
        return cls(recording, like, temperature, length=length, sums=sums, curves=classical)

    def means(self, clock: BlockClock) -> dict[str, Vector]:
        """Return the block means of all axes. For blocks of another length, the recording is read again."""
        sums = self.sums if clock.length == self.length else Seen.of(self.recording, clock.length).sums
        return {axis: clock.mean_of(axis_sums) for axis, axis_sums in sums.items()}


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions (`covariates`, or None), and regressions of all axes on them (`found`), also of independent axes.
    `unknown`: why there is no temperature, or "". `raw`: variances before subtraction, if not in memory."""

    covariates: Covariates | None = None
    found: Mapping[str, Regression] = field(default_factory=dict)
    unknown: str = ""
    raw: Mapping[str, WaveletVariance] = field(default_factory=dict)

    @classmethod
    def of(
        cls, signals: Mapping[str, Signal], asked: Asked, temperature: Vector | None, *, threads: int | None = None
    ) -> Conditions:
        """Regress the axes of a recording, without those that fail if the choice is automatic."""
        if not signals or not _is_requested(asked, temperature is not None):
            return cls()
        clock = next(iter(signals.values()))
        units = {axis: signal.unit for axis, signal in signals.items()}

        def means(clock: BlockClock) -> dict[str, Vector]:
            return in_threads(lambda _, one: clock.means(one.values, clipped=True), signals, threads=threads)

        return cls._of(clock, asked, temperature, means=means, units=units, threads=threads)

    @classmethod
    def of_recording(
        cls, recording: Imu | Streamed, asked: Asked, *, threads: int | None = None, curves: bool = False
    ) -> Conditions:
        """Regress all axes of a recording in memory or in a file, which is read once (twice without time stamps or with
        many lost samples), with its wavelet variances if `curves`."""
        if isinstance(recording, Imu):
            return cls.of(recording.signals, asked, recording.temperature, threads=threads)
        if not _is_requested(asked, recording.has_temperature):
            return cls()
        exact = next((term for term in asked.terms if term.exact and term.is_measured), None)
        if exact is not None:
            raise OptionError(
                f"against={exact} needs the recording in memory; got a Stream",
                argument="against",
                advice="Read the recording with `gmwm.read(path)`, or with {--chunked=no}.",
            )
        seen = Seen.of(recording, usual_length(recording.rows, 0), curves=curves, threads=threads)
        units = {axis: si_unit(axis) for axis in recording.axes}
        conditions = cls._of(seen.clock, asked, seen.temperature, means=seen.means, units=units, threads=threads)
        return replace(conditions, raw=seen.curves)

    @classmethod
    def _of(
        cls, clock: Signal, asked: Asked, temperature: Vector | None, *,
        means: Callable[[BlockClock], Mapping[str, Vector]], units: Mapping[str, str], threads: int | None,
    ) -> Conditions:  # fmt: skip
        """Regress the block means of the axes. The function `means` returns the block means for a clock."""
        if asked.automatic and temperature is not None and np.ptp(temperature) == 0:
            return cls()  # a constant temperature has no effect
        arrays = dict(asked.arrays or {})
        if temperature is not None:
            arrays.setdefault(TEMPERATURE, temperature)
        terms = (CovariateTerm(TEMPERATURE),) if asked.automatic else asked.terms
        try:
            covariates = Covariates.of(terms, arrays, clock)
        except DataError as error:
            if not asked.automatic:
                raise
            return cls(unknown=error.reason)

        def work(axis: str, axis_means: Vector) -> Regression | None:
            try:
                return regress_axis(axis_means, covariates, axis=axis, unit=units[axis], automatic=asked.automatic)
            except OptionError:
                raise
            except GmwmError:
                if not asked.automatic:
                    raise
                return None

        regressions = in_threads(work, means(covariates.clock), threads=threads)
        return cls(covariates, {axis: regression for axis, regression in regressions.items() if regression is not None})

    def applied_regression(self, axis: str) -> Regression | None:
        """Return the regression of an axis if it is applied, otherwise None."""
        regression = self.found.get(axis)
        return regression if regression is not None and regression.applied else None

    def without(self, axis: str, signal: Signal) -> Signal:
        """Return the signal of an axis minus the effect of the conditions."""
        regression = self.applied_regression(axis)
        return signal if regression is None or self.covariates is None else without(signal, regression, self.covariates)

    def batch(self, batch: Batch) -> Batch:
        """Return the samples of a batch minus the effect of the conditions."""
        if self.covariates is None or not any(regression.applied for regression in self.found.values()):
            return batch
        signals = {}
        for axis, signal in batch.signals.items():
            regression = self.applied_regression(axis)
            signals[axis] = signal if regression is None else without(signal, regression, self.covariates, batch.first)
        return replace(batch, signals=signals)

    def curve(self, axis: str, signal: Signal, robust: bool = False, efficiency: float = EFFICIENCY) -> WaveletVariance:
        """Return the wavelet variance of an axis after the effect of the conditions is subtracted."""
        regression = self.applied_regression(axis)
        wv = wavelet_variance(self.without(axis, signal), robust=robust, efficiency=efficiency)
        return wv if regression is None else regression.corrected(wv)

    def effect(self, axis: str, indices: Sequence[int]) -> Vector:
        """Return the effect of the conditions on an axis at the samples with the given indices."""
        regression = self.applied_regression(axis)
        if regression is None or self.covariates is None:
            return np.zeros(len(indices))
        at = [effect_of(regression, self.covariates, k, k + 1)[0] for k in indices]
        return np.array(at, dtype=np.float64)


def _is_requested(asked: Asked, temperature: bool) -> bool:
    """Return whether a regression is requested and, for the automatic choice, a temperature exists."""
    return bool(asked.terms) or (asked.automatic and temperature)


NOTHING = Conditions()  # conditions of a recording without a regression
