"""N and K of four Allan deviation tools, repeated in NumPy: `python examples/imu_tools.py`.

The tools are allan_variance_ros, kalibr_allan, imu_utils and the example of MATLAB. They were not run: the functions
repeat their calculations on simulated gyroscopes. docs/coming-from/imu-tools.md explains the differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import gmwm

RATE = 200.0
HOURS = 3.0
TRUTHS = {
    "white noise, random walk": gmwm.Model.parse("WN(sigma2=2e-6) + RW(gamma2=1e-12)"),
    "white noise, bias of 100 s": gmwm.Model.parse("WN(sigma2=2e-6) + GM(beta=0.01, sigma2=2e-9)"),
}
Samples = NDArray[np.float64]
Slopes = tuple[float, float]
"""N (rad/s/√Hz) and K (rad/s²/√Hz)."""


def line(tau: Samples, sigma: Samples, slope: float, at: float) -> float:
    """Height at `at` of the line of this slope through the points, its mean height in the logarithmic plot."""
    return math.exp(np.mean(np.log(sigma) - slope * np.log(tau))) * at**slope


def without_overlap(x: Samples, sizes: NDArray[np.int64]) -> Samples:
    """Allan deviation of non-overlapping clusters."""
    sums = np.concatenate([[0.0], np.cumsum(x - x.mean())])
    return np.array([np.sqrt(np.mean(np.diff(sums[::n], 2) ** 2) / 2) / n for n in sizes])


def with_overlap(x: Samples) -> tuple[Samples, Samples]:
    """Overlapping Allan deviation at a hundred cluster sizes."""
    sizes = np.unique(np.ceil(np.geomspace(1, 2 ** math.floor(math.log2(len(x) // 2)), 100)).astype(int))
    found = gmwm.allan_variance(x, RATE, clusters=sizes)
    return found.tau, found.deviation


def like_allan_variance_ros(x: Samples, measure_rate: float = RATE) -> Slopes:
    """Every k-th sample; periods of 0.1 s to 999.9 s; N from periods below 10 s, K from all periods."""
    every = int(RATE / measure_rate)
    tau = 0.1 * np.arange(1, 10_000)
    tau = tau[2 * tau < len(x) / RATE]
    sigma = without_overlap(x[every - 1 :: every], np.rint(tau * measure_rate).astype(int))
    return line(tau[:99], sigma[:99], -0.5, 1.0), line(tau, sigma, 0.5, 3.0)


def like_kalibr_allan(x: Samples) -> Slopes:
    """2000 periods with logarithmic spacing; N from those well before the minimum, K from those well after it."""
    sizes = np.floor(np.geomspace(1 / RATE, (len(x) - 1) // 2, 2000)).astype(int)
    sizes, place = np.unique(sizes[sizes > 0], return_inverse=True)
    tau, sigma = sizes[place] / RATE, without_overlap(x, sizes)[place]
    lowest = int(np.argmin(sigma))
    before, after = slice(0, lowest - 50), slice(lowest + 50, None)
    walk = line(tau[after], sigma[after], 0.5, 3.0) if lowest + 50 < len(tau) else math.nan
    return line(tau[before], sigma[before], -0.5, 1.0), walk


def like_imu_utils(x: Samples) -> Slopes:
    """Five powers of τ fitted to log σ² with equal weights; `gyr_n` √f σ(1 s) and `gyr_w`, the minimum of the fit."""
    tau, sigma = with_overlap(x)
    powers = tau[:, None] ** np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    start = np.abs(np.linalg.lstsq(tau[:, None] ** np.array([-1.0, -0.5, 0.0, 0.5, 1.0]), sigma, rcond=None)[0])
    found = least_squares(lambda c: np.log10(powers @ c**2) - 2 * np.log10(sigma), start, x_scale=start)
    return math.sqrt(RATE) * math.sqrt(np.sum(found.x**2)), math.sqrt(np.min(powers @ found.x**2))


def like_matlab(x: Samples) -> Slopes:
    """One point each, where the slope is nearest −½ and ½."""
    tau, sigma = with_overlap(x)
    slopes = np.diff(np.log(sigma)) / np.diff(np.log(tau))

    def read(slope: float, at: float) -> float:
        place = np.argmin(np.abs(slopes - slope))
        return float(sigma[place] * (at / tau[place]) ** slope)

    return read(-0.5, 1.0), read(0.5, 3.0)


TOOLS: dict[str, Callable[[Samples], Slopes]] = {
    "allan_variance_ros": like_allan_variance_ros,
    "… measure_rate: 100": lambda x: like_allan_variance_ros(x, 100.0),
    "kalibr_allan": like_kalibr_allan,
    "MATLAB's example": like_matlab,
    "imu_utils (gyr_n, gyr_w)": like_imu_utils,
}


def main(hours: float = HOURS, seed: int = 1) -> dict[str, dict[str, Slopes]]:
    """Print N and K of each tool and of gmwm for both gyroscopes; return them by gyroscope and tool."""
    found: dict[str, dict[str, Slopes]] = {}
    for name, truth in TRUTHS.items():
        x = truth.simulate(round(hours * 3600 * RATE), RATE, rng=seed)
        found[name] = {tool: calculate(x) for tool, calculate in TOOLS.items()}
        noise = gmwm.fit(truth.structure, gmwm.Signal(x, RATE, "rad/s", "gyro_x")).datasheet()
        found[name]["gmwm"] = (noise["N"].value, noise["K"].value)
        print(name)
        for tool, (white, walk) in found[name].items():
            print(f"  {tool:<24} {white:.3e}  {walk:.3e}")
    return found


if __name__ == "__main__":
    main()
