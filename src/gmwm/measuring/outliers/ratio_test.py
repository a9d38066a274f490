"""Test for outliers by the ratio of classical to robust variance, by bursts and by spikes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Booleans, FrozenArrays, Vector, as_vector, as_whole_number, require_rate
from gmwm.base.documents import Documented
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Quantity, Remark, texts
from gmwm.base.text import Summarised, round_text
from gmwm.measuring.covariance import Design
from gmwm.measuring.covariance.api import ratio_variances
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.covariance.robust import ratio_skewness
from gmwm.measuring.outliers.bursts import LONGEST, MATERIAL, Bursts
from gmwm.measuring.outliers.cleaning import NOTHING_REPLACED, Replaced, Screen, screened
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_size
from gmwm.recording.signals import Signal
from gmwm.theory.processes.model import ModelLike, as_model


def ratio_errors(robust: WaveletVariance, tested: Booleans, model: ModelLike | None) -> Vector:
    """Compute the standard errors of log(ν̂²/ν̃²) in Gaussian noise at the levels in `tested`, for the classical ν̂²
    and the `robust` ν̃², with correlations of `model`, by default the likeliest mixture of all processes."""
    if not np.any(tested):
        return np.empty(0)
    all_levels = Design.of(robust)
    if model is None:
        positive = robust.variance > 0
        # Scaling by a power of two causes no rounding error and keeps fourth powers within the range of numbers.
        unit = 4.0 ** np.floor(0.5 * np.log2(robust.variance.max()))
        design = all_levels.only(positive)
        _, noise = mixture(robust.variance[positive] / unit, robust.degrees_of_freedom[positive], design)
    else:
        noise = as_model(model)
    square = ratio_variances(noise, all_levels.only(tested))
    assert robust.efficiency is not None
    beyond = 2 / robust.efficiency - 2
    # If the model has no noise, only a drift, one in 2^j coefficients counts as independent.
    square = np.where(square > 0, square, beyond / all_levels.degrees_of_freedom[tested])
    outcomes = robust.diagnostics.get("robust", {}).get("outcome", ["root"] * len(robust))
    fallen = np.array([outcome == "mad" for outcome in outcomes])[tested]
    # Efficiency of (MAD / 0.67449)², used without a root (Rousseeuw and Croux 1993, JASA 88).
    square *= np.where(fallen, max((2 / 0.3675 - 2) / beyond, 1.0), 1.0)
    return np.sqrt(square)


def ratio_law(place: Vector, error: Vector, efficiency: float) -> tuple[Vector, Vector]:
    """Approximate the distribution of log(ν̂²/ν̃²) / `error` by (G − k) / √k with a gamma variable G of the same
    skewness. Returns the shape k, and the argument of `scipy.special.gammaincc` for a larger ratio than `place`."""
    # Factor by which overlapping coefficients increase the skewness; it is 1.1 to 1.45 in simulations.
    # tests/covariance/test_ratio.py and docs/validation/contamination-test.md measure the size of the resulting test.
    shape = (2 / (1.3 * ratio_skewness(efficiency) * error)) ** 2
    return shape, np.maximum(shape + place * np.sqrt(shape), 0.0)


LOW, HIGH = 0.6, 0.9
"""Efficiencies that are compared: the default, and an efficiency that tolerates fewer and smaller outliers."""


@dataclass(frozen=True, kw_only=True)
class Dependence(Documented):
    """Two robust variances at `tau` (s) that differ by more than chance; `value` is that of the fitted curve."""

    tau: float
    efficiency: float
    value: float
    other_efficiency: float
    other_value: float


def other_efficiency(efficiency: float) -> float:
    """Return the efficiency of the robust curve with which a curve of the given efficiency is compared.

    >>> other_efficiency(0.6), other_efficiency(0.95)
    (0.9, 0.6)
    """
    return HIGH if efficiency < 0.5 * (LOW + HIGH) else LOW


def dependence(robust: WaveletVariance, other: WaveletVariance, verdict: Verdict) -> Dependence | None:
    """Return the level at which two robust curves of a recording differ most, if by more than chance and 1 %, or None.
    Both errors are expansions in the same Hermite polynomials, so their log ratio has at most the variance of that of
    the classical to the less efficient curve, whose standard errors are in `verdict`."""
    from scipy.special import ndtri

    assert robust.efficiency is not None
    assert other.efficiency is not None
    usable = verdict.tested & (robust.variance > 0) & (other.variance > 0)
    if not np.any(usable):
        return None
    apart = np.abs(np.log(other.variance[usable] / robust.variance[usable]))
    error = verdict.standard_errors[usable]
    if other.efficiency < robust.efficiency:
        # The standard errors of an efficient curve are smaller: 1 / e - 1 is the variance of uncorrelated coefficients.
        error = error * np.sqrt((1 / other.efficiency - 1) / (1 / robust.efficiency - 1))
    limit = MATERIAL - float(ndtri(verdict.size / (2 * apart.size * verdict.comparisons))) * error
    if not np.any(apart > limit):
        return None
    k = int(np.flatnonzero(usable)[np.argmax(apart / limit)])
    return Dependence(
        tau=float(robust.tau[k]), efficiency=robust.efficiency, value=float(robust.variance[k]),
        other_efficiency=other.efficiency, other_value=float(other.variance[k]),
    )  # fmt: skip


LEAST_FREEDOM = 30.0
"""Number of degrees of freedom M_j / 2^j up to which a level is not tested, because the tail of the distribution of the
ratio is not known well enough (docs/validation/contamination-test.md)."""
COARSE, COARSEST = 0.4, 0.54
"""Shares of zero coefficients at which a level, or every level, is not tested: steps of 1.5 and 2.1 σ of white noise.

