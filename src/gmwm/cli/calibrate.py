"""gmwm calibrate: choose and fit the noise model of each axis of a unit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, Literal

import gmwm
from gmwm.base.atomic_files import write_bytes
from gmwm.base.errors import DataError, GmwmError, OptionError
from gmwm.base.extras import is_installed
from gmwm.base.helpers import Helpers
from gmwm.base.helpers import helpers as helpers_of
from gmwm.base.remarks import Dialect, Remark
from gmwm.base.units import sensor_of
from gmwm.calibration.additions import axis_additions
from gmwm.calibration.data import require_axes
from gmwm.calibration.document import as_text
from gmwm.calibration.options import SEARCHED, CalibrationOptions
from gmwm.calibration.summary_text import summary
from gmwm.cli.command import command
from gmwm.cli.measuring import memory_for, open_recording
from gmwm.cli.options import (
    Chunked,
    Criterion,
    Repeated,
    View,
    Weighting,
    chosen_efficiency,
    joined_against,
    named_as_options,
    parse_models,
    parse_searched,
    picture_units,
)
from gmwm.cli.output import NewFile, Outcome, file_names, make_directory, optional_plots, progress, text_file
from gmwm.cli.read_options import chosen_names, document_of, names_of, only_file
from gmwm.measuring.regression.against import AUTO
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.files.readers.streams import Stream
    from gmwm.showing.plots.labels import UnitSystem, ViewName


def each_topic(
    one: Callable[[ReadOptions, Path | None], Outcome], file: Path, reading: ReadOptions, output: Path | None
) -> Outcome:
    """Run a command for each IMU topic of a file, and combine the outcomes into one."""
    from gmwm.files.readers.topics import inertial_topics, topic_folder

    if reading.topic is not None:
        raise OptionError(argument="topic", expected="left out with --all-topics", got=reading.topic)
    done: dict[str, Outcome] = {}
    failed: dict[str, str] = {}
    for topic in inertial_topics(file, reading.format):
        try:
            done[topic] = one(replace(reading, topic=topic), None if output is None else output / topic_folder(topic))
        except GmwmError as error:
            failed[topic] = error.reason
    if not done:
        topic, reason = next(iter(failed.items()))
        raise DataError(f"none of {len(failed)} recordings of {file} can be used; the first one is {topic}: {reason}")
    outcomes = tuple(done.values())
    return Outcome(
        command=outcomes[0].command,
        document={"file": str(file), "topics": {topic: outcome.document for topic, outcome in done.items()}},
        text="\n\n".join(f"Topic {topic}\n{outcome.text}" for topic, outcome in done.items()),
        all_text="\n\n".join(f"Topic {topic}\n{outcome.all_text}" for topic, outcome in done.items()),
        files=tuple(new for outcome in outcomes for new in outcome.files),
        obsolete=tuple(old for outcome in outcomes for old in outcome.obsolete),
        remarks=(
            *(remark for outcome in outcomes for remark in outcome.remarks),
            *(
                Remark.of("not-calibrated", topic, case="calibration", reason=reason)
                for topic, reason in failed.items()
            ),
        ),
    )


def separate_topics(files: Sequence[Path], reading: ReadOptions) -> tuple[str, ...]:
    """Return one file's only topics of gyroscopes and accelerometers, unless the user chose a topic or columns."""
    from gmwm.files.readers.topics import separate_sensors

    if len(files) != 1 or reading.topic is not None or reading.columns is not None:
        return ()
    try:
        return separate_sensors(files[0], reading.format) or ()
    except (GmwmError, OSError):
        return ()  # The error is reported later, when the recording is opened.


EXAMPLES = (
    "gmwm calibrate static.csv --output results",
    "gmwm calibrate monday.csv tuesday.csv wednesday.csv --output results",
    "gmwm calibrate log.txt --rate 100 --units gyro=deg/s,accel=g --output results",
    "gmwm calibrate static.csv --against temperature:2,lag --output results",
    'gmwm calibrate static.csv --model gyro="2*GM + WN" --output results',
    'gmwm calibrate static.csv --axis gyro --within "2*GM + WN + RW" --robust yes',
)


