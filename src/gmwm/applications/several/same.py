"""Test whether recordings have the same noise."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from gmwm.applications.several.same_model import SameParameters, same_parameters
from gmwm.applications.several.same_result import SameNoise
from gmwm.base.arrays import as_rate, as_vector
from gmwm.base.errors import DataError, OptionError
from gmwm.base.multiple_tests import holm
from gmwm.choosing.replicates.level_ratios import level_ratios
from gmwm.measuring.covariance.tails import excess_covariance, with_common_tails
from gmwm.measuring.variance.api import signal_wavelet_variance
from gmwm.measuring.variance.pooling import SLOWER
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_confidence, as_size
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import ModelLike


def same(
    *recordings: Imu | Signal | ArrayLike,
    rate: float | None = None,
    labels: Sequence[str] | None = None,
    model: ModelLike | None = None,
    tolerance: float = 0.0,
    size: float = 0.05,
    confidence: float = 0.95,
) -> SameNoise:
    """Test whether recordings have the same noise at each scale, or the same parameters of a model.

    The wavelet variances ν² of two recordings are compared at each level j. With more than two recordings, each one is
    compared with the mean of the others. If the noise is the same, the ratio of the variances has approximately an F
    distribution with η_1j and η_2j degrees of freedom, η_j = 2 ν_j⁴ / V_jj. V is the covariance of the estimated
    wavelet variances. It is computed for the mixture of processes with the highest likelihood given the mean of all
    wavelet variances. The additional covariance from heavy tails or from a variance that changes with time is added.
    The p-values of all levels, axes and recordings are adjusted by Holm's method.

    With a model, its parameters are compared instead. The model is fitted to all recordings together, and the test
    statistic is the decrease of the weighted residuals if each recording has parameters of its own. This test has more
    power, and is valid if the model is correct.

    With millions of samples, the test finds differences of 0.1 %. Set `tolerance` to test only for larger differences.

    Parameters
    ----------
    *recordings : Imu, Signal, or (N,) array
        Two or more recordings with the same sampling rate and any lengths, made at different times. For Imu recordings,
        the axes that all recordings have are compared.
    rate : float
        Sampling rate (Hz); only for plain arrays.
    labels : sequence of str, optional
        Names of the recordings; "1", "2", … by default.
    model : Model, Process or str, optional
        A model whose parameters are compared, such as "WN + RW"; see `SameNoise.parameters`.
    tolerance : float
        Largest |ln(ν_1/ν_2)| that is treated as equal, at least 0. With 0.1, the test finds only wavelet deviations
        that differ by more than about 10 %.
    size : float
        Significance level of all tests together.
    confidence : float
        Confidence level of the intervals of the ratios.

    Returns
    -------
    SameNoise

    Raises
    ------
    DataError
        If there are fewer than two recordings, or if they differ in rate or unit or have no axis in common.
    ModelError
        If the model cannot be read, or cannot be fitted to the recordings.
    OptionError
        If an option has a value that is not allowed, or both a model and a tolerance are given.

    References
    ----------
    Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 65-70.
    The measured rates of false alarms are in docs/validation/same.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> monday, tuesday, later = rng.normal(size=(3, 20_000)) * [[1.0], [1.0], [1.1]]
    >>> same(monday, tuesday, rate=100.0).differs, same(monday, later, rate=100.0).differs
    (False, True)
    >>> same(monday, later, rate=100.0, tolerance=0.2).differs
    False
    >>> same(monday, tuesday, later, rate=100.0, labels=["monday", "tuesday", "later"]).differences[0].recording
    'later'
    >>> found = same(monday, later, rate=100.0, model="WN")
    >>> round(found.parameters[0].ratios[0].ratio, 2)
    0.82
    """
    size = as_size(size)
    as_confidence(confidence)
    known = isinstance(tolerance, int | float) and not isinstance(tolerance, bool)
    if not known or not 0 <= tolerance < math.inf:
        raise OptionError(argument="tolerance", expected="a number of at least 0, such as 0.1", got=tolerance)
    if model is not None and tolerance:
        raise OptionError("a tolerance is only for the test without a model", argument="tolerance", got=tolerance)
    names = [str(k) for k in range(1, len(recordings) + 1)] if labels is None else list(labels)
    if len(set(names)) != len(names) or len(names) != len(recordings):
        raise OptionError(argument="labels", expected="a different name for each recording", got=labels)
    axes = _axes(recordings, rate)
    curves = {axis: _curves(dict(zip(names, signals, strict=True))) for axis, signals in axes.items()}
    rows = [
        row
        for axis, measured in curves.items()
        for row in level_ratios(measured, axis, confidence=confidence, tolerance=tolerance)
    ]
    adjusted = holm([math.nan if row.pvalue is None else row.pvalue for row in rows]).tolist()
    rows = [
        row if row.pvalue is None else replace(row, pvalue=p, differs=p <= size)
        for row, p in zip(rows, adjusted, strict=True)
    ]
    tests: list[SameParameters] = []
    if model is not None:
        tests = [same_parameters(model, measured, axis, confidence) for axis, measured in curves.items()]
        both = holm([test.pvalue for test in tests]).tolist()
        tests = [replace(test, pvalue=p, differs=p <= size) for test, p in zip(tests, both, strict=True)]
    return SameNoise(
        recordings=tuple(names), axes=tuple(axes), levels=tuple(rows), parameters=tuple(tests),
        left_out=_left_out(recordings, axes),
        tolerance=float(tolerance), size=size, confidence=confidence,
    )  # fmt: skip


def _axes(recordings: Sequence[Any], rate: float | None) -> dict[str, list[Signal]]:
    """Return the signals to compare, by axis."""
    if len(recordings) < 2:
        raise DataError(argument="recordings", expected="at least two recordings", got=len(recordings))
    given = [_signals(item, rate, f"recording {k}") for k, item in enumerate(recordings, start=1)]
    if not any(isinstance(item, Imu) for item in recordings):
        # Single signals are compared even if their names differ.
        found = {next(iter(given[0])): [signal for one in given for signal in one.values()]}
    else:
        found = {axis: [one[axis] for one in given] for axis in given[0] if all(axis in one for one in given)}
    if not found:
        names = "; ".join(", ".join(one) for one in given)
        raise DataError(f"the recordings have no axis in common: {names}", argument="recordings")
    for axis, signals in found.items():
        first = signals[0]
        for other in signals[1:]:
            if abs(other.rate / first.rate - 1) > SLOWER:
                raise _differ(axis, "rate", f"{first.rate:g} Hz and {other.rate:g} Hz")
            if other.unit != first.unit:
                raise _differ(axis, "unit", f"{first.unit or 'none'} and {other.unit or 'none'}")
    return found


def _left_out(recordings: Sequence[Any], axes: Collection[str]) -> tuple[str, ...]:
    """Return the axes of any recording that are not compared."""
    every = dict.fromkeys(axis for item in recordings if isinstance(item, Imu) for axis in item.signals)
    return tuple(axis for axis in every if axis not in axes)


def _differ(axis: str, what: str, values: str) -> DataError:
    return DataError(
        f"the recordings of {axis} differ in their {what}: {values}", argument="recordings",
        advice=f"Compare recordings with the same {what}.",
    )  # fmt: skip


def _signals(item: Any, rate: float | None, name: str) -> Mapping[str, Signal]:
    if isinstance(item, Imu):
        return item.signals
    signal = item if isinstance(item, Signal) else Signal(as_vector(item, name), as_rate(rate))
    return {signal.axis or "signal": signal}


def _curves(signals: Mapping[str, Signal]) -> dict[str, WaveletVariance]:
    """Return the wavelet variances of the recordings of one axis, with the covariance from heavy tails."""
    curves = {}
    for name, signal in signals.items():
        wv = signal_wavelet_variance(signal)
        curves[name] = replace(wv, excess=excess_covariance(signal, wv))
    return dict(with_common_tails(curves))
