"""gmwm fit --conditions: fit one model to a recording at known conditions, which are constant in its parts or move."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

import gmwm
from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError, ReadError
from gmwm.cli.output import NewFile, Outcome, json_text, make_directory, optional_plots, over_axes, plot_file, text_file
from gmwm.cli.read_options import chosen_names, load
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.fitting.estimation import ConditionsFit

_EXPECTED = "a table with the columns start, stop and the condition, or time and the condition: `start,stop,rate`"


@dataclass(frozen=True)
class ConditionTable:
    """The parts of a recording during which a condition, such as the temperature or the rate, had a known value."""

    condition: str  # name of the condition
    # for each value of the condition, the times (s from the first sample) between which it had this value
    parts: Mapping[float, list[tuple[float, float]]]

    @classmethod
    def of_rows(cls, head: list[str], rows: list[list[float]], path: Path) -> ConditionTable:
        """Return the table of a CSV file with the columns start, stop and the condition."""
        if len(head) != 3 or head[:2] != ["start", "stop"] or not head[2].isidentifier():
            raise ReadError(f"{path} is not {_EXPECTED}", argument="conditions", got=",".join(head))
        parts: dict[float, list[tuple[float, float]]] = {}
        for number, (start, stop, condition) in enumerate(rows, 2):
            if not 0 <= start < stop:
                reason = (
                    f"{path}, row {number}: the start, {start:g} s, must be 0 or more and before the stop, {stop:g} s"
                )
                raise ReadError(reason, argument="conditions", got=(start, stop, condition))
            parts.setdefault(condition, []).append((start, stop))
        for (_, stop), (start, _) in pairwise(sorted(pair for intervals in parts.values() for pair in intervals)):
            if start < stop:
                raise ReadError(f"{path}: two parts overlap between {start:g} s and {stop:g} s", argument="conditions")
        return cls(head[2], {condition: sorted(intervals) for condition, intervals in sorted(parts.items())})

    def of(self, recording: gmwm.Imu) -> dict[float, gmwm.Imu]:
        """Return a recording for each value of the condition. It has a gap between two separate parts."""
        recordings = {}
        for condition, intervals in self.parts.items():
            gaps = [(stop, start) for (_, stop), (start, _) in pairwise(intervals) if stop < start]
            recordings[condition] = recording.between(intervals[0][0], intervals[-1][1], skip=gaps)
        return recordings


@dataclass(frozen=True)
class ConditionCourse:
    """A condition that moves during a recording: its values at times (s from the first sample)."""

    condition: str
    times: Vector
    values: Vector

    @classmethod
    def of_rows(cls, head: list[str], rows: list[list[float]], path: Path) -> ConditionCourse:
        """Return the course of a CSV file with the columns time and the condition."""
        times, values = np.array(rows).reshape(-1, 2).T
        if times.size < 2 or np.any(np.diff(times) <= 0):
            raise ReadError(f"{path}: two or more ascending times are needed", argument="conditions")
        return cls(head[1], times, values)

    def of(self, signal: gmwm.Signal) -> Vector:
        """Return the condition at the samples of a signal, interpolated linearly."""
        times = signal.times() - signal.times(np.array([0]))
        if times[0] < self.times[0] or times[-1] > self.times[-1] + 1 / signal.rate:
            raise OptionError(
                f"the recording takes {times[-1]:g} s, but the {self.condition} is known from {self.times[0]:g} to "
                f"{self.times[-1]:g} s", argument="conditions",
            )  # fmt: skip
        return np.interp(times, self.times, self.values)


def _rows(path: Path) -> tuple[list[str], list[list[float]]]:
    """Return the head of a CSV file of a condition, and its rows of numbers."""
    try:
        rows = [row for row in csv.reader(path.read_text(encoding="utf-8-sig").splitlines()) if row]
    except (OSError, UnicodeDecodeError) as error:
        raise ReadError(f"{path} cannot be read: {error}", argument="conditions") from error
    head = [cell.strip() for cell in rows[0]] if rows else []
    numbers = []
    for number, row in enumerate(rows[1:], 2):
        try:
            numbers.append([float(cell) for cell in row])
        except ValueError:
            numbers.append([])
        if len(numbers[-1]) != len(head):
            reason = f"{path}, row {number}: {len(head)} numbers were expected, not {','.join(row)!r}"
            raise ReadError(reason, argument="conditions", got=row)
    return head, numbers


def read_table(path: Path) -> ConditionTable | ConditionCourse:
    """Read the table of a condition that was constant in parts of a recording, or that moved."""
    head, rows = _rows(path)
    moves = len(head) == 2 and head[0] == "time" and head[1].isidentifier()
    return (ConditionCourse if moves else ConditionTable).of_rows(head, rows, path)


def as_varies(texts: Sequence[str]) -> dict[str, str]:
    """Parse the values of --varies, and return the sum of functions of each term of the model.

    >>> as_varies(["WN: 1 + rate**2"])
    {'WN': '1 + rate**2'}
    """
    sums = {}
    for text in texts:
        term, colon, functions = text.partition(":")
        if not colon or not functions.strip() or term.strip() in sums:
            raise OptionError(argument="varies", expected="a term and its functions, as in 'WN: 1 + rate**2'", got=text)
        sums[term.strip()] = functions.strip()
    return sums


def require_unused(conditions: bool, *, varies: bool, **others: bool) -> None:
    """Check that no option is given that cannot be combined with --conditions, or that needs it."""
    if varies and not conditions:
        raise OptionError("--varies needs --conditions", argument="varies", advice="Add {--conditions}.")
    if conditions and (name := next((name for name, present in others.items() if present), None)):
        raise OptionError(argument=name, expected="left out with --conditions", advice="Leave it out.")


def fit_conditions(
    file: Path, reading: ReadOptions, model: gmwm.Model, table: Path, varies: Sequence[str], axis: Sequence[str] | None,
    *, weighting: Literal["diagonal", "optimal", "identity"] | None, robust: bool, efficiency: float, certify: bool,
    plot: Path | None, output: Path | None,
) -> Outcome:  # fmt: skip
    """Fit one model to the parts of a recording that the CSV file `table` lists."""
    from gmwm.choosing.datasheets import numbers_at
    from gmwm.fitting.estimation.varies import parse_varies as parsed_functions

    sums, conditions = as_varies(varies), read_table(table)
    _, _, named = parsed_functions(sums)
    if named not in ("condition", conditions.condition):
        raise OptionError(argument="varies", expected=f"functions of {conditions.condition}, as in {table}", got=named)
    recording = load(file, reading)
    if output is not None:
        make_directory(output)
    parts = conditions.of(recording) if isinstance(conditions, ConditionTable) else {}
    names = chosen_names(recording.axes, axis)
    if plot is not None and len(names) > 1:
        raise OptionError(
            "--plot draws one axis at known conditions", argument="plot", got=str(plot),
            advice="Select it with {--axis=gyro_z}, or use --output.",
        )  # fmt: skip

    def work(signal: gmwm.Signal) -> ConditionsFit:
        if isinstance(conditions, ConditionCourse):
            return gmwm.fit(
                model, signal, weighting=weighting, robust=robust, efficiency=efficiency, certify=certify, varies=sums,
                against={conditions.condition: conditions.of(signal)},
            )  # fmt: skip
        curves = {
            condition: gmwm.wavelet_variance(imu[signal.axis], robust=robust, efficiency=efficiency)
            for condition, imu in parts.items()
        }
        condition_fit = gmwm.fit(model, curves, weighting=weighting, certify=certify, varies=sums)
        return replace(condition_fit, condition=conditions.condition)

    fits = over_axes(work, {name: recording[name] for name in names}, "fitting")
    content = {
        "file": str(file), "model": str(model), "conditions": str(table),
        "axes": {name: condition_fit.to_dict() for name, condition_fit in fits.items()},
    }  # fmt: skip
    files: list[NewFile] = []
    if output is not None:
        files = [text_file(output / "fits.json", json_text("fit", content) + "\n")]
        files += optional_plots(
            *(NewFile(output / f"fit_{name}.png", partial(_draw, fits[name]), "plotting") for name in fits)
        )
        files += [text_file(output / f"numbers_{name}.csv", numbers_at(fits[name]).write_csv()) for name in fits]
    for condition_fit in fits.values():
        files += plot_file(plot, partial(_draw, condition_fit))
    text = "\n\n".join(f"{name}: {condition_fit.summary()}" for name, condition_fit in fits.items())
    return Outcome(command="fit", document=content, text=text, files=tuple(files))


def _draw(found: ConditionsFit, path: Path) -> None:
    found.plot(path=path)
