"""Measure the axes of one or several recordings: everything that the calibration of an axis needs of its samples."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np

from gmwm.base.errors import DataError, GmwmError, OptionError
from gmwm.base.remarks import Remark
from gmwm.base.text import counted
from gmwm.base.threads import in_threads, return_memory
from gmwm.calibration.data import Curve, Part, Recordings
from gmwm.calibration.findings import LEAST_SCALES_FOR_USE
from gmwm.calibration.misfit import line_in
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.passes import (
    IN_THIS_PROCESS,
    AxisAccumulator,
    Execution,
    Passes,
    clean,
    needed_beginning,
    read_recording,
)
from gmwm.calibration.rest import AxisMean, means_of
from gmwm.measuring.covariance.tails import with_common_tails
from gmwm.measuring.inspection import Inspection
from gmwm.measuring.inspection.api import with_gravity
from gmwm.measuring.inspection.findings import beginning_to_omit, omission_remarks
from gmwm.measuring.inspection.jumps import jumps_to_subtract
from gmwm.measuring.inspection.time_grid import Extent
from gmwm.measuring.outliers import MATERIAL, TOLERANCE, Screen, Verdict, contamination, dependence, other_efficiency
from gmwm.measuring.outliers.bursts import RARE
from gmwm.measuring.outliers.cleaning import NOTHING_REPLACED
from gmwm.measuring.regression.conditions import Conditions
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.spectrum import Line, PowerSpectrum
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.pooling import pool
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.batches import Batch, batches, join_batches, part_of
from gmwm.recording.gaps import fill_gaps
from gmwm.recording.repairs import only_axes, repaired, without_jumps
from gmwm.recording.repairs.beginning import without_times
from gmwm.recording.signals import Imu, Signal
from gmwm.recording.time_ranges import range_texts


@dataclass(frozen=True, kw_only=True, eq=False)
class MeasuredAxis:
    """One axis of a unit's recordings before a model is chosen, in mappings by recording, "" for a single one."""

    axis: str
    # The two wavelet variances. A curve that the user gave is in one of them only.
    classical: Mapping[str, WaveletVariance] = field(default_factory=dict)
    robust: Mapping[str, WaveletVariance] = field(default_factory=dict)
    # test for outliers; empty for a curve that the user gave
    verdicts: Mapping[str, Verdict] = field(default_factory=dict)
    # power spectrum of all recordings together, smoothed except at lines; None for a curve or for few samples
    spectrum: PowerSpectrum | None = None
    # regression on the conditions, even if the axis does not follow them
    regressions: Mapping[str, Regression] = field(default_factory=dict)
    # wavelet variance before the effect of the conditions is removed, if it is removed and if this curve is known
    raw: Mapping[str, WaveletVariance] = field(default_factory=dict)
    means: Mapping[str, AxisMean] = field(default_factory=dict)  # mean of the samples and the gravity in it
    # first samples for the additions, with isolated wrong samples and knocks replaced
    beginnings: Mapping[str, Signal] = field(default_factory=dict)

    @property
    def regression(self) -> Regression | None:
        """The regression of a single recording; with several recordings, each curve contains its own."""
        return self.regressions.get("")

    def verdict(self, *, robust: bool) -> Verdict | None:
        """Return the most severe outlier test over recordings; the test of the efficiency is for `robust` curves."""
        verdicts = list(self.verdicts.values())
        if not verdicts:
            return None
        worst = min(verdicts, key=lambda verdict: (not verdict.contaminated, verdict.pvalue))
        return replace(
            worst,
            spikes=sum(verdict.spikes for verdict in verdicts),
            largest=max(verdict.largest for verdict in verdicts),
            replaced=sum((verdict.replaced for verdict in verdicts), NOTHING_REPLACED),
            dependence=worst.dependence if robust else None,
        )

    def curve(self, options: CalibrationOptions) -> WaveletVariance:
        """Return the wavelet variance to fit: the mean over recordings, without the effect of conditions. "auto" is
        robust if bursts (motion, too many knocks) raise a classical curve, which has the covariance of heavy tails."""
        removed = {name: item for name, item in self.regressions.items() if item.applied}
        curves = self._curves(options)
        return pool({name: removed[name].corrected(wv) if name in removed else wv for name, wv in curves.items()})

    def raw_curve(self, options: CalibrationOptions) -> WaveletVariance | None:
        """Return the curve without the removal of conditions; None if nothing is removed or a curve is not known."""
        if not any(regression.applied for regression in self.regressions.values()):
            return None
        curves = self._curves(options)
        for name, regression in self.regressions.items():
            if regression.applied:
                if name not in self.raw:
                    return None
                curves[name] = self.raw[name]
        return pool(curves) if len({wv.robust for wv in curves.values()}) == 1 else None

    def _curves(self, options: CalibrationOptions) -> dict[str, WaveletVariance]:
        """Return the curve of each recording. Classical and robust curves cannot be pooled, so all are of one kind."""
        names = dict.fromkeys((*self.classical, *self.robust))
        robust = any(self._needs_robust(name, options) for name in names)
        curves = {name: (self.robust if robust else self.classical)[name] for name in names}
        for name, wv in curves.items():
            if not np.any(wv.variance > 0):
                error = DataError("the signal is constant", advice="Check whether the axis is connected.")
                raise error.at(name) if name else error
        return with_common_tails(curves)

    def _needs_robust(self, name: str, options: CalibrationOptions) -> bool:
        if name not in self.classical:
            return True
        if name not in self.robust and options.robust is True:
            raise DataError(
                "the wavelet variance is classical, but a robust one is required",
                advice="Pass the signal instead, or {--robust=auto}.",
            )
        if options.robust != "auto" or name not in self.robust:
            return bool(options.robust is True)
        return self.verdicts[name].contaminated and line_in(options.general) is None


