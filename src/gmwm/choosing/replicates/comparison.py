"""Compare recordings: ratios of their wavelet deviations at each scale, tests of them, and the base of the results."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, TypeVar

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import DataError
from gmwm.base.lazy import scipy
from gmwm.base.results import Difference, DifferenceTests
from gmwm.base.statistics import holm
from gmwm.base.text import duration_text, p_relation
from gmwm.measuring.covariance.api import variances
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.variance.result import WaveletVariance


@dataclass(frozen=True, kw_only=True)
class LevelRatio:
    """Ratio of the wavelet deviations of two recordings at one scale, or of one recording to the mean of the others.

    Attributes
    ----------
    axis : str
        Name of the axis.
    recording : str
        Name of the recording in the numerator.
    level : int
        Level j.
    tau : float
        Scale (s).
    ratio : float
        ν_1 / ν_2, the ratio of the wavelet deviations.
    lower, upper : float or None
        Confidence limits of the ratio; None if the level has too few degrees of freedom for a test.
    pvalue : float or None
        p-value of equal noise, adjusted for the number of tests; None if the level is not tested.
    differs : bool
        Whether the test finds a difference.
    """

    ratio: float
    axis: str = ""
    recording: str = ""
    level: int = 0
    tau: float = 0.0
    lower: float | None = None
    upper: float | None = None
    pvalue: float | None = None
    differs: bool = False

    @property
    def difference(self) -> Difference:
        """The ratio in the form of all comparisons."""
        recording = f"recording {self.recording}" if self.recording.isdigit() else self.recording
        name = f"{self.axis} at {duration_text(self.tau)}, {recording}".removeprefix(" ")
        return Difference(
            name=name, ratio=self.ratio, lower=self.lower, upper=self.upper, pvalue=self.pvalue, differs=self.differs
        )  # fmt: skip


class RecordingComparison(DifferenceTests):
    """Base of the answers to the question whether recordings differ, with the same decision and the same ratios."""

    recordings: tuple[str, ...]
    levels: tuple[LevelRatio, ...]
    size: float

    @property
    @abstractmethod
    def pvalue(self) -> float:
        """p-value of all tests together."""

    @property
    def differs(self) -> bool:
        """Whether the tests together find a difference at the significance level `size`."""
        return self.pvalue <= self.size

    @property
    def compared(self) -> tuple[str, ...]:
        """Names of the recordings in the numerators of the ratios: the first of two recordings, otherwise all."""
        return numerators(self.recordings)

    def __repr__(self) -> str:
        answer = "different" if self.differs else "the same"
        return f"{type(self).__name__}({', '.join(self.recordings)}: {answer}, p {p_relation(self.pvalue)})"


class Decidable(Protocol):
    """A dataclass with the p-value of a test, or None if the test cannot be made."""

    @property
    def pvalue(self) -> float | None:
        """The p-value."""


AnyTest = TypeVar("AnyTest", bound=Decidable)


def numerators(names: Iterable[str]) -> tuple[str, ...]:
    """Return the recordings that are divided by the mean of the others; of two, the second would repeat the first."""
    recordings = tuple(names)
    return recordings[: 1 if len(recordings) == 2 else None]


def decide(tests: Sequence[AnyTest], size: float) -> list[AnyTest]:
    """Adjust the p-values of tests by Holm's method, and decide at the level `size` of all tests together."""
    adjusted = holm([math.nan if test.pvalue is None else test.pvalue for test in tests]).tolist()
    return [
        test if test.pvalue is None else replace(test, pvalue=p, differs=p <= size)  # type: ignore[type-var]
        for test, p in zip(tests, adjusted, strict=True)
    ]


def smallest(tests: Iterable[Decidable]) -> float:
    """Return the smallest p-value of tests; 1 if there is none."""
    return min((test.pvalue for test in tests if test.pvalue is not None), default=1.0)


class _Variances(NamedTuple):
    """Wavelet variance (J,) of a recording, and its degrees of freedom (J,)."""

    variance: Vector
    freedom: Vector


def level_ratios(
    curves: Mapping[str, WaveletVariance], axis: str = "", *, confidence: float = 0.95, tolerance: float = 0.0
) -> list[LevelRatio]:
    """Return the ratios of wavelet variances at each common level, with unadjusted p-values; see `same`."""
    measured = list(curves.values())
    levels = min(map(len, measured))
    if not all(np.all(wv.variance[:levels] > 0) for wv in measured):
        raise DataError(f"{axis} has no noise at some scales: its wavelet variance is 0", argument="recordings")
    eta = np.array([wv.degrees_of_freedom[:levels] for wv in measured])
    pooled = np.average([wv.variance[:levels] for wv in measured], axis=0, weights=eta)
    parts = {
        name: _Variances(wv.variance[:levels], _freedom(pooled, eta.sum(axis=0), wv)) for name, wv in curves.items()
    }
    rows = []
    for name in numerators(parts):
        others = _mean([curve for other, curve in parts.items() if other != name])
        for k in range(levels):
            row = _row(parts[name], others, k, confidence=confidence, tolerance=tolerance)
            rows.append(replace(row, axis=axis, recording=name, level=k + 1, tau=float(measured[0].tau[k])))
    return rows


def _mean(curves: Sequence[_Variances]) -> _Variances:
    """Return the mean of independent wavelet variances of the same noise, weighted by their degrees of freedom."""
    freedom = np.sum([curve.freedom for curve in curves], axis=0)
    total = np.sum([curve.freedom * curve.variance for curve in curves], axis=0)
    return _Variances(total / freedom, freedom)


def _row(first: _Variances, second: _Variances, k: int, *, confidence: float, tolerance: float) -> LevelRatio:
    """Return the ratio of two wavelet deviations at the level with index k, and its test."""
    ratio = float(first.variance[k] / second.variance[k])
    degrees = float(first.freedom[k]), float(second.freedom[k])
    if min(degrees) <= 2.0:
        return LevelRatio(ratio=math.sqrt(ratio))
    above = float(scipy.special.fdtrc(*degrees, ratio * math.exp(-2 * tolerance)))
    below = float(scipy.special.fdtr(*degrees, ratio * math.exp(2 * tolerance)))
    lower, upper = (math.sqrt(ratio / float(scipy.special.fdtri(*degrees, (1 + s * confidence) / 2))) for s in (1, -1))
    return LevelRatio(ratio=math.sqrt(ratio), lower=lower, upper=upper, pvalue=min(1.0, 2 * min(above, below)))


def _freedom(pooled: Vector, eta: Vector, wv: WaveletVariance) -> Vector:
    """Return the degrees of freedom η_j (J,) of one wavelet variance under the model for the mean of all recordings."""
    design = Design.of(wv).only(np.arange(len(wv)) < pooled.size)
    curve, model = mixture(pooled, eta, design, random=True)
    return np.asarray(2 * curve**2 / variances(model, design))
