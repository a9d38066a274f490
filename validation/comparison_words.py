"""The study of comparators in words: its table, who wins where, and its picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gmwm.showing.plots.figure import Axis, Band, Figure, Mark, Panel, Polyline, Tick
from gmwm.showing.plots.matplotlib import save
from gmwm.showing.plots.style import curve_stroke

YARDSTICK = "ML"
SHOWN = (0, 2, 4)
"""The models in the picture."""

Result = dict[str, Any]


def table(result: Result) -> str:
    """Markdown: errors of each method over those of the likelihood, then every parameter of every model."""
    lines = [_introduction(result), "", f"![{_CAPTION}](comparison.svg)", "", _CAPTION]
    lines += [
        "",
        "## Errors and time",
        "",
        _overall(result),
        "",
        *_glance(result),
        "",
        "## Each parameter",
        "",
        _LEGEND,
    ]
    for text, model in zip(result["truths"], _models(result), strict=True):
        lines += ["", f"### {model}", "", f"`{text}`. {verdict(result, model)}", "", *_parameters(result, model)]
    return "\n".join(lines)


def _introduction(result: Result) -> str:
    counts = zip(result["lengths"], zip(*result["counts"], strict=True), strict=True)
    lengths = ", ".join(f"{_range(numbers)} of {_power(samples)} samples" for samples, numbers in counts)
    return (
        f"# Comparison of estimation methods\n\nFor each model, all methods use the same simulated recordings at "
        f"{result['rate']:g} Hz. Their number depends on the model: "
        f"{lengths}.\n\n- Slopes: `gmwm.avlr`, which reads white noise, random walk and quantization noise from "
        "the Allan deviation (AVLR). Slopes (oracle): the same method, restricted to averaging times at which the "
        "true term has nearly all of the variance. A user does not know these times.\n- Vaccaro-Zaki: the best linear "
        "unbiased estimate of WN + RW from "
        "Allan variances, defined for this model only.\n- GMWM: `gmwm.fit`, including the certificate of the "
        f"optimum.\n- ML log-sampled: the exact likelihood of block means, {result['blocks']} of each length 1, 2, 4 "
        "… through the recording. This follows the idea of Nikolic and others, with a different choice of the blocks "
        "(`validation/log_sampled.py`).\n- ML: `gmwm.fit_ml`, the likelihood of all samples from a Kalman filter. "
        "Both likelihood methods start from a GMWM fit, and their time includes it.\n\nErrors are differences of "
        "logarithms, log(estimate / truth), which are relative errors if they are small. An error of more than a "
        f"factor of {result['factor']:g}, or a term estimated as zero, counts as an error of this factor. "
        "Estimated Gauss-Markov processes are matched with the true ones in the order of β. An estimated process "
        "counts as white noise if βΔt > 3, and as a random walk if βNΔt < 0.1. Quantization errors are uniform, as "
        "in a sensor; the likelihood methods assume Gaussian errors. Times are medians of processor time from samples "
        "to estimates, divided by the time of `numpy.cumsum` of the same samples."
    )


def _range(numbers: Sequence[int]) -> str:
    return f"{min(numbers)} to {max(numbers)}" if min(numbers) < max(numbers) else str(max(numbers))


_CAPTION = (
    "Errors divided by the errors of ML, by the length of the recording. "
    "Below: the range near 1, with ± 2 standard errors."
)

_LEGEND = (
    "The table has the bias and the root mean square error in %, separated by a slash, and the share of recordings in "
    "which the term is estimated as zero, if there are any. The bias includes the recordings in which the term was "
    "found; the error includes all recordings."
)


def _models(result: Result) -> list[str]:
    return list(dict.fromkeys(row["model"] for row in result["methods"]))


def _of(result: Result, **keys: Any) -> list[Result]:
    return [row for row in result["methods"] if all(row[key] == value for key, value in keys.items())]


def _lengths(result: Result) -> list[int]:
    return [int(samples) for samples in result["lengths"]]


def _power(samples: int) -> str:
    exponent = round(np.log10(samples))
    return (
        f"10{str(exponent).translate(str.maketrans('0123456789', '⁰¹²³⁴⁵⁶⁷⁸⁹'))}"
        if samples == 10**exponent
        else str(samples)
    )


def _overall(result: Result) -> str:
    """Each method against the likelihood, over all models and lengths."""
    words = []
    for method in dict.fromkeys(row["method"] for row in result["methods"] if row["method"] != YARDSTICK):
        pairs = [
            (row, next(r for r in _of(result, model=row["model"], samples=row["samples"]) if r["method"] == YARDSTICK))
            for row in _of(result, method=method)
        ]
        errors = [row["over_likelihood"] for row, _ in pairs]
        times = [row["time"] / slow["time"] for row, slow in pairs]
        span = f"{_share(min(times))} to {_share(max(times))}"
        words.append(
            f"- {method}: {_figure(min(errors))} to {_figure(max(errors))} times the errors of ML (median "
            f"{_figure(float(np.median(errors)))}), and {span} times its time"
        )
    return "\n".join(["Over all models and lengths, the methods have these errors and times:", "", *words])


def _glance(result: Result) -> list[str]:
    """Ratio to the likelihood and time, one line for each model and method."""
    heads = [f"errors, {_power(n)}" for n in _lengths(result)] + [f"time, {_power(n)}" for n in _lengths(result)]
    lines = [
        "Errors: root mean square error divided by the error of ML, as geometric mean over the parameters that a "
        "method estimates, with its standard error; below 1 the method is better than ML. Time: processor time "
        "divided by the time of `numpy.cumsum`.",
        "",
        f"| model | method | {' | '.join(heads)} |",
        "|---|---" + "|---" * len(heads) + "|",
    ]
    for model in _models(result):
        for method in dict.fromkeys(row["method"] for row in _of(result, model=model)):
            found = _of(result, model=model, method=method)
            errors = [
                "1" if method == YARDSTICK else _with_error(row["over_likelihood"], row["uncertain"]) for row in found
            ]
            some = "" if found[0]["complete"] else f" ({', '.join(found[0]['parameters'])})"
            times = [_plain(row["time"]) for row in found]
            lines.append(f"| {model} | {method}{some} | {' | '.join(errors + times)} |")
    return lines


def _with_error(number: float, error: float) -> str:
    return f"{_figure(number)} ± {float(f'{error:.1g}'):g}"


def _figure(number: float) -> str:
    return f"{number:.2f}" if number < 10 else _plain(number)


def _plain(number: float) -> str:
    """Two digits, without an exponent."""
    return f"{number:.2g}" if number < 10 else f"{float(f'{number:.2g}'):,.0f}".replace(",", " ")


def _parameters(result: Result, model: str) -> list[str]:
    rows = [row for row in result["rows"] if row["model"] == model]
    names = list(dict.fromkeys(row["parameter"] for row in rows))
    lines = [f"| samples | method | {' | '.join(names)} |", "|---|---" + "|---" * len(names) + "|"]
    for samples in _lengths(result):
        for method in dict.fromkeys(row["method"] for row in rows):
            mine = {r["parameter"]: r for r in rows if r["samples"] == samples and r["method"] == method}
            cells = [_cell(mine[name]) if name in mine else "–" for name in names]
            lines.append(f"| {_power(samples)} | {method} | {' | '.join(cells)} |")
    return lines


def _cell(row: Result) -> str:
    bias = "–" if row["bias"] is None else f"{_percent(row['bias'], '+')}"
    zero = f" ({row['zero']:.0%} zero)" if row["zero"] else ""
    return f"{bias} / {_percent(row['rmse'])}{zero}"


def _percent(share: float, sign: str = "") -> str:
    digits = 0 if abs(share) >= 0.1 else 1 if abs(share) >= 0.01 else 2
    return f"{100 * share:{sign}.{digits}f}"


def verdict(result: Result, model: str) -> str:
    """Who wins where, and by how much, from the numbers."""
    winners: dict[str, list[str]] = {}
    for samples in _lengths(result):
        here = [row for row in _of(result, model=model, samples=samples) if row["complete"]]
        best = next(row for row in here if row["method"] == row["best"])["method"]
        level = [r["method"] for r in here if r["method"] != best and r["over_best"] - 1 < 2 * r["best_uncertain"]]
        others = f", but they are not significantly smaller than those of {_listed(level)}" if level else ""
        winners.setdefault(f"{best} has the smallest errors{others}", []).append(_power(samples))
    words = [f"At {_listed(lengths)} samples {what}." for what, lengths in winners.items()]
    last = _of(result, model=model, samples=_lengths(result)[-1])
    slow = next(row["time"] for row in last if row["method"] == YARDSTICK)
    rest = [
        f"{_figure(row['over_likelihood'])} and {_share(row['time'] / slow)} for {row['method']}"
        + (f" ({', '.join(row['parameters'])} only)" if not row["complete"] else "")
        for row in last
        if row["method"] != YARDSTICK
    ]
    longest = _power(_lengths(result)[-1])
    words.append(f"At {longest} samples, the ratios to the errors and to the time of ML are {_listed(rest)}.")
    return " ".join(words)


def _share(ratio: float) -> str:
    return f"1/{_plain(1 / ratio)}" if ratio < 1 else _plain(ratio)


def _listed(words: Sequence[str]) -> str:
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def draw(result: Result, path: Path) -> None:
    """Errors over those of the likelihood against the length of the record: of all methods, and near 1 with limits."""
    from gmwm.showing.plots.matplotlib import draw as drawn

    models = [model for k, model in enumerate(_models(result)) if k in SHOWN]
    rows = tuple(tuple(panel(result, model) for model in models) for panel in (_all_methods, _near_one))
    save(drawn(Figure(rows, width=180.0, height=150.0, legend_columns=4)), path)


def _all_methods(result: Result, model: str) -> Panel:
    lines = _lines(result, model)
    top = 1.3 * max(2.0, *(float(line.y.max()) for line in lines))
    ticks = [t for t in (0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000) if t <= top]
    ticks = ticks if len(ticks) < 9 else [t for t in ticks if np.log10(t).is_integer()]
    low = min(0.7, *(float(line.y.min()) / 1.2 for line in lines))
    y = Axis("Error / error of ML", (low, top), _ticks(ticks), grid=tuple(ticks))
    return Panel(_length_axis(result), y, tuple(lines), model)


def _near_one(result: Result, model: str) -> Panel:
    marks: list[Mark] = []
    for line in _lines(result, model):
        rows = _of(result, model=model, method=line.label)
        margin = 2 * np.array([row["uncertain"] for row in rows])
        if line.label == YARDSTICK or "Vaccaro" in line.label or "GMWM" in line.label:
            marks += [Band(line.x, line.y - margin, line.y + margin, line.stroke.colour, 0.15), line]
    ticks = [0.8, 0.9, 1.0, 1.1, 1.2, 1.3, 1.4]
    y = Axis("Error / error of ML", (0.75, 1.45), _ticks(ticks), grid=tuple(ticks), linear=np.inf)
    return Panel(_length_axis(result), y, tuple(marks))


def _lines(result: Result, model: str) -> list[Polyline]:
    lines = []
    for k, method in enumerate(dict.fromkeys(row["method"] for row in result["methods"])):
        if rows := _of(result, model=model, method=method):
            x, y = (np.array([row[key] for row in rows], dtype=np.float64) for key in ("samples", "over_likelihood"))
            lines.append(Polyline(x, y, curve_stroke(k), method))
    return lines


def _length_axis(result: Result) -> Axis:
    lengths = [float(n) for n in _lengths(result)]
    ticks = tuple(Tick(n, _power(int(n))) for n in lengths)
    return Axis("Samples", (lengths[0] / 1.5, lengths[-1] * 1.5), ticks, grid=tuple(lengths))


def _ticks(values: Sequence[float]) -> tuple[Tick, ...]:
    return tuple(Tick(value, f"{value:g}") for value in values)
