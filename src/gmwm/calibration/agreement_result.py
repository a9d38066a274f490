"""Result of `agree`: the datasheet numbers of several recordings of one unit, the test of each, and the text."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from statistics import geometric_mean
from typing import Any, Literal

from gmwm.base.documents import Documented, plain
from gmwm.base.remarks import Dialect, Remark, sorted_remarks, texts
from gmwm.base.results import Difference, DifferenceTests
from gmwm.base.text import Named, round_text, wrap_text
from gmwm.calibration.number_verdicts import Usability
from gmwm.calibration.tables import fitting_tables, key, number, short_heads
from gmwm.choosing.datasheets import Entry
from gmwm.files.importers.values import Reference
from gmwm.measuring.variance.allan_regression import LAWS

_NONE = "–"
_ABSENT, _FAILED = "not recorded", "not calibrated"
_SAME, _OTHER = "=", "≠"
_ANSWERS = {True: _SAME, False: _OTHER, None: ""}
_LOWEST: Literal["B"] = "B"
DO_NOT_USE = Usability.DO_NOT_USE.value


def summary(found: Agreement, dialect: Dialect = Dialect.PYTHON) -> str:
    """Return the verdict, a table for each axis, the remarks and the reference values as text of at most 80 columns."""
    heads, names = short_heads(found.labels)
    parts = [[*wrap_text(found.verdict.text(dialect)), *names]]
    parts += [
        [axis, *fitting_tables(heads, lambda *part, axis=axis: _rows(found, axis, *part))] for axis in found.models
    ]
    if found.sensors:
        parts.append(["All axes of a sensor together, as a factor of the first recording",
                      *fitting_tables(heads, lambda *part: _shared(found, *part))])  # fmt: skip
    parts.append(wrap_text(_legend(found)))
    if remarks := texts(found.remarks, dialect):
        lines = [line for text in remarks for line in wrap_text(text, "- ")]
        parts.append(["What to know about the comparison:", *lines])
    if referred := [row for row in found.rows if row.reference is not None]:
        table = fitting_tables(heads, lambda *part: _beside(found, referred, *part))
        parts.append(["Measured / reference:", *table, *wrap_text(_about_reference(referred))])
    return "\n\n".join("\n".join(lines) for lines in parts if lines)


def _rows(found: Agreement, axis: str, heads: Sequence[str], part: range) -> list[list[str]]:
    models = found.models[axis]
    # The result of the test is in a column after the last recording.
    end = part.stop == len(found.labels)
    rows = [["", *heads, *([""] if end else [])]]
    shown = [_why_absent(found, axis, k) if (model := models[k]) is None else model.replace(" ", "") for k in part]
    rows.append(["model", *shown, *([""] if end else [])])
    for row in found.rows:
        if row.axis != axis or not _is_shown(found, row):
            continue
        cells = ["" if models[k] is None else _cell(found, row, k) for k in part]
        rows.append([f"{row.name} ({_unit(row)})", *cells, *([_ANSWERS[row.agrees]] if end else [])])
    return rows


def _shared(found: Agreement, heads: Sequence[str], part: range) -> list[list[str]]:
    end = part.stop == len(found.labels)
    rows = [["", *heads, *([""] if end else [])]]
    for row in found.sensors:
        cells = [_NONE if (factor := row.factors[k]) is None else _factor_text(*factor) for k in part]
        rows.append([f"{row.sensor} {row.symbol}", *cells, *([_ANSWERS[row.agrees]] if end else [])])
    return rows


def _factor_text(value: float, low: float, high: float) -> str:
    """Format a factor with its confidence interval; the first recording has none."""
    return "1" if low == high else f"{round_text(value, 3)} ({round_text(low, 3)} … {round_text(high, 3)})"


def _is_shown(found: Agreement, row: SharedNumber) -> bool:
    """Return whether a number can be compared, or belongs to the only recording of its axis."""
    alone = sum(model is not None for model in found.models[row.axis]) == 1
    return row.reason != "models" and (row.reason != "one recording" or alone)


def _why_absent(found: Agreement, axis: str, k: int) -> str:
    """Return the reason why a recording has no model for an axis."""
    return _FAILED if found.labels[k] in found.failed.get(axis, ()) else _ABSENT


def _cell(found: Agreement, row: SharedNumber, k: int) -> str:
    """Format the number in recording `k`, or the reason why there is none."""
    entry = row.entries[k]
    if entry is not None:
        return number(entry) + (" ✗" if row.use[k] == DO_NOT_USE and entry.high != math.inf else "")
    return _NONE if found.models[row.axis][k] is not None else _why_absent(found, row.axis, k)


def _unit(row: SharedNumber) -> str:
    return next(entry.in_units("datasheet")[3] for entry in row.entries if entry is not None)


def _legend(found: Agreement) -> str:
    shown = [row for row in found.rows if _is_shown(found, row)]
    named = key(entry for row in shown for entry in row.entries if entry is not None)
    refused = any("✗" in _cell(found, row, k) for row in shown for k in range(len(found.labels)))
    return (
        f"{named}. N, K, Q and B are compared whatever the models are; numbers of a single recording are left out. "
        f"±, +a/−b, a … b: confidence interval; ≤: upper limit; {'✗: do not use, not compared; ' if refused else ''}"
        f"{_NONE}: not in the model. "
        f"{_SAME}: no difference found; {_OTHER}: they differ by more than chance. p: adjusted by Holm's method."
    )


def _beside(found: Agreement, rows: Sequence[SharedNumber], heads: Sequence[str], part: range) -> list[list[str]]:
    table = [["", "reference", *heads]]
    for row in rows:
        cells = []
        for k in part:
            entry, ratio = row.entries[k], row.ratios[k]
            limit = "≤ " if entry is not None and entry.upper_only else ""
            if entry is None:
                cells.append(_cell(found, row, k))
            else:
                cells.append(_NONE if ratio is None or not math.isfinite(ratio) else f"{limit}{round_text(ratio, 3)}")
        table.append([f"{row.axis} {row.name}", str(row.reference), *cells])
    return table


def _about_reference(rows: Sequence[SharedNumber]) -> str:
    entries = [entry for row in rows if row.symbol == _LOWEST for entry in row.entries]
    if all(entry is None or entry.term is not None for entry in entries):
        return ""
    factor = LAWS[_LOWEST].factor
    return (
        f"{_LOWEST} is the minimum of the Allan deviation divided by {factor:.3f}, as in the standard. Many datasheets "
        f"state the minimum itself: multiply the ratio by {factor:.3f} in this case."
    )


@dataclass(frozen=True, kw_only=True)
class SharedNumber(Documented):
    """One datasheet number of one axis, as estimated from several recordings.

    Attributes
    ----------
    axis, symbol, title, unit : str
        Axis, symbol and title of the number, and its SI unit.
    entries : tuple of (Entry or None)
        The number in each recording; None if the model of the recording does not have it.
    use : tuple of (str or None)
        Whether the number of each recording can be used, as in `Calibration.number_verdicts`: "use", "use as a
        bound" or "do not use". None if it is not known.
    pvalue : float or None
        p-value of the test that all recordings have the same value; None if the number was not tested.
    adjusted : float or None
        The p-value adjusted by Holm's method for the number of tests; None if the number was not tested.
    agrees : bool or None
        Whether `adjusted` is above the significance level; None if the number was not tested.
    reason : str
        Why the number was not tested: "models" (it depends on the model, and the models differ), "one recording" (only
        one has it), "kinds" (B has different definitions), "interval" (fewer than two values have a confidence
        interval) or "use" (fewer than two of these may be used); "" if it was tested.
    reference : Reference or None
        The reference value, for example of the manufacturer; None if none was given.
    """

    axis: str
    symbol: str
    title: str
    unit: str
    entries: tuple[Entry | None, ...]
    use: tuple[str | None, ...]
    pvalue: float | None = None
    adjusted: float | None = None
    agrees: bool | None = None
    reason: str = ""
    reference: Reference | None = None
    document_keys = (
        "axis", "symbol", "title", "unit", "entries", "use", "apart", "pvalue", "adjusted", "agrees", "reason",
        "reference", "ratios",
    )  # fmt: skip

    @property
    def name(self) -> str:
        """The symbol for readers, as `Entry.name` returns it."""
        return next((entry.name for entry in self.entries if entry is not None), self.symbol)

    @property
    def usable(self) -> tuple[Entry | None, ...]:
        """The number in each recording, None also where it must not be used."""
        return tuple(None if use == DO_NOT_USE else each for each, use in zip(self.entries, self.use, strict=True))

    @property
    def apart(self) -> float | None:
        """Ratio of the largest to the smallest usable value, minus 1; None for fewer than two or a value ≤ 0."""
        values = [entry.value for entry in self.usable if entry is not None and not entry.upper_only]
        return max(values) / min(values) - 1 if len(values) > 1 and min(values) > 0 else None

    @property
    def ratios(self) -> tuple[float | None, ...]:
        """For each recording, ratio of the value (or upper limit) to the reference; None if either is missing."""
        if self.reference is None:
            return (None,) * len(self.entries)
        shown = [None if entry is None else entry.high if entry.upper_only else entry.value for entry in self.entries]
        return tuple(None if value is None else abs(value) / self.reference.si for value in shown)


@dataclass(frozen=True, kw_only=True)
class SensorFactors(Documented):
    """Factors by which N or K of all axes of a sensor differs between recordings.

    Attributes
    ----------
    sensor, symbol : str
        Sensor, such as "gyro", and symbol of the number, "N" or "K".
    axes : tuple of str
        The axes that are compared: those with a confidence interval in two recordings.
    factors : tuple of ((float, float, float) or None)
        For each recording, the factor relative to the first recording that has these axes, and its 95 % confidence
        interval; None if the recording has no axis that can be compared.
    pvalue : float
        p-value of the test that all factors are 1.
    adjusted : float or None
        p-value adjusted by Holm's method among the tests of the sensors.
    agrees : bool or None
        Whether `adjusted` is above the significance level.
    """

    sensor: str
    symbol: str
    axes: tuple[str, ...]
    factors: tuple[tuple[float, float, float] | None, ...]
    pvalue: float
    adjusted: float | None = None
    agrees: bool | None = None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Agreement(DifferenceTests, Sequence[SharedNumber]):
    """Comparison of the datasheet numbers of several recordings of one unit.

    Attributes
    ----------
    labels : tuple of str
        Names of the recordings.
    rows : tuple of SharedNumber
        All numbers, sorted by axis.
    models : mapping of axis to tuple of (str or None)
        The model of the axis in each recording; None if the recording has no model for it.
    rejected : mapping of axis to tuple of str
        Names of the recordings in which a goodness-of-fit test rejects the model, so that intervals are too narrow.
    size : float
        Significance level of the tests of all numbers together, and of the tests of all sensors together.
    unmatched : tuple of str
        Keys of the reference values for which no recording has a number.
    failed : mapping of axis to tuple of str
        Names of the recordings in which the axis could not be calibrated.
    sensors : tuple of SensorFactors
        Tests of N and K of all axes of a sensor together.
    """

    labels: tuple[str, ...]
    rows: tuple[SharedNumber, ...]
    models: Mapping[str, tuple[str | None, ...]]
    rejected: Mapping[str, tuple[str, ...]]
    size: float
    unmatched: tuple[str, ...] = ()
    failed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    sensors: tuple[SensorFactors, ...] = ()

    @property
    def compared(self) -> tuple[SharedNumber, ...]:
        """The numbers that were tested."""
        return tuple(row for row in self.rows if row.agrees is not None)

    @property
    def disagreeing(self) -> tuple[SharedNumber, ...]:
        """The numbers that differ between the recordings by more than chance."""
        return tuple(row for row in self.rows if row.agrees is False)

    @property
    def tests(self) -> tuple[Difference, ...]:
        """Each tested number in each recording, over the geometric mean of all recordings."""
        tests = []
        for row in self.compared:
            values = {
                label: entry for label, entry in zip(self.labels, row.usable, strict=True)
                if entry is not None and not entry.upper_only and entry.value > 0
            }  # fmt: skip
            centre = geometric_mean(entry.value for entry in values.values()) if values else 1.0
            tests += [
                Difference(name=f"{row.axis} {row.name}, {label}", ratio=entry.value / centre,
                           lower=None if entry.low is None else entry.low / centre,
                           upper=None if entry.high is None else entry.high / centre,
                           pvalue=row.adjusted, differs=row.agrees is False)
                for label, entry in values.items()
            ]  # fmt: skip
        return tuple(tests)

    @property
    def verdict(self) -> Remark:
        """Remark that states how many numbers were compared and how many of them differ."""
        return verdict_of(self)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on numbers that differ or were not compared, the most severe first."""
        return tuple(sorted_remarks(_remarks(self)))

    def __getitem__(self, index: Any) -> Any:
        """Return a number by its index or by its name, such as "gyro_x.N"."""
        if not isinstance(index, str):
            return self.rows[index]
        return Named(((f"{row.axis}.{row.symbol}", row) for row in self.rows), "number")[index]

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[SharedNumber]:
        return iter(self.rows)

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Return the comparison as text of at most 80 columns: numbers in datasheet units, remarks in a `dialect`."""
        return summary(self, dialect)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain values for JSON."""
        differing = [f"{row.axis}.{row.symbol}" for row in self.disagreeing]
        differing += [f"{row.sensor}.{row.symbol}" for row in self.sensors if row.agrees is False]
        count = len(self.compared) + len(self.sensors)
        content = {"labels": self.labels, "size": self.size, "compared": count, "disagreeing": differing}
        for name in ("models", "rejected", "unmatched", "failed", "rows", "sensors", "verdict", "remarks"):
            content[name] = getattr(self, name)
        document: dict[str, Any] = plain(content, finite=False)
        return document

    def __repr__(self) -> str:
        return f"Agreement({len(self.compared)} numbers compared, {len(self.disagreeing)} differ)"


