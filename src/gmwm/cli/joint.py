"""gmwm joint: fit a model of several axes at once."""

from __future__ import annotations

from pathlib import Path

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect
from gmwm.base.time_base import parse_length
from gmwm.cli.command import command
from gmwm.cli.measuring import tell_inspection
from gmwm.cli.output import Outcome, plot_file, progress
from gmwm.cli.read_options import chosen_axes, load
from gmwm.recording.options import ReadOptions

EXAMPLES = (
    'gmwm joint static.csv --axis gyro --model "shared(RW) + WN"',
    'gmwm joint static.csv --model "common(GM) + RW + WN" --plot joint.png',
)


@command
def joint(
    file: Path,
    reading: ReadOptions,
    model: str,
    axis: list[str] | None = None,
    levels: str | None = None,
    certify: bool = False,
    certify_within: str = "60s",
    plot: Path | None = None,
) -> Outcome:
    """Fit one model to several axes at once, including the noise that the axes share.

    The result has the covariance matrix of each term between the axes, the correlations with intervals, a test of the
    model, and for each shared term a test whether the axes are correlated. With --json, the result includes the
    state-space matrices of all axes together, in discrete and in continuous time. In contrast, the files of gmwm export
    describe each axis separately.

    Options:
        model (MODEL): Sum of terms: 'WN' is independent noise of each axis, 'common(RW)' is one process that acts on
            all axes with a factor for each axis, and 'shared(RW)' is noise with any correlations between the axes.
        levels (FIRST-LAST): Levels to use: a range such as 9-17, or 12 for the first twelve. Default: all levels with
            at least five coefficients.
        certify: Prove by branch and bound that no other correlation times fit better.
        certify_within (TIME): Largest time for the proof, such as 60s or 10min. If it is too short, the lower bound is
            less tight."""
    recording = load(file, reading)
    signals = chosen_axes(recording, axis)
    if len(signals) < 2:
        raise OptionError(
            f"the model is for two or more axes; got one, {next(iter(signals))}", argument="axis", got=axis,
            advice="Fit one axis with gmwm fit.",
        )  # fmt: skip
    with progress("fitting"):
        time = parse_length(certify_within) if certify else False
        joint_fit = gmwm.fit_joint(model, signals, levels=parse_levels(levels), certify=time)
    tell_inspection(recording)
    return Outcome(
        command="joint", document={"file": str(file), **joint_fit.to_dict()}, text=joint_fit.summary(Dialect.SHELL),
        files=plot_file(plot, lambda path: joint_fit.plot(path=path)),
    )  # fmt: skip


def parse_levels(text: str | None) -> int | list[int] | None:
    """Parse the value of --levels: a range gives a list of levels, a single number is returned as it is.

    >>> parse_levels("9-12"), parse_levels("12"), parse_levels(None)
    ([9, 10, 11, 12], 12, None)
    """
    if text is None:
        return None
    first, dash, last = (part.strip() for part in text.partition("-"))
    if first.isdecimal() and (not dash or last.isdecimal()):
        return int(first) if not dash else list(range(int(first), int(last) + 1))
    raise OptionError(argument="levels", expected="a number or a range such as 9-17", got=text)
