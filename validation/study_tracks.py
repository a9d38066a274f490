"""Errors of the filtered and the smoothed bias of a gyroscope, and their stated standard deviations.

Gyroscopes are simulated process by process, so that the bias is known: an offset and all that wanders. A stretch of
each record is taken away. The bias is estimated with the true parameters, with those of the wavelet fit, and with those
of the likelihood, all from the same record.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gmwm
from gmwm.recording.signals import Signal
from gmwm.showing.plots.axes import quiet
from gmwm.showing.plots.figure import Figure, Mark, Polyline
from gmwm.showing.plots.likelihood import WORDS, tracks_figure
from gmwm.showing.plots.matplotlib import draw as drawn
from gmwm.showing.plots.matplotlib import save
from gmwm.showing.plots.trace import extremes_there
from validation import recordings
from validation.legend import legend

NAME = "tracks"
SEED = 20261213
RATE = 100.0
SAMPLES = 60_000
OFFSET = 0.01
"""Ten minutes of a gyroscope at 100 Hz whose bias at switch-on is 0.57 °/s (rad/s)."""
GAP = (36_000, 39_000)
"""Samples that are missing: half a minute."""
SETTLED = 3_000
"""Samples at both ends that do not count: there the filter does not know the level yet, and the smoother less."""

TRUTHS = (
    "GM(beta=0.1, sigma2=4e-8) + WN(sigma2=4e-6)",
    "GM(beta=0.5, sigma2=2e-7) + WN(sigma2=4e-6) + RW(gamma2=1e-11)",
    "GM(beta=8.0, sigma2=6e-7) + GM(beta=0.15, sigma2=2e-7) + WN(sigma2=2e-6) + QN(q2=1e-6) + RW(gamma2=1e-11)",
)
"""In rad/s: angular random walks of 0.5 to 0.7 °/√h, biases that wander by 40 to 160 °/h within 0.1 to 10 s, and walks
of 3 × 10⁻⁵ rad/s/√s, which is 50 °/h in a minute."""

PARAMETERS = ("true", "GMWM", "ML")
KINDS = ("filter", "smooth")
METHODS = {"filter": "kalman_filter", "smooth": "smooth"}
TITLES = {"filter": "Bias, filtered: from the samples so far", "smooth": "Bias, smoothed: from all samples"}
DRAWN = 600
"""Columns of the picture of a study, of at most four points each."""
FIELDS = ("error", "said", "covered", "gap_error", "gap_said", "gap_covered")

Array = NDArray[np.float64]
Result = dict[str, Any]


def record(text: str, seed: int) -> tuple[Signal, Array]:
    """A record with its gap, and the true bias (N,) of every sample, those that are missing among them."""
    made = gmwm.simulate_signal(text, rate=RATE, samples=SAMPLES, rng=seed, unit="rad/s")
    terms = zip(made.model.terms, made.model.processes, strict=True)
    bias = OFFSET + sum(made[term].values for term, process in terms if process.correlation_time(RATE) != 0)
    first, last = GAP
    values = OFFSET + np.concatenate([made.signal.values[:first], made.signal.values[last:]])
    segments = ((0, first), (first, values.size))
    return Signal(values, RATE, "rad/s", "gyro_x", segments=segments, starts=(0.0, last / RATE)), np.asarray(bias)


def outcome(text: str, seed: int) -> Array:
    """Of one record: (parameters, kinds, fields) of its tracks, and (parameters, 1, 2) p-values of its residuals."""
    signal, bias = record(text, seed)
    truth = gmwm.Model.parse(text)
    fit = gmwm.fit(truth.structure, signal, certify=False)
    models = (truth, fit, gmwm.fit_ml(truth.structure, signal, start=fit))
    found = np.empty((len(PARAMETERS), len(KINDS) + 1, len(FIELDS)))
    for k, model in enumerate(models):
        for i, kind in enumerate(KINDS):
            found[k, i] = _agreement(getattr(model, METHODS[kind])(signal), bias)
        left = model.residuals(signal)
        found[k, -1] = left.ljung_box().p_value
    return found


def _agreement(tracks: gmwm.likelihood.Tracks, bias: Array) -> list[float]:
    """Mean square of the error, and of the standard deviation told; share within two of these; and in the gap."""
    low, high = tracks.band("bias")
    square, said = np.square(tracks.mean["bias"] - bias), np.square(tracks.error["bias"])
    covered = (low <= bias) & (bias <= high)
    missing = np.zeros(bias.size, dtype=bool)
    missing[slice(*GAP)] = True
    inner = ~missing
    inner[:SETTLED] = inner[-SETTLED:] = False
    return [float(np.mean(values[part])) for part in (inner, missing) for values in (square, said, covered)]


def run(reduced: bool = False) -> Result:
    """Errors of the tracks of all records of a model together, beside what the tracks say of them."""
    count, truths = (6, TRUTHS[:1]) if reduced else (80, TRUTHS)
    rows = []
    for number, text in enumerate(truths):
        seeds = SEED + 1000 * number + np.arange(count)
        found = np.array(recordings.everywhere(partial(_of_seed, text), seeds))
        rows += [_row(text, k, i, found) for k in range(len(PARAMETERS)) for i in range(len(KINDS))]
    return {"recordings": count, "samples": SAMPLES, "rate": RATE, "offset": OFFSET, "gap": list(GAP), "rows": rows}


def _of_seed(text: str, seed: np.integer[Any]) -> Array:
    return outcome(text, int(seed))


def _row(text: str, k: int, i: int, found: Array) -> dict[str, Any]:
    """What the records (count, parameters, kinds, fields) say of one kind of track with one set of parameters."""
    mean = np.mean(found[:, k, i], axis=0)
    row: dict[str, Any] = dict(zip(FIELDS, mean.tolist(), strict=True))
    for name in ("error", "said", "gap_error", "gap_said"):
        row[name] = float(np.sqrt(row[name]))
    # Samples of one record are not independent, records are.
    spread = np.std(found[:, k, i], axis=0, ddof=1) / np.sqrt(found.shape[0])
    least = float(np.sqrt(np.mean(found[:, 0, i, 0])))
    return {
        "model": gmwm.Model.parse(text).structure, "values": text, "parameters": PARAMETERS[k], "kind": KINDS[i], **row,
        "covered_uncertain": float(spread[2]), "gap_covered_uncertain": float(spread[5]),
        "over_true": row["error"] / least, "rejected": float(np.mean(found[:, k, -1, 0] <= 0.05)),
    }  # fmt: skip


def table(result: Result) -> str:
    """Markdown: what was done, what is seen, a line for each model, parameters and kind of track, and the picture."""
    picture = f"![Bias of a gyroscope, filtered and smoothed]({NAME}.svg)"
    return "\n".join([*_words(result), "", *_lines(result), "", picture])


def _lines(result: Result) -> Iterator[str]:
    yield (
        "| model | parameters | track | RMS error | stated error | over true | in 95 % band | gap: RMS error "
        "| gap: stated error | in 95 % band | Ljung-Box rejects |"
    )
    yield "|---|---|---|---|---|---|---|---|---|---|---|"
    for r in result["rows"]:
        numbers = (f"{1e6 * r[name]:.1f}" for name in ("error", "said"))
        gap = (f"{1e6 * r[name]:.0f}" for name in ("gap_error", "gap_said"))
        yield (
            f"| {r['model']} | {r['parameters']} | {r['kind']} | {' | '.join(numbers)} | {r['over_true']:.3f} "
            f"| {r['covered']:.1%} | {' | '.join(gap)} | {r['gap_covered']:.1%} | {r['rejected']:.1%} |"
        )


def _words(result: Result) -> Iterator[str]:
    rate, gap = result["rate"], (result["gap"][1] - result["gap"][0]) / result["rate"]
    values = "; ".join(f"`{text}`" for text in dict.fromkeys(row["values"] for row in result["rows"]))
    yield (
        f"{result['recordings']} recordings of each of these gyroscopes are simulated (rad/s, {rate:g} Hz, "
        f"{result['samples'] / rate / 60:g} min, turn-on bias {result['offset']:g}, {gap:g} s missing): {values}. "
        "Each process is simulated separately, so the true bias is known: the offset and all correlated processes. "
        "The bias is estimated by `kalman_filter`, from the samples so far, and by `smooth`, from all samples. The "
        "parameters are the true ones, or the estimates of `fit` (GMWM) and `fit_ml` (ML) from the same recording."
    )
    yield from legend(
        {
            "RMS error": "root mean square difference from the true bias in 10⁻⁶ rad/s (0.2 °/h), over all recordings, "
            f"without the gap and the first and last {SETTLED / rate:g} s",
            "stated error": "root mean square of the standard deviations that gmwm states",
            "over true": "RMS error divided by the RMS error with the true parameters",
            "gap": "the same quantities within the gap",
        }
    )
    yield from ["", "The results:"]
    yield ""
    yield from map("- {}".format, _seen(result["rows"], result["recordings"]))


def _seen(rows: Sequence[dict[str, Any]], count: int) -> Iterator[str]:
    """What the rows show."""
    true, fitted = ([r for r in rows if (r["parameters"] == "true") is known] for known in (True, False))
    off, off_fitted = (max(abs(r["error"] / r["said"] - 1) for r in some) for some in (true, fitted))
    chance, chance_gap = (max(r[name] for r in rows) for name in ("covered_uncertain", "gap_covered_uncertain"))
    pairs = {kind: [r["error"] for r in rows if r["kind"] == kind] for kind in KINDS}
    smoothed = [{"share": a / b} for a, b in zip(pairs["smooth"], pairs["filter"], strict=True)]
    wider = [{"times": row["gap_error"] / row["error"]} for row in rows]
    yield (
        f"With the true parameters the errors agree with the stated standard deviations within {off:.1%}, and "
        f"{_span(true, 'covered')} of the samples are in the 95 % band. The standard error of this share is at most "
        f"{chance:.1%}."
    )
    yield (
        f"With fitted parameters the errors are {_span(fitted, 'over_true', '.3f')} times as large, and agree with "
        f"the stated ones within {off_fitted:.1%}. {_span(fitted, 'covered')} of the samples are in the band, "
        "although it treats the parameters as known."
    )
    yield f"The error of a smoothed bias is {_span(smoothed, 'share', '.2f')} times the error of a filtered bias."
    yield (
        f"In the gap the errors are {_span(wider, 'times', '.1f')} times as large, and the band is wider by the same "
        f"factor. {_span(true, 'gap_covered')} of the samples are in it with the true parameters, "
        f"{_span(fitted, 'gap_covered')} with fitted ones. The standard error of this share is at most "
        f"{chance_gap:.1%}."
    )
    yield (
        f"The Ljung-Box test at 5 % rejects {_span(true, 'rejected')} of the recordings with the true parameters and "
        f"{_span(fitted, 'rejected')} with fitted ones. The standard error of this share is "
        f"{(0.05 * 0.95 / count) ** 0.5:.1%}."
    )


def _span(rows: Sequence[dict[str, Any]], name: str, form: str = ".1%") -> str:
    """From the least to the greatest of a column."""
    ends = [format(end(row[name] for row in rows), form) for end in (min, max)]
    return ends[0] if ends[0] == ends[1] else f"{ends[0]} to {ends[1]}"


def draw(result: Result, path: Path) -> None:
    """A record of the first model: its bias filtered and smoothed, through the gap, with the truth."""
    save(drawn(picture()), path)


def picture() -> Figure:
    """Record, filtered and smoothed bias of the first record of the first model, as data."""
    signal, bias = record(TRUTHS[0], SEED)
    model = gmwm.Model.parse(TRUTHS[0])
    rows = []
    for kind, title in TITLES.items():
        (over,), (alone,) = tracks_figure(getattr(model, METHODS[kind])(signal), truth=bias).rows
        assert over is not None
        assert alone is not None
        rows += [over] * (not rows) + [replace(alone, title=title)]
    named = [replace(panel, marks=tuple(_plain(mark) for mark in panel.marks)) for panel in rows]
    panels = [replace(panel, x=quiet(panel.x)) for panel in named[:-1]] + named[-1:]
    return Figure(tuple((panel,) for panel in panels), width=174.0, height=150.0, legend_columns=4)


def _plain(mark: Mark) -> Mark:
    """A mark of fewer points, as a screen shows them; its title says whether it is filtered or smoothed."""
    if not isinstance(mark, Polyline):
        return mark
    index = extremes_there(mark.y, DRAWN)
    label = "Estimate" if mark.label in WORDS.values() else mark.label
    return replace(mark, x=mark.x[index], y=mark.y[index], label=label)
