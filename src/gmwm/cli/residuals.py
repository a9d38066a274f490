"""gmwm residuals: test whether the residuals of a model are white noise."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gmwm
from gmwm.base.text import p_text
from gmwm.cli.command import command
from gmwm.cli.measuring import tell_inspection
from gmwm.cli.model_source import AxisModel, axes_of, axis_models, model_source
from gmwm.cli.options import chosen_efficiency
from gmwm.cli.output import Outcome, file_names, over_axes, plot_file, table_text
from gmwm.cli.read_options import chosen_axes, load, require_one_axis
from gmwm.recording.options import ReadOptions

if TYPE_CHECKING:
    from gmwm.fitting.likelihood import Residuals

EXAMPLES = (
    'gmwm residuals static.csv --model "GM + WN + RW"',
    'gmwm residuals static.csv --model "GM + WN" --ml --axis gyro_y --plot res.png',
    "gmwm residuals static.csv --from-fits results/calibration.json --json",
)


@command
def residuals(
    file: Path,
    reading: ReadOptions,
    model: str | None = None,
    from_fits: Path | None = None,
    axis: list[str] | None = None,
    likelihood: bool = False,
    robust: bool = False,
    efficiency: float | None = None,
    lags: int | None = None,
    plot: Path | None = None,
) -> Outcome:
    """Test the residuals of a model, which are the standardized innovations of its Kalman filter.

    If the model is right, the residuals are white, with mean 0 and standard deviation 1. They are also normally
    distributed if all noise is. The Ljung-Box test rejects whiteness if a process is missing or has wrong values. The
    Jarque-Bera test rejects normality if the recording has coarse quantization, knocks or other outliers; in a long
    recording, even small deviations are enough.

    Result:
        lags (≥ 1): Number of lags of the Ljung-Box test. Default: 10 log₁₀ n for n samples.
        plot: Plot the residuals of one axis, their quantiles and their autocorrelation to this .png, .pdf or .svg file.
    """
    source = model_source(
        model, from_fits, likelihood=likelihood, robust=robust, efficiency=chosen_efficiency(robust, efficiency)
    )
    imu = load(file, reading)
    signals = axes_of(source, chosen_axes(imu, axis), bool(axis))
    require_one_axis(list(signals), plot)
    tell_inspection(imu)
    models = axis_models(source, signals, file)
    by_axis = _residuals(models, signals)
    checks = {name: result.to_dict(lags) for name, result in by_axis.items()}
    first = next(iter(by_axis.values()))
    files = plot_file(plot, lambda path: first.plot(lags, path=path))
    axes = {name: {**models[name].to_dict(), **check} for name, check in checks.items()}
    return Outcome(
        command="residuals", document={"file": str(file), "axes": axes, "written": file_names(files)},
        text=_text(models, checks), files=files,
    )  # fmt: skip


def _residuals(models: Mapping[str, AxisModel], signals: Mapping[str, gmwm.Signal]) -> dict[str, Residuals]:
    from gmwm.fitting.likelihood import residuals as residuals_of

    def one(signal: gmwm.Signal) -> Residuals:
        axis_model = models[signal.axis]
        return residuals_of(axis_model.model, signal, estimated=None if axis_model.own else 0)

    return over_axes(one, signals, "checking residuals")


def _text(models: Mapping[str, AxisModel], checks: Mapping[str, Mapping[str, Any]]) -> str:
    first = next(iter(models.values()))
    structures = {model.values.structure for model in models.values()}
    several = len(structures) > 1
    head = f"Standardized innovations{'' if several else ' of ' + first.values.structure}, values {first.origin}"
    rows = [
        [
            name, *([models[name].values.structure] if several else []), str(check["samples"]),
            f"{check['mean']:+.4f}", f"{check['standard_deviation']:.4f}",
            f"{check['ljung_box']['statistic']:.1f}", p_text(check["ljung_box"]["p_value"]),
            f"{check['jarque_bera']['statistic']:.1f}", p_text(check["jarque_bera"]["p_value"]),
        ]
        for name, check in checks.items()
    ]  # fmt: skip
    heads = ["axis", *(["model"] if several else []), "samples", "mean", "sd", "Ljung-Box", "p", "Jarque-Bera", "p"]
    lags = next(iter(checks.values()))["ljung_box"]["lags"]
    return (
        f"{head}\n{table_text(heads, rows, texts=2 if several else 1)}\n\n"
        "If the model is right, mean is 0, sd is 1, and one p-value in twenty is below 0.05.\n"
        f"Ljung-Box: test of whiteness over {lags} lags. Jarque-Bera: test of normality,\n"
        "which coarse quantization, knocks and outliers violate."
    )
