"""Every figure of time and memory that the words state, and where the suite measures it.

A claim quotes the words, so that the test of this list fails where they were changed and the list was not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from benchmarks.results import Results

ROOT = Path(__file__).resolve().parent.parent
MARGIN = 1.12
"""A claim is kept by what is measured up to so many times larger: runs differ, machines more."""
MODEST = 0.6
"""One that measures less than this share of what it says could say more."""


@dataclass(frozen=True)
class Claim:
    """`words` in `file` say that something is at most `said`, in `unit` ("" for a ratio); `measured` finds it."""

    file: str
    words: str
    said: float
    unit: str
    measured: Callable[[Results], float]

    def verdict(self, results: Results) -> str:
        """Whether it is kept."""
        share = self.measured(results) / self.said
        return "no" if share > MARGIN else "yes, and more" if share < MODEST else "yes"

    def is_there(self) -> bool:
        """Whether the file still has the words."""
        return " ".join(self.words.split()) in " ".join((ROOT / self.file).read_text(encoding="utf-8").split())


def _readme(words: str, said: float, unit: str, measured: Callable[[Results], float]) -> Claim:
    return Claim("README.md", words, said, unit, measured)


FIT = "fit from a wavelet variance, certified"
SIX = "gmwm calibrate, six axes, csv"
CHUNKS = "10^7 samples in chunks of 1000000"
ROBUST = "robust, efficiency 0.6: white noise"

CLAIMS = (
    # --- the wavelet variance ---
    _readme("19 levels | 1.2 × `numpy.cumsum` of the same array", 1.2, "",
            lambda r: r.ratio("gmwm.wavelet_variance of 10^6", "np.cumsum")),
    _readme("23 levels | 1.5 × `numpy.cumsum`", 1.5, "",
            lambda r: r.ratio("gmwm.wavelet_variance of 10^7", "np.cumsum")),
    _readme("with limits | 1/7 of allantools", 1 / 7, "",
            lambda r: r.ratio("overlapping Allan, octaves of 10^6", "allantools")),
    _readme("robust wavelet variance of 10⁶ samples | 5 × `numpy.cumsum`", 5, "",
            lambda r: r.ratio(ROBUST)),
    # --- streams ---
    _readme("10⁹ samples in chunks | 2.8 ns per sample", 2.8, "ns",
            lambda r: 1e9 * r.per_sample("wavelet variance, in chunks", 10**9)),
    _readme("and 90 MB |", 90, "MB", lambda r: r.child("wavelet variance, in chunks")["peak"] / 1e6),
    # --- fits, covariance, choice ---
    _readme("3·GM + WN + QN + RW | 2.4 × `numpy.cumsum`", 2.4, "", lambda r: r.ratio(FIT)),
    _readme("(8 ms)", 8, "ms", lambda r: 1e3 * r.took(FIT)),
    _readme("4·GM + WN + QN + RW + DR | 0.15 s", 0.15, "s", lambda r: r.took("selection from a wavelet variance")),
    # --- the shell ---
    _readme("two cores | 4.4 s", 4.4, "s", lambda r: r.child(SIX)["seconds"]),
    _readme("and 370 MB |", 370, "MB", lambda r: r.child(SIX)["peak"] / 1e6),
)  # fmt: skip
