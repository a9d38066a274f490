"""Result of the test for shared noise: wavelet cross-covariances and correlations of several signals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from gmwm.applications.several.matrices import AxisPairs
from gmwm.base.arrays import FrozenArrays, Integers, Matrix, Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.lazy import polars
from gmwm.base.remarks import Dialect, Quantity, Remark, texts
from gmwm.base.results import Plotted, Tabular, register
from gmwm.base.text import Summarised, counted, duration_text, p_text, table_with_rule

_BY_PAIR = ("covariance", "correlation", "lower", "upper", "degrees_of_freedom", "pvalues")


@dataclass(frozen=True, kw_only=True)
class SharedNoise:
    """A scale at which the test finds that two axes share noise.

    Attributes
    ----------
    axes : tuple of two str
        Names of the two axes.
    level : int
        Level j.
    tau : float
        Scale (s).
    correlation, lower, upper : float
        Correlation of the wavelet coefficients, and its lower and upper confidence limits.
    pvalue : float
        p-value of zero correlation, adjusted for the number of tests.
    """

    axes: tuple[str, str]
    level: int
    tau: float
    correlation: float
    lower: float
    upper: float
    pvalue: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class CrossCovariance(FrozenArrays, Summarised, Plotted, Tabular):
    """Covariance and correlation of the noise of several axes at each scale.

    Attributes
    ----------
    axes : tuple of str
        Names of the signals.
    units : mapping of str to str
        Unit of each signal.
    levels : (J,) int array
        Levels j.
    rate : float
        Sampling rate (Hz).
    samples : int
        Number of samples of each signal.
    variance : mapping of str to (J,) array
        Wavelet variance of each signal, in unit².
    covariance : mapping of pair to (J,) array
        Wavelet cross-covariance γ̂ of two signals, in the product of their units, for example `covariance["gyro_x",
        "gyro_z"]`.
    correlation, lower, upper : mapping of pair to (J,) array
        Correlation of the wavelet coefficients, and its confidence limits. The limits are NaN for levels that are not
        tested.
    degrees_of_freedom : mapping of pair to (J,) array
        Degrees of freedom η of each correlation, under the hypothesis that the signals share no noise.
    pvalues : mapping of pair to (J,) array
        p-values of zero correlation, adjusted for all levels and pairs; NaN for levels that are not tested.
    delays : mapping of pair to int
        For each pair of signals that are not aligned in time, the delay (samples) of the second signal relative to the
        first. A negative value means that the second signal is earlier.
    size, confidence : float
        Significance level of all tests together, and confidence level of the limits.
    efficiency : float or None
        Efficiency of the robust estimates; None for classical ones.
    """

    axes: tuple[str, ...]
    units: Mapping[str, str]
    levels: Integers
    rate: float
    samples: int
    variance: Mapping[str, Vector]
    covariance: AxisPairs[Vector]
    correlation: AxisPairs[Vector]
    lower: AxisPairs[Vector]
    upper: AxisPairs[Vector]
    degrees_of_freedom: AxisPairs[Vector]
    pvalues: AxisPairs[Vector]
    delays: AxisPairs[int]
    size: float = 0.05
    confidence: float = 0.95
    efficiency: float | None = None

    @property
    def tau(self) -> Vector:
        """Scales τ_j = 2^j / rate (J,), in seconds."""
        return np.asarray(np.exp2(self.levels.astype(np.float64)) / self.rate)

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """All pairs of axes, as tuples of two names."""
        return tuple(self.covariance)

    @property
    def tests(self) -> int:
        """Number of tests: the levels with enough degrees of freedom, summed over all pairs."""
        return sum(int(np.count_nonzero(np.isfinite(p))) for p in self.pvalues.values())

    @property
    def matrices(self) -> Matrix:
        """Covariance matrices Γ̂_j (J, d, d) of the wavelet coefficients of all axes, in products of their units."""
        out = np.empty((self.levels.size, len(self.axes), len(self.axes)))
        for k, a in enumerate(self.axes):
            out[:, k, k] = self.variance[a]
            for m, b in enumerate(self.axes[:k]):
                out[:, k, m] = out[:, m, k] = self.covariance[a, b]
        return out

    @cached_property
    def shared(self) -> tuple[SharedNoise, ...]:
        """The scales at which two axes share noise, sorted by p-value."""
        scales = [
            SharedNoise(
                axes=pair, level=int(self.levels[k]), tau=float(self.tau[k]), pvalue=float(p[k]),
                correlation=float(self.correlation[pair][k]), lower=float(self.lower[pair][k]),
                upper=float(self.upper[pair][k]),
            )
            for pair, p in self.pvalues.items()
            for k in np.flatnonzero(p <= self.size)
        ]  # fmt: skip
        return tuple(sorted(scales, key=lambda scale: scale.pvalue))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on whether axes share noise, and on delayed axes."""
        most = max(self.shared, key=lambda scale: abs(scale.correlation), default=None)
        counts = {"size": self.size, "tests": self.tests, "count": len(self.shared)}
        late = [
            Remark.of("axis-delayed", b if d > 0 else a, reference=a if d > 0 else b, samples=abs(d))
            for (a, b), d in self.delays.items()
        ]
        if most is None:
            return (Remark.of("check-passed", case="independent", **counts), *late)
        a, b = most.axes
        tau = Quantity(most.tau, "s")
        shared = Remark.of(
            "noise-shared", case="cross", **counts, first=a, second=b, correlation=most.correlation, tau=tau
        )
        return (shared, *late)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings.

        The key of a pair is a string such as "gyro_x gyro_y". NaN becomes None."""
        return {
            **plain_fields(self, "axes units rate samples size confidence efficiency levels tau variance"),
            "pairs": {
                f"{a} {b}": {name: plain(getattr(self, name)[a, b]) for name in _BY_PAIR}
                | {"delay": self.delays.get((a, b), 0)}
                for a, b in self.pairs
            },
            "remarks": plain(self.remarks),
        }

    coordinates = ("first", "second", "level")

    def to_polars(self) -> polars.DataFrame:
        """Return the correlations as a Polars data frame with one row for each pair and level."""
        return polars.concat(
            polars.DataFrame(
                {
                    "first": [a] * self.levels.size, "second": [b] * self.levels.size, "level": self.levels,
                    "tau": self.tau,
                }
                | {
                    name.removesuffix("s") if name == "pvalues" else name: getattr(self, name)[a, b]
                    for name in _BY_PAIR
                }
            )
            for a, b in self.pairs
        )  # fmt: skip

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Format the largest correlation of each pair that shares noise, and the remarks in a `dialect`."""
        robust = "" if self.efficiency is None else f", robust with efficiency {self.efficiency:g}"
        lines = [
            f"Shared noise of {', '.join(self.axes)}: {self.samples} samples at {self.rate:g} Hz{robust}; "
            f"{counted(self.tests, 'test')}"
        ]
        rows = []
        for a, b in self.pairs:
            mine = [scale for scale in self.shared if set(scale.axes) == {a, b}]
            if mine:
                most = max(mine, key=lambda scale: abs(scale.correlation))
                rows.append([
                    f"{a}, {b}", f"{most.correlation:+.3f}", f"{most.lower:+.3f} … {most.upper:+.3f}",
                    duration_text(most.tau), p_text(most.pvalue), _ranges([scale.level for scale in mine], self.rate),
                ])  # fmt: skip
        if rows:
            head = ["axes", "correlation", f"{100 * self.confidence:g} %", "at τ", "p", "shared at τ"]
            lines += ["", *table_with_rule([head, *rows])]
        return "\n".join([*lines, "", *texts(self.remarks, dialect)])

    def __repr__(self) -> str:
        return f"CrossCovariance({', '.join(self.axes)}: {len(self.shared)} of {self.tests} tests significant)"


register(CrossCovariance, "gmwm.applications.several.plots:plot_cross")


def _ranges(levels: list[int], rate: float) -> str:
    """Format levels as ranges of scales; consecutive levels form one range."""
    runs: list[list[int]] = []
    for level in sorted(levels):
        if runs and level == runs[-1][-1] + 1:
            runs[-1].append(level)
        else:
            runs.append([level])
    ends = [(2.0 ** run[0] / rate, 2.0 ** run[-1] / rate) for run in runs]
    return ", ".join(" … ".join(dict.fromkeys(map(duration_text, pair))) for pair in ends)
