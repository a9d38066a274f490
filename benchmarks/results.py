"""What a run of the suite found, as plain data, and how to find a number in it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

Row = Mapping[str, Any]


class Results:
    """The numbers of one run: `timings`, `curves`, `children` and `recordings` as lists of rows, `machine` as texts."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.machine: Mapping[str, str] = values["machine"]
        self.bandwidth = float(values["copy_bandwidth_bytes_per_s"])
        self.timings: Sequence[Row] = values["timings"]
        self.curves: Sequence[Row] = values["curves"]
        self.children: Sequence[Row] = values["children"]
        self.recordings: Sequence[Row] = values["recordings"]

    def timing(self, name: str, against: str) -> Row:
        """One comparison."""
        return _only(self.timings, name=name, against=against)

    def ratio(self, name: str, against: str = "np.cumsum of 10^6") -> float:
        """Our time over that of the reference."""
        return float(self.timing(name, against)["ratio_median"])

    def took(self, name: str, against: str = "np.cumsum of 10^6") -> float:
        """Our time (s)."""
        return float(self.timing(name, against)["seconds"])

    def curve(self, name: str) -> Row:
        """The times of one method."""
        return _only(self.curves, name=name)

    def per_sample(self, name: str, samples: int) -> float:
        """Time of one sample (s) in a record of so many."""
        curve = self.curve(name)
        return float(curve["seconds"][list(curve["at"]).index(samples)]) / samples

    def most(self, name: str) -> int:
        """The longest record of a curve."""
        return int(self.curve(name)["at"][-1])

    def child(self, name: str, samples: int | None = None) -> Row:
        """A process; of several with one name that of so many samples, the largest by default."""
        rows = [row for row in self.children if row["name"] == name and samples in (None, row["samples"])]
        return _only(rows, samples=max((row["samples"] for row in rows), default=0), name=name)


def _only(rows: Sequence[Row], **wanted: object) -> Row:
    found = [row for row in rows if all(row[key] == value for key, value in wanted.items())]
    if len(found) != 1:
        raise LookupError(f"{len(found)} results of {wanted}; one is needed: was the whole suite run?")
    return found[0]
