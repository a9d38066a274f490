"""Result of an Allan, Hadamard or total variance, with confidence limits and noise types."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

import numpy as np

from gmwm.base.arrays import Integers, Vector, freeze
from gmwm.base.documents import Documented
from gmwm.base.errors import OptionError
from gmwm.base.results import Plotted
from gmwm.base.text import Summarised
from gmwm.measuring.axis_results import chi_square_limits, rate_words
from gmwm.measuring.variance.noise_type import NoiseType, noise_type
from gmwm.measuring.variance.phase import Data, Phase
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.signals import Signal

Family: TypeAlias = Literal["allan", "hadamard", "total"]
Kind: TypeAlias = Literal["overlapping", "nonoverlapping", "modified"]

_TITLES = {
    ("allan", "overlapping"): "Overlapping Allan", ("allan", "nonoverlapping"): "Allan",
    ("allan", "modified"): "Modified Allan", ("hadamard", "overlapping"): "Overlapping Hadamard",
    ("hadamard", "nonoverlapping"): "Hadamard", ("total", "overlapping"): "Total Allan",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ClusterVariance(Documented, Summarised, Plotted):
    """Allan, Hadamard or total variance of a signal at averaging times τ = n Δt, with chi-square limits.

    Attributes
    ----------
    family, kind : str
        "allan", "hadamard" or "total", and "overlapping", "nonoverlapping" or "modified", as for `allan_variance`.
    clusters : (J,) int array
        Cluster sizes n (samples), ascending.
    variance, lower, upper : (J,) arrays, in unit²
        Estimate and limits at the level `confidence`.
    counts : (J,) int array
        Number of squared differences that each estimate averages.
    degrees_of_freedom : (J,) array
        Equivalent degrees of freedom under the identified noise.
    noise : tuple of J str
        Dominant noise at each cluster size, such as "white FM"; `noise_terms` has the names used for inertial sensors.
    rate, confidence : float
        Sampling rate (Hz), and confidence level of the limits.
    samples : int
        Number of input values. A recording of N intervals has N values of the rate, or N + 1 values of the phase.
    unit, axis : str
        Unit of the rate, and therefore of the deviation, and name of the axis.
    data : "rate" or "phase"
        Kind of the input values.
    """

    family: Family
    kind: Kind
    clusters: Integers
    variance: Vector
    lower: Vector
    upper: Vector
    counts: Integers
    degrees_of_freedom: Vector
    noise: tuple[str, ...]
    rate: float
    samples: int
    unit: str = ""
    axis: str = ""
    confidence: float = 0.95
    data: Data = "rate"

    document_keys = (
        "family", "kind", "clusters", "variance", "lower", "upper", "counts", "degrees_of_freedom", "noise", "rate",
        "samples", "unit", "axis", "confidence", "data", "tau", "deviation", "lower_deviation", "upper_deviation",
        "noise_terms",
    )  # fmt: skip

    def __post_init__(self) -> None:
        if (self.family, self.kind) not in _TITLES:
            raise OptionError(f"the family {self.family!r} has no kind {self.kind!r}", argument="kind", got=self.kind)
        for name in ("clusters", "variance", "lower", "upper", "counts", "degrees_of_freedom"):
            freeze(getattr(self, name))

    @property
    def tau(self) -> Vector:
        """Averaging times τ = n Δt (s)."""
        return self.clusters / self.rate

    @property
    def deviation(self) -> Vector:
        """Square root of the variance (unit)."""
        return np.sqrt(self.variance)

    @property
    def lower_deviation(self) -> Vector:
        """Square root of the lower limit (unit)."""
        return np.sqrt(self.lower)

    @property
    def upper_deviation(self) -> Vector:
        """Square root of the upper limit (unit)."""
        return np.sqrt(self.upper)

    @property
    def noise_terms(self) -> tuple[str, ...]:
        """Name for inertial sensors of the dominant noise at each cluster size; "" if there is none."""
        return tuple(noise_type(name).term for name in self.noise)

    @property
    def title(self) -> str:
        """Name of the quantity, such as "Overlapping Allan deviation"."""
        return f"{_TITLES[self.family, self.kind]} deviation"

    def summary(self) -> str:
        """Format a table of the averaging time, deviation, limits, degrees of freedom and noise type of each cluster
        size."""
        unit = f" ({self.unit})" if self.unit else ""
        of = f" of {self.axis}" if self.axis else ""
        lines = [
            f"{self.title}{of}{unit}: {self.samples} samples of the {self.data} {rate_words(self.rate, self.unit)}",
            f"{'cluster':>9} {'tau [s]':>12} {'deviation':>12} {'lower':>12} {'upper':>12} {'edf':>9}  noise",
        ]
        columns = (
            self.clusters, self.tau, self.deviation, self.lower_deviation, self.upper_deviation,
            self.degrees_of_freedom, self.noise, self.noise_terms,
        )  # fmt: skip
        for n, tau, value, low, high, freedom, name, term in zip(*columns, strict=True):
            words = f"{name} ({term})" if term else name
            lines.append(f"{n:9d} {tau:12.6g} {value:12.5e} {low:12.4e} {high:12.4e} {freedom:9.1f}  {words}")
        lines.append(f"limits: {100 * self.confidence:g} % chi-square")
        return "\n".join(lines)

    def __len__(self) -> int:
        return int(self.clusters.size)

    def __repr__(self) -> str:
        return (
            f"ClusterVariance({self.axis or 'unnamed'}, {self.title.removesuffix(' deviation')}, {len(self)} "
            f"cluster sizes, {self.samples} samples {rate_words(self.rate, self.unit)})"
        )


def cluster_variance(
    phase: Phase, noise: Sequence[NoiseType], confidence: float, *, bias: Vector | float = 1.0, **values: Any
) -> ClusterVariance:
    """Return the result of a phase. Its limits are those of the variance over `bias`; `values` are other fields."""
    lower, upper = chi_square_limits(values["variance"] / bias, values["degrees_of_freedom"], confidence)
    return ClusterVariance(
        lower=lower, upper=upper, noise=tuple(kind.name for kind in noise), rate=phase.rate, samples=phase.samples,
        unit=phase.unit, axis=phase.axis, data=phase.data, confidence=confidence, **values,
    )  # fmt: skip


def over_segments(
    x: Any, measure: Callable[[Any, Any], ClusterVariance], clusters: Any, divisor: int
) -> ClusterVariance | None:
    """Return variances pooled over segments; None for a signal without unfilled gaps. `measure` takes a signal and
    cluster sizes, up to N/divisor of a segment with N samples."""
    if not isinstance(x, Signal) or len(x.segments) == 1:
        return None
    filled = x.fill_gaps()
    segments = [values for values in filled.segment_values() if values.size >= MINIMUM_SAMPLES]
    if len(filled.segments) == 1 or not segments:
        return None
    segments.sort(key=len, reverse=True)
    curves: list[ClusterVariance] = []
    for values in segments:
        sizes = clusters
        if not isinstance(clusters, str) and curves:  # the longest segment shows whether all sizes are possible
            sizes = [n for n in clusters if n <= values.size // divisor]
        if isinstance(sizes, str) or len(sizes):
            curves.append(measure(Signal(values, x.rate, x.unit, x.axis), sizes))
    return _pooled(curves, len(filled))


def _pooled(curves: Sequence[ClusterVariance], samples: int) -> ClusterVariance:
    """Return the mean of segments' curves, longest first, by numbers of differences; Var(Σ w v) = Σ w² 2 v²/edf."""
    first = curves[0]
    terms = np.zeros((4, len(first)))  # Σ c, Σ c v, Σ c v/b and Σ c²/edf, with the counts c and the bias b
    for curve in curves:
        at = np.searchsorted(first.clusters, curve.clusters)
        low, _ = chi_square_limits(curve.variance, curve.degrees_of_freedom, curve.confidence)
        bias = np.divide(low, curve.lower, out=np.ones(len(curve)), where=curve.lower > 0)
        counts = curve.counts.astype(np.float64)
        rows = (counts, counts * curve.variance, counts * curve.variance / bias, counts**2 / curve.degrees_of_freedom)
        for row, values in zip(terms, rows, strict=True):
            row[at] += values
    freedom = terms[0] ** 2 / terms[3]
    lower, upper = chi_square_limits(terms[2] / terms[0], freedom, first.confidence)
    return replace(
        first, variance=terms[1] / terms[0], lower=lower, upper=upper, counts=terms[0].astype(np.int64),
        degrees_of_freedom=freedom, samples=samples,
    )  # fmt: skip