From there on, the position of the mean between steps changes the ratio of the level by up to 15 %, or that of every
level, as the mean drifts from step to step (docs/validation/contamination-test.md)."""
TOLERANCE = 0.02  # default of the relative excess that is not reported as outliers
RISES = 2.0
"""Ratio of the excess of a level to that of all finer ones above which pulses of the mean cause it
(tests/outliers/test_pulses.py)."""
SURELY = 0.01
"""Significance level of this test for all levels together (tests/outliers/test_pulses.py)."""
FELT = 4
"""Number of levels, from a coarsely quantized one on, whose ratio changes by more than 1 %; see the same study."""
Reason = Literal["few", "rounded", "nothing"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Verdict(FrozenArrays, Documented, Summarised):
    """The result of the test for outliers, level by level.

    Attributes
    ----------
    contaminated : bool
        Whether outliers raise the classical curve: `pvalue` is at most `size`, and the samples have bursts or isolated
        wrong samples. If only two curves were given, the p-value decides.
    pvalue : float
        p-value for all tested levels and all `comparisons` together: the smallest p-value of a level times their
        number, at most 1. It is 1 if no level can be tested.
    levels, tau : (J,) arrays
        Numbers of the levels, and their scales (s).
    excess, critical : (J,) arrays
        Ratio of the classical to the robust variance, minus 1 (NaN if one is zero), and its value at which a level
        alone makes the recording contaminated (NaN for levels that are not tested).
    standard_errors, pvalues : (J,) arrays
        Standard error of log(classical / robust) in Gaussian noise, and p-value of each level; NaN without a test.
    left_out : mapping of level to "few", "rounded" or "nothing"
        Reason why a level is not tested: too few coefficients, coarse quantization, or no noise.
    size, comparisons, tolerance, efficiency, axis
        The same as for `contamination`, and the name of the axis.
    bursts : Bursts or None
        Knocks and motion in the samples; None if only two curves were given.
    spikes, largest : int, float
        Number of isolated wrong samples in the curves, and their largest deviation, in local standard deviations.
    replaced : Replaced
        The samples that were replaced before the curves were measured; see `calibrate`.
    dependence : Dependence or None
        The level at which the robust curve depends on its efficiency; None if it does not, or if this was not tested.
    """

    document_keys = (
        "contaminated", "pvalue", "size", "comparisons", "tolerance", "efficiency", "axis", "spikes", "largest",
        "levels", "tau", "excess~nan", "critical~nan", "standard_errors~nan", "pvalues~nan", "left_out", "bursts",
        "dependence", "remarks", "replaced",
    )  # fmt: skip
    marks_with_nan: ClassVar[bool] = True
    """True, because the arrays contain NaN for levels without a test."""

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
    bursts: Bursts | None = None
    spikes: int = 0
    largest: float = 0.0
    replaced: Replaced = NOTHING_REPLACED
    dependence: Dependence | None = None

    @property
    def tested(self) -> Booleans:
        """Whether each level is tested, a (J,) array."""
        return np.array([int(j) not in self.left_out for j in self.levels], dtype=np.bool_)

    @property
    def exceeds(self) -> bool:
        """Whether the classical curve exceeds the robust one by more than chance."""
        return self.pvalue <= self.size

    @property
    def heavy_tailed(self) -> bool:
        """Whether the classical curve exceeds the robust one without outliers: the noise has heavy or varying tails."""
        return self.exceeds and not self.contaminated

    @property
    def exceeding(self) -> Booleans:
        """Whether the excess of each level reaches its critical value, a (J,) array."""
        return np.asarray(
            self.tested & (np.nan_to_num(self.excess, nan=-1.0) >= np.nan_to_num(self.critical, nan=np.inf))
        )

    @property
    def rising(self) -> Booleans:
        """Whether the excess of each level is more than chance, and twice that of every finer level, (J,). For white
        noise with tails or a varying variance it falls with the scale; for pulses and jumps of the mean it rises. Above
        10 s it must double the variance: accelerometers at rest have an excess of 20 to 100 % there."""
        from scipy.special import gammaincc

        rises = np.log1p(np.where(self.tested, self.excess, 0.0))
        finer = np.maximum.accumulate(np.append(rises[:1], rises[:-1]))
        place = rises - np.maximum(RISES * finer, np.log1p(self.tolerance))
        error = np.where(self.tested, self.standard_errors, 1.0)
        above = gammaincc(*ratio_law(place / error, error, self.efficiency))
        surely = above <= SURELY / max(int(np.sum(self.tested)), 1)
        return np.asarray(surely & self.tested & ((self.tau <= LONGEST) | (self.excess > 1)))

    @property
    def lighter(self) -> Booleans:
        """Whether the robust variance of each level exceeds the classical one by more than chance: drift or rounding,
        (J,)."""
        from scipy.special import gammainc

        place = np.log1p(np.nan_to_num(self.excess)) + np.log1p(self.tolerance)
        error = np.where(self.tested, self.standard_errors, 1.0)
        below = gammainc(*ratio_law(place / error, error, self.efficiency))
        return np.asarray(self.tested & (below <= self._share))

    @property
    def _share(self) -> float:
        """Significance level of the test at each scale."""
        return self.size / (self.comparisons * max(int(np.count_nonzero(self.tested)), 1))

    @property
    def reason(self) -> Reason | Literal[""]:
        """The most frequent reason why a level was not tested; "" if all levels were tested."""
        reasons = list(self.left_out.values())
        if not reasons:
            return ""
        return max(reasons, key=reasons.count)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the result of the test, and on the levels that were not tested."""
        return tuple(self._remarks())

    def _remarks(self) -> Iterator[Remark]:
        tested = self.tau[self.tested]
        if not tested.size:
            yield Remark.of("outliers-not-tested", self.axis, case="test", reason=self.reason)
            return
        if self.heavy_tailed:
            yield Remark.of(
                "heavy-tails", self.axis, case="test", taus=_scales(self.tau[self.exceeding]), p=self.pvalue
            )
        elif self.contaminated:
            worst = int(np.argmax(np.where(self.exceeding, self.excess, -np.inf)))
            yield Remark.of(
                "outliers-found", self.axis, case="test", taus=_scales(self.tau[self.exceeding]), p=self.pvalue,
                excess=excess_text(float(self.excess[worst])), tau=Quantity(float(self.tau[worst]), "s"),
            )  # fmt: skip
        else:
            first, last = (Quantity(float(tau), "s") for tau in (tested[0], tested[-1]))
            yield Remark.of(
                "check-passed",
                self.axis,
                case="outlier-test",
                levels=tested.size,
                first=first,
                last=last,
                p=self.pvalue,
            )
        if np.any(self.lighter):
            share = -float(self.excess[self.lighter].min())
            yield Remark.of(
                "robust-too-large", self.axis, case="larger", taus=_scales(self.tau[self.lighter]), share=share
            )
        if count := list(self.left_out.values()).count("rounded"):
            yield Remark.of("outliers-not-tested", self.axis, case="levels", count=count)

    def summary(self) -> str:
        """Return the remarks as text, one on each line."""
        return "\n".join(texts(self.remarks))

    def __str__(self) -> str:
        return self.summary()


