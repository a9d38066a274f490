"""Repair a recording in memory or in a file."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from gmwm.base.arrays import Vector, freeze
from gmwm.base.remarks import Fact, Quantity, Remark
from gmwm.base.time_base import TimeBase
from gmwm.recording.batches import Streamed, batches
from gmwm.recording.chunks import Samples, samples_of, time_base_of, with_samples
from gmwm.recording.repairs.averages import SteepFilter, averaged, steep_filters
from gmwm.recording.repairs.plan import RepairPlan, plans_of
from gmwm.recording.repairs.repeats import Indices
from gmwm.recording.repairs.stage import Stage
from gmwm.recording.signals import Imu
from gmwm.recording.time_ranges import cut_base


def repaired(recording: Imu | Streamed) -> tuple[Imu | Streamed, ...]:
    """Return a recording without the logger's faults that can be undone, as the first batch decides. It is divided if
    sensors have different rates. Remarks of the results say what was changed."""
    batch = next(batches(recording))
    rows = len(recording) if isinstance(recording, Imu) else recording.rows
    base = recording.time_base
    plans = plans_of(batch, 0.0 if base is None else base.duplicates / max(rows, 1))
    return tuple(
        averaged(part, min(steep.length for steep in filters.values()), {axis: s.memory for axis, s in filters.items()})
        if filters
        else part
        for plan in plans
        for filters, part in _by_filter(recording, plan, alone=len(plans) == 1)
    )


def _by_filter(
    recording: Imu | Streamed, plan: RepairPlan, *, alone: bool
) -> Iterator[tuple[dict[str, SteepFilter], Imu | Streamed]]:
    """Yield the repaired axes of a plan that passed a steep filter, with these filters, and the other axes."""
    part = recording if alone and plan.changes_nothing else _of_plan(recording, plan)
    filters = {axis: steep for axis, steep in steep_filters(next(batches(part))).items() if steep.length > 1}
    others = [axis for axis in part.axes if axis not in filters]
    if not filters or not others:
        yield filters, part
        return
    yield filters, _of_plan(recording, plan.of(list(filters)))
    yield {}, _of_plan(recording, plan.of(others))


def _of_plan(recording: Imu | Streamed, plan: RepairPlan) -> Imu | Streamed:
    return _repaired_imu(recording, plan) if isinstance(recording, Imu) else RepairedStream(recording, plan)


def only_axes(recording: Imu | Streamed, axes: Sequence[str]) -> Imu | Streamed:
    """Return some axes of a recording."""
    return recording[list(axes)] if isinstance(recording, Imu) else _of_plan(recording, RepairPlan(axes=tuple(axes)))


class Repair:
    """One pass over the samples of a recording that applies a plan, and counts what it changed."""

    def __init__(self, plan: RepairPlan, rate: float) -> None:
        self.plan, self.rate = plan, rate / plan.every
        self.starts, self.sizes = list[float](), list[int]()
        self._counts = dict.fromkeys(("repeated", "frozen", "interpolated", "wrapped"), 0)
        self._old_rate, self._all = rate, 0
        self._frozen = 0, 0  # longest run of frozen samples, and length of the one at the end
        self._last = -1  # number of the last sample that was kept
        self._begins = list[int]()  # segments that began after it

    def apply(self, samples: Iterable[Samples], reach: int) -> Iterator[Samples]:
        """Yield the kept samples; `reach` samples on each side decide about one, 0 if all arrive together."""
        window, passed = None, 0
        for chunk in samples:
            window = chunk if window is None else _joined(window, chunk)
            stop = window.first + len(window) - reach
            if stop > passed:
                yield from self._between(window, passed, stop)
                window, passed = _from(window, stop - reach), stop
        if window is not None and passed < window.first + len(window):
            yield from self._between(window, passed, window.first + len(window))

    def _between(self, window: Samples, first: int, stop: int) -> Iterator[Samples]:
        """Yield the samples that are kept of those with the numbers first … stop − 1."""
        plan = self.plan
        begins = [sample for sample, _ in window.runs if sample >= window.first]
        masks = plan.left_out(
            window.values, np.unique([0, *(sample - window.first for sample in begins)]), window.first
        )
        a, b = first - window.first, stop - window.first
        self._all += b - a
        left_out = np.arange(first, stop) < plan.dead
        alive = ~left_out
        for name, mask in masks.items():
            new = mask[a:b] & ~left_out
            self._counts[name] += int(np.count_nonzero(new))
            if name == "frozen":
                lengths = np.diff(np.flatnonzero(np.concatenate([[True], ~(mask[a:b] & alive), [True]]))) - 1
                lengths[0] += self._frozen[1]  # of a run that began before
                self._frozen = max(self._frozen[0], int(np.max(lengths))), int(lengths[-1])
            left_out |= new
        numbers = first + np.flatnonzero(~left_out)
        if numbers.size:
            runs = self._divided(numbers, window)
            at = numbers - window.first
            count = sum(self.sizes) - numbers.size
            heat = None if window.temperature is None else window.temperature[at]
            values = {axis: self._unwrapped(axis, window.values[axis][at]) for axis in plan.axes}
            first_segment = len(self.sizes) - len(runs)
            yield Samples(values, self.rate, first=count, segment=first_segment, runs=tuple(runs), temperature=heat)
        self._begins = [begin for begin in begins if begin < stop and begin > self._last]

    def _unwrapped(self, axis: str, values: Vector) -> Vector:
        """Return the values of an axis with overflows undone, and count them."""
        values = self.plan.whole_counts(axis, values)
        changed = self.plan.unwrapped(axis, values)
        if axis in self.plan.wraps:
            self._counts["wrapped"] += int(np.count_nonzero(changed != values))
        return freeze(np.ascontiguousarray(changed))

    def _divided(self, numbers: Indices, window: Samples) -> list[tuple[int, float]]:
        """Divide samples with these numbers into runs without a gap; return their new numbers and first times."""
        every = self.plan.every
        begins = np.array(sorted({*self._begins, *(sample for sample, _ in window.runs)}), dtype=np.int64)
        before = np.append(self._last, numbers[:-1])
        seams = np.searchsorted(begins, numbers, "right") > np.searchsorted(begins, before, "right")
        # A log that is not a whole number of times faster repeats a value one time more or less.
        usual = every + (0.75 * every if every == round(every) else 1.5)
        lost = np.maximum(np.rint((numbers - before) / every).astype(np.int64) - 1, 1)
        new = np.flatnonzero(seams | (numbers - before >= usual))
        count, runs = sum(self.sizes), list[tuple[int, float]]()
        continued = int(new[0]) if new.size else numbers.size
        if continued:
            runs.append((count - self.sizes[-1], self.starts[-1]))
            self.sizes[-1] += continued
        for place, end in pairwise([*new.tolist(), numbers.size]):
            if seams[place]:
                time = _time_of(window, int(numbers[place]))
            else:
                time = self.starts[-1] + (self.sizes[-1] + int(lost[place])) / self.rate
            self.starts.append(time)
            self.sizes.append(end - place)
            runs.append((count + place, time))
        self._last = int(numbers[-1])
        return runs

    def time_base(self, base: TimeBase) -> TimeBase:
        """Return the time base of the samples that were kept. Call it after the last batch."""
        beginning = base.left + self.plan.dead / self._old_rate
        base = replace(base, rate=self.rate, duplicates=0 if self.plan.repeats else base.duplicates)
        return cut_base(base, self.starts, self.sizes, beginning)

    def remarks(self) -> tuple[Remark, ...]:
        """Return remarks on what was changed. Call it after the last batch."""
        plan, counts, old = self.plan, self._counts, self._old_rate
        cases: dict[str, tuple[Iterable[str], dict[str, Fact]]] = {}
        if plan.repeats is not None and plan.repeats.kind == "held":
            facts: dict[str, Fact] = {
                "times": plan.every,
                "rate": Quantity(self.rate, "Hz"),
                "log": Quantity(old, "Hz"),
            }
            cases["held"] = plan.axes, facts
        elif plan.repeats is not None and plan.repeats.kind == "twice":
            cases["twice"] = ("",), {"count": counts["repeated"]}
        elif plan.repeats is not None and plan.repeats.kind == "lost":
            cases["repeated"] = plan.axes, self._count_and_share("repeated")
        if counts["frozen"]:
            time, longest = Quantity(counts["frozen"] / old, "s"), Quantity((self._frozen[0] + 1) / old, "s")
            cases["frozen"] = (
                plan.frozen or plan.axes,
                {"time": time, "longest": longest, "share": 100 * counts["frozen"] / self._all},
            )
        if counts["interpolated"]:
            cases["interpolated"] = plan.straight, self._count_and_share("interpolated")
        if plan.dead:
            cases["dead"] = plan.axes, {"time": Quantity(plan.dead / old, "s")}
        if plan.wraps:
            cases["wrapped"] = plan.wraps, {"count": counts["wrapped"]}
        undone = [
            Remark.of("fault-undone", axis, case=case, **facts)
            for case, (axes, facts) in cases.items()
            for axis in axes
        ]
        return (*undone, *self.remarks_before())

    def remarks_before(self) -> tuple[Remark, ...]:
        """Return the remarks that are known before the samples are read: on two levels, and on a slower log."""
        slower = (
            Remark.of("fault-undone", axis, case="resampled", rate=Quantity(share * self._old_rate, "Hz"),
                      log=Quantity(self._old_rate, "Hz"))
            for axis, share in self.plan.resampled.items()
        )  # fmt: skip
        return *slower, *(
            Remark.of("heavy-tails", axis, case="levels", share=100 * levels.share,
                      duration=Quantity(levels.duration / self.rate, "s"))
            for axis, levels in self.plan.levels.items()
        )  # fmt: skip

    def _count_and_share(self, name: str) -> dict[str, Fact]:
        return {"count": self._counts[name], "share": 100 * self._counts[name] / self._all}


class RepairedStream(Stage):
    """A recording in a file whose samples are repaired while they are read."""

    def __init__(self, stream: Streamed, plan: RepairPlan) -> None:
        super().__init__(stream, plan.axes, plan.every)
        self._plan, self._remarks = plan, Repair(plan, stream.rate).remarks_before()

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples that are kept."""
        repair = Repair(self._plan, self._stream.rate)
        yield from repair.apply(self._stream.samples(), self._plan.reach)
        self._remarks, self._base = repair.remarks(), repair.time_base(self._stream.time_base)


