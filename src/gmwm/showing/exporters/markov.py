"""Reduce the slow terms of a model to one Gauss-Markov bias, for programs whose bias is a Gauss-Markov process."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector, freeze
from gmwm.base.remarks import Remark
from gmwm.base.text import duration_text
from gmwm.base.units import SI_UNIT
from gmwm.choosing.datasheets.effective import WALK, counted
from gmwm.choosing.datasheets.equivalent_terms import translated
from gmwm.showing.exporters.base import Noise, TwoNumbers
from gmwm.showing.exporters.reduction import AxisNoise, Number, SensorNoise, ruled
from gmwm.theory.processes.markov import GM

if TYPE_CHECKING:
    from gmwm.calibration import Calibration

Clusters = NDArray[np.int64]
LONGEST = 3600.0
"""Default of the longest averaging time (s) in the fit. For a shorter recording, its length is used."""
POINTS = 25
"""Number of averaging times in the least-squares fit, with equal distances in the logarithm."""
_TRIED = 60
"""Number of correlation times on the grid. The best one is refined afterwards."""
_WIDEST = 4.0
"""Smallest ratio of the longest averaging time to the horizon."""


@dataclass(frozen=True)
class Bias:
    """A Gauss-Markov bias of one axis.

    Attributes
    ----------
    axis : str
        Name of the axis.
    sigma : Number
        Standard deviation (SI), before inflation.
    time : float
        Correlation time (s).
    terms : tuple of str
        Slow terms of the model that it replaces. If there are none, σ is an upper limit.
    error : float
        Largest relative difference in the Allan deviation of the axis, between the bias and the terms that it replaces.
    """

    axis: str
    sigma: Number
    time: float
    terms: tuple[str, ...]
    error: float

    @property
    def walk(self) -> Number:
        """Random walk K = σ √(2/T) (SI), which describes the bias at times far below the correlation time."""
        return self.sigma.scaled(math.sqrt(2 / self.time))


@dataclass(frozen=True)
class _Slow:
    """The slow terms of one axis with their Allan variance.

    Attributes
    ----------
    axis : AxisNoise
        Noise parameters of the axis.
    terms : tuple of str
        The slow terms of the model.
    clusters : (n,) array of int
        Averaging times, in samples.
    slow, white : (n,) arrays
        Allan variance of the slow terms, and of the white noise N.
    """

    axis: AxisNoise
    terms: tuple[str, ...]
    clusters: Clusters
    slow: Vector
    white: Vector

    @classmethod
    def of(cls, one: AxisNoise, low: float, high: float) -> _Slow:
        """Compute the Allan variances of an axis at averaging times from `low` to `high` (s)."""
        written, labels = translated(one.fit)
        rate = one.fit.wavelet_variance.rate
        clusters = np.unique(np.round(np.geomspace(low, high, POINTS) * rate).astype(np.int64))
        clusters = clusters[clusters >= 1]
        parts = {
            label: p.allan_variance(clusters, rate)
            for label, p in zip(labels, written.model.processes, strict=True)
            if p.scale > 0 and p.line(rate) is None and WALK in counted(p, one.use, rate)
        }
        slow = np.asarray(np.sum(list(parts.values()), axis=0) if parts else np.zeros(clusters.size))
        return cls(axis=one, terms=tuple(parts), clusters=clusters, slow=slow, white=one.N.value**2 * rate / clusters)

    def unit(self, time: float) -> Vector:
        """Return the Allan variance (n,) of a Gauss-Markov process with variance 1 and a correlation time (s)."""
        return _unit(time, self.clusters.tobytes(), self.axis.fit.wavelet_variance.rate)

    def fitted(self, time: float) -> tuple[float, float]:
        """Return the best variance of the bias for a correlation time, and the weighted sum of squares of the fit."""
        ratio = np.log(self.slow / self.unit(time))
        weights = (self.slow / (self.slow + self.white)) ** 2
        best = float(np.sum(weights * ratio) / np.sum(weights))
        return math.exp(best), float(np.sum(weights * (ratio - best) ** 2))

    def error(self, time: float, variance: float) -> float:
        """Return the largest relative difference between two Allan deviations: white noise with the bias, and with the
        slow terms."""
        ratio = (variance * self.unit(time) + self.white) / (self.slow + self.white)
        return float(np.max(np.abs(np.sqrt(ratio) - 1)))


@lru_cache(maxsize=4096)
def _unit(time: float, clusters: bytes, rate: float) -> Vector:
    """Compute `_Slow.unit`, which several axes and formats need for the same correlation times."""
    return freeze(GM(beta=1 / time, sigma2=1.0).allan_variance(np.frombuffer(clusters, dtype=np.int64), rate))


def biases(axes: Sequence[AxisNoise], low: float, high: float, *, common: bool) -> dict[str, Bias]:
    """Fit a Gauss-Markov bias to the slow terms of each axis by least squares on the logarithm of the Allan variance.

    The weight of each averaging time is the squared share of the slow terms in its Allan variance. The rest is white
    noise, which does not depend on the bias.

    Parameters
    ----------
    axes : sequence of AxisNoise
        Noise parameters of the axes.
    low, high : float
        Shortest and longest averaging time (s), which are also the limits of the correlation time.
    common : bool
        Whether all axes have the same correlation time.

    Returns
    -------
    mapping of axis to Bias
        If an axis has no slow terms, σ is an upper limit: the RMS over the longest averaging time of a random walk with
        the upper limit of K.
    """
    known = {one.axis: _Slow.of(one, low, high) for one in axes}
    found = {}
    for group in [list(axes)] if common else [[one] for one in axes]:
        some = [known[one.axis] for one in group if known[one.axis].terms]
        time = _time(some, low, high) if some else high
        for one in group:
            slow = known[one.axis]
            if slow.terms:
                variance, _ = slow.fitted(time)
                sigma, error = Number(math.sqrt(variance), False), slow.error(time, variance)
            else:
                sigma, error = one.K.scaled(math.sqrt(high / 6)), 0.0
            found[one.axis] = Bias(axis=one.axis, sigma=sigma, time=time, terms=slow.terms, error=error)
    return found


def _time(axes: Sequence[_Slow], low: float, high: float) -> float:
    """Return the correlation time (s) with the smallest sum of squares over all axes, with the best variance of each
    axis."""
    from scipy.optimize import minimize_scalar

    def squares(log_time: float) -> float:
        return sum(one.fitted(math.exp(log_time))[1] for one in axes)

    grid = np.linspace(math.log(low), math.log(high), _TRIED)
    best = int(np.argmin([squares(float(x)) for x in grid]))
    ends = float(grid[max(best - 1, 0)]), float(grid[min(best + 1, _TRIED - 1)])
    found = minimize_scalar(squares, bounds=ends, method="bounded", options={"xatol": 1e-10})
    return math.exp(min((float(found.x), *ends), key=squares))


class GaussMarkov(TwoNumbers):
    """Base class of formats with white noise N and a Gauss-Markov bias.

    The bias has the standard deviation σ and the correlation time T.

    Attributes
    ----------
    common : bool
        Whether the program has one correlation time for all axes.
    """

    takes = frozenset({"axes", "inflation", "horizon", "duration", "rate"})
    per_axis = True
    common: ClassVar[bool] = False

    @abstractmethod
    def rows(self, noise: Noise, found: Mapping[str, Bias]) -> Sequence[str]:
        """Return the lines below the head, in ASCII, for N and the bias of each axis."""

    def body(self, noise: Noise) -> Sequence[str]:
        """Return the lines below the head."""
        return self.rows(noise, self.biases(noise))

    def _remarks(self, calibration: Calibration, noise: Noise) -> tuple[Remark, ...]:
        # The bias is fitted at all averaging times instead of at the horizon only, so this remark does not apply.
        return tuple(one for one in super()._remarks(calibration, noise) if one.code != "counted-at-horizon")

    def biases(self, noise: Noise) -> dict[str, Bias]:
        """Return the Gauss-Markov bias of each axis for the options of the file."""
        known: dict[str, dict[str, Bias]] = noise.__dict__
        if "_biases" not in known:
            low, high = band(noise)
            axes = [one for sensor in noise.sensors for one in sensor.axes]
            known["_biases"] = biases(axes, low, high, common=self.common)
        return known["_biases"]

    def head(self, calibration: Calibration, noise: Noise) -> list[str]:
        """Return the paragraphs of the head, including the averaging times and the error of the fit."""
        low, high = band(noise)
        found = self.biases(noise)
        lines = [
            "Bias: the Gauss-Markov process that is nearest to the slow terms in the Allan deviation at averaging "
            f"times from {duration_text(low, 3)} to {duration_text(high, 3)}, by least squares of the logarithm."
        ]
        for sensor in noise.sensors:
            lines += [_sentence(found[one.axis], SI_UNIT[sensor.quantity], high) for one in sensor.axes]
        return [*super().head(calibration, noise), *lines]


def _sentence(bias: Bias, unit: str, high: float) -> str:
    if not bias.terms:
        return (
            f"Bias of {bias.axis}: the model has no slow term. sigma {bias.sigma.value:.3g} {unit} is an UPPER LIMIT, "
            f"not a measured value, and T = {bias.time:.4g} s is not measured."
        )
    at_end = (
        " T is the end of the band, because the slow terms do not level off within it."
        if bias.time > 0.999 * high
        else ""
    )
    return (
        f"Bias of {bias.axis}: sigma {bias.sigma.value:.3g} {unit}, T {bias.time:.4g} s, for {', '.join(bias.terms)}; "
        f"it changes the Allan deviation by at most {max(100 * bias.error, 0.01):.2g} %.{at_end}"
    )


def band(noise: Noise) -> tuple[float, float]:
    """Return the shortest and the longest averaging time (s) of the fit."""
    low = noise.options.horizon
    if noise.options.duration is not None:
        return low, max(noise.options.duration, _WIDEST * low)
    lengths = [one.fit.wavelet_variance.samples / one.fit.wavelet_variance.rate
               for sensor in noise.sensors for one in sensor.axes]  # fmt: skip
    return low, max(min(LONGEST, *lengths), _WIDEST * low)


def of_sensor(sensor: SensorNoise, found: Mapping[str, Bias], noise: Noise) -> tuple[tuple[Number, float], ...]:
    """Return σ (after inflation) and T for the x, y and z axes of a sensor, combined by the rule of the file."""
    rule, inflation = noise.options.axes, noise.options.inflation
    if rule == "worst":
        one = found[sensor.worst.axis]
        return ((one.sigma.scaled(inflation), one.time),) * 3
    sigmas = ruled([(one.axis, found[one.axis].sigma) for one in sensor.axes], rule, inflation)
    if rule == "each":
        order = sorted(one.axis for one in sensor.axes)
        return tuple((sigma, found[axis].time) for sigma, axis in zip(sigmas, order, strict=True))
    longest = max(found[one.axis].time for one in sensor.axes)
    return tuple((sigma, longest) for sigma in sigmas)
