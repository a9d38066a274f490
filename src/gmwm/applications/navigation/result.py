"""Results of an error budget: navigation errors over time, and their summary."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import TYPE_CHECKING, Any

import numpy as np

from gmwm.base.arrays import Booleans, FrozenArrays, Vector
from gmwm.base.documents import plain, plain_fields
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect, Remark, texts
from gmwm.base.results import Plotted, Tabular, register
from gmwm.base.text import Summarised, align, duration_text, round_text, table_with_rule, wrap_text
from gmwm.calibration.tables import fitting_tables

if TYPE_CHECKING:
    from polars import DataFrame


@dataclass(frozen=True, kw_only=True, eq=False)
class Growth(FrozenArrays):
    """One navigation error over time, as a root mean square (1 σ).

    Attributes
    ----------
    name, title : str
        Name and title of the error, such as "tilt_x" and "tilt about x".
    unit : str
        "deg", "m/s" or "m".
    times : (T,) array, in s
        Times since the start of navigation, or averaging times of an alignment.
    error : (T,) array, in `unit`
        Root mean square of the error.
    low, high : (T,) arrays, in `unit`
        Confidence limits of `error`, from the covariance of the estimated parameters. Both are equal to `error` if the
        values of the model were given. If they differ by more than a factor of 10, `low` is 0, and `high` is at most
        the error that the measured wavelet variance allows.
    terms : mapping of label to (T,) array, in `unit`
        Contribution of each term of each axis. The root of the sum of their squares is `error`.
    """

    name: str
    title: str
    unit: str
    times: Vector
    error: Vector
    low: Vector
    high: Vector
    terms: Mapping[str, Vector]

    @property
    def certain(self) -> bool:
        """Whether there is no interval, because the values of the model were given."""
        return bool(np.all(self.low == self.high))

    @property
    def upper_only(self) -> Booleans:
        """Mask (T,) of the times at which the error has only an upper limit, `high`."""
        return np.asarray((self.low == 0) & (self.high > 0))

    @property
    def stated(self) -> Vector:
        """The error (T,) that texts and tables state: `error`, or the upper limit if there is only one."""
        return np.where(self.upper_only, self.high, self.error)

    def to_dict(self) -> dict[str, Any]:
        """Return the error as plain values for JSON."""
        return plain_fields(self, "title unit times error low high upper_only terms")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Budget(Summarised, Plotted, Tabular, Mapping[str, Growth]):
    """The error budget of unaided inertial navigation: a mapping of name to `Growth`.

    Attributes
    ----------
    growths : mapping of name to Growth
        Navigation errors with the names "tilt_x", "tilt_y", "heading", "velocity_x" … "velocity_z" and "position_x" …
        "position_z". An error is missing if none of its axes is known. Vertical errors are missing for durations above
        100 s.
    alignment : mapping of name to Growth
        Errors of a static alignment over the averaging time: "level_x" and "level_y" are the tilt from averaged
        accelerometers, "north_x" and "north_y" the heading from an averaged gyroscope that points east.
    duration, rest : float
        Time of navigation, and time at rest before navigation (s).
    latitude : float
        Latitude (deg).
    gravity : float
        Gravity (m/s²).
    level : float
        Confidence level of the intervals.
    remarks : tuple of Remark
        Remarks on durations that the recordings do not support, missing axes and approximations.
    """

    growths: Mapping[str, Growth]
    alignment: Mapping[str, Growth]
    duration: float
    rest: float
    latitude: float
    gravity: float
    level: float
    remarks: tuple[Remark, ...] = ()

    def __getitem__(self, name: str) -> Growth:
        if name in self.alignment:
            return self.alignment[name]
        return self.growths[name]

    def __iter__(self) -> Iterator[str]:
        return iter((*self.growths, *self.alignment))

    def __len__(self) -> int:
        return len(self.growths) + len(self.alignment)

    @property
    def times(self) -> Vector:
        """Times of the errors (s), as a (T,) array. The last time is the duration."""
        return next(iter(self.values())).times

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Return the budget as text: the final errors with their largest terms, the errors at several times, and the
        remarks in a `dialect`."""
        return summary(self, dialect)

    def compare(self, other: Budget, labels: tuple[str, str] = ("this", "other")) -> str:
        """Return a table that compares this budget with an `other`: the errors at the end, and their ratios.

        `labels` are the names of the two budgets. If they have no error in common, or differ in duration, time at rest
        or latitude, an OptionError is raised."""

        return comparison(self, other, labels)

    def to_dict(self) -> dict[str, Any]:
        """Return the budget as plain values for JSON."""
        facts = plain_fields(self, "duration rest latitude gravity level")
        return facts | {"growth": plain(self.growths), **plain_fields(self, "alignment remarks")}

    coordinates = ("error", "time")

    def to_polars(self) -> DataFrame:
        """Return the errors as a Polars data frame, with one row for each error and time."""
        from polars import DataFrame

        rows = [
            {"error": name, "unit": growth.unit, "time": t, "value": v, "low": low, "high": high, "upper_only": upper}
            for name, growth in self.items()
            for t, v, low, high, upper in zip(
                growth.times, growth.error, growth.low, growth.high, growth.upper_only.tolist(), strict=True
            )
        ]
        return DataFrame(rows, infer_schema_length=None)


