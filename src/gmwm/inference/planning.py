"""How long must I record? The standard errors that recordings of any length would give, before one is made."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from gmwm._arrays import Matrix, Vector, as_rate, freeze
from gmwm._tables import aligned
from gmwm._text import Named, Summarised, counted, duration_text
from gmwm.covariance import Design, covariance
from gmwm.errors import ModelError, OptionError
from gmwm.estimation.problem import pose
from gmwm.estimation.weighting import precision, usual_weighting
from gmwm.inference.asymptotic import sandwich_of
from gmwm.options import one_of
from gmwm.processes.model import Model, ModelLike, as_model
from gmwm.remarks import Quantity, Remark, texts
from gmwm.variance.result import WaveletVariance

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as MatplotlibFigure

SEEN = 0.5
"""Above this relative standard error a parameter is not seen: the error says no more than that it may be anything."""
PER_DECADE = 8
"""Lengths of the curve in a factor of ten."""
LONGEST = 2**40
"""Samples of the longest record that is thought of: 350 years at 100 Hz."""
SUMMED = 2**20
"""Samples up to which a covariance that is a sum over all lags takes less than a second."""
BEYOND = 1e4
"""How many times the planned duration is searched for a wanted accuracy."""
PER_OCTAVE = 4
"""Lengths in a factor of two at which that search looks before it bisects."""
NEAR = 5e-3
"""Relative accuracy of the length that it finds."""
_LEAST, _MOST = 1e-295, 1e295
"""Products of two variances that double precision holds with room to work."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Plan(Summarised):
    """Relative standard errors of the estimates of a model, by length of the recording.

    Attributes
    ----------
    model : Model
        What is going to be estimated, with the values it is expected to have; held parameters are taken as known.
    rate : float
        Samples per second (Hz).
    weighting : "diagonal" or "optimal"
        That of the fit to come.
    durations : (n,) array, s
        From the shortest record with more levels than parameters to the planned one, eight in a factor of ten. Each
        is a whole number of samples.
    errors : mapping of name to (n,) array
        Standard error of θ̂ over |θ|; infinite where a record does not determine the parameter at all.
    unit : str
        Unit of the signal, for the summary.

    Examples
    --------
    >>> made = plan("WN(sigma2=4e-6) + RW(gamma2=1e-10)", duration=3600.0, rate=100.0)
    >>> made.duration, {name: errors.shape == made.durations.shape for name, errors in made.errors.items()}
    (3600.0, {'WN.sigma2': True, 'RW.gamma2': True})
    >>> {name: f"{error:.1%}" for name, error in made.at(600.0).items()}
    {'WN.sigma2': '0.6%', 'RW.gamma2': '17.8%'}
    """

    model: Model
    rate: float
    weighting: Literal["diagonal", "optimal"]
    durations: Vector
    errors: Mapping[str, Vector]
    unit: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "errors", MappingProxyType(Named(self.errors, "parameter")))
        for array in (self.durations, *self.errors.values()):
            freeze(array)

    def __reduce__(self) -> tuple[Any, ...]:
        # A mapping proxy cannot be pickled: a copy is built anew from a plain dict, and is read-only as well.
        made = partial(
            Plan,
            model=self.model,
            rate=self.rate,
            weighting=self.weighting,
            durations=self.durations,
            errors=dict(self.errors),
            unit=self.unit,
        )
        return made, ()

    def plot(
        self, *, accuracy: float = 0.1, ax: Axes | None = None, path: str | os.PathLike[str] | None = None
    ) -> MatplotlibFigure:
        """Draw the relative standard error of each parameter over the length of the recording.

        The curves continue beyond the planned duration, which is marked.

        Parameters
        ----------
        accuracy : float
            Wanted relative standard error: a horizontal line, with a ring where each parameter reaches it.
        ax : matplotlib Axes, optional
            Where to draw; a new figure by default.
        path : path, optional
            File to write the picture to, ending in .png, .pdf or .svg.

        Returns
        -------
        matplotlib.figure.Figure
            A figure that is not registered with pyplot, so it need not be closed. Notebooks display it.

        Raises
        ------
        OptionError
            If `accuracy` is not between 0 and 0.5, or the picture cannot be drawn on `ax` or written to `path`.
        """
        from gmwm.plots.plan import plot_plan

        return plot_plan(self, accuracy=accuracy, ax=ax, path=path)

    @property
    def duration(self) -> float:
        """The planned length of the recording (s)."""
        return float(self.durations[-1])

    @property
    def horizon(self) -> float:
        """The longest recording in which `needed` looks (s): less far where a covariance takes a sum over all lags."""
        far = min(BEYOND * self.duration, LONGEST / self.rate)
        if self.model.has("coefficient_covariance"):
            return far
        return min(far, max(self.duration, SUMMED / self.rate))

    def at(self, duration: float) -> dict[str, float]:
        """Relative standard error of each parameter in a recording of `duration` (s).

        Raises
        ------
        OptionError
            If it has no more levels than the model has parameters, or more than 2⁴⁰ samples.
        """
        found = self._at(samples_of(duration, self.rate, len(self.errors)))
        return Named(zip(self.errors, found.tolist(), strict=True), "parameter")

    def needed(self, accuracy: float = 0.1) -> dict[str, float]:
        """The length (s) from which on each parameter is known to a relative standard error of `accuracy`.

        A record of more than twice the length is always better, within a factor of two the error may rise a little
        where levels are added and a drift and a random walk part: of several crossings the last one counts, looked
        for in steps of a quarter octave. `math.inf` where none is found up to `horizon`, 10 000 times the planned
        duration or 2⁴⁰ samples; 2²⁰ samples, or the planned duration, of processes whose covariance is a long sum.

        Raises
        ------
        OptionError
            If `accuracy` is not between 0 and 0.5, beyond which a standard error says nothing.

        Examples
        --------
        >>> found = plan("WN(sigma2=4e-6) + RW(gamma2=1e-10)", duration=3600.0, rate=100.0).needed(0.2)
        >>> {name: duration_text(seconds) for name, seconds in found.items()}
        {'WN.sigma2': '0.58 s', 'RW.gamma2': '7.9 min'}
        """
        wanted = as_accuracy(accuracy)
        return Named({name: self._needed(k, wanted) / self.rate for k, name in enumerate(self.errors)}, "parameter")

    def summary(self, accuracy: float = 0.1) -> str:
        """A table: value and relative error of each parameter at 1/4, 1 and 4 times the duration, and what
        `accuracy`, a relative error, needs."""
        wanted, units = self.needed(accuracy), self.model.units(self.unit)
        lengths = [self.duration * factor for factor in (0.25, 1.0, 4.0)]
        lengths = [t for t in lengths if self.durations[0] <= t <= LONGEST / self.rate]
        columns = [self.at(t) for t in lengths]
        rows = [["parameter", "unit", "value", *map(duration_text, lengths), f"for {100 * accuracy:g} %"]]
        for name, seconds in wanted.items():
            value = self.model.parameters[name]
            need = duration_text(seconds) if math.isfinite(seconds) else f"> {duration_text(self.horizon)}"
            rows.append([name, units[name], f"{value:.3e}", *(error_text(column[name]) for column in columns), need])
        lines = [
            f"Relative standard errors of {self.model.structure} by length of the recording",
            f"{self.rate:g} Hz, weighting {self.weighting}; last column: the length that gives {100 * accuracy:g} %",
            "",
        ]
        lines += aligned(rows, right=range(2, len(rows[0])))
        remarks = texts(self.remarks)
        return "\n".join([*lines, "", *remarks] if remarks else lines)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """What the planned recording will not show."""
        planned = self.at(self.duration)
        hidden = [name for name, error in planned.items() if SEEN < error < math.inf]
        lost = [name for name, error in planned.items() if math.isinf(error)]
        duration, remarks = Quantity(self.duration, "s"), []
        if hidden:
            remarks.append(Remark.of("plan-uncertain", parameters=tuple(hidden), duration=duration, seen=SEEN))
        if lost:
            remarks.append(Remark.of("plan-undetermined", parameters=tuple(lost), duration=duration))
        return tuple(remarks)

    def to_dict(self) -> dict[str, Any]:
        """The plan as plain numbers, lists and texts, ready for JSON."""
        return {
            "model": str(self.model),
            "parameters": {name: self.model.parameters[name] for name in self.errors},
            "units": {name: unit for name, unit in self.model.units(self.unit).items() if name in self.errors},
            "rate": self.rate,
            "weighting": self.weighting,
            "duration": self.duration,
            "planned": self.at(self.duration),
            "durations": self.durations.tolist(),
            "errors": {name: curve.tolist() for name, curve in self.errors.items()},
        }

    def __repr__(self) -> str:
        return f"Plan({self.model.structure}, {duration_text(self.duration)} at {self.rate:g} Hz)"

    # --- inside ---------------------------------------------------------------------------------------

    @cached_property
    def _known(self) -> dict[int, Vector]:
        """Errors that were computed before, by number of samples."""
        samples = np.rint(self.durations * self.rate).astype(np.int64).tolist()
        return dict(zip(samples, np.column_stack(list(self.errors.values())), strict=True))

    def _at(self, samples: int) -> Vector:
        if samples not in self._known:
            self._known[samples] = relative_errors(self.model, samples, self.rate, self.weighting)[1]
        return self._known[samples]

    def _needed(self, k: int, accuracy: float) -> float:
        """Samples from which on parameter k is known so well; infinite beyond the horizon."""

        def enough(samples: int) -> bool:
            return bool(self._at(samples)[k] <= accuracy)

        last = int(self.horizon * self.rate)
        low, high = len(self.errors) + 1, last.bit_length() - 1
        if not enough(last):
            return math.inf
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(1 << middle) else (middle + 1, high)
        # From one octave to the next the error falls more than it rises within one: the last crossing is near.
        near = (np.arange(-PER_OCTAVE, PER_OCTAVE + 1) / PER_OCTAVE + high).tolist()
        grid = sorted({min(max(round(2.0**at), 1 << (len(self.errors) + 1)), last) for at in near} | {last})
        short = [place for place, samples in enumerate(grid) if not enough(samples)]
        if not short:
            return grid[0]
        below, above = grid[short[-1]], grid[short[-1] + 1]
        while above - below > max(1, NEAR * above):
            middle = (above + below) // 2
            below, above = (below, middle) if enough(middle) else (middle, above)
        return above


