"""gmwm fit --conditions: fit one model to the parts of a recording that have different known conditions."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from gmwm.base.errors import OptionError, ReadError
from gmwm.cli.output import NewFile, Outcome, json_text, make_directory, optional_plots, plot_file, text_file
from gmwm.cli.read_options import chosen_names, load
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.fitting.estimation import ConditionsFit
    from gmwm.recording.signals import Imu, Signal
    from gmwm.theory.processes import Model

_EXPECTED = "a table with the columns start, stop and the condition, for example `start,stop,rate`"


@dataclass(frozen=True)
class ConditionTable:
    """The parts of a recording during which a condition, such as the temperature or the rate, had a known value."""

    condition: str  # name of the condition
    # for each value of the condition, the times (s from the first sample) between which it had this value
    parts: Mapping[float, list[tuple[float, float]]]

    @classmethod
    def read(cls, path: Path) -> ConditionTable:
        """Read a CSV file with the columns start, stop and the condition."""
        try:
            rows = [row for row in csv.reader(path.read_text(encoding="utf-8-sig").splitlines()) if row]
        except (OSError, UnicodeDecodeError) as error:
            raise ReadError(f"{path} cannot be read: {error}", argument="conditions") from error
        head = [cell.strip() for cell in rows[0]] if rows else []
        if len(head) != 3 or head[:2] != ["start", "stop"] or not head[2].isidentifier():
            raise ReadError(f"{path} is not {_EXPECTED}", argument="conditions", got=",".join(head))
        parts: dict[float, list[tuple[float, float]]] = {}
        for number, row in enumerate(rows[1:], 2):
            try:
                start, stop, condition = map(float, row)
            except ValueError as error:
                reason = f"{path}, row {number}: three numbers were expected, not {','.join(row)!r}"
                raise ReadError(reason, argument="conditions", got=row) from error
            if not 0 <= start < stop:
                reason = (
                    f"{path}, row {number}: the start, {start:g} s, must be 0 or more and before the stop, {stop:g} s"
                )
                raise ReadError(reason, argument="conditions", got=row)
            parts.setdefault(condition, []).append((start, stop))
        for (_, stop), (start, _) in pairwise(sorted(pair for intervals in parts.values() for pair in intervals)):
            if start < stop:
                raise ReadError(f"{path}: two parts overlap between {start:g} s and {stop:g} s", argument="conditions")
        return cls(head[2], {condition: sorted(intervals) for condition, intervals in sorted(parts.items())})

    def of(self, recording: Imu) -> dict[float, Imu]:
        """Return a recording for each value of the condition. It has a gap between two separate parts."""
        recordings = {}
        for condition, intervals in self.parts.items():
            gaps = [(stop, start) for (_, stop), (start, _) in pairwise(intervals) if stop < start]
            recordings[condition] = recording.between(intervals[0][0], intervals[-1][1], skip=gaps)
        return recordings


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
    file: Path, reading: ReadOptions, model: Model, table: Path, varies: Sequence[str], axis: Sequence[str] | None,
    *, weighting: Literal["diagonal", "optimal", "identity"] | None, robust: bool, efficiency: float, certify: bool,
    plot: Path | None, output: Path | None,
) -> Outcome:  # fmt: skip
    """Fit one model to the parts of a recording that the CSV file `table` lists."""
    from gmwm import fit, wavelet_variance
    from gmwm.cli.parallel import over_axes
    from gmwm.fitting.estimation.varies import parse_varies as parsed_functions

    sums, conditions = as_varies(varies), ConditionTable.read(table)
    _, named = parsed_functions(sums)
    if named not in ("condition", conditions.condition):
        raise OptionError(argument="varies", expected=f"functions of {conditions.condition}, as in {table}", got=named)
    recording = load(file, reading)
    if output is not None:
        make_directory(output)
    parts = conditions.of(recording)
    names = chosen_names(recording.axes, axis)
    if plot is not None and len(names) > 1:
        raise OptionError(
            "--plot draws one axis at known conditions", argument="plot", got=str(plot),
            advice="Select it with {--axis=gyro_z}, or use --output.",
        )  # fmt: skip

    def work(signal: Signal) -> ConditionsFit:
        curves = {
            condition: wavelet_variance(imu[signal.axis], robust=robust, efficiency=efficiency)
            for condition, imu in parts.items()
        }
        condition_fit = fit(model, curves, weighting=weighting, certify=certify, varies=sums)
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
    for condition_fit in fits.values():
        files += plot_file(plot, partial(_draw, condition_fit))
    text = "\n\n".join(f"{name}: {condition_fit.summary()}" for name, condition_fit in fits.items())
    return Outcome(command="fit", document=content, text=text, files=tuple(files))


def _draw(found: ConditionsFit, path: Path) -> None:
    found.plot(path=path)