@command
def calibrate(
    files: list[Path],
    reading: ReadOptions,
    axis: list[str] | None = None,
    within: str = SEARCHED,
    model: list[str] | None = None,
    against: list[str] | None = None,
    robust: Literal["auto", "yes", "no"] = "auto",
    efficiency: float | None = None,
    weighting: Weighting = "optimal",
    criterion: Criterion = "asymptotic",
    confidence: float = 0.95,
    seed: int = 0,
    chunked: Chunked = "auto",
    scheduler: str | None = None,
    workers: int | None = None,
    repeated: Repeated = "auto",
    gravity: float | None = None,
    tilt: float | None = None,
    warmup: Literal["omit", "keep"] = "omit",
    output: Path | None = None,
    view: View | None = None,
    datasheet: bool | None = None,
    details: bool = False,
    all_topics: bool = False,
) -> Outcome:
    """Choose and fit the noise model of each axis, and print its numbers as in a datasheet.

    gmwm searches for the model, or compares all models that are part of --within. Of the models that the data cannot
    distinguish from the best one, gmwm uses the simplest. N and K are the white noise density and the random
    walk of a filter, B the bias instability, R the ramp and Q the quantization noise. T_c and q_c are the correlation
    time and the driving noise density of Gauss-Markov processes; f_b, f_r and Q_r describe the filter and the resonance
    of the sensor.

    If a file has gyroscopes and accelerometers in two topics with different clocks, both are calibrated.
    If several files are given, they must be recordings of one unit. Each axis then gets one model, fitted to all
    recordings, a test whether the recordings have the same noise, and intervals that include the spread between them.

    --view, --datasheet and --si apply to the plots. Calibration.load reads calibration.json in Python;
    docs/calibration-format.md describes this file.

    Input:
        warmup: If a warm-up at the beginning raises K by more than its uncertainty: leave the beginning out (omit) if
            at least half of the recording is left, or use it (keep).
        all_topics (--all-topics/--no-all-topics): Calibrate each IMU topic of a file that has several, and write each
            result to its own directory.
    Bias at rest:
        gravity: Local gravity (m/s²), which determines the bias of the accelerometers. Default: 9.806 ± 0.016, the
            range at sea level.
        tilt: Largest possible angle (degrees) between the vertical and the accelerometer axis closest to it. With this
            option, the biases of the level accelerometers are computed too; without it, only the bias of the vertical
            accelerometer.
    Estimation:
        model (--model, -m [AXIS=]MODEL): Model to fit instead of comparing models: MODEL for all axes, gyro=MODEL or
            accel=MODEL for the three axes of a sensor, gyro_x=MODEL for one axis. Repeat the option for other axes;
            gmwm chooses the models of the axes that are not named, so a MODEL for all excludes --within.
        robust: Axes with the robust wavelet variance: auto, those where a test finds knocks or motion (5 % level for
            all axes together; none if --within has a sinusoid); yes, all axes; no, none.
    Result:
        output (--output, -o): Write calibration.json, report.html, summary.txt, calibration.png and by_sensor.png to
            this directory, and imu.yaml for Kalibr if gyroscopes and accelerometers are calibrated.
        details (--details/--no-details): Print all numbers of each axis, and why its model was chosen, not one line for
            each axis."""
    terms = joined_against(against, AUTO)
    options = calibration_options(
        within=within, robust=robust, efficiency=efficiency, weighting=weighting, criterion=criterion,
        confidence=confidence, seed=seed, against=terms, gravity=gravity, tilt=tilt, repeated=repeated,
        warmup=warmup,
    )  # fmt: skip
    spread = scheduler is not None or workers is not None
    if spread:
        only_file(files, "--workers" if scheduler is None else "--scheduler")
    stated = parse_models(model or [])
    processes = calibration_helpers(plots=output is not None)

    def one(readings: Sequence[ReadOptions], output: Path | None) -> Outcome:
        load = partial(open_recording, chunked=chunked, spread=spread, whole=memory_for(terms))
        groups = [[load(file, topic) for file in files] for topic in readings]
        if output is not None:
            make_directory(output)
            # beside the measurement: kernels leave Python to it, which the imports of the reader before do not
            Thread(target=_prepare_files, daemon=True).start()
        names = dict.fromkeys(name for group in groups for recording in group for name in recording.axes)
        axes = chosen_names(list(names), axis)
        models = stated if isinstance(stated, dict) else dict.fromkeys(axes, stated)
        with named_as_options({"models": "--model"}):
            chosen = replace(options, axes=axes, models=models)
            require_axes(chosen, axes)
            calibration = _unite(groups, files, chosen, scheduler=scheduler, workers=workers, helpers=processes)
        return _outcome(
            calibration, files, output, view=view or "auto", units=picture_units(datasheet), details=details,
            helpers=processes, topic=readings[0].topic if all_topics else None,
        )  # fmt: skip

    apart = separate_topics(files, reading)
    if apart:
        return one([replace(reading, topic=topic) for topic in apart], output)
    if all_topics:
        return each_topic(lambda topic, folder: one([topic], folder), only_file(files, "--all-topics"), reading, output)
    return one([reading], output)


