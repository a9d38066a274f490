"""Connect to a Dask scheduler, or start worker processes on this machine."""

from __future__ import annotations

import logging
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Any

from gmwm.base.arrays import as_whole_number
from gmwm.base.errors import GmwmError, GmwmWarning, OptionError
from gmwm.base.extras import library
from gmwm.base.remarks import Remark
from gmwm.base.reporting import warn
from gmwm.base.threads import processors

if TYPE_CHECKING:
    from distributed import Client

SCHEDULER_WAIT_S = 10  # time (s) within which a scheduler must answer: a choice, longer than the delay of any network
_DEAF = "import signal\nsignal.signal(signal.SIGINT, signal.SIG_IGN)\n"
"""Code that a worker runs first, so that Ctrl-C, which reaches all processes, leaves it to the parent."""


@contextmanager
def connect(scheduler: str | Client | None = None, workers: int | None = None) -> Iterator[Client]:
    """Connect to a Dask scheduler by address or client, or to `workers` processes (one per processor by default).

    Own processes end with the block. They import the script that runs: its work belongs under `__name__ ==
    "__main__"`."""
    distributed = library("distributed")
    if workers is not None:
        as_whole_number(workers, "workers", 1, expected="a whole number of processes, 1 or more")
    if scheduler is not None and workers is not None:
        raise OptionError(
            "a scheduler has its own workers, so their number cannot be given",
            argument="workers",
            advice="Pass either {--scheduler} or {--workers}.",
        )
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
    """Suppress asyncio's messages about tasks that Ctrl-C interrupts while workers start."""
    logger = logging.getLogger("asyncio")
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _processes(distributed: Any, workers: int, folder: str) -> Any:
    """Start a scheduler here, and workers with one thread each, which limits Polars to one thread too."""
    try:
        return distributed.LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",  # any port, because another cluster may use the default one
            silence_logs=logging.CRITICAL,
            local_directory=folder,
            env={"POLARS_MAX_THREADS": "1"},
            preload=[_DEAF],
        )
    except RuntimeError as error:
        raise GmwmError(
            f"worker processes did not start ({error})",
            advice='They import the script that runs: put its work under `if __name__ == "__main__":`.',
        ) from error


def _client(distributed: Any, address: object) -> Any:
    """Connect to the scheduler at an address."""
    if not isinstance(address, str) or not address.partition("://")[2]:
        raise OptionError(argument="scheduler", expected="an address such as tcp://10.0.0.5:8786", got=address)
    try:
        client = _registered(distributed, address)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"the scheduler at {address} does not answer ({error})",
            argument="scheduler",
            advice="Start one with `dask scheduler`, workers with `dask worker ADDRESS`, or leave {--scheduler} out.",
        ) from error
    if not client.scheduler_info(n_workers=-1)["workers"]:
        warn(GmwmWarning(Remark.of("no-workers", address=address)), stacklevel=4)
    return client


def _registered(distributed: Any, address: str) -> Any:
    """Register a client; repeat while the answer comes with a message to all clients, which Dask asserts against."""
    deadline = time.monotonic() + SCHEDULER_WAIT_S
    while True:
        try:
            return distributed.Client(address, timeout=SCHEDULER_WAIT_S, set_as_default=False)
        except AssertionError as error:
            if time.monotonic() > deadline:
                raise TimeoutError("it answers to other clients only") from error
