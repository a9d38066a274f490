"""Helper processes: the same results as without them, errors and warnings of a call, and helpers that end."""

import errno
import filecmp
import os
import signal
import subprocess
import sys
import threading

import pytest

from gmwm import simulate
from gmwm.base.helpers import Helpers, helpers, new_helper
from gmwm.recording.writers import write

FORKS = pytest.mark.skipif(sys.platform != "linux", reason="helpers are forked on Linux only")
CALLS = """
import os, signal, warnings
from math import sqrt
from gmwm.base.helpers import Helpers
def own(): return os.getpid()
until, begun = os.pipe()
def slow(): os.read(until, 1); return os.getpid()
def warn(): warnings.warn("from a helper"); return 1
def end(first): return 7 if os.getpid() == first else os.kill(os.getpid(), signal.SIGKILL)
def secret(): return lambda: 3
beside = Helpers(1)
assert beside.run(own) != os.getpid()
waiting = beside.begin(slow)
here = beside.run(own)
os.write(begun, b"x")
assert here == os.getpid() != waiting() == beside.run(own)
try:
    beside.run(sqrt, -1.0)
except ValueError as error:
    print(error)
with warnings.catch_warnings(record=True) as found:
    warnings.simplefilter("always")
    assert beside.run(warn) == 1
print(found[0].message)
assert beside.run(end, os.getpid()) == 7
assert beside.run(own) == beside.begin(own)() == os.getpid()
assert Helpers(1).run(secret)() == 3  # a result that cannot be sent
"""


def test_without_helpers_calls_are_made_here():
    made = []
    result = Helpers().begin(made.append, 1)
    assert not made
    result(), result()
    assert made == [1]
    assert Helpers().run(os.getpid) == os.getpid()


@FORKS
def test_where_no_process_can_be_forked_calls_are_made_here(monkeypatch):
    def refused():
        raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))

    monkeypatch.setattr(os, "fork", refused)
    assert Helpers(1).run(os.getpid) == os.getpid()


def test_a_process_with_threads_is_not_forked():
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    assert helpers().run(os.getpid) == os.getpid()
    ended.set()
    thread.join()


@FORKS
def test_a_helper_returns_results_errors_and_warnings_and_may_end():
    done = subprocess.run([sys.executable, "-c", CALLS], capture_output=True, text=True, timeout=300, check=False)
    assert (done.returncode, done.stdout.splitlines(), done.stderr) == (0, ["math domain error", "from a helper"], "")


@FORKS
@pytest.mark.slow
def test_the_files_are_the_same_on_any_number_of_processors(tmp_path):
    if len(os.sched_getaffinity(0)) < 2:
        pytest.skip("one processor")
    truth = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "gyro_y": "GM(beta=0.5, sigma2=3e-8) + WN(sigma2=4e-7)"}
    write(simulate(truth, rate=100.0, samples=30_000, rng=1), tmp_path / "unit.csv")
    program = "import os; os.sched_setaffinity(0, {}); from gmwm.cli import start; start()"
    for name, processors in (("one", {0}), ("all", os.sched_getaffinity(0))):
        words = ["calibrate", "unit.csv", "--within", "2*GM + WN + RW", "--output", name]
        code = program.format(f"sorted(os.sched_getaffinity(0))[:{len(processors)}]")
        done = subprocess.run(
            [sys.executable, "-c", code, *words], cwd=tmp_path, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
    files = sorted(path.name for path in (tmp_path / "one").iterdir())
    assert {"calibration.json", "calibration.png", "by_sensor.png", "report.html"} <= set(files)
    assert filecmp.cmpfiles(tmp_path / "one", tmp_path / "all", files, shallow=False) == (files, [], [])


def handled_by_a_library():
    """Set a handler for Ctrl-C as Polars does while it reads, and send Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.kill(os.getpid(), signal.SIGINT)
    return "done"


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="the system has no masks of signals")
def test_ctrl_c_does_not_interrupt_a_helper_with_the_handler_of_a_library():
    helper = new_helper("tests.test_helpers")
    try:
        helper.begin(handled_by_a_library)
        assert helper.connection.poll(60)
        assert helper.connection.recv()[:2] == (True, "done")
    finally:
        helper.end()
