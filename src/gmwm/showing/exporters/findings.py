"""Create the remarks on an exported file: noise that it leaves out, and upper limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from gmwm.base.remarks import Quantity, Remark
from gmwm.base.units import SI_UNIT, noise_unit
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.likelihood.system import is_ramp
from gmwm.showing.exporters.reduction import NAMES, Number, lines_of

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.showing.exporters.base import Noise

_TIME_POWER = {"N": 0.5, "K": -0.5, "B": 0.0}
"""Power of time in the unit of each parameter, for `noise_unit`."""


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
    for term, process in zip(fit.model.terms, fit.model.processes, strict=True):
        if process.line(wv.rate) is None and process.oscillation() is not None:
            yield from (replace(remark, subject=axis) for remark in process.remarks(term, wv.samples, wv.rate))
    for line in lines_of(fit):
        frequency, amplitude = Quantity(line.frequency, "Hz"), Quantity(line.amplitude, unit)
        yield Remark.of("lines", axis, case="file", term=line.term, frequency=frequency, amplitude=amplitude)


def of_ramps(calibration: Calibration) -> Iterator[Remark]:
    """Yield a remark for each rate ramp, because the matrices treat its slope as known without error."""
    for axis, fit in calibration.items():
        for term, process in zip(fit.model.terms, fit.model.processes, strict=True):
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