def _repaired_imu(imu: Imu, plan: RepairPlan) -> Imu:
    repair = Repair(plan, imu.rate)
    (part,) = repair.apply([samples_of(imu, plan.axes)], 0)
    return with_samples(imu, part, repair.time_base(time_base_of(imu)), repair.remarks())


def _joined(before: Samples, after: Samples) -> Samples:
    """Return consecutive samples as one."""
    axes: Sequence[str] = tuple(before.values)
    return Samples(
        {axis: np.concatenate([before.values[axis], after.values[axis]]) for axis in axes}, before.rate,
        first=before.first, segment=before.segment,
        runs=(*before.runs, *(after.runs[1:] if after.continues else after.runs)),
        temperature=None if before.temperature is None or after.temperature is None
        else np.concatenate([before.temperature, after.temperature]),
    )  # fmt: skip


def _from(samples: Samples, first: int) -> Samples:
    """Return the samples from number `first` on."""
    skip = max(first - samples.first, 0)
    at = max(k for k, (sample, _) in enumerate(samples.runs) if sample <= samples.first + skip)
    return Samples(
        {axis: values[skip:] for axis, values in samples.values.items()}, samples.rate, first=samples.first + skip,
        segment=samples.segment + at, runs=samples.runs[at:],
        temperature=None if samples.temperature is None else samples.temperature[skip:],
    )  # fmt: skip


def _time_of(samples: Samples, number: int) -> float:
    """Return the time (s) of a sample."""
    sample, time = next(run for run in reversed(samples.runs) if run[0] <= number)
    return time + (number - sample) / samples.rate
