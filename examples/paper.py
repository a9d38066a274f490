"""The paper's analysis, step by step: `python examples/paper.py [--output DIR] [--data DIR] [--reduced]`.

J. Balamuta, S. Guerrier, R. Molinari and W. Yang, *A Computationally Efficient Framework for Automatic Inertial
Sensor Calibration*: the steps of its appendix "Code used in paper" with gmwm, its tables compared with ours, and its
figures.

The example simulates the Y gyroscope of a NavChip from the estimates of Table 1, so it needs no data. If the folder of
data exists, it also uses the published wavelet variances (NavChip, MTi-G) and a recording.
"""

from __future__ import annotations

import argparse
import json
import textwrap
import time
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import gmwm

RATE = 250.0
SAMPLES = 3_105_250
CLASSICAL = gmwm.Model.parse(
    "GM(beta=8.48, sigma2=6.48e-9) + GM(beta=0.25, sigma2=7.08e-9) + GM(beta=6.28e-3, sigma2=1.28e-8)"
    "+ WN(sigma2=6.94e-7) + QN(q2=2.29e-6) + RW(gamma2=3.90e-14)"
)
"""Table 1 of the paper, shortest correlation time first: its Gauss-Markov processes 3, 1 and 2. The simulated model."""
ROBUST = gmwm.Model.parse(
    "GM(beta=12.5, sigma2=1.33e-8) + GM(beta=0.311, sigma2=6.57e-9) + GM(beta=7.26e-3, sigma2=1.12e-8)"
    "+ WN(sigma2=5.30e-7) + QN(q2=2.74e-6) + RW(gamma2=5.44e-14)"
)
NAVCHIP = {
    "gyro_x": "2*GM + WN + DR + QN + RW",
    "gyro_y": "3*GM + WN + QN + RW",
    "gyro_z": "2*GM + WN + DR + QN + RW",
    "accel_x": "4*GM + QN + RW",
    "accel_y": "4*GM + QN + RW",
    "accel_z": "3*GM + QN",
}
"""Step 2 of the appendix."""
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def main(arguments: list[str] | None = None) -> dict[str, dict[str, Any]]:
    """Run every step whose data exist; return the results by name."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("paper-output"), help="folder for the figures")
    parser.add_argument("--data", type=Path, default=DATA, help="folder with wavelet_variance/ and recordings")
    parser.add_argument("--seed", type=int, default=2018, help="seed of the simulation")
    parser.add_argument("--reduced", action="store_true", help="a third of the samples")
    options = parser.parse_args(arguments)
    with warnings.catch_warnings():
        # The tables show what the fits warn about: terms that are zero, or that act as other processes.
        warnings.simplefilter("ignore", gmwm.errors.FitWarning)
        return every_step(options)


def every_step(options: argparse.Namespace) -> dict[str, dict[str, Any]]:
    started = time.perf_counter()
    output = made(options.output)
    found: dict[str, dict[str, Any]] = {
        "gyroscope": simulated_gyroscope(output, 2**20 if options.reduced else SAMPLES, options.seed),
        "unit": simulated_unit(output, 2**18 if options.reduced else 1_000_000, options.seed),
    }
    steps = {
        "navchip": (navchip, "wavelet_variance/navchip.json"),
        "mtig": (mtig, "wavelet_variance/mtig.json"),
        "adis": (recorded, "adis16405_static_1.parquet"),
    }
    for name, (step, file) in steps.items():
        if (options.data / file).is_file():
            found[name] = step(options.data / file, output)
        else:
            print(f"\nSkipped, because the file does not exist: {options.data / file}")
    print(f"\nFigures are in {output}. {time.perf_counter() - started:.0f} s.")
    return found


def simulated_gyroscope(output: Path, samples: int, seed: int) -> dict[str, gmwm.Fit]:
    """Steps 1 to 3 on a simulated recording: classical and robust fit, Table 1, Figs. 2 and 3."""
    head(f"The Y gyroscope of Table 1, simulated: {samples} samples at {RATE:g} Hz, seed {seed}")
    parts = CLASSICAL.simulate_terms(samples, RATE, seed)
    clean = sum(parts.values())
    # The same recording with normal instead of uniform rounding errors, of the same variance.
    errors = np.random.default_rng([seed, 1]).normal(size=samples + 1)
    normal = clean - parts["QN"] + np.sqrt(CLASSICAL.parameters["QN.q2"]) * np.diff(errors)
    fits = {
        "classical": gmwm.fit(CLASSICAL.structure, gyroscope(clean)),
        "robust": gmwm.fit(CLASSICAL.structure, gyroscope(clean), robust=True),
        "robust, normal errors": gmwm.fit(CLASSICAL.structure, gyroscope(normal), robust=True),
    }
    classical, robust, control = fits.values()
    print("Classical: the simulated values, which are the estimates of the paper, and our estimates")
    table_1(CLASSICAL, classical)
    print("\nRobust, efficiency 0.6: the estimates of the paper from its recording, and ours from the simulated one")
    table_1(ROBUST, robust)
    print("\nRobust, with normal rounding errors: the simulated values and our estimates")
    table_1(CLASSICAL, control)
    curves = (classical.wavelet_variance, robust.wavelet_variance)
    print()
    for line in gmwm.contamination(curves).summary().splitlines():
        print(textwrap.fill(line, 100))
    print(
        "This recording has no outliers, but the robust estimates differ from the classical ones in the same way\n"
        "as those of the paper: more quantization noise, less white noise, a faster third Gauss-Markov process.\n"
        "The robust estimator assumes normal noise, and rounding errors are uniform. With normal rounding errors\n"
        "it estimates the simulated values."
    )
    title = "Gyroscope Y, simulated from Table 1"
    gmwm.compare(*curves, title=title, path=output / "figure_2.png")
    classical.plot(decomposition=False, path=output / "figure_3a.png")
    classical.plot(path=output / "figure_3b.png")
    return fits


def simulated_unit(output: Path, samples: int, seed: int) -> dict[str, gmwm.selection.Ranking]:
    """Steps 4 to 7 on six simulated axes."""
    rate = 100.0
    truth = gmwm.simulation.reference_imu()
    head(f"A device with six axes, simulated: {samples} samples at {rate:g} Hz, seed {seed}")
    imu = gmwm.simulate(truth, rate=rate, samples=samples, rng=seed)
    curves = gmwm.wavelet_variance(imu)
    rankings = select_all(curves, "3*GM + WN + QN + RW", truth)
    right = [ranking[truth[axis].structure] for axis, ranking in rankings.items()]
    print(
        f"The true model is recommended on {sum(c.recommended for c in right)} of {len(right)} axes, "
        f"and equivalent to the best one on {sum(c.equivalent for c in right)}."
    )
    curves.plot(path=output / "figure_1a_simulated.png")
    curves.plot(split=False, path=output / "figure_1b_simulated.png")
    gmwm.plots.plot_imu(fits_of(rankings), path=output / "figure_4_simulated.png")
    return rankings


def navchip(file: Path, output: Path) -> dict[str, gmwm.Fit]:
    """Steps 1 and 2 on the published wavelet variances of the NavChip: Figs. 1 and 3, Table 1."""
    curves = published(file)
    head("NavChip, from its published wavelet variances: models of the appendix, weights from the limits")
    gmwm.plots.plot_imu(curves, path=output / "figure_1a.png")
    gmwm.plots.plot_imu(curves, split=False, path=output / "figure_1b.png")
    fits = {axis: gmwm.fit(model, curves[axis], weighting=weights(curves[axis])) for axis, model in NAVCHIP.items()}
    print(f"  {'axis':<8} {'model':<25} {'objective':>9}  {'gap':>9}   remarks")
    for axis, fit in fits.items():
        remarks = "; ".join(f"{remark.code} {remark.facts.get('term', '')}".rstrip() for remark in fit.remarks)
        left = f"< {100 * max(fit.gap, 1e-4):.2f} %"
        print(f"  {axis:<8} {NAVCHIP[axis]:<25} {fit.objective:9.4f}  {left:>9}   {remarks}".rstrip())
    gyro_y = fits["gyro_y"]
    paper = CLASSICAL.wavelet_variance(len(curves["gyro_y"]), RATE)
    missed = gyro_y.wavelet_variance.variance - paper
    objective = missed @ gyro_y.weighting_matrix @ missed
    print(f"\nThe Y gyroscope: objective {objective:.2f} with the paper's estimates, {gyro_y.objective:.4f} with ours")
    table_1(CLASSICAL, gyro_y)
    print(
        "The estimates of the paper are not the optimum for these data; ours are. The goodness-of-fit test rejects\n"
        "the model over these 3.5 hours, so the confidence intervals are only approximate. The standard errors of\n"
        "beta in the paper, near 1e-13, are implausible: such a recording determines beta to 10 to 30 %.\n"
        "The robust column of the paper needs the recording, which is not published."
    )
    gyro_y.plot(path=output / "figure_3b_navchip.png")
    return fits


def mtig(file: Path, output: Path) -> dict[str, gmwm.selection.Ranking]:
    """Steps 4 to 7 on the published wavelet variances of the MTi-G: Fig. 4."""
    curves = published(file)
    general = 4 * gmwm.AR1() + gmwm.WN() + gmwm.RW()
    head(f"MTi-G, from its published wavelet variances: chosen within {general.structure}")
    rankings = select_all(curves, general)
    print("The paper shows its recommended models in a figure only.")
    gmwm.plots.plot_imu(curves, path=output / "figure_1a_mtig.png")
    gmwm.plots.plot_imu(fits_of(rankings), path=output / "figure_4.png")
    return rankings


def recorded(file: Path, output: Path) -> gmwm.Calibration:
    """All steps on a recording of an ADIS 16405, with coarse quantization and knocks."""
    imu = gmwm.read(file, rate=100.0, units={"gyro": "deg/s", "accel": "g"})
    head(f"ADIS 16405, recorded for {imu.duration / 3600:.1f} h at {imu.rate:g} Hz")
    curves = {
        axis: {"classical": gmwm.wavelet_variance(signal), "robust": gmwm.wavelet_variance(signal, robust=True)}
        for axis, signal in imu.signals.items()
    }
    gmwm.plots.plot_imu(curves, path=output / "figure_2_adis.png")
    calibration = gmwm.calibrate(imu, within="4*GM + WN + RW")
    print(calibration.summary())
    calibration.plot(path=output / "figure_4_adis.png")
    return calibration


def select_all(
    curves: Mapping[str, gmwm.WaveletVariance], general: str | gmwm.Model, truth: Mapping[str, gmwm.Model] | None = None
) -> dict[str, gmwm.selection.Ranking]:
    """Choose a model within the general one for each axis, and print a table."""
    rankings = {axis: gmwm.select(general, curve) for axis, curve in curves.items()}
    print(f"  {'axis':<8} {'recommended':<18} {'least WIC':<18} {'equivalent':>10} {'p':>7}" + "   truth" * bool(truth))
    for axis, ranking in rankings.items():
        chosen = ranking.recommended
        p = "" if chosen.pvalue is None else f"{chosen.pvalue:.3f}" if chosen.pvalue >= 0.001 else "< 0.001"
        equal = f"{len(ranking.equivalent)} of {len(ranking)}"
        line = f"  {axis:<8} {chosen.structure:<18} {ranking.best.structure:<18} {equal:>10} {p:>7}"
        print(line + (f"   {truth[axis].structure}" if truth else ""))
    return rankings


def fits_of(rankings: Mapping[str, gmwm.selection.Ranking]) -> dict[str, gmwm.Fit]:
    return {axis: ranking.recommended.fit for axis, ranking in rankings.items()}


def published(file: Path) -> dict[str, gmwm.WaveletVariance]:
    """Wavelet variances with their limits, by axis."""
    record = json.loads(file.read_text(encoding="utf-8"))
    return {
        axis: gmwm.WaveletVariance.from_values(
            values,
            samples=record["samples"],
            rate=record["rate_hz"],
            lower=record["lower_95"][axis],
            upper=record["upper_95"][axis],
            unit="rad/s" if axis.startswith("gyro") else "m/s²",
            axis=axis,
        )
        for axis, values in record["variance"].items()
    }


def weights(curve: gmwm.WaveletVariance) -> np.ndarray:
    """Weights of the paper: one over the squared width of the confidence limits."""
    return (curve.upper - curve.lower) ** -2.0


def gyroscope(samples: np.ndarray) -> gmwm.Signal:
    return gmwm.Signal(samples, RATE, "rad/s", "gyro_y")


def table_1(paper: gmwm.Model, fit: gmwm.Fit) -> None:
    """Print parameters of the paper and of a fit with confidence intervals, and the goodness-of-fit test."""
    intervals = fit.confidence_intervals()
    print(f"  {'parameter':<13} {'paper':>9} {'ours':>9}   95 % interval")
    for name, value in paper.parameters.items():
        low, high = intervals[name]
        shown = f"{low:.2e} … {high:.2e}" if low else f"at most {high:.2e}"
        inside = "" if low <= value <= high else "   paper outside"
        print(f"  {name:<13} {value:9.2e} {fit.parameters[name]:9.2e}   {shown}{inside}")
    print(f"  goodness of fit: p {fit.goodness_of_fit().pvalue_in_words}")


def made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def head(title: str) -> None:
    print(f"\n{title}\n{'─' * len(title)}")


if __name__ == "__main__":
    main()
