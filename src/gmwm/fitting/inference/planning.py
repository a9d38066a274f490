"""Plan a recording: standard errors of a model's parameters as functions of its length."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from gmwm.base.arrays import FrozenMappings, Matrix, Vector, as_number, as_rate, freeze
from gmwm.base.documents import plain
from gmwm.base.errors import ModelError, OptionError
from gmwm.base.remarks import Quantity, Remark, texts
from gmwm.base.results import Plotted
from gmwm.base.text import Named, Summarised, align, counted, duration_text
from gmwm.fitting.estimation.asymptotic import sandwich_of
from gmwm.fitting.estimation.problem import pose
from gmwm.fitting.estimation.weighting import precision, usual_weighting
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import one_of
from gmwm.theory.processes.model import Model, ModelLike, as_model

CERTAIN_ERROR = 0.5
"""Relative standard error above which a parameter is uncertain, because its 95 % interval then includes zero."""
LONGEST_PLAN_SAMPLES = 2**40  # largest number of samples of a planned recording, which is 350 years at 100 Hz
LONGEST_SEARCH_RATIO = 1e4  # multiple of the planned duration up to which `Plan.needed` searches
_LEAST, _MOST = 1e-295, 1e295
"""Range of squared variances: double precision, 1e±308, with a margin for sums over 2⁴⁰ samples."""


@dataclass(frozen=True)
class PlannedGaps:
    """Gaps of a planned recording, which repeat those of a pilot: the share of `filled` samples, and the lengths of its
    segments.

    >>> gaps = PlannedGaps(segments=(500, 1500))
    >>> gaps.design(1200, 100.0)[0].segments, gaps.shortest(512)
    ((500, 700), 1012)
    """

    filled: float = 0.0
    segments: tuple[int, ...] = ()

    @classmethod
    def of(cls, wv: WaveletVariance | None) -> PlannedGaps:
        """Return the gaps of the recording with the wavelet variance `wv`; no gaps for None."""
        return cls() if wv is None else cls(wv.filled / wv.samples, wv.segments)

    def __bool__(self) -> bool:
        return bool(self.filled or self.segments)

    def shortest(self, least: int) -> int:
        """Return the length (samples) of the shortest recording with a segment of `least` samples."""
        before = 0
        for length in self.segments:
            if length >= least:
                return before + least
            before += length
        if self.segments:
            raise OptionError(
                argument="pilot", expected=f"a recording with a segment of {least} samples without a gap",
                got=max(self.segments), advice="Find out why samples are lost, or use a smaller model.",
            )  # fmt: skip
        return least

    def design(self, samples: int, rate: float) -> tuple[Design, float]:
        """Return the design of a recording, and a factor of its covariance: 1/m for m repetitions."""
        filled, share, segments = round(self.filled * samples), 1.0, self.segments
        if not segments:
            return Design(np.arange(1, samples.bit_length()), samples, rate, filled=filled), share
        ends = np.cumsum(segments)
        if samples >= ends[-1]:
            share, samples = ends[-1] / samples, int(ends[-1])
        else:
            count = int(np.searchsorted(ends, samples))
            segments = (*segments[:count], samples - int(ends[count - 1] if count else 0))
        filled = round(self.filled * samples)
        levels = np.arange(1, max(segments).bit_length())
        return Design(levels, samples, rate, segments=segments, filled=filled), share


NONE = PlannedGaps()  # no gaps


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Plan(FrozenMappings, Summarised, Plotted):
    """Relative standard errors of the estimates of a model for recordings of different lengths.

    Attributes
    ----------
    model : Model
        Model to be estimated, with its expected values; fixed parameters are treated as known.
    rate : float
        Sampling rate (Hz).
    weighting : "diagonal" or "optimal"
        Weighting of the planned fit.
    durations : (n,) array, s
        Lengths of recordings, eight per factor of ten, from the shortest recording with more levels than parameters to
        the planned recording. Each is a whole number of samples.
    errors : mapping of name to (n,) array
        Relative standard error of each parameter at these lengths; infinite if a recording does not determine the
        parameter.
    unit : str
        Unit of the signal, for the summary.
    losses : PlannedGaps
        Gaps of the planned recording.

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
    losses: PlannedGaps = NONE

    def __post_init__(self) -> None:
        object.__setattr__(self, "errors", MappingProxyType(Named(self.errors, "parameter")))
        for array in (self.durations, *self.errors.values()):
            freeze(array)

    @property
    def duration(self) -> float:
        """Length (s) of the planned recording."""
        return float(self.durations[-1])

    @property
    def horizon(self) -> float:
        """Length (s) of the longest recording that `needed` considers.

        It is shorter if the covariance of a process is a sum over all lags, which would take too long."""
        far = min(LONGEST_SEARCH_RATIO * self.duration, LONGEST_PLAN_SAMPLES / self.rate)
        if all(process.memory(self.rate) is not None for process in self.model.processes):
            return far
        # Number of samples up to which a covariance that is a sum over all lags takes less than a second.
        return min(far, max(self.duration, 2**20 / self.rate))

    def at(self, duration: float) -> dict[str, float]:
        """Compute the relative standard error of each parameter for a recording of another length.

        Parameters
        ----------
        duration : float
            Length of the recording (s).

        Returns
        -------
        dict of name to float
            Relative standard error of each parameter.

        Raises
        ------
        OptionError
            If the recording has too few samples for the model, or more than 2⁴⁰ samples.
        """
        errors = self._at(samples_of(duration, self.rate, len(self.errors), self.losses))
        return Named(zip(self.errors, errors.tolist(), strict=True), "parameter")

    def needed(self, accuracy: float = 0.1) -> dict[str, float]:
        """Compute the recording length (s) that each parameter needs for a relative standard error of `accuracy`.

        A recording of more than twice the length always has smaller errors. Within a factor of two, the error may
        increase slightly where a level is added. Of several lengths at which the error falls to `accuracy`, the largest
        one is returned; the search has steps of a quarter octave.

        Parameters
        ----------
        accuracy : float
            Desired relative standard error, above 0 and at most 0.5.

        Returns
        -------
        dict of name to float
            Length (s) for each parameter; `math.inf` if no length up to `horizon` is sufficient. The horizon is 10 000
            times the planned duration, but at most 2⁴⁰ samples. If the covariance of a process is a sum over all lags,
            the horizon is 2²⁰ samples, or the planned duration if this is longer.

        Raises
        ------
        OptionError
            If `accuracy` is not between 0 and 0.5.

        Examples
        --------
        >>> found = plan("WN(sigma2=4e-6) + RW(gamma2=1e-10)", duration=3600.0, rate=100.0).needed(0.2)
        >>> {name: duration_text(seconds) for name, seconds in found.items()}
        {'WN.sigma2': '0.58 s', 'RW.gamma2': '7.9 min'}
        """
        share = as_accuracy(accuracy)
        return Named(
            {name: self._samples_needed(k, share) / self.rate for k, name in enumerate(self.errors)}, "parameter"
        )

    def summary(self, accuracy: float = 0.1) -> str:
        """Format a table of the plan.

        It has the value of each parameter, its relative standard error at 1/4, 1 and 4 times the planned duration, and
        the length of a recording that gives it a relative standard error of `accuracy`."""
        lengths_needed, units = self.needed(accuracy), self.model.units(self.unit)
        lengths = [self.duration * factor for factor in (0.25, 1.0, 4.0)]
        lengths = [t for t in lengths if self.durations[0] <= t <= LONGEST_PLAN_SAMPLES / self.rate]
        columns = [self.at(t) for t in lengths]
        rows = [["parameter", "unit", "value", *map(duration_text, lengths), f"for {100 * accuracy:g} %"]]
        for name, seconds in lengths_needed.items():
            value = self.model.parameters[name]
            need = duration_text(seconds) if math.isfinite(seconds) else f"> {duration_text(self.horizon)}"
            rows.append([name, units[name], f"{value:.3e}", *(error_text(column[name]) for column in columns), need])
        lines = [
            f"Relative standard errors of {self.model.structure} by length of the recording",
            f"{self.rate:g} Hz, weighting {self.weighting}; last column: length needed for {100 * accuracy:g} %",
            "",
        ]
        lines += align(rows, right=range(2, len(rows[0])))
        remarks = texts(self.remarks)
        return "\n".join([*lines, "", *remarks] if remarks else lines)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks about parameters that the planned recording does not determine."""
        planned = self.at(self.duration)
        uncertain = [name for name, error in planned.items() if CERTAIN_ERROR < error < math.inf]
        undetermined = [name for name, error in planned.items() if math.isinf(error)]
        duration, remarks = Quantity(self.duration, "s"), []
        if self.losses:
            longest = Quantity(max(self.losses.segments, default=0) / self.rate, "s")
            kind = "cut" if self.losses.segments else "filled"
            remarks.append(Remark.of("plan-gaps", share=self.losses.filled, longest=longest, kind=kind))
        if uncertain:
            remarks.append(
                Remark.of(
                    "poorly-known", case="plan", parameters=tuple(uncertain), duration=duration, seen=CERTAIN_ERROR
                )
            )
        if undetermined:
            remarks.append(
                Remark.of("poorly-known", case="impossible", parameters=tuple(undetermined), duration=duration)
            )
        return tuple(remarks)

    def to_dict(self) -> dict[str, Any]:
        """Return the plan as plain numbers, lists and strings for JSON."""
        return {
            "model": str(self.model), "parameters": {name: self.model.parameters[name] for name in self.errors},
            "units": {name: unit for name, unit in self.model.units(self.unit).items() if name in self.errors},
            "rate": self.rate, "weighting": self.weighting, "duration": self.duration,
            "planned": self.at(self.duration),
            **{name: plain(getattr(self, name), finite=False) for name in ("durations", "errors", "losses")},
        }  # fmt: skip

    def __repr__(self) -> str:
        return f"Plan({self.model.structure}, {duration_text(self.duration)} at {self.rate:g} Hz)"

    @cached_property
    def _cache(self) -> dict[int, Vector]:
        """Cache of relative standard errors, by number of samples."""
        samples = np.rint(self.durations * self.rate).astype(np.int64).tolist()
        return dict(zip(samples, np.column_stack(list(self.errors.values())), strict=True))

    def _at(self, samples: int) -> Vector:
        if samples not in self._cache:
            if samples < self.losses.shortest(1 << (len(self.errors) + 1)):
                return np.full(len(self.errors), np.inf)
            errors = relative_errors(self.model, samples, self.rate, self.weighting, losses=self.losses)
            self._cache[samples] = errors[1]
        return self._cache[samples]

    def _samples_needed(self, k: int, accuracy: float) -> float:
        """Return the samples from which parameter k has a relative error of at most `accuracy`; else infinity."""

        per_octave = 4

        def enough(samples: int) -> bool:
            return bool(self._at(samples)[k] <= accuracy)

        last = int(self.horizon * self.rate)
        low, high = len(self.errors) + 1, last.bit_length() - 1
        if not enough(last):
            return math.inf
        while low < high:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(1 << middle) else (middle + 1, high)
        # From octave to octave the error falls by more than it rises within one, so the length is within one of `high`.
        near = (np.arange(-per_octave, per_octave + 1) / per_octave + high).tolist()
        grid = sorted({min(max(round(2.0**at), 1 << (len(self.errors) + 1)), last) for at in near} | {last})
        short = [place for place, samples in enumerate(grid) if not enough(samples)]
        if not short:
            return grid[0]
        below, above = grid[short[-1]], grid[short[-1] + 1]
        # Relative accuracy of the lengths that `Plan.needed` finds; lengths are shown with two digits.
        while above - below > max(1, 5e-3 * above):
            middle = (above + below) // 2
            below, above = (below, middle) if enough(middle) else (middle, above)
        return above


def plan(
    model: ModelLike, *, duration: float, rate: float, weighting: Literal["diagonal", "optimal"] | None = None,
    unit: str = "", pilot: WaveletVariance | None = None,
) -> Plan:  # fmt: skip
    """Plan a recording, by computing the standard error of each parameter for recordings of many lengths.

    The covariance of the estimates is Cov θ̂ = B V Bᵀ, with B = (DᵀΩD)⁻¹DᵀΩ, D = ∂ν²/∂θ, the weighting matrix Ω, and
    the exact covariance V of the Haar wavelet variance of N samples. It is computed for many N, without simulation.
    Take the values of the model from a pilot recording or a datasheet.

    Parameters
    ----------
    model : Model, Process or str
        Model whose parameters all have values; values in ``fixed(…)`` are treated as known.
    duration : float
        Length of the planned recording (s).
    rate : float
        Sampling rate (Hz).
    weighting : "diagonal" or "optimal", optional
        Weighting matrix Ω of the planned fit, 1 / V_jj or V⁻¹; the default is the same as for `fit`.
    unit : str
        Unit of the signal, for example "rad/s", which the summary shows. It does not change the results.
    pilot : WaveletVariance, optional
        Curve of a pilot recording. The planned recording then has the same share of filled samples as the pilot, and
        repeats the lengths of its segments. The duration does not include the gaps. By default, there are no gaps.

    Returns
    -------
    Plan
        Relative standard errors by duration, and the durations that a desired accuracy requires.

    Raises
    ------
    ModelError
        If a value is missing, if a scale is zero, if the model cannot be fitted, or if the squares of its variances
        exceed the range of double precision.
    OptionError
        If the duration is too short for the model, if it has more than 2⁴⁰ samples, or if an option has an invalid
        value.
    MissingTheoryError
        If the covariance of a process is unknown.

    Examples
    --------
    >>> from gmwm import GM, WN
    >>> found = plan(GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6), duration=3600.0, rate=100.0)
    >>> {name: round(error, 3) for name, error in found.at(3600.0).items()}
    {'GM.beta': 0.054, 'GM.sigma2': 0.038, 'WN.sigma2': 0.002}
    """
    terms, rate = as_model(model), as_rate(rate)
    weighting = usual_weighting(terms) if weighting is None else weighting
    one_of(weighting, "weighting", ("diagonal", "optimal"))
    free = _free(terms, rate)
    losses = PlannedGaps.of(pilot)
    longest = samples_of(duration, rate, free, losses)
    _require_range(terms, min(int(LONGEST_SEARCH_RATIO * longest), LONGEST_PLAN_SAMPLES), rate)
    levels = losses.design(longest, rate)[0].levels.size
    pose(terms, WaveletVariance.from_values(terms.wavelet_variance(levels, rate), longest, rate), np.eye(levels))
    shortest = losses.shortest(1 << (free + 1))
    # Number of lengths per factor of ten for which standard errors are computed.
    count = 1 + math.ceil(8 * math.log10(longest / shortest))
    samples = np.unique(np.rint(np.geomspace(shortest, longest, count)).astype(np.int64))
    rows = [relative_errors(terms, n, rate, weighting, losses=losses) for n in samples.tolist()]
    curves = np.column_stack([errors for _, errors in rows])
    errors = {name: curve.copy() for name, curve in zip(rows[-1][0], curves, strict=True)}
    return Plan(
        model=terms, rate=rate, weighting=weighting, durations=samples / rate, errors=errors, unit=unit, losses=losses
    )


def relative_errors(
    model: Model, samples: int, rate: float, weighting: Literal["diagonal", "optimal"], losses: PlannedGaps = NONE
) -> tuple[tuple[str, ...], Vector]:
    """Return the names of the p free parameters, and their relative standard errors (p,), for a recording."""
    design, share = losses.design(samples, rate)
    wavelet = share * covariance(model, design)
    errors = sandwich_of(model, design, _weights(wavelet, weighting), wavelet)
    return errors.names, np.sqrt(np.diag(errors.relative))


def _weights(wavelet: Matrix, weighting: Literal["diagonal", "optimal"]) -> Matrix:
    if weighting == "optimal":
        return precision(wavelet)
    with np.errstate(over="ignore", divide="ignore"):
        weights = 1 / np.diag(wavelet)
    if not np.all(np.isfinite(weights)):
        raise ModelError(
            "the model has no noise at some level, so its estimates would be exact",
            advice="Add a term to the model, for example WN.",
        )
    return np.diag(weights)


def _free(model: Model, rate: float) -> int:
    """Return the number of free parameters; raises ModelError if a parameter has no value or a term is zero."""
    missing = {
        term: [parameter for parameter, value in process.values.items() if value is None]
        for term, process in model.by_term.items()
        if not process.is_complete
    }
    if missing:
        names = ", ".join(f"{term}.{parameter}" for term, lacking in missing.items() for parameter in lacking)
        term, lacking = next(iter(missing.items()))
        example = ", ".join(f"{parameter}=…" for parameter in lacking)
        raise ModelError(
            f"a plan of {model} needs a value for {names}",
            advice="Write it into the model as `{term}`, with a value from a pilot recording or a datasheet.",
            term=f"{term.partition('[')[0]}({example})",
        )
    zero = [
        term
        for term, process in model.by_term.items()
        if process.scale == 0 and not process.is_fixed(process.scale_parameter().name)
    ]
    if zero:
        raise ModelError(
            f"{', '.join(zero)} is zero in {model}, so it has no relative standard error",
            advice="Leave it out of the model.",
        )
    return len(model.names) - len(model.fixed_names)


def _require_range(model: Model, samples: int, rate: float) -> None:
    """Check that squared variances of recordings of up to `samples` samples are within double precision."""
    levels = np.arange(1, samples.bit_length())
    shown = model.wavelet_variance(levels, rate)
    freedom = np.maximum(samples / np.ldexp(1.0, levels), 1.0)
    with np.errstate(over="ignore", under="ignore"):
        small = shown[shown > 0] ** 2 / freedom[shown > 0]
        large = np.ldexp(shown, 2 * levels) ** 2 * samples
    if np.min(small, initial=1.0) < _LEAST or not np.max(large) < _MOST:
        raise ModelError(
            f"the wavelet variance of {model} ranges from {shown.min():g} to {shown.max():g}, and its squares exceed "
            "the range of double precision",
            advice="Write the values in another unit of the signal.",
        )


def samples_of(duration: float, rate: float, free: int, losses: PlannedGaps = NONE) -> int:
    """Return the samples of a duration (s); OptionError unless it has more levels than `free` parameters."""
    duration = as_number(duration, "duration", lambda time: time > 0, "a positive number (s)")
    samples, least = round(duration * rate), losses.shortest(1 << (free + 1))
    if samples < least:
        raise OptionError(
            argument="duration",
            expected=f"at least {least / rate:g} s ({least} samples at {rate:g} Hz) for {counted(free, 'parameter')}",
            got=duration,
            advice="Plan a longer recording, or use a smaller model.",
        )
    if samples > LONGEST_PLAN_SAMPLES:
        raise OptionError(
            argument="duration",
            expected=f"at most {LONGEST_PLAN_SAMPLES / rate:.3g} s (2^40 samples at {rate:g} Hz)",
            got=duration,
        )
    return samples


def as_accuracy(accuracy: float) -> float:
    """Check that a desired relative standard error is above 0 and at most 0.5, and return it."""
    expected = f"a relative standard error above 0 and at most {CERTAIN_ERROR:g} (0.1 for 10 %)"
    return as_number(accuracy, "accuracy", lambda share: 0 < share <= CERTAIN_ERROR, expected)


def error_text(error: float) -> str:
    """Format a relative standard error in per cent.

    >>> error_text(0.0296), error_text(0.123), error_text(0.7), error_text(float("inf"))
    ('3.0 %', '12 %', '> 50 %', 'not determined')
    """
    if math.isinf(error):
        return "not determined"
    shown = float(f"{100 * error:.2g}")
    return f"{f'{shown:#.2g}'.rstrip('.')} %" if error <= CERTAIN_ERROR else f"> {100 * CERTAIN_ERROR:g} %"
