"""Allan variance linear regression: estimate Q, N, B, K and R from lines of fixed slope in an Allan deviation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Booleans, Vector, require_rate
from gmwm.base.documents import Documented
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Remark, texts
from gmwm.base.results import Plotted
from gmwm.base.text import Summarised, with_article
from gmwm.base.units import datasheet_units, find_unit, noise_unit
from gmwm.measuring.variance.allan import allan_variance
from gmwm.measuring.variance.clusters import ClusterVariance
from gmwm.recording.options import one_of
from gmwm.recording.signals import Signal

Term: TypeAlias = Literal["Q", "N", "B", "K", "R"]
"""Noise terms of IEEE Std 952: quantization, random walk, bias instability, rate random walk, rate ramp."""


@dataclass(frozen=True)
class _Law:
    """Power law of a term, σ(τ) = factor · coefficient · τ^slope, by IEEE Std 952."""

    name: str
    slope: float
    factor: float


LAWS: dict[Term, _Law] = {
    "Q": _Law("quantization noise", -1.0, math.sqrt(3)),
    "N": _Law("angle or velocity random walk", -0.5, 1.0),
    "B": _Law("bias instability", 0.0, math.sqrt(2 * math.log(2) / math.pi)),
    "K": _Law("rate random walk", 0.5, 1 / math.sqrt(3)),
    "R": _Law("rate ramp", 1.0, 1 / math.sqrt(2)),
}
"""The terms of an Allan deviation, by ascending slope."""


def coefficient_unit(term: Term, unit: str, units: Literal["si", "datasheet"] = "si") -> tuple[str, float]:
    """Return the unit of a coefficient for data in `unit`, and the factor from its unit and seconds."""
    one_of(units, "units", ("si", "datasheet"))
    if units == "datasheet" and find_unit(unit) is None:
        raise OptionError(
            f"datasheet units need an angular rate or an acceleration; the data have {unit or 'no unit'}",
            argument="unit", got=unit, advice="Use {--units=si}.",
        )  # fmt: skip
    si, factor = noise_unit(-LAWS[term].slope, unit, empty="unit")
    if units == "si":
        return si, factor
    name, size = next(iter(datasheet_units(si).items()))
    return name, size * factor


@dataclass(frozen=True, kw_only=True)
class SlopeLine:
    """Line of fixed slope, fitted to averaging times `first` to `last` (s); `coefficient` in unit of data and s.
    `bound`: only an upper bound, the bias instability of a curve that still falls."""

    term: Term
    coefficient: float
    first: float
    last: float
    points: int
    bound: bool = False

    @property
    def slope(self) -> float:
        """Slope of the line in the logarithmic plot."""
        return LAWS[self.term].slope

    @property
    def name(self) -> str:
        """Name of the coefficient, for example "white noise density"."""
        return LAWS[self.term].name

    @property
    def reading_time(self) -> float:
        """Averaging time (s) at which the line has the value of its coefficient; for B the minimum of the curve."""
        law = LAWS[self.term]
        return self.first if law.slope == 0 else float(law.factor ** (-1 / law.slope))

    def deviation(self, tau: ArrayLike) -> Vector:
        """Compute the Allan deviation of the line at the averaging times `tau` (s)."""
        law = LAWS[self.term]
        return np.asarray(law.factor * self.coefficient * np.asarray(tau, dtype=np.float64) ** law.slope)


_Reason = Literal["slope", "chance", "few", "rising"]  # reason why a term is not found


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class AllanRegression(Documented, Summarised, Plotted):
    """Noise coefficients from the slopes of an Allan deviation, with the fitted lines.

    Attributes
    ----------
    allan : ClusterVariance
        Allan deviation to which the lines are fitted.
    lines : tuple of SlopeLine
        Fitted lines, one for each term that was found.
    remarks : tuple of Remark
        One remark for each term that was not found. Its subject is the term, and its fact `reason` is "slope",
        "chance", "few" or "rising".
    """

    allan: ClusterVariance
    lines: tuple[SlopeLine, ...]
    remarks: tuple[Remark, ...] = ()

    @property
    def coefficients(self) -> dict[str, float]:
        """Coefficient of each term that was found, in the unit of the data and seconds."""
        return {line.term: line.coefficient for line in self.lines}

    def __getitem__(self, term: str) -> SlopeLine:
        for line in self.lines:
            if line.term == term:
                return line
        if any(remark.subject == term for remark in self.remarks):
            raise OptionError(
                argument="term", expected=f"one of the terms found ({', '.join(self.coefficients) or 'none'})",
                got=term, advice="`remarks` has the reason why a term is not found.",
            )  # fmt: skip
        raise OptionError(argument="term", expected=f"one of {', '.join(LAWS)}", got=term)

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain numbers, lists and strings for JSON."""
        unit = self.allan.unit
        lines = [
            {**asdict(line), "slope": line.slope, "name": line.name, "unit": coefficient_unit(line.term, unit)[0],
             "si": line.coefficient * coefficient_unit(line.term, unit)[1]}
            for line in self.lines
        ]  # fmt: skip
        return {"allan": self.allan.to_dict(), "lines": lines, "remarks": [remark.to_dict() for remark in self.remarks]}

    def summary(self, units: Literal["si", "datasheet"] = "si") -> str:
        """Format a table of the coefficients, their units ("si" or "datasheet") and the averaging times of the fits."""
        of = f" of {self.allan.axis}" if self.allan.axis else ""
        title = self.allan.title[0].lower() + self.allan.title[1:]
        rows = [f"Slopes of the {title}{of}: {self.allan.samples} samples at {self.allan.rate:g} Hz"]
        for line in self.lines:
            unit, factor = coefficient_unit(line.term, self.allan.unit, units)
            sign = "<=" if line.bound else "="
            span = f"{line.points} values from {line.first:g} to {line.last:g} s"
            where = span if line.points > 1 else f"at {line.first:g} s"
            rows.append(
                f"{line.term} {sign:>2} {factor * line.coefficient:<11.5g} {unit:<11} {line.name:<30} "
                f"slope {line.slope:+.1f}, {where}"
            )
        rows += texts(self.remarks)
        rows.append("a graphical method: inconsistent where several terms share the range; see avlr")
        return "\n".join(rows)

    def __repr__(self) -> str:
        values = ", ".join(f"{term}={value:.4g}" for term, value in self.coefficients.items())
        return f"AllanRegression({self.allan.axis or 'unnamed'}: {values or 'nothing found'})"


