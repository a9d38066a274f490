"""Wavelet variances of one signal, and of all axes of a recording."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Integers, Matrix, Vector, as_rate, as_vector, freeze
from gmwm.base.documents import Documented
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Quantity, Remark, texts
from gmwm.base.results import Plotted, Tabular
from gmwm.base.text import Summarised, counted
from gmwm.measuring.axis_results import AxisResults, chi_square_limits, rate_words
from gmwm.measuring.variance.robust import LARGE_SHARE
from gmwm.measuring.variance.transform import (
    Transform,
    coefficient_counts,
    degrees_of_freedom,
    loss_factor,
    pooled_counts,
)
from gmwm.recording.options import one_of
from gmwm.theory.filters import find_filter

if TYPE_CHECKING:
    from polars import DataFrame


_OUTCOMES = {"mad": "robust-coarse", "mean": "robust-coarse", "zero": "robust-too-large"}
"""Codes of the remarks on robust estimates that do not solve the estimating equation."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class WaveletVariance(Documented, Summarised, Plotted, Tabular):
    """Wavelet variance ν̂² of a signal at the dyadic scales τ_j = 2^j samples, with confidence limits.

    Attributes
    ----------
    levels : (J,) int array
        Levels j, from 1. The level −l is the moment of the lag l, if the filter has lags; see `gmwm.fit`.
    variance, lower, upper : (J,) arrays, in unit²
        Estimates and confidence limits.
    counts : (J,) int array
        Number of wavelet coefficients M_j of each estimate.
    rate, samples : float, int
        Sampling rate (Hz), and length N of the signal, without the missing samples in gaps.
    unit, axis, confidence : str, str, float
        Unit and name of the signal ("" if they are unknown), and confidence level of the limits.
    filter, transform : str
        Name of the wavelet filter, and "modwt" or "dwt".
    segments : tuple of int
        Lengths of the segments between gaps; () for a signal without a gap.
    robust, efficiency : bool, float or None
        Whether the estimates are robust, and their efficiency under Gaussian noise; None for classical estimates.
    diagnostics : mapping
        Details of each level; for robust estimates see `wavelet_variance`.
    filled : int
        Number of samples that replace lost ones, see `Signal.fill_gaps`; they are included in `samples`.
    rise : float or None
        Mean rise per sample over the whole recording with its gaps, by least squares. None if the signal is a single
        segment or a gap has an unknown length.
    strides : tuple of int
        Distance (samples) between the coefficients that each level uses; () if all coefficients are used. See
        `WaveletAccumulator`.
    slope : float or None
        Mean slope of the signal (unit per sample), which gives a drift its sign. None for published values.
    excess : (J, J) array or None
        Relative covariance E of the estimates in addition to the covariance V for a Gaussian signal:
        Cov(ν̂_j², ν̂_k²) = V_jk + E_jk ν_j² ν_k². It accounts for heavy tails, and for effects that were estimated and
        removed before, such as the effect of the temperature. Tests and confidence intervals use it.
    model_error : float
        Relative error τ of the model at each level. It adds τ² to the diagonal of E. The weights of a fit and the
        choice among models use it too.
    regression : gmwm.regression.Regression or None
        Effect of the temperature or of other conditions that was removed from the signal.
    recordings : mapping of name to WaveletVariance
        Curves of several recordings of one unit, whose pooled curve this is; empty for a single recording.

    Examples
    --------
    >>> from gmwm import WN, wavelet_variance
    >>> wv = wavelet_variance(WN(sigma2=4.0).simulate(4096, 100.0, rng=1), rate=100.0)
    >>> wv.tau[:3], wv.counts[:3]
    (array([0.02, 0.04, 0.08]), array([4095, 4093, 4089]))
    >>> bool(wv.lower[0] < 2.0 < wv.upper[0])  # white noise has ν_j² = σ²/2^j
    True
    """

    levels: Integers
    variance: Vector
    lower: Vector
    upper: Vector
    counts: Integers
    rate: float
    samples: int
    unit: str = ""
    axis: str = ""
    confidence: float = 0.95
    filter: str = "haar"
    transform: Transform = "modwt"
    robust: bool = False
    efficiency: float | None = None
    slope: float | None = None
    diagnostics: Mapping[str, Any] = field(default_factory=dict)
    segments: tuple[int, ...] = ()
    filled: int = 0
    rise: float | None = None
    strides: tuple[int, ...] = ()
    excess: Matrix | None = None
    model_error: float = 0.0
    regression: Any = None
    recordings: Mapping[str, WaveletVariance] = field(default_factory=dict)

    document_keys = (
        "levels", "scales", "tau", "variance", "lower", "upper", "counts", "rate", "samples", "segments?", "filled?",
        "rise?", "strides?", "unit?", "axis?", "confidence?", "filter?", "transform?", "robust", "efficiency", "slope?",
        "excess?", "model_error?", "regression?", "diagnostics?", "recordings?",
    )  # fmt: skip

    def __post_init__(self) -> None:
        for name in ("levels", "variance", "lower", "upper", "counts"):
            if getattr(self, name).shape != (self.levels.size,):
                expected, got = f"one number for each of {self.levels.size} levels", getattr(self, name).shape
                raise DataError(argument=name, expected=expected, got=got)
            freeze(getattr(self, name))
        if self.excess is not None:
            if self.excess.shape != (len(self), len(self)):
                raise DataError(
                    argument="excess", expected=f"a {len(self)} x {len(self)} matrix", got=self.excess.shape
                )
            freeze(self.excess)
        if self.strides and len(self.strides) != len(self):
            raise DataError(
                argument="strides", expected=f"empty or one number for each of {len(self)} levels", got=self.strides
            )

    @property
    def scales(self) -> Integers:
        """Scales τ_j = 2^j (samples), and l + 1 for the level −l of a lag."""
        return np.where(self.levels < 0, 1 - self.levels, np.int64(1) << np.maximum(self.levels, 0))

    @property
    def without_lags(self) -> WaveletVariance:
        """Wavelet variance without the autocovariances of first differences at lags."""
        if not np.any(self.levels < 0):
            return self
        return replace(self._at(np.flatnonzero(self.levels > 0)), filter="haar")

    @property
    def tau(self) -> Vector:
        """Scales τ_j Δt (s)."""
        return self.scales / self.rate

    @property
    def degrees_of_freedom(self) -> Vector:
        """Equivalent degrees of freedom (Percival 1995): max(M_j / 2^j, 1) for a MODWT, and M_j for a DWT.

        For several segments see `pooled_counts`. They are divided by `loss_factor`, and multiplied by the efficiency of
        a robust estimate. This is conservative, because the efficiency is higher for correlated coefficients."""
        if self.segments:
            _, eta = pooled_counts(self.segments, self.levels, find_filter(self.filter), self.transform)
        else:
            # Coefficients at a distance of τ/64 have nearly the information of all coefficients.
            counts = self.counts * np.array(self.strides, dtype=np.int64) if self.strides else self.counts
            eta = degrees_of_freedom(counts, self.levels, self.transform)
        return eta * (1.0 if self.efficiency is None else self.efficiency) / self.loss_factor

    @property
    def loss_factor(self) -> float:
        """Factor by which filled samples increase the covariance of the estimates, see `transform.loss_factor`."""
        return loss_factor(self.filled, self.samples)

    @property
    def longest(self) -> int:
        """Length of the longest segment without a gap (samples)."""
        return max(self.segments, default=self.samples)

    @property
    def levels_text(self) -> str:
        """Number of levels and of lags as text, for example "12 levels and 8 lags"."""
        lags = int(np.count_nonzero(self.levels < 0))
        return f"{len(self) - lags} levels" + (f" and {counted(lags, 'lag')}" if lags else "")

    @property
    def extent(self) -> str:
        """Number of recorded and of filled samples, number of segments, and the rate, as text."""
        apart = f" in {len(self.segments)} segments" if self.segments else ""
        if self.recordings:
            apart = f" in {len(self.recordings)} recordings"
        filled = f" and {self.filled} filled ones" if self.filled else ""
        return f"{self.samples - self.filled} samples{filled}{apart} {rate_words(self.rate, self.unit)}"

    @classmethod
    def from_values(
        cls, variance: ArrayLike, samples: int, rate: float, lower: ArrayLike | None = None,
        upper: ArrayLike | None = None, *, robust: bool = False, efficiency: float | None = None, filter: str = "haar",
        transform: Transform = "modwt", confidence: float = 0.95, unit: str = "", axis: str = "",
    ) -> WaveletVariance:  # fmt: skip
        """Create a wavelet variance from published values at the levels 1, 2, ….

        Parameters
        ----------
        variance : (J,) array, in unit²
            Estimates at the scales 2, 4, 8, … samples. There may be fewer levels than the length allows.
        samples, rate : int, float
            Length N of the signal, and sampling rate (Hz).
        lower, upper : (J,) arrays, optional
            Published confidence limits; by default chi-square limits.
        robust, efficiency : bool, float
            Whether the estimates are robust, and their efficiency, 0.6 by default.
        filter, transform, confidence, unit, axis
            The same as the attributes.

        Raises
        ------
        DataError
            If a value is negative or not finite, N is not a whole number, or N is too small for J levels.

        Examples
        --------
        >>> wv = WaveletVariance.from_values([0.5, 0.25, 0.12], samples=1000, rate=100.0)
        >>> wv.tau
        array([0.02, 0.04, 0.08])
        """
        wavelet = find_filter(filter)
        one_of(transform, "transform", ("modwt", "dwt"))
        samples = _checked_samples(samples)
        values = as_vector(variance, "variance").copy()
        if np.any(values < 0):
            raise DataError(argument="variance", expected="zero or positive", got=float(values.min()))
        levels = np.arange(1, values.size + 1, dtype=np.int64)
        counts = coefficient_counts(samples, levels, wavelet, transform)
        if counts[-1] < 1:
            raise DataError(
                f"{values.size} levels need at least {wavelet.width(values.size)} samples; got {samples}",
                argument="samples", got=samples, advice="Pass the length of the signal, or fewer levels.",
            )  # fmt: skip
        efficiency = _checked_efficiency(robust, efficiency)
        eta = degrees_of_freedom(counts, levels, transform) * (efficiency or 1.0)
        low, high = chi_square_limits(values, eta, confidence)
        limits = []
        for name, published, default in (("lower", lower, low), ("upper", upper, high)):
            limit = default if published is None else as_vector(published, name).copy()
            if limit.shape != values.shape:
                raise DataError(argument=name, expected=f"{values.size} values, one for each variance", got=limit)
            limits.append(limit)
        if np.any(limits[0] > values) or np.any(limits[1] < values):
            raise DataError(
                "the limits must enclose the variance: lower ≤ variance ≤ upper at every level", argument="limits"
            )
        return cls(
            levels=levels, variance=values, lower=limits[0], upper=limits[1], counts=counts, rate=as_rate(rate),
            samples=samples, unit=unit, axis=axis, confidence=confidence, filter=wavelet.name, transform=transform,
            robust=robust, efficiency=efficiency,
        )  # fmt: skip

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> WaveletVariance:
        """Restore a result from `values`, the output of `to_dict`."""
        from gmwm.measuring.regression.result import Regression

        regression = values.get("regression")
        result = super().from_dict({**values, "regression": None})
        return result if regression is None else replace(result, regression=Regression.from_dict(regression))

    def require_consistent(self) -> None:
        """Raise a DataError if no recording of this length has these levels, coefficients and degrees of freedom."""
        if self.robust and self.efficiency is None:
            raise DataError("a robust variance must have an efficiency")
        _checked_efficiency(self.robust, self.efficiency)
        levels = self.levels.tolist()
        if (
            not levels
            or not {j for j in levels if j < 1} <= {-lag for lag in find_filter(self.filter).lags}
            or levels != sorted(set(levels))
            or levels[-1] > 62
            or 1 << levels[-1] > self.samples
        ):
            expected = f"levels must ascend from 1, and 2^level must not exceed the {self.samples} samples"
            raise DataError(f"{expected}; got {levels}")
        if not 0 <= self.filled <= self.samples:
            raise DataError(argument="filled", expected=f"from 0 to the {self.samples} samples", got=self.filled)
        if self.segments and (min(self.segments) < 1 or sum(self.segments) != self.samples):
            expected = f"lengths above zero whose sum is the {self.samples} samples"
            raise DataError(argument="segments", expected=expected, got=self.segments)
        strides = np.array(self.strides or [1], dtype=np.float64)
        if np.any(strides < 1) or np.any(strides > self.scales):
            raise DataError(argument="strides", expected="from 1 to 2^level", got=self.strides)
        most = self.samples / strides + max(len(self.segments), 1)
        if np.any(self.counts < 1) or np.any(self.counts > most):
            expected = f"from 1 to {self.samples} at each level, the number of samples"
            raise DataError(argument="counts", expected=expected, got=self.counts.tolist())
        if not np.all(self.degrees_of_freedom > 0):
            raise DataError(
                argument="segments", expected="long enough for a coefficient at each level", got=self.segments
            )

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on levels that must be used with care."""
        outcomes = self.diagnostics.get("robust", {}).get("outcome", [])
        remarks = []
        for outcome, code in _OUTCOMES.items():
            levels = tuple(int(j) for j, result in zip(self.levels, outcomes, strict=False) if result == outcome)
            if levels:
                remarks.append(Remark.of(code, self.axis, case=outcome, levels=levels))
        shares = self.diagnostics.get("robust", {}).get("unrejected", [])
        if shares and max(shares) >= LARGE_SHARE:
            worst = shares.index(max(shares))
            tau, share = Quantity(float(self.tau[worst]), "s"), 100 * shares[worst]
            remarks.append(Remark.of("outliers-found", self.axis, case="unrejected", tau=tau, share=share))
        if any(stride > 1 for stride in self.strides):
            first = next(k for k, stride in enumerate(self.strides) if stride > 1)
            remarks.append(
                Remark.of("approximated", self.axis, case="levels", first=Quantity(float(self.tau[first]), "s"))
            )
        others = [
            remark for curve in self.recordings.values() for remark in curve.remarks if remark.code != "approximated"
        ]
        return tuple(dict.fromkeys([*remarks, *others]))

    coordinates = ("level",)

    def to_polars(self) -> DataFrame:
        """Return the curve as a Polars data frame with one row for each level.

        >>> import gmwm
        >>> gmwm.wavelet_variance([0.0, 1.0] * 8, rate=10.0).to_polars().columns
        ['level', 'tau', 'variance', 'lower', 'upper', 'coefficients', 'degrees_of_freedom']
        """
        from polars import DataFrame

        return DataFrame(
            {
                "level": self.levels, "tau": self.tau, "variance": self.variance, "lower": self.lower,
                "upper": self.upper, "coefficients": self.counts, "degrees_of_freedom": self.degrees_of_freedom,
            }
        )  # fmt: skip

    def summary(self) -> str:
        """Format a table of the scale, the variance, its limits and the number of coefficients of every level."""
        unit = f" ({self.unit})²" if self.unit else ""
        name = self.filter.capitalize() if self.filter.startswith("haar") else self.filter.upper()
        title = f"{name} {self.transform.upper()} wavelet variance"
        lines = [
            f"{title}{' of ' + self.axis if self.axis else ''}: {self.extent}",
            f"{'level':>5} {'tau [s]':>12} {'variance' + unit:>20} {'lower':>12} {'upper':>12} {'coefficients':>13}",
        ]
        lines += [
            f"{j:5d} {tau:12.6g} {v:20.6e} {low:12.4e} {high:12.4e} {m:13d}"
            for j, tau, v, low, high, m in zip(
                self.levels, self.tau, self.variance, self.lower, self.upper, self.counts, strict=True
            )
        ]
        lines.append(f"limits: {100 * self.confidence:g} % chi-square")
        if self.robust:
            lines.append(f"robust, efficiency {self.efficiency:g}")
        lines += texts(remark.about("") for remark in self.remarks)
        return "\n".join(lines)

    def __len__(self) -> int:
        return int(self.levels.size)

    def only(self, levels: Iterable[int]) -> WaveletVariance:
        """Return the curve at some of its levels, to leave the other levels out of a fit.

        `levels` are the levels j to keep, for example ``range(3, 15)``. Raises OptionError if `levels` is empty, or
        contains a level that the curve does not have.

        >>> from gmwm import WN, fit, wavelet_variance
        >>> wv = wavelet_variance(WN(sigma2=4.0).simulate(4096, 100.0, rng=1), rate=100.0)
        >>> len(wv), fit("WN", wv.only(range(2, 8))).wavelet_variance.levels
        (12, array([2, 3, 4, 5, 6, 7]))
        """
        chosen = sorted(set(levels))
        available = self.levels.tolist()
        if not chosen or not set(chosen) <= set(available):
            raise OptionError(argument="levels", expected=f"some of {available[0]} to {available[-1]}", got=levels)
        return self._at(np.searchsorted(self.levels, chosen))

    def first(self, count: int) -> WaveletVariance:
        """Return the curve at its first `count` levels."""
        return self._at(np.arange(min(count, len(self))))

    def _at(self, indices: Integers) -> WaveletVariance:
        """Return the curve at the levels with the indices `kept`."""
        arrays = {name: getattr(self, name)[indices] for name in ("levels", "variance", "lower", "upper", "counts")}
        diagnostics = {name: {key: [values[k] for k in indices if k < len(values)] for key, values in content.items()}
                       if name == "robust" else content for name, content in self.diagnostics.items()}  # fmt: skip
        return replace(
            self, **arrays, diagnostics=diagnostics,
            strides=tuple(self.strides[k] for k in indices) if self.strides else (),
            excess=None if self.excess is None else self.excess[np.ix_(indices, indices)],
            recordings={name: curve._at(indices[indices < len(curve)]) for name, curve in self.recordings.items()},
        )  # fmt: skip

    def __repr__(self) -> str:
        kind = "robust " if self.robust else ""
        return f"WaveletVariance({self.axis or 'unnamed'}, {kind}{self.filter}, {len(self)} levels, {self.extent})"


def _checked_samples(samples: int) -> int:
    """Check that a length is a positive whole number, which may be a float such as 3e6, and return it as an int."""
    is_whole = isinstance(samples, int | float | np.number) and not isinstance(samples, bool) and samples % 1 == 0
    if not is_whole or samples < 1:
        raise DataError(argument="samples", expected="a positive whole number, the length of the signal", got=samples)
    return int(samples)


def _checked_efficiency(robust: bool, efficiency: float | None) -> float | None:
    """Check the efficiency, and return it; None for a classical estimate."""
    from gmwm.measuring.variance.biweight import biweight, unused_efficiency

    if robust:
        value = 0.6 if efficiency is None else efficiency
        biweight(value)
        return float(value)
    if efficiency is not None:
        raise unused_efficiency(efficiency)
    return None


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WaveletVariances(AxisResults[WaveletVariance], Tabular):
    """Wavelet variances of the axes of one recording, as a mapping of axis to `WaveletVariance`.

    Parameters
    ----------
    curves : mapping of axis to WaveletVariance
        The curve of each axis, at least one.

    Examples
    --------
    >>> from gmwm import simulate, wavelet_variance
    >>> curves = wavelet_variance(simulate("WN(sigma2=4e-8)", rate=100.0, samples=1000, rng=1))
    >>> curves["gyro_x"]
    WaveletVariance(gyro_x, haar, 9 levels, 1000 samples at 100 Hz)
    """

    curves: Mapping[str, WaveletVariance]
    noun = "wavelet variance"

    coordinates = ("axis", "level")

    def to_polars(self) -> DataFrame:
        """Return the curves as a Polars data frame with one row for each axis and level."""
        from polars import concat, lit

        return concat([curve.to_polars().select(lit(axis).alias("axis"), "*") for axis, curve in self.items()])

    def summary(self) -> str:
        """Format one table for each sensor, with the variance of each axis at every scale."""
        first = next(iter(self.curves.values()))
        name = first.filter.capitalize() if first.filter == "haar" else first.filter.upper()
        robust = f", robust with efficiency {first.efficiency:g}" if first.robust else ""
        lines = [f"{name} {first.transform.upper()} wavelet variance: {first.extent}{robust}"]
        for _, group in groupby(self.curves, key=lambda axis: axis.rpartition("_")[0] or axis):
            axes = list(group)
            curve = self.curves[axes[0]]
            unit = f"variance in ({curve.unit})²" if curve.unit else "variance"
            lines += ["", unit, f"{'level':>5} {'tau [s]':>12} " + " ".join(f"{axis:>14}" for axis in axes)]
            for k, (j, tau) in enumerate(zip(curve.levels, curve.tau, strict=True)):
                values = " ".join(f"{self.curves[axis].variance[k]:14.6e}" for axis in axes)
                lines.append(f"{j:5d} {tau:12.6g} {values}")
        remarks = texts(remark.about(axis) for axis, wv in self.curves.items() for remark in wv.remarks)
        return "\n".join([*lines, *(["", *remarks] if remarks else [])])

    def __repr__(self) -> str:
        first = next(iter(self.curves.values()))
        kind = "robust " if first.robust else ""
        return f"WaveletVariances({', '.join(self)}: {kind}{first.filter}, {len(first)} levels, {first.extent})"
