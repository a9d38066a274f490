"""Methods of a fit that compute standard errors, intervals, tests, criteria, datasheet numbers, summaries and plots."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, cast

import numpy as np

from gmwm.base.arrays import Matrix
from gmwm.base.plotting import Plotted

if TYPE_CHECKING:
    from gmwm.applications.navigation import Budget
    from gmwm.choosing.datasheets.sheet import Datasheet
    from gmwm.choosing.replicates import Replicates
    from gmwm.fitting.estimation.result import Fit
    from gmwm.fitting.inference.asymptotic import Sandwich
    from gmwm.fitting.inference.bootstrap import Bootstrap
    from gmwm.fitting.inference.criterion import Criterion
    from gmwm.fitting.inference.goodness import GoodnessOfFit
    from gmwm.fitting.inference.intervals import Interval, Method


class InferenceMethods(Plotted):
    """Methods of a `Fit` that call functions of upper layers. Only `Fit` inherits from this class."""

    @property
    def _fit(self) -> Fit:
        """The object itself, with the type `Fit`."""
        return cast("Fit", self)

    @cached_property
    def sandwich(self) -> Sandwich:
        """Covariance of the estimates by the sandwich formula.

        The object also has the names of the estimated parameters, their relative standard errors, and the covariance V
        of the wavelet variance.

        Raises
        ------
        ModelError
            If the model has no noise at some level.
        MissingTheoryError
            If the covariance of a process is unknown.
        """
        from gmwm.fitting.inference.asymptotic import sandwich

        return sandwich(self._fit)

    @cached_property
    def covariance(self) -> Matrix:
        """Covariance (p, p) of the estimates, Cov θ̂ = B V Bᵀ with B = (DᵀΩD)⁻¹DᵀΩ and D = ∂ν²/∂θ.

        The rows and columns are the parameters of `standard_errors`, in the same order. Raises the errors of
        `sandwich`.
        """
        return self.sandwich.covariance

    @cached_property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each estimated parameter, by name, in the unit of the parameter.

        A parameter that is fixed, zero or at an end of its domain has no standard error. Looking it up raises a
        KeyError that states the reason. Raises the errors of `sandwich`.
        """
        from gmwm.fitting.inference.asymptotic import standard_errors

        return standard_errors(self._fit)

    @cached_property
    def replicates(self) -> Replicates | None:
        """Comparison of the recordings with each other, for a fit to several recordings; None for a single recording.

        It has a test whether the parameters of the recordings are equal, a test that uses no model, the datasheet
        numbers of each recording, their spread, and a model for a navigation filter. Standard errors,
        `confidence_intervals` and the datasheet include the spread; the bootstrap does not.

        Examples
        --------
        >>> from gmwm import RW, WN, fit, wavelet_variance
        >>> model = WN(sigma2=4.0) + RW(gamma2=1e-3)
        >>> days = [wavelet_variance(model.simulate(20_000, 100.0, rng=k), 100.0) for k in (1, 2, 3)]
        >>> found = fit(WN() + RW(), days).replicates
        >>> found.differs, found["N"].apart < 0.05
        (False, True)
        """
        from gmwm.choosing.replicates.compare import compare_recordings

        return compare_recordings(self._fit)

    def confidence_intervals(
        self,
        level: float = 0.95,
        method: Method = "asymptotic",
        *,
        covariance: Matrix | None = None,
        draws: int = 500,
        rng: int | np.random.Generator = 0,
    ) -> dict[str, Interval]:
        """Compute a confidence interval (low, high) for every estimated parameter, by name.

        With the estimate θ̂, its standard error SE and the normal quantile z:

        - The interval of a variance or a correlation time is θ̂ exp(±z SE/θ̂), which is symmetric for the logarithm.
        - The interval of φ of an AR1 is symmetric for artanh φ.
        - The interval of the slope ω of a drift, which has a sign, is ω̂ ± z SE.
        - If the data do not exclude that a white noise, a random walk or a drift is zero, the interval is from 0 to an
          upper limit (for a drift, from −limit to limit). This one-sided limit of a 95 % interval has the level 97.5 %.
        - If the data do not determine a parameter, the interval is (0, inf).

        Parameters
        ----------
        level : float
            Confidence level, between 0 and 1.
        method : "asymptotic" or "bootstrap"
            Source of the intervals: the exact covariance of the wavelet variance, or quantiles of the estimates from
            `draws` simulated recordings.
        covariance : (J, J) array, optional
            Covariance V that replaces the covariance of the fitted model, for example from `empirical_covariance`; only
            with method="asymptotic". It must belong to the wavelet variance that was fitted. The empirical covariance
            of data with outliers belongs to the classical estimate, not to a robust fit.
        draws : int
            Number of simulated recordings, at least 2 / (1 − level) − 1, which is 39 for 95 %.
        rng : int or numpy.random.Generator
            Source of the draws; the same integer gives the same result.

        Returns
        -------
        dict of name to (low, high)
            Intervals, in the units of the parameters.

        Raises
        ------
        OptionError
            If an option is unknown or out of range, or `covariance` is not a covariance matrix of J levels.
        ModelError
            If the model has no noise at some level.
        MissingTheoryError
            If the covariance of a process is unknown.

        References
        ----------
        Guerrier, Skaloud, Stebler and Victoria-Feser (2013), JASA 108, 1021-1030, theorem 2.

        Examples
        --------
        >>> from gmwm import WN, RW, fit
        >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-3)).simulate(20_000, 100.0, rng=1)
        >>> low, high = fit(WN() + RW(), x, rate=100.0).confidence_intervals()["WN.sigma2"]
        >>> low < 4.0 < high
        True
        """
        from gmwm.fitting.inference.intervals import confidence_intervals

        return confidence_intervals(self._fit, level, method, covariance=covariance, draws=draws, rng=rng)

    def goodness_of_fit(
        self, method: Method = "asymptotic", *, draws: int = 500, rng: int | np.random.Generator = 0
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
        draws : int
            Number of simulated recordings, at least 19, because p is at least 1 / (draws + 1).
        rng : int or numpy.random.Generator
            Source of the draws; the same integer gives the same result.

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
        from gmwm.fitting.inference.goodness import goodness_of_fit

        return goodness_of_fit(self._fit, method, draws=draws, rng=rng)

    def wic(self, method: Method = "asymptotic", *, draws: int = 500, rng: int | np.random.Generator = 0) -> Criterion:
        """Compute the wavelet information criterion, which is the expected loss of the fit on another recording.

        Values of several models are only comparable for the same Ω; `gmwm.rank` and `gmwm.select` ensure this.

        Parameters
        ----------
        method : "asymptotic" or "bootstrap"
            Source of the optimism, the amount by which the fit to the data has a smaller loss than to another
            recording. For "asymptotic" it is 2 tr[ΩDH⁻¹DᵀΩV] with H = DᵀΩD − Σ_k [Ω(ν̂ − ν)]_k ∂²ν_k/∂θ∂θᵀ. For
            "bootstrap" it is
            2 Σ_jk Ω_jk Cov(ν̂_j*, ν_k(θ̂*)) over `draws` recordings (*) that are simulated from the fit.
        draws : int
            Number of simulated recordings.
        rng : int or numpy.random.Generator
            Source of the draws; the same integer gives the same result.

        Returns
        -------
        Criterion
            Value of the criterion, and the loss and the optimism, whose sum it is.

        Raises
        ------
        OptionError
            If an option is unknown or out of range.
        ModelError
            If the model has no noise at some level.
        MissingTheoryError
            If the covariance of a process is unknown ("asymptotic"), or a process cannot be simulated ("bootstrap").

        References
        ----------
        Efron (2004), The estimation of prediction error, JASA 99, 619-632; equation 5 of Balamuta, Guerrier, Molinari
        and Yang.

        Examples
        --------
        >>> from gmwm import RW, WN, fit
        >>> x = (WN(sigma2=4.0) + RW(gamma2=1e-2)).simulate(20_000, 100.0, rng=1)
        >>> round(fit(WN() + RW(), x, rate=100.0, weighting="optimal").wic().optimism)  # two for each parameter
        4
        """
        from gmwm.fitting.inference.criterion import wic

        return wic(self._fit, method, draws=draws, rng=rng)

    def bootstrap(
        self, draws: int = 500, rng: int | np.random.Generator = 0, *, progress: Callable[[int], None] | None = None
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
        from gmwm.fitting.inference.bootstrap import bootstrap

        return bootstrap(self._fit, draws, rng, progress=progress)

    def datasheet(self, level: float = 0.95) -> Datasheet:
        """Convert the fit to datasheet numbers N, Q, B, K, R, T_c and q_c, with confidence intervals.

            N = √(σ²Δt)   Q = √(q2) Δt   K = √(γ²f)   R = ωf   T_c = 1/β   q_c = √(2βσ²_GM)
            B = √(b2) of a flicker term, or else min over τ of the Allan deviation of the model / √(2 ln 2/π)
            A = √(2P) and f_0 of a line

        Here σ², q2, γ², ω, β, σ²_GM, b2, P and f_0 are the parameters of the processes, f is the sampling rate, and Δt
        = 1/f. If the model has a flicker term that is not zero, B is the coefficient of that term, as IEEE Std 952
        defines it. Otherwise B is computed from the minimum of the Allan deviation of the model without its lines. This
        second kind of B includes the contributions of N and K at the minimum and is at least as large as the first
        kind, so do not compare the two. If the flicker term is estimated as zero, its upper limit is given as B_f.

        If a term acts as another process on these data, it is added to that process: a Gauss-Markov term that acts as
        white noise adds to N², and a Gauss-Markov term that acts as a random walk adds to K². A process that the model
        does not contain gives no number. An AR1 with φ > 0 gives T_c and q_c of the Gauss-Markov process that has the
        same samples.

        Intervals are computed on the logarithmic scale by the delta method with the joint covariance of the estimates.
        If a number depends on one parameter only, its interval is the transformed interval of that parameter. R has a
        sign, and its interval is R ± z SE. If a term is zero or cannot be distinguished from zero, its number is an
        upper limit, as in `Fit.confidence_intervals`. B is an upper limit too if the data show no minimum.

        The unit of the wavelet variance determines whether the sensor is a gyroscope or an accelerometer. If the unit
        is unknown, the numbers are in "u", the unit of the data, and have no datasheet units.

        Parameters
        ----------
        level : float
            Confidence level, between 0 and 1.

        Returns
        -------
        Datasheet
            Mapping of symbol to `Entry`, which has the number in SI and in datasheet units.

        Raises
        ------
        OptionError
            If `level` is not between 0 and 1.

        References
        ----------
        IEEE Std 952-1997, annex C.

        Examples
        --------
        >>> import gmwm
        >>> x = (gmwm.WN(sigma2=1e-6) + gmwm.RW(gamma2=1e-12)).simulate(100_000, 100.0, rng=1)
        >>> found = gmwm.fit(gmwm.WN() + gmwm.RW(), gmwm.Signal(x, 100.0, "rad/s")).datasheet()
        >>> list(found)
        ['N', 'B', 'K']
        >>> found["N"].low < 1e-4 < found["N"].high
        True
        >>> found["N"].in_units("datasheet")[3]
        'deg/√h'
        """
        from gmwm.choosing.datasheets import datasheet

        return datasheet(self._fit, level)

    def budget(self, duration: float | str, *, rest: float | str = 0.0, level: float = 0.95) -> Budget:
        """Compute the growth of the errors of unaided inertial navigation that the noise of this axis causes.

        See `gmwm.navigation.budget` for the equations and their approximations, and for several axes.

        Parameters
        ----------
        duration : float or str
            Time of navigation (s), or text such as "60s" or "10min".
        rest : float or str
            Time at rest before the start (s).
        level : float
            Confidence level of the intervals, from 0.5 to below 1.

        Returns
        -------
        Budget

        Raises
        ------
        OptionError
            If an option is out of range, or the axis is not named gyro_x … accel_z.
        ModelError
            If the axis is not in rad/s or m/s².
        MissingTheoryError
            If a term has no state-space form.
        """
        from gmwm.applications.navigation.api import budget

        return budget({self._fit.wavelet_variance.axis: self._fit}, duration, rest=rest, level=level)

    def summary(
        self,
        level: float = 0.95,
        method: Method = "asymptotic",
        *,
        draws: int = 500,
        rng: int | np.random.Generator = 0,
    ) -> str:
        """Describe the fit in text.

        Parameters
        ----------
        level : float
            Confidence level of the intervals, between 0 and 1.
        method : "asymptotic" or "bootstrap"
            Source of the intervals and the test: theory, or `draws` simulated recordings.
        draws : int
            Number of simulated recordings.
        rng : int or numpy.random.Generator
            Source of the draws; the same integer gives the same result.

        Returns
        -------
        str
            Text with the model, the number of samples, the rate, the levels and the weighting; the objective with its
            bounds; the goodness-of-fit test; a table of the parameters with estimate, interval, relative standard error
            and unit; and the remarks.

        Raises
        ------
        OptionError
            If an option is unknown or out of range.
        """
        from gmwm.fitting.inference.summary import summary

        return summary(self._fit, level, method, draws=draws, rng=rng)

    def _repr_html_(self) -> str:
        """Return the summary as HTML with a table of the parameters, for notebooks."""
        from gmwm.fitting.inference.summary import as_html

        return as_html(self._fit)
