"""A fitted model: estimates, criterion, bounds, and what they were computed from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm._text import Named
from gmwm.errors import ModelError, ReadError
from gmwm.estimation.inference_methods import InferenceMethods
from gmwm.estimation.starts import Start
from gmwm.processes.kalman_methods import KalmanMethods
from gmwm.processes.model import Model
from gmwm.remarks import Remark
from gmwm.variance.result import WaveletVariance


@dataclass(frozen=True, kw_only=True)
class Diagnostics:
    """What to know before using a fit.

    Attributes
    ----------
    acts_as : mapping of term to process name
        Terms at an end of their domain, which these data cannot tell from another process.
    not_supported : tuple of str
        Terms estimated as zero: these data do not show them.
    nodes : int
        Nodes of the search tree that the certificate took.
    start : Start or None
        From where the optimum was reached, and the criterion there; None of a fit that was read from a file without it.
    remarks : tuple of Remark
        What to know before using the fit.
    """

    acts_as: Mapping[str, str]
    not_supported: tuple[str, ...]
    nodes: int
    start: Start | None = None
    remarks: tuple[Remark, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """The diagnostics as plain numbers, lists and texts, ready for JSON."""
        return {
            "acts_as": dict(self.acts_as),
            "not_supported": list(self.not_supported),
            "search_nodes": self.nodes,
            "start": None if self.start is None else self.start.to_dict(),
            "remarks": [remark.to_dict() for remark in self.remarks],
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Diagnostics:
        """The diagnostics whose `to_dict` gave `values`."""
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
    """A model fitted to a wavelet variance.

    Attributes
    ----------
    wavelet_variance : WaveletVariance
        What it was fitted to, ν̂².
    model : Model
        With its estimates; repeated terms have the shortest correlation time first.
    parameters : mapping of name to value
        "WN.sigma2", "GM.beta", with repeats "GM[1].beta"; SI and per sample, β in 1/s. "DR.omega" is signed
        where the wavelet variance came from data, |ω| otherwise.
    objective : float
        (ν̂ − ν)ᵀ Ω (ν̂ − ν) at the estimate.
    lower_bound : float or None
        No model of this form has a smaller objective; None if fitted with certify=False, and where a process has
        several parameters of its shape.
    relaxed_bound : float
        No model with any number of the repeated process has a smaller objective; 0 where nothing better is known.
    implied : (J,) array, in unit²
        Wavelet variance of the fitted model.
    decomposition : mapping of term to (J,) array
        That of each process; they add up to `implied`.
    weighting : str
        Which Ω: "diagonal", "optimal", "identity", or "matrix" for one that was given.
    weighting_matrix : (J, J) array
        Ω.
    diagnostics : Diagnostics
        Terms that act as another process or are not supported by the data, and how the search went.
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
        """Share of the objective that a better fit could gain at most; None without a certificate.

        0 for a perfect fit, whose objective is that of rounding errors.
        """
        if self.lower_bound is None:
            return None
        weighed = float(self.wavelet_variance.variance @ self.weighting_matrix @ self.wavelet_variance.variance)
        if self.objective <= np.finfo(float).eps * weighed:
            return 0.0
        return 1 - self.lower_bound / self.objective

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Parameters that mean nothing here: the shapes of terms that are estimated as zero."""
        return tuple(
            f"{term}.{parameter.name}"
            for term, process in zip(self.model.terms, self.model.processes, strict=True)
            if term in self.diagnostics.not_supported
            for parameter in process.nonlinear_parameters()
            if not process.is_fixed(parameter.name)
        )

    def units(self) -> dict[str, str]:
        """Unit of every parameter."""
        return self.model.units(self.wavelet_variance.unit)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What to know before using the fit: about its terms, its weights and the levels that it was fitted to."""
        return (*self.diagnostics.remarks, *self.wavelet_variance.remarks)

    def to_dict(self) -> dict[str, Any]:
        """The fit as plain numbers, lists and texts, ready for JSON."""
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
        """The fit whose `to_dict` gave `values`, to the last bit; from its JSON, or an axis of a fits.json, too.

        Raises
        ------
        ReadError
            If they are not those of a fit: something is missing, or of the wrong kind or size.

        Examples
        --------
        >>> from gmwm import RW, WN, fit
        >>> found = fit(WN() + RW(), (WN(sigma2=4.0) + RW(gamma2=1.0)).simulate(1000, 100.0, rng=1), rate=100.0)
        >>> Fit.from_dict(found.to_dict()).parameters == found.parameters
        True
        """
        try:
            return cls._from_dict(values)
        except KeyError as error:
            raise ReadError(f"not a fit: it has no {error.args[0]!r}") from error
        except (TypeError, ValueError, AttributeError) as error:
            raise ReadError(f"not a fit: {error}") from error

    @classmethod
    def _from_dict(cls, values: Mapping[str, Any]) -> Fit:
        wv = WaveletVariance.from_dict(values["wavelet_variance"])
        model = Model.parse(values["model"])
        parameters = {name: value for name, value in model.parameters.items() if value is not None}
        if parameters != values["parameters"] or len(parameters) < len(model.names):
            raise ModelError(f"the parameters are not those of {model}")
        decomposition = {term: _curve(part, len(wv)) for term, part in values["decomposition"].items()}
        if tuple(decomposition) != model.terms:
            raise ModelError(f"the decomposition is not that of {model}: it has {', '.join(decomposition)}")
        matrix = np.array(values["weighting_matrix"], dtype=np.float64)
        if matrix.shape != (len(wv), len(wv)):
            raise ModelError(f"the weighting matrix is of shape {matrix.shape}, the data have {len(wv)} levels")
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
    """A number for each level."""
    curve = np.array(values, dtype=np.float64)
    if curve.shape != (levels,):
        raise ModelError(f"a curve of shape {curve.shape} where the data have {levels} levels")
    return curve
