"""Compare the error that a filter with the calibrated noise claims with its error on a recording.

The error of a predicted mean of n samples is e = (1/n) Σ_k Ψ_{n−k} ν_k with innovations ν and Ψ_i = 1 + Σ_{j=1}^{i} H
F^{j−1} K, for any model; the filter claims (S/n²) Σ Ψ_i². Bar-Shalom, Li and Kirubarajan (2001), Estimation with
Applications to Tracking and Navigation, section 5.4."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np

from gmwm.applications.monitor.baseline import check_rate
from gmwm.applications.monitor.whitening import Finite, Gain, Whitener
from gmwm.base.arrays import Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.errors import DataError, OptionError
from gmwm.base.lazy import scipy
from gmwm.base.results import register
from gmwm.base.statistics import autocorrelation
from gmwm.base.text import align, duration_text
from gmwm.base.units import noise_unit
from gmwm.calibration.result import Calibration
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S, TRUE_CLAIM, Use, effective_noise
from gmwm.choosing.datasheets.entry import Entry
from gmwm.choosing.datasheets.filter_numbers import filter_numbers, samples_in
from gmwm.fitting.estimation.result import Fit
from gmwm.measuring.axis_results import AxisResults
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Imu, Signal
from gmwm.showing.exporters.one_state import TIMES, biases
from gmwm.showing.exporters.reduction import AxisNoise, Number
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model, as_model
from gmwm.theory.processes.noise import RW, WN

WIDEST_INTERVAL = 2.0
"""Largest ratio of the limits of an interval that decides. A filter that claims half of its error is then detected.
Pinned by tests/monitor/test_consistency.py."""
OF_SAMPLES = (
    "NIS: mean normalised innovation squared of single samples; r₁: autocorrelation of the innovations. They differ\n"
    "from 1 and 0 if the sensor filters or rounds its output, which N and K do not describe. They do not decide ✓ or ✗."
)
MARKS = {"consistent": "✓", "overconfident": "✗", "cautious": "✗", "undecided": "?"}


@dataclass(frozen=True, kw_only=True)
class PredictionError:
    """Error with which a filter predicts the mean of the signal over the next `horizon`.

    Attributes
    ----------
    horizon : float
        Horizon (s).
    claimed, real : float
        Root mean square error that the filter claims, and that it makes, in the unit of the signal.
    low, high : float
        Confidence limits of `claimed / real`, for the number of independent errors. They are 0 and infinite, and
        `real` is NaN, if the recording is too short.
    independent : float
        Number of independent errors: the number of squared errors divided by their correlation in time.
    """

    horizon: float
    claimed: float
    real: float
    low: float
    high: float
    independent: float

    @property
    def ratio(self) -> float:
        """Claimed over real error; NaN if the recording is too short."""
        return self.claimed / self.real

    @property
    def nees(self) -> float:
        """Mean of the normalised squared error, (real / claimed)²; 1 for a consistent filter."""
        return self.ratio**-2

    @property
    def verdict(self) -> str:
        """ "consistent", "overconfident" (claims less than its error), "cautious" (claims more) or "undecided"."""
        least, most = TRUE_CLAIM
        if self.ratio < least and self.high < 1:
            return "overconfident"
        if self.ratio > most and self.low > 1:
            return "cautious"
        decides = least <= self.ratio <= most and self.high <= WIDEST_INTERVAL * self.low
        return "consistent" if decides else "undecided"

    def to_dict(self) -> dict[str, Any]:
        """Return the error as plain values for JSON."""
        return plain_fields(self, "horizon claimed real ratio low high nees independent verdict")


@dataclass(frozen=True, kw_only=True)
class AxisConsistency:
    """Claimed and real errors of the filter of one axis.

    Attributes
    ----------
    axis, unit : str
        Name of the axis, and unit of the signal.
    model : str
        Noise model of the filter with its values, per sample.
    nis : float
        Mean normalised innovation squared ν²/S of single samples; 1 for a consistent filter.
    nis_band : (float, float)
        Limits of `nis` for a consistent filter from the χ² distribution, for the number of independent innovations.
    correlation : float
        Autocorrelation of the innovations at the lag of one sample; 0 for a consistent filter.
    errors : tuple of PredictionError
        The errors at the horizons of the verdict.
    curve : tuple of PredictionError
        The errors at horizons of 1, 2, 4, … samples, for the plot.
    limits : tuple of str
        Numbers of the filter that are upper limits, such as "K". A filter with a limit is cautious.
    """

    axis: str
    unit: str
    model: str
    nis: float
    nis_band: tuple[float, float]
    correlation: float
    errors: tuple[PredictionError, ...]
    curve: tuple[PredictionError, ...]
    limits: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """ "overconfident" if the filter is at any horizon, else "cautious", "undecided" or "consistent"."""
        verdicts = {error.verdict for error in self.errors}
        return next(verdict for verdict in ("overconfident", "cautious", "undecided", "consistent")
                    if verdict in verdicts)  # fmt: skip

    @property
    def inflation(self) -> float:
        """Factor on N and K, or on all standard deviations of the model, with which the filter is nowhere
        overconfident; at least 1."""
        return max([1.0, *(1 / error.ratio for error in self.errors if error.verdict == "overconfident")])

    def reason(self) -> str:
        """Describe the verdict in one sentence."""
        verdict = self.verdict
        errors = [error for error in self.errors if error.verdict == verdict]
        at = ", ".join(duration_text(error.horizon) for error in errors)
        if verdict == "undecided":
            return f"{self.axis} is undecided at {at}: the recording is too short, so record longer."
        if verdict == "consistent":
            return f"{self.axis} is consistent: the filter claims the error that it makes."
        worst = max(errors, key=lambda error: abs(math.log(error.ratio)))
        claim = f"over {duration_text(worst.horizon)}, it claims {worst.ratio:.2f} ({worst.low:.2f} … {worst.high:.2f})"
        if verdict == "cautious":
            cause = f"{' and '.join(self.limits)} is an upper limit." if self.limits else "A smaller N or K is enough."
            return f"{self.axis} is cautious at {at}: {claim} times its error. {cause}"
        return (
            f"{self.axis} is overconfident at {at}: {claim} of its error. An inflation of "
            f"{math.ceil(100 * self.inflation) / 100:g} is enough."
        )

    def to_dict(self) -> dict[str, Any]:
        """Return the errors as plain values for JSON."""
        facts = plain_fields(self, "unit model limits nis nis_band correlation verdict inflation errors curve")
        return {**facts, "reason": self.reason()}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Consistency(AxisResults[AxisConsistency]):
    """Claimed and real errors of filters: a mapping of axis to `AxisConsistency`.

    Attributes
    ----------
    axes : mapping of axis to AxisConsistency
        Errors and verdict of each axis.
    filter : str
        The form of the filter: "N, K", "N, sigma, T" or "model".
    duration, rate : float
        Length (s) and sampling rate (Hz) of the recording.
    level : float
        Confidence level of intervals and bands.
    """

    axes: Mapping[str, AxisConsistency]
    filter: str
    duration: float
    rate: float
    level: float

    def summary(self) -> str:
        """Return one line for each axis, and the reason of each axis whose filter is not consistent."""
        share, kind = f"{100 * self.level:g} %", "the whole model" if self.filter == "model" else self.filter
        results = list(self.values())
        count, over = (
            sum(result.verdict == verdict for result in results) for verdict in ("consistent", "overconfident")
        )
        rows = [["", "", *(duration_text(error.horizon) for error in results[0].errors), "NIS", "its band", "r₁"]]
        for axis, result in self.items():
            low, high = result.nis_band
            cells = [axis, MARKS[result.verdict], *map(_ratio, result.errors), f"{result.nis:.3f}"]
            rows.append([*cells, f"{low:.3f} … {high:.3f}", f"{result.correlation:+.2f}"])
        lines = [
            f"Filters with {kind}: consistent on {count} of {len(self)} axes, overconfident on {over}, in "
            f"{duration_text(self.duration)}.",
            f"Claimed over real error of the mean over the next T ({share} interval); ✓ is 0.8 to 1.3:",
            *align(rows, right=range(2, len(rows[0]))),
            *(result.reason() for result in results if result.verdict != "consistent"),
        ]
        if any(not result.nis_band[0] <= result.nis <= result.nis_band[1] for result in results):
            lines.append(OF_SAMPLES)
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return the results as plain values for JSON."""
        return {**plain_fields(self, "filter duration rate level"), "axes": plain(dict(self.axes))}


