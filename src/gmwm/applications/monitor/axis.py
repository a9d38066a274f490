"""One axis of a monitor: its filter, charts and present fault, and the events that follow from alarms."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np

from gmwm.applications.monitor.charts import HISTORY_LEVEL, Alarm, Charts, ChartSettings
from gmwm.applications.monitor.whitening import Gain, Whitener, number, numbers, whole
from gmwm.base.arrays import Vector
from gmwm.base.documents import plain_fields
from gmwm.base.errors import ReadError
from gmwm.base.text import counted, round_text, with_minus

Kind = Literal[
    "noise-up", "noise-down", "jump", "ramp", "hum", "spike", "frozen", "saturated", "lost", "clock", "moved", "still"
]  # fmt: skip
"""Kinds of events; see `Event`."""
KINDS: tuple[Kind, ...] = get_args(Kind)
SHOWN = {"rad/s": ("deg/s", 180.0 / math.pi), "rad/s²": ("deg/s²", 180.0 / math.pi)}
"""Displayed unit for each SI unit, with the conversion factor."""


@dataclass(frozen=True, kw_only=True)
class Event:
    """A change of a sensor that a monitor has detected.

    Attributes
    ----------
    kind : str
        Kind of the change. "noise-up" and "noise-down": the noise is larger or smaller at the scale `scale`. "jump" and
        "ramp": the level changed suddenly, or changes steadily. "hum": a sinusoid appeared. "spike": single samples are
        wrong. "frozen": all samples are equal. "saturated": all samples are equal and outside the usual range. "lost":
        samples are missing. "clock": the time stamps went back. "moved": three axes changed within a second, not by
        drifts. "still": the unit is at rest again.
    time : float
        Time (s) at which a chart statistic exceeded its threshold.
    began : float
        Estimated time (s) at which the change began.
    axis : str
        Name of the axis; an empty string for the whole unit.
    level : int or None
        Haar level of the chart that raised the alarm.
    scale : float or None
        Scale τ = 2^level samples (s) at which the noise changed.
    size : float or None
        Size of a jump or a spike, slope of a ramp, amplitude of a hum, step of the clock, or number of lost samples, in
        `unit`.
    unit : str
        Unit of `size`: rad/s or m/s², rad/s² or m/s³ for a ramp, "s" for a step of the clock, or "samples".
    ratio : float or None
        Ratio of the standard deviation of the noise at the scale `scale` to the expected one.
    frequency : float or None
        Frequency of a hum (Hz), between 0 and half the sampling rate.
    """

    kind: Kind
    time: float
    began: float
    axis: str = ""
    level: int | None = None
    scale: float | None = None
    size: float | None = None
    unit: str = ""
    ratio: float | None = None
    frequency: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return the event as numbers and strings for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Event:
        """Create an event from the `content` that `to_dict` returned. Other content raises a ReadError."""
        try:
            event = cls(**content)
        except TypeError as error:
            raise ReadError(f"not an event: {error}") from error
        if event.kind not in KINDS:
            raise ReadError(f"not an event: kind must be one of {', '.join(KINDS)}; got {event.kind!r}")
        return event

    @property
    def description(self) -> str:
        """Text that describes the change, without time and axis.

        >>> Event(kind="jump", time=3596.2, began=3596.1, axis="gyro_x", size=0.0019, unit="rad/s").description
        'level jumped by 0.11 deg/s'
        """
        unit, factor = SHOWN.get(self.unit, (self.unit, 1.0))
        amount = "" if self.size is None else round_text(self.size * factor)
        scale = "" if self.scale is None else f" at a scale of {round_text(self.scale)} s"
        unit_error = "; check the unit" if 45 < (self.ratio or 0.0) < 70 else ""  # deg/s that are stated as rad/s
        texts: dict[Kind, str] = {
            "noise-up": f"noise rose by a factor of {round_text(self.ratio or 1.0)}{scale}{unit_error}",
            "noise-down": f"noise fell to {round_text(100.0 * (self.ratio or 0.0))} %{scale}",
            "jump": f"level jumped by {amount} {unit}", "ramp": f"level drifts by {amount} {unit}",
            "hum": f"periodic disturbance of {amount} {unit} at {round_text(self.frequency or 0.0, 3)} Hz",
            "spike": f"spike of {amount} {unit}", "frozen": "value does not change any more",
            "saturated": "value stays at a limit outside the usual range",
            "lost": f"{counted(int(self.size), 'sample')} lost" if self.size else "samples lost",
            "clock": f"time stamps went back by {amount} {unit}",
            "moved": "the unit was moved: charts rest until it is still", "still": "the unit is still again",
        }  # fmt: skip
        return texts[self.kind]

    def __str__(self) -> str:
        subject = self.axis or "unit"
        return with_minus(f"{self.time:.1f} s  {subject}  {self.description} (began {self.began:.1f} s)")


NAMING_S = 1.0
"""Time (s) from the first alarm to the report. Alarms of all axes during this time are evaluated together."""
SLOWNESS, LONGEST_NAMING = 8.0, 60.0
"""A change of level is named after SLOWNESS times the time from onset to alarm, within LONGEST_NAMING seconds. 9 of
10 excursions of slow noise are then not jumps (validation/study_monitor.py)."""
SLOW_LEVEL, SLOW_PRIOR = 6, 4.0
"""Level from which a jump must exceed slow noise's log-likelihood by SLOW_PRIOR (validation/study_monitor.py)."""


