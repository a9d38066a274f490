"""Open recordings in memory or in chunks, also texts that still grow, and compute their wavelet variances."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Remark
from gmwm.cli.options import Chunked, Transform
from gmwm.cli.output import progress, tell
from gmwm.cli.read_options import chosen_axes, chosen_names, load, names_of
from gmwm.measuring.regression.against import NONE, Asked
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.files.readers.growing_files import GrowingFile, GrowingPipe, Lines
    from gmwm.files.readers.streams import Stream
    from gmwm.measuring.regression.conditions import Conditions


def open_recording(
    path: Path, reading: ReadOptions, chunked: Chunked, *, spread: bool = False, whole: str = ""
) -> gmwm.Imu | Stream:
    """Open the recording in a file, in memory or in chunks."""
    whole = whole or ("--gaps longest" if reading.gaps == "longest" else "")
    if whole and (spread or chunked == "yes"):
        chunks = "--scheduler and --workers read" if spread else "--chunked yes reads"
        raise OptionError(
            f"{whole} needs the whole recording in memory, but {chunks} it in chunks",
            advice="Leave one of these options out.",
        )
    if spread and chunked == "no":
        raise OptionError(
            "--scheduler and --workers read the recording in chunks", argument="chunked", got=chunked,
            advice="Leave {--chunked=no} out.",
        )  # fmt: skip
    from gmwm.files.readers.api import stream_file
    from gmwm.files.readers.streams import is_large

    if not spread and (chunked == "no" or (chunked == "auto" and (whole or not is_large(path)))):
        return load(path, reading)

    with progress(f"reading {path.name}"):
        return stream_file(path, reading)


def needs_memory(filter: str, transform: str) -> str:
    """Return --filter or --transform if its value needs the whole recording in memory; "" if neither does."""
    if filter != "haar":
        return f"{'--moments' if 'lags' in filter else '--filter'} {filter}"
    return f"--transform {transform}" if transform != "modwt" else ""


def stream_curves(
    stream: Stream, axes: Sequence[str], *, robust: bool, efficiency: float, scheduler: str | None = None,
    workers: int | None = None, against: str = NONE,
) -> dict[str, gmwm.WaveletVariance]:  # fmt: skip
    """Compute a stream's wavelet variances; the remarks of its inspection become warnings of the command."""
    from gmwm.calibration.passes import Execution, curves_and_inspection
    from gmwm.measuring.regression.conditions import Conditions

    with progress("reading") as advance:
        conditions = Conditions.of_recording(stream, Asked.of(against))
        curves, inspection = curves_and_inspection(
            stream, axes, robust=robust, efficiency=efficiency, conditions=conditions,
            run=Execution(scheduler=scheduler, workers=workers, progress=lambda text: advance(text, 0)),
        )  # fmt: skip
    for remark in inspection.remarks:
        tell(remark)
    return curves


def memory_for(against: str, other: str = "") -> str:
    """Return --against if its value needs the whole recording in memory, otherwise `other`."""
    if other and against != NONE:
        reason = f"--against removes an effect from Haar coefficients only, and cannot be combined with {other}"
        instead = ", or use {--likelihood} instead of the lags" if other.startswith("--moments") else ""
        raise OptionError(reason, argument="against", got=against, advice=f"Leave one of them out{instead}.")
    exact = any(term.exact and term.is_measured for term in Asked.of(against).terms)
    return f"--against {against}" if exact else other


def signals_or_curves(
    recording: gmwm.Imu | Stream, wanted: Sequence[str] | None, *, robust: bool, efficiency: float, against: str = NONE
) -> Mapping[str, gmwm.Signal | gmwm.WaveletVariance]:
    """Return signals of axes, or variances if in chunks or --against; remarks of inspections become warnings."""
    if isinstance(recording, gmwm.Imu):
        conditions = tell_inspection(recording, against)
        signals = chosen_axes(recording, wanted)
        if against == NONE:
            return signals
        return {axis: conditions.curve(axis, signals[axis], robust, efficiency) for axis in signals}
    axes = chosen_names(recording.axes, wanted)
    return stream_curves(recording, axes, robust=robust, efficiency=efficiency, against=against)


