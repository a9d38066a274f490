"""Options for the estimation and for the output that several commands share, and their names in error messages."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

import gmwm
from gmwm.base.errors import GmwmError, ModelError, OptionError
from gmwm.base.units import AXES, SI_UNIT
from gmwm.measuring.regression.against import Asked
from gmwm.measuring.variance.biweight import EFFICIENCY, biweight
from gmwm.recording.options import as_confidence

if TYPE_CHECKING:
    from gmwm.showing.plots.labels import UnitSystem
    from gmwm.theory.processes.model import ModelLike

T = TypeVar("T")


@contextmanager
def named_as_options(options: Mapping[str, str]) -> Iterator[None]:
    """Make errors in the block name shell options, by arguments whose option has another name.

    >>> from gmwm.base.template import Dialect
    >>> from gmwm.errors import OptionError
    >>> try:
    ...     with named_as_options({"format": "--to"}):
    ...         raise OptionError(argument="format", expected="one of imu:IMAR", got="x")
    ... except OptionError as error:
    ...     print(error.text(Dialect.SHELL))
    --to must be one of imu:IMAR; got 'x'
    """
    try:
        yield
    except GmwmError as error:
        error.options = options
        raise


def checker(check: Callable[[T], object]) -> Callable[[T | None], T | None]:
    """Return a Typer callback that checks the value of an option with a function of the library."""

    def callback(given: T | None) -> T | None:
        if given is not None:
            check(given)
        return given

    return callback


_PLACE = re.compile(r"\s*(\w+)\s*=(.*)", re.DOTALL)

View = Literal["wavelet", "allan"]
Chunked = Literal["auto", "yes", "no"]
Repeated = Literal["auto", "keep"]
Transform = Literal["modwt", "dwt"]
Weighting = Literal["optimal", "diagonal"]
Criterion = Literal["asymptotic", "bootstrap"]

SHARED = """
Arguments:
    files (FILE…): Recording in any supported format; or a pattern in quotes, such as "hour_*.csv", for files that
        continue one another. If several recordings are given, they must be of one unit, and one model is fitted to all
        of them. Their lengths may differ.
    file (FILE): Recording in any supported format; or a pattern in quotes, such as "hour_*.csv", for files that
        continue one another.
Options:
    model (--model, -m MODEL): Sum of processes, as for gmwm fit. If all parameters have values, the command uses these
        values; otherwise it first fits the model to each axis.
    from_fits: Instead of --model: the fits.json of gmwm fit or the calibration.json of gmwm calibrate. It can come from
        this recording, or from another recording of the same unit at the same rate.
    idle (LENGTH): Stop after this time without new data. Default: stop at Ctrl-C or at the end of standard input.
    source (--from SOURCE): Noise without a recording: the numbers of a datasheet, such as 'gyro: N=0.15deg/√h, B=3deg/h
        over 100s; accel: N=60µg/√Hz, B=0.02mg', or a file of Kalibr, allan_variance_ros, imu_utils, OpenVINS, Kimera,
        VINS, ORB-SLAM3, LIO-SAM, FAST-LIO, KF-GINS, PX4, ArduPilot or MATLAB.
Input:
    rate: Sampling rate (Hz). Not needed if the file has time stamps.
    units (gyro=deg/s,accel=g): Units, if the file does not state them. Gyroscopes: rad/s, deg/s, mdeg/s, deg/h;
        accelerometers: m/s², g, mg, mGal, µg; position: m, cm, mm; time: s, ms, us, ns.
    columns (time,gyro_x,gyro_y,…): Axes of the columns, if the file does not name them: a list in the order of the
        columns, in which an empty item skips a column; or items axis=NAME or axis=INDEX, with indices from 0. time=
        ignores the time stamps.
    gaps: If samples are missing: use all segments between the gaps (keep), or only the longest segment (longest).
    bad_lines: If a line of a text file cannot be read: stop with an error that names the line (error), or treat the
        line as missing samples (skip).
    start (LENGTH): Start at this time after the first sample, such as 90s, 10min, 1h30m or a number of seconds.
    stop (LENGTH): Stop at this time after the first sample.
    skip (FROM-TO): Leave out a time range, such as 20min-25min after the first sample. For several ranges, repeat the
        option or use commas.
    format (NAME): Format of the file, if its content does not show it, for example imu:LN200 for .imu records of that
        sensor. If the name is unknown, the error lists all formats.
    topic (NAME): Recording to read from a file that contains several, for example a topic of a ROS bag. If the option
        is missing for such a file, the error lists the names.
    scale (gyro=1/131,accel_x=6.1e-5): Scale factors for raw counts, by sensor or axis. Each number in the file is
        multiplied by its factor.
    increments (gyro,accel): Sensors or axes whose numbers are increments of angle or velocity per sample. The
        increments are multiplied by the sampling rate; for increments in degrees, give the unit deg/s in --units.
    mount (x=-y,y=x,z=z): How the unit is mounted: the axis of the unit, with its sign, along each of x, y and z of the
        vehicle.
    axis (AXIS): Axis to use: gyro_x … accel_z, east, north, up or level, or gyro or accel for all three axes of a
        sensor. For several axes, repeat the option or use commas. Default: all axes.
    chunked: Read the recording in chunks, which needs little memory. auto: only for files of 300 MB or more. The result
        is the same.
    repeated: auto: undo faults of the logger. Repeated, frozen and interpolated values are left out, and values that
        wrapped around are moved back. keep: use all values as they are.
