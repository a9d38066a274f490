"""The picture of the front page: a gyroscope with everything in it, its model, and what each process has of it."""

from __future__ import annotations

from pathlib import Path

import gmwm

TRUTH = "GM(beta=0.02, sigma2=6e-9) + WN(sigma2=4e-7) + QN(q2=2.5e-7) + RW(gamma2=8e-14)"
RATE, SAMPLES, SEED = 100.0, 2_880_000, 3


def write(folder: Path) -> list[Path]:
    """Eight hours of it."""
    made = gmwm.simulate_signal(TRUTH, rate=RATE, samples=SAMPLES, rng=SEED, unit="rad/s")
    fit = gmwm.fit("GM + WN + QN + RW", made.signal)
    path = folder / "front.svg"
    fit.plot(path=path)
    return [path]
