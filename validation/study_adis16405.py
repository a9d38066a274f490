"""Differences between three recordings of ADIS16405 units that are calibrated together, and their intervals."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import gmwm
from gmwm.base.units import AXES
from gmwm.showing.plots.axes import quiet, signed_axis, time_axis
from gmwm.showing.plots.figure import Figure, Panel, Polyline
from gmwm.showing.plots.labels import axis_title
from gmwm.showing.plots.matplotlib import draw as drawn
from gmwm.showing.plots.matplotlib import save
from gmwm.showing.plots.style import curve_stroke
from validation.legend import legend

NAME = "adis16405"
SEED = 0
DATA = Path(__file__).resolve().parents[2] / "shared" / "data"
"""Static recordings of the Department of Geomatics Engineering, University of Calgary (R package imudata)."""
UNITS = {"gyro": "deg/s", "accel": "g"}
NUMBERS = ("N", "B")
FREEDOM = 10.0
"""Degrees of freedom from which on a level is drawn."""


def run(reduced: bool = False) -> dict[str, Any]:
    """Calibrate the recordings together, and describe their spread."""
    samples = 100.0 if reduced else None
    recordings = {
        f"recording {k}": gmwm.read(DATA / f"adis16405_static_{k}.parquet", rate=100.0, units=UNITS, stop=samples)
        for k in (1, 2, 3)
    }
    calibration = gmwm.calibrate(recordings, "WN + RW" if reduced else "auto")
    rows, curves = [], []
    for axis, found in calibration.axes.items():
        replicates = found.replicates
        assert replicates is not None
        for symbol in NUMBERS:
            entry = found.datasheet.get(symbol)
            number = next((one for one in replicates.numbers if one.symbol == symbol), None)
            if entry is None or number is None:
                continue
            value, low, high, unit = entry.in_units("datasheet")
            own = [None if one is None or one.upper_only else one.in_units("datasheet")[0]
                   for one in number.entries.values()]  # fmt: skip
            rows.append({
                "axis": axis, "symbol": symbol, "unit": unit, "own": own, "value": value, "low": low, "high": high,
                "spread": number.spread, "pvalue": replicates.pvalue, "model": found.fit.model.structure,
            })  # fmt: skip
        wv = found.fit.wavelet_variance
        used = wv.degrees_of_freedom > FREEDOM
        ratios = [(100 * (np.sqrt(one.variance / wv.variance) - 1))[used] for one in wv.recordings.values()]
        curves.append({"axis": axis, "tau": wv.tau[used], "percent": ratios})
    return {"rows": rows, "curves": curves, "recordings": list(recordings)}


def table(result: dict[str, Any]) -> str:
    """Markdown: a row for each number of each axis."""
    lines = [
        ("Three recordings of ADIS16405 units, 10 000 s at 100 Hz each, are calibrated together with the defaults."),
        *legend(
            {
                "together": "value from the mean curve with its 95 % interval, which includes the spread",
                "spread": "standard deviation between the recordings, less the contribution of estimation errors",
                "p": "p-value of the test of the hypothesis that the true value is the same in all recordings",
            }
        ),
        "",
        "| axis | number | recording 1 | 2 | 3 | together | spread | p |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in result["rows"]:
        own = " | ".join("limit" if value is None else f"{value:.3g}" for value in row["own"])
        together = f"{row['value']:.3g} ({row['low']:.3g} … {row['high']:.3g})"
        if row["low"] == 0:
            together = f"≤ {row['high']:.3g}"
        spread = "" if row["spread"] is None else f"{100 * row['spread']:.2g} %"
        p = f"{row['pvalue']:.2g}" if row["pvalue"] >= 0.001 else "< 0.001"
        lines.append(f"| {row['axis']} | {row['symbol']} ({row['unit']}) | {own} | {together} | {spread} | {p} |")
    caption = "Ratio of the wavelet deviation of each recording to the wavelet deviation of all recordings together"
    lines += ["", f"![{caption}](adis16405.svg)"]
    return "\n".join(lines)


def draw(result: dict[str, Any], path: Path) -> None:
    """Draw the ratio of the wavelet deviation of each recording to the wavelet deviation of all recordings."""
    save(drawn(picture(result)), path)


def picture(result: dict[str, Any]) -> Figure:
    """A panel for each axis, as data."""
    every = np.concatenate([np.concatenate(curve["percent"]) for curve in result["curves"]])
    panels = []
    for curve in result["curves"]:
        tau = np.array(curve["tau"])
        marks = tuple(
            Polyline(tau, np.array(values), stroke=curve_stroke(k), label=name)
            for k, (name, values) in enumerate(zip(result["recordings"], curve["percent"], strict=True))
        )
        y = signed_axis(every, "Difference from the mean (%)", linear=10.0, even=100.0)
        x = replace(time_axis(tau, "Scale τ (s)"), opposite=())
        panels.append(Panel(x, y, marks, title=axis_title(curve["axis"])))
    order = sorted(panels, key=lambda panel: [axis_title(axis) for axis in AXES].index(panel.title))
    quieter = [replace(panel, y=quiet(panel.y)) if k % 3 else panel for k, panel in enumerate(order)]
    rows = tuple(tuple(quieter[k : k + 3]) for k in range(0, len(quieter), 3))
    return Figure(rows, width=174.0, height=110.0, legend_columns=3)