class Measurements(NamedTuple):
    """Measured axes or errors; inspections of each recording's parts; findings of `recording_additions` by part."""

    axes: dict[str, MeasuredAxis | GmwmError]
    inspections: dict[str, list[Inspection]]
    findings: dict[str, list[tuple[object, ...]]]


def measure(recordings: Recordings, options: CalibrationOptions, run: Execution = IN_THIS_PROCESS) -> Measurements:
    """Measure the axes of recordings; OptionError if workers cannot read one, or `against` lacks samples."""
    if run.remote:
        _require_one_stream(recordings, "workers" if run.scheduler is None else "scheduler")
    parts: dict[str, list[MeasuredAxis | GmwmError]] = {axis: [] for axis in recordings.axes}
    accumulators: dict[str, list[AxisAccumulator]] = {axis: [] for axis in recordings.axes}
    inspections: dict[str, list[Inspection]] = {}
    findings: dict[str, list[tuple[object, ...]]] = {}
    for name in recordings.parts:
        measured, items, inspections[name], findings[name] = _measure_recording(
            name, recordings, options, run.with_name(name)
        )
        for axis in recordings.axes:
            parts[axis].append(measured[axis])
        for axis, item in items.items():
            accumulators[axis].append(item)
    swings = [swing for items in inspections.values() for item in items for swing in item.swings]
    days = {swing.axis: swing.lines() for swing in swings if len(recordings.parts) == 1}
    axes = in_threads(
        lambda axis, own: _together(own, accumulators[axis], days.get(axis, ())), parts, threads=run.threads
    )
    return Measurements(axes, inspections, findings)


