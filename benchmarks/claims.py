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


def _likelihood(words: str, said: float, unit: str, measured: Callable[[Results], float]) -> Claim:
    return Claim("docs/likelihood.md", words, said, unit, measured)


FIT = "fit from a wavelet variance, certified"
WEAK = "log-likelihood of GM+WN+RW with a weak walk, 10^6 samples"
LARGE = "value, slope and information of 3*GM + WN + QN + RW, 10^5 samples"
LIKELIHOOD = "log-likelihood of GM+WN+RW, 10^5 samples"
SIX = "gmwm calibrate, six axes, csv"
OF_A_MILLION = "of GM+WN, 10^6 samples"
CHUNKS = "10^7 samples in chunks of 1000000"
ROBUST = "robust, efficiency 0.6: white noise"

CLAIMS = (
    # --- the wavelet variance ---
    _readme("takes as long as `numpy.cumsum` of the same array", 1, "",
            lambda r: r.ratio("gmwm.wavelet_variance of 10^6", "np.cumsum")),
    _readme("that of 10⁷ samples at 23 levels 1.9 times", 1.9, "",
            lambda r: r.ratio("gmwm.wavelet_variance of 10^7", "np.cumsum")),
    _readme("a plain NumPy pyramid takes 7 times as long as the kernel", 1 / 7, "",
            lambda r: r.ratio("kernel, 19 levels of 10^6", "NumPy pyramid")),
    _readme("takes a seventh of allantools' time", 1 / 7, "",
            lambda r: r.ratio("overlapping Allan, octaves of 10^6", "allantools")),
    _readme("10⁷ a seventeenth", 1 / 17, "",
            lambda r: r.ratio("overlapping Allan, octaves of 10^7", "allantools")),
    _readme("PyWavelets' stationary transform takes 15 times as long for 8 levels of 2²⁰ samples", 1 / 15, "",
            lambda r: r.ratio("gmwm.wavelet_variance, 8 levels of 2^20", "pywt.swt")),
    _readme("The robust wavelet variance of 10⁶ samples takes 5 times as long as `numpy.cumsum`", 5, "",
            lambda r: r.ratio(ROBUST)),
    _readme("with 1 outlier in 1000 samples 7 times", 7, "",
            lambda r: r.ratio("robust, efficiency 0.6: 1 outlier in 1000")),
    _readme("8 times where most coefficients are zero", 8, "",
            lambda r: r.ratio(f"{ROBUST} in steps of 3 σ")),
    # --- streams ---
    _readme("A sample takes as long as in memory", 1, "", lambda r: r.ratio(CHUNKS, "in memory")),
    _readme("4 to 6 ns on the machine below", 6, "ns", lambda r: 1e9 * r.took(CHUNKS, "in memory") / 10**7),
    _readme("counting takes four times as long as the classical curve", 4, "",
            lambda r: r.ratio(f"{CHUNKS}, robust", "in chunks")),
    _readme("keeps a bounded state, some MB an axis", 10, "MB",
            lambda r: r.child("wavelet variance, in chunks")["state"] / 1e6),
    _readme("made on the fly take 6 ns each in chunks", 6, "ns",
            lambda r: 1e9 * r.per_sample("wavelet variance, in chunks", 10**9)),
    _readme("and 110 MB in all", 110, "MB", lambda r: r.child("wavelet variance, in chunks")["peak"] / 1e6),
    # --- fits, covariance, choice ---
    _readme("takes 15 to 22 times as long as that `numpy.cumsum`", 22, "", lambda r: r.ratio(FIT)),
    _readme("(50 to 75 ms)", 75, "ms", lambda r: 1e3 * r.took(FIT)),
    _readme("AR(2) + WN takes 0.3 s at 10⁶", 0.3, "s", lambda r: r.took("covariance of AR(2) + WN")),
    _readme("beside a walk 4 s", 4, "s", lambda r: r.took("covariance of AR(2) + WN + RW")),
    _readme("4·GM + WN + QN + RW + DR takes 190 times as long", 190, "",
            lambda r: r.ratio("selection from a wavelet variance")),
    _readme("(0.64 s)", 0.64, "s", lambda r: r.took("selection from a wavelet variance")),
    # --- the shell ---
    _readme("from the shell to its files, 10 s", 10, "s", lambda r: r.child(SIX)["seconds"]),
    _readme("and 300 MB on two cores", 300, "MB", lambda r: r.child(SIX)["peak"] / 1e6),
    _readme("from then on it takes some ten seconds", 10, "s", lambda r: r.child("gmwm demo")["seconds"]),
    # --- likelihood ---
    _readme("A log-likelihood takes 1.3 times as long as `numpy.cumsum` at 10⁷ samples", 1.3, "",
            lambda r: r.ratio("log-likelihood of GM+WN, 10^7 samples", "np.cumsum")),
    _readme("and 1/22 of the time of statsmodels", 1 / 22, "", lambda r: r.ratio(LIKELIHOOD, "statsmodels")),
    _likelihood("| log-likelihood | 5.3 ms | 1.6", 1.6, "",
                lambda r: r.ratio(f"log-likelihood {OF_A_MILLION}", "np.cumsum")),
    _likelihood("| with its slope and the information | 53 ms | 16 |", 16, "",
                lambda r: r.ratio(f"value, slope and information {OF_A_MILLION}", "np.cumsum")),
    _likelihood("| `fit_ml` from a wavelet fit | 240 ms | 70;", 70, "",
                lambda r: r.ratio(f"maximum likelihood from a wavelet fit {OF_A_MILLION}", "np.cumsum")),
    _likelihood("10 of the wavelet fit", 10, "",
                lambda r: r.ratio(f"the same, against the wavelet fit {OF_A_MILLION}", "gmwm.fit")),
    _likelihood("| filter | 110 ms | 32 |", 32, "", lambda r: r.ratio(f"filtering {OF_A_MILLION}", "np.cumsum")),
    _likelihood("| smooth | 250 ms | 74 |", 74, "", lambda r: r.ratio(f"smoothing {OF_A_MILLION}", "np.cumsum")),
    _likelihood("4.3 ns for the record and its level", 4.3, "ns",
                lambda r: 1e9 * r.took("log-likelihood of GM+WN, 10^7 samples", "np.cumsum") / 10**7),
    _likelihood("as with a weak walk, a sample takes 17 ns", 17, "ns",
                lambda r: 1e9 * r.took(WEAK, "np.cumsum") / 10**6),
    _likelihood("slope and information some 0.7 µs", 700, "ns",
                lambda r: 1e9 * r.took(LARGE, "np.cumsum") / 10**5),
)  # fmt: skip
