"""gmwm psd: power spectral density of a recording, with its lines and broad peaks."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import gmwm
from gmwm.base.text import round_text
from gmwm.base.units import usual_unit
from gmwm.cli.command import command
from gmwm.cli.measuring import open_recording, tell_inspection
from gmwm.cli.options import Chunked, picture_units
from gmwm.cli.output import Outcome, csv_file, over_axes, plot_file, progress, table_text
from gmwm.cli.read_options import chosen_axes, chosen_names
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.files.readers.streams import Stream
    from gmwm.measuring.spectrum import PowerSpectra

EXAMPLES = (
    "gmwm psd static.csv",
    "gmwm psd static.csv --axis accel --plot psd.png",
    "gmwm psd static.csv --length 4096 --csv psd.csv",
)


@command
def psd(
    file: Path,
    reading: ReadOptions,
    axis: list[str] | None = None,
    chunked: Chunked = "auto",
    length: int | None = None,
    detrend: Literal["constant", "linear"] = "constant",
    datasheet: bool | None = None,
    csv: Path | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Print the lines and the resonances in the power spectral density of each axis.

    The density is estimated by Welch's method. A line is a significant narrow peak; a broad peak is wider, such as a
    resonance. For each axis, the probability of any false line or broad peak is at most 1 %. Q is the frequency
    divided by the width.

    Estimation:
        length: Length of the blocks (samples), an even number of at least 8. Default: the largest power of two up to
            65536 that gives at least 15 blocks.
        detrend: Trend to remove from each block: its mean (constant) or a fitted line (linear).
    Result:
        datasheet (--datasheet/--si): Use deg/h, mg (default), or SI.
        csv: Write all frequencies to this CSV file (SI units)."""
    recording = open_recording(file, reading, chunked)
    spectra = _measure(recording, axis, length=length, detrend=detrend)
    system = picture_units(datasheet)
    heading = "axis,unit,frequency_hz,density,lower,upper,degrees_of_freedom"
    tables = [
        ((axis_name, s.unit), (s.frequencies, s.density, s.lower, s.upper, s.degrees_of_freedom))
        for axis_name, s in spectra.items()
    ]
    drawing = spectra if len(spectra) > 1 else next(iter(spectra.values()))
    return Outcome(
        command="psd", document={"file": str(file), "axes": spectra.to_dict()}, text=_text(spectra, si=system == "si"),
        files=csv_file(csv, heading, tables) + plot_file(plot, lambda path: drawing.plot(units=system, path=path)),
    )  # fmt: skip


def _measure(
    recording: gmwm.Imu | Stream, axis: list[str] | None, *, length: int | None, detrend: Literal["constant", "linear"]
) -> PowerSpectra:
    """Estimate the spectrum of each axis."""
    from gmwm.files.readers.streams import Stream
    from gmwm.measuring.spectrum import PowerSpectra

    if isinstance(recording, Stream):
        chosen = chosen_names(recording.axes, axis)
        with progress("reading") as advance:
            axis_spectra = recording.psd(
                length=length, detrend=detrend, done=lambda samples: advance(f"{samples} samples", samples)
            )
        return PowerSpectra(spectra={name: axis_spectra[name] for name in chosen})
    measure = partial(gmwm.psd, length=length, detrend=detrend)
    spectra = over_axes(measure, chosen_axes(recording, axis), "spectrum")
    tell_inspection(recording)
    return PowerSpectra(spectra=spectra)


def _text(found: PowerSpectra, si: bool) -> str:
    """Format a table of the lines and a table of the broad peaks of all axes."""
    first = next(iter(found.values()))
    parts = [f"{first.extent}; resolution {first.resolution:.3g} Hz"]
    units = {axis: (spectrum.unit, 1.0) if si else usual_unit(spectrum.unit) for axis, spectrum in found.items()}
    lines = [
        [
            axis, f"{line.frequency:.6g}", f"{line.frequency_error:.1g}",
            f"{units[axis][1] * line.amplitude:.3g} {units[axis][0]}",
            f"{units[axis][1] * line.amplitude_error:.1g}", "narrow" if line.narrow else f"{line.width:.2g}",
            round_text(line.height, 3), line.multiple,
        ]
        for axis, spectrum in found.items()
        for line in spectrum.lines
    ]  # fmt: skip
    bumps = [
        [axis, f"{bump.frequency:.4g}", f"{bump.width:.2g}", round_text(bump.quality), round_text(bump.height, 3)]
        for axis, spectrum in found.items()
        for bump in spectrum.bumps
    ]
    heads = ["axis", "frequency (Hz)", "±", "amplitude", "±", "width (Hz)", "× level", "harmonic"]
    parts.append(table_text(heads, lines, title="Lines") if lines else "No lines")
    heads = ["axis", "frequency (Hz)", "width (Hz)", "Q", "× level"]
    parts.append(table_text(heads, bumps, title="Broad peaks") if bumps else "No broad peaks")
    return "\n\n".join(parts)
