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

state, x = Path(sys.argv[1]), np.load(sys.argv[2])
live = gmwm.WaveletAccumulator(rate=100.0, exact=10, robust=True)
if state.exists():
    live = pickle.loads(state.read_bytes())
print(len(live), flush=True)
while len(live) < x.size:
    k = len(live)
    if k == 100_000:
        live.gap()
    live.update(x[k : min(k + 10_000, 100_000 if k < 100_000 else x.size)])
    new = state.with_suffix(".new")
    new.write_bytes(pickle.dumps(live))
    os.replace(new, state)
print("done", flush=True)
"""


@pytest.mark.slow
def test_killed_and_restored(tmp_path):
    x = np.random.default_rng(1).normal(size=SAMPLES).cumsum() * 1e-3 + np.random.default_rng(2).normal(size=SAMPLES)
    np.save(tmp_path / "x.npy", x)
    command = [sys.executable, "-c", MEASURE, str(tmp_path / "state"), str(tmp_path / "x.npy")]
    begun, kills = [], 0
    while True:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert process.stdout is not None
        begun.append(int(process.stdout.readline()))
        if kills < 3:
            time.sleep(0.15)
            process.send_signal(signal.SIGKILL)
        rest = process.stdout.read()
        process.wait()
        process.stdout.close()
        if rest.strip() == "done":
            break
        kills += 1
        assert kills <= 3
    assert kills >= 1
    assert begun[0] == 0 < begun[-1] < SAMPLES

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
