"""A virtual sensor that fuses several sensors, and its Kalman filter on the differences of their signals.

Differences B x (B 1 = 0) of signals of one axis contain no motion. w₀ᵀ x has the least white noise, independent of
them. The filter estimates other noise b_p: ŝ = w₀ᵀ x − Σ_p c_p B b̂_p, with c_p = w₀ᵀ Σ_p Bᵀ (B Σ_p Bᵀ)⁺, as c_p B b_p
predicts w₀ᵀ b_p best."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.several.matrices import synchronous_signals
from gmwm.applications.several.state_space import factor
from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.documents import plain_fields
from gmwm.base.errors import DataError
from gmwm.base.lazy import polars, scipy
from gmwm.base.remarks import Dialect, Quantity, Remark, texts
from gmwm.base.results import Tabular, register
from gmwm.base.text import duration_text, p_relation, table_with_rule
from gmwm.base.units import AXES
from gmwm.measuring.axis_results import AxisResults
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.statespace import StateSpace

BLOCK_SAMPLES = 256  # number of consecutive samples that are filtered by one matrix product


@dataclass(frozen=True, eq=False)
class DifferenceFilter:
    """A Kalman filter with constant gain for signals x_t: ξ_t = A ξ_{t−1} + K B x_t, ŝ_t = w₀ᵀ x_t − C ξ_t."""

    weights: Vector  # (d,) w₀
    differences: Matrix  # (d − 1, d) B
    # A (n, n), K (n, d − 1): transition matrix and gain
    A: Matrix
    K: Matrix
    C: Vector  # (n,) row that predicts the noise of w₀ᵀ x_t from the states

    @classmethod
    def static(cls, weights: Vector) -> DifferenceFilter:
        """Return a filter without states, which computes the weighted sum of the signals."""
        d = weights.size
        empty = np.zeros((0, 0))
        return cls(weights, np.zeros((d - 1, d)), A=empty, K=np.zeros((0, d - 1)), C=np.zeros(0))

    @property
    def memory(self) -> int:
        """Time constant (samples) of the slowest state of the filter."""
        slowest = float(np.max(np.abs(np.linalg.eigvals(self.A)), initial=0.0))
        return int(min(np.ceil(1 / max(1 - slowest, 1e-12)), 2**62))

    def to_dict(self) -> dict[str, Any]:
        """Return the matrices as lists."""
        return {"w0": self.weights.tolist(), "B": self.differences.tolist(), "A": self.A.tolist(),
                "K": self.K.tolist(), "C": self.C.tolist()}  # fmt: skip

    def run(self, x: Matrix) -> Vector:
        """Return the fused signal (N,) of samples (d, N) of a segment, minus the mean difference over the filter's
        first time constant, a constant for a small transient."""
        base = self.weights @ x
        if not self.C.size:
            return np.asarray(base)
        z = self.differences @ x
        z = z - z[:, : max(self.memory, 1)].mean(axis=1, keepdims=True)
        return np.asarray(base - self._correction(z))

    def _correction(self, z: Matrix) -> Vector:
        """Return C ξ_t (N,) for differences (d − 1, N), computed block by block."""
        count, n = z.shape[1], self.C.size
        blocks = -(-count // BLOCK_SAMPLES)
        padded = np.zeros((blocks * BLOCK_SAMPLES, z.shape[0]))
        padded[:count] = z.T
        rows = padded.reshape(blocks, -1)
        power, drive, out = np.eye(n), [], []
        for _ in range(BLOCK_SAMPLES):
            drive.append(power @ self.K)
            power = self.A @ power
            out.append(self.C @ power)
        # Response of the output at each sample of a block to the input at each earlier sample of the block.
        impulse = np.array([self.C @ matrix for matrix in drive])
        within = np.zeros((BLOCK_SAMPLES, BLOCK_SAMPLES, z.shape[0]))
        for lag in range(BLOCK_SAMPLES):
            within[np.arange(lag, BLOCK_SAMPLES), np.arange(BLOCK_SAMPLES - lag)] = impulse[lag]
        inputs = rows @ np.concatenate(drive[::-1], axis=1).T
        states = np.zeros((blocks, n))
        for k in range(1, blocks):
            states[k] = power @ states[k - 1] + inputs[k - 1]
        return np.asarray((rows @ within.reshape(BLOCK_SAMPLES, -1).T + states @ np.array(out).T).ravel()[:count])


@dataclass(frozen=True, eq=False)
class ArrayNoise:
    """Noise of an array: processes at unit scale, and the covariance matrix of each between the d signals."""

    processes: tuple[Process, ...]  # the P processes at unit scale
    sigmas: Matrix  # (P, d, d) covariance matrix of each process
    rate: float  # Hz

    @property
    def spaces(self) -> list[StateSpace]:
        """The state spaces of the processes at unit scale."""
        return [process.state_space(self.rate) for process in self.processes]

    @property
    def white(self) -> Matrix:
        # So that the covariance matrix has an inverse.
        """Covariance (d, d) of the white measurement noise of one sample, with a small diagonal matrix."""
        d = self.sigmas.shape[-1]
        total = sum((space.R[0, 0] * sigma for space, sigma in zip(self.spaces, self.sigmas, strict=True)),
                    np.zeros((d, d)))  # fmt: skip
        ridge = 1e-10 * float(np.trace(total if np.any(total) else self.sigmas.sum(axis=0))) / d
        return np.asarray(total + ridge * np.eye(d))

    def filter(self) -> DifferenceFilter:
        """Return the Kalman filter on the differences of the signals."""
        white = self.white
        d = len(white)
        inverse = np.linalg.solve(white, np.ones(d))
        weights = inverse / inverse.sum()
        differences = scipy.linalg.null_space(np.ones((1, d))).T
        seen = [self._observed_parts(space, sigma, differences, weights=weights)
                for space, sigma in zip(self.spaces, self.sigmas, strict=True) if space.states]  # fmt: skip
        if not sum(part[0].shape[0] for part in seen):
            return DifferenceFilter.static(weights)
        F, Q = (scipy.linalg.block_diag(*(part[k] for part in seen)) for k in (0, 1))
        H, C = np.concatenate([part[2] for part in seen], axis=1), np.concatenate([part[3] for part in seen])
        R = differences @ white @ differences.T
        ahead = _steady(F, Q, H, R)
        K = np.linalg.solve(H @ ahead @ H.T + R, H @ ahead).T
        return DifferenceFilter(weights, differences, A=(np.eye(len(F)) - K @ H) @ F, K=K, C=C)

    @staticmethod
    def _observed_parts(
        space: StateSpace, sigma: Matrix, differences: Matrix, *, weights: Vector
    ) -> tuple[Matrix, Matrix, Matrix, Vector]:
        """Return F, Q and H of one process as it appears in the differences, and its part of the row C."""
        root = factor(differences @ sigma @ differences.T)
        eye = np.eye(root.shape[1])
        regression = weights @ sigma @ differences.T @ np.linalg.pinv(root).T if root.size else np.zeros(0)
        parts = [np.kron(space.F, eye), np.kron(space.Q, eye), np.kron(space.H, root), np.kron(space.H[0], regression)]
        F, Q, H, C = (np.asarray(part, dtype=np.float64) for part in parts)
        return F, Q, H, C

    def fused_space(self, filter: DifferenceFilter) -> StateSpace:
        """Return the fused signal's state space at rest, for any filter. As walks z make its states ξ non-stationary, ξ
        = G z + e with the steady response G: e_t = A e_{t−1} − A G w_{t−1} + K B n_t, increments w, noise n."""
        parts = [(space, factor(sigma)) for space, sigma in zip(self.spaces, self.sigmas, strict=True) if space.states]
        F = scipy.linalg.block_diag(*(np.kron(space.F, np.eye(root.shape[1])) for space, root in parts))
        Q = scipy.linalg.block_diag(*(np.kron(space.Q, np.eye(root.shape[1])) for space, root in parts))
        H = np.concatenate([np.kron(space.H, root) for space, root in parts], axis=1)
        walk = np.concatenate([np.repeat(space.diffuse, root.shape[1]) for space, root in parts])
        gain = filter.K @ filter.differences
        response = np.linalg.solve(np.eye(filter.C.size) - filter.A, gain @ H) * walk
        p, n, d = len(F), filter.C.size, filter.weights.size
        white = self.white
        # The state vector contains noise states, e, and this sample's white noise, which enters the output and e.
        stationary = gain @ (H * ~walk)
        transition = np.zeros((p + n + d, p + n + d))
        transition[:p, :p], transition[p : p + n, :p], transition[p : p + n, p : p + n] = F, stationary @ F, filter.A
        carry = np.concatenate([np.eye(p), stationary - filter.A @ response, np.zeros((d, p))])
        other = np.concatenate([np.zeros((p, d)), gain, np.eye(d)])
        noise = carry @ Q @ carry.T + other @ white @ other.T
        seen = np.concatenate([filter.weights @ H - filter.C @ response, -filter.C, filter.weights])
        stays = np.concatenate([~walk, np.ones(n + d, bool)])
        start = np.zeros_like(noise)
        start[np.ix_(stays, stays)] = _stationary(transition[np.ix_(stays, stays)], noise[np.ix_(stays, stays)])
        return StateSpace(F=transition, Q=noise, H=seen, P0=start)

    def static(self, weights: Vector, levels: Integers) -> Vector:
        """Return the wavelet variance (J,) of a weighted sum of the signals."""
        scales = np.einsum("a,pab,b->p", weights, self.sigmas, weights)
        shapes = np.array([process.wavelet_variance(levels, self.rate) for process in self.processes])
        return np.asarray(scales @ shapes)


def wavelet_variance(noise: ArrayNoise, filter: DifferenceFilter, levels: Integers) -> Vector:
    """Return the wavelet variance (J,) of the fused signal of an array at rest."""
    return noise.fused_space(filter).haar_variance(levels) if filter.C.size else noise.static(filter.weights, levels)


def _steady(F: Matrix, Q: Matrix, H: Matrix, R: Matrix) -> Matrix:
    """Return the steady-state covariance of the predicted state, by the doubling algorithm for the Riccati recursion
    (Anderson and Moore 1979, Optimal Filtering, section 6.7)."""
    a, g, p = F.T.copy(), H.T @ np.linalg.solve(R, H), Q.copy()
    eye = np.eye(len(F))
    for _ in range(64):
        inner = np.linalg.solve(eye + g @ p, np.concatenate([a, g], axis=1))
        first, second = inner[:, : len(F)], inner[:, len(F) :]
        added = a.T @ p @ first
        g, a, p = g + a @ second @ a.T, a @ first, p + (added + added.T) / 2
        if np.linalg.norm(added) <= 1e-14 * np.linalg.norm(p):
            break
    return p


def _stationary(transition: Matrix, noise: Matrix) -> Matrix:
    """Return the stationary covariance P that solves P = A P Aᵀ + W, computed by doubling."""
    p, a = noise, transition
    for _ in range(64):
        added = a @ p @ a.T
        p, a = p + added, a @ a
        if np.linalg.norm(added) <= 1e-15 * np.linalg.norm(p):
            break
    return (p + p.T) / 2


ALONE = "virtual"  # name of the axis if the names of the signals do not state one
_MEMBER = re.compile(r"(?P<axis>.+?)\s*\[(?P<unit>[^\]]+)\]")
_EXPECTED = "several recordings, or a mapping of names such as gyro_x[0] to signals"


def like_axes(x: Any, rate: float | None) -> dict[str, dict[str, Signal]]:
    """Group the signals of an array of units by axis, and by name within each axis; `fuse` describes the arguments."""
    groups = _groups(x)
    axes = {}
    for axis, members in groups.items():
        if len(members) < 2:
            raise DataError(
                f"{axis} has only one signal, {next(iter(members))}", argument="x", advice=f"Pass {_EXPECTED}."
            )
        axes[axis] = synchronous_signals(members, rate, fill=False)
        units = {name: signal.unit for name, signal in axes[axis].items()}
        if len(set(units.values())) > 1:
            raise DataError(f"the signals of {axis} differ in their units", argument="x", got=units)
    return axes


def _groups(x: Any) -> dict[str, dict[str, Any]]:
    if isinstance(x, Imu):
        x = x.signals
    if not isinstance(x, Mapping):
        if not isinstance(x, Sequence) or isinstance(x, str) or not all(isinstance(item, Imu | Signal) for item in x):
            raise DataError(argument="x", expected=_EXPECTED, got=x)
        x = {str(k): item for k, item in enumerate(x)}
    if not x:
        raise DataError(argument="x", expected=_EXPECTED, got=x)
    if all(isinstance(item, Imu) for item in x.values()):
        return _of_units(x)
    matches = {name: _MEMBER.fullmatch(name) for name in x}
    if not any(matches.values()):
        return {_common_axis(x): dict(x)}
    groups: dict[str, dict[str, Any]] = {}
    for name, match in matches.items():
        if match is None:
            raise DataError(f"{name} names no unit, but other signals do", argument="x", got=list(x))
        groups.setdefault(match["axis"], {})[name] = x[name]
    return groups


def _of_units(units: Mapping[str, Imu]) -> dict[str, dict[str, Signal]]:
    """Group the signals of the axes that all units have."""
    first, *others = units.values()
    axes = [axis for axis in first.axes if all(axis in other.axes for other in others)]
    if not axes:
        raise DataError(
            "the recordings have no axis in common", argument="x", got={k: v.axes for k, v in units.items()}
        )
    return {axis: {f"{axis}[{name}]": unit[axis] for name, unit in units.items()} for axis in axes}


def _common_axis(x: Mapping[str, Any]) -> str:
    """Return the axis that the signals state, or a default name if they state none."""
    stated: Iterable[str] = {item.axis if isinstance(item, Signal) else "" for item in x.values()}
    names = set(stated) - {""} | (set(x) & set(AXES))
    if len(names) > 1:
        raise DataError(
            f"{', '.join(sorted(names))} do not measure the same motion", argument="x", got=list(x),
            advice="Pass signals of like axes, such as gyro_x[0] and gyro_x[1].",
        )  # fmt: skip
    return next(iter(names), ALONE)


@dataclass(frozen=True, kw_only=True, eq=False)
class VirtualAxis:
    """The weights or the filter of one axis, and the noise of the fused signal.

    Attributes
    ----------
    axis : str
        Name of the axis.
    members : tuple of str
        Names of the d signals.
    unit : str
        Their unit.
    weights : (d,) array
        Weights of the signals; their sum is 1, so that the motion is not changed. With a Kalman filter, these weights
        minimise the white noise.
    filter : DifferenceFilter or None
        The Kalman filter on the differences of the signals; None for static weights.
    model : str
        The joint model of the noise; an empty string if the weights follow from the measured covariance matrices.
    pvalue : float or None
        p-value of the goodness-of-fit test of this model; None without a model.
    levels : (J,) int array
        Levels j of the wavelet variances below.
    rate : float
        Sampling rate (Hz).
    samples : int
        Number of samples of each signal.
    variance : (J,) array
        Predicted wavelet variance of the virtual sensor, in unit², corrected for the estimation of the weights from the
        same recording.
    average : (J,) array
        Wavelet variance of the average of all signals.
    each : (d, J) array
        Wavelet variances of the signals.
    measured : (J,) array
        Wavelet variance of the fused signal in the recording itself.
    optimism : (J,) array
        Factor by which `variance` was multiplied to correct for the estimation of the weights from the same recording.
    without : (d,) array
        Ratio by which the smallest deviation of static weights grows if a signal is left out, at the scales of the
        weights; with a Kalman filter, over all scales. A signal with a ratio near 1 can be left out.
    """

    axis: str
    members: tuple[str, ...]
    unit: str
    weights: Vector
    levels: Integers
    rate: float
    samples: int
    variance: Vector
    average: Vector
    each: Matrix
    measured: Vector
    optimism: Vector
    without: Vector
    filter: DifferenceFilter | None = None
    model: str = ""
    pvalue: float | None = None

    @property
    def tau(self) -> Vector:
        """Scales τ_j = 2^j / rate (J,), in seconds."""
        return np.asarray(np.exp2(self.levels.astype(np.float64)) / self.rate)

    @property
    def seen(self) -> Vector:
        """Number of wavelet coefficients per scale at each level (J,): samples/2^j − 1."""
        return np.asarray(self.samples / np.exp2(self.levels) - 1)

    @property
    def deviation(self) -> Vector:
        """Predicted wavelet deviation of the virtual sensor (J,), in `unit`."""
        return np.sqrt(self.variance)

    @property
    def gain(self) -> Vector:
        """Ratio (J,) of the wavelet deviation of the average of all signals to the deviation of the virtual sensor."""
        return np.asarray(np.sqrt(self.average / self.variance))

    @property
    def gain_over_best(self) -> Vector:
        """Ratio (J,) of the wavelet deviation of the best single signal at each scale to the deviation of the virtual
        sensor."""
        return np.asarray(np.sqrt(self.each.min(axis=0) / self.variance))

    def apply(self, signals: Mapping[str, Signal]) -> Signal:
        """Fuse the signals named in `members`. A Kalman filter restarts after a gap."""
        first = next(iter(signals.values()))
        x = np.array([signals[name].values for name in self.members])
        if self.filter is None:
            values = self.weights @ x
        else:
            values = np.concatenate([self.filter.run(x[:, start:stop]) for start, stop in first.segments])
        return Signal(
            values, first.rate, first.unit, self.axis, segments=first.segments, starts=first.starts,
            gaps_known=first.gaps_known,
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return {
            **plain_fields(self, "axis unit rate"),
            "weights": dict(zip(self.members, self.weights.tolist(), strict=True)),
            **plain_fields(self, "model pvalue filter tau deviation"), "average": np.sqrt(self.average).tolist(),
            **plain_fields(self, "gain gain_over_best"), "measured": np.sqrt(self.measured).tolist(),
            "optimism": self.optimism.tolist(), "without": dict(zip(self.members, self.without.tolist(), strict=True)),
        }  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class VirtualSensor(AxisResults[VirtualAxis], Tabular):
    """A virtual sensor that fuses an array of sensors of the same type.

    A mapping of axis to its weights and noise: `virtual["gyro_x"]`.

    Attributes
    ----------
    axes : mapping of axis to VirtualAxis
        The axes of the virtual sensor.
    horizon : float, (float, float) or None
        Scale (s), or range of scales, at which the weights minimise the wavelet variance; None for a Kalman filter.
    """

    axes: Mapping[str, VirtualAxis]
    horizon: float | tuple[float, float] | None

    def apply(self, x: Sequence[Imu] | Mapping[str, Imu | Signal | ArrayLike] | Imu, rate: float | None = None) -> Imu:
        """Fuse a recording of the same array, at rest or in motion.

        Parameters
        ----------
        x : sequence or mapping
            The recordings or signals of the units, as for `fuse`, with the same names or in the same order.
        rate : float, optional
            Sampling rate (Hz); only for plain arrays.

        Returns
        -------
        Imu
            The fused recording, with one signal for each axis and the gaps of the input.

        Raises
        ------
        DataError
            If the signals do not belong to this array, or are not synchronous.
        """
        groups = like_axes(x, rate)
        fused = {}
        for axis, fusion in self.axes.items():
            if tuple(groups.get(axis, ())) != fusion.members:
                expected = f"the signals of {axis}: {', '.join(fusion.members)}"
                raise DataError(argument="x", expected=expected, got=list(groups.get(axis, ())))
            first = next(iter(groups[axis].values()))
            if first.rate != fusion.rate:
                reason = f"the weights are for {fusion.rate:g} Hz, but the signals have {first.rate:g} Hz"
                raise DataError(reason, argument="x")
            fused[axis] = fusion.apply(groups[axis])
        return Imu(fused)

    @property
    def remarks(self) -> tuple[Remark, ...]:
        """Remarks on weights that amplify errors from scale factor and misalignment, and on models that do not fit."""
        remarks = []
        for axis, fusion in self.axes.items():
            place = int(np.argmin(fusion.weights))
            if fusion.weights[place] < 0:
                factor = float(np.sqrt(fusion.weights @ fusion.weights * fusion.weights.size))
                member, weight = fusion.members[place], float(fusion.weights[place])
                remarks.append(Remark.of("weights-negative", axis, member=member, weight=weight, factor=factor))
            if fusion.pvalue is not None and fusion.pvalue < 0.01:
                ratio = fusion.measured / fusion.variance
                at = int(np.argmax(np.abs(np.log(ratio)) * (fusion.seen > 10.0)))
                size, tau = float(np.sqrt(ratio[at])), Quantity(float(fusion.tau[at]), "s")
                remarks.append(Remark.of("model-rejected", axis, case="array", model=fusion.model, ratio=size, tau=tau))
        return tuple(remarks)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields as plain numbers, lists and strings."""
        return plain_fields(self, "horizon axes remarks")

    def to_polars(self) -> polars.DataFrame:
        """Return the predicted deviations as a Polars data frame with one row for each axis and level."""
        return polars.concat(
            polars.DataFrame({
                "axis": [axis] * fusion.levels.size, "level": fusion.levels, "tau": fusion.tau,
                "deviation": fusion.deviation, "average": np.sqrt(fusion.average), "gain": fusion.gain,
                "gain_over_best": fusion.gain_over_best,
            })
            for axis, fusion in self.axes.items()
        )  # fmt: skip

    def summary(self, dialect: Dialect = Dialect.PYTHON) -> str:
        """Format the weights, the gain at a few scales, and the remarks, in the `dialect` of Python or the shell."""
        lines = []
        for axis, fusion in self.axes.items():
            weights = [["weight", *(name.removeprefix(axis) for name in fusion.members)]]
            weights.append(["", *(f"{weight:.3f}" for weight in fusion.weights)])
            weights.append(["deviation without it", *(f"× {ratio:.2f}" for ratio in fusion.without)])
            places = set(range(0, fusion.tau.size, max(fusion.tau.size // 6, 1)))
            if isinstance(self.horizon, float) and self.horizon < np.inf:
                places.add(int(np.argmin(np.abs(np.log(fusion.tau / self.horizon)))))
            shown = sorted(places)
            gains = [["at τ", *(duration_text(fusion.tau[k]) for k in shown)]]
            gains.append(["gain over the average", *(f"{fusion.gain[k]:.2f}" for k in shown)])
            gains.append(["gain over the best one", *(f"{fusion.gain_over_best[k]:.2f}" for k in shown)])
            lines += [f"{axis}: virtual sensor of {len(fusion.members)}, {self._method}"]
            lines += [f"Model {fusion.model}, p {p_relation(fusion.pvalue)}"] if fusion.pvalue is not None else []
            lines += ["", *table_with_rule(weights), "", *table_with_rule(gains), ""]
        return "\n".join([*lines, *texts(self.remarks, dialect)]).rstrip()

    @property
    def _method(self) -> str:
        if self.horizon is None:
            return "Kalman filter"
        if isinstance(self.horizon, tuple):
            return f"for scales of {' to '.join(map(duration_text, self.horizon))}"
        return "for the slowest noise" if self.horizon == np.inf else f"for a scale of {duration_text(self.horizon)}"

    def __repr__(self) -> str:
        count = len(next(iter(self.axes.values())).members)
        return f"VirtualSensor({', '.join(self.axes)}: {count} units, {self._method})"


register(VirtualSensor, "gmwm.applications.several.plots:plot_fusion")