def contamination(
    x: Signal | ArrayLike | tuple[WaveletVariance, WaveletVariance], rate: float | None = None, *,
    model: ModelLike | None = None, efficiency: float = 0.6, size: float = 0.05, comparisons: int = 1,
    tolerance: float = TOLERANCE, screen: Screen | None = None,
) -> Verdict:  # fmt: skip
    """Test a recording for outliers, by the ratio of the classical to the robust wavelet variance at every level.

    Noise with heavy tails, or with a varying variance, raises this ratio too, because the robust curve then estimates
    another quantity. A signal is therefore contaminated only if its samples also have bursts (at least 1 % of the
    classical variance of a level, in at most 15 % of the time, see `find_bursts`), or isolated wrong samples.

    Let d_j = log(ν̂_j²/ν̃_j²), with the classical variance ν̂_j² and the robust variance ν̃_j² at level j. In Gaussian
    noise, it has mean 0 and the variance

        Var d_j = Σ_{q = 4, 6, …} c_q Σ_u n(u) ρ_j(u)^q / M_j²,

    where M_j is the number of coefficients, n(u) the number of their pairs at the lag u, ρ_j their correlation, and c_q
    a constant of the Hermite expansion of the robust estimate; see `wavelet_covariance`. Knocks, spikes and motion
    raise the classical variance, so the test is one-sided. Rounding errors and drifts have light tails and raise the
    robust variance. The p-value of a level is that of d_j − log(1 + tolerance) under the gamma distribution with this
    variance and the skewness of the ratio. For L levels and `comparisons` recordings, a recording is rejected if its
    smallest p-value is at most size / (L × comparisons). A unit with six axes whose noise is Gaussian, or has lighter
    tails, is therefore contaminated with a probability of at most `size`, whatever the correlation between the levels.

    The test leaves out levels with at most 30 degrees of freedom M_j / 2^j, and levels with a coarse quantization: a
    level with more than 40 % zero coefficients and the three levels above it, and every level if one has more than
    54 %. (White noise has 28 % zeros at the first level if the quantization step is its standard deviation, and 50 % if
    it is twice as large.) The numbers of zeros are known only if x is a signal or a robust variance measured by gmwm.

    Parameters
    ----------
    x : Signal, (N,) array, or (classical, robust) wavelet variances
        A pair must be Haar MODWT variances of the same recording.
    rate : float
        Sampling rate (Hz); a Signal or a pair of wavelet variances has its own.
    model : Model, Process or str, optional
        Model with a value for every parameter, from which the correlations are computed; by default the mixture of
        processes with the largest likelihood.
    efficiency : float
        Efficiency of the robust estimate, if x is a signal.
    size : float
        Probability of a false alarm among all comparisons, between 0 and 1.
    comparisons : int
        Number of recordings that are tested together, for example 6 for the axes of a unit.
    tolerance : float
        Excess that is not reported as outliers; 0.02 changes a standard deviation by 1 %. Without a tolerance, the test
        would reject noise that is only approximately Gaussian in a long recording.
    screen : Screen, optional
        For a pair, the screening of the samples for bursts and wrong samples. Without it, a pair is contaminated if its
        p-value is small.

    Raises
    ------
    DataError
        If the wavelet variance of the signal cannot be computed, or the two wavelet variances are of different
        recordings.
    OptionError
        If an option has an invalid value.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=100_000)
    >>> verdict = contamination(x, rate=100.0)
    >>> verdict.contaminated, [remark.code for remark in verdict.remarks]
    (False, ['check-passed'])
    >>> x[50_000:50_100] *= 30.0
    >>> verdict = contamination(x, rate=100.0, comparisons=6)
    >>> verdict.contaminated, verdict.pvalue < 1e-6
    (True, True)
    """
    from scipy.special import gammaincc, gammainccinv

    size = as_size(size)
    as_whole_number(comparisons, "comparisons", 1, expected="an integer of at least 1")
    if not 0 <= tolerance < np.inf:
        raise OptionError(argument="tolerance", expected="zero or a positive number", got=tolerance)
    classical, robust = _both(x, rate, efficiency)
    if screen is None and not _is_pair(x):
        screen = screened(x if isinstance(x, Signal) else Signal(np.asarray(x, dtype=np.float64), classical.rate))
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
        contaminated=pvalue <= size and (screen is None or screen.bursts.found or screen.spikes > 0), pvalue=pvalue,
        levels=robust.levels.copy(), tau=robust.tau.copy(), excess=excess, critical=critical, standard_errors=error,
        pvalues=pvalues, left_out=dict(sorted(left_out.items())), size=float(size), comparisons=int(comparisons),
        tolerance=float(tolerance), efficiency=robust.efficiency, axis=robust.axis,
        bursts=None if screen is None or not screen.bursts.tau.size else screen.bursts,
        spikes=0 if screen is None else screen.spikes, largest=0.0 if screen is None else screen.largest,
        replaced=NOTHING_REPLACED if screen is None else screen.replaced,
    )  # fmt: skip


