"""Verdict, limits and remarks of an exported file, and how well a filter with its N and K predicts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from gmwm.base.lazy import once_per_result
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.template import fact_text
from gmwm.base.text import list_text, round_text
from gmwm.base.units import SI_UNIT, noise_unit
from gmwm.calibration.findings import unusable
from gmwm.calibration.number_verdicts import MAIN, Usability
from gmwm.choosing.datasheets.effective import TRUE_CLAIM, claim, true_times
from gmwm.choosing.datasheets.filter_numbers import FilterGain, FilterPrediction, samples_in, smallest_error
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.showing.exporters.one_state import TIMES, biases
from gmwm.showing.exporters.reduction import NAMES, RULES, AxisNoise, Number, Rule, SensorNoise, lines_of
from gmwm.showing.exporters.text import is_given

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.showing.exporters.base import Noise

_WHY = {"tilt": "tilt unknown", "recording": "no samples of the axis"}  # reasons why a bias is not known


def verdict(calibration: Calibration) -> str:
    """Return a sentence on whether the numbers of a file can be used, and which of them must not be used."""
    if is_given(calibration):
        return "Verdict: these numbers were given, and not measured by gmwm."
    refused = refused_numbers(calibration)
    text = calibration.verdict.text()
    if not refused:
        return f"Verdict: {text}"
    text = text.partition(". ")[2] if text.startswith("Do not use ") else text
    return f"Verdict: DO NOT USE {list_text(refused)} until the cause is found. {text}"


def refused_numbers(calibration: Calibration) -> list[str]:
    """Return the numbers N, K and B that must not be used, as in the table, by axis: "accel_x" or "K of accel_x"."""
    lost = unusable(calibration)
    if len(lost) == len(calibration.number_verdicts):
        return ["this file"]
    axes = {
        symbol: [
            axis for axis, of_axis in calibration.number_verdicts.items()
            if axis not in lost and symbol in of_axis and of_axis[symbol].usability is Usability.DO_NOT_USE
        ]
        for symbol in MAIN
    }  # fmt: skip
    return [*lost, *(f"{symbol} of {', '.join(names)}" for symbol, names in axes.items() if names)]


def rule_of(sensor: SensorNoise, rule: Rule) -> str:
    """Return a sentence on the axes from which the numbers of a sensor come."""
    axes = ", ".join(axis.axis for axis in sensor.axes)
    name = NAMES[sensor.quantity].capitalize()
    if len(sensor.axes) == 1:
        return f"{name}: {axes}."
    if rule != "worst":
        return f"{name}: {RULES[rule]} {axes}."
    white, walk = (_source(sensor.worst(symbol), symbol) for symbol in ("N", "K"))
    return f"{name}: N of {white}, K of {walk}, {RULES[rule]} {axes}."


def _source(axis: AxisNoise, symbol: str) -> str:
    return f"{axis.axis} (upper limit)" if getattr(axis, symbol).upper else axis.axis


def limits(remarks: Iterable[Remark]) -> list[str]:
    """Return a sentence on the numbers that are upper limits, and one on means that contain upper limits."""
    limits = [remark for remark in remarks if remark.code == "upper-limit"]
    whole = [remark for remark in limits if remark.facts["case"] == "axis"]
    among = [remark for remark in limits if remark.facts["case"] == "mean"]
    lines = []
    if whole:
        level = fact_text(whole[0].facts["level"])
        lines.append(f"UPPER LIMIT, not a measured value ({level}): {', '.join(remark.subject for remark in whole)}.")
    for number in dict.fromkeys(str(remark.facts["number"]) for remark in among):
        axes = [r.subject for r in among if r.facts["number"] == number and r.facts["kind"] != "measured"]
        lines.append(f"UPPER LIMIT among measured values: {number} contains the limit of {', '.join(axes)}.")
    return lines


def not_measured(remarks: Iterable[Remark]) -> list[str]:
    """Return a sentence on the biases for which the file has 0, because they are not known."""
    subjects: dict[str, list[str]] = {}
    for remark in remarks:
        subjects.setdefault(_WHY[str(remark.facts["why"])], []).append(remark.subject)
    axes = [f"{', '.join(names)} ({reason})" for reason, names in subjects.items()]
    return [f"NOT MEASURED: the bias of {', and of '.join(axes)}. The file has 0."] if axes else []


def left_out(sensors: Iterable[SensorNoise]) -> list[str]:
    """Return sentences on the sinusoids: the strongest of each sensor, their number, and their effect on N and K."""
    parts, count = [], 0
    for sensor in sensors:
        lines = [(*line, axis.axis) for axis in sensor.axes for line in lines_of(axis.fit)]
        if lines:
            amplitude, frequency, _, axis = max(lines, key=lambda line: line[0])
            parts.append(f"{axis} {frequency:.3g} Hz ({amplitude:.2g} {SI_UNIT[sensor.quantity]})")
            count += len(lines)
    more = f" and {count - len(parts)} more" if count > len(parts) else ""
    if not parts:
        return []
    near = "in N and K if the period is 1/10 to 3 times the horizon"
    return [f"Periodic disturbances, {near}: {', '.join(parts)}{more}."]


_TIME_POWER = {"N": 0.5, "K": -0.5, "B": 0.0}  # power of time in the unit of each parameter, for `noise_unit`


def remarks_of(noise: Noise, confidence: float) -> Iterator[Remark]:
    """Yield the remarks on N and K of each sensor, at a confidence level."""
    yield from _upper_limits(noise, confidence)
    rates = {sensor.quantity: Quantity(sensor.rate, "Hz") for sensor in noise.sensors}
    if len({rate.value for rate in rates.values()}) > 1 and noise.options.rate is None:
        yield Remark.of("rates-differ", gyro=rates["gyro"], accel=rates["accel"])
    for sensor in noise.sensors:
        for axis in sensor.axes:
            yield from of_lines(axis.axis, axis.fit)


def of_lines(axis: str, fit: Fit) -> Iterator[Remark]:
    """Yield a remark for each sinusoid and each slow oscillation of an axis, because the file does not include them."""
    wv = fit.wavelet_variance
    unit = wv.unit or "u"
    for term, process in fit.model.by_term.items():
        if process.line(wv.rate) is None and process.oscillation() is not None:
            yield from (replace(remark, subject=axis) for remark in process.remarks(term, wv.samples, wv.rate))
    for amplitude, frequency, term in lines_of(fit):
        yield Remark.of(
            "lines", axis, case="file", term=term, frequency=Quantity(frequency, "Hz"),
            amplitude=Quantity(amplitude, unit),
        )  # fmt: skip


def of_ramps(calibration: Calibration) -> Iterator[Remark]:
    """Yield a remark for each rate ramp, because the matrices treat its slope as known without error."""
    for axis, fit in calibration.items():
        for term, process in fit.model.by_term.items():
            if is_ramp(process, fit.wavelet_variance.rate):
                yield Remark.of("ramp-in-matrices", axis, term=term)


def _upper_limits(noise: Noise, confidence: float) -> Iterator[Remark]:
    """Yield remarks on the parameters of a file that are upper limits instead of measured values."""
    rule, level = noise.options.axes, Quantity(50 + 50 * confidence, "%")
    for sensor in noise.sensors:
        for symbol, power in _TIME_POWER.items():
            if symbol == "B" and not sensor.axes[0].use.flicker:
                continue
            axes: dict[str, Number] = {one.axis: getattr(one, symbol) for one in sensor.axes}
            limited = [axis for axis, number in axes.items() if number.upper]
            if rule != "mean":
                shown = limited if rule == "each" else [a for a in limited if a == sensor.worst(symbol).axis]
                if shown:
                    yield Remark.of("upper-limit", f"{symbol} of {', '.join(shown)}", case="axis", level=level)
            elif getattr(sensor, symbol)[0].upper:
                name = f"{symbol} of the {NAMES[sensor.quantity]}"
                if len(limited) == len(axes):
                    yield Remark.of("upper-limit", name, case="axis", level=level)
                else:
                    unit = noise_unit(power, SI_UNIT[sensor.quantity])[0]
                    yield from _limits_among(name, axes, unit, level=level)


def _limits_among(name: str, axes: Mapping[str, Number], unit: str, *, level: Quantity) -> Iterator[Remark]:
    """Yield a remark for each axis that contributes to a parameter computed from measured values and upper limits."""
    for axis, number in axes.items():
        # The value is zero for an axis whose model does not have this noise, for example flicker noise.
        if number.value > 0:
            yield Remark.of(
                "upper-limit", axis, case="mean", number=name, level=level,
                kind="upper limit" if number.upper else "measured", value=Quantity(number.value, unit),
            )  # fmt: skip


LARGE_LOSS = 1.2
"""Loss at the longest time that advises a filter with more states, a convention (tests/exporters/test_quality.py)."""


@dataclass(frozen=True)
class Quality:
    """RMS error of a mean over that of the full model's filter (None without one), and stated over real error."""

    loss: float | None
    claim: float


