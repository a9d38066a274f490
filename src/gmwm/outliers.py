"""Robust or classical: is a recording contaminated by more than its noise? A test at every level, of a stated size."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm._arrays import Vector, freeze
from gmwm._text import Summarised, counted, rounded
from gmwm.covariance import Design
from gmwm.covariance.ratio import ratio_errors, ratio_law
from gmwm.errors import DataError, OptionError
from gmwm.processes.model import ModelLike
from gmwm.signals import Signal
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.result import WaveletVariance

__all__ = ["Verdict", "contamination"]

HUGE = 10.0
"""Excess from which on it is told as a factor."""
LEAST_FREEDOM = 30.0
"""More degrees of freedom M_j / 2^j than this a level must have for the law of the ratio to hold far out."""
COARSE, COARSEST = 0.4, 0.54
"""Shares of coefficients that are zero: at the first level, steps of 1.5 and 2.1 standard deviations of white noise.

Beyond the first the ratio hangs on where the mean lies between two steps, by up to 15 %; beyond the second that of
every level does, as the noise that passes changes while the mean wanders from step to step."""
FELT = 4
"""Levels that coarse steps are felt in by more than 1 %, from the one that shows them on."""
Reason = Literal["few", "rounded", "nothing"]

_REASONS: Mapping[str, str] = {
    "few": "too few coefficients",
    "rounded": "the output's steps outweigh its noise",
    "nothing": "there is no noise",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict(Summarised):
    """Whether a recording holds more than its noise, level by level.

    Attributes
    ----------
    contaminated : bool
        Whether `pvalue` is at most `size`.
    pvalue : float
        Probability of one level as far out among all those that are tested, and all `comparisons`, if nothing is
        wrong: the smallest p-value times their number, 1 at most. 1 where no level can be tested.
    levels, tau : (J,) arrays
        Levels, and their scales (s).
    excess : (J,) array
        Classical over robust variance, less 1. NaN where one is zero.
    critical : (J,) array
        Excess from which on a level by itself makes the recording contaminated. NaN where it is not tested.
    standard_errors, pvalues : (J,) arrays
        Of log(classical / robust) in Gaussian noise; of each level by itself. NaN where it is not tested.
    left_out : mapping of level to "few", "rounded" or "nothing"
        Levels that are not tested: of too few coefficients, ruled by the steps of a rounding, without noise.
    size, tolerance, efficiency : float
    comparisons : int
    axis : str
    """

    contaminated: bool
    pvalue: float
    levels: NDArray[np.int64]
    tau: Vector
    excess: Vector
    critical: Vector
    standard_errors: Vector
    pvalues: Vector
    left_out: Mapping[int, Reason]
    size: float
    comparisons: int
    tolerance: float
    efficiency: float
    axis: str = ""

    def __post_init__(self) -> None:
        for name in _ARRAYS:
            freeze(getattr(self, name))

    @property
    def tested(self) -> NDArray[np.bool_]:
        """Which levels are tested (J,)."""
        return np.array([int(j) not in self.left_out for j in self.levels], dtype=np.bool_)

    @property
    def exceeding(self) -> NDArray[np.bool_]:
        """At which levels the excess is beyond its critical value (J,)."""
        return np.asarray(
            self.tested & (np.nan_to_num(self.excess, nan=-1.0) >= np.nan_to_num(self.critical, nan=np.inf))
        )

    @property
    def lighter(self) -> NDArray[np.bool_]:
        """At which levels the robust variance is clearly the larger one: of a drift or of rounding (J,)."""
        from scipy.special import gammainc

        place = np.log1p(np.nan_to_num(self.excess)) + np.log1p(self.tolerance)
        error = np.where(self.tested, self.standard_errors, 1.0)
        below = gammainc(*ratio_law(place / error, error, self.efficiency))
        return np.asarray(self.tested & (below <= self._share))

    @property
    def _share(self) -> float:
        """What of the size each level gets."""
        return self.size / (self.comparisons * max(int(np.count_nonzero(self.tested)), 1))

    @property
    def reason(self) -> str:
        """Why levels could not be tested, the most frequent reason; "" if all were."""
        reasons = list(self.left_out.values())
        return _REASONS[max(reasons, key=reasons.count)] if reasons else ""

    def summary(self) -> str:
        """The verdict and what to do about it, in one to three lines."""
        name, number = f"{self.axis}: " if self.axis else "", int(np.count_nonzero(self.tested))
        if not number:
            return f"{name}no level can be tested: {self.reason}"
        p = "p < 0.001" if self.pvalue < 0.001 else f"p = {self.pvalue:.3f}"
        if self.contaminated:
            where = self.exceeding
            most = int(np.argmax(np.where(where, self.excess, -np.inf)))
            at = "" if np.count_nonzero(where) == 1 else f" at {self.tau[most]:.4g} s"
            lines = [
                f"{name}contaminated: at {_seconds(self.tau[where])} the classical wavelet variance exceeds the robust "
                f"one, by {_percent(self.excess[most])}{at} ({p})",
                "the unit was touched, shaken, or its cable moved: use robust=True, and see `gmwm info` for knocks",
            ]
        else:
            lines = [
                f"{name}not contaminated: at none of {counted(number, 'level')}, {self.tau[self.tested][0]:.4g} to "
                f"{self.tau[self.tested][-1]:.4g} s, does the classical wavelet variance exceed the robust one by more "
                f"than chance ({p}); use the classical one"
            ]
        if np.any(self.lighter):
            lines.append(
                f"at {_seconds(self.tau[self.lighter])} the robust one is larger, by up to "
                f"{_percent(-self.excess[self.lighter].min())} of it: rounding, a drift or a hum, which have no tails"
            )
        if "rounded" in self.left_out.values():
            rounded = [j for j, reason in self.left_out.items() if reason == "rounded"]
            lines.append(f"{counted(len(rounded), 'level')} cannot be tested: {_REASONS['rounded']}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """All fields as plain numbers, lists and texts, ready for JSON; None for NaN."""
        plain = {name: [_plain(value) for value in getattr(self, name).tolist()] for name in _ARRAYS}
        scalars = ("contaminated", "pvalue", "size", "comparisons", "tolerance", "efficiency", "axis")
        left_out = {str(level): reason for level, reason in self.left_out.items()}
        return {name: getattr(self, name) for name in scalars} | plain | {"left_out": left_out}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Verdict:
        """The verdict whose `to_dict` gave `values`."""
        arrays = {name: np.array(values[name], dtype=np.float64) for name in _ARRAYS if name != "levels"}
        left_out = {int(level): reason for level, reason in values["left_out"].items()}
        known = get_args(Reason)
        if wrong := [reason for reason in left_out.values() if reason not in known]:
            raise DataError(f"left_out must hold {', '.join(known)}; got {wrong[0]!r}")
        return cls(**{**values, **arrays, "levels": np.array(values["levels"], dtype=np.int64), "left_out": left_out})

    def __str__(self) -> str:
        return self.summary()


_ARRAYS = ("levels", "tau", "excess", "critical", "standard_errors", "pvalues")


def contamination(
    x: Signal | ArrayLike | tuple[WaveletVariance, WaveletVariance],
    rate: float | None = None,
    *,
    model: ModelLike | None = None,
    efficiency: float = 0.6,
    size: float = 0.05,
    comparisons: int = 1,
    tolerance: float = 0.02,
) -> Verdict:
    """Test at every level whether the classical wavelet variance exceeds the robust one by more than chance.

    In Gaussian noise d_j = log(ν̂_j²/ν̃_j²), classical over robust, has mean 0 and

        Var d_j = Σ_{q = 4, 6, …} c_q Σ_u n(u) ρ_j(u)^q / M_j²,

    ρ_j the correlation of the coefficients and c_q of the Hermite expansion of the robust one: see
    `wavelet_covariance`. Knocks, spikes and motion raise the classical one, so the test is one-sided; rounding errors
    and a drift, which have no tails, raise the robust one. A level's p-value is that of d_j − log(1 + tolerance) under
    the gamma law that has this variance and the skewness of the ratio; of L levels and `comparisons` recordings, the
    smallest must be at most size / (L × comparisons). So a unit of six axes whose noise is Gaussian, or lighter in the
    tails, is called contaminated with a probability of `size` at most, whatever the levels have to do with each other.

    Not tested are levels of 30 or fewer degrees of freedom M_j / 2^j, and those that the steps of a coarse rounding
    rule: a level of which 40 % of the coefficients are zero and the three above it, and every level if one has 54 %.
    (White noise has 28 % at the first level if a step is its standard deviation, 50 % if it is twice that.) For this,
    x must be a signal or a robust variance measured here.

    Parameters
    ----------
    x : Signal, (N,) array, or (classical, robust) wavelet variances
        The two must be Haar MODWT variances of the same recording.
    rate : float
        Samples per second (Hz); taken from a Signal or the wavelet variances.
    model : Model, Process or str, optional
        With all its values, for the correlations; by default the likeliest mixture of all processes.
    efficiency : float
        Of the robust estimate, if x is a signal.
    size : float
        Probability of a false alarm among all comparisons, between 0 and 1.
    comparisons : int
        How many recordings are judged together: 6 for the axes of a unit.
    tolerance : float
        Excess that is put up with: 0.02 changes a standard deviation by 1 %. Real noise is not quite Gaussian, which
        a long recording shows.

    Returns
    -------
    Verdict

    Raises
    ------
    DataError
        If the signal cannot have a wavelet variance, or the two are not of the same recording.
    OptionError
        If an option is not one of those it may be.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=100_000)
    >>> print(contamination(x, rate=100.0))  # doctest: +NORMALIZE_WHITESPACE
    not contaminated: at none of 11 levels, 0.02 to 20.48 s, does the classical wavelet variance exceed the robust one
    by more than chance (p = 1.000); use the classical one
    >>> x[50_000:50_100] *= 30.0
    >>> verdict = contamination(x, rate=100.0, comparisons=6)
    >>> verdict.contaminated, verdict.pvalue < 1e-6
    (True, True)
    """
    from scipy.special import gammaincc, gammainccinv

    if not 0 < size < 1:
        raise OptionError(f"size must be between 0 and 1, got {size!r}")
    if isinstance(comparisons, bool) or not isinstance(comparisons, int | np.integer) or comparisons < 1:
        raise OptionError(f"comparisons must be an integer of at least 1, got {comparisons!r}")
    if not 0 <= tolerance < np.inf:
        raise OptionError(f"tolerance must not be negative, got {tolerance!r}")
    classical, robust = _both(x, rate, efficiency)
    left_out = _left_out(robust)
    tested = np.array([int(j) not in left_out for j in robust.levels])
    error = np.full(len(robust), np.nan)
    error[tested] = ratio_errors(robust, tested, model)
    assert robust.efficiency is not None
    both = (classical.variance > 0) & (robust.variance > 0)
    excess = np.where(both, classical.variance, np.nan) / np.where(both, robust.variance, 1.0) - 1
    pvalues, critical = np.full((2, len(robust)), np.nan)
    e, allowed, count = error[tested], np.log1p(tolerance), int(comparisons) * int(np.count_nonzero(tested))
    pvalues[tested] = gammaincc(*ratio_law((np.log1p(excess[tested]) - allowed) / e, e, robust.efficiency))
    if count:
        shape, _ = ratio_law(np.zeros(e.size), e, robust.efficiency)
        place = (gammainccinv(shape, size / count) - shape) / np.sqrt(shape)
        critical[tested] = np.expm1(allowed + e * place)
    pvalue = min(1.0, count * float(np.min(pvalues[tested], initial=1.0))) if count else 1.0
    return Verdict(
        contaminated=pvalue <= size,
        pvalue=pvalue,
        levels=robust.levels.copy(),
        tau=robust.tau.copy(),
        excess=excess,
        critical=critical,
        standard_errors=error,
        pvalues=pvalues,
        left_out=dict(sorted(left_out.items())),
        size=float(size),
        comparisons=int(comparisons),
        tolerance=float(tolerance),
        efficiency=robust.efficiency,
        axis=robust.axis,
    )


def _both(x: Any, rate: float | None, efficiency: float) -> tuple[WaveletVariance, WaveletVariance]:
    """The classical and the robust wavelet variance, of one recording."""
    pair = isinstance(x, tuple | list) and any(isinstance(part, WaveletVariance) for part in x)
    if isinstance(x, WaveletVariance) or (pair and not all(isinstance(part, WaveletVariance) for part in x)):
        raise DataError("x must be a signal, or two wavelet variances of it: (classical, robust)")
    if not pair:
        classical = signal_wavelet_variance(x, rate)
        return classical, signal_wavelet_variance(x, rate, robust=True, efficiency=efficiency)
    if len(x) != 2 or x[0].robust or not x[1].robust:
        kinds = ", ".join("robust" if part.robust else "classical" for part in x)
        raise DataError(f"wavelet variances must come as (classical, robust), got ({kinds})")
    classical, robust = x
    if not all(Design.of(part).running_sum for part in x):
        raise OptionError("the test is of Haar MODWT variances: filter='haar', transform='modwt'")
    same = ("samples", "segments", "rate", "unit", "axis")
    differ = [name for name in same if getattr(classical, name) != getattr(robust, name)]
    if differ or not np.array_equal(classical.levels, robust.levels):
        what = differ[0] if differ else "levels"
        raise DataError(f"the two wavelet variances must be of one recording, but their {what} differ")
    if rate is not None and rate != robust.rate:
        raise OptionError(f"rate={rate:g} contradicts the {robust.rate:g} Hz of the wavelet variances; leave rate out")
    return classical, robust


def _left_out(robust: WaveletVariance) -> dict[int, Reason]:
    """Levels that cannot be tested, and why."""
    freedom = Design.of(robust).degrees_of_freedom
    found = robust.diagnostics.get("robust", {})
    outcomes = found.get("outcome", ["root"] * len(robust))
    zeros = np.array(found.get("zeros", np.zeros(len(robust))))
    # Of a handful of coefficients one that is zero by chance would be a large share.
    rounded = _ruled_by_steps(np.where(freedom > LEAST_FREEDOM, zeros, 0.0))
    left_out: dict[int, Reason] = {}
    for k, level in enumerate(robust.levels.tolist()):
        if zeros[0] == 1 or (robust.variance[k] <= 0 and outcomes[k] != "zero"):
            left_out[level] = "nothing"
        elif rounded[k] or outcomes[k] == "zero":
            left_out[level] = "rounded"
        elif freedom[k] <= LEAST_FREEDOM or outcomes[k] == "mean":
            left_out[level] = "few"
    return left_out


def _ruled_by_steps(zeros: Vector) -> NDArray[np.bool_]:
    """Levels whose ratio shows the steps of the values, from the share of zeros at each level."""
    if np.max(zeros) > COARSEST:
        return np.ones(zeros.size, dtype=np.bool_)
    ruled = np.zeros(zeros.size, dtype=np.bool_)
    for k in np.flatnonzero(zeros > COARSE):
        ruled[k : k + FELT] = True
    return ruled


def _seconds(tau: Vector) -> str:
    """Scales in words: all of them, or from first to last."""
    if tau.size <= 3:
        return ", ".join(f"{t:.4g}" for t in tau) + " s"
    return f"{tau.size} levels from {tau[0]:.4g} to {tau[-1]:.4g} s"


def _percent(share: float) -> str:
    if share >= HUGE:
        return f"a factor of {rounded(1 + share)}"
    return f"{100 * share:.2g} %" if share < 1 else f"{100 * share:.0f} %"


def _plain(value: float) -> float | None:
    return value if value == value else None
