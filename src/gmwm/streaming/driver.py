"""The wavelet variance of a recording in one pass: the axes in threads, while the next piece is read."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait

from gmwm._arrays import Vector
from gmwm._threads import BREATH, in_threads, processors
from gmwm.readers.chunks import Piece, Stream
from gmwm.signals import axis_quantity
from gmwm.units import SI_UNIT
from gmwm.variance.accumulate import EXACT, WaveletAccumulator
from gmwm.variance.result import WaveletVariance


def stream_variance(
    stream: Stream,
    *,
    levels: int | None = None,
    exact: int = EXACT,
    confidence: float = 0.95,
    threads: int | None = None,
    done: Callable[[int], None] | None = None,
) -> dict[str, WaveletVariance]:
    """The wavelet variance of each axis of a recording of any length, in one pass.

    Levels up to `exact` are those of `wavelet_variance`; each further one takes the coefficients at every τ/64-th
    sample, see `WaveletAccumulator`. Segments between gaps are measured together, no coefficient lies across a gap.

    Parameters
    ----------
    stream : Stream
        Of `gmwm.stream`.
    levels : int, optional
        Number of levels J; all that have a coefficient by default.
    exact : int
        Levels of which every coefficient is taken, 6 to 24.
    confidence : float
        Level of the limits, between 0 and 1.
    threads : int, optional
        Axes that are worked on at once; as many as there are processors by default.
    done : callable, optional
        Called with the number of samples so far after every piece, in the calling thread.

    Returns
    -------
    dict of axis name to WaveletVariance

    Raises
    ------
    ReadError, DataError
        At what `read` refuses, when it is reached.

    Examples
    --------
    >>> import tempfile, pathlib, gmwm
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "static.parquet")
    >>> gmwm.write(gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=5_000, seed=1), path)
    >>> gmwm.stream(path).wavelet_variance()
    {'gyro_x': WaveletVariance(gyro_x, haar, 12 levels, 5000 samples at 100 Hz)}
    >>> folder.cleanup()
    """
    measured = accumulators(stream.axes, stream.rate, levels=levels, exact=exact)
    pool = ThreadPoolExecutor(max(1, min(len(measured), threads or processors())))
    running: list[Future[None]] = []
    samples = segment = 0
    try:
        for piece in stream:
            # While it was read the one before was worked on.
            _await(running)
            if done is not None and samples:
                done(samples)
            after_gap = piece.segment != segment
            running = [pool.submit(_take, one, piece[axis], after_gap) for axis, one in measured.items()]
            samples, segment = piece.first + len(piece), piece.segment
        _await(running)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
    if done is not None:
        done(samples)
    return in_threads(lambda _, one: one.result(confidence), measured, threads=threads)


def accumulators(
    axes: Sequence[str], rate: float, *, levels: int | None = None, exact: int = EXACT
) -> dict[str, WaveletAccumulator]:
    """An accumulator for each axis, in its SI unit."""
    return {
        axis: WaveletAccumulator(rate, levels=levels, exact=exact, unit=SI_UNIT[axis_quantity(axis)], axis=axis)
        for axis in axes
    }


def feed(pieces: Iterable[Piece], measured: Mapping[str, WaveletAccumulator]) -> None:
    """Give pieces as they come to the accumulators of some axes, one after the other."""
    segment = 0
    for piece in pieces:
        for axis, one in measured.items():
            _take(one, piece[axis], piece.segment != segment)
        segment = piece.segment


def _take(one: WaveletAccumulator, values: Vector, after_gap: bool) -> None:
    if after_gap:
        one.gap()
    one.update(values)


def _await(running: Sequence[Future[None]]) -> None:
    """Wait until all are done, looking up for Ctrl-C; an error of theirs is raised here."""
    pending: set[Future[None]] = set(running)
    while pending:
        _, pending = wait(pending, timeout=BREATH)
    for future in running:
        future.result()