def _ratio(error: PredictionError) -> str:
    if math.isnan(error.ratio):
        return "too short"
    return f"{error.ratio:.2f} {MARKS[error.verdict]} ({error.low:.2f} … {error.high:.2f})"


register(Consistency, "gmwm.applications.monitor.plot:plot_consistency")


FilterName = Literal["N, K", "N, sigma, T", "model"]


def consistency(
    calibration: Mapping[str, Any], recording: Imu | Mapping[str, Signal], *, filter: FilterName = "N, K",
    horizons: Sequence[float] = TIMES, level: float = 0.95,
) -> Consistency:  # fmt: skip
    """Run the filter that an exported file describes on a recording at rest: does it claim the error that it makes?

    The filter of each axis predicts the mean of the signal over the next T seconds, for each horizon T. The result has
    the error that it claims (from its covariance), the error that it makes, and their ratio with a confidence interval;
    and the normalised innovation squared (NIS) of single samples. The errors of two times are correlated. The intervals
    therefore use the number of independent errors, n / (1 + 2 Σ ρ_k) with the autocorrelation ρ of the squared errors,
    and the χ² distribution. The level of the signal is unknown to the filter, so that a constant bias is no error.

    Use a recording from which the calibration was not computed. Motion, knocks and changes of temperature are errors of
    the filter, too.

    Parameters
    ----------
    calibration : Calibration, or mapping of axis to Fit or Model
        The noise of each axis. Axes that the recording lacks are left out. Values of a Model are per sample of the
        recording.
    recording : Imu, or mapping of axis to Signal
        A recording at rest. Short gaps are filled (`Signal.fill_gaps`); the filter starts again after others.
    filter : "N, K", "N, sigma, T" or "model"
        White noise N and a random walk K; white noise N and a Gauss-Markov bias of standard deviation sigma and
        correlation time T; or the state space of the whole model.
    horizons : sequence of float
        Horizons T (s) of the verdict.
    level : float
        Confidence level of intervals and bands.

    Raises
    ------
    OptionError
        If an option is out of range, no axis is in both, or the rates differ.
    DataError
        If the units differ, or the data do not determine a number of the filter.
    ModelError
        If a model has no state space.

    Examples
    --------
    >>> import gmwm
    >>> truth = {"gyro_x": "WN(sigma2=1e-6) + RW(gamma2=1e-12)"}
    >>> first, second = (gmwm.simulate(truth, rate=10.0, samples=36_000, rng=seed) for seed in (1, 2))
    >>> result = consistency({"gyro_x": gmwm.fit("WN + RW", first["gyro_x"])}, second)
    >>> result["gyro_x"].verdict
    'consistent'

    References
    ----------
    Bar-Shalom, Li and Kirubarajan (2001), Estimation with Applications to Tracking and Navigation, section 5.4.
    """
    if filter not in get_args(FilterName):
        raise OptionError(argument="filter", expected=f"one of {', '.join(get_args(FilterName))}", got=filter)
    times = sorted(set(horizons))
    if not times or not all(0 < time < math.inf for time in times):
        raise OptionError(argument="horizons", expected="positive times (s)", got=list(horizons))
    level = as_confidence(level, "level")
    both = [axis for axis in calibration if axis in recording]
    if not both:
        names = ", ".join(calibration), ", ".join(recording)
        raise OptionError(
            f"the calibration ({names[0]}) and the recording ({names[1]}) have no axis in common",
            argument="recording", got=names[1],
        )  # fmt: skip
    axes = {}
    for axis in both:
        signal = recording[axis].fill_gaps()
        try:
            model, limits = filter_model(calibration, axis, signal, filter)
            errors = _Innovations.of(model, signal, samples_in(times[-1], signal.rate))
        except (DataError, OptionError) as error:
            raise error.at(axis) from error
        measured = _axis_consistency(axis, signal, model, errors=errors, times=times, level=level)
        axes[axis] = replace(measured, limits=limits)
    first = recording[both[0]]
    return Consistency(axes=axes, filter=filter, duration=first.duration, rate=first.rate, level=level)


