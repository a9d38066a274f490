"""Bias instability: the lowest point of the model's Allan deviation."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import Vector
from gmwm.datasheets.curve import ENDLESS, Curve
from gmwm.datasheets.entry import Entry
from gmwm.estimation.result import Fit
from gmwm.processes.base import Process
from gmwm.processes.model import Model
from gmwm.remarks import Quantity, Remark
from gmwm.units import noise_unit
from gmwm.variance.result import WaveletVariance
from gmwm.variance.slope_line import LAWS

_PER_OCTAVE = 24
_ZOOM = 32
_LEVEL = 1e-9
"""A curve whose ends differ by no more than this share is flat, as that of flicker noise alone: all of it is B."""

SYMBOL: Literal["B"] = "B"


def bias_instability(fit: Fit, z: float | None) -> tuple[Entry | None, Remark | None]:
    """B = min over τ of the model's Allan deviation / √(2 ln 2/π), over all averaging times that the record shows.

    At the minimum a change of τ matters to second order only, so that with A = σ²(τ)

        ∂ ln B/∂ ln θ = ½ ∂ ln A/∂ ln θ at the τ of the minimum,

    and the interval is B exp(±z SE(ln B)). The errors are those in which terms that are zero are free. Where the curve
    still falls at the last τ, or nowhere after its minimum is above it by z standard errors of the difference, or rises
    from the first τ on, B is only bounded, by the upper end of that interval. Lines are left out: between its teeth the
    curve of a line is low without any noise being low there.

    Such a bound trusts the model where the data hardly reach: flicker noise that it does not have lies above it. B is
    at most σ(τ) at any τ, so that the upper confidence limit of the measured σ at one level is a limit without a model.
    The least of these upper limits, at the confidence of the curve, is taken if it is the larger one.

    Parameters
    ----------
    fit : Fit
        Without terms that act as others.
    z : float or None
        Reach of the interval in standard errors; None if these are not known.

    Returns
    -------
    Entry or None, and a Remark or None
    """
    wv = fit.wavelet_variance
    noises = tuple(process for process in fit.model.processes if process.line(wv.rate) is None)
    lines = tuple(process for process in fit.model.processes if process.line(wv.rate) is not None)
    if not noises:
        return None, Remark.of("no-bias-instability", wv.axis, reason=f"{fit.model.structure} has no noise")
    model = Model(noises)
    last = 2 ** (int(wv.levels[-1]) - 1)
    unit, factor = noise_unit(0.0, wv.unit)
    factor /= LAWS[SYMBOL].factor
    n = lowest(lambda sizes: model.allan_variance(sizes, wv.rate), last)
    least = float(model.allan_variance([n], wv.rate)[0])
    if least == 0:
        return None, Remark.of("no-bias-instability", wv.axis, reason="the model is zero")
    curve = None if z is None else Curve.of(fit).without_lines()
    bounded = _bounded(model, n, last=last, rate=wv.rate, curve=curve, z=z)
    reached = {"tau": Quantity((1 if bounded == "rises" else last) / wv.rate, "s")}
    remark = None if bounded is None else Remark.of("b-limit", wv.axis, because=bounded, source="model", **reached)
    value = factor * math.sqrt(least)
    entry = Entry(
        symbol=SYMBOL,
        title=LAWS[SYMBOL].name,
        value=value,
        low=None,
        high=None,
        unit=unit,
        term=None,
        upper_only=remark is not None,
        tau=n / wv.rate,
    )
    if set(model.parameters) <= model.fixed_names:
        return replace(entry, low=value, high=value, held=True), remark
    if z is None or curve is None:
        return entry, remark
    reach = math.exp(min(0.5 * z * curve.error(curve.slopes(n)) / least, ENDLESS))
    if remark is None or bounded is None:
        return replace(entry, low=value / reach, high=value * reach), None
    high = value * reach
    measured = _of_data(wv, model, lines, n)
    if measured is not None and factor * measured > high:
        high = factor * measured
        remark = Remark.of("b-limit", wv.axis, because=bounded, source="data", **reached)
    return replace(entry, low=0.0, high=high), remark


def _of_data(wv: WaveletVariance, model: Model, lines: tuple[Process, ...], n: int) -> float | None:
    """Least upper limit of the measured Allan deviation without its lines.

    With the Haar filter the Allan variance is 2 ν²; with another one it is that of the model times the ratio of data to
    model. None where the levels beside the model's lowest point are not there: the data may say nothing of it.
    """
    implied = model.wavelet_variance(wv.levels, wv.rate, wv.filter)
    added = sum((line.wavelet_variance(wv.levels, wv.rate, wv.filter) for line in lines), np.zeros(len(wv)))
    # A variance of zero is that of a coarse output, not of its noise.
    seen = (wv.variance > 0) & (wv.upper > added) & (implied > 0)
    if not {n.bit_length(), (n - 1).bit_length() + 1} <= set(wv.levels[seen].tolist()):
        return None
    sizes = np.left_shift(1, wv.levels[seen] - 1)
    ours = model.allan_variance(sizes, wv.rate)
    high = np.sqrt(ours * (wv.upper[seen] - added[seen]) / implied[seen])
    return float(high.min())


def lowest(curve: Callable[[NDArray[np.int64]], Vector], last: int) -> int:
    """The whole number of samples from 1 to `last` at which a curve is lowest; exact where it has few turns an octave.

    >>> lowest(lambda n: (n - 1000.3) ** 2, 10**6)
    1000
    """
    count = 2 + math.ceil(_PER_OCTAVE * math.log2(last))
    sizes = np.unique(np.round(np.geomspace(1, last, count)).astype(np.int64))
    while True:
        k = int(np.argmin(curve(sizes)))
        low, high = int(sizes[max(k - 1, 0)]), int(sizes[min(k + 1, sizes.size - 1)])
        if high - low <= 2:
            return int(sizes[k])
        # Whole numbers between the neighbours; where there are few enough, all of them.
        sizes = np.unique(np.linspace(low, high, min(_ZOOM, high - low) + 1).astype(np.int64))


def _bounded(model: Model, n: int, last: int, rate: float, curve: Curve | None, z: float | None) -> str | None:
    """Why the minimum is only a bound: "falls" to the end, "rises" from the start, or "unsure"; None if it is none."""
    ends, least = model.allan_variance([1, last], rate), model.allan_variance([n], rate)[0]
    # Of a flat curve n is wherever rounding has its least value.
    if ends.max() <= (1 + _LEVEL) * least:
        return None
    if n == last:
        return "falls"
    if n == 1:
        return "rises"
    if z is None or curve is None:
        return None
    later = [2**k for k in range(n.bit_length(), last.bit_length())]
    rises = model.allan_variance(later, rate) - least
    here = curve.slopes(n)
    if not any(rise > z * curve.error(curve.slopes(m) - here) for m, rise in zip(later, rises, strict=True)):
        return "unsure"
    return None
