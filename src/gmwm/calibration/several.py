"""Measure one axis in one or several recordings of a unit: its curve, its spectrum and the test for outliers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gmwm.calibration.measurement import AxisMeasurement, Measured, Pair, measured_axis
from gmwm.calibration.options import CalibrationOptions
from gmwm.covariance.tails import with_common_tails
from gmwm.errors import DataError, GmwmError
from gmwm.outliers import Verdict
from gmwm.outliers.screening import NOTHING_REPLACED
from gmwm.regression.conditions import Conditions
from gmwm.regression.result import Regression
from gmwm.signals import Signal
from gmwm.spectrum import PowerSpectrum
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.pooling import pooled
from gmwm.variance.result import WaveletVariance


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """One axis of one recording: its measurements, the data as they were given, and the conditions."""

    item: Measured
    raw: Measured | None
    conditions: Conditions


class Together(NamedTuple):
    """One axis of all recordings.

    Attributes
    ----------
    wv : WaveletVariance
        The curve to fit.
    verdicts : mapping of name to Verdict
        The test for outliers in each recording.
    spectrum : PowerSpectrum or None
    raw : WaveletVariance or None
        The curve with the effect of the conditions; None if nothing was removed, or if it is not known.
    """

    wv: WaveletVariance
    verdicts: Mapping[str, Verdict]
    spectrum: PowerSpectrum | None
    raw: WaveletVariance | None


def measured_together(
    axis: str, parts: Mapping[str, Part], options: CalibrationOptions, *, comparisons: int
) -> Together:
    """Measure one axis in all recordings, and pool the curves and the spectra.

    If one recording needs the robust curve, all have it, because classical and robust curves cannot be pooled.

    Raises
    ------
    DataError
        If an axis is constant, or the recordings cannot be pooled.
    """
    several = len(parts) > 1
    spectrum = _spectrum([part.item for part in parts.values()]) if several else None
    found: dict[str, tuple[WaveletVariance, Verdict | None, PowerSpectrum | None]] = {}
    pairs = {name: pair_of_axis(part.item, options) if several else part.item for name, part in parts.items()}
    for name, item in pairs.items():
        found[name] = measured_axis(item, options, comparisons=comparisons * len(parts))
        if not np.any(found[name][0].variance > 0):
            error = DataError("the signal is constant", advice="Check whether the axis is connected.")
            raise error.at(name) if several else error
    if len({wv.robust for wv, *_ in found.values()}) > 1:
        for name, (wv, verdict, own) in found.items():
            if not wv.robust:
                robust, *_ = measured_axis(pairs[name], replace(options, robust=True), comparisons=1)
                found[name] = robust, verdict, own
    curves = with_common_tails({name: wv for name, (wv, *_) in found.items()})
    noise, raw, removed = {}, {}, False
    for name, wv in curves.items():
        applied = parts[name].conditions.applied(axis)
        noise[name] = wv if applied is None else applied.corrected(wv)
        before = wv if applied is None else _raw(axis, parts[name])
        removed = removed or applied is not None
        if before is not None:
            raw[name] = before
    known = removed and len(raw) == len(noise)
    return Together(
        wv=pooled(noise),
        verdicts={name: verdict for name, (_, verdict, _) in found.items() if verdict is not None},
        spectrum=spectrum if several else next(iter(found.values()))[2],
        raw=pooled(raw) if known and len({wv.robust for wv in raw.values()}) == 1 else None,
    )


def regression_of(axis: str, parts: Mapping[str, Part]) -> Regression | None:
    """Return the regression of an axis on the conditions if there is one recording. With several recordings return
    None, because the curve of each recording holds its own regression."""
    if len(parts) > 1:
        return None
    return next(iter(parts.values())).conditions.found.get(axis)


def pair_of_axis(item: Measured, options: CalibrationOptions) -> Measured:
    """Return the curves of an axis, after which its samples are no longer needed."""
    if not isinstance(item, AxisMeasurement):
        return item
    with item.turn:
        pair: Pair = item.pair(options.efficiency)
        item.release()
    return pair


def _raw(axis: str, part: Part) -> WaveletVariance | None:
    """Return the wavelet variance with the effect of the conditions."""
    raw = part.conditions.raw.get(axis)
    if raw is None and isinstance(part.raw, Signal):
        return signal_wavelet_variance(part.raw)
    return raw


def _spectrum(items: Sequence[Measured]) -> PowerSpectrum | None:
    """Return the spectrum of all recordings together, smoothed except at lines."""
    samples = [item.samples for item in items if isinstance(item, AxisMeasurement)]
    try:
        return samples[0].spectrum_with(samples[1:])
    except (GmwmError, IndexError):
        return None


def worst(verdicts: Iterable[Verdict]) -> Verdict | None:
    """Return the most severe verdict, with the wrong samples and knocks of all recordings."""
    known = list(verdicts)
    if len(known) < 2:
        return next(iter(known), None)
    one = min(known, key=lambda verdict: (not verdict.contaminated, verdict.pvalue))
    return replace(
        one, spikes=sum(each.spikes for each in known), largest=max(each.largest for each in known),
        replaced=sum((each.replaced for each in known), NOTHING_REPLACED),
    )  # fmt: skip