def _measure_recording(
    name: str, recordings: Recordings, options: CalibrationOptions, run: Execution
) -> tuple[
    dict[str, MeasuredAxis | GmwmError], dict[str, AxisAccumulator], list[Inspection], list[tuple[object, ...]]
]:  # fmt: skip
    """Measure the axes of one recording without their spectrum, and return the accumulators of the spectra too."""
    accumulators: dict[str, AxisAccumulator] = {}
    shares: dict[str, MeasuredAxis] = {}
    inspections, findings = list[Inspection](), list[tuple[object, ...]]()
    pieces = deque(
        piece
        for part in recordings.parts[name]
        for piece in (repaired(part) if options.repeated == "auto" else (part,))
    )
    while pieces:
        part = pieces.popleft()
        axes = [axis for axis in recordings.axes if axis in part.axes]
        if not axes:
            continue  # repairs have divided the recording, and this part has only axes that are not calibrated
        _require_scales_between_gaps(part)
        if not any(part is original for original in recordings.parts[name]):
            run = replace(run, scheduler=None, workers=None)  # a repaired recording cannot be divided for processes
        conditions, passes = _read(part, axes, options, run)
        omitted, ranges = _motion_to_omit(passes) if options.repeated == "auto" else ([], ())
        if ranges:
            part, axes = _only({remark.subject for remark in omitted}, part, axes, pieces)
            offset = passes.inspection.time_base.left  # the time left out before the first sample
            part = without_times(part, 0.0, [(begin - offset, end - offset) for begin, end in ranges])
            run = replace(run, scheduler=None, workers=None)
            conditions, passes = _read(part, axes, options, run)
        steady = part
        jumps, notes = jumps_to_subtract(passes.inspection)
        if jumps and options.repeated == "auto" and not run.remote:
            steady = without_jumps(part, jumps, notes)
            conditions, passes = _read(steady, axes, options, run)
        inspection = passes.inspection
        if start := _warm_up(inspection, options):
            late = {trend.axis for trend in inspection.trends if trend.settles and not trend.is_small}
            if len(late) < len(part.axes):
                part, axes = _only(late, part, axes, pieces)
                steady = only_axes(steady, sorted(late))
            part, steady = without_times(part, start), without_times(steady, start)
            # A recording without its beginning cannot be divided into parts for other processes.
            conditions, passes = _read(steady, axes, options, replace(run, scheduler=None, workers=None))
            remarks = (*omission_remarks(inspection, start), *passes.inspection.remarks)
            inspection = replace(passes.inspection, remarks=remarks)
        remarks = (*omitted, *(r for r in inspection.remarks if not _is_motion(r) or _not_replaced(r, passes)))
        inspections.append(replace(inspection, remarks=remarks))
        findings.append(passes.findings)
        accumulators |= passes.axes
        beginnings = _beginnings(part, passes.axes, conditions)
        for axis in axes:
            regression, raw = conditions.found.get(axis), _raw(axis, part, conditions)
            shares[axis] = MeasuredAxis(
                axis=axis, regressions={} if regression is None else {name: regression},
                raw={} if raw is None else {name: raw},
                beginnings={name: beginnings[axis]} if axis in beginnings else {}
            )  # fmt: skip
    inspections = with_gravity(inspections)
    curves = recordings.curves[name]
    if curves and options.conditions.terms:
        raise _no_samples(*next(iter(curves.items())))
    means = means_of(inspections, options)

    def work(axis: str, item: Curve | AxisAccumulator) -> MeasuredAxis | GmwmError:
        try:
            part = _curves_of(axis, name, item, options, comparisons=recordings.comparisons)
        except GmwmError as error:
            return error
        if axis not in shares:
            return part
        share = shares[axis]
        return replace(
            part, regressions=share.regressions, raw=share.raw, means={name: means[axis]}, beginnings=share.beginnings
        )

    return in_threads(work, {**curves, **accumulators}, threads=run.threads), accumulators, inspections, findings


