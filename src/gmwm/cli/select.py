"""gmwm select: choose the noise model of each axis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from gmwm.choosing.selection import Ranking
from gmwm.choosing.selection.ranking import SLOW, RankingOptions
from gmwm.cli.command import command
from gmwm.cli.measuring import axes_together, measure_together, memory_for, open_together
from gmwm.cli.options import Chunked, Criterion, Weighting, chosen_efficiency, joined_against, parse_within
from gmwm.cli.output import NewFile, Outcome, file_names, json_text, make_directory, optional_plots, text_file
from gmwm.cli.read_options import document_of, require_one_axis
from gmwm.measuring.regression.against import NONE
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.options import ReadOptions
from gmwm.recording.signals import Signal
from gmwm.theory.processes.model import Model

EXAMPLES = (
    'gmwm select static.csv --axis gyro_y --within "3*GM + WN + QN + RW"',
    "gmwm select static.csv --axis gyro_y --plot ranking.png",
    "gmwm select monday.csv tuesday.csv wednesday.csv --axis gyro_y",
    "gmwm select static.csv --output results --json",
)


@command
def select(
    files: list[Path],
    reading: ReadOptions,
    axis: list[str] | None = None,
    against: list[str] | None = None,
    within: str = SLOW,
    robust: bool = False,
    efficiency: float | None = None,
    weighting: Weighting = "optimal",
    criterion: Criterion = "asymptotic",
    confidence: float = 0.95,
    seed: int = 0,
    chunked: Chunked = "auto",
    limit: int = 10,
    plot: Path | None = None,
    output: Path | None = None,
) -> Outcome:
    """Compare all models that are part of a largest model, and recommend one for each axis.

    The wavelet information criterion (WIC) is the objective plus a penalty. The penalty is the expected increase of the
    objective if the fitted model is compared with another recording of the same noise. All models are fitted with the
    weights of the largest model. Models that the data cannot distinguish from the best one are marked, and the simplest
    of them is recommended.

    If several files are given, they must be recordings of one unit. The models are then fitted to the mean of their
    curves, and ranked by cross-validation: each recording is predicted by a fit to the other recordings.

    Estimation:
        within (MODEL): Largest model; all models that are part of it are compared. A term with a fixed value, such as
            WN(sigma2=fixed(1e-6)), is in all of them.
    Result:
        limit (≥ 1): Number of models to print for each axis.
        plot: Plot the best models of one axis to this .png, .pdf or .svg file.
        output (--output, -o): Write rankings.json and a plot of the best models of each axis to this directory."""
    largest, strength = parse_within(within), chosen_efficiency(robust, efficiency)
    options = RankingOptions(weighting=weighting, criterion=criterion, confidence=confidence, seed=seed)
    terms = joined_against(against, NONE)
    recordings = open_together(files, reading, chunked, whole=memory_for(terms))
    names = axes_together(recordings, axis)
    require_one_axis(names, plot, "Select one with {--axis}, or plot all with {--output}.")
    if output is not None:
        make_directory(output)
    measured = measure_together(recordings, axis, robust=robust, efficiency=strength, against=terms)
    rankings = _rank(largest, measured, options=options, robust=robust, efficiency=strength)
    axes = {name: ranking.to_dict() for name, ranking in rankings.items()}
    content = {**document_of(files), "within": within, "axes": axes}
    new_files = [] if output is None else _files(rankings, output, content)
    if plot is not None:
        new_files.append(_picture(next(iter(rankings.values())), plot))
    parts = {name: ranking.summary(limit) for name, ranking in rankings.items()}
    return Outcome(
        command="select",
        document={**content, "written": file_names(new_files)},
        text="\n\n".join(f"{name}\n{part}" if len(parts) > 1 else part for name, part in parts.items()),
        files=tuple(new_files),
    )


def _rank(
    largest: Model, measured: Mapping[str, Signal | WaveletVariance], options: RankingOptions, robust: bool,
    efficiency: float,
) -> dict[str, Ranking]:  # fmt: skip
    from gmwm.choosing.selection.api import select_within
    from gmwm.cli.output import over_axes

    return over_axes(
        lambda one: select_within(largest, one, options, robust=robust, efficiency=efficiency), measured,
        "comparing models",
    )  # fmt: skip


def _files(rankings: Mapping[str, Ranking], folder: Path, content: Mapping[str, object]) -> list[NewFile]:
    pictures = [_picture(ranking, folder / f"ranking_{name}.png") for name, ranking in rankings.items()]
    return [text_file(folder / "rankings.json", json_text("select", content) + "\n"), *optional_plots(*pictures)]


def _picture(ranking: Ranking, path: Path) -> NewFile:
    return NewFile(path, lambda target: ranking.plot(path=target), f"plotting {path.name}")