def _is_pair(x: Any) -> bool:
    return isinstance(x, tuple | list) and any(isinstance(part, WaveletVariance) for part in x)


def _both(x: Any, rate: float | None, efficiency: float) -> tuple[WaveletVariance, WaveletVariance]:
    """Return the classical and the robust wavelet variance of the recording."""
    pair = _is_pair(x)
    if isinstance(x, WaveletVariance) or (pair and not all(isinstance(part, WaveletVariance) for part in x)):
        raise DataError(argument="x", expected="a signal, or a pair (classical, robust) of wavelet variances", got=x)
    if not pair:
        signal = x if isinstance(x, Signal) else as_vector(x, "x")
        return wavelet_variance(signal, rate), wavelet_variance(signal, rate, robust=True, efficiency=efficiency)
    if len(x) != 2 or x[0].robust or not x[1].robust:
        kinds = ", ".join("robust" if part.robust else "classical" for part in x)
        raise DataError(argument="x", expected="a pair (classical, robust) of wavelet variances", got=kinds)
    classical, robust = x
    if not all(Design.of(part).running_sum for part in x):
        raise OptionError(
            "the test for outliers needs Haar MODWT variances",
            advice="Measure them with {--filter=haar} and {--transform=modwt}.",
        )
    same = ("samples", "segments", "rate", "unit", "axis")
    differ = [name for name in same if getattr(classical, name) != getattr(robust, name)]
    if differ or not np.array_equal(classical.levels, robust.levels):
        what = differ[0] if differ else "levels"
        raise DataError(
            f"the two wavelet variances are of different recordings: their {what} differ", argument="x", got=what,
            advice="Compute both wavelet variances from the same recording.",
        )  # fmt: skip
    require_rate(rate, robust.rate, "pair")
    return classical, robust


