"""Result of `fleet`: the table, the calibrations and the statistics of many units."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gmwm.applications.fleets.storage import TABLE, read_facts, unit_file
from gmwm.applications.fleets.table import RUN_AGAIN, read_table
from gmwm.base.errors import DataError, OptionError, ReadError
from gmwm.base.plotting import Plotted, register
from gmwm.base.remarks import Remark, sorted_remarks
from gmwm.base.text import Summarised
from gmwm.calibration.options import CalibrationOptions
from gmwm.calibration.result import Calibration

if TYPE_CHECKING:
    from polars import DataFrame

    from gmwm.applications.fleets.statistics_result import FleetStatistics


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Fleet(Summarised, Plotted):
    """A fleet of calibrated units. `fleet["unit"]` loads the Calibration of one unit.

    Attributes
    ----------
    folder : Path
        Output folder, with fleet.json, fleet.parquet and a file units/<unit>.json for each unit.
    paths : mapping of unit to path
        Recording of each unit.
    table : polars.DataFrame
        A row for each unit and axis: `unit`, `axis`, `status` ("calibrated" or "failed"), `reason`, `file`, `sha256`,
        `samples`, `rate` (Hz), `duration` (s), `model`, `p_value` (of the fit), `robust`, `contaminated`, `certified`,
        `cautions` (number of cautions); and for each datasheet parameter, such as N, the columns N, N_low, N_high and
        N_unit in SI units. If only an upper limit is known, the value is missing, the low end is 0, and the high end is
        the limit (infinite if there is none). A unit that failed completely has one row without an axis.
    settings : CalibrationOptions
        Options of the calibrations.
    left_out : tuple of str
        Files in the input folder that are not recordings.
    kept, done : int
        Number of units calibrated by earlier runs, and by this run. For a loaded fleet, `done` is 0.
    reading : mapping
        Arguments of `read` that differ from its defaults.
    """

    folder: Path
    paths: Mapping[str, str]
    table: DataFrame
    settings: CalibrationOptions
    left_out: tuple[str, ...] = ()
    kept: int = 0
    done: int = 0
    reading: Mapping[str, Any] = field(default_factory=dict)

    @property
    def units(self) -> tuple[str, ...]:
        """Names of all units."""
        return tuple(self.paths)

    @cached_property
    def failed(self) -> dict[str, str]:
        """Units that could not be calibrated, with the reason."""
        rows = self.table.filter(self.table["axis"].is_null()).select("unit", "reason").rows()
        return {str(unit): str(reason) for unit, reason in rows}

    @cached_property
    def statistics(self) -> FleetStatistics:
        """Statistics of each noise parameter: typical value, spread, outliers and differences between axes."""
        from gmwm.applications.fleets.statistics import fleet_statistics

        return fleet_statistics(self.table, confidence=self.settings.confidence)

    @property
    def outliers(self) -> Any:
        """The values that differ from the values of the other units by more than chance explains."""
        return self.statistics.outliers

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on the fleet, the most severe first."""
        from gmwm.applications.fleets.findings import of_units

        remarks = of_units(self.table, len(self.units), len(self.failed))
        return tuple(sorted_remarks([*remarks, *self.statistics.remarks]))

    def __getitem__(self, unit: str) -> Calibration:
        if unit not in self.paths:
            examples = ", ".join(list(self.paths)[:3])
            raise OptionError(
                argument="unit", expected=f"one of the {len(self.paths)} units, such as {examples}", got=unit
            )
        if unit in self.failed:
            raise DataError(f"{unit} could not be calibrated: {self.failed[unit]}", argument="unit", got=unit)
        return Calibration.load(unit_file(self.folder, unit))

    def __iter__(self) -> Iterator[str]:
        return (unit for unit in self.paths if unit not in self.failed)

    def __len__(self) -> int:
        return len(self.paths) - len(self.failed)

    def __contains__(self, unit: object) -> bool:
        return unit in self.paths and unit not in self.failed

    def summary(self) -> str:
        """Describe the fleet in text: number of units, failed units, tables, outliers and remarks."""
        from gmwm.applications.fleets import summary_text

        return summary_text.summary(self)

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Fleet:
        """Load a fleet from an output `folder` of `gmwm.fleet` or of the command `gmwm fleet`.

        Another folder, another version, or a folder without a completed run raises a ReadError.
        """
        where = Path(folder)
        facts = read_facts(where)
        table = read_table(where / TABLE)
        try:
            settings = CalibrationOptions.from_dict(facts["settings"])
        except (ReadError, TypeError) as error:
            raise ReadError(f"{where} has unknown settings: {error}", advice=RUN_AGAIN) from error
        paths, listed = facts["units"], set(table["unit"])
        if any(unit not in listed for unit in paths):
            raise ReadError(f"{where}: the last run ended before it wrote the table", advice=RUN_AGAIN)
        loaded = cls(
            folder=where, paths=paths, table=table, settings=settings, left_out=tuple(facts["left_out"]),
            reading=facts["reading"],
        )  # fmt: skip
        return replace(loaded, kept=len(loaded))

    def __repr__(self) -> str:
        failed = f", {len(self.failed)} failed" if self.failed else ""
        return f"Fleet({len(self)} of {len(self.paths)} units calibrated{failed})"


register(Fleet, "gmwm.applications.fleets.plot:plot_fleet")
