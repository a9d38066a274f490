"""Parametric bootstrap, which fits the model to recordings that are simulated from the fitted model."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import FrozenArrays, Matrix, Vector, as_whole_number
from gmwm.base.errors import FitWarning
from gmwm.base.lazy import once_per_result
from gmwm.fitting.estimation.problem import pose
from gmwm.fitting.estimation.simulated_curves import simulated_variances
from gmwm.fitting.estimation.solver import model_of, solve_near
from gmwm.measuring.covariance import Design
from gmwm.theory.processes.validation import as_seed

if TYPE_CHECKING:
    from gmwm.fitting.estimation.result import Fit

DRAWS = 500
LEAST_DRAWS = 2  # smallest number of simulated recordings that gives a standard deviation
LEAST_FOR_TEST = 19
"""Smallest number of simulated recordings for a test at the 5 % level, because p is at least 1 / (draws + 1)."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Bootstrap(FrozenArrays):
    """Estimates from recordings that were simulated from a fitted model.

    Attributes
    ----------
    names : tuple of str
        Names of the p estimated parameters.
    estimates : (draws, p) array
        Estimates from each simulated recording. A drift has the same sign as in the fit.
    objectives : (draws,) array
        Objectives of the fits to the simulated recordings, with the weights of the original fit.
    variances : (draws, J) array, in unit²
        Wavelet variances of the simulated recordings.
    implied : (draws, J) array, in unit²
        Wavelet variances of the models that were fitted to the simulated recordings.
    seed : int
        Seed of the simulation.
    """

    names: tuple[str, ...]
    estimates: Matrix
    objectives: Vector
    variances: Matrix
    implied: Matrix
    seed: int

    def __repr__(self) -> str:
        return f"Bootstrap({len(self.objectives)} draws of {', '.join(self.names)}, seed {self.seed})"

    @property
    def errors(self) -> dict[str, float]:
        """Standard error of each parameter, which is the standard deviation of its estimates."""
        return dict(zip(self.names, self.estimates.std(axis=0, ddof=1).tolist(), strict=True))

    def quantiles(self, low: float, high: float) -> dict[str, tuple[float, float]]:
        """Return the quantiles `low` and `high` (between 0 and 1) of the estimates of each parameter."""
        ends = np.quantile(self.estimates, [low, high], axis=0)
        return {name: (float(ends[0, k]), float(ends[1, k])) for k, name in enumerate(self.names)}


def bootstrap(
    fit: Fit, draws: int = DRAWS, rng: int | np.random.Generator = 0, *, progress: Callable[[int], None] | None = None
) -> Bootstrap:
    """Estimate the parameters from each of many recordings that are simulated from the fit (parametric bootstrap).

    Each recording has the length and the gaps of the data. Gauss-Markov and autoregressive terms start from their
    stationary distribution. Each recording is fitted with the weights of this fit, and robustly if this fit is
    robust.

    Parameters
    ----------
    draws : int
        Number of simulated recordings, at least 2.
    rng : int or numpy.random.Generator
        Source of the draws; the same integer gives the same result. The result records the integer seed, which is
        drawn from a Generator if one is given.
    progress : callable, optional
        Function that is called with the number of recordings that are finished.

    Returns
    -------
    Bootstrap
        Estimates from all recordings, with their standard errors and quantiles.

    Raises
    ------
    OptionError
        If `draws` or `rng` has an invalid value.
    MissingTheoryError
        If a process cannot be simulated.

    Examples
    --------
    >>> from gmwm import WN, fit
    >>> found = fit(WN(), WN(sigma2=4.0).simulate(4096, 100.0, rng=1), rate=100.0)
    >>> again = found.bootstrap(draws=100, rng=1)
    >>> 0.5 < again.errors["WN.sigma2"] / found.standard_errors["WN.sigma2"] < 1.5
    True
    """
    draws, seed = as_draws(draws, LEAST_DRAWS, "a standard deviation"), as_seed(rng)
    return once_per_result(fit, "bootstrap", (draws, seed), lambda: _bootstrap(fit, draws, seed, progress))


def as_draws(draws: int, least: int, what: str, name: str = "draws") -> int:
    """Check that a number of simulated recordings is a whole number of at least `least`, which `what` requires."""
    return as_whole_number(draws, name, least, expected=f"a whole number of at least {least}, for {what}")


def least_draws(level: float) -> int:
    """Return the smallest number of draws for an interval of this level: of n estimates, the smallest is the quantile 1
    / (n + 1).

    >>> least_draws(0.95), least_draws(0.99)
    (39, 199)
    """
    # In floating point, 2 / (1 − 0.95) differs from 40 in the last digit.
    return max(LEAST_DRAWS, math.ceil(2 / (1 - level) * (1 - 1e-12)) - 1)


def _bootstrap(fit: Fit, draws: int, seed: int, progress: Callable[[int], None] | None) -> Bootstrap:
    wv = fit.wavelet_variance
    variances = simulated_variances(fit.model, Design.of(wv), draws, seed, progress=progress)
    problem = pose(fit.model, wv, fit.weighting_matrix)
    offset = wv.variance - problem.observed
    free = [name for name in fit.parameters if name not in fit.model.fixed_names]
    # The wavelet variance does not determine the sign of a drift; the sign of an AR coefficient is estimated.
    signed = {f"{t}.{p.scale_parameter().name}" for t, p in fit.model.by_term.items()}
    sign = np.array([-1.0 if name in signed and fit.parameters[name] < 0 else 1.0 for name in free])
    estimates, objectives = np.empty((len(variances), len(free))), np.empty(len(variances))
    implied = np.empty_like(variances)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        for k, variance in enumerate(variances):
            drawn = problem.observing(variance - offset)
            solution = solve_near(drawn)
            model = model_of(drawn, solution, None).sorted(wv.rate)
            parameters = model.parameters
            implied[k] = model.wavelet_variance(wv.levels, wv.rate, wv.filter)
            estimates[k] = sign * np.array([parameters[name] for name in free], dtype=np.float64)
            objectives[k] = solution.objective
    return Bootstrap(
        names=tuple(free), estimates=estimates, objectives=objectives, variances=variances, implied=implied, seed=seed
    )
