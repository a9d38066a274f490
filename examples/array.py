"""A virtual gyroscope from four units with a common supply: predicted and achieved noise, at rest and in motion.

The noise of the units is simulated in plain NumPy. The virtual sensors are made from a recording at rest, and applied
to a second recording, in which the array turns. `python examples/array.py` prints the deviations, and draws them.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import gmwm

RATE = 100.0
WHITE = np.array([1.0, 1.0, 1.4, 2.0])
"""Angle random walk of the units, in 0.0001 rad/s/√Hz."""
SHARES = np.array([1.0, -0.8, 0.9, -0.6])
"""How the supply acts on them."""


def noise(samples: int, seed: int) -> np.ndarray:
    """Noise of the four units (4, samples), in rad/s: white noise, a common walk, and a walk of each unit."""
    rng = np.random.default_rng(seed)
    white = 1e-3 * WHITE[:, None] * rng.normal(size=(4, samples))
    supply = np.cumsum(1e-5 * rng.normal(size=samples))
    return white + np.outer(SHARES, supply) + np.cumsum(3e-6 * rng.normal(size=(4, samples)), axis=1)


def named(values: np.ndarray) -> dict[str, np.ndarray]:
    return {f"gyro_z[{k}]": row for k, row in enumerate(values)}


def deviation(values: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Haar wavelet deviation in plain NumPy."""
    path = np.concatenate([[0.0], np.cumsum(values - values.mean())])
    found = []
    for level in levels:
        half = 1 << (level - 1)
        found.append(np.sqrt(np.mean((path[2 * half :] - 2 * path[half:-half] + path[: -2 * half]) ** 2)) / 2**level)
    return np.array(found)


def main(arguments: list[str] | None = None) -> dict[str, np.ndarray]:
    """Make the virtual sensors, print and plot; return achieved over predicted deviations by sensor."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=1_000_000, help="length of each recording")
    parser.add_argument("--output", type=Path, default=Path("array.png"), help="file of the figure")
    options = parser.parse_args(arguments)
    static, turning = noise(options.samples, 1), noise(options.samples, 2)
    motion = 0.5 * np.sin(np.arange(options.samples) / RATE / 10)
    sensors = {
        "Kalman filter": gmwm.fuse(named(static), RATE),
        "weights for 1 min": gmwm.fuse(named(static), RATE, horizon=60.0),
    }
    ratios = {}
    for name, virtual in sensors.items():
        one = virtual["gyro_z"]
        fused = virtual.apply(named(turning + motion), RATE)["gyro_z"].values - motion
        levels = one.levels[one.seen > 20]
        found, average = deviation(fused, levels), deviation(turning.mean(axis=0), levels)
        ratios[name] = found / one.deviation[: levels.size]
        print(f"{name}: in the second recording")
        print(f"{'τ (s)':>8}  {'achieved/predicted':>18}  {'average/achieved':>16}")
        for k, tau in enumerate(one.tau[: levels.size]):
            print(f"{tau:8.2f}  {ratios[name][k]:18.2f}  {average[k] / found[k]:16.2f}")
    sensors["Kalman filter"].plot(path=options.output)
    print(f"wrote {options.output}")
    return ratios


if __name__ == "__main__":
    main()
