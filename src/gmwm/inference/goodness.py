"""Goodness of fit: could the wavelet variance come from the fitted model?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gmwm._arrays import freeze
from gmwm._text import Summarised, counted
from gmwm.covariance import Design, covariance
from gmwm.errors import ModelError, OptionError
from gmwm.estimation.estimator import refitted
from gmwm.estimation.reweighting import REWEIGHTED
from gmwm.estimation.weighting import precision, square_root
from gmwm.inference.asymptotic import COLLINEAR, columns_of, relative_jacobian
from gmwm.inference.bootstrap import DRAWS, LEAST_FOR_TEST, as_draws, bootstrap
from gmwm.inference.intervals import Method
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from gmwm.estimation.result import Fit

LEAST_FREEDOM = 3.0
"""More degrees of freedom M_j / 2^j than this a level must have for the chi-square law to hold at the 5 % level.

It leaves out the two coarsest levels of a full set."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GoodnessOfFit(Summarised):
    """A test of the hypothesis that the data come from the fitted model.

    Attributes
    ----------
    statistic : float
        rᵀV⁻¹r less what the estimated parameters take of it; the criterion itself for the bootstrap.
    df : int or None
        Degrees of freedom: levels used less parameters that were free to move. None for the bootstrap.
    pvalue : float
        Probability of such a statistic or a larger one if the model is right.
    levels : (J,) int array
        Levels that were used.
    left_out : tuple of int
        Coarse levels that were not: they have too few degrees of freedom.
    method : "asymptotic" or "bootstrap"
    """

    statistic: float
    df: int | None
    pvalue: float
    levels: NDArray[np.int64]
    left_out: tuple[int, ...]
    method: Method

    def __post_init__(self) -> None:
        freeze(self.levels)

    def to_dict(self) -> dict[str, Any]:
        """The test as plain numbers, lists and texts, ready for JSON."""
        return {
            "statistic": self.statistic,
            "df": self.df,
            "pvalue": self.pvalue,
            "levels": self.levels.tolist(),
            "left_out": list(self.left_out),
            "method": self.method,
        }

    def summary(self) -> str:
        """The test in one line."""
        law = f"chi-square {self.statistic:.4g} on {self.df} degrees of freedom"
        if self.method == "bootstrap":
            law = f"objective {self.statistic:.4g} among those of simulated records"
        used = f"levels {self.levels[0]} to {self.levels[-1]}"
        verdict = "the model is rejected" if self.pvalue <= 0.05 else "the model is not rejected"
        sign = "" if self.pvalue_in_words.startswith("<") else "= "
        return f"{law}, {used}: p {sign}{self.pvalue_in_words}, {verdict} at the 5 % level"

    @property
    def pvalue_in_words(self) -> str:
        """Three decimals, or that it is less than one in a thousand."""
        return f"{self.pvalue:.3f}" if self.pvalue >= 0.001 else "< 0.001"

    def __str__(self) -> str:
        return self.summary()


def goodness_of_fit(
    fit: Fit, method: Method = "asymptotic", *, draws: int = DRAWS, rng: int | np.random.Generator = 0
) -> GoodnessOfFit:
    """Test whether the data could come from the fitted model: see `Fit.goodness_of_fit`."""
    if method not in ("asymptotic", "bootstrap"):
        raise OptionError(f"method must be 'asymptotic' or 'bootstrap', got {method!r}")
    wv = fit.wavelet_variance
    if method == "bootstrap":
        as_draws(draws, LEAST_FOR_TEST, "a test at the 5 % level")
        drawn = bootstrap(fit, draws, rng).objectives
        larger = int(np.count_nonzero(drawn >= fit.objective))
        return GoodnessOfFit(
            statistic=fit.objective,
            df=None,
            pvalue=(1 + larger) / (1 + drawn.size),
            levels=wv.levels.copy(),
            left_out=(),
            method=method,
        )
    # It takes a fit, and a summary, a file and a table ask for the same test.
    if "_goodness" not in fit.__dict__:
        fit.__dict__["_goodness"] = _by_theory(fit)
    found: GoodnessOfFit = fit.__dict__["_goodness"]
    return found


def _by_theory(fit: Fit) -> GoodnessOfFit:
    """The chi-square test."""
    from scipy.special import gammaincc

    wv = fit.wavelet_variance
    used = int(np.count_nonzero(usable_levels(wv)))
    free = len(fit.model.names) - len(fit.model.fixed_names)
    if used < free:
        raise _too_few(fit, free, used)
    short = fit if used == len(wv) and fit.weighting in REWEIGHTED else refitted(fit, shortened(wv, used))
    statistic, count = _statistic(short)
    df = used - count
    return GoodnessOfFit(
        statistic=statistic,
        df=df,
        pvalue=float(gammaincc(df / 2, statistic / 2)),
        levels=wv.levels[:used].copy(),
        left_out=tuple(int(j) for j in wv.levels[used:]),
        method="asymptotic",
    )


def _too_few(fit: Fit, parameters: int, levels: int) -> ModelError:
    return ModelError(
        f"{fit.model.structure} has {counted(parameters, 'parameter')}, and only {counted(levels, 'level')} "
        f"{'is' if levels == 1 else 'are'} fine enough for a test; record longer, take a smaller model, or "
        "method='bootstrap'"
    )


def usable_levels(wv: WaveletVariance) -> NDArray[np.bool_]:
    """Which levels have the degrees of freedom that the test needs."""
    return usable_in(Design.of(wv))


def usable_in(design: Design) -> NDArray[np.bool_]:
    """Which levels of a design have these degrees of freedom."""
    return np.asarray(design.degrees_of_freedom > LEAST_FREEDOM)


def shortened(wv: WaveletVariance, count: int) -> WaveletVariance:
    """The first `count` levels of a wavelet variance."""
    cut = {name: getattr(wv, name)[:count].copy() for name in ("levels", "variance", "lower", "upper", "counts")}
    return replace(wv, **cut, strides=wv.strides[:count])


def _statistic(fit: Fit) -> tuple[float, int]:
    """T, and the number of parameters that were free to move."""
    wv = fit.wavelet_variance
    design = Design.of(wv)
    columns, _ = columns_of(fit.model, fit.diagnostics.acts_as)
    if len(columns) >= len(wv):
        raise _too_few(fit, len(columns), len(wv))
    root = square_root(precision(covariance(fit.model, design)))
    left = root @ (wv.variance - fit.implied)
    slopes = root @ relative_jacobian(fit.model, design, columns)
    length = np.linalg.norm(slopes, axis=0)
    axes, strength, _ = np.linalg.svd(slopes[:, length > 0] / length[length > 0], full_matrices=False)
    clear = strength > COLLINEAR * strength.max(initial=0.0)
    taken = axes[:, clear].T @ left
    return float(left @ left - taken @ taken), int(np.count_nonzero(clear))
