"""The numbers that several recordings of one unit share, and the verdict on each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from gmwm._text import Summarised
from gmwm.calibration.agreement_text import summary
from gmwm.calibration.reference import Reference
from gmwm.datasheets import Entry


@dataclass(frozen=True, kw_only=True)
class SharedNumber:
    """One number of one axis, as several recordings give it.

    Attributes
    ----------
    axis, symbol, title, unit : str
        Which one it is, and its SI unit.
    entries : tuple of Entry or None
        As each recording gives it; None where it does not.
    pvalue : float or None
        Of numbers that differ so much or more if there is but one; None where they are not compared.
    adjusted : float or None
        The same with all numbers that were compared in mind, by Holm.
    agrees : bool or None
        Whether `adjusted` is above the size of the test; None where they are not compared.
    reason : str
        Why they are not compared: "one recording", "models", "kinds" (read in different ways), "interval"; else "".
    reference : Reference or None
        The maker's value.
    """

    axis: str
    symbol: str
    title: str
    unit: str
    entries: tuple[Entry | None, ...]
    pvalue: float | None = None
    adjusted: float | None = None
    agrees: bool | None = None
    reason: str = ""
    reference: Reference | None = None

    @property
    def apart(self) -> float | None:
        """The largest over the smallest value, less 1; None without two values, or with signs."""
        values = [entry.value for entry in self.entries if entry is not None and not entry.upper_only]
        return max(values) / min(values) - 1 if len(values) > 1 and min(values) > 0 else None

    @property
    def ratios(self) -> tuple[float | None, ...]:
        """Ours over the maker's, for each recording; of an upper limit where there is no value. None without them."""
        if self.reference is None:
            return (None,) * len(self.entries)
        shown = [None if entry is None else entry.high if entry.upper_only else entry.value for entry in self.entries]
        return tuple(None if value is None else abs(value) / self.reference.si for value in shown)

    def to_dict(self) -> dict[str, Any]:
        """The number as plain numbers, lists and texts, ready for JSON."""
        return {
            "axis": self.axis, "symbol": self.symbol, "title": self.title, "unit": self.unit,
            "entries": [None if entry is None else entry.to_dict() for entry in self.entries],
            "apart": self.apart, "pvalue": self.pvalue, "adjusted": self.adjusted, "agrees": self.agrees,
            "reason": self.reason, "reference": None if self.reference is None else self.reference.to_dict(),
            "ratios": list(self.ratios),
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Agreement(Summarised, Sequence[SharedNumber]):
    """Every number of several recordings of one unit, and which of them differ by more than chance.

    Attributes
    ----------
    labels : tuple of str
        What the recordings are called.
    rows : tuple of SharedNumber
        All numbers, axis by axis.
    models : mapping of axis to tuple of (str or None)
        The model of each recording, None where it has no such axis.
    rejected : mapping of axis to tuple of str
        Recordings whose model a test of the fit rejects there: their intervals are too narrow.
    size : float
        Probability of any disagreement where there is none.
    unmatched : tuple of str
        References that no recording has a number for.
    failed : mapping of axis to tuple of str
        Recordings that have the axis, but that it could not be calibrated in.
    """

    labels: tuple[str, ...]
    rows: tuple[SharedNumber, ...]
    models: Mapping[str, tuple[str | None, ...]]
    rejected: Mapping[str, tuple[str, ...]]
    size: float
    unmatched: tuple[str, ...] = ()
    failed: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def compared(self) -> tuple[SharedNumber, ...]:
        """The numbers that were tested."""
        return tuple(row for row in self.rows if row.agrees is not None)

    @property
    def disagreeing(self) -> tuple[SharedNumber, ...]:
        """The numbers that differ by more than chance."""
        return tuple(row for row in self.rows if row.agrees is False)

    def __getitem__(self, index: Any) -> Any:
        """A number by its place, or by its name as "gyro_x.N"."""
        if not isinstance(index, str):
            return self.rows[index]
        for row in self.rows:
            if f"{row.axis}.{row.symbol}" == index:
                return row
        raise KeyError(f"no {index!r}; there are {', '.join(f'{row.axis}.{row.symbol}' for row in self.rows)}")

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[SharedNumber]:
        return iter(self.rows)

    def summary(self) -> str:
        """The numbers side by side in the units of datasheets, those that differ, and the maker's; 80 columns wide."""
        return summary(self)

    def to_dict(self) -> dict[str, Any]:
        """All of it as plain numbers, lists and texts, ready for JSON."""
        return {
            "labels": list(self.labels),
            "size": self.size,
            "compared": len(self.compared),
            "disagreeing": [f"{row.axis}.{row.symbol}" for row in self.disagreeing],
            "models": {axis: list(models) for axis, models in self.models.items()},
            "rejected": {axis: list(labels) for axis, labels in self.rejected.items()},
            "unmatched": list(self.unmatched),
            "failed": {axis: list(labels) for axis, labels in self.failed.items()},
            "rows": [row.to_dict() for row in self.rows],
        }

    def __repr__(self) -> str:
        return f"Agreement({len(self.compared)} numbers compared, {len(self.disagreeing)} differ)"