def filter_model(
    calibration: Mapping[str, Any], axis: str, signal: Signal, filter: FilterName
) -> tuple[Model, tuple[str, ...]]:
    """Return the noise model of a filter of an axis, per sample of the signal, and which of its numbers are limits."""
    item = calibration[axis]
    if not isinstance(item, Fit):
        model = as_model(item)
        if filter == "N, sigma, T":
            raise OptionError(argument="filter", expected="'N, K' or 'model', because a Model has no fit", got=filter)
        if filter == "model":
            return model, ()
        numbers = filter_numbers(model.processes, signal.rate)
        return _two_numbers(numbers.N, numbers.K, signal.rate), ()
    unit = item.wavelet_variance.unit
    if unit and signal.unit and unit != signal.unit:
        raise DataError(
            f"the calibration of {axis} is in {unit}, and the recording in {signal.unit}", argument="recording"
        )
    check_rate(signal.rate, item.wavelet_variance.rate)
    if filter == "model":
        return item.model, ()
    entries: Mapping[str, Entry] = {}
    if isinstance(calibration, Calibration):
        entries = calibration.datasheets[axis]
    if not {"N", "K"} <= set(entries):
        entries = effective_noise(item)
    white, walk = (_value(entries[symbol], unit, power) for symbol, power in (("N", 0.5), ("K", -0.5)))
    limits = tuple(symbol for symbol, number in (("N", white), ("K", walk)) if number.upper)
    if filter == "N, K":
        return _two_numbers(white.value, walk.value, signal.rate), limits
    noise = AxisNoise(axis, item, N=white, K=walk, B=Number(0.0, False), use=Use())
    bias = biases([noise], DEFAULT_HORIZON_S)[axis]
    state = GM(beta=1 / bias.time, sigma2=bias.sigma.value**2)
    return Model((WN(sigma2=white.value**2 * signal.rate), state)), limits


