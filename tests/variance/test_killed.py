"""A process that measures and keeps its state is killed, again and again: whoever goes on ends at the same curve."""

from __future__ import annotations

import pickle
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import gmwm

SAMPLES = 300_000

MEASURE = """
import os, pickle, sys
from pathlib import Path
import numpy as np
import gmwm

state, x, until = Path(sys.argv[1]), np.load(sys.argv[2]), int(sys.argv[3])
live = gmwm.WaveletAccumulator(rate=100.0, exact=10, robust=True)
if state.exists():
    live = pickle.loads(state.read_bytes())
print(len(live), flush=True)
reached = False
while len(live) < x.size:
    k = len(live)
    if k < until:
        if k == 100_000:
            live.gap()
        live.update(x[k : min(k + 10_000, 100_000 if k < 100_000 else x.size)])
    new = state.with_suffix(".new")
    new.write_bytes(pickle.dumps(live))
    os.replace(new, state)
    if not reached and len(live) >= until:
        reached = True
        print("there", flush=True)  # from here the state is saved again and again, until the kill
print("done", flush=True)
"""


@pytest.mark.slow
def test_killed_and_restored(tmp_path):
    x = np.random.default_rng(1).normal(size=SAMPLES).cumsum() * 1e-3 + np.random.default_rng(2).normal(size=SAMPLES)
    np.save(tmp_path / "x.npy", x)
    command = [sys.executable, "-c", MEASURE, str(tmp_path / "state"), str(tmp_path / "x.npy")]
    for begin, until in ((0, 90_000), (90_000, 160_000), (160_000, 250_000)):
        with subprocess.Popen([*command, str(until)], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            assert [process.stdout.readline() for _ in range(2)] == [f"{begin}\n", "there\n"]
            time.sleep(0.02)
            process.send_signal(signal.SIGKILL)
    last = subprocess.run([*command, str(SAMPLES)], stdout=subprocess.PIPE, text=True, check=True)
    assert last.stdout.split() == ["250000", "there", "done"]

    found = pickle.loads((tmp_path / "state").read_bytes())
    whole = gmwm.WaveletAccumulator(rate=100.0, exact=10, robust=True)
    whole.update(x[:100_000])
    whole.gap()
    whole.update(x[100_000:])
    for robust in (False, True):
        one, other = found.result(robust=robust), whole.result(robust=robust)
        assert one.segments == other.segments == (100_000, 200_000)
        np.testing.assert_array_equal(one.counts, other.counts)
        np.testing.assert_allclose(one.variance, other.variance, rtol=1e-12 if not robust else 1e-6)
