"""A datasheet and its numbers, with confidence intervals and units."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gmwm.base.arrays import FrozenArrays, Vector
from gmwm.base.documents import Documented
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.results import Tabular
from gmwm.base.text import align, html_table, round_text, with_minus
from gmwm.base.units import datasheet_units, spelt

if TYPE_CHECKING:
    from polars import DataFrame

_DIGITS = 2
"""Number of significant digits to which half the width of an interval is rounded, as is usual for standard errors."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One datasheet number with its confidence interval.

    Parameters
    ----------
    symbol : str
        "N", "Q", "K", "R" or "B"; "T_c" and "q_c" of a Gauss-Markov term; "f_b", "f_r" and "Q_r" of an ARMA term;
        "f_0" and "A" of a sinusoid. If there are several such terms, the symbol has an index, for example "T_c[2]".
    title : str
        Name of the number, for example "white noise density".
    value : float
        Value in `unit`. Only the rate ramp R can be negative.
    low, high : float or None
        Ends of the confidence interval in `unit`. `high` is infinite if the data do not determine the number. Both are
        None if there is no interval.
    unit : str
        SI unit. In it, "u" stands for the unknown unit of a signal.
    term : str or None
        Term of the model from which the number is computed; None if it is computed from the whole model.
    upper_only : bool
        Whether the data give only an upper limit, so that the magnitude of the number is at most `high`.
    held : bool
        Whether the number was held fixed instead of estimated.
    tau : float or None
        Averaging time (s) at which the number is read from the Allan deviation; None for other numbers.
    frequency : float or None
        Frequency (Hz) of the line or oscillation that the number describes; None for other numbers.

    Examples
    --------
    >>> entry = Entry(
    ...     symbol="N", title="white noise density", value=1.0e-4, low=0.9e-4, high=1.1e-4, unit="rad/s/√Hz", term="WN"
    ... )
    >>> entry.text()
    '0.344 (0.309 … 0.378) deg/√h'
    >>> entry.text("si")
    '1.00e-04 (9.00e-05 … 1.10e-04) rad/s/√Hz'
    """

    symbol: str
    title: str
    value: float
    low: float | None
    high: float | None
    unit: str
    term: str | None = None
    upper_only: bool = False
    held: bool = False
    tau: float | None = None
    frequency: float | None = None

    @property
    def name(self) -> str:
        """The symbol for readers. A number of an oscillation has its frequency instead of its place in the model."""
        if self.frequency is None:
            return self.symbol
        return f"{self.symbol.partition('[')[0]} at {round_text(self.frequency, 3)} Hz"

    @property
    def units(self) -> tuple[str, ...]:
        """Units to which the number can be converted. The first is the usual datasheet unit, the last the SI unit."""
        return tuple(dict.fromkeys((*datasheet_units(self.unit), self.unit)))

    def in_units(self, units: str = "datasheet") -> tuple[float, float | None, float | None, str]:
        """Convert the number to another unit.

        Parameters
        ----------
        units : str
            "si", "datasheet" (the usual datasheet unit, or SI if there is none), or one of `units`, for example
            "µg/√Hz". √ may be written sqrt.

        Returns
        -------
        value, low, high : float, and float or None
            The number and the ends of its interval, in this unit.
        unit : str
            Name of the unit.

        Raises
        ------
        OptionError
            If the number cannot be converted to this unit.
        """
        factors = {self.unit: 1.0, **datasheet_units(self.unit)}
        named = {"si": self.unit, "datasheet": self.units[0]} | {spelt(name): name for name in factors}
        name = named.get(units) or named.get(spelt(units), "")
        if not name:
            raise OptionError(
                argument="units", expected=f"'si', 'datasheet' or one of {', '.join(self.units)}", got=units
            )
        factor = factors[name]
        return (
            factor * self.value, None if self.low is None else factor * self.low,
            None if self.high is None else factor * self.high, name,
        )  # fmt: skip

    def text(self, units: str = "datasheet") -> str:
        """Format the number in `units` (see `in_units`), for example "0.21 (0.20 … 0.22) deg/√h" or "≤ 0.03 deg/h"."""
        value, low, high, unit = self.in_units(units)
        unit = "" if unit == "1" else f" {unit}"
        if self.held:
            return f"{significant(value, 4)}{unit} (fixed)"
        if low is None or high is None:
            return f"{significant(value, 4)}{unit}"
        if not math.isfinite(high):
            return "not determined"
        if self.upper_only:
            return f"{'≤' if low >= 0 else 'within ±'} {significant(high, 3)}{unit}".replace("± ", "±")
        shown = _alike(value, low, high)
        return with_minus(f"{shown[0]} ({shown[1]} … {shown[2]}){unit}")

    def to_dict(self) -> dict[str, Any]:
        """Return all fields as plain values for JSON. An infinite limit becomes None."""
        values = asdict(self)
        if self.frequency is None:
            del values["frequency"]
        if self.high is not None and not math.isfinite(self.high):
            values["high"] = None
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Entry:
        """Restore an entry from `values`, the result of `to_dict`."""
        fields = dict(values)
        if fields["low"] is not None and fields["high"] is None:
            fields["high"] = math.inf
        return cls(**fields)

    def __str__(self) -> str:
        return f"{self.name} = {self.text()}".replace("= ≤", "≤")


def significant(x: float, digits: int) -> str:
    """Format a number with a given number of significant digits, with a power of ten if very small or large.

    >>> significant(0.012345, 3), significant(1.5e-7, 2), significant(1234.5, 2)
    ('0.0123', '1.5e-07', '1234')
    """
    if x == 0 or not math.isfinite(x):
        return f"{x:g}"
    if not 1e-3 <= abs(x) < 1e5:
        return f"{x:.{digits - 1}e}"
    return f"{x:.{max(0, digits - 1 - math.floor(math.log10(abs(x))))}f}"


def _alike(value: float, low: float, high: float) -> tuple[str, str, str]:
    """Format a value and limits with equal decimals (`_DIGITS` of the interval), or each if they differ much."""
    most_digits = 6
    size, half = max(abs(low), abs(high)), (high - low) / 2
    if low <= 0 < high or abs(high - low) > min(abs(low), abs(high)):
        return significant(value, _DIGITS), significant(low, _DIGITS), significant(high, _DIGITS)
    digits = most_digits
    if half > 0:
        digits = min(most_digits, _DIGITS + math.floor(math.log10(size)) - math.floor(math.log10(half)))
    if not 1e-3 <= size < 1e5:
        return f"{value:.{digits - 1}e}", f"{low:.{digits - 1}e}", f"{high:.{digits - 1}e}"
    decimals = max(0, digits - 1 - math.floor(math.log10(size)))
    return f"{value:.{decimals}f}", f"{low:.{decimals}f}", f"{high:.{decimals}f}"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Datasheet(FrozenArrays, Documented, Tabular, Mapping[str, Entry]):
    """Datasheet numbers of one axis: a mapping of symbol to `Entry`. The numbers are in SI units and can be converted.

    Attributes
    ----------
    entries : tuple of Entry
        The numbers, in the order Q, N, B, K, R, T_c, q_c, f_b, f_r, Q_r, f_0, A.
    axis : str
        Name of the axis; "" if it has none.
    unit : str
        SI unit of the signal; "u" if it is unknown.
    model : str
        Structure of the model, for example "2*GM + WN".
    samples : int
        Number of samples of the recording.
    rate : float
        Sampling rate (Hz).
    level : float
        Confidence level of the intervals.
    averaging_time : (J,) array, in s
        Averaging times of `allan_deviation`, up to the longest that the recording allows.
    allan_deviation : (J,) array, in `unit`
        Allan deviation of the model.
    remarks : tuple of Remark
        Remarks on the numbers.

    Examples
    --------
    >>> import gmwm
    >>> x = gmwm.WN(sigma2=1e-6).simulate(10_000, 100.0, rng=1)
    >>> sheet = gmwm.fit(gmwm.WN(), gmwm.Signal(x, 100.0, "rad/s")).datasheet()
    >>> sheet["N"].unit, sheet["N"].in_units("deg/√h")[3]
    ('rad/s/√Hz', 'deg/√h')
    """

    shares: ClassVar[tuple[str, ...]] = ("level",)
    document_keys = (
        "axis", "unit", "model", "samples", "rate", "level", "entries", "averaging_time", "allan_deviation", "remarks",
    )  # fmt: skip

    entries: tuple[Entry, ...]
    axis: str
    unit: str
    model: str
    samples: int
    rate: float
    level: float
    averaging_time: Vector
    allan_deviation: Vector
    remarks: tuple[Remark, ...] = ()

    def __getitem__(self, symbol: str) -> Entry:
        for entry in self.entries:
            if entry.symbol == symbol:
                return entry
        raise KeyError(f"the model {self.model} has no {symbol}; it has {', '.join(self)}")

    def __iter__(self) -> Iterator[str]:
        return (entry.symbol for entry in self.entries)

    def __len__(self) -> int:
        return len(self.entries)

    @property
    def horizon(self) -> float:
        """Longest averaging time (s) of the recording."""
        return float(self.averaging_time[-1])

    def table(self, units: str = "datasheet") -> list[dict[str, Any]]:
        """Return the numbers as rows with symbol, title, value, low, high, unit, upper_only, term and text.

        Parameters
        ----------
        units : "si" or "datasheet"
            Units of the numbers, as in `Entry.in_units`.
        """
        rows = []
        for entry in self.entries:
            value, low, high, unit = entry.in_units(units)
            rows.append(
                {"symbol": entry.symbol, "title": entry.title, "value": value, "low": low, "high": high, "unit": unit,
                 "upper_only": entry.upper_only, "term": entry.term, "text": entry.text(units)}
            )  # fmt: skip
        return rows

    coordinates = ("symbol",)

    def to_polars(self, units: str = "datasheet") -> DataFrame:
        """Return the rows of `table` as a Polars data frame.

        Parameters
        ----------
        units : "si" or "datasheet"
            Units of the numbers, as in `Entry.in_units`.
        """
        from polars import DataFrame

        return DataFrame(self.table(units))

    def summary(self, units: str = "datasheet") -> str:
        """Return the datasheet as text: the numbers with intervals and in another common unit, and the remarks.

        Parameters
        ----------
        units : "si" or "datasheet"
            Units of the numbers, as in `Entry.in_units`.
        """
        rows = [(entry.name, _title(entry), entry.text(units), _also(entry, units)) for entry in self.entries]
        about = (remark.about("") for remark in self.remarks)
        return "\n".join([self._head(), *align(rows), *texts(about)])

    def _head(self) -> str:
        axis = f"{self.axis}: " if self.axis else ""
        return f"{axis}{self.model}, {self.samples} samples at {self.rate:g} Hz, {100 * self.level:g} % intervals"

    def __repr__(self) -> str:
        return f"Datasheet({self.axis or 'unnamed'}: {'; '.join(str(entry) for entry in self.entries)})"

    def _repr_html_(self) -> str:
        rows = ((entry.name, _title(entry), entry.text(), entry.text("si")) for entry in self.entries)
        about = (remark.about("") for remark in self.remarks)
        remarks = "".join(f"<p>{text}</p>" for text in texts(about, Dialect.HTML))
        return (
            f"<div><b>{escape(self._head())}</b>{html_table(('', 'quantity', 'datasheet', 'SI'), rows)}{remarks}</div>"
        )


def _title(entry: Entry) -> str:
    return entry.title if entry.tau is None else f"{entry.title} at {significant(entry.tau, 2)} s"


def _also(entry: Entry, units: str) -> str:
    """Format a number, or its upper limit, in another common unit; "" if there is none or the limit is infinite."""
    shown = entry.in_units(units)[3]
    other = next((name for name in entry.units if name != shown), None)
    if other is None or (entry.high is not None and not np.isfinite(entry.high)):
        return ""
    value, low, high, unit = entry.in_units(other)
    if entry.upper_only and high is not None and low is not None:
        return f"{'≤ ' if low >= 0 else '±'}{significant(high, 3)} {unit}"
    return f"{significant(value, 3)} {unit}"
