"""Estimate the latent processes of a recording with a Kalman filter, a smoother, or a prediction."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, as_whole_number, freeze
from gmwm.base.errors import OptionError
from gmwm.base.results import Plotted
from gmwm.base.text import Named
from gmwm.fitting.estimation import Fit
from gmwm.fitting.likelihood.problem import LikelihoodProblem, Record, as_mean, as_record, nothing_to_chance
from gmwm.fitting.likelihood.result import LikelihoodFit
from gmwm.fitting.likelihood.system import LEVEL, System, assemble
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, as_model
from gmwm.theory.processes.validation import require_values

Kind = Literal["filter", "smooth", "predict"]
Modelled = Fit | LikelihoodFit | Model | Process | str  # A fit, or a model with values

BIAS = "bias"
"""Label of the bias, which is the sum of the level of the recording and of all slow terms, as in navigation filters."""
RATES_ALIKE = 1e-3
"""Relative difference of equal rates (time stamps vary): ≤ 0.1 % of a parameter (tests/likelihood/test_tracks.py)."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tracks(Plotted):
    """Estimated time series of the latent processes of a recording, with standard deviations.

    Attributes
    ----------
    kind : "filter", "smooth" or "predict"
        Kind of estimate: from the samples up to each time, from all samples, or a prediction after the end of the
        recording.
    model : Model
        The model with its values.
    rate : float
        Sampling rate (Hz).
    unit, axis : str
        Unit of the recording and name of the axis.
    times : (N,) array
        Times of the samples (s).
    data : (N,) array
        The recording; NaN for missing and for predicted samples.
    mean, error : mapping of label to (N,) array
        Expected value and standard deviation given the data, in the unit of the recording. The labels are the terms,
        "level" and "bias". "level" is the constant mean, if no random walk includes it. "bias" is the sum of the level
        and of all terms with a correlation time of more than one sample. While the data do not determine a process, its
        error is infinite and its mean is NaN.

    Examples
    --------
    >>> from gmwm import RW, WN
    >>> model = WN(sigma2=1.0) + RW(gamma2=1e-4)
    >>> terms = model.simulate_terms(20_000, rate=100.0, rng=1)
    >>> tracks = model.smooth(terms["WN"] + terms["RW"], rate=100.0)
    >>> tracks.labels, tracks.times[:3], tracks.mean["RW"].shape
    (('WN', 'RW', 'bias'), array([0.  , 0.01, 0.02]), (20000,))
    >>> low, high = tracks.band("RW", level=0.95)
    >>> round(float(np.mean((low < terms["RW"]) & (terms["RW"] < high))), 2)
    0.95
    """

    kind: Kind
    model: Model
    rate: float
    unit: str
    axis: str
    times: Vector
    data: Vector
    mean: Mapping[str, Vector]
    error: Mapping[str, Vector]

    def __post_init__(self) -> None:
        for name in ("mean", "error"):
            object.__setattr__(self, name, Named(getattr(self, name), "track"))
        for array in (self.times, self.data, *self.mean.values(), *self.error.values()):
            freeze(array)

    def __len__(self) -> int:
        return int(self.data.size)

    @property
    def labels(self) -> tuple[str, ...]:
        """Labels of the tracks."""
        return tuple(self.mean)

    def band(self, label: str = BIAS, level: float = 0.95) -> tuple[Vector, Vector]:
        """Return the lower and upper ends (N,) of the interval that contains the process at each sample with a given
        probability.

        Parameters
        ----------
        label : str
            One of `labels`.
        level : float
            Probability, from 0.5 to below 1. The parameters of the model are treated as known.

        Returns
        -------
        low, high : (N,) arrays, in the unit of the recording

        Raises
        ------
        OptionError
            If the label is unknown, or `level` is out of range.
        """
        if label not in self.mean:
            raise OptionError(argument="label", expected=f"one of {', '.join(self.mean)}", got=label)
        reach = NormalDist().inv_cdf((1 + as_confidence(level, "level")) / 2) * self.error[label]
        finite = np.isfinite(reach)
        centre = np.where(finite, self.mean[label], 0.0)
        return centre - reach, centre + reach

    def __repr__(self) -> str:
        return f"Tracks({self.kind}, {', '.join(self.labels)}: {len(self)} samples at {self.rate:g} Hz)"


def filter_tracks(
    model: Modelled, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None
) -> Tracks:
    """Estimate the latent processes at each time from the samples up to this time; see `Model.kalman_filter`."""
    return _tracks("filter", model, data=data, rate=rate, mean=mean)


def smooth_tracks(
    model: Modelled, data: Signal | ArrayLike, rate: float | None = None, *, mean: float | None = None
) -> Tracks:
    """Estimate the latent processes from all samples; see `Model.smooth`."""
    return _tracks("smooth", model, data=data, rate=rate, mean=mean)


def predict_tracks(
    model: Modelled, data: Signal | ArrayLike, steps: int, rate: float | None = None, *, mean: float | None = None
) -> Tracks:
    """Predict the latent processes after the end of a recording; see `Model.predict`."""
    # Largest number of predicted samples. Each takes about 100 bytes, so this number takes 1 GB.
    farthest = 10_000_000
    steps = as_whole_number(steps, "steps", 1)
    if steps > farthest:
        raise OptionError(
            argument="steps", expected=f"at most {farthest}", got=steps,
            advice="Predict at a lower rate with `model.continuous(rate).discrete(lower_rate)`.",
        )  # fmt: skip
    return _tracks("predict", model, data=data, rate=rate, mean=mean, steps=steps)