register(Budget, "gmwm.applications.navigation.plot:plot_budget")


SHOWN = (1.0, 10.0, 60.0, 600.0, 3600.0, 36000.0)
"""Times (s) for which the table shows the errors, in addition to the duration."""
RIGHT_ANGLE = 90.0
"""Alignment errors above this angle (deg) are not shown as numbers, because the direction is then unknown."""
_KINDS = {
    "tilt": ("tilt_x", "tilt_y"), "heading": ("heading",), "velocity": ("velocity_x", "velocity_y"),
    "position": ("position_x", "position_y"), "height": ("position_z",),
}  # fmt: skip
"""Columns of the table of errors over time. A column shows the largest of the errors in its list."""


def summary(budget: Budget, dialect: Dialect) -> str:
    """Return the text of `Budget.summary`."""
    growths = budget.growths.values()
    interval = "" if all(growth.certain for growth in growths) else f", {100 * budget.level:g} % interval"
    rows = [("error (1 σ)", f"after {duration_text(budget.duration)}{interval}", "largest contributions")]
    rows += [(growth.title, error_text(growth), terms_text(growth)) for growth in growths]
    lines = [*wrap_text(headline(budget)), *wrap_text(start(budget)), "", *_table(rows, (17, 28, 29))]
    if len(budget.times) > 1:
        lines += ["", "Growth, largest of the horizontal directions", *_growth(budget)]
    if budget.alignment:
        title = f"Static alignment: error of a mean (deg), gyro-compassing at {budget.latitude:g}° latitude"
        lines += ["", *wrap_text(title), *_alignment(budget)]
    lines += ["", *(part for line in method(budget) for part in wrap_text(line))]
    return "\n".join([*lines, *(part for line in texts(budget.remarks, dialect) for part in wrap_text(line))])


def headline(budget: Budget) -> str:
    """Return one sentence with the largest tilt, heading and position errors at the end of the duration."""
    parts = [
        f"{kind} {number_text(worst, budget.duration)} {worst.unit}"
        for kind in ("tilt", "heading", "position")
        if (worst := largest(budget, kind)) is not None
    ]
    return f"After {duration_text(budget.duration)} of navigation without corrections: {', '.join(parts)} (1 σ)."


def start(budget: Budget) -> str:
    """Return one sentence with the rule for the start of all terms."""
    if not budget.rest:
        return "Start: for all terms, the biases and the level are known exactly."
    time = duration_text(budget.rest)
    return f"Start: for all terms, the bias and the level are those of a filter with N and K after {time} at rest."


def largest(budget: Budget, kind: str) -> Growth | None:
    """Return the error of a kind, such as "tilt", that is largest at the end of the duration; None if there is none."""
    candidates = [budget.growths[name] for name in _KINDS[kind] if name in budget.growths]
    return max(candidates, key=lambda growth: float(growth.stated[-1]), default=None)


def number_text(one: Growth, time: float, largest_number: float = np.inf) -> str:
    """Format an error at a time (s) or its limit, interpolated on logarithmic scales, or only `largest_number`."""
    with np.errstate(divide="ignore"):
        value = float(np.exp(np.interp(np.log(time), np.log(one.times), np.log(one.stated))))
    if value >= largest_number:
        return f"> {largest_number:g}"
    limit = bool(one.upper_only[min(int(np.searchsorted(one.times, time)), len(one.times) - 1)])
    return f"{'≤ ' if limit else ''}{round_text(value, 3)}"


