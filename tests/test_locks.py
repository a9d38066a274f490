"""Accumulators and monitors that several threads use at once lose no sample."""

import pickle
import sys
import threading

import numpy as np
import pytest

from gmwm.base.threads import OneAtATime, one_at_a_time
from gmwm.measuring.spectrum.api import SpectrumAccumulator
from gmwm.measuring.variance.accumulate import WaveletAccumulator


@pytest.fixture
def often():
    """Switch between threads a thousand times as often."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(5e-6)
    yield
    sys.setswitchinterval(before)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [WaveletAccumulator, SpectrumAccumulator])
def test_no_sample_is_lost(often, kind):
    live, x = kind(rate=100.0), np.random.default_rng(1).normal(size=500)

    def run():
        for _ in range(100):
            live.update(x)
            len(live)

    threads = [threading.Thread(target=run) for _ in range(8)]
    for thread in threads:
        thread.start()
    for _ in range(3):
        len(live.lengths)
    for thread in threads:
        thread.join()
    assert len(live) == 8 * 100 * x.size
    assert live.result().samples == len(live)
    if kind is WaveletAccumulator:
        assert live.result().counts[0] == len(live) - 1


def test_a_call_of_another_thread_waits():
    class Slow(OneAtATime):
        def __init__(self):
            self.inside, self.most = 0, 0
            self.go = threading.Event()

        @one_at_a_time
        def work(self):
            self.inside += 1
            self.most = max(self.most, self.inside)
            self.go.wait(0.02)
            self.inside -= 1

    one = Slow()
    threads = [threading.Thread(target=one.work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert one.most == 1


@pytest.mark.parametrize("kind", [WaveletAccumulator, SpectrumAccumulator])
def test_the_lock_is_not_pickled(kind):
    live = kind(rate=100.0)
    live.update(np.random.default_rng(1).normal(size=1000))
    again = pickle.loads(pickle.dumps(live))
    again.update([1.0, 2.0])
    assert (len(live), len(again)) == (1000, 1002)
