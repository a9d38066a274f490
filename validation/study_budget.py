"""Error budgets against a strapdown integration of simulated sensors, in plain NumPy and apart from the package.

A vehicle at rest on the rotating Earth. Its six sensors have noise of a known model. A full strapdown integration in
north, east and down with quaternions, the rotation of the Earth, transport rate, Coriolis terms and the curvature of a
spherical Earth follows many such vehicles at once. The budget uses linear error equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

import gmwm
from gmwm.applications.navigation import budget
from gmwm.choosing.datasheets.filter_numbers import filter_numbers

NAME = "budget"
SEED = 20261125
RATE = 10.0
RUNS = 800
FLICKER_RUNS = 400
TIMES = (1, 10, 60, 600, 3600)
LATITUDE = math.radians(45.0)
GRAVITY = 9.80665
EARTH_RATE = 7.292115e-5
RADIUS = 6.371e6
FITS = 200
"""Recordings from which the intervals are computed."""

Array = NDArray[np.float64]
Draw = Callable[[int], Array]

MODELS: dict[str, tuple[str, str, int]] = {
    "WN": ("WN(sigma2=1e-6)", "WN(sigma2=1e-4)", 0),
    "WN + RW": ("WN(sigma2=1e-6) + RW(gamma2=1e-14)", "WN(sigma2=1e-4) + RW(gamma2=1e-11)", 0),
    "WN + GM": ("WN(sigma2=1e-7) + GM(beta=0.01, sigma2=1e-10)", "WN(sigma2=1e-5) + GM(beta=0.005, sigma2=1e-8)", 0),
    "WN + 2*GM, after 60 s at rest": (
        "WN(sigma2=1e-7) + GM(beta=0.1, sigma2=1e-9) + GM(beta=0.0005, sigma2=4e-11)",
        "WN(sigma2=1e-5) + GM(beta=0.02, sigma2=1e-8) + GM(beta=0.0005, sigma2=1e-8)", 60,
    ),
    "QN + FN + WN, after 60 s at rest": (
        "QN(q2=1e-7) + FN(b2=1e-10) + WN(sigma2=1e-7)", "QN(q2=1e-5) + FN(b2=1e-9) + WN(sigma2=1e-6)", 60,
    ),
}  # fmt: skip
"""Gyroscopes, accelerometers, and seconds at rest before the start."""


# --- simulators -------------------------------------------------------------------------------------


def sensor(text: str, runs: int, samples: int, rng: np.random.Generator, old: Sequence[int]) -> Draw:
    """A function that returns the noise (3, runs) of sample number k. `old` has 1 for axes whose Gauss-Markov processes
    are stationary, and 0 for axes in which they start at zero."""
    terms = [(p.name, p.values) for p in gmwm.Model.parse(text).processes]
    draws = [_term(name, values, (runs, samples), rng, np.array(old)[:, None]) for name, values in terms]
    return lambda k: np.sum([draw(k) for draw in draws], axis=0)


def _term(name: str, values: dict[str, Any], size: tuple[int, int], rng: np.random.Generator, old: Any) -> Draw:
    runs, samples = size
    shape = (3, runs)
    if name == "WN":
        return lambda k: math.sqrt(values["sigma2"]) * rng.standard_normal(shape)
    if name == "QN":
        last = [math.sqrt(values["q2"]) * rng.standard_normal(shape)]

        def rounding(k: int) -> Array:
            new = math.sqrt(values["q2"]) * rng.standard_normal(shape)
            step, last[0] = new - last[0], new
            return step

        return rounding
    if name == "FN":
        path = _flicker(values["b2"], (*shape, samples), rng)
        return lambda k: path[:, :, k].astype(np.float64)
    if name == "RW":
        decay, step, state = 1.0, math.sqrt(values["gamma2"]), [np.zeros(shape)]
    else:
        decay = math.exp(-values["beta"] / RATE)
        step = math.sqrt(values["sigma2"] * (1 - decay**2))
        state = [math.sqrt(values["sigma2"]) * rng.standard_normal(shape) * old]

    def walk(k: int) -> Array:
        now = state[0]
        state[0] = decay * now + step * rng.standard_normal(shape)
        return now

    return walk


def _flicker(b2: float, shape: tuple[int, int, int], rng: np.random.Generator) -> NDArray[np.float32]:
    """Flicker noise by half an integration of white noise (Kasdin 1995), which began long before."""
    wanted = shape[-1]
    n = max(2**18, 2 * wanted) if wanted > 10_000 else 2**13
    weights = np.cumprod(np.r_[1.0, (np.arange(1, n) - 0.5) / np.arange(1, n)])
    size = 2 ** math.ceil(math.log2(2 * n))
    gain = np.fft.rfft(weights, size)
    # The spectrum of the sum is Q f^(-1)/2π for white noise of variance Q; B²/(2π|f|) in the standard.
    out = np.empty(shape, dtype=np.float32)
    for i in range(shape[0]):
        for j in range(shape[1]):
            white = math.sqrt(b2) * rng.standard_normal(n)
            out[i, j] = np.fft.irfft(gain * np.fft.rfft(white, size), size)[n - wanted : n]
    return out


# --- strapdown integration --------------------------------------------------------------------------


def cross(a: Array, b: Array) -> Array:
    """Vector product along the first axis."""
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def product(p: Array, q: Array) -> Array:
    """Product of quaternions (4, runs)."""
    return np.concatenate(
        [[p[0] * q[0] - np.sum(p[1:] * q[1:], axis=0)], p[0] * q[1:] + q[0] * p[1:] + cross(p[1:], q[1:])]
    )


def turn(angle: Array) -> Array:
    """Quaternion of a rotation vector (3, runs)."""
    size = np.sqrt(np.sum(angle**2, axis=0))
    return np.concatenate([[np.cos(size / 2)], 0.5 * np.sinc(size / (2 * np.pi)) * angle])


def rotated(q: Array, v: Array) -> Array:
    """A vector in the body frame, in the frame of north, east and down."""
    t = 2 * cross(q[1:], v)
    return v + q[0] * t + cross(q[1:], t)


def bias_of_filter(draw: Draw, model: str, runs: int, rest: int) -> Array:
    """The bias (3, runs) that a Kalman filter with N and K of a model knows after `rest` samples."""
    numbers = filter_numbers(gmwm.Model.parse(model).processes, RATE)
    white, walk = numbers.N**2 * RATE, numbers.K**2 / RATE
    bias, variance = np.zeros((3, runs)), math.inf
    for k in range(rest):
        gain = 1.0 if math.isinf(variance) else variance / (variance + white)
        bias, variance = bias + gain * (draw(k) - bias), gain * white + walk
    return bias


def navigate(
    models: tuple[str, str], runs: int, rest: int, times: Sequence[int], rng: np.random.Generator
) -> dict[int, dict[str, Array]]:
    """Errors of attitude (3, runs), velocity and position at `times` (s) with the models of gyroscopes and
    accelerometers."""
    samples, moving = rest + times[-1] * round(RATE), int(rest > 0)
    gyro = sensor(models[0], runs, samples, rng, [moving] * 3)
    accel = sensor(models[1], runs, samples, rng, [0, 0, moving])
    dt = 1 / RATE
    true = EARTH_RATE * np.array([math.cos(LATITUDE), 0.0, -math.sin(LATITUDE)])[:, None]
    weight = np.array([0.0, 0.0, GRAVITY])[:, None]
    q, v, p = turn(np.zeros((3, runs))), np.zeros((3, runs)), np.zeros((3, runs))
    bias, force = bias_of_filter(gyro, models[0], runs, rest), bias_of_filter(accel, models[1], runs, rest)
    if rest:
        # Levelling: the axes are turned so that the mean force points up. The heading stays.
        q = turn(np.stack([force[1], -force[0], np.zeros(runs)]) / -GRAVITY)
        force[:2] = 0.0
    found = {}
    for k in range(times[-1] * round(RATE)):
        measured_turn = true + gyro(rest + k) - bias
        measured_force = -weight + accel(rest + k) - force
        latitude = LATITUDE + p[0] / RADIUS
        earth = EARTH_RATE * np.stack([np.cos(latitude), np.zeros(runs), -np.sin(latitude)])
        carry = np.stack([v[1], -v[0], -v[1] * np.tan(latitude)]) / RADIUS
        down = weight * (1 + 2 * p[2] / RADIUS)
        before = q
        q = product(turn(-(earth + carry) * dt), product(q, turn(measured_turn * dt)))
        middle = before + q
        middle /= np.sqrt(np.sum(middle**2, axis=0))
        rise = rotated(middle, measured_force) + down - cross(2 * earth + carry, v)
        p += v * dt + 0.5 * rise * dt**2
        v = v + rise * dt
        if (k + 1) % round(RATE) == 0 and (k + 1) // round(RATE) in times:
            found[(k + 1) // round(RATE)] = {
                "attitude": 2 * q[1:] * np.sign(q[0]),
                "velocity": v.copy(),
                "position": p.copy(),
            }
    return found


# --- the study --------------------------------------------------------------------------------------


QUANTITIES = {
    "tilt": (("tilt_x", "tilt_y"), "attitude", (0, 1), 180 / math.pi),
    "heading": (("heading",), "attitude", (2,), 180 / math.pi),
    "velocity": (("velocity_x", "velocity_y"), "velocity", (0, 1), 1.0),
    "position": (("position_x", "position_y"), "position", (0, 1), 1.0),
    "height": (("position_z",), "position", (2,), 1.0),
}


def run(reduced: bool = False) -> dict[str, Any]:
    """Root mean square errors of the integration, and of the budget."""
    rows = []
    times = TIMES[:2] if reduced else TIMES
    for k, (name, (gyro, accel, rest)) in enumerate(MODELS.items()):
        runs = (FLICKER_RUNS if "FN" in name else RUNS) // (20 if reduced else 1)
        rng = np.random.default_rng([SEED, k])
        drawn = navigate((gyro, accel), runs, rest * round(RATE), times, rng)
        noise = {f"gyro_{x}": gyro for x in "xyz"} | {f"accel_{x}": accel for x in "xyz"}
        for seconds in times:
            budgeted = budget(noise, float(seconds), rate=RATE, rest=float(rest))
            for quantity, (names, kind, axes, size) in QUANTITIES.items():
                if names[0] not in budgeted.growths:
                    continue
                values = size * drawn[seconds][kind][list(axes)]
                rms = float(np.sqrt(np.mean(values**2)))
                said = float(np.mean([budgeted[one].error[-1] for one in names]))
                # For normal errors, the relative standard error of a root mean square of n values is 1/√(2n).
                rows.append(
                    {"model": name, "seconds": seconds, "quantity": quantity, "monte_carlo": rms, "budget": said,
                     "ratio": said / rms, "error": 1 / math.sqrt(2 * values.size)}
                )  # fmt: skip
    fewer = 20 if reduced else 1
    return {
        "rows": rows,
        "runs": RUNS // fewer,
        "flicker_runs": FLICKER_RUNS // fewer,
        "coverage": _coverage(5 if reduced else FITS),
    }


def _coverage(fits: int) -> dict[str, Any]:
    """How often the 95 % interval contains the error of the true model."""
    truth, rate, samples = "WN(sigma2=1e-6) + RW(gamma2=1e-12)", 100.0, 60_000
    exact = budget({"gyro_x": truth}, 60.0, rate=rate)["tilt_x"].error[-1]
    inside = 0
    for k in range(fits):
        rng = np.random.default_rng([SEED, 100, k])
        x = 1e-3 * rng.standard_normal(samples) + np.cumsum(1e-6 * rng.standard_normal(samples))
        fit = gmwm.fit("WN + RW", gmwm.Signal(x, rate, "rad/s", "gyro_x"), weighting="optimal")
        found = budget({"gyro_x": fit}, 60.0)["tilt_x"]
        inside += int(found.low[-1] <= exact <= found.high[-1])
    return {"fits": fits, "inside": inside}


def table(result: dict[str, Any]) -> str:
    """Markdown: the ratios of budget and integration."""
    lines = [
        "The error budget is compared with strapdown integrations of simulated sensors, written in plain NumPy apart "
        "from the package: quaternions, a rotating spherical Earth at 45° latitude, transport rate and Coriolis "
        f"terms. The table has the error of the budget divided by the root mean square error of {result['runs']} "
        f"integrations ({result['flicker_runs']} with flicker noise) at {RATE:g} Hz. The standard error of a ratio is "
        f"{_percent(result, min)} to {_percent(result, max)} %. It is largest for heading and height, which have one "
        "value in each run. The budget has no height after 100 s.",
        "",
        "| model | after | tilt | heading | velocity | position | height |",
        "|---|---|---|---|---|---|---|",
    ]
    rows = result["rows"]
    for name in dict.fromkeys(row["model"] for row in rows):
        for seconds in dict.fromkeys(row["seconds"] for row in rows):
            ratios = {r["quantity"]: r["ratio"] for r in rows if r["model"] == name and r["seconds"] == seconds}
            cells = " | ".join(f"{ratios[quantity]:.3f}" if quantity in ratios else "" for quantity in QUANTITIES)
            lines.append(f"| {name} | {seconds} s | {cells} |")
    covered = result["coverage"]
    worst = max(rows, key=lambda row: abs(row["ratio"] - 1))
    lines += [
        "",
        f"The largest difference is {100 * abs(worst['ratio'] - 1):.1f} %, for the {worst['quantity']} after "
        f"{worst['seconds']} s with {worst['model']}.",
        "",
        f"The 95 % interval of the tilt after 60 s, from fits of WN + RW to {covered['fits']} recordings of ten "
        "minutes, contains the error of the true model in "
        f"{100 * covered['inside'] / covered['fits']:.0f} % of the recordings.",
    ]
    return "\n".join(lines)


def _percent(result: dict[str, Any], which: Callable[[list[float]], float]) -> str:
    return f"{100 * which([row['error'] for row in result['rows']]):.1f}"