def plan(
    model: ModelLike,
    *,
    duration: float,
    rate: float,
    weighting: Literal["diagonal", "optimal"] | None = None,
    unit: str = "",
) -> Plan:
    """How well a recording that is still to be made will determine each parameter of a model, by its length.

    Cov θ̂ = B V Bᵀ with B = (DᵀΩD)⁻¹DᵀΩ, D = ∂ν²/∂θ and V the exact covariance of the Haar wavelet variance of a
    record of N samples, for many N. Nothing is simulated. Take the values from a pilot recording or a datasheet.

    Parameters
    ----------
    model : Model, Process or str
        With all its values; those in ``fixed(…)`` are taken as known.
    duration : float
        Length of the recording that is planned (s).
    rate : float
        Samples per second (Hz).
    weighting : "diagonal" or "optimal", optional
        Ω of the fit to come: 1 / V_jj, or V⁻¹; by default as of `fit`.
    unit : str
        Unit of the signal, as "rad/s"; shown in the summary, changes no number.

    Returns
    -------
    Plan

    Raises
    ------
    ModelError
        If a value is missing, a scale is zero or leaves the range of double precision, or the model cannot be fitted.
    OptionError
        If the duration is too short for the model or has more than 2⁴⁰ samples, or an option is unknown.
    MissingTheoryError
        If the covariance of a process is not known.

    Examples
    --------
    >>> from gmwm import GM, WN
    >>> found = plan(GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6), duration=3600.0, rate=100.0)
    >>> {name: round(error, 3) for name, error in found.at(3600.0).items()}
    {'GM.beta': 0.054, 'GM.sigma2': 0.038, 'WN.sigma2': 0.002}
    """
    whole, rate = as_model(model), as_rate(rate)
    weighting = usual_weighting(whole) if weighting is None else weighting
    one_of(weighting, "weighting", ("diagonal", "optimal"))
    free = _free(whole, rate)
    longest = samples_of(duration, rate, free)
    _require_range(whole, min(int(BEYOND * longest), LONGEST), rate)
    levels = longest.bit_length() - 1
    pose(whole, WaveletVariance.from_values(whole.wavelet_variance(levels, rate), longest, rate), np.eye(levels))
    shortest = 1 << (free + 1)
    count = 1 + math.ceil(PER_DECADE * math.log10(longest / shortest))
    samples = np.unique(np.rint(np.geomspace(shortest, longest, count)).astype(np.int64))
    found = [relative_errors(whole, n, rate, weighting) for n in samples.tolist()]
    curves = np.column_stack([errors for _, errors in found])
    errors = {name: curve.copy() for name, curve in zip(found[-1][0], curves, strict=True)}
    return Plan(model=whole, rate=rate, weighting=weighting, durations=samples / rate, errors=errors, unit=unit)


