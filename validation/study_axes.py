"""What the axes of real units share: three recordings of ADIS 16405 units at rest, with ../shared/data."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np

import gmwm
from gmwm.applications.several import CrossCovariance, JointFit, cross, fit_joint, same
from gmwm.applications.several.plots import plot_cross, plot_joint
from gmwm.base.template import join_names
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.matplotlib import draw as render

NAME = "axes"
SEED = 0
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
MODEL = "shared(WN) + shared(RW) + shared(GM)"
LEVELS = range(9, 18)
TAUS = (20.48, 40.96, 81.92, 163.84)
GROUPS = {"gyro, gyro": ("gyro", "gyro"), "gyro, accel": ("gyro", "accel"), "accel, accel": ("accel", "accel")}


def recordings(reduced: bool) -> list[gmwm.Imu]:
    """The recordings, or the first 300 s of them."""
    found = [
        gmwm.read(DATA / f"adis16405_static_{k}.parquet", rate=100, units={"gyro": "deg/s", "accel": "g"})
        for k in (1, 2, 3)
    ]
    return [imu.between(stop=300.0) for imu in found] if reduced else found


def run(reduced: bool = False) -> dict[str, Any]:
    """Correlations by scale, joint fits, and differences between the recordings."""
    imus = recordings(reduced)
    rows = [_row(imu, reduced) for imu in imus]
    return {"rows": rows, "same": _differences(imus)}


def _row(imu: gmwm.Imu, reduced: bool) -> dict[str, Any]:
    found = cross(imu)
    fit = fit_joint("shared(WN)" if reduced else MODEL, imu, levels=range(5, 12) if reduced else LEVELS)
    test = fit.goodness_of_fit()
    return {
        "tests": found.tests,
        "shared": len(found.shared),
        "fine": {f"{a}, {b}": float(found.correlation[a, b][1]) for a, b in combinations(imu.axes[:3], 2)},
        "slow": {f"{tau:g}": _mean(found, tau) for tau in TAUS if tau <= found.tau[-1]},
        "fit": {
            "statistic": test.statistic, "df": test.df, "parameters": dict(fit.parameters),
            "terms": {term: _ranges(fit, term) for term in fit.terms},
            "pvalues": {term: fit.shared(term).pvalue for term in fit.terms},
        },
    }  # fmt: skip


def _mean(found: CrossCovariance, tau: float) -> list[float]:
    """Mean, least and greatest correlation of a gyroscope with an accelerometer at a scale."""
    at = int(np.argmin(np.abs(found.tau - tau)))
    values = [found.correlation[a, b][at] for a in found.axes[:3] for b in found.axes[3:]]
    return [float(np.mean(values)), float(np.min(values)), float(np.max(values))]


def _ranges(fit: JointFit, term: str) -> dict[str, list[float]]:
    """Least and greatest correlation of a term among pairs of two sensors."""
    found = {}
    for name, (one, other) in GROUPS.items():
        values = [
            float(fit.correlation[term][i, j])
            for (i, a), (j, b) in combinations(enumerate(fit.axes), 2)
            if {a.partition("_")[0], b.partition("_")[0]} == {one, other}
        ]
        found[name] = [min(values), max(values)]
    return found


def _differences(imus: list[gmwm.Imu]) -> list[dict[str, Any]]:
    """For each axis, how far the recordings differ: the levels that do, and the largest ratio of deviations."""
    rows = []
    for (k, one), (m, other) in combinations(enumerate(imus, start=1), 2):
        found = same(one, other)
        for axis in found.axes:
            fine = [abs(np.log(row.ratio)) for row in found[axis] if row.level <= 11]
            tested = [row for row in found[axis] if row.pvalue is not None]
            sure = [row for row in tested if row.differs]
            most = max(sure, key=lambda row: abs(np.log(row.ratio)), default=None)
            rows.append(
                {"pair": f"{k}, {m}", "axis": axis, "levels": len(sure), "tested": len(tested),
                 "fine": float(np.max(fine)), "most": None if most is None else [most.ratio, most.tau]}
            )  # fmt: skip
    return rows


def table(result: dict[str, Any]) -> str:
    """Markdown: correlations, joint fits and differences."""
    rows, differ = result["rows"], sum(row["levels"] > 0 for row in result["same"])
    lines = [
        "The study uses three recordings of ADIS 16405 units at rest, with 10⁶ samples of six axes at 100 Hz each. It "
        "is not known whether they come from one unit.",
        "",
        "**What is correlated.** `gmwm.cross` finds shared noise in "
        + join_names([f"{row['shared']} of {row['tests']}" for row in rows])
        + " tests (one for each pair of axes and scale, with a joint level of 5 %). At the "
        "finest scales the correlations of gyroscopes "
        "are small and the same in all recordings. At scales above about 10 s, all axes share slow noise.",
        "",
        "![Correlation of the six axes by scale, first recording](axes.svg)",
        "",
        "| correlation | " + " | ".join(f"recording {k}" for k in range(1, len(rows) + 1)) + " |",
        "|---|" + "---|" * len(rows),
        *(
            f"| {pair}, at 0.04 s | " + " | ".join(f"{row['fine'][pair]:+.4f}" for row in rows) + " |"
            for pair in rows[0]["fine"]
        ),
        *(
            f"| gyroscope and accelerometer, at {float(tau):.0f} s: mean (least to greatest) | "
            + " | ".join("{:.2f} ({:.2f} to {:.2f})".format(*row["slow"][tau]) for row in rows)
            + " |"
            for tau in rows[0]["slow"]
        ),
        "",
        f"**Result of the joint fit.** `gmwm.fit_joint(\"{MODEL}\", imu, levels=range(9, 18))` fits the scales "
        "of 5 s to 22 min. No model fits all scales of these recordings, whose output is rounded. At scales above 5 s, "
        "the misfit is moderate. The white noise of the gyroscopes is independent of all other noise. All six axes "
        "share the slow noise, most of all the accelerometers. Motion of the table or changes of the room temperature "
        "would cause this.",
        "",
        "![Deviations and correlations of the first recording, with the joint model](axes-joint.svg)",
        "",
        "| | " + " | ".join(f"recording {k}" for k in range(1, len(rows) + 1)) + " |",
        "|---|" + "---|" * len(rows),
        "| χ², degrees of freedom | "
        + " | ".join(f"{row['fit']['statistic']:.0f}, {row['fit']['df']}" for row in rows) + " |",
    ]  # fmt: skip
    for term in rows[0]["fit"]["terms"]:
        for group in GROUPS:
            cells = " | ".join("{:+.2f} to {:+.2f}".format(*row["fit"]["terms"][term][group]) for row in rows)
            lines.append(f"| correlation of {term}, {group} | {cells} |")
        cells = " | ".join(f"{row['fit']['pvalues'][term]:.1g}" for row in rows)
        lines.append(f"| p-value of independent {term} | {cells} |")
    lines += [
        "",
        f"**Whether the recordings differ.** `gmwm.same` finds differences in {differ} of {len(result['same'])} "
        "comparisons of an axis. Up to 20 s, the differences are a few per cent for gyroscopes, and up to 15 % "
        "for accelerometers. At larger scales, a test finds only large differences.",
        "",
        "| recordings | axis | scales that differ | largest difference up to 20 s | largest difference that the test "
        "finds |",
        "|---|---|---|---|---|",
        *(
            f"| {r['pair']} | {r['axis']} | {r['levels']} of {r['tested']} | {100 * np.expm1(r['fine']):.1f} % | "
            + ("none |" if r["most"] is None else f"{_percent(r['most'][0]):.0f} % at {r['most'][1]:.3g} s |")
            for r in result["same"]
        ),
    ]
    return "\n".join(lines)


def _percent(ratio: float) -> float:
    """How much larger the larger of two deviations is."""
    return float(100 * np.expm1(abs(np.log(ratio))))


def draw(result: dict[str, Any], path: Path) -> None:
    """The correlations of the first recording, and the joint fit of its gyroscopes and one accelerometer."""
    imu = recordings(reduced=False)[0]
    render(description(plot_cross)(cross(imu)), path=path)
    fit = fit_joint(MODEL, {axis: imu[axis] for axis in ("gyro_x", "gyro_y", "accel_x", "accel_y")}, levels=LEVELS)
    render(description(plot_joint)(fit), path=path.with_name("axes-joint.svg"))