Estimation:
    within (MODEL): Largest model; all models that are part of it are compared. auto: search for the model with the
        wavelet variance and the spectrum.
    against (COVARIATES): Remove the effect of covariates from each axis before its noise is estimated. auto: remove the
        effect of the temperature from axes that follow it (5 % level). none: remove nothing. Otherwise: temperature,
        time or warmup with options such as temperature:2,lag (degree 2, and its rate of change), temperature:knots=2 or
        time:3; season:1y for a cycle with this period; step:2019-03-01 or step:2000d for a step at a date (UTC) or a
        time after the first sample. For several, repeat the option, or join them by +. The recording has one offset;
        +offsets gives every part between gaps its own.
    efficiency: Efficiency of the robust wavelet variance for Gaussian noise, 0.3 to 0.99. Lower values suppress
        outliers close to the noise; higher values tolerate more distant outliers. Default: 0.6.
    weighting: Weight the levels in the fit by the inverse of their covariance matrix (optimal) or of their variances
        (diagonal).
    criterion: Compute the penalty of a model, for the comparison of models, from theory (asymptotic) or from simulated
        records (bootstrap).
    confidence (LEVEL): Confidence level of the intervals, and of the comparison of models.
    seed (≥ 0): Seed of the simulated records.
    transform: Use the maximal-overlap transform (modwt), or the decimated transform (dwt), whose estimates have a
        larger variance.
    robust: Use the robust wavelet variance, which is insensitive to outliers.
    likelihood (--likelihood, --ml): Fit the model by maximum likelihood, starting from the wavelet fit. With
        --from-fits, use the maximum-likelihood fit in the file.
Parallel work:
    scheduler (ADDRESS): Address of a Dask scheduler, such as tcp://10.0.0.5:8786. Each worker reads a part of the
        recording and needs the file at the same path. Default: this process.
    workers (≥ 1): Number of processes on this machine; each reads a part of the recording. Default: threads in one
        process.
Result:
    view: Show the wavelet variance over the scale, or the Allan deviation over the averaging time. By default, pictures
        show the Allan deviation, and tables the wavelet variance.
    datasheet (--datasheet/--si): Use deg/h and mg, or rad/s and m/s². By default, pictures of the Allan deviation have
        deg/h and mg, and everything else has rad/s and m/s².
    plot: Plot to this .png, .pdf or .svg file.
    json: Print only JSON on stdout; warnings and progress go to stderr.
    all_remarks: Show all remarks instead of the five most severe.
