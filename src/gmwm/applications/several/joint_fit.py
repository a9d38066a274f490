"""Fit a model of several signals at once with `gmwm.fit_joint`, and its result."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.several import fitting
from gmwm.applications.several.certificate import LARGEST_GAP, Prover
from gmwm.applications.several.matrices import entries, lag_products, symmetric
from gmwm.applications.several.search import descend, joint_terms, sum_model
from gmwm.applications.several.state_space import JointContinuousStateSpace, JointStateSpace, continuous, discrete
from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.errors import MissingTheoryError, OptionError
from gmwm.base.lazy import scipy
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.results import Plotted, register
from gmwm.base.text import Named, Summarised, gap_text, p_relation, table_with_rule
from gmwm.fitting.estimation.goodness import GoodnessOfFit
from gmwm.fitting.likelihood.tracks import Tracks
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import Model, ModelLike


@dataclass(frozen=True, kw_only=True)
class SharedTerm:
    """Result of the test whether the noise of one term is independent between the signals.

    Attributes
    ----------
    term : str
        Name of the term.
    statistic : float
        Decrease of the weighted residual sum of squares if the term may be shared. The weights are those of the model
        in which it is not shared.
    df : int
        Degrees of freedom of the statistic.
    pvalue : float
        Probability of a statistic at least this large if the term is not shared.
    """

    term: str
    statistic: float
    df: int
    pvalue: float

    def summary(self) -> str:
        """Format the result of the test in one line."""
        answer = "shared" if self.pvalue <= 0.05 else "not found to be shared"
        test = f"chi-square {self.statistic:.4g} on {self.df} degrees of freedom, p {p_relation(self.pvalue)}"
        return f"{self.term} is {answer}: {test}"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class JointFit(Summarised, Plotted):
    """Joint fit of several signals: the covariance matrix of each term of the model, and the parameters of its shape.

    Attributes
    ----------
    axes : tuple of str
        Names of the d signals.
    units : mapping of str to str
        Unit of each signal.
    model : str
        The model, such as "common(RW) + GM + WN".
    terms : tuple of str
        Names of the terms; these are the keys of the mappings below.
    rate : float
        Sampling rate (Hz).
    samples : int
        Number of samples of each signal.
    levels : (J,) int array
        Levels used.
    covariances : mapping of term to (d, d) array
        Covariance matrix Σ_p of each term. The diagonal contains the scale parameter of the term (σ², γ², Q², σ²_GM, …)
        in each signal, and the other entries contain the covariances between signals.
    parameters : mapping of str to float
        Parameters of the shapes, such as "GM.beta".
    objective : float
        Weighted squared distance between data and model at the estimate.
    lower_bound : float or None
        Proven lower bound on the objective for any parameter values of this model. None if the model has unknown
        correlation times and `certify` was not used. For a model with `common(…)` terms, the bound is computed for the
        model with `shared(…)` in their place.
    relaxed_bound : float or None
        Lower bound on the objective of a model with any number of terms of each process whose correlation time is
        searched.
    measured, implied : (J, d, d) arrays
        Covariance matrices Γ_j of the wavelet coefficients: the estimates from the data, and the values of the fitted
        model.
    settled : JointSolution
        The weighted least-squares problem and its solution, from which standard errors and tests are computed.
    """

    axes: tuple[str, ...]
    units: Mapping[str, str]
    model: str
    terms: tuple[str, ...]
    rate: float
    samples: int
    levels: Integers
    covariances: Mapping[str, Matrix]
    parameters: Mapping[str, float]
    objective: float
    lower_bound: float | None
    relaxed_bound: float | None
    measured: Matrix
    implied: Matrix
    settled: fitting.JointSolution = field(repr=False)

    @classmethod
    def of(
        cls, settled: fitting.JointSolution, units: Mapping[str, str], bounds: tuple[float, float] | None
    ) -> JointFit:
        """Create the result from a solved problem (`settled`), the units of its signals, and its two lower bounds."""
        problem, estimate, measured = settled.problem, settled.estimate, settled.measured
        labels = [term.label for term in problem.terms]
        processes = problem.processes(estimate.u)
        parameters = {
            f"{label}.{name.name}": float(value)
            for label, process in zip(labels, processes, strict=True)
            for name, value in zip(process.nonlinear_parameters(), process.nonlinear, strict=True)
        }
        sigmas = settled.sigmas
        return cls(
            axes=measured.names, units=dict(units), model=" + ".join(map(str, problem.terms)), terms=tuple(labels),
            rate=measured.design.rate, samples=measured.design.samples, levels=measured.design.levels,
            covariances=Named(zip(labels, sigmas, strict=True), "term"), parameters=Named(parameters, "parameter"),
            objective=estimate.objective, lower_bound=None if bounds is None else bounds[0],
            relaxed_bound=None if bounds is None else bounds[1], measured=measured.values,
            implied=np.einsum("pj,pab->jab", problem.shapes(estimate.u), sigmas), settled=settled,
        )  # fmt: skip

    @property
    def converged(self) -> bool:
        """Whether the weights are the inverse of the covariance under the fitted model. If estimate and weights do not
        agree after twelve iterations, the weights are inverse variances that are estimated from the data."""
        return self.settled.converged

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """A remark if the weights did not converge."""
        return () if self.converged else (Remark.of("weights-from-data", ", ".join(self.axes), case="iteration"),)

    @property
    def proved(self) -> bool:
        """Whether the bound proves that no other parameter values of the model lower the objective by more than 0.2 %.

        False without a bound."""
        return self.lower_bound is not None and self.lower_bound >= (1 - 2 * LARGEST_GAP) * self.objective

    def _place(self, term: str) -> int:
        if term not in self.terms:
            raise OptionError(argument="term", expected=f"one of {', '.join(self.terms)}", got=term)
        return self.terms.index(term)

    @cached_property
    def correlation(self) -> Mapping[str, Matrix]:
        """Correlation matrix (d, d) of each term; NaN for signals in which the term has variance 0."""
        return Named({term: fitting.correlation_of(sigma) for term, sigma in self.covariances.items()}, "term")

    @property
    def loadings(self) -> Mapping[str, Vector]:
        """Factors ℓ (d,) of the signals for each common term, with Σ = ℓℓᵀ. The largest entry of ℓ is positive."""
        loadings = {}
        for term in self.settled.problem.terms:
            if term.kind == "common":
                sigma = self.covariances[term.label]
                at = int(np.argmax(np.diag(sigma)))
                loadings[term.label] = sigma[at] / np.sqrt(sigma[at, at])
        return Named(loadings, "common term")

    @cached_property
    def _errors(self) -> fitting.Errors:
        return fitting.errors(self.settled)

    @cached_property
    def standard_errors(self) -> Mapping[str, Matrix]:
        """Standard errors (d, d) of the entries of each covariance matrix, by term; 0 for entries that are not
        estimated."""
        scale = np.outer(self.settled.unit, self.settled.unit)
        errors_of = {}
        for place, term in enumerate(self.terms):
            variance = np.diag(self._errors.of_matrix(place))
            errors_of[term] = symmetric(np.sqrt(np.maximum(variance, 0.0)), len(self.axes)) / scale
        return Named(errors_of, "term")

    @cached_property
    def parameter_errors(self) -> Mapping[str, float]:
        """Standard errors of the parameters of the shapes; NaN for a parameter that the data do not determine."""
        errors_of: dict[str, float] = {}
        problem = self.settled.problem
        for at, place in enumerate(problem.search_places):
            term, branch = problem.terms[place], problem.branches[place]
            assert branch is not None
            slope = float(branch.slope(self.settled.estimate.u[at : at + 1])[0, 0])
            name = term.process.nonlinear_parameters()[0].name
            errors_of[f"{term.label}.{name}"] = float(np.sqrt(self._errors.of_shape(place)) * abs(slope))
        return Named(errors_of, "parameter")

    def correlation_interval(self, term: str, confidence: float = 0.95) -> tuple[Matrix, Matrix]:
        """Return the lower and upper confidence limits (d, d) of the correlations of one term, from Fisher's
        transformation.

        If the covariance matrix is singular, each correlation has a one-sided limit towards zero with the same
        confidence level, and the other limit is ±1. The limits of common and of independent terms are NaN.

        Raises
        ------
        OptionError
            If there is no such term, or the confidence level is not allowed.
        """
        place, d = self._place(term), len(self.axes)
        level = as_confidence(confidence)
        if self.settled.problem.terms[place].kind != "shared":
            return np.full((d, d), np.nan), np.full((d, d), np.nan)
        sigma = self.settled.estimate.sigmas[place]
        values = np.linalg.eigvalsh(sigma)
        singular = bool(values[0] <= fitting.SINGULAR_SHARE * values.sum())
        estimate = fitting.unconstrained_matrix(self.settled, place) if singular else sigma
        scatter = (fitting.errors(self.settled, inside=True) if singular else self._errors).of_matrix(place)
        r = fitting.correlation_of(estimate)
        error = fitting.correlation_errors(estimate, scatter)
        z = float(scipy.special.ndtri(level if singular else (1 + level) / 2))
        if singular:
            low = np.where(r > 0, np.clip(r - z * error, -1, 1), -1.0)
            high = np.where(r > 0, 1.0, np.clip(r + z * error, -1, 1))
        else:
            with np.errstate(divide="ignore", invalid="ignore"):
                centre, width = np.arctanh(r), z * error / (1 - r**2)
                low, high = np.tanh(centre - width), np.tanh(centre + width)
        for limits in (low, high):
            np.fill_diagonal(limits, 1.0)
        return low, high

    def goodness_of_fit(self) -> GoodnessOfFit:
        """Test whether the model describes the data.

        The statistic is the weighted sum of squared residuals of a fit that does not require positive semidefinite
        matrices. Its p-value is slightly larger than that of a chi-square variable, because the moments of coarse
        levels are skewed."""
        return fitting.misfit(self.settled)

    def shared(self, term: str) -> SharedTerm:
        """Test the null hypothesis that a term is independent between the signals, so that its correlations are zero.

        Raises
        ------
        OptionError
            If there is no such term.
        """
        place = self._place(term)
        if term not in self._shared_tests:
            terms = self.settled.problem.terms
            unshared = (*terms[:place], replace(terms[place], kind="own"), *terms[place + 1 :])
            null = fitting.settle(unshared, self.settled.measured)
            statistic, df = fitting.sharing(null, place)
            pvalue = float(scipy.special.gammaincc(df / 2, max(statistic, 0.0) / 2)) if df else 1.0
            self._shared_tests[term] = SharedTerm(term=term, statistic=statistic, df=df, pvalue=pvalue)
        return self._shared_tests[term]

    @cached_property
    def _shared_tests(self) -> dict[str, SharedTerm]:
        """Results of `shared`, which fits the model of the null hypothesis, by term."""
        return {}

    @property
    def models(self) -> Mapping[str, Model]:
        """Noise model of each signal alone. It does not contain the correlations with the other signals."""
        processes = self.settled.problem.processes(self.settled.estimate.u)
        models = {}
        for k, axis in enumerate(self.axes):
            scales = [float(self.covariances[term][k, k]) for term in self.terms]
            models[axis] = sum_model(p.with_scale(scale) for p, scale in zip(processes, scales, strict=True))
        return Named(models, "axis")

    def state_space(self, rate: float | None = None) -> JointStateSpace:
        """Return the discrete-time state space of all signals, with independent states.

        The blocks of term p are F_p ⊗ I, Q_p ⊗ I and H_p ⊗ L_p, where F_p, Q_p and H_p belong to its process at unit
        scale and L_p L_pᵀ = Σ_p.

        Parameters
        ----------
        rate : float, optional
            Sampling rate (Hz); by default the rate of the recording. Use another rate only if no parameter of the model
            is defined per sample.
        """
        processes = self.settled.problem.processes(self.settled.estimate.u)
        sigmas = np.array(list(self.covariances.values()))
        return discrete(processes, sigmas, rate or self.rate, axes=self.axes, labels=self.terms)

    def continuous(self) -> JointContinuousStateSpace:
        """Return the continuous-time state space of all signals."""
        processes = self.settled.problem.processes(self.settled.estimate.u)
        sigmas = np.array(list(self.covariances.values()))
        return continuous(processes, sigmas, self.rate, axes=self.axes, labels=self.terms)

    def smooth(self, x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None = None) -> Mapping[str, Tracks]:
        """Estimate the latent processes of all signals from a whole recording, with a fixed-interval Kalman smoother.

        Because the signals share noise, the samples of every signal improve the estimates for all signals. The constant
        level of each signal is treated as unknown.

        Parameters
        ----------
        x : Imu, or mapping of name to Signal or (N,) array
            A recording with the axes of the fit, which were sampled together. Gaps of signals are missing samples; in
            arrays, NaN marks a missing sample.
        rate : float, optional
            Sampling rate (Hz) of plain arrays; the rate of the fit by default.

        Returns
        -------
        mapping of axis to Tracks
            Mean and standard deviation of each latent process of the axis at each sample.

        Raises
        ------
        DataError, OptionError
            If an axis is missing, if the signals are not synchronous, or if the rate differs from the rate of the fit.
        MissingTheoryError
            If a term has no state-space form.

        References
        ----------
        Durbin and Koopman (2012), Time Series Analysis by State Space Methods, 2nd ed., section 4.4.
        """
        from gmwm.applications.several.state_space import smooth_joint

        return smooth_joint(self, x, rate)

    def to_dict(self) -> dict[str, Any]:
        """Return the estimates, standard errors, tests and state spaces as plain numbers, lists and strings."""
        spaces: tuple[dict[str, Any] | None, ...] = (None, None)
        with suppress(MissingTheoryError):
            spaces = self.state_space().to_dict(), self.continuous().to_dict()
        return {
            **plain_fields(
                self,
                "axes units model rate samples levels objective lower_bound proved relaxed_bound converged remarks "
                "parameters parameter_errors",
            ),
            "terms": {
                term: {
                    "covariance": plain(self.covariances[term]),
                    "standard_errors": plain(self.standard_errors[term]),
                    "correlation": plain(self.correlation[term]),
                }
                for term in self.terms
            },
            "goodness_of_fit": self.goodness_of_fit().to_dict(),
            "shared": {term: asdict(self.shared(term)) for term in self._shareable},
            "state_space": spaces[0],
            "continuous_state_space": spaces[1],
        }

    @property
    def _shareable(self) -> tuple[str, ...]:
        return tuple(term.label for term in self.settled.problem.terms if term.kind == "shared")

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Format the parameters, the correlations of shared terms, the tests, and the remarks in a `dialect`."""
        head = f"Joint fit of {', '.join(self.axes)}: {self.model}"
        rows, processes = [["", *self.axes, "unit"]], self.settled.problem.processes(self.settled.estimate.u)
        units = set(self.units.values())
        unit = units.pop() if len(units) == 1 else "u"
        for term, process in zip(self.terms, processes, strict=True):
            values, scale = np.diag(self.covariances[term]), process.scale_parameter()
            # A variance of zero is that of the optimum up to rounding.
            cells = [f"{value:.4g}" if value > 1e-9 * np.max(values) else "0" for value in values]
            rows.append([f"{term}.{scale.name}", *cells, scale.unit(unit)])
        lines = [head, f"{self.samples} samples at {self.rate:g} Hz, levels {self.levels[0]} to {self.levels[-1]}", ""]
        lines += table_with_rule(rows)
        if self.parameters:
            lines.append("")
        for name, value in self.parameters.items():
            unit = " 1/s" if name.endswith(".beta") else ""
            error = self.parameter_errors.get(name, float("nan"))
            lines.append(f"{name} = {value:.4g}{unit} (standard error {error:.2g}), the same for all axes")
        for term in self._shareable:
            low, high = self.correlation_interval(term)
            pairs = [["correlation of " + term, "r", "95 %"]]
            for a, b in zip(*(where.tolist() for where in entries(len(self.axes))), strict=True):
                if a != b:
                    limits = f"{low[a, b]:+.2f} … {high[a, b]:+.2f}"
                    pairs.append([f"{self.axes[a]}, {self.axes[b]}", f"{self.correlation[term][a, b]:+.2f}", limits])
            lines += ["", *table_with_rule(pairs)]
        if self.remarks:
            lines += ["", *texts(self.remarks, dialect)]
        tests = [f"Test of the model: {self.goodness_of_fit().summary()}"]
        tests += [self.shared(term).summary() for term in self._shareable]
        if self.lower_bound is not None:
            share = 1 - self.lower_bound / self.objective
            tests.append(f"No other parameters of this model lower the objective by more than {gap_text(share)}.")
            if not self.proved:
                tests.append("This bound does not prove that the fit is the optimum.")
        return "\n".join([*lines, "", *tests])

    def __repr__(self) -> str:
        return f"JointFit({', '.join(self.axes)}: {self.model})"


