"""Appendix A of the paper: seconds from samples to a fit of 3·GM, by R and by gmwm."""

from __future__ import annotations

import json
from pathlib import Path

DOCS = Path(__file__).resolve().parent.parent / "docs"

PAPER: dict[tuple[str, int], tuple[float, float]] = {
    ("classical", 100): (0.0100, 0.1216),
    ("classical", 1_000): (0.0188, 0.1386),
    ("classical", 10_000): (0.0300, 0.2005),
    ("classical", 100_000): (0.1408, 0.3411),
    ("classical", 1_000_000): (1.5473, 1.7917),
    ("robust", 1_000): (0.0327, 0.1666),
    ("robust", 10_000): (0.0816, 0.2516),
    ("robust", 100_000): (0.6839, 0.8556),
    ("robust", 1_000_000): (11.4097, 11.5957),
}
"""Seconds of the R package gmwm for each estimate and number of samples, from the true values and from the best of
20 000 guesses: the tables in Appendix A of Balamuta, Guerrier, Molinari and Yang (2018), without their machine."""


def section() -> str:
    """Markdown: the paper's seconds beside those of `make bench` and the objectives of the study of starting values."""
    benchmarks, starts = (
        json.loads((DOCS / name).read_text(encoding="utf-8")) for name in ("benchmarks.json", "validation/starts.json")
    )
    seconds = {timing["name"]: timing["seconds"] for timing in benchmarks["timings"]}
    worst = {(row["robust"], row["samples"], row["start"]): row["worst"] for row in starts["rows"]}
    machine = benchmarks["machine"]
    lines = [
        "## The benchmark of the paper",
        "",
        "Appendix A of the paper (2018) has the seconds that the R package gmwm takes from samples to a fit of 3\\*GM. "
        "It names neither the machine nor the parameters. The seconds of gmwm, with a proof of the optimum, are from "
        f"[`make bench`](../benchmarks.md) on another machine ({machine['processor']}, {machine['processors']} "
        "processors), so that small ratios mean little. R gmwm 3.0.0 was run on "
        "2026-11-28: from its guesses, it ended at objectives 10³ to 10⁶ times above the optimum, from 10⁴ samples on. "
        "The last column is the worst objective that gmwm reaches from the guesses that the paper describes, over the "
        f"optimum, in {starts['recordings']} recordings ([study](starts.md)).",
        "",
        "| variance | samples | R, true values (s) | R, 20 000 guesses (s) | gmwm (s) | R / gmwm | guesses / optimum |",
        "|---|---|---|---|---|---|---|",
    ]
    for (variance, samples), (exact, guessed) in PAPER.items():
        ours = seconds[f"3*GM, {variance}, N = {samples}: convex"]
        ratio = worst[variance == "robust", samples, "20000 draws"]
        lines.append(
            f"| {variance} | {samples} | {exact:.3g} | {guessed:.3g} | {ours:.2g} | "
            f"{_two_digits(exact / ours)}–{_two_digits(guessed / ours)} | {ratio:.4g} |"
        )
    return "\n".join(lines)


def _two_digits(ratio: float) -> str:
    return f"{float(f'{ratio:.2g}'):g}"