def calibration_options(*, within: str, robust: str, efficiency: float | None, **others: Any) -> CalibrationOptions:
    """Return the options of a calibration from the values of --within, --robust, --efficiency and others."""
    outliers: dict[str, Literal["auto"] | bool] = {"auto": "auto", "yes": True, "no": False}
    strength = chosen_efficiency(robust != "no", efficiency, "Leave {--efficiency} or {--robust=no} out.")
    return CalibrationOptions(within=parse_searched(within), robust=outliers[robust], efficiency=strength, **others)


def _unite(
    groups: Sequence[Sequence[gmwm.Imu | Stream]], files: Sequence[Path], options: CalibrationOptions, *,
    scheduler: str | None, workers: int | None, helpers: Helpers,
) -> gmwm.Calibration:  # fmt: skip
    """Calibrate a unit, of one group of recordings, or one for each sensor whose results are combined."""
    calibrations = []
    for group in groups:
        axes = tuple(axis for axis in options.wanted or () if any(axis in recording.axes for recording in group))
        data = group[0] if len(files) == 1 else dict(zip(names_of(files), group, strict=True))
        if axes:
            shared = [axis for axis in axes if all(axis in recording.axes for recording in group)]
            models = {
                name: model for name, model in options.models.items() if name in (*shared, *map(sensor_of, shared))
            }
            within = SEARCHED if options.gives_all(shared) else options.within
            group_options = replace(options, axes=axes, models=models, within=within)
            calibrations.append(
                run_calibration(data, group_options, helpers, scheduler=scheduler, workers=workers).of_file(*files)
            )
    return calibrations[0].combined(*calibrations[1:])


def _outcome(
    found: gmwm.Calibration, files: Sequence[Path], output: Path | None, *, view: ViewName, units: UnitSystem,
    details: bool, helpers: Helpers, topic: str | None,
) -> Outcome:  # fmt: skip
    """Return the outcome of the command, with the files to write; `topic` heads the summary of one of several."""
    from gmwm.cli.export import KalibrFile, kalibr_file

    plots = None if output is None else begin_pictures(helpers, found, view, units)
    document, text = found.to_dict(), summary(found, Dialect.SHELL, details=True, every=True)
    files_of_calibration: tuple[NewFile, ...] = ()
    if output is not None and plots is not None:
        named = text if topic is None else f"Topic {topic}\n{text}"
        files_of_calibration = calibration_files(found, output, document=document, text=named, plots=plots)
    kalibr = KalibrFile() if output is None else kalibr_file(found, output)
    written = file_names((*files_of_calibration, *kalibr.files))
    return Outcome(
        command="calibrate", document={**document, **document_of(files), "written": written},
        text=summary(found, Dialect.SHELL, details=details), all_text=text,
        files=(*files_of_calibration, *kalibr.files), together=True, obsolete=kalibr.obsolete, remarks=kalibr.remarks,
    )  # fmt: skip


