"""gmwm simulate: a static recording with known noise, as a file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gmwm.cli.command import command
from gmwm.cli.durations import parse_length
from gmwm.cli.output import Outcome, progress
from gmwm.errors import OptionError
from gmwm.signals import AXES
from gmwm.units import SI_UNIT

if TYPE_CHECKING:
    from gmwm.processes.model import Model, ModelLike
    from gmwm.signals import Imu

EXAMPLES = (
    "gmwm simulate --reference --duration 1h --output imu.csv",
    "gmwm simulate --model 'gyro=WN(sigma2=4e-8)' --duration 10min -o gyro.parquet",
    "gmwm simulate --reference --duration 10min -o imu.csv --components parts.csv",
)
_PLACE = re.compile(r"\s*(\w+)\s*=(.*)", re.DOTALL)


@command
def simulate(
    output: Annotated[
        Path, typer.Option("--output", "-o", help="File to write: .csv or .parquet.", show_default=False)
    ],
    duration: Annotated[
        str,
        typer.Option(
            help="Length of the recording: 90s, 20min, 1h30m, 2h, 1d, or a number of seconds.",
            metavar="LENGTH",
            show_default=False,
        ),
    ],
    model: Annotated[
        list[str] | None,
        typer.Option(
            "--model",
            "-m",
            help="A model with all its values: MODEL for all six axes, gyro=MODEL or accel=MODEL for three, "
            "gyro_x=MODEL for one; repeat it.",
            metavar="[AXIS=]MODEL",
            show_default=False,
        ),
    ] = None,
    reference: Annotated[
        bool,
        typer.Option("--reference", help="In place of --model: the six axes of the demo, a good MEMS unit."),
    ] = False,
    rate: Annotated[float, typer.Option(help="Samples per second (Hz).")] = 100.0,
    seed: Annotated[int, typer.Option(help="The same seed gives the same recording.", min=0)] = 1,
    components: Annotated[
        Path | None,
        typer.Option(
            help="Write the latent process of each term as well, a column each such as 'gyro_x WN \\[rad/s]': "
            ".csv or .parquet.",
            show_default=False,
        ),
    ] = None,
) -> Outcome:
    """Write a static recording whose noise is known.

    Each axis is a path of its own model (values in SI units and per sample, GM.beta in 1/s); accel_z carries
    gravity as well. Every axis draws from its own stream of the seed. With --components the recording is the same;
    less gravity, its axes are the sums of the columns of the other file.
    """
    from gmwm.simulation import models_by_axis, reference_imu
    from gmwm.writers import table_path

    if reference == bool(model):
        raise OptionError("give what to simulate as --model or as --reference, one of them")
    seconds = parse_length(duration)
    # What cannot be written is told before anything is.
    if components is not None and table_path(components).resolve() == output.resolve():
        raise OptionError(f"--components needs a file of its own, got {str(components)!r} for --output too")
    truth = models_by_axis(reference_imu() if reference else parse_models(model or []))
    imu, columns = _written(truth, rate, seconds=seconds, seed=seed, output=output, components=components)
    lines = [f"{axis:<8} {m}" for axis, m in truth.items()]
    lines.append(f"wrote {output}: {len(imu)} samples at {imu.rate:g} Hz, {imu.duration:g} s, seed {seed}")
    if components is not None:
        lines.append(f"wrote {components}: {len(columns)} columns of the same length, one for each latent process")
    return Outcome(
        command="simulate",
        document={
            "file": str(output), "seed": seed, "rate": imu.rate, "samples": len(imu), "duration": imu.duration,
            "axes": {axis: {"model": str(m), "parameters": m.parameters} for axis, m in truth.items()},
            "components": {"file": str(components), "columns": list(columns)} if columns else None,
        },
        text="\n".join(lines),
        written=(output,) if components is None else (output, components),
        listed=False,
    )  # fmt: skip


def _written(
    truth: Mapping[str, Model], rate: float, seconds: float, seed: int, output: Path, components: Path | None
) -> tuple[Imu, tuple[str, ...]]:
    """The simulated recording and the names of its latent processes, both written to their files."""
    from gmwm._text import duration_text
    from gmwm.simulation import simulate as simulated

    made = None
    with progress(f"simulating {duration_text(seconds)}"):
        if components is not None:
            made = simulated(truth, rate=rate, duration=seconds, rng=seed, components=True)
        imu = made.imu if made is not None else simulated(truth, rate=rate, duration=seconds, rng=seed)
    with progress(f"writing {output.name}"):
        imu.write(output)
        return imu, () if components is None or made is None else tuple(made.write_components(components))


def parse_models(texts: Sequence[str]) -> dict[str, ModelLike] | str:
    """What `gmwm.simulation.api` takes, from the values of --model.

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
            raise OptionError(f"with several --model each needs its axis, as gyro='{text}'; got {text!r}")
        if match[1] not in (*SI_UNIT, *AXES):
            raise OptionError(
                f"--model takes [AXIS=]MODEL with an axis of {', '.join((*SI_UNIT, *AXES))}; got {match[1]!r}"
            )
        if match[1] in models:
            raise OptionError(f"--model is given twice for {match[1]}; write its processes as one sum")
        models[match[1]] = match[2].strip()
    return models
