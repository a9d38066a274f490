"""What is printed does not depend on the number of threads, on the kernels of the BLAS, or on the order of files."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

import gmwm

RATE, SAMPLES = 100.0, 20_000
TRUTH = {"gyro_x": "WN(sigma2=1e-6) + RW(gamma2=1e-11)", "accel_z": "WN(sigma2=1e-4) + GM(beta=0.5, sigma2=1e-6)"}


def recording(seed):
    return gmwm.simulate(TRUTH, rate=RATE, samples=SAMPLES, rng=seed)


@pytest.mark.slow
def test_kernels_of_the_blas_print_the_same(tmp_path):
    # OpenBLAS reads the variable when it is loaded; another BLAS ignores it.
    path = tmp_path / "a.csv"
    recording(1).write(path)
    command = [sys.executable, "-m", "gmwm", "calibrate", str(path)]
    texts = {
        subprocess.run(
            command, env={**os.environ, "OPENBLAS_CORETYPE": kernel, "OMP_NUM_THREADS": threads},
            capture_output=True, text=True, check=True,
        ).stdout
        for kernel, threads in (("Haswell", "1"), ("Prescott", "2"))
    }  # fmt: skip
    assert len(texts) == 1
    assert "WN" in texts.pop()


@pytest.mark.slow
def test_any_number_of_threads_gives_the_same_document():
    imu = recording(2)
    first, *others = (gmwm.calibrate(imu, within="GM + WN + RW", threads=threads).to_dict() for threads in (1, 2, 5))
    assert all(other == first for other in others)


@pytest.mark.slow
def test_any_order_of_recordings_prints_the_same_numbers():
    names = {"monday": recording(3), "tuesday": recording(4), "friday": recording(5)}
    texts = []
    for order in (list(names), list(reversed(names))):
        found = gmwm.calibrate({name: names[name] for name in order}, within="WN + RW")
        texts.append(
            {
                axis: {symbol: f"{entry.value:.6g} {entry.high:.6g}" for symbol, entry in sheet.items() if entry.high}
                for axis, sheet in found.datasheets.items()
            }
        )
    assert texts[0] == texts[1]
    assert all(len(numbers) > 1 for numbers in texts[0].values())