def avlr(
    x: ClusterVariance | Signal | ArrayLike, rate: float | None = None, *,
    terms: Iterable[Term] = ("Q", "N", "B", "K", "R"), ranges: Mapping[Term, tuple[float, float]] | None = None,
    tolerance: float = 0.2, least_freedom: float = 5.0,
) -> AllanRegression:  # fmt: skip
    """Estimate noise coefficients by regression on the slopes of the Allan deviation.

    This is the classical method, which gmwm includes for comparison. In the logarithmic plot of the Allan deviation σ
    over the averaging time τ, each term is a straight line: √3 Q/τ, N/√τ, 0.664 B, K √(τ/3) and R τ/√2. A line is
    fitted to the longest range in which the curve has about the slope of the line, by the mean of log σ − slope · log
    τ. Q is the value of its line at τ = √3 s, N at 1 s, K at 3 s, and R at √2 s. B follows from the minimum of the
    curve.

    The estimator is inconsistent: on any range all other terms add to the curve, and more data do not remove this
    bias. A Gauss-Markov process produces slopes that belong to none of the terms. Use `gmwm.fit` for consistent
    estimates. At the sampling rate f, the coefficients correspond to the parameters σ² = N² f of white noise, γ² = K²/f
    of a random walk, ω = R/f of a drift, and Q² f² of quantization noise.

    Parameters
    ----------
    x : ClusterVariance, Signal, or (N,) array
        Allan or total deviation, or a signal whose Allan deviation is computed at octaves. If averaging times are
        closer than an octave, only some of them are used.
    rate : float
        Sampling rate (Hz), required if `x` is an array.
    terms : sequence
        Terms to estimate.
    ranges : mapping of term to (first, last), optional
        Range of averaging times (s) to which a term is fitted, whatever the slope of the curve is there.
    tolerance : float
        Largest difference between the local slope of the curve and the slope of the term.
    least_freedom : float
        Smallest number of degrees of freedom of the values that are used.

    Returns
    -------
    AllanRegression
        Lines, coefficients, and a remark for each term that was not found.

    Raises
    ------
    DataError
        If the Allan variance of the signal cannot be computed.
    OptionError
        If an option is invalid, or the curve is a modified or a Hadamard deviation, whose lines have other factors.

    References
    ----------
    IEEE Std 952, annex C; Guerrier, S., Molinari, R. and Stebler, Y. (2016), Theoretical limitations of Allan
    variance-based regression for time series model estimation, IEEE Signal Processing Letters 23, 597-601.

    Examples
    --------
    >>> import numpy as np
    >>> x = np.random.default_rng(1).normal(size=40000)
    >>> found = avlr(x, rate=100.0)
    >>> bool(abs(found["N"].coefficient - 0.1) < 0.002)
    True
    """
    allan = x if isinstance(x, ClusterVariance) else allan_variance(x, rate)
    if not isinstance(allan, ClusterVariance):
        raise DataError(
            f"x must be one signal; got {', '.join(allan)}", argument="x", got=x, advice="Pass `{one}`.",
            one=f"x[{next(iter(allan))!r}]",
        )  # fmt: skip
    if allan.family == "hadamard" or allan.kind == "modified":
        raise OptionError(
            f"the lines can be fitted to an Allan deviation only; got {with_article(allan.title)}", argument="x", got=x,
            advice="Use `gmwm.allan_variance`.",
        )  # fmt: skip
    if isinstance(x, ClusterVariance):
        require_rate(rate, allan.rate, "curve")
    requested = list(terms)
    for term in (*requested, *(ranges or {})):
        if term not in LAWS:
            raise OptionError(argument="terms", expected=f"among {', '.join(LAWS)}", got=term)
    if not 0 < tolerance <= 0.5:
        raise OptionError(argument="tolerance", expected="greater than 0 and at most 0.5", got=tolerance)
    used = _octaves(allan.tau, (allan.variance > 0) & (allan.degrees_of_freedom >= least_freedom))
    tau, deviation = allan.tau[used], allan.deviation[used]
    lines: list[SlopeLine] = []
    remarks: list[Remark] = []
    for term in (term for term in LAWS if term in requested):
        if ranges and term in ranges:
            fit = _line(term, tau, deviation, _inside(term, ranges[term], tau))
        elif term == "B":
            fit = _minimum(tau, deviation)
        else:
            fit = _line(
                term, tau, deviation, _fitted_range(np.log(tau), np.log(deviation), LAWS[term].slope, tolerance)
            )
        # A line far above the upper confidence limit of the curve at some averaging time is due to chance.
        if isinstance(fit, SlopeLine) and not (ranges and term in ranges):
            fit = "chance" if np.any(fit.deviation(allan.tau) > 1.5 * allan.upper_deviation) else fit
        if isinstance(fit, SlopeLine):
            lines.append(fit)
        else:
            remarks.append(Remark.of("no-number", term, case="slope", reason=fit, slope=LAWS[term].slope))
    return AllanRegression(allan=allan, lines=tuple(lines), remarks=tuple(remarks))


