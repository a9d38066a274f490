"""Measure one axis in one or several recordings of a unit: wavelet variance, spectrum and outlier test."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from gmwm.base.errors import DataError, GmwmError
from gmwm.calibration.measurement import AxisMeasurement, Measured, Pair, measured_axis
from gmwm.calibration.options import CalibrationOptions
from gmwm.measuring.covariance.tails import with_common_tails
from gmwm.measuring.outliers import Verdict
from gmwm.measuring.outliers.screening import NOTHING_REPLACED
from gmwm.measuring.regression.conditions import Conditions
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.spectrum import PowerSpectrum
from gmwm.measuring.variance.api import signal_wavelet_variance
from gmwm.measuring.variance.pooling import pooled
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """One axis of one recording.

    Attributes
    ----------
    item : Measured
        The measurements of the axis.
    raw : Measured or None
        The data as the user gave them; None for a stream.
    conditions : Conditions
        The conditions whose effect may be removed, with the regression of each axis.
    """

    item: Measured
    raw: Measured | None
    conditions: Conditions


class Together(NamedTuple):
    """The measurements of one axis in all recordings together.

    Attributes
    ----------
    wv : WaveletVariance
        The wavelet variance to fit.
    verdicts : mapping of name to Verdict
        The outlier test of each recording.
    spectrum : PowerSpectrum or None
        The power spectrum of all recordings together.
    raw : WaveletVariance or None
        The wavelet variance from which the effect of the conditions is not removed; None if there is nothing to remove,
        or if it is not known.
    """

    wv: WaveletVariance
    verdicts: Mapping[str, Verdict]
    spectrum: PowerSpectrum | None
    raw: WaveletVariance | None


def measured_together(
    axis: str, parts: Mapping[str, Part], options: CalibrationOptions, *, comparisons: int
) -> Together:
    """Measure one axis in all recordings, and pool the wavelet variances and the spectra.

    If one recording needs the robust wavelet variance, it is used for all recordings, because classical and robust
    wavelet variances cannot be pooled.

    Parameters
    ----------
    axis : str
    parts : mapping of recording to Part
    options : CalibrationOptions
        Options of this axis.
    comparisons : int
        Number of axes that are tested for outliers together.

    Raises
    ------
    DataError
        If the axis is constant in a recording, or the recordings cannot be pooled.
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
    """Return the regression of an axis on the conditions; None if there is none, or if there are several recordings.

    For several recordings, the wavelet variance of each recording contains its own regression.
    """
    if len(parts) > 1:
        return None
    return next(iter(parts.values())).conditions.found.get(axis)


def pair_of_axis(item: Measured, options: CalibrationOptions) -> Measured:
    """Return the wavelet variances of an axis as a `Pair`, and free the memory of its samples.

    Data that are not an AxisMeasurement are returned unchanged.
    """
    if not isinstance(item, AxisMeasurement):
        return item
    with item.turn:
        pair: Pair = item.pair(options.efficiency)
        item.release()
    return pair


def _raw(axis: str, part: Part) -> WaveletVariance | None:
    """Return the wavelet variance from which the effect of the conditions is not removed; None if it is not known."""
    raw = part.conditions.raw.get(axis)
    if raw is None and isinstance(part.raw, Signal):
        return signal_wavelet_variance(part.raw)
    return raw


def _spectrum(items: Sequence[Measured]) -> PowerSpectrum | None:
    """Return the power spectrum of all recordings together, smoothed except at lines; None if there is none."""
    samples = [item.samples for item in items if isinstance(item, AxisMeasurement)]
    try:
        return samples[0].spectrum_with(samples[1:])
    except (GmwmError, IndexError):
        return None


def worst(verdicts: Iterable[Verdict]) -> Verdict | None:
    """Return the most severe of several outlier tests, with the wrong samples and knocks of all recordings."""
    known = list(verdicts)
    if len(known) < 2:
        return next(iter(known), None)
    one = min(known, key=lambda verdict: (not verdict.contaminated, verdict.pvalue))
    return replace(
        one, spikes=sum(each.spikes for each in known), largest=max(each.largest for each in known),
        replaced=sum((each.replaced for each in known), NOTHING_REPLACED),
    )  # fmt: skip
