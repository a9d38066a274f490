"""The page of the benchmarks, docs/benchmarks.md: all its numbers come from a run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.claims import CLAIMS, MARGIN
from benchmarks.kernels import bandwidth_words
from benchmarks.picture import draw
from benchmarks.results import Results
from gmwm._files import written_whole
from gmwm.plots.axes import number_text, power_text

DOCUMENTS = Path(__file__).resolve().parent.parent / "docs"
NAME = "benchmarks"

PAGE = """# How fast, and how much memory

What everyone has beside what is here, timed in turns in one process: a ratio of neighbours in time cancels what
both suffer from. Ratios are ours over the other's, medians of the pairs, on one thread where nothing else is
said; below 1 gmwm is faster. Times in ms and ns are those of one machine: {machine}. A plain copy moves
{bandwidth:.1f} GB/s there, read and written.

`make bench` runs all of it, prints it, and keeps the numbers in `build/benchmarks.json`; `make bench PAGE=1` writes
this page. Nothing here is typed by hand.

![Time of a sample against the length of the record; time against Gauss-Markov terms and axes; memory.](benchmarks.svg)

Above: the time of one sample. Small records pay for limits and checks, {small} µs a call; beyond, curves are flat
up to where a record no longer fits the caches. In chunks the working set always does. allantools and PyWavelets
are drawn up to calls of a few seconds: the stationary transform of PyWavelets filters with zeros between, so that
each level costs twice the one before. Below: fits, covariance and choice of a model from a wavelet variance of
10⁶ samples, calibration of several axes, and the largest resident set beyond that of `import gmwm`, samples
included.

## How far from memory bandwidth, and why

{kernels}

## A record of any length

{lengths}

A record of {longest} samples in chunks takes {stream:.2g} ns a sample, {over:.2f} times as long as one of 10⁷ in
memory does, and {memory:.0f} MB of memory in all, {beyond:.0f} MB beyond the import, whatever its length; what is
kept between two chunks is {state:.1f} MB.

## What the words say

What README and documents say of time and memory, and what this run found; kept is what is at most {margin:g}
times as large.

{claims}

## All ratios

{ratios}

## Memory and processes

Each in a process of its own: wall time with the start of Python, the largest resident set, and how much of that
is beyond `import gmwm`. Samples are those of all axes; a stream is drawn as it goes, which is most of its time.

{children}
"""


def write(values: dict[str, Any], folder: Path = DOCUMENTS) -> None:
    """Write numbers, page and picture: all or none."""
    results = Results(values)
    words = text(results)
    files = (folder / f"{NAME}{ending}" for ending in (".json", ".md", ".svg"))
    data, page, picture = files
    with written_whole(data) as numbers, written_whole(page) as document, written_whole(picture) as image:
        numbers.write_text(json.dumps(values, indent=1, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
        document.write_text(words, encoding="utf-8")
        draw(results, image)


def text(results: Results) -> str:
    """The page as Markdown."""
    live = results.child("wavelet variance, in chunks")
    chunks, whole = "wavelet variance, in chunks", "wavelet variance, in memory"
    longest = results.most(chunks)
    stream = results.per_sample(chunks, longest)
    return PAGE.format(
        machine=", ".join(f"{key} {value}" for key, value in results.machine.items()),
        bandwidth=results.bandwidth / 1e9, small=f"{1e9 * results.per_sample(whole, 1000):.0f}",
        kernels=bandwidth_words(results), lengths=_lengths(results), longest=power_text(longest), stream=1e9 * stream,
        over=stream / results.per_sample(whole, 10**7), memory=live["peak"] / 1e6, beyond=live["beyond"] / 1e6,
        state=live["state"] / 1e6, margin=MARGIN, claims=_claims(results), ratios=_ratios(results),
        children=_children(results),
    )  # fmt: skip


def table(head: Sequence[str], rows: Iterable[Sequence[str]], left: int = 1) -> str:
    """Rows as Markdown; columns after the first `left` stand to the right."""
    rule = [":--" if k < left else "--:" for k in range(len(head))]
    return "\n".join("| " + " | ".join(row) + " |" for row in (head, rule, *rows))


def _lengths(results: Results) -> str:
    curves = [curve for curve in results.curves if curve["along"] == "samples" and "pywt" not in curve["name"]]
    at = [n for n in (10**k for k in range(3, 10)) if any(n in curve["at"] for curve in curves)]
    rows = []
    for curve in curves:
        times = dict(zip(curve["at"], curve["seconds"], strict=True))
        rows.append([curve["name"], *(number_text(1e9 * times[n] / n, 2) if n in times else "" for n in at)])
    return table(["ns a sample", *(power_text(n) for n in at)], rows)


def _claims(results: Results) -> str:
    rows = []
    for claim in CLAIMS:
        found = claim.measured(results)
        said, measured = (_figure(value, claim.unit) for value in (claim.said, found))
        quote = " ".join(claim.words.replace("|", " ").split())
        rows.append([Path(claim.file).name, f"… {quote} …", said, measured, claim.verdict(results)])
    return table(["in", "words", "said", "found", "kept"], rows, 2)


def _figure(value: float, unit: str) -> str:
    if not unit and value < 0.3:
        return f"1/{1 / value:.2g}"
    return f"{number_text(value, 2)} {unit}".strip()


def _ratios(results: Results) -> str:
    parts = []
    for module in dict.fromkeys(row["module"] for row in results.timings):
        rows = [
            [
                row["name"], row["against"], number_text(1e3 * row["seconds"], 3), number_text(row["ratio_median"], 3),
                f"{number_text(row['ratio_min'], 2)} … {number_text(row['ratio_max'], 2)}",
            ]
            for row in results.timings if row["module"] == module
        ]  # fmt: skip
        title = module.removeprefix("bench_").replace("_", " ")
        head = table(["case", "against", "ms", "ratio", "least … largest"], rows, 2)
        parts.append(f"### {title[0].upper()}{title[1:]}\n\n{head}")
    return "\n\n".join(parts)


def _children(results: Results) -> str:
    rows = [
        [
            row["name"], power_text(row["samples"]) if row["samples"] else "", f"{row['seconds']:.2g}",
            f"{row['peak'] / 1e6:.0f}", f"{row['beyond'] / 1e6:.0f}",
        ]
        for row in results.children
    ]  # fmt: skip
    return table(["process", "samples", "s", "MB", "MB beyond the import"], rows)
