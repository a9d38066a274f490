"""Where work goes that is spread over processes or machines: a Dask scheduler that runs, or one of our own."""

from __future__ import annotations

import logging
import tempfile
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from gmwm._threads import processors
from gmwm.errors import GmwmError, GmwmWarning, MissingDependencyError, OptionError

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 10
"""Seconds in which a scheduler must answer."""
_DEAF = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""What a worker process begins with: a terminal sends Ctrl-C to all, and the process that began it ends it."""


@contextmanager
def connected(scheduler: str | Client | None = None, workers: int | None = None) -> Iterator[Client]:
    """A client of Dask: of a scheduler that runs already, or of worker processes of this machine.

    What was begun here ends with the block; a client that is passed is left as it is.

    Parameters
    ----------
    scheduler : str, distributed.Client or None
        Address of a scheduler, as tcp://10.0.0.5:8786; or a client of one; None to begin worker processes here. These
        import the script that runs: it must hold its work under `if __name__ == "__main__":`.
    workers : int, optional
        How many worker processes, of one thread each; as many as there are processors by default.

    Raises
    ------
    MissingDependencyError
        If distributed is not installed.
    OptionError
        If no scheduler answers, or workers are asked for that are not ours to begin.
    GmwmError
        If worker processes do not begin.

    Warns
    -----
    GmwmWarning
        If a scheduler has no workers yet.

    Examples
    --------
    >>> with connected("127.0.0.1") as client:
    ...     client.submit(sum, [1, 2]).result()
    Traceback (most recent call last):
    gmwm.errors.OptionError: scheduler must be an address as tcp://10.0.0.5:8786, got '127.0.0.1'
    """
    distributed = library()
    if workers is not None and (isinstance(workers, bool) or not isinstance(workers, int) or workers < 1):
        raise OptionError(f"workers must be a whole number of processes, 1 or more; got {workers!r}")
    if scheduler is not None and workers is not None:
        raise OptionError("workers= is how many processes to begin here, scheduler= has its own: pass one of them")
    if isinstance(scheduler, distributed.Client):
        yield scheduler
        return
    with ExitStack() as stack:
        if scheduler is None:
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="gmwm-", ignore_cleanup_errors=True))
            stack.enter_context(_quiet())
            cluster = stack.enter_context(_processes(distributed, workers or processors(), folder))
            yield stack.enter_context(distributed.Client(cluster, set_as_default=False))
        else:
            yield stack.enter_context(_client(distributed, scheduler))


@contextmanager
def _quiet() -> Iterator[None]:
    """Without a word of asyncio on what Ctrl-C leaves unfinished where workers are just begun."""
    logger = logging.getLogger("asyncio")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def library() -> Any:
    """The package distributed, or an error that says how to install it."""
    try:
        import distributed
    except ImportError as error:
        raise MissingDependencyError(
            "work is spread over processes and machines by Dask, which is not installed: pip install 'gmwm[dask]'"
        ) from error
    return distributed


def _processes(distributed: Any, workers: int, folder: str) -> Any:
    """A scheduler in this process, with workers of one thread: Polars begins none beside it."""
    try:
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # any port: the usual one may be that of another cluster
            silence_logs=logging.CRITICAL,
            local_directory=folder,
            env={"POLARS_MAX_THREADS": "1"},
            preload=[_DEAF],
        )
    except RuntimeError as error:
        raise GmwmError(
            f"worker processes did not begin ({error}): they import the script that runs, so that it must hold its "
            'work under if __name__ == "__main__":'
        ) from error


def _client(distributed: Any, address: object) -> Any:
    """The client of the scheduler at an address."""
    if not isinstance(address, str) or not address.partition("://")[2]:
        raise OptionError(f"scheduler must be an address as tcp://10.0.0.5:8786, got {address!r}")
    try:
        client = distributed.Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"scheduler={address!r} does not answer ({error}): begin one with `dask scheduler` and workers with "
            "`dask worker ADDRESS`, or leave scheduler= out to work on this machine"
        ) from error
    if not client.scheduler_info(n_workers=-1)["workers"]:
        warnings.warn(
            f"the scheduler at {address} has no workers yet; the work waits for the first: begin them with "
            f"`dask worker {address}`",
            GmwmWarning,
            stacklevel=4,
        )
    return client