register(JointFit, "gmwm.applications.several.plots:plot_joint")


def fit_joint(
    model: ModelLike, x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None = None, *,
    axes: str | Sequence[str] | None = None, levels: int | Sequence[int] | None = None, certify: bool | float = False,
) -> JointFit:  # fmt: skip
    """Fit a sum of noise processes to several signals at once, including the noise that they share.

    Each term p of the model has a shape κ_p(τ), the wavelet variance of its process at unit scale, and a covariance
    matrix Σ_p of its noise in the d signals:

        Γ_j = Σ_p κ_p(τ_j) Σ_p,

    with Γ_j the covariance matrix of the wavelet coefficients at level j. A plain term such as "RW" is independent
    noise of each signal: Σ_p is diagonal. "common(RW)" is one process that occurs in all signals with a factor for each
    signal: Σ_p = ℓℓᵀ, with ℓ (d,) the vector of factors. "shared(RW)" allows any positive semidefinite Σ_p. For given
    shapes, the fit is a convex problem. Correlation times are searched from several starting values. The weight matrix
    is the inverse of the exact covariance matrix of all wavelet variances and cross-covariances under the model.

    Parameters
    ----------
    model : str or Model
        The terms, such as "common(RW) + GM + shared(WN)". A shape parameter with a value in fixed(…) is not estimated.
    x : Imu, or mapping of name to Signal or (N,) array
        Two to twelve signals that were sampled together.
    rate : float, optional
        Sampling rate (Hz); only for plain arrays.
    axes : str or sequence of str, optional
        The signals to use, such as "gyro" or ["gyro_x", "accel_z"]; all by default.
    levels : int or sequence of int, optional
        The levels to use, or the number of finest levels to use. By default, all levels with at least five coefficients
        per scale are used. Leave out fine levels that the noise model does not describe, for example levels that a
        low-pass filter in the sensor changes.

    certify : bool or float
        Whether to compute a lower bound on the objective by branch and bound, for a model with unknown correlation
        times. A number is the time limit (s); True is 60 s. The computation takes a few seconds for one Gauss-Markov
        term of three signals, and up to several minutes for two. If the time is not enough, the bound is not tight, and
        `fit.proved` is False. A model without unknown correlation times always has a bound.

    Raises
    ------
    ModelError
        If the model cannot be read, or a term cannot be shared.
    DataError
        If the signals are not synchronous, or too short for the model.
    OptionError
        If an axis or a level does not exist.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), JASA 108, 1021-1030, for one signal. The measured rejection
    rates of the tests and the coverage of the intervals are in docs/validation/joint.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> supply = np.cumsum(0.02 * rng.normal(size=20_000))
    >>> shares = {"x": 1.0, "y": -0.5, "z": 0.8}
    >>> units = {axis: rng.normal(size=20_000) + share * supply for axis, share in shares.items()}
    >>> found = fit_joint("shared(RW) + WN", units, rate=100.0)
    >>> found.correlation["RW"].round(1)
    array([[ 1., -1.,  1.],
           [-1.,  1., -1.],
           [ 1., -1.,  1.]])
    >>> found.shared("RW").pvalue < 0.001
    True
    """
    if certify is not False and (not isinstance(certify, int | float) or not certify > 0):
        raise OptionError(argument="certify", expected="True, False or a positive time (s)", got=certify)
    seconds = 60.0 if certify is True else float(certify)
    terms = joint_terms(model)
    signals = fitting.chosen_signals(x, rate, axes)
    unknowns = len(terms) + sum(term.branch is not None for term in terms)
    settled = fitting.settle(terms, fitting.measured_at(signals, levels, unknowns))
    bounds, settled = _bounds(settled, seconds)
    return JointFit.of(settled, {name: signal.unit for name, signal in signals.items()}, bounds)


def _bounds(settled: fitting.JointSolution, seconds: float) -> tuple[tuple[float, float] | None, fitting.JointSolution]:
    """Return `JointFit.lower_bound` and `JointFit.relaxed_bound`, or None without a proof, and the best fit."""
    problem, estimate = settled.problem, settled.estimate
    if not problem.search_places:
        convex = problem.solve(estimate.u)
        bound = min(convex.objective - convex.gap, estimate.objective)
        return (bound, bound), settled
    if not seconds:
        return None, settled
    single = any(term.kind == "common" for term in problem.terms)
    proof = Prover(problem).prove(descend(problem, estimate.u) if single else estimate, seconds)
    if not single and proof.best.objective < estimate.objective:
        products = lag_products(problem.processes(proof.best.u), problem.design)
        settled = replace(settled, estimate=proof.best, products=products)
    return (proof.lower_bound, proof.relaxed_bound), settled