@dataclass(frozen=True, eq=False)
class History:
    """The last standardised innovations of an axis."""

    now: int  # number of the next sample
    fast: Vector  # (n,) the last innovations, up to sample `now` − 1
    slow: Vector  # (m,) the last sums of innovations over 2^HISTORY_LEVEL samples
    slow_stop: int  # number of the first sample after the last of these sums

    def since(self, sample: int) -> tuple[Vector, int, int]:
        """Return innovations from `sample` or earlier on, the number of samples per value, and the first sample."""
        width = 1 << HISTORY_LEVEL
        if sample >= self.now - self.fast.size or self.slow.size * width <= self.fast.size:
            first = max(sample, self.now - self.fast.size)
            return self.fast[self.fast.size - (self.now - first) :], 1, first
        count = min(self.slow.size, -(-(self.slow_stop - sample) // width))
        values = self.slow[self.slow.size - count :] / math.sqrt(width)
        return values, width, self.slow_stop - count * width


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A fault whose kind was determined."""

    kind: Kind
    onset: int  # number of the sample at which it began
    level: int | None = None  # Haar level at which it was found
    size: float | None = None  # size in the unit of the signal, per sample for a ramp
    ratio: float | None = None  # ratio of the standard deviation of the noise to the expected one
    cycles: float | None = None  # frequency of a hum (cycles per sample)

    @property
    def is_motion(self) -> bool:
        """Whether the change counts as motion if several axes have it at the same time."""
        louder = self.kind == "noise-up" and (self.ratio or 0.0) >= 2.0
        return louder or self.kind in ("jump", "ramp", "spike")

    @property
    def magnitude(self) -> float:
        """Size of the fault for comparisons: absolute size, or factor between the noise and the expected noise."""
        if self.ratio:
            return max(self.ratio, 1.0 / self.ratio)
        return abs(self.size or 0.0)


@dataclass(frozen=True)
class _LevelChange:
    """A jump or a ramp fitted to innovations: kind, gain of log-likelihood, size, and index of its beginning."""

    kind: Kind
    gain: float
    size: float
    begin: int


def naming_time(alarm: Alarm, rate: float) -> int:
    """Return the number of samples after a first alarm at which its fault is determined; more for a slow change."""
    usual = max(round(NAMING_S * rate), 1)
    if alarm.family != "level":
        return usual
    slow = round(SLOWNESS * (alarm.sample - alarm.onset))
    return max(usual, min(slow, round(LONGEST_NAMING * rate)))


def name_fault(alarms: Sequence[Alarm], history: History, gain: Gain, settings: ChartSettings) -> Fault:
    """Determine the fault that caused the alarms of one axis, in order of time and without the family "constant"."""
    families = {alarm.family for alarm in alarms}
    first = alarms[0]
    if families == {"spike"}:
        place = history.fast.size - (history.now - first.sample)
        error = float(history.fast[place]) if place >= 0 else math.sqrt(2.0 * first.score) * first.sign
        return Fault(kind="spike", onset=first.sample, size=error * math.sqrt(gain.S))
    noise = _strongest(alarms, "noise up")
    level = _strongest(alarms, "level")
    down = _strongest(alarms, "noise down")
    if down is not None and noise is None and (level is None or down.score > level.score):
        ratio = _noise_ratio(history, down)
        return Fault(kind="noise-down", onset=down.onset + 1, level=down.level, ratio=ratio)
    earliest = next((alarm for alarm in alarms if alarm.family == "level"), first)
    shape = _course(history, earliest.onset + 1, gain)
    if noise is None:
        white = 0.0 if "spike" not in families else _excess(history, first.onset + 1)
    else:
        white = max(noise.score, _excess(history, noise.onset + 1))
    slow, slow_level = _slow_excess(history, earliest.onset + 1) if level is not None else (0.0, 0)
    # A jump that is detected only after seconds is small compared with slow noise, which is then the more likely cause.
    prior = SLOW_PRIOR if level is not None and earliest.level >= SLOW_LEVEL and shape.kind == "jump" else 0.0
    if slow + prior > max(shape.gain, white) and slow_level > 3:
        ratio = _noise_ratio(history, earliest._replace(level=slow_level))
        return Fault(kind="noise-up", onset=earliest.onset + 1, level=slow_level, ratio=ratio)
    if level is not None and shape.gain > white:
        return Fault(kind=shape.kind, onset=shape.begin, level=level.level, size=shape.size)
    chosen = noise or first
    line = _line(history, chosen.onset + 1, gain)
    if line is not None:
        cycles, size = line
        return Fault(kind="hum", onset=chosen.onset + 1, level=chosen.level, size=size, cycles=cycles)
    if noise is None and level is not None and "spike" not in families:
        return Fault(kind=shape.kind, onset=shape.begin, level=level.level, size=shape.size)
    return Fault(
        kind="noise-up", onset=chosen.onset + 1, level=noise.level if noise else None,
        ratio=_noise_ratio(history, chosen),
    )  # fmt: skip


def _strongest(alarms: Sequence[Alarm], family: str) -> Alarm | None:
    candidates = [alarm for alarm in alarms if alarm.family == family]
    return max(candidates, key=lambda alarm: alarm.score) if candidates else None


def _excess(history: History, onset: int) -> float:
    """Return the log-likelihood ratio of an increased variance of the innovations since the onset, or 0."""
    values, _, _ = history.since(onset)
    if not values.size:
        return 0.0
    r = float(np.mean(np.square(values)))
    return 0.5 * values.size * (r - 1.0 - math.log(r)) if r > 1.0 else 0.0


def _noise_ratio(history: History, alarm: Alarm) -> float:
    """Return the ratio of the measured to the expected standard deviation at the level of an alarm, since its onset."""
    values, width, _ = history.since(alarm.onset + 1)
    half = max((1 << alarm.level) // 2 // width, 1)
    if values.size < 2 * half:
        return math.sqrt(float(np.mean(np.square(values)))) if values.size else math.nan
    path = np.concatenate([[0.0], np.cumsum(values)])
    w = path[2 * half :] - 2.0 * path[half:-half] + path[: -2 * half]
    return math.sqrt(float(np.mean(np.square(w))) / (2.0 * half))


def _course(history: History, onset: int, gain: Gain) -> _LevelChange:
    """Return the jump or ramp of the level that explains the innovations best."""
    duration = max(history.now - onset, 1)
    values, width, first = history.since(onset - 3 * duration)
    step = _thin(gain.step_response(values.size * width), width)
    slope = _thin(np.cumsum(gain.step_response(values.size * width)), width)
    place = max((onset - first) // width, 0)
    near = max(duration // width, 8)
    jumps = range(max(place - near // 2, 0), min(place + near, values.size - 1) + 1, max(near // 64, 1))
    ramps = {max(place - k * duration // width, 0) for k in (0, 1, 2, 3)}
    candidates = [_fit_change("jump", values, step, begin) for begin in jumps]
    candidates += [_fit_change("ramp", values, slope, begin) for begin in sorted(ramps)]
    # The best of many possible beginnings fits well by chance, so the logarithm of their number is subtracted.
    price = {"jump": math.log(max(len(jumps), 1)), "ramp": math.log(len(ramps))}
    best = max(candidates, key=lambda change: change.gain - price[change.kind])
    return _LevelChange(best.kind, best.gain, best.size, first + best.begin * width)


def _slow_excess(history: History, onset: int) -> tuple[float, int]:
    """Return the largest log-likelihood ratio of a larger variance of block means (slow noise), and its level."""
    values, width, _ = history.since(onset)
    best, level = (0.0, 0), width.bit_length() - 1
    while values.size >= 4:
        r = float(np.mean(np.square(values)))
        if r > 1.0:
            best = max(best, (0.5 * values.size * (r - 1.0 - math.log(r)), level))
        even = values.size & ~1
        values, level = (values[0:even:2] + values[1:even:2]) / math.sqrt(2.0), level + 1
    return best


def _thin(values: Vector, width: int) -> Vector:
    return values if width == 1 else np.asarray(values.reshape(-1, width).sum(axis=1) / math.sqrt(width))


def _fit_change(kind: Kind, values: Vector, response: Vector, begin: int) -> _LevelChange:
    here, g = values[begin:], response[: values.size - begin]
    power = float(g @ g)
    if power == 0:
        return _LevelChange(kind, 0.0, 0.0, begin)
    size = float(g @ here) / power
    return _LevelChange(kind, 0.5 * size * size * power, size, begin)


def _line(history: History, onset: int, gain: Gain) -> tuple[float, float] | None:
    """Return frequency (cycles per sample) and amplitude of a significant sinusoid that explains much of the excess."""
    start = max(onset, history.now - history.fast.size)
    values = history.fast[history.fast.size - (history.now - start) :]
    if values.size < 64:
        return None
    size = 4 * values.size
    window = np.hanning(values.size + 2)[1:-1]
    power = np.square(np.abs(np.fft.rfft(values * window, size))) / float(np.sum(window**2))
    power[:8] = 0.0  # frequencies of slow noise, not of a hum
    peak = int(np.argmax(power[: size // 2]))
    background = float(np.median(power[8 : size // 2])) / math.log(2.0)
    # Chance of such a peak at any frequency without a sinusoid.
    if power[peak] / max(background, 1.0) < math.log(values.size / 1e-4):
        return None
    amplitude = 2.0 * math.sqrt(float(power[peak]) * float(np.sum(window**2))) / float(np.sum(window))
    excess = float(np.mean(np.square(values))) - 1.0
    if 0.5 * amplitude**2 < 1.0 / 3.0 * excess:  # share of the excess power (validation/study_monitor.py)
        return None
    cycles = peak / size
    return cycles, amplitude / gain.magnitude(cycles)


@dataclass(frozen=True)
class Stillness:
    """State of the detection: samples of the present block, and number of blocks without motion before it."""

    calm: int = 0  # number of consecutive blocks without motion
    samples: int = 0  # number of samples since the motion was detected
    held: Mapping[str, Vector] = field(default_factory=dict)  # samples of the present block

    def update(
        self, parts: Mapping[str, Vector], axes: Mapping[str, MonitoredAxis], naming: int
    ) -> tuple[int, Stillness, bool]:
        """Add samples of all axes. Return the number of used samples, the new state, and whether the unit rests."""
        block = max(naming, 32)  # without motion, the ratio below exceeds its limit once in 10¹⁰ blocks
        filled = next(iter(self.held.values())).size if self.held else 0
        used = min(next(iter(parts.values())).size, block - filled)
        held = {
            axis: np.concatenate([self.held[axis], x[:used]]) if self.held else x[:used] for axis, x in parts.items()
        }
        if filled + used < block:
            return used, replace(self, held=held, samples=self.samples + used), False
        for axis, x in held.items():
            errors, usual = Whitener(axes[axis].gain).update(x), float(axes[axis].settings.ratios[0])
            if not float(np.mean(np.square(errors))) < 4.0 * usual:
                return used, Stillness(0, self.samples + used), False
        return used, Stillness(self.calm + 1, self.samples + used), self.calm + 1 >= 3

    def broken(self) -> Stillness:
        """Return the state after a gap."""
        return Stillness(samples=self.samples)

    def to_dict(self) -> dict[str, Any]:
        """Return the state as numbers and lists."""
        return plain_fields(self, "calm samples held")

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Stillness:
        """Create a state from the result of `to_dict`."""
        held = {axis: numbers(x) for axis, x in content["held"].items()}
        return cls(whole(content["calm"]), whole(content["samples"]), held)


_EVERYTHING = frozenset({"noise up", "noise down", "level", "spike", "constant"})
_EXPLAINED: Mapping[str, frozenset[str]] = {
    "noise-up": _EVERYTHING - {"constant"}, "hum": _EVERYTHING - {"constant"}, "noise-down": frozenset({"noise down"}),
    "jump": frozenset({"level", "noise up", "spike"}), "ramp": frozenset({"level", "noise up", "spike"}),
    "spike": frozenset({"spike"}), "frozen": _EVERYTHING, "saturated": _EVERYTHING, "moved": _EVERYTHING - {"constant"},
}  # fmt: skip
"""Families of alarms that a reported fault explains, by kind of the fault."""
_SILENT = ("frozen", "saturated", "moved")  # kinds of faults that explain innovations of any size
_OWN: Mapping[str, frozenset[str]] = {
    "noise-up": frozenset({"noise up"}), "hum": frozenset({"noise up"}), "noise-down": frozenset({"noise down"}),
    "ramp": frozenset({"level"}), "spike": frozenset({"spike"}),
}  # fmt: skip
"""Families of alarms that show that a fault is still present, by kind of the fault."""


@dataclass(frozen=True)
class Open:
    """A reported fault to which further alarms are attributed."""

    kind: Kind
    until: int  # Last sample at which alarms are attributed to it. Each such alarm moves it to a later sample.
    hold: int  # number of samples after the last alarm for which further alarms are attributed to it


class MonitoredAxis:
    """Filter, charts and faults of one axis of a monitor; see `Charts` for the run length and the pauses."""

    def __init__(self, gain: Gain, settings: ChartSettings, *, run_length: float, rest: int, longest_rest: int) -> None:
        self.gain, self.settings = gain, settings
        self.whitener = Whitener(gain)
        self.charts = Charts(settings, run_length, rest, longest_rest)
        self.fast = self.slow = np.zeros(0)
        self.value: float | None = None
        self.run = 0  # number of equal samples at the end of the data so far
        self.open: Open | None = None
        self.known: dict[str, tuple[int, float]] = {}  # last alarm and magnitude of each reported kind

    def update(self, x: Vector) -> list[Alarm]:
        """Add samples (n,), and return the alarms that no reported fault explains, in order of time."""
        alarms = self._constant(x)
        e = self.whitener.update(x)
        alarms += self.charts.update(e)
        # 4096 innovations, and as many sums, determine the kind of a fault.
        self.fast = np.concatenate([self.fast, e])[-4096:]
        self.slow = np.concatenate([self.slow, self.charts.recent])[-4096:]
        return [alarm for alarm in sorted(alarms) if not self._is_explained(alarm)]

    def _constant(self, x: Vector) -> list[Alarm]:
        """Return an alarm for each run of equal samples whose length reaches the limit."""
        limit, before = self.settings.equal, self.run
        places = np.flatnonzero(x[1:] != x[:-1]) + 1
        if self.value is None or x[0] != self.value:
            begins, before = np.concatenate([[0], places]), 0
        else:
            begins = np.concatenate([[-before], places])
        lengths = np.diff(np.concatenate([begins, [x.size]]))
        self.value, self.run = float(x[-1]), int(lengths[-1])
        if limit == 0 or int(lengths.max()) < limit:
            return []
        alarms = []
        for k in np.flatnonzero(lengths >= limit).tolist():
            sample = int(begins[k]) + limit - 1
            if sample >= 0:
                first = self.charts.count + int(begins[k])
                at = self.charts.count + sample
                alarms.append(Alarm(at, "constant", 0, 1, onset=first - 1, score=float(limit)))
        return alarms

    def _is_explained(self, alarm: Alarm) -> bool:
        fault = self.open
        if fault is None or alarm.sample > fault.until or alarm.family not in _EXPLAINED[fault.kind]:
            return False
        if alarm.score > 0.5 * (20.0 * self.charts.spike) ** 2 and fault.kind not in _SILENT:
            return False  # this is motion, regardless of the reported fault
        hold = max(fault.hold, alarm.sample - alarm.onset)
        self.open = Open(fault.kind, max(fault.until, alarm.sample + hold), fault.hold)
        if alarm.family in _OWN.get(fault.kind, ()):
            name = "noise-up" if fault.kind == "hum" else fault.kind
            _, magnitude = self.known.get(name, (0, 0.0))
            self.known = {**self.known, name: (alarm.sample, magnitude)}
        return True

    def name(self, alarms: Sequence[Alarm]) -> Fault:
        """Determine the fault that caused alarms."""
        stuck = next((alarm for alarm in alarms if alarm.family == "constant"), None)
        if stuck is not None:
            return Fault(kind="saturated" if self._is_outside() else "frozen", onset=stuck.onset + 1)
        done = self.charts.done[HISTORY_LEVEL] if self.charts.depth >= HISTORY_LEVEL else 0
        stop = self.charts.base + (done << HISTORY_LEVEL)
        return name_fault(alarms, History(self.charts.count, self.fast, self.slow, stop), self.gain, self.settings)

    def _is_outside(self) -> bool:
        """Return whether the present sample differs from the first one by more than the limit of a spike."""
        far, origin = self.charts.spike * float(np.sqrt(self.gain.S)), self.whitener.origin
        return self.value is not None and origin is not None and abs(self.value - origin) > far

    def is_loud(self, samples: int) -> bool:
        """Return whether one of the last `samples` innovations is far beyond the limit of a spike."""
        # This is motion, not noise.
        return bool(np.max(np.abs(self.fast[-samples:]), initial=0.0) > 3.0 * self.charts.spike)

    def report(
        self, kind: Kind, alarms: Sequence[Alarm], *, hold: int, remembered: int = 0, magnitude: float = 0.0
    ) -> bool:
        """Register a fault, and return whether it is new or larger; jumps and ramps restart the level. Alarms for
        `hold` samples belong to it, and the same fault is not new for `remembered` samples."""
        now = self.charts.count
        longest = max((alarm.sample - alarm.onset for alarm in alarms), default=0)
        self.open = Open(kind, now + max(hold, longest), hold)
        if kind in ("jump", "ramp"):
            self.begin_again()
        name = "noise-up" if kind == "hum" else kind
        last, before = self.known.get(name, (-remembered, 0.0))
        new = kind == "jump" or now - last >= remembered or magnitude > 1.5 * before
        self.known = {**self.known, name: (now, max(magnitude, 0.0 if new else before))}
        return new

    def begin_again(self) -> None:
        """Restart the filter with an unknown level, and all charts at 0."""
        self.whitener.restart()
        self.charts.reset()
        self.fast = self.slow = np.zeros(0)

    def gap(self, samples: int | None) -> None:
        """Continue after missing samples; `samples` is None if their number is unknown."""
        if not self.whitener.gap(samples):  # otherwise the innovations continue as if no sample were lost
            self.charts.break_blocks()
            self.fast = self.slow = np.zeros(0)
        self.value, self.run = None, 0

    def save(self) -> dict[str, Any]:
        """Return the state. Its arrays are never modified in place."""
        state = {name: getattr(self, name) for name in ("fast", "slow", "value", "run", "known")}
        fault = None if self.open is None else [self.open.kind, self.open.until, self.open.hold]
        return {"whitener": self.whitener.save(), "charts": self.charts.save(), **state, "open": fault}

    def load(self, state: Mapping[str, Any]) -> None:
        """Restore a state from `save`."""
        self.whitener.load(state["whitener"])
        self.charts.load(state["charts"])
        self.fast, self.slow = numbers(state["fast"]), numbers(state["slow"])
        self.value = None if state["value"] is None else number(state["value"])
        self.run = whole(state["run"])
        fault = state["open"]
        self.open = None if fault is None else Open(fault[0], whole(fault[1]), whole(fault[2]))
        self.known = {kind: (whole(last), number(magnitude)) for kind, (last, magnitude) in state["known"].items()}
