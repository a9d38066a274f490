"""gmwm calibrate: the noise model of every axis of a unit, with its numbers, pictures and what to know of them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.calibration.options import WITHIN
from gmwm.cli.export import written_for_kalibr
from gmwm.cli.measuring import InPieces, Scheduler, Workers, opened
from gmwm.cli.options import (
    RESULT,
    ChoiceWeighting,
    Confidence,
    CriterionName,
    Datasheet,
    Efficiency,
    Json,
    Seed,
    View,
    Within,
    parse_within,
)
from gmwm.cli.read_options import Axes, File, Opening, chosen_names, opens
from gmwm.errors import OptionError

if TYPE_CHECKING:
    from gmwm.calibration import Calibration
    from gmwm.processes.model import ModelLike
    from gmwm.readers.streams import Stream
    from gmwm.signals import Imu

EXAMPLES = (
    "gmwm calibrate static.csv --output results",
    "gmwm calibrate log.txt --rate 100 --units gyro=deg/s,accel=g --output results",
    "gmwm calibrate static.csv --axis gyro --within '2*GM + WN + RW' --robust yes",
)

Outliers = Annotated[
    Literal["auto", "yes", "no"],
    typer.Option(
        help="Leave outliers out: of the axes where a test at 5 % for all together finds them (of none if --within has "
        "a sinusoid), of all, of none.",
        rich_help_panel="Estimation",
    ),
]
ROBUST: Mapping[str, Literal["auto"] | bool] = {"auto": "auto", "yes": True, "no": False}


@opens
def calibrate(
    file: File,
    opening: Opening,
    axis: Axes = None,
    within: Within = WITHIN,
    robust: Outliers = "auto",
    efficiency: Efficiency = None,
    weighting: ChoiceWeighting = "optimal",
    criterion: CriterionName = "asymptotic",
    confidence: Confidence = 0.95,
    seed: Seed = 0,
    in_pieces: InPieces = "auto",
    scheduler: Scheduler = None,
    workers: Workers = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Write calibration.json, report.html, summary.txt, calibration.png and by_sensor.png into this "
            "directory; imu.yaml for Kalibr too, if gyroscopes and accelerometers are calibrated.",
            rich_help_panel=RESULT,
        ),
    ] = None,
    view: View = "wavelet",
    datasheet: Datasheet = False,
    json: Json = False,
) -> None:
    """Calibrate a unit: choose the noise model of each axis, and give its numbers as datasheets do.

    Every model within the general one is compared; of those that the data cannot tell from the best the simplest is
    recommended. N is the angle or velocity random walk, B the bias instability, K the rate random walk, R the rate
    ramp, Q the quantization noise; T_c and q_c are of Gauss-Markov terms. --view and --datasheet are of the pictures.

    calibration.json holds everything: Calibration.load reads it, docs/calibration-format.md describes it.
    """
    from gmwm.cli.errors import as_options
    from gmwm.cli.output import made_directory, print_json, print_written, tell, told_warnings

    if efficiency is not None and robust == "no":
        raise OptionError("--efficiency belongs to the robust wavelet variance; leave it or --robust no out")
    largest = parse_within(within)
    with told_warnings() as told:
        recording = opened(file, opening, in_pieces, spread=scheduler is not None or workers is not None)
        chosen = tuple(chosen_names(recording.axes, axis))
        if output is not None:
            made_directory(output)
        found = calibrated(
            recording, largest, axes=chosen, robust=ROBUST[robust], weighting=weighting, criterion=criterion,
            efficiency=0.6 if efficiency is None else efficiency, confidence=confidence, seed=seed,
            scheduler=scheduler, workers=workers,
        ).of_file(file)  # fmt: skip
        for caution in found.cautions if json else ():  # else the summary has them
            tell(told, caution)
        for name, why in found.failed.items():
            tell(told, f"{name} is not calibrated: {why}")
        written = [] if output is None else write_all(found, output, view, datasheet)
        if json:
            document = {**found.to_dict(), "file": str(file), "written": list(map(str, written))}
            print_json("calibrate", document, told)
            return
        print(as_options(found.summary()))
        print_written(written)


def calibrated(
    recording: Imu | Stream,
    within: ModelLike,
    *,
    axes: tuple[str, ...] | None = None,
    robust: Literal["auto"] | bool = "auto",
    efficiency: float = 0.6,
    weighting: Literal["diagonal", "optimal"] = "optimal",
    criterion: Literal["asymptotic", "bootstrap"] = "asymptotic",
    confidence: float = 0.95,
    seed: int = 0,
    scheduler: str | None = None,
    workers: int | None = None,
) -> Calibration:
    """The calibration, with a progress bar."""
    from gmwm.calibration.api import STAGES, calibrate
    from gmwm.cli.output import progress

    before = 0
    with progress("calibrating", len(STAGES) * len(recording.axes if axes is None else axes)) as advance:

        def tell(done: int, _: int, text: str) -> None:
            nonlocal before
            advance(text, done - before)
            before = done

        return calibrate(
            recording, within, axes=axes, robust=robust, efficiency=efficiency, weighting=weighting,
            criterion=criterion, confidence=confidence, seed=seed, scheduler=scheduler, workers=workers, progress=tell,
        )  # fmt: skip


def write_all(
    found: Calibration, folder: Path, view: Literal["wavelet", "allan"] = "wavelet", datasheet: bool = False
) -> list[Path]:
    """The document, the page, the summary and the pictures, all of them or none."""
    from gmwm._files import write_text, written_together
    from gmwm.cli.errors import as_options
    from gmwm.cli.output import progress

    names = ("calibration.json", "report.html", "summary.txt", "calibration.png", "by_sensor.png")
    system: Literal["si", "datasheet"] = "datasheet" if datasheet else "si"
    with written_together(folder) as room:
        document, page, text, grid, by_sensor = (room / name for name in names)
        found.save(document)
        write_text(text, as_options(found.summary()) + "\n")
        with progress("drawing"):
            found.plot(view=view, units=system, path=grid)
            found.plot(split=False, view=view, units=system, path=by_sensor)
        with progress("writing the report"):
            found.report(page)
        kalibr = written_for_kalibr(found, room, folder)
    return [folder / name for name in (*names, *kalibr)]