_RAMP = "R"


def verdict_of(found: Agreement) -> Remark:
    """Return the verdict, a remark that states how many numbers were compared and how many of them differ."""
    compared = len(found.compared) + len(found.sensors)
    differing = len(found.disagreeing) + sum(row.agrees is False for row in found.sensors)
    absent = tuple(axis for axis, models in found.models.items() if None in models)
    alike = "incomplete" if absent else "all"
    state = "none" if not compared else alike if not differing else "one" if differing == 1 else "some"
    return Remark.of(
        "agreement", recordings=len(found.labels), compared=compared, differing=differing, size=found.size,
        state=state, absent=absent,
    )  # fmt: skip


def _remarks(found: Agreement) -> Iterator[Remark]:
    for shared in found.sensors:
        if shared.agrees is False and shared.adjusted is not None:
            factors = zip(found.labels, shared.factors, strict=True)
            others = [(name, factor) for name, factor in factors if factor is not None]
            yield Remark.of(
                "recordings-differ", f"{shared.symbol} of {shared.sensor}", case="sensor", p=shared.adjusted,
                recording=others[0][0], axes=shared.axes,
                values=tuple(f"{_factor_text(*factor)} in {name}" for name, factor in others[1:]),
            )  # fmt: skip
    for row in found.disagreeing:
        yield _difference(row)
    for axis, labels in found.rejected.items():
        everywhere = len(labels) == sum(model is not None for model in found.models[axis])
        yield Remark.of(
            "model-rejected", axis, case="recording", recordings=("all recordings",) if everywhere else labels
        )
    for row in found.disagreeing:
        if row.symbol == _RAMP:
            yield Remark.of("drift", _name(row), case="ramps")
    for axis, models in found.models.items():
        if len({model for model in models if model is not None}) > 1:
            yield Remark.of("not-compared", axis, case="models", numbers=("N", "K", "B", "Q"))
    for row in found.rows:
        if row.reason == "kinds":
            yield Remark.of("not-compared", _name(row), case="kinds")
        if row.reason == "one recording":
            yield Remark.of("not-compared", _name(row), case="single")
    for axis in found.unmatched:
        yield Remark.of("not-compared", axis, case="reference")


def _name(row: SharedNumber) -> str:
    return f"{row.symbol} of {row.axis}"


def _difference(row: SharedNumber) -> Remark:
    """Return the remark on a number that differs between recordings, with its values and p-value."""
    entries = [entry for entry in row.usable if entry is not None]
    unit = entries[0].in_units("datasheet")[3]
    return Remark.of(
        "recordings-differ", _name(row), case="agreement", values=tuple(number(entry) for entry in entries), unit=unit,
        p=row.adjusted if row.adjusted is not None else 1.0, sizes="no" if row.apart is None else "yes",
        apart="" if row.apart is None else apart_text(row.apart),
    )  # fmt: skip


def apart_text(share: float) -> str:
    """Format how far the largest value is from the smallest, given their ratio minus 1.

    >>> apart_text(0.12), apart_text(2.0)
    ('12 % between the largest and the smallest', 'a factor of 3 between the largest and the smallest')
    """
    size = f"{round_text(100 * share)} %" if share < 1 else f"a factor of {round_text(1 + share)}"
    return f"{size} between the largest and the smallest"
