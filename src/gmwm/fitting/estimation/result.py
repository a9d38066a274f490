"""Result of a fit: estimates with their errors, intervals and tests, the objective with its bounds, and the data."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.documents import Documented
from gmwm.base.errors import ModelError
from gmwm.base.kinds import Document
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.results import Plotted, Tabular
from gmwm.base.text import Named
from gmwm.fitting.estimation import asymptotic, criterion, goodness, intervals
from gmwm.fitting.estimation.bootstrap import bootstrap as simulate_fits
from gmwm.fitting.estimation.problem import to_find
from gmwm.fitting.estimation.reweighting import REWEIGHTED, WeightedSolution, settle
from gmwm.fitting.estimation.solver import follow, model_of
from gmwm.fitting.estimation.starts import Start
from gmwm.fitting.estimation.summary import as_html
from gmwm.fitting.estimation.summary import summary as describe
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.equivalence import likeness
from gmwm.theory.processes.model import KalmanMethods, Model
from gmwm.theory.processes.oscillator import name_in_text

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.applications.navigation import Budget
    from gmwm.choosing.datasheets.entry import Datasheet
    from gmwm.choosing.replicates import Replicates

GIVEN = "given"  # attribute `weighting` of a `Fit` whose parameters were given and not estimated from data


@dataclass(frozen=True, kw_only=True)
class Diagnostics(Documented):
    """Diagnostics of a fit, with the terms that the data do not determine, the search and remarks.

    Attributes
    ----------
    acts_as : mapping of term to process name
        For each term at an end of its domain, the process that the data cannot distinguish from it.
    not_supported : tuple of str
        Terms that are estimated as zero.
    nodes : int
        Number of nodes of the search tree.
    start : Start or None
        Starting point of the search and the objective there; None if the fit was read from a file without it.
    remarks : tuple of Remark
        Remarks about terms and weights.
    """

    acts_as: Mapping[str, str]
    not_supported: tuple[str, ...]
    nodes: int
    start: Start | None = None
    remarks: tuple[Remark, ...] = ()
    document_keys = ("acts_as", "not_supported", "search_nodes=nodes", "start", "remarks")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit(Documented, Plotted, Tabular, KalmanMethods):
    """Model that was fitted to a wavelet variance.

    Attributes
    ----------
    wavelet_variance : WaveletVariance
        Measured wavelet variance ν̂².
    model : Model
        Fitted model. Repeated terms are sorted by correlation time, the shortest first.
    parameters : mapping of name to value
        Estimates by name, such as "WN.sigma2" and "GM.beta", or "GM[1].beta" for repeated terms. They are in SI units
        and per sample, and β is in 1/s. "DR.omega" has a sign if the wavelet variance was computed from a signal;
        otherwise it is |ω|.
    objective : float
        Objective (ν̂ − ν)ᵀ Ω (ν̂ − ν) at the estimate.
    lower_bound : float or None
        Lower bound on the objective of every model of this form. None if the fit was made with certify=False, or if a
        process has several shape parameters.
    relaxed_bound : float
        Lower bound on the objective of models with any number of the repeated process; 0 if it is unknown.
    implied : (J,) array, in unit²
        Wavelet variance ν² of the fitted model.
    decomposition : mapping of term to (J,) array
        Wavelet variance of each term; their sum is `implied`.
    weighting : str
        Kind of the weighting: "diagonal", "optimal", "identity", "matrix" if an array was passed, or "given" if there
        were no data.
    weighting_matrix : (J, J) array
        Weighting matrix Ω, in unit⁻⁴.
    diagnostics : Diagnostics
        Terms that act as another process or are estimated as zero, and the search.
    """

    wavelet_variance: WaveletVariance
    model: Model
    parameters: Mapping[str, float]
    objective: float
    lower_bound: float | None
    relaxed_bound: float
    implied: Vector
    decomposition: Mapping[str, Vector]
    weighting: str
    weighting_matrix: Matrix
    diagnostics: Diagnostics
    document = Document("fit", "Pass the values that `Fit.to_dict()` returned.")
    document_keys = (
        "model", "parameters", "units", "objective", "lower_bound", "relaxed_bound", "implied", "decomposition",
        "weighting", "weighting_matrix", "undetermined", "*diagnostics", "wavelet_variance",
    )  # fmt: skip

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", Named(self.parameters, "parameter"))
        object.__setattr__(self, "decomposition", Named(self.decomposition, "term"))
        freeze(self.implied)
        freeze(self.weighting_matrix)

    @classmethod
    def of(cls, settled: WeightedSolution, wv: WaveletVariance, weighting: str) -> Fit:
        """Return the fit to `wv` for a solved problem (`settled`) and a kind of `weighting`, with sorted terms."""
        problem, solution = settled.problem, settled.solution
        processes = model_of(problem, solution, wv.slope).processes
        model = Model(processes).sorted(wv.rate)
        label = {id(process): term for term, process in model.by_term.items()}
        terms = {label[id(processes[place])]: term for place, term in zip(problem.shaped, solution.terms, strict=True)}
        free = (*problem.linear, *problem.shaped)
        acts_as = {name: term.acts_as for name, term in sorted(terms.items()) if term.acts_as is not None}
        zero = tuple(sorted(label[id(processes[place])] for place in free if processes[place].scale == 0))
        remarks = (*_of_terms(model, acts_as, zero, wv=wv, matrix=problem.matrix), *settled.remarks)
        diagnostics = Diagnostics(
            acts_as=acts_as, not_supported=zero, nodes=solution.nodes, start=solution.start, remarks=remarks
        )
        decomposition = model.decomposition(wv.levels, wv.rate, wv.filter)
        return cls(
            wavelet_variance=wv, model=model,
            parameters={name: v for name, v in model.parameters.items() if v is not None}, objective=solution.objective,
            lower_bound=solution.lower_bound, relaxed_bound=solution.relaxed_bound,
            implied=np.asarray(sum(decomposition.values()), dtype=np.float64), decomposition=decomposition,
            weighting=weighting, weighting_matrix=problem.matrix, diagnostics=diagnostics,
        )  # fmt: skip

    def refit(self, wv: WaveletVariance) -> Fit:
        """Fit the model to data `wv` that are almost the same as the data of this fit.

        The weighting is the same, except that "diagonal" replaces "identity" and a matrix of the user.
        """
        if self.weighting not in REWEIGHTED:
            return Fit.of(settle(self.model, wv, "diagonal", certify=False), wv, "diagonal")
        settled = settle(
            # The change is below the relative error √(2/N) at 2⁴⁰ samples, `gmwm.plan`'s limit. Only models that do not
            # describe the data need more iterations (tests/estimation/test_weights.py).
            self.model, wv, self.weighting, certify=False, start=self.model, fixed=1e-6, returns=2,
            first=follow, search=not any(len(to_find(process)) > 1 for process in self.model.processes),
        )  # fmt: skip
        return Fit.of(settled, wv, self.weighting)

    @property
    def gap(self) -> float | None:
        """Largest relative decrease of the objective that other parameter values can reach; None without a certificate.

        It is 0 if the objective is as small as rounding errors.
        """
        if self.lower_bound is None:
            return None
        weighed = float(self.wavelet_variance.variance @ self.weighting_matrix @ self.wavelet_variance.variance)
        if self.objective <= np.finfo(float).eps * weighed:
            return 0.0
        return 1 - self.lower_bound / self.objective

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the shape parameters of terms that are estimated as zero. The data do not determine their values."""
        return tuple(
            f"{term}.{parameter.name}"
            for term, process in self.model.by_term.items()
            if term in self.diagnostics.not_supported
            for parameter in process.nonlinear_parameters()
            if not process.is_fixed(parameter.name)
        )

    @property
    def regression(self) -> Regression | None:
        """Effect of the temperature or of other conditions that was removed from the data; None if none was removed."""
        regression: Regression | None = self.wavelet_variance.regression
        return regression

    @property
    def without_lags(self) -> Fit:
        """Fit with the wavelet variances alone, for plots of a fit that has moments at lags."""
        scales = self.wavelet_variance.levels > 0
        if np.all(scales):
            return self
        return replace(
            self, wavelet_variance=self.wavelet_variance.without_lags, implied=self.implied[scales],
            decomposition={term: curve[scales] for term, curve in self.decomposition.items()},
            weighting_matrix=self.weighting_matrix[np.ix_(scales, scales)],
        )  # fmt: skip

    def units(self) -> dict[str, str]:
        """Return the unit of every parameter, by name."""
        return self.model.units(self.wavelet_variance.unit)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks about the terms, the weights and the wavelet variance that limit the use of the fit."""
        return (*self.diagnostics.remarks, *self.wavelet_variance.remarks)

    sandwich = cached_property(asymptotic.sandwich)
    standard_errors = cached_property(asymptotic.standard_errors)
    confidence_intervals = intervals.confidence_intervals
    goodness_of_fit = goodness.goodness_of_fit
    wic = criterion.wic
    bootstrap = simulate_fits
    summary = describe
    _repr_html_ = as_html

    @property
    def covariance(self) -> Matrix:
        """Covariance (p, p) of the estimates, Cov θ̂ = B V Bᵀ with B = (DᵀΩD)⁻¹DᵀΩ and D = ∂ν²/∂θ.

        The rows and columns are the parameters of `standard_errors`, in the same order. Raises the errors of
        `sandwich`.
        """
        return self.sandwich.covariance

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
        from gmwm.choosing.replicates.result import compare_recordings

        return compare_recordings(self)

    def datasheet(self, level: float = 0.95) -> Datasheet:
        """Compute the datasheet numbers N, Q, B, K, R, T_c and q_c, with intervals at the confidence level `level`; see
        `gmwm.datasheets.datasheet`."""
        from gmwm.choosing.datasheets import datasheet

        return datasheet(self, level)

    def budget(self, duration: float | str, *, rest: float | str = 60.0, level: float = 0.95) -> Budget:
        """Compute the growth of the errors of unaided inertial navigation that the noise of this axis causes.

        `duration`, `rest` and `level`, the result and the errors are those of `gmwm.navigation.budget`.
        """
        from gmwm.applications.navigation.api import budget

        return budget({self.wavelet_variance.axis: self}, duration, rest=rest, level=level)

    coordinates = ("parameter",)

    def to_polars(self, level: float = 0.95) -> DataFrame:
        """Return the estimates as a Polars data frame with the columns parameter, value, low, high and unit.

        Parameters
        ----------
        level : float
            Confidence level of the intervals from low to high.
        """
        from polars import DataFrame

        limits, units, nan = self.confidence_intervals(level), self.units(), float("nan")
        rows = [
            {
                "parameter": name, "value": value, "low": float(limits.get(name, (nan,))[0]),
                "high": float(limits.get(name, (nan,))[-1]), "unit": units.get(name, ""),
            }
            for name, value in self.parameters.items()
        ]  # fmt: skip
        return DataFrame(rows)

    def require_consistent(self) -> None:
        """Raise ModelError if the parameters, the curves or the weights do not belong to the model and the data."""
        parameters = {name: value for name, value in self.model.parameters.items() if value is not None}
        if parameters != self.parameters or len(parameters) < len(self.model.names):
            raise ModelError(
                f"the parameters do not match the model {self.model}", argument="parameters", got=self.parameters
            )
        if (terms := tuple(self.decomposition)) != self.model.terms:
            raise ModelError(
                f"the decomposition has the terms {', '.join(terms)}, and the model is {self.model}",
                argument="decomposition", got=terms,
            )  # fmt: skip
        levels = len(self.wavelet_variance)
        for curve in (self.implied, *self.decomposition.values()):
            if curve.shape != (levels,):
                raise ModelError(
                    f"a curve has shape {curve.shape}, and the data have {levels} levels", argument="values", got=curve
                )
        if (shape := self.weighting_matrix.shape) != (levels, levels):
            raise ModelError(
                f"the weighting matrix has shape {shape}, and the data have {levels} levels",
                argument="weighting_matrix", got=shape,
            )  # fmt: skip

    def __repr__(self) -> str:
        return f"Fit({self.model.structure}, objective {self.objective:.6g})"


def _of_terms(
    model: Model, acts_as: Mapping[str, str], zero: Sequence[str], *, wv: WaveletVariance, matrix: Matrix
) -> Iterator[Remark]:
    """Yield remarks about terms that act as another process, terms that are zero, and the parameters of other terms."""
    processes = model.by_term
    for term, name in acts_as.items():
        like = likeness(
            processes[term], name, levels=wv.levels, rate=wv.rate, filter=find_filter(wv.filter), matrix=matrix
        )
        if like is None:
            yield Remark.of("correlation-time-unknown", wv.axis, case="fit", term=term, process=name, known="no")
        else:
            parameter = like.scale_parameter()
            yield Remark.of(
                "correlation-time-unknown", wv.axis, case="fit", term=term, process=name, known="yes",
                parameter=f"{like.name}.{parameter.name}",
                amount=Quantity(like.value(parameter.name), parameter.unit(wv.unit)),
            )  # fmt: skip
    for term in zero:
        yield Remark.of("term-zero", wv.axis, case="fit", term=name_in_text(term, processes[term]))
    for term, process in processes.items():
        if process.scale > 0 and term not in acts_as:
            yield from (remark.about(wv.axis) for remark in process.remarks(term, wv.samples, wv.rate))