def _value(entry: Entry, unit: str, power: float) -> Number:
    """Return a number as a filter uses it, in the unit of the signal: its value, or the limit if it is one."""
    value = entry.high if entry.upper_only and entry.high is not None else entry.value
    if not math.isfinite(value):
        raise DataError(
            f"the data do not determine an upper limit of {entry.symbol}", argument="calibration",
            advice="Record longer.",
        )  # fmt: skip
    return Number(value / noise_unit(power, unit)[1], entry.upper_only)


def _two_numbers(white: float, walk: float, rate: float) -> Model:
    return Model((WN(sigma2=white**2 * rate), RW(gamma2=walk**2 / rate)))


@dataclass(frozen=True, eq=False)
class _Innovations:
    """Standardised innovations of a signal (one array for each part without a gap), and how a filter predicts."""

    parts: tuple[Vector, ...]
    response: Vector  # (n,) Ψ_0, Ψ_1, …
    S: float  # variance of an innovation
    settled: float  # samples after which the gain is constant

    @classmethod
    def of(cls, model: Model, signal: Signal, longest: int) -> _Innovations:
        """Compute innovations, and the response over `longest` samples; the filter starts again after each gap."""
        gain = Gain.of(Finite.of(model, signal.rate))
        whitener, parts = Whitener(gain), []
        for values in signal.segment_values():
            whitener.restart()
            parts.append(whitener.update(values))
        moving = gain.finite.moving
        slowest = np.max(np.abs(np.linalg.eigvals(gain.phi[np.ix_(moving, moving)])), initial=0.0)
        # After three time constants, the gain is constant within 5 %. That of a constant level falls for ever.
        settled = 3.0 / max(1.0 - float(slowest), 1e-15) if np.all(moving) else math.inf
        state = (gain.F - gain.phi) @ gain.H / (gain.H @ gain.H)  # the gain K, because F − Φ = K H
        steps = np.ones(longest)
        for k in range(1, longest):
            steps[k] = gain.H @ state
            state = gain.F @ state
        return cls(tuple(parts), np.cumsum(steps), gain.S, settled)

    @property
    def correlation(self) -> float:
        """Autocorrelation of the innovations at the lag of one sample."""
        return sum(float(z[1:] @ z[:-1]) for z in self.parts) / sum(float(z @ z) for z in self.parts)

    def errors(self, samples: int) -> tuple[float, Vector]:
        """Return the claimed RMS error of the mean of n samples, and the errors over it. They start at each quarter of
        n: this has 1.4 times the information of errors that do not overlap."""
        weights = self.response[samples - 1 :: -1]
        size = float(np.linalg.norm(weights))
        collected = []
        for part in self.parts:
            # While the gain falls as 1/t, the error differs by less than 5 % from that of a constant gain after three
            # horizons (tests/monitor/test_consistency.py).
            start = round(min(3.0 * samples, self.settled))
            count = (part.size - start) // samples - 1
            if count < 1:
                continue
            shifts = [part[start + k * samples // 4 :][: count * samples] for k in range(min(4, samples))]
            collected.append(np.column_stack([x.reshape(-1, samples) @ weights for x in shifts]).ravel() / size)
        return math.sqrt(self.S) * size / samples, np.concatenate([np.zeros(0), *collected])


def independent_squares(errors: Vector) -> float:
    """Return the number of independent squared errors, by r² for Gaussian errors with autocorrelation r, or by the
    measured variance if larger (heavy tails or bursts; Newey and West 1994)."""
    first = errors[: 1 << 17]  # the correlation of more errors is the same, and takes longer
    n = first.size
    lags = min(n // 4, 400)
    gaussian = 1 + 2 * float(np.sum(np.maximum(autocorrelation(first, lags)[1:] ** 2 - 1 / n, 0.0)))
    squares = first**2
    lags = min(lags, max(8, round(16 * (n / 100) ** (2 / 9))))
    weights = 1 - np.arange(1, lags + 1) / (lags + 1)
    relative = float(np.var(squares) / np.mean(squares) ** 2 / 2)
    measured = relative * max(1 + 2 * float(weights @ autocorrelation(squares, lags)[1:]), 0.0)
    return errors.size / max(gaussian, measured)


def _prediction(innovations: _Innovations, samples: int, rate: float, level: float) -> PredictionError:
    claimed, errors = innovations.errors(samples)
    # Five horizons, without overlap, are the fewest from which an error is estimated.
    if errors.size < 5 * min(4, samples):
        return PredictionError(
            horizon=samples / rate, claimed=claimed, real=math.nan, low=0.0, high=math.inf, independent=0.0
        )
    square, count = float(np.mean(errors**2)), independent_squares(errors)
    low, high = (math.sqrt(scipy.stats.chi2.ppf(p, count) / count / square) for p in ((1 - level) / 2, (1 + level) / 2))
    return PredictionError(
        horizon=samples / rate, claimed=claimed, real=claimed * math.sqrt(square), low=low, high=high,
        independent=count,
    )  # fmt: skip


def _axis_consistency(
    axis: str, signal: Signal, model: Model, *, errors: _Innovations, times: Sequence[float], level: float
) -> AxisConsistency:
    counts = [samples_in(time, signal.rate) for time in times]
    octaves = [2**k for k in range(1 + int(math.log2(max(counts))))]
    by_samples = {n: _prediction(errors, n, signal.rate, level) for n in {*counts, *octaves}}
    if math.isnan(by_samples[1].real):
        raise DataError("the recording has fewer than 5 samples after the filter has settled", argument="recording")
    single = by_samples[1]
    band = tuple(
        float(scipy.stats.chi2.ppf(p, single.independent)) / single.independent
        for p in ((1 - level) / 2, (1 + level) / 2)
    )
    return AxisConsistency(
        axis=axis, unit=signal.unit, model=str(model), nis=single.nees, nis_band=(band[0], band[1]),
        correlation=errors.correlation,
        errors=tuple(by_samples[n] for n in dict.fromkeys(counts)),
        curve=tuple(by_samples[n] for n in sorted(by_samples) if not math.isnan(by_samples[n].real)),
    )  # fmt: skip
