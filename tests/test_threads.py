"""Work on several things at once can be broken off."""

import os
import signal
import subprocess
import sys
import time

import pytest

# As a library does that has its own handler: what waits for a lock is not woken by the signal.
WORK = """
import os, signal, time
from gmwm._threads import in_threads
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.siginterrupt(signal.SIGINT, False)
def work(name, seconds):
    print(name, flush=True)
    time.sleep(seconds)
try:
    in_threads(work, {"long": 60.0})
except KeyboardInterrupt:
    print("broken off", flush=True)
    os._exit(0)
"""


@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_an_interrupt_does_not_wait_for_the_work():
    process = subprocess.Popen([sys.executable, "-c", WORK], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "long\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=30)
    finally:
        process.kill()
    assert (process.returncode, out) == (0, "broken off\n")