def run_calibration(
    recording: gmwm.Imu | Stream | Mapping[str, gmwm.Imu | Stream], options: CalibrationOptions, helpers: Helpers, *,
    scheduler: str | None = None, workers: int | None = None,
) -> gmwm.Calibration:  # fmt: skip
    """Calibrate a recording, or several recordings of one unit by name, with a progress bar."""
    from gmwm.calibration.calibrate_recordings import STAGES, calibrate_recording

    before = 0
    axes = options.wanted or (next(iter(recording.values())) if isinstance(recording, Mapping) else recording).axes
    with progress("calibrating", len(STAGES) * len(axes)) as advance:

        def show(done: int, _: int, text: str) -> None:
            nonlocal before
            advance(text, done - before)
            before = done

        return calibrate_recording(
            recording, options, scheduler=scheduler, workers=workers, progress=show, helpers=helpers
        )


def calibration_helpers(
    *, plots: bool = False, before: str = "gmwm.calibration.calibrate_recordings", count: int | None = None
) -> Helpers:
    """Fork helpers that calibrate."""
    for module in ("scipy.special", "scipy.optimize", before):
        import_module(module)  # here, because all processes need it
    axis_additions()  # the same
    drawing = ("gmwm.showing.plots.imu", "gmwm.showing.plots.matplotlib")
    return helpers_of(*(drawing if plots and is_installed("matplotlib") else ()), count=count)


def _prepare_files() -> None:
    """Import what writes the files, and compile the template of the report."""
    from gmwm.showing.reports.write import template

    import_module("gmwm.cli.export")
    template("report.html")


def begin_pictures(
    helpers: Helpers, found: gmwm.Calibration, view: ViewName, units: UnitSystem
) -> Callable[[], dict[str, bytes]]:
    """Begin to draw the plots of a calibration, which need its fits without what is computed from them."""
    return helpers.begin(draw_pictures, {axis: replace(fit) for axis, fit in found.items()}, view, units)


def draw_pictures(fits: Mapping[str, gmwm.Fit], view: ViewName, units: UnitSystem) -> dict[str, bytes]:
    """Draw the plots of a calibration: the content of each file. Without Matplotlib, there are none."""
    if not is_installed("matplotlib"):
        return {}
    from gmwm.showing.plots.imu import plot_imu
    from gmwm.showing.plots.matplotlib import render

    return {
        name: render(plot_imu(fits, split=split, view=view, units=units), ".png")
        for name, split in (("calibration.png", True), ("by_sensor.png", False))
    }


def calibration_files(
    found: gmwm.Calibration, folder: Path, *, document: Mapping[str, Any], text: str,
    plots: Callable[[], dict[str, bytes]],
) -> tuple[NewFile, ...]:  # fmt: skip
    """Return the files to write for a calibration: calibration.json, report, summary and two plots."""
    return (
        text_file(folder / "calibration.json", as_text(document)),
        NewFile(folder / "report.html", found.report, "writing the report"),
        text_file(folder / "summary.txt", text + "\n"),
        *optional_plots(
            NewFile(folder / "calibration.png", lambda path: write_bytes(path, plots()["calibration.png"]), "plotting"),
            NewFile(folder / "by_sensor.png", lambda path: write_bytes(path, plots()["by_sensor.png"]), "drawing"),
        ),
    )
