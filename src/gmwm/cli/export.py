"""gmwm export: write the noise of a calibrated unit in the formats of other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypedDict

import typer

import gmwm
from gmwm.base.atomic_files import read_json
from gmwm.base.errors import DataError, MissingTheoryError, OptionError, ReadError
from gmwm.base.remarks import Remark
from gmwm.base.time_base import parse_length
from gmwm.base.units import sensor_of
from gmwm.calibration import Calibration
from gmwm.choosing.datasheets.effective import DEFAULT_HORIZON_S
from gmwm.cli.command import command
from gmwm.cli.model_source import read_given
from gmwm.cli.output import NewFile, Outcome, calibration_file, file_names, make_directory, text_file
from gmwm.cli.read_options import document_of
from gmwm.showing.exporters import export as exported
from gmwm.showing.exporters import export_all, export_formats
from gmwm.showing.exporters.base import require_extension

EXAMPLES = (
    "gmwm export results/calibration.json --format kalibr --output imu.yaml",
    "gmwm export results/calibration.json --format openvins --inflation 10",
    "gmwm export gyro_results accel_results --output imu.yaml",
    "gmwm export results/calibration.json --all exported",
    "gmwm export results/fits.json --format state-space --output noise.py",
    "gmwm export --from old_vins.yaml --rate 200 --format orbslam3",
)
DEFAULT = "kalibr"


@command
def export(
    calibrations: list[Path] | None = None,
    source: str | None = None,
    format: Annotated[
        str | None,
        typer.Option(
            help=f"Format: {', '.join(export_formats())}. Default: {DEFAULT}.",
            metavar="NAME",
            autocompletion=lambda incomplete: [name for name in export_formats() if name.startswith(incomplete)],
        ),
    ] = None,
    axes: Literal["worst", "mean", "each"] | None = None,
    inflation: float = 1.0,
    horizon: str = f"{DEFAULT_HORIZON_S:g}s",
    rate: float | None = None,
    duration: str | None = None,
    output: Path | None = None,
    all: Path | None = None,
) -> Outcome:
    """Write the noise of a calibrated unit in the format of another program.

    Most programs use only the white noise N and the random walk K of the bias. If the model lacks one of these
    processes, the file contains the upper limit from the data instead of zero, and a comment says so. The header of
    each file states the units, whether the values are for continuous or discrete time, how axes are combined, and the
    inflation, horizon, models and source.

    Arguments:
        calibrations (CALIBRATION...): The calibration.json that gmwm calibrate --output wrote, or its folder. Give two
            if gyroscopes and accelerometers were calibrated separately. The state-space formats also accept the
            fits.json of gmwm fit.
    Options:
        axes: How to combine the axes of a sensor: use the largest value (worst), the root mean square (mean), or one
            value for each axis (each) if the format allows it. Default: worst for filters, each for simulators and
            messages.
        inflation: Factor on all standard deviations. Variances are multiplied by its square.
        horizon (LENGTH): Time over which a filter with N and K predicts best and states its real error, such as 100ms,
            1s, 1min or a number of seconds.
        rate: Sampling rate (Hz) in the other program. Default: the rate of the recording.
        duration (LENGTH): For programs that model the bias as a Gauss-Markov process: longest averaging time to which
            this process is fitted. Default: 1h, or the duration of the recording if it is shorter.
    Result:
        output (--output, -o): Write to this file. Default: print the text.
        all: Write one file in each format to this directory."""
    if all is not None and (format is not None or output is not None):
        raise OptionError(
            "--all writes every format", argument="all", got=str(all), advice="Leave {--format} and {--output} out."
        )
    seconds = parse_length(horizon, "horizon")
    choice: _ExportArguments = {
        "axes": axes, "inflation": inflation, "horizon": seconds, "rate": rate,
        "duration": None if duration is None else parse_length(duration, "duration"),
    }  # fmt: skip
    if source is not None:
        choice["rate"] = None
    written = DEFAULT if format is None else format
    fitted = None if source is not None else _fits_source(calibrations or [], None if all is not None else written)
    files, calibration = _source(calibrations, source, rate) if fitted is None else (calibrations or [], fitted)
    if all is not None:
        return _all(calibration, files, make_directory(all, "all"), choice)
    return _one(calibration, files, output=output, name=written, choice=choice)


def _source(
    calibrations: list[Path] | None, source: str | None, rate: float | None
) -> tuple[list[Path], gmwm.Calibration]:
    """Return the input files and the calibration to export, from the given calibrations or from --from."""
    from gmwm.showing.exporters.given import given_calibration

    if (source is None) == (not calibrations):
        raise OptionError(
            "exactly one of CALIBRATION and --from is needed", argument="calibrations", got=source,
            advice="Pass a calibration.json, or noise without a recording with {--from}.",
        )  # fmt: skip
    if source is not None:
        return [Path(source)], given_calibration(read_given(source, rate))
    files = [calibration_file(path) for path in calibrations or ()]
    first, *others = [gmwm.Calibration.load(file) for file in files]
    return files, first.combined(*others)


def _fits_source(files: Sequence[Path], format: str | None) -> Calibration | None:
    """Return the fits of a fits.json as a calibration; None if none of the files is a fits.json."""
    from gmwm.cli.plan import fits_in
    from gmwm.showing.exporters.given import fitted_calibration

    if not any(_is_fits(path) for path in files):
        return None
    allowed = [name for name in export_formats() if name.startswith("state-space")]
    if len(files) > 1 or format not in allowed:
        raise OptionError(
            "a fits.json of gmwm fit can only be written by itself and as state space, because it has one model and no "
            "comparison with others", argument="format", got=format or "--all",
            advice=f"Use one file with {{--format}} {', '.join(allowed)}, or pass the calibration.json of "
            "`gmwm calibrate`.",
        )  # fmt: skip
    recording, fits = fits_in(files[0])
    return fitted_calibration({axis: gmwm.Fit.from_dict(content) for axis, content in fits.items()}, recording or "")


def _is_fits(path: Path) -> bool:
    """Return whether a path is a fits.json of gmwm fit, or a folder with one and without a calibration.json."""
    if path.is_dir():
        return (path / "fits.json").is_file() and not (path / "calibration.json").is_file()
    try:
        content = read_json(path)
    except (OSError, ValueError, ReadError):
        return False
    return isinstance(content, dict) and content.get("command") == "fit"


class _ExportArguments(TypedDict):
    """Keyword arguments of `gmwm.exporters.export` that the options of the command set."""

    axes: Literal["worst", "mean", "each"] | None
    inflation: float
    horizon: float
    rate: float | None
    duration: float | None


def _one(
    found: Calibration, files: Sequence[Path], output: Path | None, name: str, choice: _ExportArguments
) -> Outcome:
    """Return the outcome of an export in one format, which is written to `output` or, if that is None, printed."""
    if output is not None:
        require_extension(name, output, "output")
    text = exported(found, None, name, **choice)
    new = () if output is None else (text_file(output, text),)
    return Outcome(
        command="export", document={**document_of(files), "format": name, "text": text, "written": file_names(new)},
        text="" if new else text, files=new,
    )  # fmt: skip


def _all(found: Calibration, files: Sequence[Path], folder: Path, choice: _ExportArguments) -> Outcome:
    """Write every format that the calibration allows. For each other format, a remark gives the reason."""
    written, refused = export_all(found, folder, **choice)
    paths = tuple(written.values())
    return Outcome(
        command="export", document={**document_of(files), "written": list(map(str, paths)), "left_out": refused},
        written=paths, closing=f"\nWrote {len(paths)} of {len(paths) + len(refused)} formats.",
        remarks=tuple(Remark.of("format-not-written", name, reason=reason) for name, reason in refused.items()),
    )  # fmt: skip


@dataclass(frozen=True)
class KalibrFile:
    """The Kalibr file imu.yaml of a calibration: the file to write, an older file to remove, and remarks."""

    files: tuple[NewFile, ...] = ()
    obsolete: tuple[Path, ...] = ()
    remarks: tuple[Remark, ...] = ()


def kalibr_file(found: Calibration, folder: Path) -> KalibrFile:
    """Return imu.yaml if both sensors are calibrated and the data give a value or an upper limit for each number."""
    target, remarks = folder / "imu.yaml", []
    if {"gyro", "accel"} <= {sensor_of(axis) for axis in found}:
        try:
            return KalibrFile((text_file(target, exported(found)),))
        except (DataError, MissingTheoryError) as error:
            remarks.append(Remark.of("format-not-written", target.name, reason=error.reason))
    if not target.is_file():
        return KalibrFile(remarks=tuple(remarks))
    # A user would mistake the file of an earlier run for a result of this calibration.
    remarks.append(Remark.of("other-results", target.name, case="old"))
    return KalibrFile(obsolete=(target,), remarks=tuple(remarks))