def _left_out(robust: WaveletVariance) -> dict[int, Reason]:
    """Return the levels that are not tested, with the reason."""
    freedom = Design.of(robust).degrees_of_freedom
    diagnostics = robust.diagnostics.get("robust", {})
    outcomes = diagnostics.get("outcome", ["root"] * len(robust))
    zeros = np.array(diagnostics.get("zeros", np.zeros(len(robust))))
    # If there are few coefficients, one that is zero by chance is a large share.
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


def _ruled_by_steps(zeros: Vector) -> Booleans:
    """Return the levels whose ratio depends on the quantization steps, from the share of zeros at each level."""
    if np.max(zeros) > COARSEST:
        return np.ones(zeros.size, dtype=np.bool_)
    ruled = np.zeros(zeros.size, dtype=np.bool_)
    for k in np.flatnonzero(zeros > COARSE):
        ruled[k : k + FELT] = True
    return ruled


def excess_text(excess: float) -> str:
    """Format the excess of the classical over the robust variance, in per cent or, if it is large, as a factor.

    >>> excess_text(0.14), excess_text(20.0)
    ('by 14 %', 'by a factor of 21')
    """
    return (
        f"by {100 * excess:.2g} %"
        if excess < 1
        else f"by {100 * excess:.0f} %"
        if excess < 10
        else (f"by a factor of {round_text(1 + excess)}")
    )


def _scales(tau: Vector) -> tuple[Quantity, ...]:
    return tuple(Quantity(float(seconds), "s") for seconds in tau)