def relative_errors(
    model: Model, samples: int, rate: float, weighting: Literal["diagonal", "optimal"]
) -> tuple[tuple[str, ...], Vector]:
    """Names of the free parameters, and the standard error of each over its value, for a record of `samples`."""
    design = Design(np.arange(1, samples.bit_length()), samples, rate)
    wavelet = covariance(model, design)
    found = sandwich_of(model, design, _weights(wavelet, weighting), wavelet)
    return found.names, np.sqrt(np.diag(found.relative))


def _weights(wavelet: Matrix, weighting: Literal["diagonal", "optimal"]) -> Matrix:
    if weighting == "optimal":
        return precision(wavelet)
    with np.errstate(over="ignore", divide="ignore"):
        weights = 1 / np.diag(wavelet)
    if not np.all(np.isfinite(weights)):
        raise ModelError("the model has no noise at some level, so that a record of any length would be exact; add WN")
    return np.diag(weights)


def _free(model: Model, rate: float) -> int:
    """Number of parameters to estimate, of a model with all its values and no term that is zero."""
    missing = {
        term: [parameter for parameter, value in process.values.items() if value is None]
        for term, process in zip(model.terms, model.processes, strict=True)
        if not process.is_complete
    }
    if missing:
        names = ", ".join(f"{term}.{parameter}" for term, lacking in missing.items() for parameter in lacking)
        term, lacking = next(iter(missing.items()))
        example = ", ".join(f"{parameter}=…" for parameter in lacking)
        raise ModelError(
            f"a plan of {model} needs a value for {names}: write it into the model, as "
            f"{term.partition('[')[0]}({example}), from a pilot recording or a datasheet"
        )
    zero = [
        term
        for term, process in zip(model.terms, model.processes, strict=True)
        if process.scale == 0 and not process.is_fixed(process.scale_parameter().name)
    ]
    if zero:
        raise ModelError(f"{', '.join(zero)} is zero in {model}: an error relative to it means nothing; leave it out")
    return len(model.names) - len(model.fixed_names)


