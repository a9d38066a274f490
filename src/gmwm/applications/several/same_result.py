"""Result of the test whether recordings have the same noise."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from gmwm.base.differences import Difference
from gmwm.base.documents import plain_fields
from gmwm.base.frames import Tabular
from gmwm.base.multiple_tests import holm
from gmwm.base.remarks import Dialect, Quantity, Remark, texts
from gmwm.base.text import duration_text, table_with_rule
from gmwm.choosing.replicates.comparison import LevelRatio, RecordingComparison, smallest

if TYPE_CHECKING:
    from polars import DataFrame

SMALLEST_PVALUE = 1e-300
"""Smallest p-value that is shown, so that no text states p = 0."""


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
                       upper=part.upper, pvalue=test.pvalue, differs=test.differs)
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
                        p=max(smallest(rows), SMALLEST_PVALUE), recording=recording, other=self._other,
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
                    p=max(test.pvalue, SMALLEST_PVALUE),
                )  # fmt: skip
        for test in self.parameters:
            if not test.differs:
                yield Remark.of("recordings-agree", test.axis, case="parameters", size=self.size)
        adjusted = holm([test.fit_pvalue for test in self.parameters]).tolist()
        rejected = [test for test, p in zip(self.parameters, adjusted, strict=True) if p <= self.size]
        for test in rejected:
            least = max(min(other.fit_pvalue for other in rejected), SMALLEST_PVALUE)
            yield Remark.of("model-rejected", test.axis, case="same", p=least)

    @property
    def _other(self) -> str:
        return f"recording {self.recordings[1]}" if len(self.recordings) == 2 else "the others"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return plain_fields(
            self, "recordings axes left_out tolerance size confidence pvalue differs levels parameters remarks"
        )

    def to_polars(self) -> DataFrame:
        """Return the ratios as a Polars data frame with one row for each axis, compared recording and level."""
        from polars import DataFrame

        return DataFrame([asdict(row) for row in self.levels], infer_schema_length=None)

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Format the most significant ratio, or the parameters, of each axis, and the remarks in a `dialect`."""
        two, level = len(self.recordings) == 2, f"{100 * self.confidence:g} %"
        ratio = " over ".join(self.recordings) if two else "each recording over the mean of the others"
        if self.parameters:
            head = f"Ratio of the parameters, {ratio}; p is the p-value of the test of all parameters of an axis"
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
    return "" if p is None else f"{max(p, SMALLEST_PVALUE):.2g}"
