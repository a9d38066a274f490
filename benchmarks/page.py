"""The page of the benchmarks, docs/benchmarks.md: all its numbers come from a run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks import targets
from benchmarks.claims import CLAIMS, MARGIN
from benchmarks.kernels import bandwidth_words
from benchmarks.picture import draw
from benchmarks.recordings import MEASURED, RATIOS, rows_of_others, rows_of_recordings
from benchmarks.results import Results
from gmwm.base.atomic_files import written_whole
from gmwm.showing.plots.axes import number_text, power_text

DOCUMENTS = Path(__file__).resolve().parent.parent / "docs"
NAME = "benchmarks"

PAGE = """# Run time and memory

gmwm and another program are timed alternately in one process. Each ratio is the run time of gmwm divided by that of the
other program, the median over pairs of runs on one thread: below 1, gmwm is faster. Times are from one machine:
{machine}. A plain memory copy reaches {bandwidth:.1f} GB/s (bytes read plus bytes written).

`make bench PAGE=1` writes this page. No number is typed by hand.

![Time per sample by length of the record; time by number of Gauss-Markov terms and axes; memory.](benchmarks.svg)

Top: time per sample. Small records take {small} µs per call for limits and checks.
Bottom: fits, covariance and model selection from 10⁶ samples, calibration of several axes, and the largest resident
memory in addition to `import gmwm`.

## A record of any length

{lengths}

In chunks, {longest} samples take {stream:.2g} ns each, {over:.2f} times as long as 10⁷ samples in memory. They need
{memory:.0f} MB, {beyond:.0f} MB more than the import, at any length; the state between chunks is {state:.1f} MB.

`python -m benchmarks --from docs/benchmarks.json --tables` prints all ratios and limits.

## Real recordings

`gmwm calibrate` with all files, the shorter of two runs; a curve without Python's start.

{recordings}

Times of other programs were measured once {when}.
{others_as_ratios}

{others}
"""

APPENDIX = """## Appendix

### Comparison with the memory bandwidth

{kernels}

### What was asked, and what limits it

Ratios are to `numpy.cumsum` of as many samples (10⁶ for fits), unless another reference is named. *Before* is the value
at the beginning of the work on speed.

{targets}

### Statements in the documentation

The table compares statements about time and memory in README and the documentation with this run. A statement counts
as confirmed if the measured value is at most {margin:g} times the stated one.

{claims}

### All ratios

{ratios}

### Memory and processes

Each row is a separate process: wall time including the start of Python, peak resident memory, and the increase over
`import gmwm` alone. The number of samples is the sum over all axes. The samples of a stream are drawn while it runs,
which takes most of its time.

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
        lengths=_lengths(results), longest=power_text(longest), stream=1e9 * stream,
        over=stream / results.per_sample(whole, 10**7), memory=live["peak"] / 1e6, beyond=live["beyond"] / 1e6,
        state=live["state"] / 1e6, recordings=_recordings(results), when=MEASURED, others_as_ratios=RATIOS,
        others=table(["work", "program", "its time", "gmwm"], rows_of_others(results), 2),
    )  # fmt: skip


def appendix(results: Results) -> str:
    """All ratios, limits and checked statements as Markdown."""
    return APPENDIX.format(
        kernels=bandwidth_words(results), margin=MARGIN, claims=_claims(results), targets=_targets(results),
        ratios=_ratios(results), children=_children(results),
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
    return table(["ns per sample", *(power_text(n) for n in at)], rows)


def _recordings(results: Results) -> str:
    if not results.recordings:
        return "This run did not have them."
    return table(["recording", "samples", "s", "CPU-s", "MB"], rows_of_recordings(results))


def _targets(results: Results) -> str:
    return table(targets.HEAD, targets.rows(results))


def _claims(results: Results) -> str:
    rows = []
    for claim in CLAIMS:
        found = claim.measured(results)
        said, measured = (_figure(value, claim.unit) for value in (claim.said, found))
        quote = " ".join(claim.words.replace("|", " ").split())
        rows.append([Path(claim.file).name, f"… {quote} …", said, measured, claim.verdict(results)])
    return table(["file", "statement", "stated", "measured", "confirmed"], rows, 2)


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
        parts.append(f"#### {title[0].upper()}{title[1:]}\n\n{head}")
    return "\n\n".join(parts)


def _children(results: Results) -> str:
    rows = [
        [
            row["name"], power_text(row["samples"]) if row["samples"] else "", f"{row['seconds']:.2g}",
            f"{row['cpu']:.2g}" if row.get("cpu") else "", f"{row['peak'] / 1e6:.0f}" if row["peak"] else "",
            f"{row['beyond'] / 1e6:.0f}" if row["peak"] else "",
        ]
        for row in results.children
    ]  # fmt: skip
    return table(["process", "samples", "s", "s of all processors", "MB", "MB beyond the import"], rows)
