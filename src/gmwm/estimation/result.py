"""A fitted model: estimates, criterion, bounds, and what they were computed from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gmwm._arrays import Matrix, Vector, freeze
from gmwm._late import LateMethod
from gmwm.processes.model import Model
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
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
    """

    acts_as: Mapping[str, str]
    not_supported: tuple[str, ...]
    nodes: int

    def notes(self) -> list[str]:
        """The same in words."""
        notes = [
            f"{term} acts as {name}: its correlation time cannot be told from these data"
            for term, name in self.acts_as.items()
        ]
        return notes + [f"{term} is not supported by these data: estimated as zero" for term in self.not_supported]


@dataclass(frozen=True, eq=False, repr=False)
class Fit:
    """A model fitted to a wavelet variance.

    Attributes
    ----------
    model : Model
        With its estimates; repeated terms have the shortest correlation time first.
    parameters : mapping of name to value
        "WN.sigma2", "GM.beta", with repeats "GM[1].beta"; SI and per sample, β in 1/s. "DR.omega" is signed
        where the wavelet variance came from data, |ω| otherwise.
    objective : float
        (ν̂ − ν)ᵀ Ω (ν̂ − ν) at the estimate.
    lower_bound : float or None
        No model of this form has a smaller objective; None if fitted with certify=False.
    relaxed_bound : float
        No model with any number of the repeated process has a smaller objective.
    implied : (J,) array, in unit²
        Wavelet variance of the fitted model.
    decomposition : mapping of term to (J,) array
        That of each process; they add up to `implied`.
    weighting_matrix : (J, J) array
        Ω.
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

    plot: ClassVar[LateMethod[..., Figure]] = LateMethod(
        "gmwm.plots.fit:plot_fit",
        "Draw the observed and the implied curve with every process; view='allan' shows the Allan deviation.",
    )

    def __post_init__(self) -> None:
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
            "acts_as": dict(self.diagnostics.acts_as),
            "not_supported": list(self.diagnostics.not_supported),
            "undetermined": list(self.undetermined),
            "search_nodes": self.diagnostics.nodes,
            "wavelet_variance": self.wavelet_variance.to_dict(),
        }

    def summary(self) -> str:
        """Model, data, criterion with its bounds, and the estimates with their units."""
        wv = self.wavelet_variance
        units = self.units()
        width = max(len(name) for name in self.parameters)
        certificate = "not certified (certify=False)"
        if self.gap is not None:
            claim = "global optimum, no better fit" if self.gap <= 1e-3 else "best found, not proven: none better"
            certificate = f"{claim} by more than {100 * self.gap:.2g} %"
        lines = [
            f"{self.model.structure}{' of ' + wv.axis if wv.axis else ''}",
            f"{wv.samples} samples at {wv.rate:g} Hz, {len(wv)} levels, "
            f"{f'robust, efficiency {wv.efficiency:g}, ' if wv.robust else ''}weighting {self.weighting}",
            f"objective {self.objective:.6g}: {certificate}",
            f"any number of terms: at least {self.relaxed_bound:.6g}",
            "",
        ]
        for name, value in self.parameters.items():
            shown = "undetermined" if name in self.undetermined else f"{value:.6e}"
            held = "  (held)" if name in self.model.fixed else ""
            lines.append(f"  {name:<{width}}  {shown:>14}  {units[name]}{held}")
        notes = self.diagnostics.notes()
        return "\n".join([*lines, "", *notes] if notes else lines)

    def __repr__(self) -> str:
        return f"Fit({self.model.structure}, objective {self.objective:.6g})"

    def _repr_html_(self) -> str:
        return f"<pre>{escape(self.summary())}</pre>"
