"""Status of a watched recording: curves, estimates, and whether the recording is long enough."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gmwm.base.errors import FitWarning, GmwmError

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit
    from gmwm.measuring.variance.result import WaveletVariance
    from gmwm.theory.processes.model import Model


def fit_curves(model: Model | None, curves: Mapping[str, WaveletVariance]) -> tuple[dict[str, Fit], dict[str, str]]:
    """Fit a model to the wavelet variance of each axis. Returns the fits, and for each axis that could not be fitted
    the reason. Both are empty without a model."""
    from gmwm import fit

    fits: dict[str, Fit] = {}
    failed: dict[str, str] = {}
    if model is None:
        return fits, failed
    for axis, curve in curves.items():
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FitWarning)
                fits[axis] = fit(model, curve, certify=False)
        except GmwmError as error:
            failed[axis] = error.reason
    return fits, failed


def _needed_durations(fit: Fit, accuracy: float) -> dict[str, float | None]:
    """Return the recording duration (s) at which each parameter reaches an accuracy; None if unknown or infinite."""
    from gmwm import Model, plan

    wv = fit.wavelet_variance
    present = tuple(process for process in fit.model.processes if process.scale > 0)
    try:
        needed = plan(Model(present), duration=wv.samples / wv.rate, rate=wv.rate).needed(accuracy) if present else {}
    except GmwmError:
        needed = {}
    return {name: (seconds if seconds < float("inf") else None) for name, seconds in needed.items()}


def _errors(fit: Fit) -> dict[str, float]:
    """Return the relative standard error of each parameter; an empty mapping if they cannot be computed."""
    try:
        errors = fit.standard_errors
    except GmwmError:
        return {}
    return {name: error / abs(fit.parameters[name]) for name, error in errors.items() if fit.parameters[name]}


def whole_text(
    curves: Mapping[str, WaveletVariance], fits: Mapping[str, Fit], failed: Mapping[str, str], accuracy: float,
    datasheet: bool, live: bool = False,
) -> str:  # fmt: skip
    """Format the complete status: a table of deviations for each sensor, and a table of estimates for each axis."""
    from gmwm.base.axis_names import by_sensor
    from gmwm.base.text import duration_text
    from gmwm.cli.output import table_text
    from gmwm.showing.plots.view import view_of

    first = next(iter(curves.values()))
    parts = [f"{first.extent}: {duration_text(first.samples / first.rate)}"]
    sensors = by_sensor(curves)
    for group in sensors.values():
        leading = next(iter(group.values()))
        shown = view_of(leading.unit, "allan", "datasheet" if datasheet else "si")
        heights = [shown.height(curve.variance) for curve in group.values()]
        rows = [
            [f"{t:.6g}", *(f"{h[k]:.3e}" for h in heights), f"{100 * e:.2g} %"]
            for k, (t, e) in enumerate(zip(shown.time(leading.tau), _relative(leading), strict=True))
        ]
        parts.append(table_text(["τ (s)", *group, "±"], rows, title=shown.height_label, texts=0))
    answers = [_estimates(axis, fit, accuracy) for axis, fit in fits.items()]
    answers += [f"{axis}: not fitted: {reason}" for axis, reason in failed.items()]
    # A terminal cuts a live view at its height, so the most important part comes first.
    return "\n\n".join([parts[0], *answers, *parts[1:]] if live else [*parts, *answers])


def _relative(wv: WaveletVariance) -> Any:
    """Return the relative standard error of the deviation at each scale. The error is ½ √(2/η), because the square of
    the deviation has a χ² distribution with η degrees of freedom."""
    return 0.5 * (2.0 / wv.degrees_of_freedom) ** 0.5


def _estimates(axis: str, fit: Fit, accuracy: float) -> str:
    """Format the estimates of an axis as a table, with intervals and whether the recording is long enough."""
    from gmwm.base.text import duration_text
    from gmwm.cli.output import table_text
    from gmwm.fitting.estimation.summary import IntervalMethod, intervals_if_known, rows

    errors, needed = _errors(fit), _needed_durations(fit, accuracy)
    now = fit.wavelet_variance.samples / fit.wavelet_variance.rate
    lines = []
    for row in rows(fit, intervals_if_known(fit, IntervalMethod())[0], IntervalMethod()):
        error, least = errors.get(row.name), needed.get(row.name)
        if row.name in fit.model.fixed_names:
            enough = ""
        elif error is None or not math.isfinite(error):
            enough = "unknown"
        elif error <= accuracy:
            enough = "yes"
        else:
            enough = "no" if least is None or least <= now else f"at {duration_text(least)}"
        lines.append([row.name, row.estimate, row.interval, row.error, enough, row.unit])
    heads = ["parameter", "estimate", "95 % interval", "error", f"{100 * accuracy:g} %?", "unit"]
    return table_text(heads, lines, title=f"{axis}: {fit.model.structure}")


def one_line_of(
    curves: Mapping[str, WaveletVariance], fits: Mapping[str, Fit], failed: Mapping[str, str], accuracy: float,
    datasheet: bool,
) -> str:  # fmt: skip
    """Format the status in one line: the duration, and for each axis the estimates, or deviations without a model."""
    from gmwm.base.text import duration_text
    from gmwm.fitting.estimation.summary import IntervalMethod, short_values
    from gmwm.showing.plots.view import view_of

    first = next(iter(curves.values()))
    parts = [f"{duration_text(first.samples / first.rate)}, {first.samples} samples"]
    for axis, curve in curves.items():
        if axis in fits:
            values = ", ".join(f"{name} {value}" for name, value in short_values(fits[axis], IntervalMethod()).items())
            errors = _errors(fits[axis])
            free = [name for name in fits[axis].parameters if name not in fits[axis].model.fixed_names]
            inaccurate = ", ".join(name for name in free if not errors.get(name, math.inf) <= accuracy)
            share = f"{100 * accuracy:g} %"
            parts.append(
                f"{axis}: {values}; {f'not yet {share}: {inaccurate}' if inaccurate else f'all within {share}'}"
            )
        elif axis in failed:
            parts.append(f"{axis}: not fitted: {failed[axis]}")
        else:
            shown = view_of(curve.unit, "allan", "datasheet" if datasheet else "si")
            heights, times = shown.height(curve.variance), shown.time(curve.tau)
            k = int(heights.argmin())
            error = f"{100 * _relative(curve)[k]:.2g} %"
            parts.append(f"{axis}: {heights[0]:.3e} at {times[0]:.3g} s, least {heights[k]:.3e} ± {error} at "
                         f"{times[k]:.3g} s")  # fmt: skip
    return " | ".join(parts)


def as_dicts(
    curves: Mapping[str, WaveletVariance], fits: Mapping[str, Fit], accuracy: float
) -> dict[str, dict[str, Any]]:
    """Return the wavelet variance, fit, relative errors and needed duration of each axis as plain values for JSON."""
    from gmwm.fitting.estimation.summary import IntervalMethod, inference

    out = {}
    for axis, curve in curves.items():
        out[axis] = {"wavelet_variance": curve.to_dict()}
        if axis in fits:
            fit = fits[axis]
            out[axis]["fit"] = fit.to_dict() | inference(fit, IntervalMethod())
            out[axis]["relative_errors"] = _errors(fit)
            out[axis]["needed"] = _needed_durations(fit, accuracy)
    return out
