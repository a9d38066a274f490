"""Wavelet variances of many simulated recordings of a model, computed on all processors."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice

import numpy as np

from gmwm.base.arrays import Matrix, as_whole_number
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance.api import variances_alone
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.validation import require_values

DRAWN_SAMPLES = 1 << 17
"""Samples of each process that are drawn at once (1 MiB, in the cache); paths depend on this number."""


def simulated_variances(
    model: Model, design: Design, draws: int, seed: int, *, threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Matrix:  # fmt: skip
    """Simulate independent sample paths of a model, and compute their wavelet variances (draws, J) in u². Each batch of
    paths has a random stream that depends on the seed and its number, so the result does not depend on `threads`, and a
    longer run begins with the rows of a shorter one. Each thread needs the memory of about three paths, or of three
    batches of 1 MiB. `progress` is called in the thread of the caller with the number of finished paths."""
    draws, seed = as_whole_number(draws, "draws", 1), as_whole_number(seed, "seed", 0)
    threads = as_whole_number(os.cpu_count() or 1 if threads is None else threads, "threads", 1)
    _require_simulable(model)
    together = max(1, DRAWN_SAMPLES // design.samples)
    rows = np.empty((draws, design.levels.size))

    def work(batch: int) -> int:
        part = rows[batch * together : (batch + 1) * together]
        # Most of the time is spent on normal variates. SFC64 is the fastest generator of NumPy, by a seventh.
        stream = np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(batch,)))
        _measure(model, design, together=together, rng=np.random.Generator(stream), rows=part)
        return len(part)

    # Keeps glibc from returning the memory of a batch, above twice the largest freed block, to the system: getting it
    # back page by page can take longer than the computation. The block here is never accessed and costs nothing.
    np.empty(min(8 * together * design.samples, 31 << 17))
    done = 0
    batches = iter(range(-(-draws // together)))
    pool = ThreadPoolExecutor(threads)
    try:
        # The queue is only as long as needed to keep every thread busy, because futures use memory.
        pending: set[Future[int]] = {pool.submit(work, batch) for batch in islice(batches, 2 * threads)}
        while pending:
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            done += sum(future.result() for future in finished)
            pending |= {pool.submit(work, batch) for batch in islice(batches, len(finished))}
            if progress is not None:
                progress(done)
    finally:
        # After Ctrl-C or an error, no new batch starts, and the running batches are completed.
        pool.shutdown(wait=True, cancel_futures=True)
    return rows


def _measure(model: Model, design: Design, together: int, rng: np.random.Generator, rows: Matrix) -> None:
    """Fill `rows` with variances of the first paths of a batch, drawn completely: paths depend on its size."""
    deepest = int(design.levels[-1])
    rows_of_levels = np.searchsorted(design.filter.numbers(deepest), design.levels)
    segments = [model.simulate(length, design.rate, rng, together) for length in design.lengths]
    for row, *path in zip(rows, *segments, strict=False):
        row[:] = variances_alone(
            path, design.filter, transform=design.transform, levels=deepest, efficiency=design.efficiency
        )[rows_of_levels]


def _require_simulable(model: Model) -> None:
    require_values(model, "a simulation", "Write the values into the model, or fit the model to data.")
    for process in model.processes:
        if not process.has("simulate"):
            raise process.missing("simulate")
