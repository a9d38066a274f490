"""A fitted noise model in a navigation filter: `python examples/navigation.py [--runs M] [--output FIGURE] [--seed N]`.

The example simulates a gyroscope and two accelerometers at rest for hours and fits their noise models. It simulates
M drives of a vehicle with these sensors and a satellite receiver with two outages. Extended Kalman filters with several
noise models estimate the track, and the example compares their errors with the errors that they predict.
docs/navigation.md has the results.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import block_diag
from scipy.stats import chi2

import gmwm
from gmwm.showing.plots.style import BLACK, BLUE, GREEN, GRID, ORANGE

RATE, STEPS = 100.0, 10
"""Samples of the sensors, and steps of the filter, per second."""
HOURS, SECONDS = 8.0, 480
"""Length of the recording at rest (h) and of the drive (s)."""
OUTAGES = ((150, 210), (330, 390))
"""Times without a satellite position (s)."""
FIX = 1.0
"""Standard deviation of a satellite position (m). One arrives every second."""
TRUTH = {
    "gyro_z": gmwm.Model.parse("GM(beta=0.02, sigma2=2e-8) + WN(sigma2=2e-7) + RW(gamma2=4e-13)"),
    "accel_x": gmwm.Model.parse("GM(beta=0.02, sigma2=9e-6) + WN(sigma2=3e-5) + RW(gamma2=4e-11)"),
    "accel_y": gmwm.Model.parse("GM(beta=0.02, sigma2=9e-6) + WN(sigma2=3e-5) + RW(gamma2=4e-11)"),
}
TURN_ON = {"gyro_z": 1e-4, "accel_x": 2e-3, "accel_y": 2e-3}
"""Standard deviation of the bias at the start of the drive (rad/s, m/s²)."""
START = np.array([FIX, FIX, 0.2, 0.2, np.deg2rad(1.0)])
"""Standard deviations of position (2), velocity (2) and heading at the start: the states common to all filters."""
SHOWN = ((slice(4, 5), np.rad2deg(1), "Heading error (deg)"), (slice(0, 2), 1, "Position error (m)"))
"""States that the table and the figure show, with factor and label."""
DRAWN = ("fitted model", "white noise only", "N, B as a constant", "10 N, 10 K")


# --- noise models in state-space form -----------------------------------------------------------------


class Noise(NamedTuple):
    """Model of the errors of the three sensors: b' = F b + w, error = H b + v."""

    F: np.ndarray
    Q: np.ndarray
    H: np.ndarray
    R: np.ndarray
    P0: np.ndarray


def noise(models: Mapping[str, gmwm.Model], start: Mapping[str, float] = TURN_ON) -> Noise:
    """The block-diagonal matrices of the three sensors, for the step of the filter."""
    # The filter runs at a lower rate than the sensors. At their rate, use model.state_space(RATE).
    spaces = {axis: model.continuous(RATE).discrete(STEPS) for axis, model in models.items()}
    # A random walk has no stationary variance. Its variance at the start is that of the bias.
    first = [space.P0 + start[axis] ** 2 * np.diag(space.diffuse) for axis, space in spaces.items()]
    blocks = {name: [getattr(space, name) for space in spaces.values()] for name in ("F", "Q", "H", "R")}
    return Noise(**{name: block_diag(*block) for name, block in blocks.items()}, P0=block_diag(*first))


