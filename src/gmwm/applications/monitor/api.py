"""Monitor a sensor at rest, and report changes since its calibration."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import ArrayLike

from gmwm.applications.monitor.axis import NAMING_S, Event, Fault, MonitoredAxis, Stillness, naming_time
from gmwm.applications.monitor.baseline import (
    Baseline,
    as_every,
    baselines_of,
    check_rate,
    checked_samples,
    chunks_of,
    common_rate,
    models_of,
    remarks_of,
)
from gmwm.applications.monitor.charts import LONGEST_PAUSE_S, Alarm, ChartSettings
from gmwm.applications.monitor.whitening import Finite, Gain, number, require_scale, whole
from gmwm.base.arrays import Vector, as_whole_number
from gmwm.base.documents import plain, plain_fields
from gmwm.base.errors import ReadError
from gmwm.base.kinds import Document
from gmwm.base.threads import OneAtATime, one_at_a_time
from gmwm.base.time_base import lost_samples
from gmwm.base.units import AXES, SI_UNIT, axis_quantity
from gmwm.recording.chunks import Chunk

if TYPE_CHECKING:
    from typing_extensions import Self

    from gmwm.files.readers.streams import Stream
    from gmwm.recording.signals import Imu

_PER_SECOND = {"rad/s": "rad/s²", "m/s²": "m/s³"}


@dataclass(frozen=True)
class SampleClock:
    """Conversion of the sample numbers of a monitor to times."""

    rate: float  # Hz
    runs: tuple[tuple[int, float], ...]  # number and time (s) of the first sample after each gap, for the last gaps

    def time(self, sample: int) -> float:
        """Return the time (s) of a sample."""
        first, time = next((run for run in reversed(self.runs) if run[0] <= sample), self.runs[0])
        return time + (sample - first) / self.rate

    def after_gap(self, sample: int, time: float) -> SampleClock:
        """Return the clock after a gap, if sample number `sample` is the next one and has the given time (s)."""
        return SampleClock(self.rate, (*self.runs[-15:], (sample, time)))  # an event may begin before the last gaps

    def event(self, axis: str, fault: Fault, first: Alarm) -> Event:
        """Return the event that reports a fault of an axis, in SI units. `first` is its first alarm."""
        unit = SI_UNIT[axis_quantity(axis)] if axis in AXES else ""
        size = fault.size
        if size is not None and fault.kind == "ramp":
            size, unit = size * self.rate, _PER_SECOND.get(unit, "")
        time = self.time(first.sample)
        return Event(
            kind=fault.kind, time=time, began=min(self.time(max(fault.onset, 0)), time), axis=axis, level=fault.level,
            scale=None if not fault.level or fault.ratio is None else (1 << fault.level) / self.rate, size=size,
            unit=unit if size is not None else "", ratio=fault.ratio,
            frequency=None if fault.cycles is None else fault.cycles * self.rate,
        )  # fmt: skip


HOLD_S = 60.0
"""Further alarms of an axis are attributed to a reported fault for at least this time (s) after its last alarm."""
REMEMBERED_S = 3600.0
"""A fault that recurs within this time (s) is not reported again, unless it is larger. A jump is always reported."""
FORMAT = "gmwm-monitor"


class Monitor(OneAtATime):
    """Monitor a sensor at rest, and report when its noise or its level changes.

    A Kalman filter with the model of each axis computes the standardised innovations of its samples. At each scale,
    CUSUM charts monitor the mean squares of the Haar wavelet coefficients of the innovations, and their block means.
    Other charts monitor single innovations and runs of equal samples. An event is reported one second after the first
    alarm, or up to a minute after it for a slow change of the level. During this time, the monitor determines the kind
    of the fault.

    The events do not depend on how the samples are divided into chunks. A monitor can be pickled, or written as JSON
    with `to_dict`. A restored monitor continues from the same state.

    Parameters
    ----------
    calibration : Calibration, or mapping of axis to Fit, Model or str
        The model of each axis, with all values. Power-law noise, which has no finite state, is approximated by
        Gauss-Markov processes.
    every : str or float
        Average time between false alarms of a healthy sensor, for all axes together: a number of seconds, or text such
        as "30d".
    rate : float, optional
        Sampling rate (Hz); by default the rate of the calibration.
    baseline : mapping of axis to Baseline, or None, optional
        Statistics of the innovations of the healthy sensor; by default those in the calibration. With None, the signal
        is compared with the model only. Real sensors never follow a model exactly, so false alarms are then more
        frequent.
    axes : sequence of str, optional
        The axes to monitor; all by default.
    start : float
        Time of the first sample (s).

    Attributes
    ----------
    models : dict of str to Model
        The model of each axis.
    baselines : dict of str to Baseline
        The baseline of each axis that has one.
    remarks : tuple of Remark
        Remarks about the charts, for example on an axis without a baseline.

    Raises
    ------
    OptionError
        If an argument is invalid.
    ModelError
        If a parameter of a model has no value, or a model has no noise.

    Examples
    --------
    >>> from gmwm import Model, Monitor
    >>> model = Model.parse("WN(sigma2=1e-6) + RW(gamma2=1e-12)")
    >>> monitor = Monitor({"gyro_x": model}, rate=100.0)
    >>> x = model.simulate(60_000, 100.0, rng=1)
    >>> x[50_000:] += 0.005
    >>> for event in monitor.update({"gyro_x": x}):
    ...     print(event)
    500.0 s  gyro_x  level jumped by 0.28 deg/s (began 500.0 s)

    References
    ----------
    Page (1954), Continuous inspection schemes, Biometrika 41, 100-115; Lorden (1971), Annals of Mathematical Statistics
    42, 1897-1908; Siegmund (1985), Sequential Analysis.
    """

    def __init__(
        self, calibration: Mapping[str, Any], every: str | float = "30d", *, rate: float | None = None,
        baseline: Mapping[str, Baseline] | Literal["auto"] | None = "auto", axes: Sequence[str] | None = None,
        start: float = 0.0,
    ) -> None:  # fmt: skip
        models = models_of(calibration, axes)
        self.rate = common_rate(calibration, rate)
        self.every = as_every(every)
        self.baselines = baselines_of(calibration, baseline, list(models))
        self.models = models
        gains = {axis: Gain.of(Finite.of(model, self.rate)) for axis, model in models.items()}
        self.remarks = tuple(remarks_of(gains, self.baselines, wanted=baseline is not None))
        usual = ChartSettings.of_model(self.rate)
        settings = {axis: self.baselines[axis].settings() if axis in self.baselines else usual for axis in models}
        charts = sum(charts_of.charts for charts_of in settings.values())
        # Events per alarm of a chart: neighbouring levels raise alarms together (docs/validation/monitor.md).
        self.run_length = 0.7 * self.every * self.rate * charts
        self._naming = max(round(NAMING_S * self.rate), 1)
        longest = max(round(LONGEST_PAUSE_S * self.rate), self._naming)
        self._axes = {
            axis: MonitoredAxis(
                gains[axis], settings[axis], run_length=self.run_length, rest=self._naming, longest_rest=longest
            )
            for axis in models
        }
        self._clock = SampleClock(self.rate, ((0, float(start)),))
        self._count = 0
        self._pool: tuple[tuple[str, Alarm], ...] = ()
        self._deadline: int | None = None
        self._moved: Stillness | None = None
        self._lost_until = -1
        self._lost = 0
        self._segment: int | None = None

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes."""
        return tuple(self._axes)

    @property
    def samples(self) -> int:
        """Number of samples that the monitor has received."""
        return self._count

    @property
    def lost(self) -> int:
        """Number of samples that are known to be missing, in all gaps. Only the first gap in a minute is an event."""
        return self._lost

    @property
    def _now(self) -> float:
        """Time of the next sample (s)."""
        return self._clock.time(self._count)

    @property
    def resting(self) -> bool:
        """Whether the charts are paused because the unit was moved and is not yet at rest again."""
        return self._moved is not None

    @property
    def moving_for(self) -> float:
        """Time (s) for which the charts have been paused because of the present motion."""
        return 0.0 if self._moved is None else self._moved.samples / self.rate

    def heights(self) -> dict[str, dict[str, float]]:
        """Return the largest values of the chart statistics during the last update, as fractions of their thresholds.

        The keys are the axes and, for each axis, the families of charts."""
        return {axis: monitored.charts.heights() for axis, monitored in self._axes.items()}

    @one_at_a_time
    def update(self, values: Mapping[str, ArrayLike] | Chunk) -> list[Event]:
        """Add the next samples of all axes, in rad/s and m/s².

        Parameters
        ----------
        values : mapping of axis to (n,) array, or Chunk
            Samples without a gap. Axes without a model are ignored. A chunk of `gmwm.stream` contains the information
            about gaps before it.

        Returns
        -------
        list of Event
            The events that were detected with these samples, in order of time.

        Raises
        ------
        DataError
            If an axis is missing, if the axes have different lengths, or if a value is not finite.
        """
        events: list[Event] = []
        if isinstance(values, Chunk):
            events += self._join(values)
            values = values.values
        arrays = checked_samples(self.axes, values)
        n = next(iter(arrays.values())).size
        for monitored in self._axes.values():
            monitored.charts.forget_peaks()
        at = 0
        while at < n:
            stop = min(n, at + (1 << 16))  # the result does not depend on the number of samples in a step
            if self._moved is not None:
                at += self._rest({axis: x[at:stop] for axis, x in arrays.items()}, events)
                continue
            if self._deadline is not None:
                stop = min(stop, at + self._deadline - self._count)
            at += self._advance({axis: x[at:stop] for axis, x in arrays.items()}, events)
        return events

    def watch(self, recording: Imu | Stream) -> Iterator[Event]:
        """Monitor a whole recording with its gaps. Faults that are still undetermined at its end are reported there.

        Parameters
        ----------
        recording : Imu or Stream
            A recording from `gmwm.read` or `gmwm.stream`.

        Returns
        -------
        iterator of Event
            Each event as soon as its kind is determined.
        """
        check_rate(recording.rate, self.rate)
        for chunk in chunks_of(recording):
            yield from self.update(chunk)
        yield from self.finish()

    @one_at_a_time
    def gap(self, samples: int | None = None) -> list[Event]:
        """Tell the monitor that samples are missing before the next update.

        Parameters
        ----------
        samples : int, optional
            Number of missing samples, if it is known.

        Returns
        -------
        list of Event
            The faults that were still undetermined, and the event "lost", unless lost samples were reported in the last
            minute.
        """
        if samples is not None:
            samples = as_whole_number(samples, "samples", 1)
        events = self.finish()
        time = self._now
        return events + self._after_gap(time + (samples or 0) / self.rate, samples)

    @one_at_a_time
    def skip(self, samples: int) -> None:
        """Leave out samples that should not be monitored, for example while the unit is moved on purpose.

        Afterwards, the level is unknown and all charts start at 0. Alarms that were not yet reported as a fault are
        discarded.

        Parameters
        ----------
        samples : int
            Number of samples to leave out.
        """
        samples = as_whole_number(samples, "samples", 0)
        self._pool, self._deadline, self._moved = (), None, None
        for axis in self._axes.values():
            axis.charts.skip(samples)
            axis.begin_again()
        self._count += samples

    @one_at_a_time
    def finish(self) -> list[Event]:
        """Determine and return the faults of pending alarms at the end of the samples."""
        events: list[Event] = []
        if self._deadline is not None:
            self._decide(events)
        return events

    def _join(self, chunk: Chunk) -> list[Event]:
        """Return the events that a gap before a chunk of a stream causes."""
        segment, self._segment = self._segment, chunk.segment
        if segment is None:
            if self._count == 0:
                self._clock = SampleClock(self.rate, ((0, chunk.start),))
            return []
        if segment == chunk.segment:
            return []
        events = self.finish()
        expected = self._now
        late = int(lost_samples(chunk.start - expected, self.rate))
        if chunk.start < expected - 0.5 / self.rate:
            # After the clock was set back, times follow the new time stamps.
            event = Event(kind="clock", time=expected, began=expected, size=expected - chunk.start, unit="s")
            return [*events, event, *self._after_gap(chunk.start, None, told=True)]
        return events + self._after_gap(chunk.start, late if late >= 1 else None)

    def _after_gap(self, time: float, samples: int | None, *, told: bool = False) -> list[Event]:
        before = self._now
        self._lost += samples or 0
        for axis in self._axes.values():
            axis.gap(samples)
        if self._moved is not None:
            self._moved = self._moved.broken()
        self._clock = self._clock.after_gap(self._count, time)
        if told:
            return []
        earlier, self._lost_until = self._lost_until, self._count + round(HOLD_S * self.rate)
        if self._count <= earlier:
            return []
        size = None if samples is None else float(samples)
        return [Event(kind="lost", time=before, began=before, size=size, unit="samples")]

    def _advance(self, parts: Mapping[str, Vector], events: list[Event]) -> int:
        """Process samples up to the time at which pending alarms are evaluated, and return their number."""
        n = next(iter(parts.values())).size
        before = {axis: monitored.save() for axis, monitored in self._axes.items()}
        alarms = self._alarms(parts)
        if self._deadline is None and alarms:
            deadline = alarms[0][1].sample + naming_time(alarms[0][1], self.rate)
            if deadline < self._count + n:
                # Later samples are processed after the evaluation, which may reset the charts.
                for axis, monitored in self._axes.items():
                    monitored.load(before[axis])
                n = deadline - self._count
                alarms = self._alarms({axis: x[:n] for axis, x in parts.items()})
            self._deadline = deadline
        self._pool = (*self._pool, *alarms)
        self._count += n
        if self._deadline is not None and self._count >= self._deadline:
            self._decide(events)
        return n

    def _alarms(self, parts: Mapping[str, Vector]) -> list[tuple[str, Alarm]]:
        alarms = [(axis, alarm) for axis, monitored in self._axes.items() for alarm in monitored.update(parts[axis])]
        return sorted(alarms, key=lambda item: item[1].sample)

    def _rest(self, parts: Mapping[str, Vector], events: list[Event]) -> int:
        """Process samples of a moving unit, and return their number. The charts restart when the unit is at rest."""
        assert self._moved is not None
        used, self._moved, still = self._moved.update(parts, self._axes, self._naming)
        for axis in self._axes.values():
            axis.charts.skip(used)
        self._count += used
        if still:
            self._moved = None
            for axis in self._axes.values():
                axis.begin_again()
            time = self._now
            events.append(Event(kind="still", time=time, began=time))
        return used

    def _decide(self, events: list[Event]) -> None:
        """Determine the faults of all pending alarms, and append their events."""
        pool, self._pool, self._deadline = self._pool, (), None
        by_axis: dict[str, list[Alarm]] = {}
        for axis, alarm in pool:
            by_axis.setdefault(axis, []).append(alarm)
        faults = {axis: self._axes[axis].name(alarms) for axis, alarms in by_axis.items()}
        hold = round(HOLD_S * self.rate)
        moving = [axis for axis, fault in faults.items() if fault.is_motion or self._axes[axis].is_loud(self._naming)]
        # An axis with a reported fault raises no new alarm, but large innovations show that it moves too.
        others = [
            axis for axis, monitored in self._axes.items() if axis not in faults and monitored.is_loud(self._naming)
        ]
        loud = {axis.partition("_")[0] for axis in (*moving, *others)}
        still = [axis for axis in self._axes if axis.partition("_")[0] not in loud]
        # Noise of one sensor beside another one at rest is no motion, but for example a wrong unit.
        noisy = len(still) >= 3 and all(faults[axis].kind == "noise-up" for axis in moving)
        # During warm-up, several axes drift together, without a motion that a second of data shows.
        drifting = all(
            axis in faults and faults[axis].kind == "ramp" and not self._axes[axis].is_loud(self._naming)
            for axis in moving
        )
        if len(moving) + len(others) >= 3 and not noisy and not drifting:  # axes change together: the unit was moved
            first = min(alarm.sample for axis in moving for alarm in by_axis[axis])
            onset = min(faults[axis].onset for axis in moving)
            events.append(Event(kind="moved", time=self._clock.time(first), began=self._clock.time(onset)))
            for monitored in self._axes.values():
                monitored.report("moved", (), hold=hold)
            self._moved = Stillness()
            faults = {axis: fault for axis, fault in faults.items() if axis not in moving}
        for axis, fault in faults.items():
            remembered = round(REMEMBERED_S * self.rate)
            new = self._axes[axis].report(
                fault.kind, by_axis[axis], hold=hold, remembered=remembered, magnitude=fault.magnitude
            )
            if new:
                events.append(self._clock.event(axis, fault, by_axis[axis][0]))

    @one_at_a_time
    def to_dict(self) -> dict[str, Any]:
        """Return the settings and the state of the monitor as dicts, lists, numbers and strings for JSON."""
        state = {
            "axes": {axis: monitored.save() for axis, monitored in self._axes.items()}, "runs": self._clock.runs,
            "count": self._count, "pool": self._pool, "deadline": self._deadline, "moved": self._moved,
            "lost_until": self._lost_until, "lost": self._lost, "segment": self._segment,
        }  # fmt: skip
        models = {axis: str(model) for axis, model in self.models.items()}
        return {
            "format": FORMAT, "version": 1, **plain_fields(self, "every rate"), "models": models,
            "baselines": plain(self.baselines), "state": plain(state),
        }  # fmt: skip

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Self:
        """Create a monitor that continues from the `content` that `to_dict` returned, also after a trip through JSON.

        Other content raises a ReadError."""
        if not isinstance(content, Mapping) or content.get("format") != FORMAT:
            raise ReadError(f'not a monitor: it has no "format": "{FORMAT}"')
        with Document("monitor", "Make a new monitor from the calibration.").reading():
            baselines = {axis: Baseline.from_dict(item) for axis, item in content["baselines"].items()}
            monitor = cls(content["models"], content["every"], rate=content["rate"], baseline=baselines)
            monitor._restore(content["state"])
            if monitor._deadline is not None and (monitor._deadline <= monitor._count or not monitor._pool):
                raise ValueError("the deadline must come after the samples so far, and needs an alarm")
            for axis, item in monitor._axes.items():
                require_scale(axis, item.whitener.gain.S)
        return monitor

    def _restore(self, state: Mapping[str, Any]) -> None:
        for axis, monitored in self._axes.items():
            monitored.load(state["axes"][axis])
        self._clock = SampleClock(self.rate, tuple((whole(sample), number(time)) for sample, time in state["runs"]))
        if not self._clock.runs:
            raise ValueError("runs must not be empty")
        self._count = whole(state["count"])
        self._deadline = None if state["deadline"] is None else whole(state["deadline"])
        self._pool = tuple((axis, Alarm(*alarm)) for axis, alarm in state["pool"])
        self._moved = None if state["moved"] is None else Stillness.from_dict(state["moved"])
        if self._moved is not None and self._moved.held and set(self._moved.held) != set(self._axes):
            raise ValueError("held must have all axes")
        self._lost_until, self._lost = whole(state["lost_until"]), whole(state["lost"])
        self._segment = None if state["segment"] is None else whole(state["segment"])

    def __repr__(self) -> str:
        return f"Monitor({', '.join(self.axes)} at {self.rate:g} Hz: {self.samples} samples)"
