"""Result of a regression: coefficients with intervals, a joint test, and the effect on the wavelet variance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import FrozenArrays, Matrix, Vector, as_vector
from gmwm.base.documents import Documented, fields_of
from gmwm.base.errors import DataError, OptionError
from gmwm.base.lazy import scipy
from gmwm.base.results import Plotted
from gmwm.base.text import Summarised, duration_text, p_relation
from gmwm.measuring.axis_results import chi_square_limits
from gmwm.measuring.regression.against import TEMPERATURE, WARM_UP, CovariateTerm
from gmwm.measuring.regression.covariates import Basis, Column
from gmwm.measuring.variance.result import WaveletVariance


class Effect(NamedTuple):
    """Effect of a covariate on an axis at given values of the covariate, with a confidence band.

    Attributes
    ----------
    at, value, lower, upper : (m,) arrays
        Values of the covariate, and effect relative to its reference value with the limits, in the unit of the axis.
    """

    at: Vector
    value: Vector
    lower: Vector
    upper: Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class Points(FrozenArrays):
    """Means of an axis over parts (m,), with and without the effect, against the first covariate (time in hours)."""

    at: Vector
    before: Vector
    after: Vector


@dataclass(frozen=True, kw_only=True)
class Coefficient(Documented):
    """One coefficient of a regression.

    Attributes
    ----------
    value, error, unit : float, float, str
        Estimate and standard error in `unit`, the unit of the axis per unit of the column ("" if the axis has none).
    freedom, pvalue : float
        Degrees of freedom of the standard error, and two-sided p-value of the t test that the coefficient is zero.
    """

    value: float
    error: float
    unit: str
    freedom: float
    pvalue: float
    document_keys = ("value", "standard_error=error", "unit", "df=freedom", "pvalue", "interval")

    def interval(self, confidence: float = 0.95) -> tuple[float, float]:
        """Return the interval (low, high) at the level `confidence` from Student's t distribution, in `unit`."""
        reach = float(scipy.special.stdtrit(self.freedom, (1 + confidence) / 2)) * self.error
        return self.value - reach, self.value + reach


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Regression(FrozenArrays, Documented, Summarised, Plotted, Mapping[str, Coefficient]):
    """Regression of one axis on conditions: a mapping from the names of the columns to their coefficients.

    Attributes
    ----------
    axis, unit : str
        Name and unit of the axis.
    basis : Basis
        The covariates, their reference values (at which the effects are zero), and the knots of splines.
    estimates, covariance, freedoms : tuple of p floats, (p, p) array, tuple of p floats
        Estimates β̂ of the coefficients of the p columns, their covariance, and degrees of freedom of each standard
        error.
    statistic, freedom, pvalue : float
        Joint F test that all coefficients are zero: statistic, denominator degrees of freedom (the numerator has p) and
        p-value.
    ranges : mapping of covariate to (lowest, highest)
        Range of each covariate in the recording. The unit of time is hours, or years in recordings of over a year.
    mean : float
        Mean of the axis at the reference values of the covariates.
    tau, tau_error : float or None
        Time constant of a warm-up (s) and its standard error; None without a warm-up.
    block, rate : float
        Length of the blocks over which the covariates were averaged (s), and sampling rate (Hz).
    kept, share : (J,) arrays
        Share of the noise that the regression leaves at each level, and share of the wavelet variance that it explains.
    points : Points
        Means of up to 256 parts of the recording.
    applied : bool
        Whether the effect is subtracted from the axis.
    coarse : tuple of three floats, or None
        First coefficient and its standard error from the longer half of the scales, and the shortest of them (s), if it
        is significantly farther from zero than the coefficient from all scales.
    """

    axis: str
    unit: str
    basis: Basis
    estimates: tuple[float, ...]
    covariance: Matrix
    freedoms: tuple[float, ...]
    statistic: float
    freedom: float
    pvalue: float
    ranges: Mapping[str, tuple[float, float]]
    mean: float
    tau: float | None = None
    tau_error: float | None = None
    block: float
    rate: float
    kept: Vector
    share: Vector
    points: Points
    applied: bool = True
    coarse: tuple[float, float, float] | None = None
    document_keys = (
        "axis", "unit", "against", "coefficients=_coefficients", "covariance", "statistic", "df=freedom", "pvalue",
        "references", "ranges", "knots=_knots", "mean", "tau", "tau_error", "block", "rate", "kept", "share", "points",
        "applied", "coarse",
    )  # fmt: skip

    def __getitem__(self, name: str) -> Coefficient:
        names = list(self)
        if name not in names:
            raise DataError(argument="name", expected=f"one of {', '.join(names)}", got=name)
        k = names.index(name)
        value, error, freedom = self.estimates[k], float(np.sqrt(self.covariance[k, k])), self.freedoms[k]
        pvalue = 2 * float(scipy.special.stdtr(freedom, -abs(value) / error)) if error > 0 else 0.0
        return Coefficient(
            value=value, error=error, unit=per(self.unit, self.columns[k].power), freedom=freedom, pvalue=pvalue
        )

    def __iter__(self) -> Any:
        return iter(column.name for column in self.columns)

    def __len__(self) -> int:
        return len(self.columns)

    @property
    def columns(self) -> tuple[Column, ...]:
        """The columns, in the order of the coefficients."""
        return self.basis.columns

    @property
    def terms(self) -> tuple[CovariateTerm, ...]:
        """The covariates, with the forms of their effects."""
        return self.basis.terms

    @property
    def against(self) -> str:
        """The covariates as text in the format of the option `against`."""
        return " + ".join(map(str, self.terms))

    @property
    def references(self) -> Mapping[str, float]:
        """Value of each covariate at which its effect is zero. The unit of time is hours."""
        return self.basis.references

    @property
    def lag(self) -> dict[str, float]:
        """Delay (s) of the axis behind each covariate that has a lag column."""
        names = [term.name for term in self.terms if term.lag and self[term.name].value]
        return {name: -self[f"{name} lag"].value / self[name].value for name in names}

    def curve(self, at: ArrayLike, name: str | None = None, *, confidence: float = 0.95) -> Effect:
        """Compute the effect of a covariate at given values, relative to its reference value.

        Parameters
        ----------
        at : (m,) array
            Values of the covariate, inside its range in the recording.
        name : str, optional
            The covariate; by default the first one.
        confidence : float
            Confidence level of the band at each point.

        Raises
        ------
        OptionError
            If the covariate is unknown, or a value is outside the range of the recording.
        """
        covariate = self.terms[0].name if name is None else name
        if covariate not in self.references or covariate == WARM_UP:
            names = ", ".join(n for n in self.references if n != WARM_UP)
            raise OptionError(argument="name", expected=f"one of {names or 'none'}", got=covariate)
        points = as_vector(np.atleast_1d(np.asarray(at, dtype=np.float64)), "at")
        low, high = self.ranges[covariate]
        reach = 0.05 * (high - low)
        if np.any(points < low - reach) or np.any(points > high + reach):
            raise OptionError(
                argument="at", expected=f"from {low:.4g} to {high:.4g}, the range of the recording", got=at,
                advice="Record over a larger range; the curve is not known outside.",
            )  # fmt: skip
        rows = self.basis.along(covariate, points)
        value = rows @ np.array(self.estimates)
        error = np.sqrt(np.maximum(np.einsum("ma,ab,mb->m", rows, self.covariance, rows), 0.0))
        width = float(scipy.special.stdtrit(min(self.freedoms), (1 + confidence) / 2)) * error
        return Effect(points, value, value - width, value + width)

    def polynomial(self, reference: float | None = None) -> Vector:
        """Return the bias as a polynomial in (temperature − reference): its coefficients, starting with the constant.

        Sensor drivers that subtract a temperature-dependent bias need this polynomial. PX4 has the parameters
        TC_G0_X0_0 to TC_G0_X3_0 with the reference TC_G0_TREF. ArduPilot has INS_TCAL1_GYR1_X to GYR3_X; they are 10⁶
        times the coefficients of degree 1 to 3 for the reference 35 °C.

        Parameters
        ----------
        reference : float, optional
            Reference temperature (°C); by default the reference of the regression.

        Returns
        -------
        (degree + 1,) array, in the unit of the axis per °C^k

        Raises
        ------
        OptionError
            If the regression has no polynomial in the temperature.
        """
        term = next((t for t in self.terms if t.name == TEMPERATURE and not t.knots), None)
        if term is None:
            raise OptionError(
                f"the regression of {self.axis or 'the axis'} has no polynomial in the temperature",
                argument="reference",
                advice="Use {--against=temperature:3}.",
            )
        coefficients = [self.mean] + [
            self[c.name].value for c in self.columns if c.term == term.name and "lag" not in c.name
        ]
        at = self.references[TEMPERATURE]
        away = 0.0 if reference is None else reference - at
        shifted = np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([away, 1.0])).coef
        return np.pad(shifted, (0, len(coefficients) - shifted.size))

    def corrected(self, wv: WaveletVariance) -> WaveletVariance:
        """Return the wavelet variance of the noise, computed from the wavelet variance `wv` of the residuals.

        A regression also removes a share 1 − `kept` of the noise, mostly at the coarsest levels. The variance of each
        level is divided by the remaining share, and its relative covariance is increased accordingly. From the first
        level on at which less than half of the noise is left, the levels are dropped."""
        # A smaller share of noise left drops this and all coarser levels (docs/validation/regression.md).
        limit = 0.5
        shares = np.concatenate([self.kept, np.zeros(len(wv))])[: len(wv)]
        count = int(np.argmax(shares < limit)) if np.any(shares < limit) else shares.size
        eta = wv.degrees_of_freedom[:count]
        shares, excess = shares[:count], None if wv.excess is None else wv.excess[:count, :count]
        lost = np.diag(2 / eta * (1 / shares - 1))
        variance = wv.variance[:count] / shares
        lower, upper = chi_square_limits(variance, np.maximum(eta * shares, 1.0), wv.confidence)
        robust = {
            name: list(value)[:count] if isinstance(value, Sequence) and len(value) == len(wv) else value
            for name, value in wv.diagnostics.get("robust", {}).items()
        }
        return replace(
            wv, levels=wv.levels[:count].copy(), variance=variance, lower=lower, upper=upper,
            counts=wv.counts[:count].copy(), strides=wv.strides[:count],
            diagnostics=dict(wv.diagnostics) | ({"robust": robust} if robust else {}),
            excess=lost if excess is None else excess + lost, regression=self,
        )  # fmt: skip

    def summary(self) -> str:
        """Write the coefficients with 95 % confidence intervals, and the joint test."""
        lines = [f"{self.axis or 'signal'} against {self.against}" + ("" if self.applied else " (not removed)")]
        for name, coefficient in self.items():
            low, high = coefficient.interval()
            value = f"{coefficient.value:12.5g} ± {coefficient.error:.2g} {coefficient.unit}"
            lines.append(f"  {name:<18} {value}  [{low:.5g}, {high:.5g}]")
        if self.tau is not None:
            spread = "" if self.tau_error is None else f" ± {duration_text(self.tau_error)}"
            lines.append(f"  time constant      {duration_text(self.tau)}{spread}")
        for name, lag in self.lag.items():
            lines.append(f"  lag behind {name}: {'-' * (lag < 0)}{duration_text(abs(lag))}")
        at = ", ".join(
            f"{term.name} {self.references[term.name]:g} {term.unit}".rstrip()
            for term in self.terms
            if term.name in self.references and term.name != WARM_UP
        )
        lines.append(f"  F({len(self)}, {self.freedom:.0f}) = {self.statistic:.4g}, p {p_relation(self.pvalue)}")
        if at:
            lines.append(f"  zero at {at}; blocks of {duration_text(self.block)}")
        return "\n".join(lines)

    def _coefficients(self) -> dict[str, Coefficient]:
        return dict(self)

    def _knots(self) -> Mapping[str, tuple[float, ...]]:
        return self.basis.knots

    @classmethod
    def from_dict(cls, content: Mapping[str, Any]) -> Regression:
        """Create a regression from `content`, the result of `to_dict`."""
        knots = {name: tuple(map(float, values)) for name, values in content["knots"].items()}
        terms = tuple(map(CovariateTerm.parse, content["against"].split("+")))
        coefficients = content["coefficients"].values()
        return cls(
            basis=Basis(terms, content["references"], knots),
            estimates=tuple(float(entry["value"]) for entry in coefficients),
            freedoms=tuple(float(entry["df"]) for entry in coefficients), **fields_of(cls, content),
        )  # fmt: skip

    def __repr__(self) -> str:
        return f"Regression({self.axis or 'signal'} against {self.against}, p {p_relation(self.pvalue)})"


def per(unit: str, power: str) -> str:
    """Return the unit of an axis per unit of a column, such as "(deg/s)/°C"; the unit of the axis if one is unknown."""
    if not unit or not power:
        return unit
    return f"({unit})/({power})" if "/" in power else f"({unit})/{power}" if "/" in unit else f"{unit}/{power}"
