"""How far each kernel is from what memory can deliver, and what holds it back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from benchmarks.results import Results


@dataclass(frozen=True)
class Kernel:
    """Bytes a sample that cannot but pass between memory and processor, how long a sample takes, and why."""

    name: str
    samples: int
    moved: int
    took: Callable[[Results], float]
    reason: str


def _timed(name: str, against: str = "np.cumsum") -> Callable[[Results], float]:
    return lambda results: results.took(name, against)


def _curve(name: str, samples: int) -> Callable[[Results], float]:
    return lambda results: results.per_sample(name, samples) * samples


KERNELS = (
    Kernel("`np.cumsum`", 10**6, 16, _curve("np.cumsum", 10**6), "each addition waits for the one before"),
    Kernel("`np.cumsum`", 10**7, 16, _curve("np.cumsum", 10**7), "the same"),
    Kernel("running sum", 10**6, 24, _timed("running sum of 10^6"), "a few samples are summed among themselves first"),
    Kernel("running sum", 10**7, 24, _timed("running sum of 10^7"), "memory, two passes (mean, sum)"),
    Kernel("all levels, 19", 10**6, 8, _timed("levels of 10^6"), "reads from the near caches and arithmetic, 19 times"),
    Kernel("all levels, 23", 10**7, 8, _timed("levels of 10^7"), "the same; lags beyond the caches, read again"),
    Kernel("wavelet variance", 10**6, 16, _timed("gmwm.wavelet_variance of 10^6"), "the levels; samples read twice"),
    Kernel("wavelet variance", 10**7, 16, _timed("gmwm.wavelet_variance of 10^7"), "the same"),
    Kernel("in chunks of 10⁶", 10**7, 8, _timed("10^7 samples in chunks of 1000000", "in memory"),
           "the levels; the running sum never leaves the cache"),
    Kernel("robust", 10**6, 8, _timed("robust, efficiency 0.6: white noise", "np.cumsum of 10^6"),
           "arithmetic: a scale of each level, found in several looks at its coefficients"),
    Kernel("log-likelihood, GM + WN", 10**7, 8, _timed("log-likelihood of GM+WN, 10^7 samples"),
           "two multiply-and-adds a sample that wait for those before"),
)  # fmt: skip

WORDS = """The share is the minimum time for the memory traffic divided by the measured time. The minimum
time assumes the speed of a plain copy of as many samples (a copy reads 8 bytes per sample and writes 8).

{table}

- **The running sum** is the only step of the wavelet variance that the memory bandwidth limits. For 10⁷ samples it
  takes {sum:.1f} times as long as a copy of as many bytes. {fresh:.0f} % of its time is spent on new memory pages,
  which the system sets to zero at every call. `np.cumsum` is slower, because each addition waits for the previous one.
- **The levels** read one running sum and write nothing. gmwm processes the sum in tiles of 4096 samples (32 KiB), and
  five levels at once, so that these levels share their reads. In the table, *all levels* is one kernel on a stored
  running sum: {near:.2f} ns per sample and level at 10⁶ samples, and {far:.2f} at 10⁷ samples, where the lags of the
  coarsest levels exceed the caches.
- **No running sum of a long record is stored.** From 2¹⁸ samples on, `wavelet_variance` reads the samples twice and
  writes nothing to memory. The first time, levels up to 14 use a window of the running sum in the second-level cache
  (up to 17 for more than 10⁸ samples). The second time, the samples are a matrix whose rows have the length of the
  window. A few columns of all rows are summed and serve all other levels. The next samples are requested from memory
  during the arithmetic. The running sum is relative to a value near the mean, from 3 % of the samples.
- **In chunks** of 10⁶ samples, the levels above 14 use only every τ/64-th coefficient, and all levels together take
  {chunks:.1f} ns per sample; the memory traffic alone would take {memory:.1f}.
- **Possible improvement.** With all levels at the speed of memory, 10⁶ samples would take {ideal:.1f} ms instead of
  {real:.1f}. Each level takes three operations per vector of eight coefficients, and a processor with two vector units
  needs one and a half cycles for them. To be faster, the coarse levels would have to use only every τ/64-th
  coefficient, as in a stream. In memory, gmwm uses every coefficient, as the definition requires.
- **Robust curves, the likelihood and fits** are limited by arithmetic and by operations that depend on one another.
  They use a small share of the bandwidth. Threads over axes help; a faster memory would not."""


def bandwidth_words(results: Results) -> str:
    """Table and reasons."""
    rows = []
    for kernel in KERNELS:
        took = kernel.took(results) / kernel.samples
        share = kernel.moved / took / copy_speed(results, kernel.samples)
        rows.append(
            f"| {kernel.name} | 10{'⁶' if kernel.samples == 10**6 else '⁷'} | {1e9 * took:.2f} | {kernel.moved} "
            f"| {'< 1' if share < 0.01 else f'{100 * share:.0f}'} % | {kernel.reason} |"
        )
    head = (
        "| kernel | samples | ns per sample | bytes | share | what limits it |\n| :-- | --: | --: | --: | --: | :-- |"
    )
    running = results.took("running sum of 10^7", "np.cumsum") / 1e7
    fresh = results.timing("fresh pages for 10^7", "pages that are there")
    return WORDS.format(
        table="\n".join([head, *rows]),
        fresh=100 * (fresh["seconds"] - fresh["reference_seconds"]) / (1e7 * running),
        sum=running * copy_speed(results, 10**7) / 24,
        near=1e9 * results.took("levels of 10^6", "np.cumsum") / 1e6 / 19,
        far=1e9 * results.took("levels of 10^7", "np.cumsum") / 1e7 / 23,
        chunks=1e9 * results.took("10^7 samples in chunks of 1000000", "in memory") / 1e7,
        memory=1e9 * 8 / copy_speed(results, 10**7),
        ideal=1e3 * 16e6 / copy_speed(results, 10**6),
        real=1e3 * results.took("gmwm.wavelet_variance of 10^6", "np.cumsum"),
    )


def copy_speed(results: Results, samples: int) -> float:
    """Bytes per second of a copy of so many samples, read and written."""
    return 16 / results.per_sample("copy (np.copyto)", samples)
