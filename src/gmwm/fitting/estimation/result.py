"""Result of a fit, with the estimates, the objective and its bounds, and the data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.errors import ModelError
from gmwm.base.kinds import Document, require_kinds
from gmwm.base.remarks import Remark
from gmwm.base.text import Named
from gmwm.fitting.estimation.inference_methods import InferenceMethods
from gmwm.fitting.estimation.starts import Start
from gmwm.measuring.regression.result import Regression
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.kalman_methods import KalmanMethods
from gmwm.theory.processes.model import Model

if TYPE_CHECKING:
    from polars import DataFrame

_HOW_WRITTEN = "Pass the values that `Fit.to_dict()` returned."


GIVEN = "given"
"""Attribute `weighting` of a `Fit` whose parameters were given and not estimated from data."""


@dataclass(frozen=True, kw_only=True)
class Diagnostics:
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

    def to_dict(self) -> dict[str, Any]:
        """Return the diagnostics as plain numbers, lists and strings for JSON."""
        return {
            "acts_as": dict(self.acts_as),
            "not_supported": list(self.not_supported),
            "search_nodes": self.nodes,
            "start": None if self.start is None else self.start.to_dict(),
            "remarks": [remark.to_dict() for remark in self.remarks],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Diagnostics:
        """Restore the diagnostics from `values`, the output of `to_dict`."""
        start = values["start"]
        return cls(
            acts_as=dict(values["acts_as"]),
            not_supported=tuple(values["not_supported"]),
            nodes=int(values["search_nodes"]),
            start=None if start is None else Start.from_dict(start),
            remarks=tuple(Remark.from_dict(remark) for remark in values["remarks"]),
        )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fit(InferenceMethods, KalmanMethods):
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

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", Named(self.parameters, "parameter"))
        object.__setattr__(self, "decomposition", Named(self.decomposition, "term"))
        freeze(self.implied)
        freeze(self.weighting_matrix)

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
            for term, process in zip(self.model.terms, self.model.processes, strict=True)
            if term in self.diagnostics.not_supported
            for parameter in process.nonlinear_parameters()
            if not process.is_fixed(parameter.name)
        )

    @property
    def regression(self) -> Regression | None:
        """Effect of the temperature or of other conditions that was removed from the data; None if none was removed."""
        found: Regression | None = self.wavelet_variance.regression
        return found

    def units(self) -> dict[str, str]:
        """Return the unit of every parameter, by name."""
        return self.model.units(self.wavelet_variance.unit)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks about the terms, the weights and the wavelet variance that limit the use of the fit."""
        return (*self.diagnostics.remarks, *self.wavelet_variance.remarks)

    def to_frame(self, level: float = 0.95) -> DataFrame:
        """Return the estimates as a Polars data frame with the columns parameter, value, low, high and unit.

        Parameters
        ----------
        level : float
            Confidence level of the intervals from low to high.
        """
        from polars import DataFrame

        limits, units = self.confidence_intervals(level), self.units()
        nan = (float("nan"), float("nan"))
        rows = [
            {
                "parameter": name,
                "value": value,
                "low": float(limits.get(name, nan)[0]),
                "high": float(limits.get(name, nan)[1]),
                "unit": units.get(name, ""),
            }
            for name, value in self.parameters.items()
        ]
        return DataFrame(rows)

    def to_dict(self) -> dict[str, Any]:
        """Return the fit as plain numbers, lists and strings for JSON."""
        return {
            "model": str(self.model),
            "parameters": dict(self.parameters),
            "units": self.units(),
            "objective": self.objective,
            "lower_bound": self.lower_bound,
            "relaxed_bound": self.relaxed_bound,
            "implied": self.implied.tolist(),
            "decomposition": {term: part.tolist() for term, part in self.decomposition.items()},
            "weighting": self.weighting,
            "weighting_matrix": self.weighting_matrix.tolist(),
            "undetermined": list(self.undetermined),
            **self.diagnostics.to_dict(),
            "wavelet_variance": self.wavelet_variance.to_dict(),
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Fit:
        """Restore a fit from the output of `to_dict`. All numbers are exactly the same.

        Parameters
        ----------
        values : mapping
            Output of `to_dict`, which may have been written to JSON and read again, or one axis of a fits.json file.

        Returns
        -------
        Fit

        Raises
        ------
        ReadError
            If a value is missing, or has the wrong type or size.

        Examples
        --------
        >>> from gmwm import RW, WN, fit
        >>> found = fit(WN() + RW(), (WN(sigma2=4.0) + RW(gamma2=1.0)).simulate(1000, 100.0, rng=1), rate=100.0)
        >>> Fit.from_dict(found.to_dict()).parameters == found.parameters
        True
        """
        document = Document("fit", _HOW_WRITTEN)
        with document.reading():
            found = cls._from_dict(values)
        require_kinds(found, "", document)
        return found

    @classmethod
    def _from_dict(cls, values: Mapping[str, Any]) -> Fit:
        wv = WaveletVariance.from_dict(values["wavelet_variance"])
        model = Model.parse(values["model"])
        parameters = {name: value for name, value in model.parameters.items() if value is not None}
        if parameters != values["parameters"] or len(parameters) < len(model.names):
            raise ModelError(
                f"the parameters do not match the model {model}", argument="parameters", got=values["parameters"]
            )
        decomposition = {term: _curve(part, len(wv)) for term, part in values["decomposition"].items()}
        if tuple(decomposition) != model.terms:
            raise ModelError(
                f"the decomposition has the terms {', '.join(decomposition)}, and the model is {model}",
                argument="decomposition",
                got=tuple(decomposition),
            )
        matrix = np.array(values["weighting_matrix"], dtype=np.float64)
        if matrix.shape != (len(wv), len(wv)):
            raise ModelError(
                f"the weighting matrix has shape {matrix.shape}, and the data have {len(wv)} levels",
                argument="weighting_matrix",
                got=matrix.shape,
            )
        lower = values["lower_bound"]
        return cls(
            wavelet_variance=wv,
            model=model,
            parameters=parameters,
            objective=float(values["objective"]),
            lower_bound=None if lower is None else float(lower),
            relaxed_bound=float(values["relaxed_bound"]),
            implied=_curve(values["implied"], len(wv)),
            decomposition=decomposition,
            weighting=str(values["weighting"]),
            weighting_matrix=matrix,
            diagnostics=Diagnostics.from_dict(values),
        )

    def __repr__(self) -> str:
        return f"Fit({self.model.structure}, objective {self.objective:.6g})"


def _curve(values: Any, levels: int) -> Vector:
    """Check that an array has one number for each level, and return it."""
    curve = np.array(values, dtype=np.float64)
    if curve.shape != (levels,):
        raise ModelError(
            f"a curve has shape {curve.shape}, and the data have {levels} levels", argument="values", got=values
        )
    return curve
