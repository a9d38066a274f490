"""Compare one calibration with a reference: a file of another program, or the numbers of a datasheet."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Literal

from gmwm.base.documents import Documented
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import Named, Summarised, round_text, table_with_rule, wrap_text
from gmwm.base.units import SI_UNIT, datasheet_units, noise_unit, sensor_of
from gmwm.calibration.number_verdicts import Usability, as_limit
from gmwm.choosing.datasheets import Entry, effective_noise
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S
from gmwm.choosing.datasheets.entry import significant
from gmwm.files.importers import Given, Values, given_noise
from gmwm.files.importers.values import as_reference

if TYPE_CHECKING:
    from gmwm.calibration.result import Calibration

Verdict = Literal["agrees", "close", "larger", "smaller", "unusable", "unknown"]
ReferenceLike = Mapping[str, tuple[float, str]] | Given | str | os.PathLike[str]

CLOSE_DIFFERENCE = 0.1  # relative difference of a close reference outside the interval; datasheets round to two digits
LEAST_UNIT_RATIO = 3.0
"""Smallest ratio (or inverse ratio) of measured and reference value for which a wrong unit is suspected."""
POWERS = {"Q": 1.0, "N": 0.5, "B": 0.0, "K": -0.5, "R": -1.0}
_WORDS = {
    "agrees": "agrees", "close": "within 10 %", "larger": "reference larger", "smaller": "reference smaller",
    "unusable": "do not use the measured number", "unknown": "not measured",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ReferenceNumber(Documented):
    """A datasheet number of one axis, as calibrated and as in the reference.

    Attributes
    ----------
    axis, symbol : str
        Axis and symbol, such as "gyro_x" and "N".
    reference : float
        Reference value, in the SI unit of `measured`.
    measured : Entry or None
        The number of the calibration; None if the model does not have it. If the reference is a file, N and K are the
        values for the horizon, as in exported files.
    key : str
        Key of the number in the file; "" for a datasheet.
    written : float or None
        Value as written in the file; None for a datasheet.
    verdict : "agrees", "close", "larger", "smaller", "unusable" or "unknown"
        "agrees" if the reference is inside the confidence interval, "close" if it differs by at most 10 %, otherwise
        "larger" or "smaller" than measured; "unusable" if `Calibration.number_verdicts` says not to use the number;
        "unknown" if it was not measured.
    """

    axis: str
    symbol: str
    reference: float
    measured: Entry | None
    key: str = ""
    written: float | None = None
    verdict: Verdict = "unknown"
    document_keys = (
        "axis", "symbol", "reference", "key", "measured", "written", "as_written", "ratio", "verdict",
    )  # fmt: skip

    @property
    def ratio(self) -> float | None:
        """Measured value, or its upper limit, divided by the reference; None if the number was not measured."""
        measured = self.measured
        if measured is None:
            return None
        value = measured.high if measured.upper_only else measured.value
        return None if not value or not math.isfinite(value) else abs(value) / self.reference

    @property
    def as_written(self) -> float | None:
        """The measured value, or its upper limit, in the convention of the file; None if the reference is no file."""
        if not self.written or not self.ratio:
            return None
        # File and reference have two conventions of one number, so their ratio (squared for variances) converts values.
        return float(self.written * self.ratio**self.power)

    @property
    def unit(self) -> str:
        """SI unit of the number."""
        return noise_unit(POWERS[self.symbol], SI_UNIT["gyro" if self.axis.startswith("gyro") else "accel"])[0]

    @property
    def shown(self) -> tuple[float, str]:
        """The reference value in the usual unit of datasheets, and this unit."""
        name, size = next(iter(datasheet_units(self.unit).items()), (self.unit, 1.0))
        return size * self.reference, name

    @property
    def power(self) -> float:
        """Exponent of the standard deviation in the file: 2 if the file contains variances, otherwise 1."""
        return 2.0 if self.key.endswith("_cov") else 1.0


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ReferenceCheck(Documented, Summarised):
    """Comparison of the datasheet numbers of a calibration with a reference.

    Attributes
    ----------
    rows : tuple of ReferenceNumber
        The numbers, sorted by axis.
    name : str
        Name of the file; "datasheet" or "reference" for numbers without a file.
    format : str
        Program to which the file belongs; "datasheet" for numbers without a file.
    horizon : float
        Time horizon (s) of N and K if the reference is a file.
    rate : float
        Sampling rate (Hz) of the program of the file, or of the calibration if the file does not state it.
    level : float
        Confidence level of the intervals.
    unmatched : tuple of str
        Axes of the reference that the calibration does not have.
    """

    rows: tuple[ReferenceNumber, ...]
    name: str
    format: str
    horizon: float
    rate: float
    level: float
    unmatched: tuple[str, ...] = ()
    document_keys = ("reference=name", "format", "horizon", "level", "rows", "unmatched", "remarks")

    def __iter__(self) -> Iterator[ReferenceNumber]:
        return iter(self.rows)

    def __getitem__(self, name: str) -> ReferenceNumber:
        """Return a number by its name, such as "gyro_x.N"."""
        return Named(((f"{row.axis}.{row.symbol}", row) for row in self.rows), "number")[name]

    def of(self, *verdicts: Verdict) -> tuple[ReferenceNumber, ...]:
        """Return the numbers with one of these verdicts."""
        return tuple(row for row in self.rows if row.verdict in verdicts)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """The verdict, and remarks on ratios that look like a conversion factor of units."""
        counts = {name: len(self.of(name)) for name in ("smaller", "larger", "unusable", "unknown")}
        state = "file" if self.format != "datasheet" else "datasheet"
        agreeing = len(self.of("agrees", "close"))
        worst = next((name for name, count in counts.items() if count), "all")
        named = f"the {self.name}" if self.name in ("datasheet", "reference") else self.name
        verdict = Remark.of(
            "reference-verdict", count=len(self.rows), agreeing=agreeing, smaller=counts["smaller"],
            larger=counts["larger"], state=f"{state}-{worst}", reference=named,
        )  # fmt: skip
        return (verdict, *self._factors())

    def _factors(self) -> Iterator[Remark]:
        # If a unit is wrong, all axes of the sensor are affected.
        sensors: dict[tuple[str, str], list[ReferenceNumber]] = {}
        for row in self.rows:
            sensors.setdefault((sensor_of(row.axis), row.symbol), []).append(row)
        for rows in sensors.values():
            if any(row.verdict == "unusable" for row in rows):
                continue
            causes, factor = {_cause(row, self.rate) for row in rows}, rows[0].ratio
            if len(causes) == 1 and (cause := causes.pop()) is not None and factor is not None:
                names = tuple(f"{row.symbol} of {row.axis}" for row in rows)
                yield Remark.of("reference-factor", numbers=names, factor=factor, cause=cause, rate=self.rate)

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Return the comparison as text, with the ratio and the verdict of each number, and remarks in a `dialect`."""
        return _summary(self, dialect)


