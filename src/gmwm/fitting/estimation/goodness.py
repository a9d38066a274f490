"""Goodness-of-fit test of a fitted model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, get_args

import numpy as np

from gmwm.base.arrays import Booleans, FrozenArrays, Integers
from gmwm.base.documents import Documented
from gmwm.base.errors import ModelError
from gmwm.base.lazy import scipy
from gmwm.base.text import Summarised, counted, p_relation, p_text
from gmwm.fitting.estimation.bootstrap import DRAWS, LEAST_FOR_TEST, as_draws, bootstrap
from gmwm.fitting.estimation.intervals import Method
from gmwm.fitting.estimation.linearised import slopes_of, square_of_rest, usable_in
from gmwm.fitting.estimation.reweighting import REWEIGHTED
from gmwm.fitting.estimation.weighting import precision, square_root
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import one_of

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit


@dataclass(frozen=True, kw_only=True, eq=False)
class GoodnessOfFit(FrozenArrays, Documented, Summarised):
    """Test of the hypothesis that the data come from the fitted model.

    Attributes
    ----------
    statistic : float
        Statistic T of `Fit.goodness_of_fit`; for the bootstrap, the objective of the fit.
    df : int or None
        Degrees of freedom, which are the number of levels used minus the number of free parameters. None for the
        bootstrap.
    pvalue : float
        Probability of a statistic that is at least this large if the model is correct.
    levels : (J,) int array
        Levels that the test uses.
    left_out : tuple of int
        Coarse levels that the test leaves out, because they have too few degrees of freedom.
    method : "asymptotic" or "bootstrap"
        Method by which the p-value was computed.
    """

    statistic: float
    df: int | None
    pvalue: float
    levels: Integers
    left_out: tuple[int, ...]
    method: Method

    def summary(self, among_all: bool | None = None) -> str:
        """Describe the test in one line. `among_all` tells whether the level of all axes together rejects the model."""
        law = f"chi-square {self.statistic:.4g} on {self.df} degrees of freedom"
        if self.method == "bootstrap":
            law = f"objective {self.statistic:.4g} compared with simulated recordings"
        levels = self.levels[self.levels > 0]
        first, last = levels[0], levels[-1]
        every = len(levels) == last - first + 1
        used = f"{'' if every else f'{len(levels)} of '}levels {first} to {last}"
        if lags := len(self.levels) - len(levels):
            used += f" and {counted(lags, 'lag')}"
        rejected = self.pvalue <= 0.05 if among_all is None else among_all
        verdict = f"the model is {'' if rejected else 'not '}rejected at the 5 % level"
        several = " for all axes together" if self.pvalue <= 0.05 and not rejected else ""
        return f"{law}, {used}: p {p_relation(self.pvalue)}, {verdict}{several}"

    @property
    def pvalue_in_words(self) -> str:
        """Text of the p-value, with three decimals or as "< 0.001"."""
        return p_text(self.pvalue)

    def __str__(self) -> str:
        return self.summary()


def goodness_of_fit(
    fit: Fit, method: Method = "asymptotic", *, draws: int = DRAWS, rng: int | np.random.Generator = 0
) -> GoodnessOfFit:
    """Test whether the data could come from the fitted model, for any weighting Ω of the fit.

    With the residuals r = ν̂² − ν²(θ̂), the covariance V of ν̂² and D = ∂ν²/∂θ at the estimate,

        T = rᵀV⁻¹r − rᵀV⁻¹D (DᵀV⁻¹D)⁻¹ DᵀV⁻¹r ~ χ² with (levels − parameters) degrees of freedom.

    The test leaves out the coarsest levels, whose ν̂² has a skewed distribution for recordings of any length. With
    these levels, a test at the 5 % level would reject about 8 % of correct models. The model is fitted again
    without them. This fit has the same weighting if it is "diagonal" or "optimal". Otherwise it is "diagonal",
    because estimates with other weights may be too inaccurate for the chi-square distribution to hold. Parameters
    that are zero or at an end of their domain do not count.

    Parameters
    ----------
    method : "asymptotic" or "bootstrap"
        Source of the p-value: the chi-square distribution, or the objectives of `draws` recordings that are
        simulated from the fitted model, with all levels.
    draws, rng
        The same as for `Fit.bootstrap`, with at least 19 draws, because p is at least 1 / (draws + 1).

    Returns
    -------
    GoodnessOfFit
        Statistic, degrees of freedom and p-value.

    Raises
    ------
    OptionError
        If an option is unknown or out of range.
    ModelError
        If no degree of freedom is left.
    MissingTheoryError
        If the covariance of a process is unknown.

    Examples
    --------
    >>> from gmwm import RW, WN, fit
    >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-2)).simulate(20_000, 100.0, rng=1)
    >>> fit(WN() + RW(), x, rate=100.0).goodness_of_fit().pvalue > 0.05
    True
    >>> fit(WN(), x, rate=100.0).goodness_of_fit().pvalue < 1e-6
    True
    """
    one_of(method, "method", get_args(Method))
    wv = fit.wavelet_variance
    if method == "bootstrap":
        as_draws(draws, LEAST_FOR_TEST, "a test at the 5 % level")
        drawn = bootstrap(fit, draws, rng).objectives
        larger = int(np.count_nonzero(drawn >= fit.objective))
        return GoodnessOfFit(
            statistic=fit.objective, df=None, pvalue=(1 + larger) / (1 + drawn.size), levels=wv.levels.copy(),
            left_out=(), method=method,
        )  # fmt: skip
    # The result is cached, because the test needs another fit, and a summary, a file and a table all show the test.
    if "_goodness" not in fit.__dict__:
        fit.__dict__["_goodness"] = _by_theory(fit)
    test: GoodnessOfFit = fit.__dict__["_goodness"]
    return test


def _by_theory(fit: Fit) -> GoodnessOfFit:
    """Compute the chi-square test of `Fit.goodness_of_fit`."""
    wv = fit.wavelet_variance
    used = int(np.count_nonzero(usable_levels(wv)))
    free = len(fit.model.names) - len(fit.model.fixed_names)
    if used < free:
        raise _too_few(fit, free, used)
    short = fit if used == len(wv) and fit.weighting in REWEIGHTED else fit.refit(wv.first(used))
    statistic, count = _statistic(short)
    df = used - count
    return GoodnessOfFit(
        statistic=statistic, df=df, pvalue=float(scipy.special.gammaincc(df / 2, statistic / 2)),
        levels=wv.levels[:used].copy(), left_out=tuple(int(j) for j in wv.levels[used:]), method="asymptotic",
    )  # fmt: skip


def _too_few(fit: Fit, parameters: int, levels: int) -> ModelError:
    return ModelError(
        f"{fit.model.structure} has {counted(parameters, 'parameter')}, and only {counted(levels, 'level')} "
        f"{'has' if levels == 1 else 'have'} enough degrees of freedom for a test",
        advice="Record longer, use a smaller model, or use the bootstrap.",
    )


def usable_levels(wv: WaveletVariance) -> Booleans:
    """Return a mask (J,) of the levels of a wavelet variance that have enough degrees of freedom for the test."""
    return usable_in(Design.of(wv))


def _statistic(fit: Fit) -> tuple[float, int]:
    """Return the statistic T, and the number of free parameters that the data determine."""
    wv = fit.wavelet_variance
    slopes = slopes_of(fit)
    if slopes.shape[1] >= len(wv):
        raise _too_few(fit, slopes.shape[1], len(wv))
    root = square_root(precision(covariance(fit.model, Design.of(wv))))
    return square_of_rest(root @ (wv.variance - fit.implied), root @ slopes)