def candidates(seed: int) -> dict[str, Noise]:
    """The true model, the model fitted to a recording at rest, and four common choices."""
    fitted, white, steady, two, inflated, start = ({} for _ in range(6))
    print(f"Fitted to {HOURS:g} h at rest at {RATE:g} Hz: estimate / truth ± standard error")
    for k, (axis, truth) in enumerate(TRUTH.items()):
        samples = truth.simulate(round(HOURS * 3600 * RATE), RATE, np.random.default_rng([seed, k]))
        signal = gmwm.Signal(samples, RATE, "rad/s" if axis.startswith("gyro") else "m/s²", axis)
        fit = gmwm.fit(truth.structure, signal)
        at, by = fit.parameters, fit.standard_errors
        shares = (f"{name} {at[name] / v:.2f} ± {by[name] / v:.2f}" for name, v in truth.parameters.items())
        print(f"  {axis:<8} " + ", ".join(shares))
        fitted[axis] = fit.model
        # N and B from the slopes of the Allan deviation.
        read = gmwm.avlr(signal).coefficients
        white[axis] = gmwm.Model.parse(f"WN(sigma2={read['N'] ** 2 * RATE})")
        steady[axis] = white[axis] + gmwm.RW(gamma2=0.0)
        start[axis] = float(np.hypot(read["B"], TURN_ON[axis]))
        # N and K that replace the model over one second, and ten times these values.
        both = gmwm.datasheets.effective_noise(fit, horizon=1.0)
        n2, k2 = both["N"].value ** 2, both["K"].value ** 2
        two[axis] = gmwm.Model.parse(f"WN(sigma2={n2 * RATE}) + RW(gamma2={k2 / RATE})")
        inflated[axis] = gmwm.Model.parse(f"WN(sigma2={100 * n2 * RATE}) + RW(gamma2={100 * k2 / RATE})")
    return {
        "true model": noise(TRUTH),
        "fitted model": noise(fitted),
        "white noise only": noise(white),
        "N, B as a constant": noise(steady, start),
        "N, K": noise(two),
        "10 N, 10 K": noise(inflated),
    }


# --- the drive ----------------------------------------------------------------------------------------


class Drive(NamedTuple):
    """State of the vehicle at each sample, and the output of sensors without errors."""

    state: np.ndarray
    """Position (m), velocity (m/s) and heading (rad), (5, samples + 1)."""
    sensed: np.ndarray
    """Turn rate (rad/s), specific force ahead and to the left (m/s²), (3, samples)."""


def drive() -> Drive:
    """Turns and changes of speed, between 8 and 16 m/s."""
    t = np.arange(round(SECONDS * RATE) + 1) / RATE
    heading = 2 * np.pi * t / 240 + 0.8 * np.sin(2 * np.pi * t / 45)
    velocity = (12 + 4 * np.sin(2 * np.pi * t / 60)) * np.array([np.cos(heading), np.sin(heading)])
    way = np.cumsum((velocity[:, 1:] + velocity[:, :-1]) / (2 * RATE), axis=1)
    state = np.concatenate([np.pad(way, ((0, 0), (1, 0))), velocity, heading[None]])
    force = turned((heading[1:] + heading[:-1]) / -2, *(np.diff(velocity) * RATE))
    return Drive(state, np.array([np.diff(heading) * RATE, *force]))


