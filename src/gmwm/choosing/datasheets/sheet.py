"""The datasheet of one axis: a collection of datasheet numbers that can be shown as text, table or plain values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from gmwm.base.arrays import FrozenArrays, Vector
from gmwm.base.frames import Tabular
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.text import align
from gmwm.choosing.datasheets.entry import Entry, significant

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Datasheet(FrozenArrays, Tabular, Mapping[str, Entry]):
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
        rows = [(entry.symbol, _title(entry), entry.text(units), _also(entry, units)) for entry in self.entries]
        about = (remark.about("") for remark in self.remarks)
        return "\n".join([self._head(), *align(rows), *texts(about)])

    def _head(self) -> str:
        axis = f"{self.axis}: " if self.axis else ""
        return f"{axis}{self.model}, {self.samples} samples at {self.rate:g} Hz, {100 * self.level:g} % intervals"

    def to_dict(self) -> dict[str, Any]:
        """Return the datasheet as plain values for JSON."""
        return {
            "axis": self.axis, "unit": self.unit, "model": self.model, "samples": self.samples, "rate": self.rate,
            "level": self.level, "entries": [entry.to_dict() for entry in self.entries],
            "averaging_time": self.averaging_time.tolist(), "allan_deviation": self.allan_deviation.tolist(),
            "remarks": [remark.to_dict() for remark in self.remarks],
        }  # fmt: skip

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Datasheet:
        """Restore a datasheet from `values`, the result of `to_dict`."""
        given = dict(values)
        given["entries"] = tuple(Entry.from_dict(entry) for entry in values["entries"])
        given["remarks"] = tuple(Remark.from_dict(remark) for remark in values["remarks"])
        for name in ("averaging_time", "allan_deviation"):
            given[name] = np.array(values[name], dtype=np.float64)
        return cls(**given)

    def __repr__(self) -> str:
        return f"Datasheet({self.axis or 'unnamed'}: {'; '.join(str(entry) for entry in self.entries)})"

    def _repr_html_(self) -> str:
        rows = "".join(
            f"<tr><td>{escape(entry.symbol)}</td><td>{escape(_title(entry))}</td><td>{escape(entry.text())}</td>"
            f"<td>{escape(entry.text('si'))}</td></tr>"
            for entry in self.entries
        )
        about = (remark.about("") for remark in self.remarks)
        remarks = "".join(f"<p>{text}</p>" for text in texts(about, Dialect.HTML))
        return (
            f"<div><b>{escape(self._head())}</b><table><thead><tr><th></th><th>quantity</th><th>datasheet</th>"
            f"<th>SI</th></tr></thead><tbody>{rows}</tbody></table>{remarks}</div>"
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
