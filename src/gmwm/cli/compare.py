"""gmwm compare: compare the classical and robust wavelet variances of one or several recordings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import gmwm
from gmwm.base.errors import OptionError
from gmwm.cli.command import command
from gmwm.cli.options import View, picture_units, unit_system
from gmwm.cli.output import Outcome, calibration_file, over_axes, plot_file, tell
from gmwm.cli.read_options import chosen_axes, load
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.showing.plots.labels import UnitSystem, ViewName

EXAMPLES = (
    "gmwm compare static.csv --axis gyro_y --plot compare.png",
    "gmwm compare monday.csv tuesday.csv --robust --axis accel --plot days.pdf",
)


@command
def compare(
    files: list[Path],
    reading: ReadOptions,
    axis: list[str] | None = None,
    classical: bool = False,
    robust: bool = False,
    efficiency: float | None = None,
    view: View | None = None,
    datasheet: bool | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Compare the classical and robust wavelet variances of one or several recordings.

    If the classical curve is above the robust curve, the recording has outliers such as knocks, spikes or transmission
    errors. The robust curve tolerates up to 26 % bad coefficients; at level j, one bad sample affects 2^j coefficients.
    If more than half of the coefficients are zero, as for a coarsely quantized sensor, the robust curve may be zero,
    and the command prints a warning.

    Arguments:
        files (FILE…): One or more recordings, each in any supported format.
    Estimation:
        classical: Show only the classical curve.
        robust: Show only the robust curve."""
    if calibrations := [
        file for file in files if calibration_file(file).is_file() and calibration_file(file).suffix == ".json"
    ]:
        raise OptionError(
            f"gmwm compare compares recordings, and {calibrations[0]} is a calibration or a result",
            argument="files",
            got=str(calibrations[0]),
            advice="Compare calibrations with each other or with a reference with `gmwm agree`.",
        )
    if efficiency is not None and classical and not robust:
        raise OptionError(
            "--efficiency applies only to the robust curve", argument="efficiency", got=efficiency,
            advice="Leave {--efficiency} or {--classical} out.",
        )  # fmt: skip
    kinds = [kind for kind, chosen in (("classical", classical), ("robust", robust)) if chosen or classical == robust]
    system = unit_system(datasheet)
    curves: dict[str, dict[str, gmwm.WaveletVariance]] = {}
    for file, name in zip(files, _names(files), strict=True):
        signals = chosen_axes(load(file, reading), axis)
        for kind in kinds:
            label = ", ".join(filter(None, (name, kind if name == "" or len(kinds) > 1 else "")))
            for axis_name, result in _measure(signals, kind, efficiency).items():
                curves.setdefault(axis_name, {})[label] = result
                for remark in result.remarks:
                    tell(remark.about(f"{axis_name}, {label}"))
    axes = {a: {label: wv.to_dict() for label, wv in group.items()} for a, group in curves.items()}
    return Outcome(
        command="compare", document={"files": list(map(str, files)), "axes": axes},
        text=_curves_text(curves, view or "wavelet", system),
        files=plot_file(plot, partial(_draw, curves, view or "auto", picture_units(datasheet))),
    )  # fmt: skip


def _names(files: Sequence[Path]) -> list[str]:
    """Return a unique label for each file: its stem, name or path; "" if there is only one file."""
    if len(files) == 1:
        return [""]
    for names in ([file.stem for file in files], [file.name for file in files], [str(file) for file in files]):
        if len(set(names)) == len(names):
            return names
    raise OptionError(f"a recording is given twice: {', '.join(map(str, files))}", argument="files", got=files)


def _measure(
    signals: Mapping[str, gmwm.Signal], kind: str, efficiency: float | None
) -> dict[str, gmwm.WaveletVariance]:
    robust = kind == "robust"
    measure = partial(
        gmwm.wavelet_variance, robust=robust, efficiency=efficiency if robust and efficiency is not None else 0.6
    )
    return over_axes(measure, signals, f"{kind} wavelet variance")


def _draw(
    curves: Mapping[str, Mapping[str, gmwm.WaveletVariance]], view: ViewName, system: UnitSystem, path: Path
) -> None:
    """Plot the curves to a file, with one panel for each axis."""
    from gmwm.showing.plots.imu import plot_imu
    from gmwm.showing.plots.labels import axis_title

    if len(curves) > 1:
        plot_imu(curves, view=view, units=system, path=path)
        return
    ((name, group),) = curves.items()
    gmwm.compare(*group.values(), labels=list(group), view=view, units=system, title=axis_title(name), path=path)


def _curves_text(curves: Mapping[str, Mapping[str, gmwm.WaveletVariance]], view: ViewName, system: UnitSystem) -> str:
    """Format a table for each axis, with a column for each curve."""
    from gmwm.calibration.tables import fitting_tables, short_heads
    from gmwm.showing.plots.labels import view_of

    style = "#.5g" if view == "allan" and system == "datasheet" else ".4e"
    labels = list(dict.fromkeys(label for group in curves.values() for label in group))
    heads, legend = short_heads(labels)
    tables = [legend] if legend else []
    for axis, group in curves.items():
        shown = view_of(next(iter(group.values())).unit, view, system)
        columns: list[dict[float, str]] = []
        for wv in group.values():
            heights = shown.height(wv.variance)
            columns.append({t: f"{h:{style}}" for t, h in zip(shown.time(wv.tau).tolist(), heights, strict=True)})

        def rows(names: Sequence[str], part: range, columns: list[dict[float, str]] = columns) -> list[list[str]]:
            times = sorted(set().union(*columns))
            return [["τ (s)", *names], *([f"{t:.6g}", *(columns[k].get(t, "") for k in part)] for t in times)]

        names = [heads[labels.index(label)] for label in group]
        tables.append([f"{axis}: {shown.height_label}", *fitting_tables(names, rows, most=4)])
    return "\n\n".join("\n".join(lines) for lines in tables)