"""
"""Options that several commands have, by the name of their parameter; see `option_texts`."""
_CHECKS: Mapping[str, Callable[[Any], object]] = {"efficiency": biweight, "confidence": as_confidence}
"""Functions of the library that check the value of an option before the command runs."""
_ENTRY = re.compile(r"(?m)^    (\w+)(?: \((.*?)\))?: (.*)$")
_MARKS = re.compile(r"((?:--?[\w/-]+(?:, | |$))*)(.*?) ?(?:≥ (\d+)|(\d+) … (\d+))?")


@dataclass(frozen=True)
class OptionText:
    """The text of a parameter of a command: heading, names, placeholder and limits, and help."""

    heading: str
    marks: str
    help: str

    def annotate(self, name: str, hint: Any) -> Any:
        """Return the type of the parameter with the option or the argument that Typer makes of it."""
        match = _MARKS.fullmatch(self.marks)
        assert match is not None
        names, metavar, least, low, high = match.groups()
        if self.heading == "Arguments":
            return Annotated[hint, typer.Argument(help=self.help, metavar=metavar or None)]
        shell_names = names.strip().split(", ") if names else [f"--{name.replace('_', '-')}"] if hint is bool else []
        smallest = least or low
        return Annotated[hint, typer.Option(
            *shell_names, help=self.help, metavar=metavar or None,
            min=None if smallest is None else int(smallest), max=None if high is None else int(high),
            callback=checker(_CHECKS[name]) if name in _CHECKS else None,
            rich_help_panel=None if self.heading == "Options" else self.heading,
        )]  # fmt: skip


def option_texts(docstring: str) -> tuple[str, dict[str, OptionText]]:
    """Divide the docstring of a command into the help of the command and the texts of its parameters.

    A text has a heading, the name of the parameter and, in parentheses, the names of the option unless it has the name
    of the parameter, the placeholder of its value, and its limits. The heading Arguments has arguments without a name.

    >>> option_texts("Count.\\n\\nResult:\\n    seed (--seed, -s N ≥ 0): Seed of the\\n        draws.")
    ('Count.', {'seed': OptionText(heading='Result', marks='--seed, -s N ≥ 0', help='Seed of the draws.')})
    """
    text, *sections = re.split(r"(?m)^([A-Z][a-z ]+):\n(?=    )", docstring)
    return text.strip(), {
        name: OptionText(heading, marks, help)
        for heading, entries in zip(sections[::2], sections[1::2], strict=True)
        for name, marks, help in _ENTRY.findall(entries.replace("\n        ", " "))
    }


def joined_against(parts: Sequence[str] | None, default: str) -> str:
    """Return the values of all options --against as one text."""
    text = " + ".join(parts) if parts else default
    Asked.of(text)
    return text


def unit_system(datasheet: bool | None) -> Literal["si", "datasheet"]:
    """Return the units of tables that --datasheet selects."""
    return "datasheet" if datasheet else "si"


def picture_units(datasheet: bool | None) -> UnitSystem:
    """Return the units of pictures that --datasheet and --si select."""
    return "auto" if datasheet is None else unit_system(datasheet)


def parse_within(text: str) -> gmwm.Model:
    """Parse the value of --within to a model.

    >>> parse_within("GM + WN")
    Model('GM + WN')
    """
    try:
        return gmwm.Model.parse(text)
    except ModelError as error:
        error.prefix = "within"
        raise


def parse_searched(text: str) -> gmwm.Model | str:
    """Parse the value of --within in commands that also accept "auto".

    >>> parse_searched("auto"), parse_searched("GM + WN")
    ('auto', Model('GM + WN'))
    """
    from gmwm.calibration.options import SEARCHED

    return text if text == SEARCHED else parse_within(text)


def chosen_efficiency(
    robust: bool, efficiency: float | None, advice: str = "Add {--robust}, or leave {--efficiency} out."
) -> float:
    """Return the efficiency of the robust wavelet variance, 0.6 by default."""
    if efficiency is not None and not robust:
        raise OptionError(
            "--efficiency applies only to the robust wavelet variance", argument="efficiency", got=efficiency,
            advice=advice,
        )  # fmt: skip
    return EFFICIENCY if efficiency is None else efficiency


def parse_models(texts: Sequence[str]) -> dict[str, ModelLike] | str:
    """Parse the values of --model, and return the models by axis or sensor, or one model for all axes.

    >>> parse_models(["gyro=WN(sigma2=4e-8)", "accel_z=QN(q2=1e-6)"])
    {'gyro': 'WN(sigma2=4e-8)', 'accel_z': 'QN(q2=1e-6)'}
    >>> parse_models(["WN(sigma2=4e-8)"])
    'WN(sigma2=4e-8)'
    """
    matches = [_PLACE.fullmatch(text) for text in texts]
    if len(texts) == 1 and matches[0] is None:
        return texts[0]
    models: dict[str, ModelLike] = {}
    for text, match in zip(texts, matches, strict=True):
        if match is None:
            raise OptionError(argument="model", expected=f"AXIS=MODEL, such as gyro='{text}', if repeated", got=text)
        if match[1] not in (*SI_UNIT, *AXES):
            expected = f"[AXIS=]MODEL with an axis of {', '.join((*SI_UNIT, *AXES))}"
            raise OptionError(argument="model", expected=expected, got=match[1])
        if match[1] in models:
            raise OptionError(
                f"{match[1]} has two models", argument="model", got=match[1], advice="Write its processes as one sum."
            )
        models[match[1]] = match[2].strip()
    return models
