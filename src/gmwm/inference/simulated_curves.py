"""The wavelet variances that other recordings of a model would have had: many paths at once, on all processors."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from itertools import islice
from typing import Any

import numpy as np

from gmwm._arrays import Matrix
from gmwm.covariance.design import Design
from gmwm.errors import ModelError, OptionError
from gmwm.processes.model import Model
from gmwm.variance.api import variances_alone

BATCH = 1 << 17
"""Samples of each process that are drawn at once (1 MiB): the cache holds them, Python's part in them is small.

A number of its own for every machine would draw other paths on each.
"""


def simulated_variances(
    model: Model,
    design: Design,
    draws: int,
    seed: int,
    *,
    threads: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Matrix:
    """Wavelet variances ν̂*² of independent sample paths of a model, each measured as `design` says.

    Paths are drawn in batches, batch b from a stream of its own, child b of the seed: the numbers depend on neither
    `threads` nor `draws`, and the first rows of a longer run are those of a shorter one. Stationary processes start
    stationary, and quantization noise is uniform. Segments between gaps are independent paths, measured together.

    Parameters
    ----------
    model : Model
        With all its values.
    design : Design
        Levels, samples, rate, filter, transform and estimator.
    draws : int
        Number of paths B.
    seed : int
        Not negative; the same seed gives the same paths.
    threads : int, optional
        How many work at once, one on each processor by default. Each holds about three paths, or three batches
        of 1 MiB where paths are shorter.
    progress : callable, optional
        Called in the caller's thread, with the number of paths done so far.

    Returns
    -------
    (B, J) array, in u² for a signal in u

    Raises
    ------
    OptionError
        If `draws`, `seed` or `threads` is not such a number.
    ModelError
        If a parameter has no value, or a process cannot be simulated.

    Examples
    --------
    >>> from gmwm.processes import WN
    >>> design = Design(np.arange(1, 4), samples=1000, rate=100.0)
    >>> simulated_variances(Model((WN(sigma2=2.0),)), design, draws=1000, seed=1).mean(axis=0).round(2)
    array([1.  , 0.5 , 0.25])
    """
    draws, seed = _whole(draws, "draws", 1), _whole(seed, "seed", 0)
    threads = _whole(os.cpu_count() or 1 if threads is None else threads, "threads", 1)
    _require_simulable(model)
    together = max(1, BATCH // design.samples)
    rows = np.empty((draws, design.levels.size))

    def work(batch: int) -> int:
        part = rows[batch * together : (batch + 1) * together]
        _measure(model, design, together=together, rng=_stream(seed, batch), rows=part)
        return len(part)

    _keep_memory(together * design.samples)
    done = 0
    batches = iter(range(-(-draws // together)))
    pool = ThreadPoolExecutor(threads)
    try:
        # No more in the queue than keeps every thread busy: a million futures would be memory, too.
        pending: set[Future[int]] = {pool.submit(work, batch) for batch in islice(batches, 2 * threads)}
        while pending:
            finished, pending = wait(pending, return_when=FIRST_COMPLETED)
            done += sum(future.result() for future in finished)
            pending |= {pool.submit(work, batch) for batch in islice(batches, len(finished))}
            if progress is not None:
                progress(done)
    finally:
        # After Ctrl-C or an error nothing new is begun, and what is under way, a batch a thread, is waited for.
        pool.shutdown(wait=True, cancel_futures=True)
    return rows


def _measure(model: Model, design: Design, together: int, rng: np.random.Generator, rows: Matrix) -> None:
    """Fill `rows` from the first paths of a batch; the batch is always drawn whole, as the paths depend on its size."""
    deepest, wanted = int(design.levels[-1]), design.levels - 1
    segments = [model.simulate(length, design.rate, rng, together) for length in design.lengths]
    for row, *path in zip(rows, *segments, strict=False):
        row[:] = variances_alone(
            path, design.filter, transform=design.transform, levels=deepest, efficiency=design.efficiency
        )[wanted]


def _stream(seed: int, batch: int) -> np.random.Generator:
    # Normals take most of the time, and this generator is the fastest that NumPy has, by a seventh.
    return np.random.Generator(np.random.SFC64(np.random.SeedSequence(seed, spawn_key=(batch,))))


def _keep_memory(batch: int) -> None:
    """Let the allocator keep what a batch frees for the next one.

    glibc gives free memory back to the system beyond twice the largest block that it has seen freed, up to 32 MiB; to
    get it again page by page could take longer than the arithmetic. This block is never touched, it costs nothing.
    """
    np.empty(min(8 * batch, 31 << 17))


def _require_simulable(model: Model) -> None:
    missing = [name for name, value in model.parameters.items() if value is None]
    if missing:
        raise ModelError(
            f"paths of {model} need a value for {', '.join(missing)}: "
            f"give them, as model.with_values({{{missing[0]!r}: …}}), or fit the model to data"
        )
    for process in model.processes:
        if not process.has("simulate"):
            raise process.missing("simulate")


def _whole(value: Any, name: str, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise OptionError(f"{name} must be an integer of at least {least}, got {value!r}")
    return int(value)