def _require_range(model: Model, samples: int, rate: float) -> None:
    """Squares of the variances, as they are summed and weighed for up to `samples`, must be finite and not vanish."""
    levels = np.arange(1, samples.bit_length())
    shown = model.wavelet_variance(levels, rate)
    freedom = np.maximum(samples / np.ldexp(1.0, levels), 1.0)
    with np.errstate(over="ignore", under="ignore"):
        small = shown[shown > 0] ** 2 / freedom[shown > 0]
        large = np.ldexp(shown, 2 * levels) ** 2 * samples
    if np.min(small, initial=1.0) < _LEAST or not np.max(large) < _MOST:
        raise ModelError(
            f"the wavelet variance of {model} runs from {shown.min():g} to {shown.max():g}: its squares leave the "
            "range of double precision; write the values in a larger or smaller unit of the signal"
        )


def samples_of(duration: float, rate: float, free: int) -> int:
    """Samples of a recording of `duration` (s), which must have more levels than `free` parameters."""
    if isinstance(duration, bool) or not isinstance(duration, int | float | np.number):
        raise OptionError(f"duration must be a number (s), got {duration!r}")
    if not (math.isfinite(duration) and duration > 0):
        raise OptionError(f"duration must be positive and finite (s), got {duration!r}")
    samples, least = round(float(duration) * rate), 1 << (free + 1)
    if samples < least:
        raise OptionError(
            f"duration={duration:g} has {counted(samples, 'sample')} at {rate:g} Hz: to estimate "
            f"{counted(free, 'parameter')} takes {least}, {least / rate:g} s; plan for longer, or take a smaller model"
        )
    if samples > LONGEST:
        raise OptionError(f"duration={duration:g} has {samples:.3g} samples at {rate:g} Hz, more than 2^40; take less")
    return samples


def as_accuracy(accuracy: float) -> float:
    """A relative standard error that means something: above 0, up to 0.5."""
    if isinstance(accuracy, bool) or not isinstance(accuracy, int | float | np.number) or not 0 < accuracy <= SEEN:
        raise OptionError(
            f"accuracy must be above 0 and at most {SEEN:g}, as 0.1 for 10 %, since a larger relative standard error "
            f"says nothing; got {accuracy!r}"
        )
    return float(accuracy)


def error_text(error: float) -> str:
    """A relative standard error in per cent.

    >>> error_text(0.0296), error_text(0.123), error_text(0.7), error_text(float("inf"))
    ('3.0 %', '12 %', 'not to be seen', 'not determined')
    """
    if math.isinf(error):
        return "not determined"
    shown = float(f"{100 * error:.2g}")
    return f"{f'{shown:#.2g}'.rstrip('.')} %" if error <= SEEN else "not to be seen"
