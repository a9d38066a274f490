"""Likelihood by unconstrained coordinates, of equally spaced samples with NaN for missing ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_number, as_rate, as_vector, freeze, require_rate
from gmwm.base.errors import DataError, MissingTheoryError, ModelError
from gmwm.base.text import counted
from gmwm.fitting.likelihood.system import (
    FreeCoordinate,
    Regressor,
    System,
    assemble,
    at_shape,
    is_ramp,
    regressors,
    slopes,
)
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.parameter import Branch


@dataclass(frozen=True, eq=False)
class Record:
    """Samples of one axis from time `start` (s), NaN if missing; `centre` is subtracted before squares, and `columns`
    (p, N) are divided by `scales`."""

    values: Vector
    rate: float
    unit: str = ""
    axis: str = ""
    start: float = 0.0
    centre: float = 0.0
    columns: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    scales: Vector = field(default_factory=lambda: np.zeros(0))
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        freeze(self.values)

    def without(self, coefficients: Sequence[float]) -> Record:
        """Return the recording minus the effect of its columns with the given (unscaled) coefficients."""
        effect = (np.array(coefficients) * self.scales) @ self.columns
        return Record(self.values - effect, self.rate, self.unit, self.axis, start=self.start, centre=self.centre)

    @property
    def observed(self) -> int:
        """Number of observed samples."""
        return int(np.count_nonzero(np.isfinite(self.values)))

    @property
    def times(self) -> Vector:
        """Time of each sample (s)."""
        return np.asarray(self.start + np.arange(self.values.size) / self.rate)

    def signal(self) -> Signal:
        """Return the signal with short gaps filled, or all interpolated if most segments are too short."""
        signal = Signal.from_missing(self.values, self.rate, self.unit, self.axis).fill_gaps()
        usable = sum(b - a for a, b in signal.segments if b - a >= MINIMUM_SAMPLES)
        if 2 * usable >= len(signal):
            return signal
        index = np.flatnonzero(np.isfinite(self.values))
        values = np.interp(np.arange(index[0], index[-1] + 1), index, self.values[index])
        return Signal(values, self.rate, self.unit, self.axis)


def as_record(data: Signal | ArrayLike, rate: float | None) -> Record:
    """Make a recording for the Kalman filter: gaps become missing samples by time stamps (1 if the clock was set back),
    as do NaN and masked values of an array."""
    if isinstance(data, Signal):
        require_rate(rate, data.rate)
        values, step, unit, axis, start = _with_gaps(data), data.rate, data.unit, data.axis, data.start
    elif isinstance(data, Imu):
        raise DataError(
            f"data must be one axis; got a recording of {', '.join(data)}", argument="data",
            advice="Pass one axis, for example `imu['{axis}']`.", axis=data.axes[0],
        )  # fmt: skip
    else:
        samples = np.ma.filled(data.astype(np.float64), np.nan) if isinstance(data, np.ma.MaskedArray) else data
        values, unit, axis, start = as_vector(samples, "data", finite=False).copy(), "", "", 0.0
        step = 1.0 if rate is None else as_rate(rate)
    observed = np.isfinite(values)
    seen = values if bool(np.all(observed)) else values[observed]
    endless = int(np.count_nonzero(np.isinf(values))) if seen.size < values.size else 0
    if endless:
        at = int(np.argmax(np.isinf(values)))
        raise DataError(
            f"{axis or 'data'} must be finite; got {counted(endless, 'infinite value')}, the first at index {at}",
            argument="data",
            advice="Mark missing samples as NaN.",
        )
    if seen.size < MINIMUM_SAMPLES:
        raise DataError(
            f"{axis or 'data'} must have at least {MINIMUM_SAMPLES} samples that are not missing; got {seen.size} of "
            f"{values.size}",
            argument="data",
            got=seen.size,
        )
    centre = float(np.mean(seen))
    if np.min(seen) == np.max(seen):
        raise ModelError(
            "the signal is constant: all its samples are equal",
            advice="Check that the sensor was recording, and that the right column was read.",
        )
    return Record(values=values, rate=step, unit=unit, axis=axis, start=start, centre=centre)


def _with_gaps(signal: Signal) -> Vector:
    """Return the samples of a signal, with NaN for the samples that are missing between its segments."""
    if len(signal.segments) == 1:
        return signal.values.copy()
    places: list[int] = []
    at, end = 0, 0.0
    for (first, last), time in zip(signal.segments, signal.starts, strict=True):
        # A gap has at least one missing sample.
        at = max(round(at + (time - end) * signal.rate), at + 1) if places else 0
        places.append(at)
        at += last - first
        end = time + (last - first) / signal.rate
    # Missing samples (80 MB) that gaps may add; longer recordings may have more, see `_with_gaps`
    # (test_gaps_that_need_too_much_memory_are_refused in tests/likelihood/test_loglikelihood.py).
    if at > 10 * len(signal) + 10_000_000:
        raise DataError(
            f"{signal.axis or 'the signal'} has {at - len(signal)} samples missing in gaps, and only {len(signal)} "
            "observed samples",
            advice="Use the longest part without a gap (`signal.longest()`), or each part alone.",
        )
    values = np.full(at, np.nan)
    for place, segment in zip(places, signal.segment_values(), strict=True):
        values[place : place + segment.size] = segment
    return values


@dataclass(frozen=True, eq=False)
class RegressionEstimate:
    """Labels of the m regression coefficients, with their values (m,) and covariance (m, m)."""

    labels: tuple[str, ...]
    values: Vector
    covariance: Matrix


@dataclass(frozen=True, eq=False)
class LikelihoodPoint:
    """Log-likelihood, its gradient (q,) and information matrix (q, q) with respect to q coordinates."""

    value: float
    gradient: Vector
    information: Matrix
    model: Model


@dataclass(frozen=True, eq=False)
class LikelihoodProblem:
    """Likelihood as a function of coordinates, for a model with starting values, a recording, and its mean if known."""

    model: Model
    record: Record
    mean: float | None = None

    @cached_property
    def rate(self) -> float:
        """Sampling rate (Hz)."""
        return self.record.rate

    @cached_property
    def regressors(self) -> list[Regressor]:
        """The regressors: unknown levels, drifts, and the columns of a regression on conditions."""
        record = self.record
        courses = regressors(self.model, self.rate, record.values.size, self.mean)
        return [
            *courses,
            *(Regressor(c, name, flat=True) for c, name in zip(record.columns, record.names, strict=True)),
        ]

    @cached_property
    def coordinates(self) -> tuple[FreeCoordinate, ...]:
        """The free coordinates: the scale and the shape parameters of each random term, except fixed ones."""
        free: list[FreeCoordinate] = []
        for k, process in enumerate(self.model.processes):
            if is_ramp(process, self.rate):
                continue
            if not process.is_fixed(process.scale_parameter().name):
                free.append(FreeCoordinate(k))
            shapes = process.nonlinear_parameters()
            held = [process.is_fixed(p.name) for p in shapes]
            if any(held) and not all(held):
                raise ModelError(
                    f"some shape parameters of {self.model.terms[k]} are fixed and some are free",
                    advice="Fix all of them, or none.",
                )
            if shapes and not held[0]:
                free.extend(FreeCoordinate(k, i) for i in range(len(shapes)))
        if len(free) > _core.most_slopes:
            raise ModelError(
                f"the model has {len(free)} free parameters, and maximum likelihood allows {_core.most_slopes}",
                advice="Use a smaller model, or fix parameters with `fixed(…)`.",
            )
        return tuple(free)

    @cached_property
    def series(self) -> Matrix:
        """The recording minus its centre (first row) and the m regressors, as an array (1 + m, N)."""
        size = self.record.values.size
        rows = np.empty((1 + len(self.regressors), size))
        np.subtract(self.record.values, self.centre, out=rows[0])
        for process in self.model.processes:
            if is_ramp(process, self.rate) and process.is_fixed(process.scale_parameter().name):
                rows[0] -= process.mean(np.arange(size))
        for row, regressor in zip(rows[1:], self.regressors, strict=True):
            row[:] = regressor.course
        return rows

    @cached_property
    def centre(self) -> float:
        """The constant that is subtracted from the recording: the known mean, or otherwise the mean of the samples."""
        if self.mean is not None:
            return self.mean
        return self.record.centre

    def start(self) -> Vector:
        """Return the coordinates (q,) of the starting values."""
        return self.at(self.model)

    def at(self, model: Model) -> Vector:
        """Return the coordinates (q,) of the parameter values of a model."""
        out = []
        for coordinate in self.coordinates:
            process = model.processes[coordinate.term]
            if coordinate.shape is None:
                out.append(math.log(process.scale) if process.scale > 0 else -math.inf)
            else:
                z = type(process).coordinates(process.nonlinear.reshape(1, -1))
                out.append(float(z[0, coordinate.shape]))
        return np.array(out)

    def at_point(self, z: Vector) -> Model:
        """Return the model with the parameter values at coordinates z (q,); −inf of a scale stands for 0."""
        processes = list(self.model.processes)
        by_term: dict[int, dict[int, float]] = {}
        for coordinate, value in zip(self.coordinates, z.tolist(), strict=True):
            k = coordinate.term
            if coordinate.shape is None:
                name = processes[k].scale_parameter().name
                processes[k] = processes[k].with_values(**{name: processes[k].value_from(math.exp(value))})
            else:
                by_term.setdefault(k, {})[coordinate.shape] = value
        for k, shape in by_term.items():
            processes[k] = at_shape(processes[k], np.array([shape[i] for i in range(len(shape))]))
        return Model(tuple(processes))

    @cached_property
    def bounds(self) -> Matrix:
        """Bounds (q, 2) of the coordinates, beyond which the recording cannot distinguish shapes."""
        # Limit of the absolute value of any other shape coordinate; for a logarithm, this is a factor of 160 000.
        farthest = 12.0
        # Duration over the longest correlation time: a correlation of e^(−1e-3) over the recording changes no variance
        # by more than 0.1 %, less than the standard error of any scale.
        least_decay = 1e-3
        out, samples = [], self.record.values.size
        for coordinate in self.coordinates:
            if coordinate.shape is None:
                out.append((-math.inf, math.inf))
                continue
            parameter = self.model.processes[coordinate.term].nonlinear_parameters()[coordinate.shape]
            if parameter.domain == "positive" and parameter.time_power == -1:
                out.append((math.log(least_decay * self.rate / samples), math.log(40.0 * self.rate)))
            elif parameter.domain == "between":
                far = 0.5 * math.log(2.0 * samples / least_decay)
                out.append((-far, far))
            else:
                out.append((-farthest, farthest))
        return np.array(out).reshape(-1, 2)

    def faint(self, z: Vector, k: int, model: Model, share: float) -> float:
        """Return a scale coordinate at which term k has at most `share` of the variance at every level."""
        levels, at = max(int(math.log2(self.record.observed)), 1), z.copy()
        at[k] = 0.0
        curve = self.at_point(at).processes[self.coordinates[k].term].wavelet_variance(levels, self.rate)
        total = model.wavelet_variance(levels, self.rate)
        return math.log(share * float(np.min(total[curve > 0] / curve[curve > 0])))

    def branch(self, coordinate: FreeCoordinate) -> tuple[Branch, ...]:
        """Return the search branches of the process that a coordinate belongs to."""
        return self.model.processes[coordinate.term].search(self.record.values.size, self.rate)

    def value(self, model: Model) -> tuple[float, RegressionEstimate]:
        """Return the log-likelihood of a model with values, and the estimated regression coefficients."""
        return _likelihood(assemble(model, self.rate), self.series, self.regressors)

    def evaluate(self, z: Vector, active: Sequence[int]) -> LikelihoodPoint | None:
        """Evaluate the `active` coordinates; None if the likelihood is undefined."""
        try:
            model = self.at_point(z)
        except OverflowError:  # a scale can diverge along a profile
            return None
        coordinates = [self.coordinates[k] for k in active]
        try:
            system = assemble(model, self.rate)
            d = slopes(model, system, coordinates, self.rate)
        except MissingTheoryError:  # power-law noise has a state space only for some exponents
            return None
        value, level = _likelihood(system, self.series, self.regressors)
        if not math.isfinite(value):
            return None
        flat = [k for k, r in enumerate(self.regressors) if r.flat]
        residual = self.series[0] - level.values @ self.series[1:] if level.values.size else self.series[0]
        rows = np.ascontiguousarray(np.vstack([residual, *(self.series[1 + k] for k in flat)]))
        good, _, _, _, _, logs, squares, information, cross, turned = _core.kalman_score(
            *system.matrices, d.F, d.Q, d.H, d.R, d.P0, rows
        )
        if not good:
            return None
        q, m = len(coordinates), len(flat)
        gradient = -0.5 * (logs + squares)
        if m:
            inverse = np.linalg.inv(cross.reshape(m, m))
            gradient -= 0.5 * np.einsum("ij,lji->l", inverse, turned.reshape(q, m, m))
        return LikelihoodPoint(value, gradient, information.reshape(q, q), model)


def _likelihood(system: System, series: Matrix, wanted: list[Regressor]) -> tuple[float, RegressionEstimate]:
    """Return the log-likelihood (−inf if the model predicts a sample exactly), and the regression coefficients."""
    good, count, _, logs, cross = _core.kalman_innovations(*system.matrices, series, np.empty(0))
    size = len(series)
    sums, labels = cross.reshape(size, size), tuple(r.label for r in wanted)
    if not good or not np.all(np.isfinite(sums)):
        return -math.inf, RegressionEstimate(labels, np.zeros(size - 1), np.zeros((size - 1, size - 1)))
    beta, covariance, square = np.empty(0), np.empty((0, 0)), float(sums[0, 0])
    value = -0.5 * (count * math.log(2 * math.pi) + logs)
    if size > 1:
        gram = sums[1:, 1:]
        scale = 1.0 / np.sqrt(np.diag(gram))
        covariance = np.asarray(np.linalg.inv(gram * np.outer(scale, scale)) * np.outer(scale, scale))
        beta = covariance @ sums[1:, 0]
        square -= float(beta @ sums[1:, 0])
        flat = [k for k, r in enumerate(wanted) if r.flat]
        if flat:
            value -= 0.5 * float(np.linalg.slogdet(sums[1:, 1:][np.ix_(flat, flat)])[1])
    return value - 0.5 * square, RegressionEstimate(labels, beta, covariance)


def standardise(problem: LikelihoodProblem, model: Model) -> tuple[Vector, int]:
    """Return standardised innovations (N,), NaN for missing samples, and the number of coefficients from all data."""
    system = assemble(model, problem.rate)
    value, level = _likelihood(system, problem.series, problem.regressors)
    if not math.isfinite(value):
        raise nothing_to_chance(model)
    residual = problem.series[0] - level.values @ problem.series[1:] if level.values.size else problem.series[0]
    out = np.empty(residual.size)
    _core.kalman_innovations(*system.matrices, np.ascontiguousarray(residual[None, :]), out)
    return out, len(level.values)


def nothing_to_chance(model: Model) -> ModelError:
    """Create the error for a model that predicts a sample exactly."""
    return ModelError(
        f"{model} predicts some sample exactly from the samples before, so it has no likelihood",
        advice="Add white noise, or another term that is not zero.",
    )


def as_mean(mean: float | None) -> float | None:
    """Check the known mean of a recording, and return it as a float, or None if it is unknown."""
    expected = "a finite number in the unit of the data, or None if it is unknown"
    return None if mean is None else as_number(mean, "mean", lambda _: True, expected)