def turned(angle: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


def measured(way: Drive, runs: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Output of the sensors, (runs, 3, samples), and of the satellite receiver, (runs, 2, seconds)."""
    said = np.empty((runs, *way.sensed.shape))
    for k, (axis, truth) in enumerate(TRUTH.items()):
        rng = np.random.default_rng([seed, 10 + k])
        said[:, k] = way.sensed[k] + TURN_ON[axis] * rng.standard_normal((runs, 1))
        said[:, k] += truth.simulate(said.shape[2], RATE, rng, paths=runs)
    fixes = way.state[:2, round(RATE) :: round(RATE)]
    return said, fixes + FIX * np.random.default_rng([seed, 20]).standard_normal((runs, *fixes.shape))


# --- the filter ---------------------------------------------------------------------------------------


class Track(NamedTuple):
    """Errors of a filter before each satellite position, (seconds, runs, 5), and the covariances that it claims."""

    error: np.ndarray
    covariance: np.ndarray

    @property
    def nees(self) -> np.ndarray:
        """Normalised estimation error squared eᵀP⁻¹e, mean over the runs: 5 for a consistent filter."""
        whitened = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        return np.mean(np.sum(self.error * whitened, axis=2), axis=1)

    def size(self, states: slice) -> tuple[np.ndarray, np.ndarray]:
        """Root mean square error of these states over the runs, and its value according to the filter."""
        variance = np.diagonal(self.covariance, axis1=2, axis2=3)[..., states].sum(axis=2)
        return np.sqrt(np.mean(np.sum(self.error[..., states] ** 2, axis=2), axis=1)), np.sqrt(variance.mean(axis=1))


def follow(model: Noise, way: Drive, said: np.ndarray, fixes: np.ndarray, seed: int) -> Track:
    """An extended Kalman filter of the errors δ = truth − estimate, all runs at once.

    δ = (position, velocity, heading, b). The estimate of b corrects the sensors. δ contains the error of this estimate.
    """
    runs, states = len(said), 5 + len(model.F)
    x = way.state[:, 0] + START * np.random.default_rng([seed, 30]).standard_normal((runs, 5))
    b = np.zeros((runs, len(model.F)))
    P = np.tile(block_diag(np.diag(START**2), model.P0), (runs, 1, 1))
    each, errors, covariances = round(RATE) // STEPS, [], []
    for step in range(SECONDS * STEPS):
        sensed = said[:, :, step * each : (step + 1) * each] - (b @ model.H.T)[:, :, None]
        x, by_heading, by_sensors = strapdown(x, sensed)
        # Errors after the step: transition of the errors before it, plus the errors of the sensors.
        transition = np.tile(np.eye(states), (runs, 1, 1))
        transition[:, [0, 1], [2, 3]] = 1 / STEPS
        transition[:, :4, 4] = by_heading
        transition[:, :5, 5:] = by_sensors @ model.H
        transition[:, 5:, 5:] = model.F
        added = np.zeros_like(P)
        added[:, :5, :5] = by_sensors @ model.R @ by_sensors.transpose(0, 2, 1)
        added[:, 5:, 5:] = model.Q
        b, P = b @ model.F.T, transition @ P @ transition.transpose(0, 2, 1) + added
        second, rest = divmod(step + 1, STEPS)
        if rest:
            continue
        errors.append(way.state[:, round(second * RATE)] - x)
        covariances.append(P[:, :5, :5])
        if not any(first < second <= last for first, last in OUTAGES):
            gain = P[:, :, :2] @ np.linalg.inv(P[:, :2, :2] + FIX**2 * np.eye(2))
            found = (gain @ (fixes[:, :, second - 1] - x[:, :2])[:, :, None])[:, :, 0]
            x, b, P = x + found[:, :5], b + found[:, 5:], P - gain @ P[:, :2]
    return Track(np.array(errors), np.array(covariances))


def strapdown(x: np.ndarray, sensed: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Integrate the samples of one filter step; return the state after it and its derivatives by an error.

    The derivatives of position and velocity by the heading have the shape (runs, 4). Those of all five states by an
    error of the sensors have the shape (runs, 5, 3). A positive error of a sensor is subtracted from its output.
    """
    dt, span = 1 / RATE, 1 / STEPS
    ahead = dt * np.cumsum(sensed[:, 0], axis=1)
    angle = x[:, 4:] + ahead - dt * sensed[:, 0] / 2
    gained = dt * np.cumsum(turned(angle, sensed[:, 1], sensed[:, 2]), axis=2)
    rise = gained[:, :, -1].T
    way = span * x[:, 2:4] + dt * (gained.sum(axis=2).T - rise / 2)
    after = x + np.concatenate([way, rise, ahead[:, -1:]], axis=1)
    # A change of heading rotates the velocity increment; half of it over the step adds to the position.
    turn = np.stack([-rise[:, 1], rise[:, 0]], axis=1)
    c, s = dt * np.cos(angle).sum(axis=1), dt * np.sin(angle).sum(axis=1)
    by_sensors = np.zeros((len(x), 5, 3))
    by_sensors[:, 4, 0] = -span
    by_sensors[:, 2:4] = np.stack([-span / 2 * turn, -np.stack([c, s], axis=1), np.stack([s, -c], axis=1)], axis=2)
    by_sensors[:, :2] = span / 2 * by_sensors[:, 2:4]
    return after, np.concatenate([span / 2 * turn, turn], axis=1), by_sensors


# --- results ------------------------------------------------------------------------------------------


def main(arguments: list[str] | None = None) -> dict[str, Track]:
    """Fit, simulate, filter, print and plot; return the tracks by noise model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=100, help="number of drives, each with independent noise")
    parser.add_argument("--output", type=Path, default=Path("navigation.png"), help="file of the figure")
    parser.add_argument("--seed", type=int, default=2018)
    options = parser.parse_args(arguments)
    models, way = candidates(options.seed), drive()
    said, fixes = measured(way, options.runs, options.seed)
    tracks = {name: follow(one, way, said, fixes, options.seed) for name, one in models.items()}
    print_table(tracks, options.runs)
    draw({name: tracks[name] for name in DRAWN}, options.runs, options.output)
    print(f"wrote {options.output}")
    return tracks


def band(runs: int) -> np.ndarray:
    """The interval that contains 95 % of the mean NEES of a consistent filter."""
    return chi2.ppf([0.025, 0.975], 5 * runs) / runs


def print_table(tracks: Mapping[str, Track], runs: int) -> None:
    """Print one row for each noise model."""
    low, high = band(runs)
    away = [list(range(first, last + 1)) for first, last in OUTAGES]
    there = np.setdiff1d(np.arange(60, SECONDS), np.concatenate(away))
    times = {"with fixes": there, "outage end": [outage[-1] for outage in away]}
    print(f"\n{runs} drives of {SECONDS} s: root mean square errors, in brackets those predicted by the filter")
    print(f"{'':<19} {'NEES':>7}  {'in band':>7}   {'heading, deg':<29} position, m")
    print(f"{'':<38}" + "".join(f"{name:<15}" for _ in range(2) for name in times).rstrip())
    for name, track in tracks.items():
        inside = np.mean((low <= track.nees) & (track.nees <= high))
        line = f"{name:<19} {track.nees.mean():>7.2f}  {inside:>7.0%}   "
        for states, factor, _ in SHOWN:
            for at in times.values():
                rms, says = (factor * np.sqrt(np.mean(one[at] ** 2)) for one in track.size(states))
                line += f"{f'{rms:.2f} ({says:.2f})':<15}"
        print(line.rstrip())
    print(f"NEES of 5 states: mean over runs and time; in band: mean over runs within {low:.2f} … {high:.2f}")


def draw(tracks: Mapping[str, Track], runs: int, path: Path) -> None:
    """Plot heading error, position error and NEES over time, one column per noise model."""
    figure = Figure(figsize=(174 / 25.4, 138 / 25.4), layout="constrained")
    axes = figure.subplots(3, len(tracks), sharex=True, sharey="row")
    t, (first, reference) = np.arange(1, SECONDS + 1), next(iter(tracks.items()))
    for column, (name, track) in zip(axes.T, tracks.items(), strict=True):
        column[0].set_title(name, fontsize=8)
        for ax, (states, factor, label) in zip(column, SHOWN, strict=False):
            rms, says = track.size(states)
            of_drives = f"error (root mean square), or NEES (mean), of {runs} drives"
            ax.plot(t, factor * rms, color=BLUE, lw=1.1, label=of_drives)
            estimated = "standard deviation (1 σ) that the filter estimates"
            ax.plot(t, factor * says, color=ORANGE, lw=1.4, dashes=(4, 1.6), label=estimated)
            if track is reference:
                ax.set_ylabel(label, fontsize=8)
                ax.yaxis.set_major_formatter("{x:g}")
            else:
                best = factor * reference.size(states)[0]
                compared = f"error with the {first} (root mean square)"
                ax.plot(t, best, color=BLACK, lw=0.8, dashes=(1, 1.4), label=compared)
        column[2].plot(t, track.nees, color=BLUE, lw=1.1)
        consistent = f"95 % of mean NEES of {runs} drives, if the filter is consistent"
        column[2].axhspan(*band(runs), color=GREEN, alpha=0.35, lw=0, label=consistent)
    for ax in axes.flat:
        ax.set(yscale="log", xlim=(0, SECONDS), xticks=range(0, SECONDS + 1, 120))
        ax.grid(color=GRID, lw=0.5)
        ax.tick_params(labelsize=7)
        for outage in OUTAGES:
            ax.axvspan(*outage, color=GRID, alpha=0.7, lw=0, label="outage: no satellite positions")
    for ax in axes[2]:
        ax.set_yscale("symlog", linthresh=10)  # linear up to 10, the range of the band
        ax.set_yticks([0, 5, 10, 100, 1000])
        ax.set_xlabel("Time (s)", fontsize=8)
        ax.yaxis.set_major_formatter("{x:g}")
    axes[2, 0].set_ylabel("NEES (no unit)", fontsize=8)
    entries = {label: line for ax in axes.flat for line, label in zip(*ax.get_legend_handles_labels(), strict=True)}
    figure.legend(entries.values(), entries.keys(), loc="outside lower center", ncols=2, fontsize=7, frameon=False)
    figure.savefig(path, dpi=200)


if __name__ == "__main__":
    main()
