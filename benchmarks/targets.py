"""What the round for speed began with, what it asked for, what a run finds, and what limits each kind of work."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.bench_fit import GOODNESS, INTERVALS, OPTIMAL, WHOLE
from benchmarks.results import Results
from gmwm.showing.plots.axes import number_text

CUMSUM = "np.cumsum of 10^6"
CERTIFIED = "fit from a wavelet variance, certified"
SIX = "gmwm calibrate, six axes with filters, csv"
FLEET = "gmwm fleet, units of 6 x 6x10^5 samples"
IMPORT = "import gmwm beyond NumPy"
NAMES = "import of all names beyond NumPy"


@dataclass(frozen=True)
class Target:
    """`work` took `before` when its round began (None: not measured), and should take `asked`: a ratio, s, or units/s
    (more is better)."""

    work: str
    unit: str
    before: float | None
    asked: float
    measured: Callable[[Results], float]
    limit: str

    def found(self, results: Results) -> float | None:
        """The measured value; None in a run without it."""
        try:
            return self.measured(results)
        except LookupError:
            return None

    def kept(self, value: float) -> bool:
        """Whether the target is reached."""
        return value >= self.asked if self.unit == "units/s" else value <= self.asked


def _in_memory(samples: int) -> Callable[[Results], float]:
    def ratio(results: Results) -> float:
        try:
            return results.per_sample("wavelet variance, in memory", samples) / results.per_sample("np.cumsum", samples)
        except ValueError as error:  # this run has no record of this length
            raise LookupError(samples) from error

    return ratio


def _processor(name: str) -> Callable[[Results], float]:
    def seconds(results: Results) -> float:
        return float(results.child(name).get("cpu") or _missing(name))

    return seconds


def _slowest(results: Results, name: str, key: str) -> float:
    rows = [row for row in results.recordings if name in row["name"]]
    return max(float(row[key]) for row in rows) if rows else _missing(name)


def _missing(name: str) -> float:
    raise LookupError(name)


LEVELS = "arithmetic on one running sum in the caches, once for each level; see the table above"
PARTS = "one core: imports, reading and the files at the end; both: inspection, search and fits"
TARGETS = (
    Target("wavelet variance of 10⁶ samples in memory", "", 0.97, 0.9, _in_memory(10**6), LEVELS),
    Target("wavelet variance of 10⁷ samples in memory", "", 1.9, 1.2, _in_memory(10**7), LEVELS),
    Target("wavelet variance of 10⁸ samples in memory", "", 2.3, 1.2, _in_memory(10**8),
           "the same, and memory: the samples are read twice, the second time in columns of a matrix"),
    Target("10⁷ samples in chunks of 1000, against one chunk", "", 2.7, 1.2,
           lambda r: r.ratio("10^7 samples in chunks of 1000", "one chunk"),
           "a call of Python for each chunk, and one more copy of each sample"),
    Target("fit of 3·GM + WN + QN + RW with certificate, diagonal weights", "", 9.6, 4, lambda r: r.ratio(CERTIFIED),
           "one kernel call: a nonnegative least-squares problem for each node of the search, and the weights, which "
           "follow the estimate in some iterations"),
    Target("the same with optimal weights", "", 150, 20, lambda r: r.ratio(OPTIMAL),
           "the exact covariance of all pairs of levels in each iteration: exponentials near each kink of a pair"),
    Target("confidence intervals of the fit", "", 17, 5, lambda r: r.ratio(INTERVALS),
           "one exact covariance; for a parameter at a limit, some fits with this parameter held"),
    Target("goodness of fit of the fit", "", 5, 2, lambda r: r.ratio(GOODNESS),
           "a fit without the coarsest levels, with a search before and after its weights converge, and one exact "
           "covariance"),
    Target("fit, intervals and test of AR(2) + 2·GM + RW, 10⁶ samples", "s", 3.3, 0.1,
           lambda r: r.took(WHOLE, "np.cumsum of 10^6"),
           "descents from the points of a scan, a few calls of Python a step; an exact covariance in each iteration"),
    Target("model selection, 79 candidates, one axis", "", 185, 60,
           lambda r: r.ratio("selection from a wavelet variance"),
           "a search for each candidate whose optimum no larger candidate gives, an exact covariance for each "
           "candidate that is compared with the best one and in each iteration of its test, and Python between these "
           "calls"),
    Target("`gmwm calibrate`, 6 × 10⁶ samples with filters, a resonance and a line, wall time", "s", 7.2, 3,
           lambda r: float(r.child(SIX)["seconds"]),
           "the processor time of the next row; the start of Python and the reading of the file come before the fits"),
    Target("the same, processor time", "s", 11, 6, _processor(SIX),
           "fits and selection of six axes; the file and its samples; the report and the plots; imports"),
    Target("`import gmwm` beyond NumPy", "s", 0.19, 0.08, lambda r: float(r.child(IMPORT)["seconds"]),
           "one small module: a name loads its package when it is used"),
    Target("the same with all public names", "s", 0.19, 0.08, lambda r: float(r.child(NAMES)["seconds"]),
           "modules that are read from disk, and the definition of data classes, in about equal parts"),
    Target("`gmwm --version`, wall time", "s", 0.7, 0.25, lambda r: float(r.child("gmwm --version")["seconds"]),
           "the start of Python"),
    Target("`gmwm info` of a small CSV file, wall time", "s", 0.7, 0.6,
           lambda r: float(r.child("gmwm info, csv of 200 rows")["seconds"]), "the import of Polars and of NumPy"),
    Target("`gmwm fleet`, units of 6 × 6·10⁵ samples, two processors", "units/s", 0.18, 1,
           lambda r: r.child(FLEET)["units"] / r.child(FLEET)["seconds"],
           "the processor time of one unit, mostly its calibration; the processes share their imports"),
    Target("slowest real recording of 6 × 10⁶ samples, shell to all files, wall time", "s", 54.8, 4,
           lambda r: _slowest(r, "adis", "seconds"), PARTS),
    Target("slowest of 30 simulated units with resonances and lines, the same", "s", None, 4,
           lambda r: _slowest(r, "simulated unit", "seconds"), PARTS),
    Target("slowest of 200 curves without samples, one axis, wall time", "s", 130, 1,
           lambda r: _slowest(r, "curve of", "inside"), "Python and NumPy around the fit of each hypothesis"),
    Target("log of 40 min at 1 kHz with 0.5 % lost samples, against the same without", "", None, 1.5,
           lambda r: _slowest(r, "samples lost", "seconds") / _slowest(r, "no sample lost", "seconds"),
           "the samples are read once more for the estimate at each gap"),
)  # fmt: skip


def rows(results: Results) -> list[list[str]]:
    """The table: work, before, asked, found, and the limit."""
    made = []
    for target in TARGETS:
        value = target.found(results)
        shown = ["–", "–"] if value is None else [_figure(value, target), "yes" if target.kept(value) else "no"]
        made.append([
            target.work, "–" if target.before is None else _figure(target.before, target),
            _figure(target.asked, target), *shown, target.limit,
        ])  # fmt: skip
    return made


HEAD = ("work", "before", "asked", "found", "reached", "what limits it")


def _figure(value: float, target: Target) -> str:
    return f"{number_text(value, 2)} {target.unit}".strip()
