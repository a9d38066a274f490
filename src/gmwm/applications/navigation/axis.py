"""The noise of one axis for an error budget: its processes, and the covariance of their estimated parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gmwm.applications.navigation.response import Response, mean_squares
from gmwm.base.arrays import Matrix, as_rate
from gmwm.base.axis_names import AXES
from gmwm.base.errors import GmwmError, MissingTheoryError, ModelError, OptionError
from gmwm.base.remarks import Quantity, Remark
from gmwm.base.units import SI_UNIT
from gmwm.choosing.datasheets.curve import FitCurve
from gmwm.choosing.datasheets.measured_limit import variance_limit
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.ladder import approximation_remarks
from gmwm.theory.processes.model import Model, as_model


@dataclass(frozen=True, eq=False)
class BudgetAxis:
    """The noise of one axis."""

    axis: str
    terms: Mapping[str, Process]  # the terms of the model that are not zero
    rate: float  # Hz
    # the estimated parameters and their covariance; None if the values were given, or have no standard errors
    curve: FitCurve | None = None
    wavelet_variance: WaveletVariance | None = None  # that of the recording; None if the values were given
    longest: float = np.inf  # longest averaging time (s) of the recording; infinite if the values were given

    @classmethod
    def of(cls, axis: str, source: Fit | Model | Process | str, rate: float | None) -> BudgetAxis:
        """Return the noise of an axis from a fit, or from a model with all values and its sampling rate (Hz)."""
        if axis not in AXES:
            raise OptionError(argument="axis", expected=f"one of {', '.join(AXES)}", got=axis)
        if isinstance(source, Fit):
            wv = source.wavelet_variance
            si = SI_UNIT["gyro" if axis.startswith("gyro") else "accel"]
            if wv.unit != si:
                raise ModelError(
                    f"{axis} is in {wv.unit or 'an unknown unit'} instead of {si}",
                    advice="Read the recording again with {--units}.",
                )
            try:
                curve = FitCurve.of(source)
            except GmwmError:
                curve = None
            terms = dict(zip(source.model.terms, source.model.processes, strict=True))
            return cls(
                axis, _present(axis, terms, wv.rate), wv.rate, curve, wavelet_variance=wv, longest=float(wv.tau[-1]) / 2
            )
        model = as_model(source)
        missing = [name for name, value in model.parameters.items() if value is None]
        if missing:
            raise ModelError(
                f"the error budget of {model} needs a value for {', '.join(missing)}",
                advice="Write the values into the model, or calibrate a recording.",
            )
        if rate is None:
            raise OptionError(argument="rate", expected="the sampling rate (Hz), because a model has none", got=rate)
        rate = as_rate(rate)
        return cls(axis, _present(axis, dict(zip(model.terms, model.processes, strict=True)), rate), rate)

    def remarks(self, duration: float) -> tuple[Remark, ...]:
        """Return remarks if the duration (s) exceeds the recording, or if the state space of a term is approximate."""
        model = Model(tuple(self.terms.values())) if self.terms else None
        remarks = () if model is None else approximation_remarks(model, self.rate, self.axis)
        if duration <= self.longest:
            return remarks
        facts = {"duration": Quantity(duration, "s"), "longest": Quantity(self.longest, "s")}
        return (Remark.of("budget-extrapolated", self.axis, **facts), *remarks)

    def mean_squares(self, motion: Response, times: Sequence[float], rest: float) -> dict[str, Matrix]:
        """Return the mean square (T, q) of the errors that each term causes at T times (s) after a rest (s)."""
        return {label: self._of(process, motion, times, rest) for label, process in self.terms.items()}

    def errors(self, motion: Response, times: Sequence[float], rest: float, terms: Mapping[str, Matrix]) -> Matrix:
        """Return the standard errors (T, q) of the sum of the mean squares `terms`; zero if the values were given."""
        if self.curve is None or not self.curve.moving:
            return np.zeros((len(times), motion.drive.size))
        squares = {id(process): terms[label] for label, process in self.terms.items()}

        def slope(process: Process, name: str | None) -> Matrix:
            """Return the derivative (T, q) of the mean squares by the logarithm of a parameter, or by a zero scale."""
            if name is None:
                return self._of(process, motion, times, rest)
            parameter = next(p for p in process.parameters if p.name == name)
            if parameter.scale_power is not None:
                return parameter.scale_power * squares[id(process)]
            value = process.value(name)
            # Relative error of the derivatives: about 1e-6.
            moved = [process.with_values(**{name: value * (1 + side * 1e-3)}) for side in (1, -1)]
            upper, lower = (self._of(variant, motion, times, rest) for variant in moved)
            return (upper - lower) / (2 * 1e-3)

        slopes = np.array([slope(process, name) for process, name in self.curve.moving])
        variance = np.einsum("iab,ij,jab->ab", slopes, self.curve.scatter, slopes)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)), dtype=np.float64)

    def limits(self, motion: Response, times: Sequence[float], rest: float) -> Matrix:
        """Return the largest mean squares (T, q) that the measured wavelet variance allows; infinite without one."""
        if self.wavelet_variance is None:
            return np.full((len(times), motion.drive.size), np.inf)
        processes = [p for p in self.terms.values() if p.oscillation() is None]
        return variance_limit(self.wavelet_variance, processes, lambda p: self._of(p, motion, times, rest))

    def _of(self, process: Process, motion: Response, times: Sequence[float], rest: float) -> Matrix:
        steps = [max(1, round(time * self.rate)) for time in times]
        return mean_squares(process, self.rate, motion, steps, rest=round(rest * self.rate))


def _present(axis: str, terms: Mapping[str, Process], rate: float) -> dict[str, Process]:
    """Return the terms that are not zero. Raises a MissingTheoryError if one of them has no state-space form."""
    present = {label: process for label, process in terms.items() if process.scale > 0}
    try:
        for process in present.values():
            process.state_space(rate)
    except MissingTheoryError as error:
        raise error.at(axis) from error
    return present
