"""A recording with knocks, fitted classically and robustly: `python examples/contaminated.py [PICTURE]`.

The example simulates 1000 s of a gyroscope with Gauss-Markov and white noise, and adds ten knocks of one second each.
The classical fit interprets the knocks as noise. The robust fit limits their influence.
"""

from __future__ import annotations

import sys

import numpy as np

import gmwm

RATE = 100.0
SECONDS = 1000
TRUTH = gmwm.Model.parse("GM(beta=0.5, sigma2=1e-6) + WN(sigma2=4e-6)")


def recording(seed: int = 7) -> gmwm.Signal:
    """Noise of the model with ten knocks of one second: oscillations with exponential decay."""
    rng = np.random.default_rng(seed)
    length = round(RATE)
    x = TRUTH.simulate(SECONDS * length, RATE, rng)
    for start in length * rng.choice(SECONDS, SECONDS // 100, replace=False):
        ring = 0.1 * np.exp(-np.arange(length) / (0.25 * length)) * rng.standard_normal(length)
        x[start : start + length] += ring - ring.mean()
    return gmwm.Signal(x, RATE, "rad/s", "gyro_x")


def main(path: str = "contaminated.png") -> dict[str, gmwm.Fit]:
    """Fit both curves, print the estimates and the true values, plot both; return the fits by name."""
    signal = recording()
    fits = {
        "classical": gmwm.fit(TRUTH.structure, signal),
        "robust": gmwm.fit(TRUTH.structure, signal, robust=True),
    }
    print(f"{'parameter':<10} {'truth':>10}" + "".join(f" {name:>10}" for name in fits))
    for name, value in TRUTH.parameters.items():
        print(f"{name:<10} {value:10.3g}" + "".join(f" {fit.parameters[name]:10.3g}" for fit in fits.values()))
    gmwm.compare(*fits.values(), labels=list(fits), title="Gyroscope with knocks in 1 % of the time", path=path)
    print(f"wrote {path}")
    return fits


if __name__ == "__main__":
    main(*sys.argv[1:2])