def _require_scales_between_gaps(part: Part) -> None:
    """Raise a DataError if gaps that are not filled leave no part with the scales that usable numbers need."""
    if not isinstance(part, Imu) or len(part.segments) < 2:
        return
    signal = part[part.axes[0]]
    ranges = Extent(signal.rate, signal.segments, signal.starts, signal.gaps_known).unbroken
    longest, least = max(last - first for first, last in ranges), 1 << LEAST_SCALES_FOR_USE
    if longest < least:
        raise DataError(
            f"the recording has {counted(len(ranges) - 1, 'gap')} with too few samples around them to be filled. The "
            f"longest part between them has {counted(longest, 'sample')}, and at least {least} are needed",
            argument="data", got=longest,
            advice="Find out why samples are lost, for example by a slow link or disk, and record again, if necessary "
            "at a lower rate.",
        )  # fmt: skip


def _only(names: Collection[str], part: Part, axes: Sequence[str], pieces: deque[Part]) -> tuple[Part, list[str]]:
    """Return the axes with a disturbance, which costs the others nothing: they are a further piece."""
    if others := [axis for axis in part.axes if axis not in names]:
        pieces.append(only_axes(part, others))
        part = only_axes(part, sorted(names))
    return part, [axis for axis in axes if axis in names]


def _read(part: Part, axes: Sequence[str], options: CalibrationOptions, run: Execution) -> tuple[Conditions, Passes]:
    """Return the conditions of a part of a recording, and the results of the passes over its samples."""
    conditions = Conditions.of_recording(part, options.conditions, threads=run.threads, curves=True)
    return conditions, read_recording(part, axes, options.efficiency, conditions=conditions, run=run)


def _is_motion(remark: Remark) -> bool:
    return remark.code == "recording-moved" and remark.facts["case"] == "moved"


def _not_replaced(motion: Remark, passes: Passes) -> tuple[tuple[float, float], ...]:
    """Return the ranges (s) of the motion of an axis that are not within one of its replaced knocks."""
    ranges: Any = motion.facts["ranges"]
    knocks = [times for axis, item in passes.axes.items() if axis == motion.subject for times in item.replaced.knocks]
    return tuple(span for span in ranges if not any(begin <= span[0] and span[1] <= end for begin, end in knocks))


def _motion_to_omit(passes: Passes) -> tuple[list[Remark], tuple[tuple[float, float], ...]]:
    """Return remarks on motion that is not replaced, and its ranges (s), if it is so rare that it can be left out."""
    moved = [remark for remark in passes.inspection.remarks if _is_motion(remark) and remark.subject in passes.axes]
    ranges = tuple(sorted({span for remark in moved for span in _not_replaced(remark, passes)}))
    if sum(end - begin for begin, end in ranges) > RARE * passes.inspection.duration or not ranges:
        return [], ()
    facts: dict[str, Any] = {"case": "excluded", "parts": range_texts(ranges), "ranges": ranges}
    return [Remark.of(remark.code, remark.subject, **facts) for remark in moved], ranges


def _warm_up(inspection: Inspection, options: CalibrationOptions) -> float:
    """Return the time (s) of a warm-up to leave out, or 0: arrays of covariates belong to the whole recording."""
    if options.warmup == "keep" or options.conditions.arrays:
        return 0.0
    return beginning_to_omit(inspection.trends, inspection.duration) or 0.0


def _require_one_stream(recordings: Recordings, argument: str) -> None:
    """Raise an OptionError if other processes cannot read the data."""
    if len(recordings.parts) > 1:
        raise OptionError(
            f"{argument} can be given for one recording only, and there are several", argument=argument,
            advice="Leave {--" + argument + "} out."
        )  # fmt: skip
    from gmwm.files.readers.streams import Stream

    if not all(isinstance(part, Stream) for part in recordings.parts[""]) or not recordings.parts[""]:
        raise OptionError(
            f"{argument} can be given for a stream only", argument=argument,
            advice="Pass a stream: `calibrate(gmwm.stream(path), …)`."
        )  # fmt: skip


def _no_samples(axis: str, item: Curve) -> OptionError:
    """Return the error for conditions of an axis that was given as curves."""
    kind = "WaveletVariance" if isinstance(item, WaveletVariance) else "pair of curves"
    return OptionError(
        f"against needs the samples; {axis} is a {kind}",
        argument="against",
        advice="Pass signals, or leave {--against} out.",
    )