def _tracks(
    kind: Kind, model: Modelled, data: Signal | ArrayLike, rate: float | None, mean: float | None, steps: int = 0
) -> Tracks:
    problem = pose_filter(model, data, rate=rate, mean=mean, steps=steps)
    system = assemble(problem.model, problem.rate)
    labels, states, shares = _sums(problem, system)
    size = problem.record.values.size
    means, variances = np.empty((len(labels) + 1, size)), np.empty((len(labels) + 1, size))
    if not _core.kalman_tracks(*system.matrices, problem.series, states, shares, kind == "smooth", means, variances):
        raise nothing_to_chance(problem.model)
    errors = np.sqrt(variances, out=variances)
    tracks = {label: (means[k], errors[k]) for k, label in enumerate(labels)}
    white = [block.label for block in system.blocks if block.space.states == 0]
    if white:
        tracks[white[0]] = (means[-1], errors[-1])
    _add_known(problem, system, tracks)
    order = [label for label in (*problem.model.terms, LEVEL, BIAS) if label in tracks]
    part = slice(size - steps, None) if kind == "predict" else slice(None)
    record = problem.record
    return Tracks(
        kind=kind, model=problem.model, rate=record.rate, unit=record.unit, axis=record.axis, times=record.times[part],
        data=record.values[part].copy(), mean={label: tracks[label][0][part] for label in order},
        error={label: tracks[label][1][part] for label in order},
    )  # fmt: skip


def pose_filter(
    model: Modelled, data: Signal | ArrayLike, rate: float | None, mean: float | None, steps: int = 0
) -> LikelihoodProblem:
    """Create the likelihood problem of a model with values and a recording, with `steps` missing samples appended."""
    if isinstance(model, Fit | LikelihoodFit):
        fit_rate = model.wavelet_variance.rate if isinstance(model, Fit) else model.rate
        data_rate = data.rate if isinstance(data, Signal) else rate
        if data_rate is not None and not math.isclose(data_rate, fit_rate, rel_tol=RATES_ALIKE):
            raise OptionError(
                argument="rate", expected=f"{fit_rate:g}, the rate of the fit (Hz), because its values are per sample",
                got=data_rate, advice="Fit the model to data with this rate.",
            )  # fmt: skip
        rate = None if isinstance(data, Signal) else fit_rate
        mean = model.mean if isinstance(model, LikelihoodFit) and mean is None else mean
        model = model.model
    terms = as_model(model)
    require_values(terms, "the Kalman filter", "Write the values into the model, or fit it to data.")
    record = as_record(data, rate)
    if steps:
        record = Record(
            values=np.concatenate([record.values, np.full(steps, np.nan)]), rate=record.rate, unit=record.unit,
            axis=record.axis, start=record.start, centre=record.centre,
        )  # fmt: skip
    return LikelihoodProblem(terms.held, record, as_mean(mean))


def _sums(problem: LikelihoodProblem, system: System) -> tuple[list[str], Matrix, Matrix]:
    """Return the labels of the g tracks, and the weights of states (g, p) and regressors (g, m) in each."""
    regressors = problem.regressors
    labels, states, shares = [], [], []
    bias, carried = np.zeros(system.H.size), np.zeros(len(regressors))
    for block in system.blocks:
        if block.space.states == 0:
            continue
        seen = np.zeros(system.H.size)
        seen[block.first : block.last] = block.space.H[0]
        share = np.array([float(r.label == block.label) for r in regressors])
        labels.append(block.label)
        states.append(seen)
        shares.append(share)
        if wanders(block.process, problem.rate):
            bias += seen
            carried += share
    if any(r.label == LEVEL for r in regressors):
        share = np.array([float(r.label == LEVEL) for r in regressors])
        labels.append(LEVEL)
        states.append(np.zeros(system.H.size))
        shares.append(share)
        carried += share
    labels.append(BIAS)
    return labels, np.array([*states, bias]).reshape(len(labels), -1), np.array([*shares, carried])


def wanders(process: Process, rate: float) -> bool:
    """Return whether a process is part of the bias: slower than one sample, and not a sinusoid."""
    time = process.correlation_time(rate)
    return process.line(rate) is None and (time is None or time * rate > 1.0)


def _add_known(problem: LikelihoodProblem, system: System, found: dict[str, tuple[Vector, Vector]]) -> None:
    """Add what was subtracted from the recording: its centre or known mean, and drifts with known slopes."""
    bias = found[BIAS][0]
    bias += problem.centre
    levelled = [r.label for r in problem.regressors if r.flat]
    if levelled:
        found[levelled[0]][0][:] += problem.centre
    elif problem.centre:
        found[LEVEL] = (np.full(bias.size, problem.centre), np.zeros(bias.size))
    random = {block.label for block in system.blocks}
    for label, process in problem.model.by_term.items():
        if label not in random:
            course = process.mean(np.arange(bias.size))
            found[label] = (np.asarray(course, dtype=np.float64), np.zeros(bias.size))
            bias += course