def check_reference(calibration: Calibration, reference: ReferenceLike, *, horizon: float = 1.0) -> ReferenceCheck:
    """Compare a calibration with a reference. `Calibration.agree` describes the arguments."""
    level = calibration.settings.confidence
    rate = max(fit.wavelet_variance.rate for fit in calibration.values())
    if isinstance(reference, Mapping):
        rows, unmatched = _of_numbers(calibration, reference)
        name, form = "reference", "datasheet"
    else:
        stated = reference if isinstance(reference, Given) else _parse_reference(reference, rate)
        name, form, rate = PurePath(stated.source).name if stated.written else "datasheet", stated.format, stated.rate
        unmatched = tuple(axis for axis in stated.values if axis not in calibration)
        rows = [
            row
            for axis, values in stated.values.items()
            if axis in calibration
            for row in _of_axis(calibration, axis, values, stated, horizon=horizon)
        ]
    if not rows:
        raise OptionError(
            argument="reference", expected=f"numbers of an axis of {', '.join(calibration)}", got=", ".join(unmatched)
        )
    return ReferenceCheck(
        rows=tuple(_with_use(row, calibration) for row in rows), name=name, format=form, horizon=horizon,
        rate=rate, level=level, unmatched=tuple(unmatched),
    )  # fmt: skip


def _parse_reference(source: str | os.PathLike[str], rate: float) -> Given:
    """Return the noise in a file or datasheet. If it states no sampling rate, `rate` (Hz) is used."""
    text = os.fspath(source)
    try:
        return given_noise(text)
    except OptionError as error:
        if error.argument != "rate":
            error.options = {**error.options, "source": "--reference"}
            raise
    return given_noise(text, rate)


def _of_numbers(
    calibration: Calibration, reference: Mapping[str, tuple[float, str]]
) -> tuple[list[ReferenceNumber], tuple[str, ...]]:
    """Return compared numbers such as "gyro.N" (an axis before its sensor), and keys that match no axis."""
    numbers: dict[tuple[str, str], ReferenceNumber] = {}
    unmatched: list[str] = []
    for key in sorted(reference, key=lambda key: key.rpartition(".")[0] in calibration):
        place, _, symbol = key.rpartition(".")
        axes = [axis for axis in calibration if place in (axis, sensor_of(axis))]
        if symbol not in POWERS:
            raise OptionError(argument="reference", expected=f"of {', '.join(POWERS)}", got=key)
        for axis in axes:
            row = _row(axis, symbol, 0.0, calibration.datasheets[axis].get(symbol))
            value = as_reference(key, reference[key], row.unit).si
            numbers[axis, symbol] = replace(row, reference=value, verdict=_verdict(value, row.measured))
        if not axes:
            unmatched.append(key)
    return [numbers[key] for key in sorted(numbers, key=lambda key: (list(calibration).index(key[0]), key[1]))], tuple(
        unmatched
    )