def _curves_of(
    axis: str, name: str, item: Curve | AxisAccumulator, options: CalibrationOptions, *, comparisons: int
) -> MeasuredAxis:
    """Return the wavelet variances of one axis of one recording, with their test for outliers."""
    if isinstance(item, WaveletVariance):
        curve = {name: item}
        return MeasuredAxis(axis=axis, classical={} if item.robust else curve, robust=curve if item.robust else {})
    screen: Screen | None = None
    if isinstance(item, AxisAccumulator):
        assert item.curves is not None
        with item.turn:
            screen = item.screen()
            classical, robust = item.curves.classical(), item.curves.robust()
            # The screening accounts for heavy tails, so a smaller excess of the classical curve is significant.
            verdict = contamination((classical, robust), comparisons=comparisons, tolerance=MATERIAL, screen=screen)
            if verdict.contaminated:
                other = item.curves.first.result(robust=True, efficiency=other_efficiency(options.efficiency))
                verdict = replace(verdict, dependence=dependence(robust, other, verdict))
            if item.two_levels:
                verdict = replace(verdict, contaminated=False)
            classical = replace(classical, excess=screen.tails.excess(classical))
            item.curves = None  # their samples are not needed any more
            return_memory()
    else:
        assert isinstance(item, tuple)
        classical, robust = item
        verdict = contamination(item, comparisons=comparisons, tolerance=TOLERANCE)
    return MeasuredAxis(axis=axis, classical={name: classical}, robust={name: robust}, verdicts={name: verdict})


def _raw(axis: str, part: Part, conditions: Conditions) -> WaveletVariance | None:
    """Return the curve with the effect of conditions; None if none is removed, or if it is not known."""
    if conditions.applied_regression(axis) is None:
        return None
    return wavelet_variance(part.signals[axis]) if isinstance(part, Imu) else conditions.raw.get(axis)


def _beginnings(part: Part, items: Mapping[str, AxisAccumulator], conditions: Conditions) -> dict[str, Signal]:
    """Return the first samples for the additions, with short gaps filled, and without wrong ones and knocks, which a
    monitor must report. The effect of conditions stays, as in a monitor; if it was removed, they are read again."""
    beginnings = {
        axis: item.beginning
        for axis, item in items.items()
        if item.beginning is not None and conditions.applied_regression(axis) is None
    }
    again = [axis for axis in items if axis not in beginnings]
    if not again:
        return beginnings
    signals = _first_samples(part)
    return beginnings | fill_gaps({axis: clean(part_of(signals[axis], 0, needed_beginning())) for axis in again})


def _first_samples(recording: Part) -> Mapping[str, Signal]:
    """Return the signals of a recording by axis, at least up to the last sample that an addition needs."""
    parts: list[Batch] = []
    for batch in batches(recording):
        parts.append(batch)
        if batch.stop >= needed_beginning():
            break
    return join_batches(parts).signals


def _together(
    parts: Sequence[MeasuredAxis | GmwmError], accumulators: Sequence[AxisAccumulator], day: tuple[Line, ...]
) -> MeasuredAxis | GmwmError:
    """Return one axis of all recordings with its spectrum and a day's lines, or the first error."""
    mappings: dict[str, dict[str, Any]] = {}
    for part in parts:
        if isinstance(part, GmwmError):
            return part
        for entry in fields(part):
            if isinstance(values := getattr(part, entry.name), Mapping):
                mappings.setdefault(entry.name, {}).update(values)
        axis = part.axis
    first, others = accumulators[:1], accumulators[1:]
    spectrum = first[0].spectrum(others) if first else None
    if spectrum is not None and day:
        spectrum = replace(spectrum, lines=(*day, *spectrum.lines))
    return MeasuredAxis(axis=axis, spectrum=spectrum, **mappings)
