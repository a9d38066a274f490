"""Test whether recordings have the same noise, and the result of this test."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import as_rate, as_vector
from gmwm.base.documents import plain_fields
from gmwm.base.errors import DataError, OptionError
from gmwm.base.lazy import polars
from gmwm.base.remarks import Dialect, Quantity, Remark, texts
from gmwm.base.results import Difference, Tabular
from gmwm.base.statistics import holm
from gmwm.base.text import duration_text, p_text, table_with_rule
from gmwm.choosing.replicates.comparison import (
    LevelRatio,
    RecordingComparison,
    decide,
    level_ratios,
    numerators,
    smallest,
)
from gmwm.fitting.estimation.estimator import fit
from gmwm.fitting.estimation.intervals import parameters_by_name
from gmwm.fitting.estimation.recordings import LONGEST_STEP, Deviations, deviations
from gmwm.measuring.covariance.tails import excess_covariance, with_common_tails
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.pooling import SAME_RATE_DIFFERENCE, pool
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import as_confidence, as_size
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import ModelLike
from gmwm.theory.processes.parameter import Parameter


@dataclass(frozen=True, kw_only=True)
class ParameterRatio:
    """A parameter of one recording over the parameter of the other, or over the mean of the others.

    Attributes
    ----------
    recording : str
        The recording in the numerator.
    name : str
        The parameter, such as "WN.sigma2".
    ratio, lower, upper : float
        The ratio, and its confidence limits.
    """

    recording: str
    name: str
    ratio: float
    lower: float
    upper: float

    @property
    def excludes_one(self) -> bool:
        """Whether 1 is outside the interval. The test of all parameters decides; it may disagree with an interval."""
        return not self.lower <= 1 <= self.upper


@dataclass(frozen=True, kw_only=True)
class SameParameters:
    """The test whether recordings of one axis have the same parameters.

    Attributes
    ----------
    axis : str
    model : str
        The model with the parameters of all recordings together.
    statistic : float
        Decrease of the weighted residuals if each recording has parameters of its own.
    df : int
    pvalue : float
        p-value, adjusted for the number of axes.
    differs : bool
        Whether the test finds a difference.
    fit_pvalue : float
        p-value of the goodness-of-fit test of the model for all recordings together. If it is small, the test of the
        parameters is not valid.
    ratios : tuple of ParameterRatio
        The parameters that the recordings determine, if any: for two recordings, the first over the second; for more,
        each over the mean of the others.
    """

    axis: str
    model: str
    statistic: float
    df: int
    pvalue: float
    differs: bool
    fit_pvalue: float
    ratios: tuple[ParameterRatio, ...]

    @property
    def largest(self) -> ParameterRatio:
        """Ratio that differs most from 1, in standard errors."""
        return max(self.ratios, key=lambda ratio: abs(math.log(ratio.ratio)) / math.log(ratio.upper / ratio.lower))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SameNoise(RecordingComparison, Tabular):
    """Result of the test whether recordings have the same noise, by axis and scale.

    Attributes
    ----------
    recordings : tuple of str
        Names of the recordings.
    axes : tuple of str
        Names of the compared axes.
    levels : tuple of LevelRatio
        Ratios at all levels of all axes. With two recordings, the first one is divided by the second. With more, each
        is divided by the mean of the others.
    parameters : tuple of SameParameters
        For each axis, the test that the parameters of the model are equal; empty without a model.
    left_out : tuple of str
        Axes that are not compared, because not all recordings have them.
    tolerance : float
        Largest |ln(ν_1/ν_2)| that is treated as equal.
    size, confidence : float
        Significance level of all tests together, and confidence level of the intervals.
    """

    recordings: tuple[str, ...]
    axes: tuple[str, ...]
    levels: tuple[LevelRatio, ...]
    parameters: tuple[SameParameters, ...] = ()
    left_out: tuple[str, ...] = ()
    tolerance: float
    size: float
    confidence: float

    def __getitem__(self, axis: str) -> tuple[LevelRatio, ...]:
        """Return the ratios at all levels of one axis."""
        return tuple(row for row in self.levels if row.axis == axis)

    @property
    def differences(self) -> tuple[LevelRatio, ...]:
        """The ratios at which the test finds a difference, sorted by p-value."""
        return tuple(sorted((row for row in self.levels if row.differs), key=lambda row: row.pvalue or 0.0))

    @property
    def pvalue(self) -> float:
        """Smallest adjusted p-value, of the levels of all axes or, with a model, of its parameters."""
        return smallest(self.parameters or self.levels)

    def largest(self, axis: str, recording: str = "") -> LevelRatio:
        """Return the ratio with the most significant difference for an axis, of one recording or of all."""
        rows = [row for row in self[axis] if recording in ("", row.recording)]
        return min(rows, key=lambda row: (row.pvalue if row.pvalue is not None else 1.0, -abs(row.ratio - 1)))

    @property
    def tests(self) -> tuple[Difference, ...]:
        """The ratios of all levels or, with a model, of its parameters."""
        if not self.parameters:
            return tuple(row.difference for row in self.levels)
        return tuple(
            Difference(name=f"{test.axis} {part.name}, {part.recording}", ratio=part.ratio, lower=part.lower,
                       upper=part.upper, pvalue=test.pvalue, differs=test.differs and part.excludes_one)
            for test in self.parameters for part in test.ratios
        )  # fmt: skip

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the differences of each axis and recording, or one remark that no difference was found."""
        missing = [Remark.of("not-compared", axis, case="axis") for axis in self.left_out]
        return (*(self._parameter_remarks() if self.parameters else self._level_remarks()), *missing)

    def _level_remarks(self) -> tuple[Remark, ...]:
        if not self.differs:
            tests = sum(row.pvalue is not None for row in self.levels)
            within = "yes" if self.tolerance else "no"
            return (
                Remark.of(
                    "recordings-agree",
                    case="noise",
                    tests=tests,
                    size=self.size,
                    tolerance=self.tolerance,
                    within=within,
                ),
            )
        remarks = []
        for recording in self.compared:
            for axis in self.axes:
                rows = [row for row in self[axis] if row.differs and row.recording == recording]
                if rows:
                    most = max(rows, key=lambda row: abs(row.ratio - 1))
                    remarks.append(Remark.of(
                        "recordings-differ", axis, case="noise",
                        percent=abs(most.ratio - 1), tau=Quantity(most.tau, "s"),
                        more="higher" if most.ratio > 1 else "lower", levels=len(rows),
                        p=smallest(rows), recording=recording, other=self._other,
                    ))  # fmt: skip
        return tuple(remarks)

    def _parameter_remarks(self) -> Iterator[Remark]:
        """Whether the parameters differ, by axis, and which models are rejected."""
        for test in self.parameters:
            if test.differs and test.ratios:
                most = test.largest
                yield Remark.of(
                    "recordings-differ", test.axis, case="parameters",
                    name=most.name, recording=most.recording, other=self._other,
                    ratio=most.ratio, lower=most.lower, upper=most.upper, confidence=self.confidence,
                    p=test.pvalue, alone="yes" if most.excludes_one else "no",
                )  # fmt: skip
        adjusted = holm([test.fit_pvalue for test in self.parameters]).tolist()
        pairs = zip(self.parameters, adjusted, strict=True)
        rejected = {test.axis: test.fit_pvalue for test, p in pairs if p <= self.size}
        for test in self.parameters:
            if test.axis in rejected:
                yield Remark.of("model-rejected", test.axis, case="same", p=min(rejected.values()))
            elif not test.differs:
                yield Remark.of("recordings-agree", test.axis, case="parameters", size=self.size)

    @property
    def _other(self) -> str:
        return f"recording {self.recordings[1]}" if len(self.recordings) == 2 else "the others"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return plain_fields(
            self, "recordings axes left_out tolerance size confidence pvalue differs levels parameters remarks"
        )

    def to_polars(self) -> polars.DataFrame:
        """Return the ratios as a Polars data frame with one row for each axis, compared recording and level."""
        return polars.DataFrame([asdict(row) for row in self.levels], infer_schema_length=None)

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Format the most significant ratio, or the parameters, of each axis, and the remarks in a `dialect`."""
        two, level = len(self.recordings) == 2, f"{100 * self.confidence:g} %"
        ratio = " over ".join(self.recordings) if two else "each recording over the mean of the others"
        if self.parameters:
            head = f"Ratio of the parameters, {ratio}; p of the test of all parameters of an axis, which decides"
            rows = [["axis", "recording", "parameter", "ratio", level, "p"]]
            for test in self.parameters:
                for part in test.ratios:
                    size = _cells(part.ratio, part.lower, part.upper)
                    rows.append([test.axis, part.recording, part.name, *size, _p_cell(test.pvalue)])
        else:
            head = f"Ratio of the deviations, {ratio}, at the scale of the most significant difference"
            rows = [["axis", "recording", "ratio", level, "at τ", "p"]]
            for axis in self.axes:
                for recording in self.compared:
                    row = self.largest(axis, recording)
                    size = _cells(row.ratio, row.lower, row.upper)
                    rows.append([axis, recording, *size, duration_text(row.tau), _p_cell(row.pvalue)])
        if two:
            rows = [[axis, *cells] for axis, _, *cells in rows]
        table = [head, "", *table_with_rule(rows), ""] if len(rows) > 1 else []
        return "\n".join([*table, *texts(self.remarks, dialect)])


def _cells(ratio: float, lower: float | None, upper: float | None) -> list[str]:
    return [f"{ratio:.3f}", "no test" if lower is None else f"{lower:.3f} … {upper:.3f}"]


def _p_cell(p: float | None) -> str:
    return "" if p is None else p_text(p)


def same(
    *recordings: Imu | Signal | ArrayLike, rate: float | None = None, labels: Sequence[str] | None = None,
    model: ModelLike | None = None, tolerance: float = 0.0, size: float = 0.05, confidence: float = 0.95,
) -> SameNoise:  # fmt: skip
    """Test whether recordings have the same noise at each scale, or the same parameters of a model.

    The wavelet variances ν² of two recordings are compared at each level j. With more than two recordings, each one is
    compared with the mean of the others. If the noise is the same, the ratio of the variances has approximately an F
    distribution with η_1j and η_2j degrees of freedom, η_j = 2 ν_j⁴ / V_jj. V is the covariance of the estimated
    wavelet variances. It is computed for the mixture of processes with the highest likelihood given the mean of all
    wavelet variances. The additional covariance from heavy tails or from a variance that changes with time is added.
    The p-values of all levels, axes and recordings are adjusted by Holm's method.

    With a model, its parameters are compared instead. The model is fitted to all recordings together, and the test
    statistic is the decrease of the weighted residuals if each recording has parameters of its own. This test has more
    power, and is valid if the model is correct.

    With millions of samples, the test finds differences of 0.1 %. Set `tolerance` to test only for larger differences.

    Parameters
    ----------
    *recordings : Imu, Signal, or (N,) array
        Two or more recordings with the same sampling rate and any lengths, made at different times. For Imu recordings,
        the axes that all recordings have are compared.
    rate : float
        Sampling rate (Hz); only for plain arrays.
    labels : sequence of str, optional
        Names of the recordings; "1", "2", … by default.
    model : Model, Process or str, optional
        A model whose parameters are compared, such as "WN + RW"; see `SameNoise.parameters`.
    tolerance : float
        Largest |ln(ν_1/ν_2)| that is treated as equal, at least 0. With 0.1, the test finds only wavelet deviations
        that differ by more than about 10 %.
    size : float
        Significance level of all tests together.
    confidence : float
        Confidence level of the intervals of the ratios.

    Raises
    ------
    DataError
        If there are fewer than two recordings, or if they differ in rate or unit or have no axis in common.
    ModelError
        If the model cannot be read, or cannot be fitted to the recordings.
    OptionError
        If an option has a value that is not allowed, or both a model and a tolerance are given.

    References
    ----------
    Holm (1979), A simple sequentially rejective multiple test procedure, Scandinavian Journal of Statistics 6, 65-70.
    The measured rates of false alarms are in docs/validation/same.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> monday, tuesday, later = rng.normal(size=(3, 20_000)) * [[1.0], [1.0], [1.1]]
    >>> same(monday, tuesday, rate=100.0).differs, same(monday, later, rate=100.0).differs
    (False, True)
    >>> same(monday, later, rate=100.0, tolerance=0.2).differs
    False
    >>> same(monday, tuesday, later, rate=100.0, labels=["monday", "tuesday", "later"]).differences[0].recording
    'later'
    >>> found = same(monday, later, rate=100.0, model="WN")
    >>> round(found.parameters[0].ratios[0].ratio, 2)
    0.82
    """
    size = as_size(size)
    as_confidence(confidence)
    if not isinstance(tolerance, int | float) or isinstance(tolerance, bool) or not 0 <= tolerance < math.inf:
        raise OptionError(argument="tolerance", expected="a number of at least 0, such as 0.1", got=tolerance)
    if model is not None and tolerance:
        raise OptionError("a tolerance is only for the test without a model", argument="tolerance", got=tolerance)
    names = [str(k) for k in range(1, len(recordings) + 1)] if labels is None else list(labels)
    if len(set(names)) != len(names) or len(names) != len(recordings):
        raise OptionError(argument="labels", expected="a different name for each recording", got=labels)
    axes = _axes(recordings, rate)
    curves = {axis: _curves(dict(zip(names, signals, strict=True))) for axis, signals in axes.items()}
    rows = [
        row
        for axis, measured in curves.items()
        for row in level_ratios(measured, axis, confidence=confidence, tolerance=tolerance)
    ]
    tests = []
    if model is not None:
        tests = [_same_parameters(model, measured, axis, confidence) for axis, measured in curves.items()]
    every = dict.fromkeys(axis for item in recordings if isinstance(item, Imu) for axis in item.signals)
    return SameNoise(
        recordings=tuple(names), axes=tuple(axes), levels=tuple(decide(rows, size)),
        parameters=tuple(decide(tests, size)), left_out=tuple(axis for axis in every if axis not in axes),
        tolerance=float(tolerance), size=size, confidence=confidence,
    )  # fmt: skip


def _axes(recordings: Sequence[Any], rate: float | None) -> dict[str, list[Signal]]:
    """Return the signals to compare, by axis."""
    if len(recordings) < 2:
        raise DataError(argument="recordings", expected="at least two recordings", got=len(recordings))
    imus = [_signals(item, rate, f"recording {k}") for k, item in enumerate(recordings, start=1)]
    if not any(isinstance(item, Imu) for item in recordings):
        # Single signals are compared even if their names differ.
        axes = {next(iter(imus[0])): [signal for imu in imus for signal in imu.values()]}
    else:
        axes = {axis: [imu[axis] for imu in imus] for axis in imus[0] if all(axis in imu for imu in imus)}
    if not axes:
        names = "; ".join(map(", ".join, imus))
        raise DataError(f"the recordings have no axis in common: {names}", argument="recordings")
    for axis, (first, *others) in axes.items():
        for other in others:
            rates, units = [f"{s.rate:g} Hz" for s in (first, other)], [s.unit or "none" for s in (first, other)]
            same_rate = abs(other.rate / first.rate - 1) <= SAME_RATE_DIFFERENCE
            for name, equal, values in (("rate", same_rate, rates), ("unit", other.unit == first.unit, units)):
                if not equal:
                    raise DataError(
                        f"the recordings of {axis} differ in their {name}: {' and '.join(values)}",
                        argument="recordings", advice=f"Compare recordings with the same {name}.",
                    )  # fmt: skip
    return axes


def _signals(item: Any, rate: float | None, name: str) -> Mapping[str, Signal]:
    if isinstance(item, Imu):
        return item.signals
    signal = item if isinstance(item, Signal) else Signal(as_vector(item, name), as_rate(rate))
    return {signal.axis or "signal": signal}


def _curves(signals: Mapping[str, Signal]) -> dict[str, WaveletVariance]:
    """Return the wavelet variances of the recordings of one axis, with the covariance from heavy tails."""
    curves = {}
    for name, signal in signals.items():
        wv = wavelet_variance(signal)
        curves[name] = replace(wv, excess=excess_covariance(signal, wv))
    return dict(with_common_tails(curves))


def _same_parameters(
    model: ModelLike, curves: Mapping[str, WaveletVariance], axis: str, confidence: float
) -> SameParameters:
    """Test the recordings of one axis, with the p-value of this test alone."""
    together = fit(model, pool(curves), certify=False)
    apart = deviations(together)
    return SameParameters(
        axis=axis, model=str(together.model), statistic=apart.statistic, df=apart.df, pvalue=apart.pvalue,
        differs=False, fit_pvalue=together.goodness_of_fit().pvalue,
        ratios=tuple(_ratios(apart, parameters_by_name(together.model), confidence)),
    )  # fmt: skip


def _ratios(apart: Deviations, parameters: Mapping[str, Parameter], confidence: float) -> Iterator[ParameterRatio]:
    """Yield the ratios of each recording to the others, for the parameters that both determine."""
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    precision = np.where(np.isfinite(apart.values), 1 / apart.variances, 0.0)
    values = np.nan_to_num(apart.values)
    for k, recording in enumerate(numerators(apart.recordings)):
        others = np.arange(len(values)) != k
        for place, name in enumerate(apart.names):
            weight, weights = float(precision[k, place]), precision[others, place]
            if not weight or not weights.sum():
                continue
            scale = parameters[name].scale_power is not None
            mean = float(np.average(values[others, place], weights=weights))
            upper = _on_logarithm(float(values[k, place]), weight, scale)
            lower = _on_logarithm(mean, float(weights.sum()), scale)
            if upper is not None and lower is not None:
                width = z * math.hypot(upper[1], lower[1])
                low, at, high = (math.exp(upper[0] - lower[0] + s * width) for s in (-1, 0, 1))
                yield ParameterRatio(recording=recording, name=name, ratio=at, lower=low, upper=high)


def _on_logarithm(step: float, precision: float, scale: bool) -> tuple[float, float] | None:
    """Return log parameter over pool and its error, or None; curves are linear in variances, so one step is exact."""
    size = 1.0 + step if scale else 1.0
    error = 1 / math.sqrt(precision) / size if size > 0 else math.inf
    if error > LONGEST_STEP or abs(step) > LONGEST_STEP:
        return None
    return (math.log(size) if scale else step), error
