"""Result of the test whether recordings have the same noise."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from gmwm.applications.several.same_model import SameParameters
from gmwm.base.multiple_tests import holm
from gmwm.base.remarks import Dialect, Quantity, Remark, texts
from gmwm.base.tables import headed
from gmwm.base.text import Summarised, duration_text
from gmwm.choosing.replicates.level_ratios import LevelRatio

if TYPE_CHECKING:
    from polars import DataFrame

_EACH = "each recording over the mean of the others"
SMALLEST = 1e-300
"""Smallest p-value that is shown, so that no text states p = 0."""


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SameNoise(Summarised):
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
    def differs(self) -> bool:
        """Whether a test finds a difference: at any scale of any axis, or in parameters of the model."""
        return any(test.differs for test in self.parameters) if self.parameters else bool(self.differences)

    @property
    def pvalue(self) -> float:
        """The smallest adjusted p-value, which is the p-value of the tests of all levels and axes together; with a
        model, of the tests of its parameters."""
        if self.parameters:
            return min(test.pvalue for test in self.parameters)
        return min((row.pvalue for row in self.levels if row.pvalue is not None), default=1.0)

    @property
    def compared(self) -> tuple[str, ...]:
        """Names of the recordings in the numerators of the ratios: only the first one of two recordings, otherwise
        all."""
        return self.recordings[: 1 if len(self.recordings) == 2 else None]

    def largest(self, axis: str, recording: str = "") -> LevelRatio:
        """Return the ratio with the most significant difference for an axis, of one recording or (by default) of
        all."""
        rows = [row for row in self[axis] if recording in ("", row.recording)]
        return min(rows, key=lambda row: (row.pvalue if row.pvalue is not None else 1.0, -abs(row.ratio - 1)))

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the differences of each axis and recording, or one remark that no difference was found."""
        missing = [Remark.of("axes-not-compared", axis) for axis in self.left_out]
        return (*(self._parameter_remarks() if self.parameters else self._level_remarks()), *missing)

    def _level_remarks(self) -> tuple[Remark, ...]:
        if not self.differs:
            tests = sum(row.pvalue is not None for row in self.levels)
            within = "yes" if self.tolerance else "no"
            same = Remark.of("noise-same", tests=tests, size=self.size, tolerance=self.tolerance, within=within)
            return (same,)
        found = []
        for recording in self.compared:
            for axis in self.axes:
                rows = [row for row in self[axis] if row.differs and row.recording == recording]
                if rows:
                    most = max(rows, key=lambda row: abs(row.ratio - 1))
                    found.append(
                        Remark.of(
                            "noise-differs", axis, percent=abs(most.ratio - 1), tau=Quantity(most.tau, "s"),
                            more="higher" if most.ratio > 1 else "lower", levels=len(rows),
                            p=max(min(row.pvalue or 0.0 for row in rows), SMALLEST), recording=recording,
                            other=self._other,
                        )
                    )  # fmt: skip
        return tuple(found)

    def _parameter_remarks(self) -> Iterator[Remark]:
        """Whether the parameters differ, by axis, and which models are rejected."""
        equal = [test.axis for test in self.parameters if not test.differs]
        for test in self.parameters:
            if test.differs and test.ratios:
                most = test.largest
                yield Remark.of(
                    "parameters-differ", test.axis, name=most.name, recording=most.recording, other=self._other,
                    ratio=most.ratio, lower=most.lower, upper=most.upper, confidence=self.confidence,
                    p=max(test.pvalue, SMALLEST),
                )  # fmt: skip
        for axis in equal:
            yield Remark.of("parameters-same", axis, size=self.size)
        adjusted = holm([test.fit_pvalue for test in self.parameters]).tolist()
        rejected = [test for test, p in zip(self.parameters, adjusted, strict=True) if p <= self.size]
        for test in rejected:
            least = max(min(other.fit_pvalue for other in rejected), SMALLEST)
            yield Remark.of("compared-model-rejected", test.axis, p=least)

    @property
    def _compared(self) -> str:
        """What the ratios of a table compare, in words."""
        return " over ".join(self.recordings) if len(self.recordings) == 2 else _EACH

    @property
    def _other(self) -> str:
        return f"recording {self.recordings[1]}" if len(self.recordings) == 2 else "the others"

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return {
            "recordings": list(self.recordings),
            "axes": list(self.axes),
            "left_out": list(self.left_out),
            "tolerance": self.tolerance,
            "size": self.size,
            "confidence": self.confidence,
            "pvalue": self.pvalue,
            "differs": self.differs,
            "levels": [asdict(row) for row in self.levels],
            "parameters": [asdict(test) for test in self.parameters],
            "remarks": [remark.to_dict() for remark in self.remarks],
        }

    def to_frame(self) -> DataFrame:
        """Return the ratios as a Polars data frame with one row for each axis, compared recording and level."""
        from polars import DataFrame

        return DataFrame([asdict(row) for row in self.levels], infer_schema_length=None)

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Format a table with the most significant ratio of each axis, or with the ratios of its parameters, and the
        remarks.

        Parameters
        ----------
        dialect : Dialect
            Whether options are written as in Python or as in the shell.
        """
        if self.parameters:
            return self._parameter_summary(dialect)
        two = len(self.recordings) == 2
        rows = [["axis", *([] if two else ["recording"]), "ratio", f"{100 * self.confidence:g} %", "at τ", "p"]]
        for axis in self.axes:
            for recording in self.compared:
                row = self.largest(axis, recording)
                limits = "no test" if row.lower is None else f"{row.lower:.3f} … {row.upper:.3f}"
                p = "" if row.pvalue is None else f"{max(row.pvalue, SMALLEST):.2g}"
                name = [] if two else [recording]
                rows.append([axis, *name, f"{row.ratio:.3f}", limits, duration_text(row.tau), p])
        head = f"Ratio of the deviations, {self._compared}, at the scale of the most significant difference"
        return "\n".join([head, "", *headed(rows), "", *texts(self.remarks, dialect)])

    def _parameter_summary(self, dialect: Dialect) -> str:
        two = len(self.recordings) == 2
        rows = [["axis", *([] if two else ["recording"]), "parameter", "ratio", f"{100 * self.confidence:g} %", "p"]]
        for test in self.parameters:
            for one in test.ratios:
                name = [] if two else [one.recording]
                limits = f"{one.lower:.3f} … {one.upper:.3f}"
                rows.append(
                    [test.axis, *name, one.name, f"{one.ratio:.3f}", limits, f"{max(test.pvalue, SMALLEST):.2g}"]
                )
        head = f"Ratio of the parameters, {self._compared}; p is the p-value of the test of all parameters of an axis"
        table = [head, "", *headed(rows), ""] if len(rows) > 1 else []
        return "\n".join([*table, *texts(self.remarks, dialect)])

    def __repr__(self) -> str:
        found = "different" if self.differs else "the same"
        return f"SameNoise({', '.join(self.axes)}: {found}, p = {self.pvalue:.2g})"
