"""Processes that begin with the package imported.

An import takes two seconds of processor time, more than most pages and commands take after it. So one process imports
once and forks for each page and each command, which is a process with its own modules, signals and output.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import traceback
from collections.abc import Sequence
from functools import wraps
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from gmwm.cli.main import NAMES

# Not Polars: it starts threads when it is imported, and threads do not survive a fork.
COMMANDS = tuple(f"gmwm.cli.{name}" for name in NAMES)
LATER = (
    "gmwm.applications.monitor", "gmwm.applications.several", "gmwm.showing.reports.write", "gmwm.theory.simulation",
    "jinja2", "rich.progress", "rich.table", *(["pydantic.types"] if find_spec("pydantic") else []),
)  # fmt: skip
"""Modules that commands import when they run."""
PRELOADED = ("gmwm.cli.main", *COMMANDS, *LATER, "matplotlib.pyplot", "scipy.signal", "scipy.stats", "tests.pictures")
ROOT = Path(__file__).parents[1]


class Done(NamedTuple):
    """What a process left: its exit code and what it printed."""

    returncode: int
    stdout: str
    stderr: str


class Forks:
    """A process that forks for each call of a function.

    Parameters
    ----------
    requests, answers : binary file
        The process reads calls from the first and writes exit codes to the second.
    process : subprocess.Popen, optional
        The process, if it was not forked from this one.
    """

    def __init__(self, requests: BinaryIO, answers: BinaryIO, process: subprocess.Popen[bytes] | None = None) -> None:
        self._requests, self._answers, self._process = requests, answers, process

    @classmethod
    def new(cls) -> Forks:
        """Start a process that imports the package."""
        settings = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"}
        command = [sys.executable, "-m", "tests.forked"]
        process = subprocess.Popen(command, cwd=ROOT, env=settings, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert process.stdin is not None
        assert process.stdout is not None
        return cls(process.stdin, process.stdout, process)  # type: ignore[arg-type]

    @classmethod
    def of_this_process(cls) -> Forks:
        """Fork this process as it is now."""
        (requests, to), (back, answers) = os.pipe(), os.pipe()
        if os.fork() == 0:
            os.close(to)
            os.close(back)
            serve(os.fdopen(requests, "rb"), os.fdopen(answers, "wb"))
            os._exit(0)
        os.close(requests)
        os.close(answers)
        return cls(os.fdopen(to, "wb"), os.fdopen(back, "rb"))

    def run(self, function: str, *arguments: str, folder: Path, **environment: str) -> Done:
        """Run a function, `"module:name"`, in a folder and with variables of the environment."""
        streams = [folder / f".{name}" for name in ("stdout", "stderr")]
        code = self.write_to([str(file) for file in streams], function, *arguments, folder=folder, **environment)
        texts = [file.read_text(encoding="utf-8") for file in streams]
        for file in streams:
            file.unlink()
        return Done(code, *texts)

    def write_to(self, streams: Sequence[str], function: str, *arguments: str, folder: Path, **environment: str) -> int:
        """Run a function that prints to these files, and return its exit code."""
        call = [function, arguments, str(folder), streams, environment]
        self._requests.write(json.dumps(call).encode() + b"\n")
        self._requests.flush()
        return int(self._answers.readline())

    def close(self) -> None:
        """End the process."""
        self._requests.close()
        self._answers.close()
        if self._process is not None:
            self._process.wait()


def gmwm(*arguments: str) -> None:
    """The command `gmwm` with these arguments, as its script runs it."""
    from gmwm.cli.main import run

    sys.argv = ["gmwm", *arguments]
    run()


def gmwm_in_a_code_page(*arguments: str) -> None:
    """The same as on Windows, whose pipes are in a code page of its own."""
    for stream in (sys.stdout, sys.stderr):
        stream.reconfigure(encoding="cp1252")  # type: ignore[union-attr]
    gmwm(*arguments)


def gmwm_struck(module: str, name: str, number: str, *arguments: str) -> None:
    """The script of the command, which gets a signal when it calls a function for the first time."""
    from gmwm.cli import start

    main, owner = os.getpid(), import_module(module)
    work = getattr(owner, name)

    @wraps(work)  # a helper gets it by the name of the function
    def strike(*given: Any, **options: Any) -> Any:
        os.kill(main, int(number))  # of this process, also if a helper does the work
        return work(*given, **options)

    setattr(owner, name, strike)
    # A shell ignores the first for commands in the background, nohup the second.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    sys.argv = ["gmwm", *arguments]
    start()


def serve(requests: BinaryIO, answers: BinaryIO) -> None:
    """Fork for each call until there are no more."""
    while line := requests.readline():
        pid = os.fork()
        if pid == 0:
            requests.close()
            answers.close()
            os._exit(_run(*json.loads(line)))
        answers.write(b"%d\n" % os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))
        answers.flush()


def _run(function: str, arguments: list[str], folder: str, streams: list[str], environment: dict[str, str]) -> int:
    """The exit code of a function."""
    for number, file in enumerate([os.devnull, *streams]):
        opened = os.open(file, os.O_RDWR | os.O_CREAT | os.O_APPEND)
        os.dup2(opened, number)
        os.close(opened)
    sys.stdin = os.fdopen(0, encoding="utf-8", closefd=False)
    sys.stdout, sys.stderr = (os.fdopen(number, "w", encoding="utf-8", closefd=False) for number in (1, 2))
    os.environ.update(environment)
    os.chdir(folder)
    module, _, name = function.partition(":")
    code: object = 0
    try:
        getattr(import_module(module), name)(*arguments)
    except SystemExit as end:
        code = end.code
    except BaseException:
        traceback.print_exc()
        code = 1
    if isinstance(code, str):
        print(code, file=sys.stderr)
    sys.stdout.flush()
    sys.stderr.flush()
    return code if isinstance(code, int) else int(code is not None)


if __name__ == "__main__":
    for module in PRELOADED:
        import_module(module)
    serve(sys.stdin.buffer, sys.stdout.buffer)
