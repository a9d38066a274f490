"""gmwm select: which model within a general one an axis calls for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.calibration.options import WITHIN
from gmwm.cli.measuring import InPieces, opened, signals_or_curves
from gmwm.cli.options import (
    RESULT,
    ChoiceWeighting,
    Confidence,
    CriterionName,
    Efficiency,
    Json,
    Robust,
    Seed,
    Within,
    chosen_efficiency,
    parse_within,
)
from gmwm.cli.read_options import Axes, File, Opening, chosen_names, opens
from gmwm.errors import OptionError

if TYPE_CHECKING:
    from gmwm.selection import Ranking
    from gmwm.signals import Signal
    from gmwm.variance.result import WaveletVariance

EXAMPLES = (
    "gmwm select static.csv --axis gyro_y --within '3*GM + WN + QN + RW'",
    "gmwm select static.csv --axis gyro_y --plot ranking.png",
    "gmwm select static.csv --output results --json",
)


@opens
def select(
    file: File,
    opening: Opening,
    axis: Axes = None,
    within: Within = WITHIN,
    robust: Robust = False,
    efficiency: Efficiency = None,
    weighting: ChoiceWeighting = "optimal",
    criterion: CriterionName = "asymptotic",
    confidence: Confidence = 0.95,
    seed: Seed = 0,
    in_pieces: InPieces = "auto",
    limit: Annotated[int, typer.Option(help="Models to print for each axis.", min=1, rich_help_panel=RESULT)] = 10,
    plot: Annotated[
        Path | None,
        typer.Option(help="Draw the best models of one axis to this .png, .pdf or .svg file.", rich_help_panel=RESULT),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            help="Write rankings.json, and a picture of the best models of each axis, into this directory.",
            rich_help_panel=RESULT,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """Compare every model within a general one, for each axis.

    The wavelet information criterion (WIC) is the objective plus what it would be larger by on another record of the
    same kind. All models have the weights of the general one. Those that the data cannot tell from the best are
    marked, and the simplest of them is recommended.
    """
    from gmwm.cli.output import made_directory, print_json, print_written, told_warnings
    from gmwm.cli.parallel import over_axes

    largest = parse_within(within)
    with told_warnings() as told:
        recording = opened(file, opening, in_pieces)
        signals = chosen_names(recording.axes, axis)
        if plot is not None and len(signals) > 1:
            raise OptionError(f"--plot draws one axis, {', '.join(signals)} are chosen; pass --axis, or take --output")
        if output is not None:
            made_directory(output)
        strength = chosen_efficiency(robust, efficiency)
        measured = signals_or_curves(recording, axis, robust=robust, efficiency=strength, told=told)

        def ranked(signal: Signal | WaveletVariance) -> Ranking:
            from gmwm.selection import select as select_within

            return select_within(
                largest, signal, weighting=weighting, criterion=criterion, confidence=confidence, seed=seed,
                robust=robust, efficiency=strength,
            )  # fmt: skip

        rankings = over_axes(ranked, measured, "comparing models")
        content = {
            "file": str(file), "within": within,
            "axes": {name: ranking.to_dict() for name, ranking in rankings.items()},
        }  # fmt: skip
        written = [] if output is None else _written(rankings, output, content)
        if plot is not None:
            written.append(_drawn(next(iter(rankings.values())), plot))
        if json:
            print_json("select", {**content, "written": list(map(str, written))}, told)
            return
        for k, (name, ranking) in enumerate(rankings.items()):
            if k:
                print()
            if len(rankings) > 1:
                print(name)
            print(ranking.summary(limit))
        print_written(written)


def _written(rankings: Mapping[str, Ranking], folder: Path, content: Mapping[str, object]) -> list[Path]:
    from gmwm._files import write_text
    from gmwm.cli.output import json_text

    path = folder / "rankings.json"
    write_text(path, json_text("select", content) + "\n")
    return [path, *(_drawn(ranking, folder / f"ranking_{name}.png") for name, ranking in rankings.items())]


def _drawn(ranking: Ranking, path: Path) -> Path:
    from gmwm.cli.output import progress

    with progress(f"drawing {path.name}"):
        ranking.plot(path=path)
    return path
