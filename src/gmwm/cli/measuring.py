"""Recordings larger than memory: when they are read in chunks, and how their curves are had, here or on a cluster."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from gmwm.cli.read_options import INPUT, chosen_axes, chosen_names, load
from gmwm.errors import OptionError
from gmwm.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.readers.streams import Stream
    from gmwm.signals import Imu, Signal
    from gmwm.variance.result import WaveletVariance

Chunked = Annotated[
    Literal["auto", "yes", "no"],
    typer.Option(
        help="Read the recording in chunks, twice, in bounded memory. auto: files of 300 MB or more; yes: every file; "
        "no: never. In chunks, scales from 2^15 samples on use one coefficient every τ/64; temperatures are not read.",
        rich_help_panel=INPUT,
    ),
]
MACHINES = "Where it is done"
Scheduler = Annotated[
    str | None,
    typer.Option(
        help="Dask scheduler whose workers read the recording, a part each, as tcp://10.0.0.5:8786; they find the "
        "file under the same path. Default: this process.",
        metavar="ADDRESS",
        rich_help_panel=MACHINES,
        show_default=False,
    ),
]
Workers = Annotated[
    int | None,
    typer.Option(
        help="Processes on this machine that read the recording, a part each. Default: threads of this one.",
        min=1,
        rich_help_panel=MACHINES,
        show_default=False,
    ),
]


def opened(
    path: Path,
    reading: ReadOptions,
    chunked: Literal["auto", "yes", "no"],
    *,
    spread: bool = False,
    whole: str = "",
) -> Imu | Stream:
    """The recording in a file, in memory or in chunks.

    Parameters
    ----------
    path, reading, chunked
    spread : bool
        Whether workers read it, which is always in chunks.
    whole : str
        What was asked for that needs it in memory; "" if nothing was.
    """
    whole = whole or ("--gaps longest" if reading.gaps == "longest" else "")
    if whole and (spread or chunked == "yes"):
        asked = "--scheduler and --workers read" if spread else "--chunked yes reads"
        raise OptionError(f"{whole} needs the whole recording in memory, {asked} it in chunks: leave one of them out")
    if spread and chunked == "no":
        raise OptionError("--scheduler and --workers read the recording in chunks: leave --chunked no out")
    from gmwm.cli.output import progress
    from gmwm.readers.streams import is_large, stream_file

    if not spread and (chunked == "no" or (chunked == "auto" and (whole or not is_large(path)))):
        return load(path, reading)

    with progress(f"reading {path.name}"):
        return stream_file(path, reading)


def needs_memory(filter: str, transform: str) -> str:
    """The option that only a recording in memory can have, "" if there is none."""
    if filter != "haar":
        return f"--filter {filter}"
    return f"--transform {transform}" if transform != "modwt" else ""


def stream_curves(
    stream: Stream,
    axes: Sequence[str],
    *,
    robust: bool,
    efficiency: float,
    scheduler: str | None = None,
    workers: int | None = None,
) -> dict[str, WaveletVariance]:
    """The curves of some axes of a recording in chunks; adds what the inspection finds."""
    from gmwm.calibration.stream_measurement import measured_and_inspected
    from gmwm.cli.output import progress, tell

    with progress("reading") as advance:
        curves, seen = measured_and_inspected(
            stream, axes, pairs=False, robust=robust, efficiency=efficiency, scheduler=scheduler, workers=workers,
            progress=lambda text: advance(text, 0),
        )  # fmt: skip
    for remark in seen.remarks:
        tell(remark)
    return {axis: found[0] for axis, found in curves.items()}


def signals_or_curves(
    recording: Imu | Stream, wanted: Sequence[str] | None, *, robust: bool, efficiency: float
) -> Mapping[str, Signal | WaveletVariance]:
    """The axes that --axis names, measured already if the recording is in chunks; adds what an inspection finds."""
    from gmwm.cli.output import tell_inspection
    from gmwm.signals import Imu

    if isinstance(recording, Imu):
        tell_inspection(recording)
        return chosen_axes(recording, wanted)
    return stream_curves(recording, chosen_names(recording.axes, wanted), robust=robust, efficiency=efficiency)