def open_together(
    files: Sequence[Path], reading: ReadOptions, chunked: Chunked, *, whole: str = ""
) -> dict[str, gmwm.Imu | Stream]:
    """Open one or several recordings of one unit, and return them by name."""
    return {
        name: open_recording(file, reading, chunked, whole=whole)
        for name, file in zip(names_of(files), files, strict=True)
    }


def axes_together(recordings: Mapping[str, gmwm.Imu | Stream], wanted: Sequence[str] | None) -> list[str]:
    """Return those axes of --axis that all recordings have."""
    from gmwm.calibration.data import common_axes

    return common_axes(
        {name: dict.fromkeys(chosen_names(recording.axes, wanted)) for name, recording in recordings.items()}
    )[0]


def measure_together(
    recordings: Mapping[str, gmwm.Imu | Stream], wanted: Sequence[str] | None, *, robust: bool, efficiency: float,
    against: str = NONE, filter: str = "haar", transform: Transform = "modwt",
) -> Mapping[str, gmwm.Signal | gmwm.WaveletVariance]:  # fmt: skip
    """Return each axis's data to fit: signals or variances of one recording, or pooled ones of several."""
    from gmwm.measuring.covariance.tails import with_tails
    from gmwm.measuring.variance.pooling import pool

    axes = axes_together(recordings, wanted)
    data_of = {
        name: signals_or_curves(recording, axes, robust=robust, efficiency=efficiency, against=against)
        for name, recording in recordings.items()
    }
    if len(data_of) == 1:
        return next(iter(data_of.values()))

    def curve(data: gmwm.Signal | gmwm.WaveletVariance) -> gmwm.WaveletVariance:
        if isinstance(data, gmwm.WaveletVariance):
            return data
        wv = gmwm.wavelet_variance(data, filter=filter, transform=transform, robust=robust, efficiency=efficiency)
        return with_tails(wv, data)

    return {axis: pool({name: curve(data[axis]) for name, data in data_of.items()}) for axis in axes}


def tell_inspection(imu: gmwm.Imu | Stream, against: str = NONE) -> Conditions:
    """Inspect a recording, and add the remarks about motion, knocks and similar problems to the warnings."""
    from gmwm.measuring.inspection.api import inspect_with
    from gmwm.measuring.regression.conditions import Conditions

    with progress("inspecting"):
        conditions = Conditions.of_recording(imu, Asked.of(against))
        inspection = inspect_with(imu, conditions)
    for remark in inspection.remarks:
        tell(remark)
    return conditions


@contextmanager
def growing_source(file: str) -> Iterator[tuple[GrowingFile | GrowingPipe, Path]]:
    """Open a growing file, or standard input for "-", and yield its reader and its name."""
    from gmwm.files.readers.growing_files import GrowingFile, GrowingPipe

    if file != "-" and not Path(file).is_file():
        problem = "is not a file" if Path(file).exists() else "does not exist"
        raise OptionError(
            f"{file} {problem}", argument="file", got=file,
            advice="Pass a text file that is being written, or - for standard input.",
        )  # fmt: skip
    take = GrowingPipe(sys.stdin.buffer) if file == "-" else GrowingFile(Path(file))
    try:
        yield take, Path("standard input" if file == "-" else file)
    finally:
        take.close()


def remarks_on_end(take: GrowingFile | GrowingPipe, name: Path, lines: Lines) -> tuple[Remark, ...]:
    """Return remarks if reading ended because of a problem, or if the last line was incomplete."""
    remarks = [Remark.of("watch-ended", str(name), reason=take.trouble)] if take.trouble else []
    return (*remarks, *([Remark.of("last-line", str(name), case="left-out")] if lines.rest else []))


@contextmanager
def interruptible() -> Iterator[Callable[[], bool]]:
    """Yield a function that returns whether Ctrl-C was pressed. A second Ctrl-C raises KeyboardInterrupt."""
    pressed = False

    def note(*_: Any) -> None:
        nonlocal pressed
        pressed = True
        signal.signal(signal.SIGINT, signal.default_int_handler)

    before = signal.signal(signal.SIGINT, note)
    try:
        yield lambda: pressed
    finally:
        signal.signal(signal.SIGINT, before)
