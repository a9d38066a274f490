"""Parallel work in threads: interrupts and errors."""

import os
import signal
import subprocess
import sys
import time

import pytest

from gmwm.base.errors import DataError, OptionError
from gmwm.base.threads import in_threads
from tests.helpers import raises

# With siginterrupt off, as libraries with a handler of their own set it, the signal does not end a wait for a lock.
WORK = """
import os, signal, time
from gmwm.base.threads import in_threads
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.siginterrupt(signal.SIGINT, False)
def work(name, seconds):
    print(name, flush=True)
    time.sleep(seconds)
try:
    in_threads(work, {"long": 600.0})
except KeyboardInterrupt:
    print("broken off", flush=True)
    os._exit(0)
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="needs POSIX signals")
def test_an_interrupt_does_not_wait_for_the_work():
    process = subprocess.Popen([sys.executable, "-c", WORK], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "long\n"
        time.sleep(0.5)
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=300)
    finally:
        process.kill()
    assert (process.returncode, out) == (0, "broken off\n")


def test_the_error_of_the_first_item_is_raised_with_its_name():
    def work(name, seconds):
        time.sleep(seconds)
        raise DataError(f"fails after {seconds} s", got=seconds)

    with raises(DataError, 0.2, got=0.2, subject="slow"):
        in_threads(work, {"slow": 0.2, "fast": 0.0}, threads=2)


def test_an_error_of_an_option_has_no_name():
    def work(name, value):
        raise OptionError(argument="rate", expected="positive", got=value)

    with raises(OptionError, argument="rate", got=-1, subject=""):
        in_threads(work, {"gyro_x": -1})
