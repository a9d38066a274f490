"""Make the remarks on a recording from the results of its inspection."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from gmwm.base.remarks import Fact, Quantity, Remark
from gmwm.base.text import counted, duration_text, moment, round_text
from gmwm.base.time_base import TimeBase, lost_samples
from gmwm.base.units import SI_UNIT, STANDARD_GRAVITY, noise_unit, usual_unit
from gmwm.measuring.regression.result import Regression, per

if TYPE_CHECKING:
    from gmwm.measuring.inspection.axis_statistics import Motion
    from gmwm.measuring.inspection.knocks import Knock, Step
    from gmwm.measuring.inspection.result import AxisInspection, Inspection
    from gmwm.measuring.inspection.time_grid import Extent, Saturation
    from gmwm.measuring.inspection.trends import Swing, Trend

MOVED = 1.0
"""Change of the direction of gravity (°) that shows motion, as by a bias of 17 mg (tests/test_inspection_limits.py)."""

_NOISY = 0.1  # noise density (deg/s/√Hz) at the upper end of low-cost gyroscopes (docs/howto/units.md)


def of_time(extent: Extent, base: TimeBase, same: int) -> Iterator[Remark]:
    """Yield remarks on gaps and time stamps. `same` is the number of samples that equal the one before on all axes."""
    filled, count = extent.filled_samples
    if len(extent.unbroken) > 1:
        lost = lost_samples([duration - 1 / base.rate for _, duration in base.gaps], base.rate)
        missing = (int(lost.sum()) - filled) / base.rate
        length = "known" if missing > 0.5 / extent.rate else "unknown"
        span = Quantity(max(missing, 0.0), "s")
        use = "longest" if 2 * max(last - first for first, last in extent.segments) >= extent.samples else "all"
        yield Remark.of("gaps", segments=len(extent.unbroken), missing=span, length=length, use=use)
    if count:
        yield Remark.of("gaps-filled", case="filled", share=filled / (extent.samples + filled), count=count)
    if base.duplicates:
        # Share of rows written twice, below which there is no remark on them. N is too large by half of this share.
        many = base.duplicates > 1e-3 * extent.samples
        # Repeated stamps and samples agree in number for rows written twice, not if stamps are only rounded.
        twice = many and abs(same / base.duplicates - 1) <= 0.1
        repeated = Remark.of("stamps-irregular", case="repeated", count=base.duplicates)
        yield Remark.of("rows-repeated", count=base.duplicates) if twice else repeated
    if base.backward:
        yield Remark.of("stamps-irregular", case="backward", count=base.backward)
    # Jitter of the time stamps (sampling intervals) above which there is a remark.
    if base.jitter * base.rate > 0.1:
        yield Remark.of("stamps-irregular", case="jitter", share=float(base.jitter * base.rate))


def of_stuck(stuck: Mapping[str, tuple[float, float] | None]) -> Iterator[Remark]:
    """Yield remarks on axes whose output stops changing, with the time (s) and the share of the recording."""
    for axis, finding in stuck.items():
        if finding is not None:
            yield Remark.of("axis-stuck", axis, time=Quantity(finding[0], "s"), share=finding[1])


def of_copies(axes: Mapping[str, AxisInspection]) -> Iterator[Remark]:
    """Yield remarks on axes that have the samples of another axis times a factor, and so its statistics."""
    for axis, item in axes.items():
        if twin := next((name for name, other in axes.items() if name != axis and _is_multiple(item, other)), None):
            factor = item.noise / axes[twin].noise
            scale = "" if item == axes[twin] else f" times {round_text(factor, 4)}, up to an offset"
            of = f"those of {twin}{scale}" if twin in list(axes)[: list(axes).index(axis)] else ""
            facts: dict[str, Fact] = {"reference": twin, "factor": factor, "of": of, "numbers": ("all numbers",)}
            yield Remark.of("noise-shared", axis, case="copy", **facts)


def _is_multiple(one: AxisInspection, other: AxisInspection) -> bool:
    """Return whether the statistics that an offset does not change have one ratio, except for rounding errors."""
    first, second = ((item.noise, item.sd, item.wander) for item in (one, other))
    ratios = [a / b for a, b in zip(first, second, strict=True)] if min(*first, *second) > 0 else [0.0, 1.0]
    return one.unit == other.unit and max(ratios) <= (1 + 1e-9) * min(ratios)


def of_saturation(saturations: tuple[Saturation, ...], units: Mapping[str, str]) -> Iterator[Remark]:
    """Yield remarks on axes whose output is clipped, has a dead band, or is an absolute value."""
    for item in saturations:
        value = in_datasheet_units(item.value, 0.0, units[item.axis])
        case = "folded" if item.folded else "inside" if item.inside else "noise" if item.matters else "rare"
        yield Remark.of(
            "output-clipped", item.axis, case=case, share=100 * item.share, value=value, loss=100 * item.loss
        )  # fmt: skip


def of_motion(motion: Motion, tilt: float | None, knocks: tuple[Knock, ...], extent: Extent) -> Iterator[Remark]:
    """Yield remarks on knocks, on motion by axis, and on a change of the direction of gravity (`tilt`, °)."""
    shown = tuple(f"{moment(begin)} to {moment(end)}" for begin, end in motion.spans)
    first, last = extent.times([0, extent.samples - 1])
    how = "throughout" if any(a <= first and last <= b for a, b in motion.spans) else "moved"
    for axis in motion.ratios:
        ratio = max(motion.ratios.values())
        yield Remark.of("recording-moved", axis, case=how, parts=shown, ranges=motion.spans, ratio=ratio)
    if tilt is not None and tilt > MOVED:  # gyroscopes measure only the rate of the turn, which their mean shows
        yield Remark.of("recording-moved", "accel", case="tilted", angle=Quantity(tilt, "°"))
    elif tilt is not None:
        yield Remark.of("recording-settles", angle=Quantity(tilt, "°"))
    # Knocks whose samples together add less than 1 % to the variance of sums change N by at most 0.5 %.
    if sum((knock.peak * (1 + knock.duration * extent.rate)) ** 2 for knock in knocks) > 0.01 * extent.samples:
        yield Remark.of("knocks", count=len(knocks), first=Quantity(knocks[0].time, "s"))


def of_positions(parts: Sequence[tuple[float, float]]) -> Iterator[Remark]:
    """Yield the remark on a recording that was turned between positions, with its still parts (s)."""
    begin, end = max(parts, key=lambda part: part[1] - part[0])
    shown = tuple(f"{moment(a)} to {moment(b)}" for a, b in parts)
    longest = {"begin": Quantity(begin, "s"), "end": Quantity(end, "s")}
    yield Remark.of("recording-moved", case="positions", count=len(parts), parts=shown, **longest)


def of_steps(steps: tuple[Step, ...], known: Sequence[Remark]) -> Iterator[Remark]:
    """Yield remarks on lasting jumps of the mean and on settling, at most three for each axis. Jumps within a settling
    that is `known`, because its jumps were subtracted, are a part of it."""
    settled: Any = {r.subject: r.facts["ranges"] for r in known if r.code == "level-steps" and "ranges" in r.facts}
    new = [step for step in steps if not any(a <= step.time <= b for a, b in settled.get(step.axis, ()))]
    for axis in dict.fromkeys(step.axis for step in steps):
        if any(step.axis == axis and step.until is not None for step in new):
            yield Remark.of("level-steps", axis, case="settles", **settling_times(new))
        if jumps := [step for step in new if step.axis == axis and not step.at_gap and step.until is None]:
            case = "possible" if all(step.possible for step in jumps) else "clear"
            yield Remark.of("level-steps", axis, case=case, **places_of(jumps))
        if restarts := [step for step in steps if step.axis == axis and step.at_gap]:
            first = Quantity(restarts[0].time, "s")
            yield Remark.of("gaps-filled", axis, case="restart", count=len(restarts), first=first)


def places_of(jumps: Sequence[Step]) -> dict[str, Fact]:
    """Return the number of some jumps and their times, for a remark."""
    places = tuple(moment(jump.time) for jump in jumps)
    return {"count": len(jumps), "places": places, "first": Quantity(jumps[0].time, "s")}


def settling_times(steps: Sequence[Step]) -> dict[str, Fact]:
    """Return the times in which the mean of any axis settles after a jump, for a remark."""
    ranges: list[list[float]] = []
    for step in sorted((step for step in steps if step.until is not None), key=lambda step: step.time):
        begin, end = float(math.floor(step.time) - 1), float(math.ceil(step.until or 0.0))
        if not ranges or begin > ranges[-1][1]:
            ranges.append([begin, end])
        ranges[-1][1] = max(ranges[-1][1], end)
    return {"parts": tuple(f"{moment(a)} to {moment(b)}" for a, b in ranges), "ranges": tuple(map(tuple, ranges))}


def of_trends(trends: tuple[Trend, ...], units: Mapping[str, str], extent: Extent, cut: bool) -> Iterator[Remark]:
    """Yield remarks on trends, one for each axis. `cut` tells whether the beginning of the file is already left out."""
    longest = {small: _longest(trends, small) for small in (True, False)}
    late = beginning_to_omit(trends, extent.samples / extent.rate) is None
    way = "late" if late else "again" if cut else "start"
    for trend in trends:
        size = in_datasheet_units(abs(trend.size), 0.0, units[trend.axis])
        # The numbers are estimated at long scales, where a trend looks like noise.
        facts: dict[str, Fact] = {"size": size, "left": 100 * trend.share, "numbers": ("B", "K", "R")}
        if trend.tau is not None and trend.until is not None:
            tau, until = Quantity(trend.tau, "s"), Quantity(longest[trend.is_small], "s")
            if trend.is_small:
                facts["numbers"] = ()
                yield Remark.of("warm-up", trend.axis, case="small", **facts, tau=tau, duration=until)
            else:
                facts["first"] = Quantity(round_up(until.value), "s")
                yield Remark.of("warm-up", trend.axis, case="large", **facts, tau=tau, duration=until, way=way)
        elif trend.kind == "linear":
            yield Remark.of("linear-trend", trend.axis, **{**facts, "numbers": ("K", "R")})
        else:
            yield Remark.of("trend", trend.axis, case="curve", **facts)


def of_swings(swings: tuple[Swing, ...], units: Mapping[str, str]) -> Iterator[Remark]:
    """Yield remarks on periodic changes of the mean."""
    for swing in swings:
        size = in_datasheet_units(swing.amplitude, 0.0, units[swing.axis])
        facts: dict[str, Fact] = {"size": size, "period": Quantity(swing.period, "s"), "numbers": ("B", "K", "R")}
        yield Remark.of("trend", swing.axis, case="swing", periods=swing.periods, **facts)


def beginning_to_omit(trends: tuple[Trend, ...], duration: float) -> float | None:
    """Return the time (s) to omit because of large warm-ups; 0 if none, None if too little would remain."""
    longest = _longest(trends, small=False)
    # At least half of the recording must be left for a calibration (docs/howto/record.md).
    return None if longest > 0.5 * duration else round_up(longest) if longest else 0.0


def _longest(trends: tuple[Trend, ...], small: bool) -> float:
    """Return the length (s) of the longest warm-up whose effect is small or large; 0 if there is none."""
    return max((t.until for t in trends if t.until is not None and t.is_small == small), default=0.0)


def omission_remarks(inspection: Inspection, start: float) -> tuple[Remark, ...]:
    """Return a remark for each axis because of whose warm-up the first `start` seconds of a recording are left out."""
    return tuple(
        Remark.of(
            "warm-up", trend.axis, case="omitted", numbers=(), first=Quantity(start, "s"),
            whole=Quantity(inspection.duration, "s"),
            size=in_datasheet_units(abs(trend.size), 0.0, inspection.axes[trend.axis].unit),
        )
        for trend in inspection.trends
        if trend.settles and not trend.is_small
    )  # fmt: skip


def of_conditions(regressions: Mapping[str, Regression], unknown: str) -> Iterator[Remark]:
    """Yield remarks on axes that depend on conditions and those that do not, or on an `unknown` temperature."""
    if unknown:
        yield Remark.of("conditions", case="unknown", reason=unknown)
    for axis, regression in regressions.items():
        if regression.coarse is not None:
            long, _, tau = regression.coarse
            (name, *_) = regression
            yield Remark.of(
                "conditions-attenuated", axis, against=covariates_text(regression), tau=Quantity(tau, "s"),
                ratio=regression[name].value / long,
            )  # fmt: skip
        if regression.applied:
            yield removal_remark(axis, regression)
        else:
            yield Remark.of(
                "conditions", axis, case="none", against=covariates_text(regression), pvalue=regression.pvalue
            )


def removal_remark(axis: str, regression: Regression, left_in: str = "") -> Remark:
    """Make the remark on an effect that is removed. `left_in` says what it would do otherwise; by default to the Allan
    deviation three octaves below the longest averaging time."""
    level = max(regression.share.size - 3, 1)
    times = 1 / math.sqrt(max(1 - float(regression.share[level - 1]), 1e-4))
    time = duration_text(2.0 ** (level - 1) / regression.rate)
    return Remark.of(
        "conditions", axis, case="removed", against=covariates_text(regression), effect=effect_text(regression),
        pvalue=regression.pvalue,
        left_in=left_in or f"the Allan deviation at {time} would be {round_text(times)} times as large",
    )  # fmt: skip


def covariates_text(regression: Regression) -> str:
    """Return the names of the covariates of a regression, for a sentence."""
    words = {"temperature": "the temperature", "time": "a trend in time", "warmup": "a warm-up"}
    return " and ".join(words.get(term.name, term.name) for term in regression.terms)


def effect_text(regression: Regression) -> str:
    """Format the first coefficient with half its 95 % interval, as "0.0123 ± 0.0009 (deg/s)/°C"."""
    column = regression.columns[0]
    coefficient = regression[column.name]
    half = (coefficient.interval()[1] - coefficient.interval()[0]) / 2
    value, error = (in_datasheet_units(number, 0.0, regression.unit) for number in (coefficient.value, half))
    unit = per(value.unit, column.power)
    digits = max(1, min(6, 1 + math.floor(math.log10(abs(coefficient.value) / half) + 1))) if coefficient.value else 2
    text = f"{value.value:.{digits}g} ± {error.value:.2g} {unit}".rstrip()
    more = len(regression.columns) - 1
    return text if not more else f"{text} and {counted(more, 'further coefficient')}"


def of_levels(changes: Mapping[str, tuple[float, float]]) -> Iterator[Remark]:
    """Yield remarks on axes whose noise changes its level: the ratio, and the time (s) of the largest change."""
    for axis, (ratio, time) in sorted(changes.items()):
        yield Remark.of("heavy-tails", axis, case="changes", share=100 * (ratio - 1), time=Quantity(time, "s"))


def in_datasheet_units(value: float, time_power: float, unit: str) -> Quantity:
    """Convert a noise coefficient in SI to the unit of a datasheet; `time_power` is the power of seconds in its unit.

    >>> in_datasheet_units(1e-3, 0.0, "rad/s")
    Quantity(value=206.26480624709637, unit='deg/h')
    """
    si, factor = noise_unit(time_power, unit)
    name, size = usual_unit(si)
    return Quantity(value * factor * size, name)


def round_up(seconds: float) -> float:
    """Round a duration (s) up to a multiple of 1 s, 10 s, 1 min, 5 min, 30 min or 1 h, the first that is ≥ 1/20 of it.

    >>> [round_up(x) for x in (0.3, 47.0, 233.0, 1500.0, 9000.0)]
    [1.0, 50.0, 240.0, 1500.0, 9000.0]
    """
    step = next((step for step in (1.0, 10.0, 60.0, 300.0, 1800.0) if seconds <= 20 * step), 3600.0)
    return math.ceil(seconds / step) * step


def of_gravity(
    gravity: float | None, axes: Mapping[str, AxisInspection], turning: str | None = None
) -> Iterator[Remark]:
    """Yield a remark if the norm of the mean specific force (m/s²) differs from gravity, which an axis `turning` of a
    gyroscope has instead."""
    error = 0.0 if gravity is None else gravity / STANDARD_GRAVITY - 1
    # Relative error of gravity above which there is a remark, more than a good accelerometer has.
    if gravity is not None and abs(error) > 0.02:
        norm, expected = Quantity(gravity, "m/s²"), Quantity(STANDARD_GRAVITY, "m/s²")
        # Offsets of 100 mg and 3 % of scale (low-cost parts) change gravity by 15 %; beyond, the unit may be wrong.
        if turning is not None:
            yield Remark.of("unit-doubtful", turning, case="exchanged", norm=norm)
        # With a wrong unit, gravity is still far above the noise.
        elif gravity < 3 * math.hypot(*(item.sd for item in axes.values() if item.unit == SI_UNIT["accel"])):
            yield Remark.of("unit-contradicted", case="removed", norm=norm)
        elif abs(error) > 0.15:
            yield Remark.of("unit-doubtful", "accel", case="gravity", norm=norm, expected=expected)
        else:
            yield Remark.of("unit-contradicted", case="gravity", norm=norm, expected=expected, share=100 * error)


def of_rounding(axes: Mapping[str, AxisInspection], rate: float) -> Iterator[Remark]:
    """Yield remarks on quantization, at a sampling rate (Hz)."""
    for name, axis in axes.items():
        if axis.lsb is not None and axis.counter:
            yield Remark.of("output-rounded", name, case="counter", step=in_datasheet_units(axis.lsb, 0.0, axis.unit))
        if axis.lsb is None or axis.before_rounding is None:
            continue
        ratio = axis.lsb / axis.before_rounding if axis.before_rounding else math.inf
        step = in_datasheet_units(axis.lsb, 0.0, axis.unit)
        # Largest quantization step (standard deviations of the noise) at which the rounding error is white noise of
        # variance step²/12. N is then known to 2 %, and slow changes of the mean to 3 % (docs/validation/rounding.md).
        if ratio > 2.0:
            yield Remark.of("coarse-output", name, step=step, ratio=ratio, numbers=("N", "B", "K", "Q", "q_c"))
        # Step (standard deviations σ) above which rounding adds at least 2 %, step²/24σ², to N.
        elif ratio > 0.7:
            density = in_datasheet_units(axis.lsb / math.sqrt(12 * rate), 0.5, axis.unit)
            yield Remark.of("output-rounded", name, case="rounded", step=step, ratio=ratio, density=density)


def of_units(densities: Mapping[str, float]) -> Iterator[Remark]:
    """Yield remarks on gyroscopes whose noise density (rad/s/√Hz) suggests deg/s read as rad/s, 57 times as large."""
    noisy = {axis: degrees for axis, density in densities.items() if (degrees := math.degrees(density)) > _NOISY}
    limit = Quantity(_NOISY, "deg/s/√Hz")
    for axis, degrees in noisy.items():
        yield Remark.of("unit-doubtful", axis, case="density", density=Quantity(degrees, "deg/s/√Hz"), limit=limit)