def _of_axis(
    calibration: Calibration, axis: str, values: Values, given: Given, *, horizon: float
) -> Iterator[ReferenceNumber]:
    """Yield the compared numbers of one axis; N and K of a file with those that a file for the horizon has."""
    measured: Mapping[str, Entry] = calibration.datasheets[axis]
    written = given.written.get(axis, {})
    if written and not (horizon == DEFAULT_HORIZON_S and {"N", "K"} <= measured.keys()):
        noise = effective_noise(calibration[axis], horizon, calibration.settings.confidence)
        bounds = {symbol for symbol in noise if symbol in measured and measured[symbol].upper_only}
        measured = {**measured, **noise, **{symbol: as_limit(noise[symbol]) for symbol in bounds}}
    numbers, keys = {symbol: getattr(values, symbol) for symbol in POWERS}, dict(written)
    if values.sigma and values.time:
        # For times far below T, a Gauss-Markov process of standard deviation σ is a random walk with K = σ √(2/T).
        numbers["K"] = values.sigma * math.sqrt(2 / values.time)
        keys["K"] = written.get("sigma", ("sigma", None))
    for symbol in filter(numbers.get, numbers):
        key, raw = keys.get(symbol, ("", None))
        yield _row(axis, symbol, numbers[symbol], measured.get(symbol), key=key, written=raw)


def _row(
    axis: str, symbol: str, value: float, measured: Entry | None, *, key: str = "", written: float | None = None
) -> ReferenceNumber:
    verdict = _verdict(value, measured)
    return ReferenceNumber(
        axis=axis, symbol=symbol, reference=value, measured=measured, key=key, written=written, verdict=verdict
    )  # fmt: skip


def _with_use(row: ReferenceNumber, calibration: Calibration) -> ReferenceNumber:
    """Return a row with the verdict "unusable" if a remark says that the measured number must not be used."""
    use = calibration.number_verdicts[row.axis].get(row.symbol)
    # Without a remark, the number has no upper limit, but that for the horizon of a file can have one.
    refused = use is not None and use.usability is Usability.DO_NOT_USE and use.reason is not None
    return replace(row, verdict="unusable") if refused and row.verdict != "unknown" else row


def _verdict(reference: float, measured: Entry | None) -> Verdict:
    if measured is None or (measured.high is not None and not math.isfinite(measured.high)):
        return "unknown"
    value, low, high = abs(measured.value), measured.low, measured.high
    if measured.upper_only:
        assert high is not None
        return "agrees" if reference <= high else "close" if reference <= (1 + CLOSE_DIFFERENCE) * high else "larger"
    if low is not None and high is not None and low <= reference <= high:
        return "agrees"
    if abs(reference / value - 1) <= CLOSE_DIFFERENCE:
        return "close"
    return "larger" if reference > value else "smaller"


def _cause(row: ReferenceNumber, rate: float) -> str | None:
    """Return the conversion that a ratio or its inverse resembles: √rate, √3600 ("hour"), 180/π ("degree"), or None."""
    if row.ratio is None or max(row.ratio, 1 / row.ratio) < LEAST_UNIT_RATIO:
        return None
    distance = abs(math.log(row.ratio))
    for cause, size in {"rate": math.sqrt(rate), "hour": 60.0, "degree": 180 / math.pi}.items():
        # A remark names a conversion factor that is within 15 % of the ratio: more than most confidence intervals.
        if abs(distance - math.log(size)) < math.log1p(0.15) and size > LEAST_UNIT_RATIO:
            return cause
    return None


def _summary(found: ReferenceCheck, dialect: Dialect) -> str:
    """Return the text of `ReferenceCheck.summary`."""
    (verdict, *others), in_file = found.remarks, any(row.key for row in found)
    head = ["", *(["in the file"] if in_file else []), "reference", f"measured ({100 * found.level:g} % interval)"]
    head += [*(["measured, as in the file"] if in_file else []), "measured / reference", ""]
    rows = [head, *(_row_text(row, in_file) for row in found)]
    about = "numbers of a datasheet."
    if in_file:
        about = f"{found.name} ({found.format}, {found.rate:g} Hz). Measured N and K are for a filter with a horizon "
        about += f"of {found.horizon:g} s, as in exported files."
    parts = [f"Reference: {about}", *texts(others, dialect)]
    if found.unmatched:
        parts.append(f"The calibration does not have {', '.join(found.unmatched)}.")
    paragraphs = [wrap_text(texts([verdict], dialect)[0]), table_with_rule(rows), *map(wrap_text, parts)]
    return "\n\n".join("\n".join(lines) for lines in paragraphs)


def _row_text(row: ReferenceNumber, in_file: bool) -> list[str]:
    cells = [f"{row.axis} {row.symbol}"]
    if in_file:
        cells.append(row.key if row.written is None else f"{row.key} {row.written:.4g}")
    value, unit = row.shown
    limit = "≤ " if row.measured is not None and row.measured.upper_only else ""
    cells += [f"{significant(value, 3)} {unit}", "–" if row.measured is None else row.measured.text()]
    if in_file:
        shown = row.as_written
        cells.append("" if shown is None else f"{limit}{shown:.4g}")
    return [*cells, "" if row.ratio is None else limit + round_text(row.ratio, 3), _WORDS[row.verdict]]