def qualities(axis: AxisNoise, white: float, walk: float) -> tuple[Quality, ...]:
    """Return the quality of N and K of a file for an axis at each of `TIMES`."""
    each = (_quality(axis.fit, white, walk, time) for time in TIMES)
    return once_per_result(axis.fit, "qualities", (white, walk), lambda: tuple(each))


def _quality(fit: Fit, white: float, walk: float, time: float) -> Quality:
    processes, rate = fit.model.processes, fit.wavelet_variance.rate
    samples, gain = samples_in(time, rate), FilterGain(walk / (white * rate))
    # The filter of the full model has no sinusoids either.
    error = FilterPrediction.of(processes, rate, samples, lines=False).error(gain)[0]
    least = smallest_error(processes, rate, samples)
    loss = None if least is None else math.sqrt(max(error / least, 1.0))
    return Quality(loss, claim(fit, white, walk, time))


def predictions(sensors: Iterable[SensorNoise], inflation: float) -> list[str]:
    """Return sentences on how a filter with N and K of the file predicts its axes, before inflation: for each sensor
    the largest loss against the full model, the smallest and largest ratio of the stated to the real error, and the
    times at which the smallest ratio is right."""
    lines, large = [], False
    for sensor in sensors:
        groups: dict[tuple[float, float], list[AxisNoise]] = {}  # axes with the same N and K in the file
        for axis, white, walk in zip(sensor.axes, sensor.N, sensor.K, strict=False):
            if white.value > 0:
                groups.setdefault((white.value / inflation, walk.value / inflation), []).append(axis)
        if not groups:
            continue
        by_time = list(zip(*(qualities(axis, *pair) for pair, axes in groups.items() for axis in axes), strict=True))
        losses = [max((each.loss for each in at if each.loss is not None), default=math.nan) for at in by_time]
        error = "" if any(map(math.isnan, losses)) else f"error {', '.join(f'{loss:.2f}' for loss in losses)}; "
        stated = ", ".join(range_text([each.claim for each in at]) for at in by_time)
        spans = {pair: true_times([axis.fit for axis in axes], *pair) for pair, axes in groups.items()}
        first = min(spans, key=lambda pair: spans[pair][1])
        since, until = max(begin for begin, _ in spans.values()), spans[first][1]
        end = f" up to {until:g} s" if since < until < math.inf else ""
        right = " at no time" if since == math.inf else f" from {since:g} s{end}" if since > TIMES[0] else end
        lines.append(f"{NAMES[sensor.quantity].capitalize()}: {error}stated {stated}{right and f'; right{right}'}.")
        if since <= TIMES[0] and until < TIMES[-1]:
            instead = _bias_instead(min(groups[first], key=lambda axis: qualities(axis, *first)[-1].claim), inflation)
            lines.append(f"For longer predictions, set the horizon{instead}.")
        large = large or losses[-1] > LARGE_LOSS
    if not lines:
        return []
    before = ", before inflation" if inflation != 1 else ""
    head = (
        f"Predictions over {', '.join(f'{time:g}' for time in TIMES)} s{before}: error over the full model's; "
        f"stated over real error (right: {TRUE_CLAIM[0]:g} to {TRUE_CLAIM[1]:g})."
    )
    return [head, *lines, *["Filters with Gauss-Markov states (format state-space) predict better."] * large]


def _bias_instead(axis: AxisNoise, inflation: float) -> str:
    """Return white noise and a Gauss-Markov bias of an axis, as the files with such a bias have them."""
    bias = biases([axis], axis.use.horizon)[axis.axis]
    # Short, because a file has few lines of comment; the units are those of the file.
    white, sigma = axis.N.value * inflation, bias.sigma.value * inflation
    text = f", or use N {white:.3g}, σ {sigma:.2g}, T {round_text(bias.time, 2)} s ({axis.axis})"
    return text if bias.claims else ""


def range_text(ratios: Sequence[float]) -> str:
    """Return the smallest and the largest ratio, once if they agree."""
    return "-".join(dict.fromkeys(f"{ratio:.2f}" for ratio in (min(ratios), max(ratios))))