def _octaves(tau: Vector, usable: Booleans) -> list[int]:
    """Return indices of usable values that are about an octave apart; slopes between closer values are too noisy."""
    indices: list[int] = []
    for k in np.flatnonzero(usable).tolist():
        if not indices or tau[k] >= 1.9 * tau[indices[-1]]:
            indices.append(k)
    return indices


def _inside(term: Term, bounds: tuple[float, float], tau: Vector) -> Booleans:
    inside = (tau >= bounds[0]) & (tau <= bounds[1])
    if not inside.any():
        span = f"{tau[0]:g} … {tau[-1]:g} s" if tau.size else "no averaging time"
        raise OptionError(
            f"the range of {term} contains no usable averaging time; the usable ones are {span}",
            argument="ranges",
            got=bounds,
        )
    return np.asarray(inside)


def _fitted_range(log_tau: Vector, log_deviation: Vector, slope: float, tolerance: float) -> Booleans:
    """Mark the longest run of values with a local slope within `tolerance` of `slope`, if there is one."""
    chosen = np.zeros(log_tau.size, dtype=bool)
    near = np.abs(np.diff(log_deviation) / np.diff(log_tau) - slope) <= tolerance
    length, start = 0.0, None
    for k in range(near.size + 1):
        inside = k < near.size and bool(near[k])
        if inside and start is None:
            start = k
        elif not inside and start is not None:
            if log_tau[k] - log_tau[start] > length:
                length = log_tau[k] - log_tau[start]
                chosen[:] = False
                chosen[start : k + 1] = True
            start = None
    return chosen


def _line(term: Term, tau: Vector, deviation: Vector, chosen: Booleans) -> SlopeLine | _Reason:
    law = LAWS[term]
    if not chosen.any():
        return "slope"
    t, heights = tau[chosen], np.log(deviation[chosen]) - law.slope * np.log(tau[chosen])
    coefficient = math.exp(float(heights.mean())) / law.factor
    return SlopeLine(term=term, coefficient=coefficient, first=float(t[0]), last=float(t[-1]), points=int(t.size))


def _minimum(tau: Vector, deviation: Vector) -> SlopeLine | _Reason:
    if tau.size < 2:
        return "few"
    k = int(np.argmin(deviation))
    if k == 0:
        return "rising"
    at = float(tau[k])
    return SlopeLine(
        term="B", coefficient=float(deviation[k]) / LAWS["B"].factor, first=at, last=at, points=1,
        bound=k == tau.size - 1,
    )  # fmt: skip