def error_text(one: Growth, k: int = -1) -> str:
    """Format an error at the k-th time with its interval and unit. The default is the last time."""
    value, low, high = (float(values[k]) for values in (one.error, one.low, one.high))
    if low == high:
        return f"{round_text(value, 3)} {one.unit}"
    if one.upper_only[k]:
        return f"≤ {round_text(high, 3)} {one.unit}"
    return f"{round_text(value, 3)} ({round_text(low, 3)} … {round_text(high, 3)}) {one.unit}"


def merged_terms(growth: Growth) -> dict[str, Vector]:
    """Return the terms of an error. The oscillations of an axis are one term, the root of their sum of squares."""
    terms: dict[str, Vector] = {}
    for term, values in growth.terms.items():
        label = re.sub(r" OSC(\[\d+\])?$", " oscillations", term)
        terms[label] = np.hypot(terms.get(label, 0.0), values)
    return terms


def terms_text(one: Growth) -> str:
    """Format the largest contributions to an error at the last time, as in "gyro_x RW 0.25, WN 0.1, gyro_y WN 0.02"."""
    parts = sorted(((float(values[-1]), label) for label, values in merged_terms(one).items()), reverse=True)
    named, last = list[str](), ""
    for value, label in [part for part in parts if part[0] > 0.05 * float(one.error[-1])][:3]:
        axis, _, term = label.partition(" ")
        named.append(f"{term if axis == last else label} {round_text(value, 2)}")
        last = axis
    return ", ".join(named)


def _growth(budget: Budget) -> list[str]:
    kinds = {kind: growth for kind in _KINDS if (growth := largest(budget, kind)) is not None}
    rows: list[Sequence[str]] = [("time", *(f"{kind} ({growth.unit})" for kind, growth in kinds.items()))]
    for time in shown_times(budget):
        rows.append((duration_text(time), *(number_text(growth, time) for growth in kinds.values())))
    return table_with_rule(rows)


def _alignment(budget: Budget) -> list[str]:
    times = shown_times(budget)

    def rows(heads: Sequence[str], part: range) -> list[list[str]]:
        growths = budget.alignment.values()
        return [["mean over", *heads]] + [
            [growth.title, *(number_text(growth, times[k], RIGHT_ANGLE) for k in part)] for growth in growths
        ]

    return fitting_tables([duration_text(time) for time in times], rows)


def shown_times(budget: Budget) -> list[float]:
    """Return the times (s) for which the tables show the errors."""
    inside = [time for time in SHOWN if budget.times[0] <= time < 0.99 * budget.duration]
    return [*inside, budget.duration]


def method(budget: Budget) -> list[str]:
    """Return sentences that state the assumptions of the budget."""
    return [
        f"A level vehicle at rest at {budget.latitude:g}° latitude, x north: linear error equations with the rotation "
        "of the Earth.",
        "Constant biases, scale factors and misalignments are not included.",
    ]


def comparison(one: Budget, other: Budget, labels: tuple[str, str] = ("this", "other")) -> str:
    """Return the text of `Budget.compare`."""
    for name in ("duration", "rest", "latitude"):
        if getattr(one, name) != getattr(other, name):
            raise OptionError(argument="other", expected=f"a budget with the same {name}", got=getattr(other, name))
    rows: list[Sequence[str]] = [("error (1 σ)", *labels, "ratio")]
    for name in (name for name in one if name in set(other)):
        ratio = float(other[name].stated[-1]) / float(one[name].stated[-1]) if one[name].stated[-1] > 0 else np.inf
        rows.append((one[name].title, error_text(one[name]), error_text(other[name]), f"{ratio:.2f}"))
    if len(rows) == 1:
        raise OptionError(argument="other", expected=f"a budget of {', '.join(one)}", got=", ".join(other))
    title = f"After {duration_text(one.duration)} of navigation without corrections"
    return "\n".join([title, *_table(rows, (17, 25, 25, 8))])


def _table(rows: Sequence[Sequence[str]], widths: Sequence[int]) -> list[str]:
    """Format a table. Cells wider than their column continue below, broken before brackets and after commas."""
    blank = "\N{NO-BREAK SPACE}"
    folded: list[list[Sequence[str]]] = []
    for name, *cells in rows:
        texts = [cell.replace(" ", blank).replace(f",{blank}", ", ").replace(f"{blank}(", " (") for cell in cells]
        parts = (textwrap.wrap(text, width) for text, width in zip((name, *texts), widths, strict=True))
        folded.append([[part.replace(blank, " ") for part in row] for row in zip_longest(*parts, fillvalue="")])
    lines = align([line for row in folded for line in row])
    lines.insert(len(folded[0]), "  " + "─" * (max(map(len, lines)) - 2))
    return lines
