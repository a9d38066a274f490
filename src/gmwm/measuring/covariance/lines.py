"""Contribution of sinusoids with fixed amplitude and random phase to the covariance of a wavelet variance.

The signal is X = Y + Σ_l A_l cos(ω_l t + U_l), with Gaussian noise Y and independent uniform phases U_l. Its wavelet
coefficients are W_j = G_j + L_j (noise and sinusoids). L_j² is nearly constant, so the product of L_j and G_j matters:

    V_jk = V_jk of Y + 4/(M_j M_k) Σ_u n(u) R_jk(u) C_jk(u) + Cov(mean L_j², mean L_k²).

Here C_jk(u) = Cov(G_{j,t}, G_{k,t+u}) and R_jk(u) = Σ_l P_l Re[H_j* H_k e^(iω_l u)], with the power P_l = A_l²/2 and
the gain H_j of the wavelet filter at ω_l. If lags are few or can be far apart (slow sinusoid), the second term is a
closed form (Haar filter) or summed. Otherwise it is 4 Σ_l P_l |H_j|² |H_k|² S(ω_l) / max(M_j, M_k), with the spectral
density S of Y; its relative error is about 2^k / M_k.

The last term is a sum of ½ Re(c_j c_k*). With the mean D_j(Ω) of e^(iΩt) over the coefficients of level j, each
sinusoid contributes c_j = ½A² H_j² D_j(2ω), each pair c_j = A_l A_m H_j(ω_l) H_j(±ω_m) D_j(ω_l ± ω_m), and each
sinusoid with a mean μ_j of the coefficients (drift) c_j = 2μ_j A H_j D_j(ω)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.base.errors import MissingTheoryError
from gmwm.measuring.covariance import filtered, gaussian
from gmwm.measuring.covariance.design import Design
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.exponential_sum import ExponentialSum
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.oscillator import OSC, SHARPEST

ALL_LAGS = 2**14
"""Largest number of summed lags; beyond, they are farther apart (tests/covariance/test_lines.py, also the next)."""


@dataclass(frozen=True, eq=False)
class TermLine:
    """Sinusoid, with the gains of the wavelet filters of a design at its frequency."""

    power: float  # power P = A²/2 (u²) of a sinusoid of amplitude A
    cycles: float  # frequency (cycles per sample), within ±½
    gain: NDArray[np.complex128]  # (J,) gains H_j of the wavelet filters of all levels

    @property
    def amplitude(self) -> float:
        """Amplitude A (u)."""
        return math.sqrt(2.0 * self.power)


def apart(model: Model, design: Design) -> tuple[Model | None, tuple[TermLine, ...]]:
    """Separate the noise of a model (None without noise) from its sinusoids, which no robust estimate may have."""
    seen = [process.line(design.rate) for process in model.processes]
    if not any(seen):
        return model, ()
    felt = [(process, at) for process, at in zip(model.processes, seen, strict=True) if at and all(at)]
    if felt and design.efficiency is not None:
        raise MissingTheoryError(
            f"the covariance of the robust wavelet variance is unknown for {felt[0][0].name}, because a sinusoid of "
            "fixed amplitude is not Gaussian",
            advice="Use the classical wavelet variance with {--robust=no}.",
        )
    rest = tuple(process for process, at in zip(model.processes, seen, strict=True) if at is None)
    # The gains H_j = Σ_l h_{j,l} e^(−iωl) of the wavelet filters h_j at the frequency ω = 2π `cycles`.
    gains = [_all_gains(at[1], design.filter, int(design.levels[-1]))[design.levels - 1] for _, at in felt]
    waves = tuple(TermLine(*at, gain) for (_, at), gain in zip(felt, gains, strict=True))
    return (Model(rest) if rest else None), waves


def excess(noise: Model | None, lines: tuple[TermLine, ...], design: Design, *, diagonal: bool) -> Matrix:
    """Compute the contribution of sinusoids to V (J, J), or to its diagonal (J,), in u⁴."""
    total = _of_phases(noise, lines, design)
    slow = [line for line in lines if np.any(_stages(line, design) >= 0)]
    if noise is not None and (closed := _closed_form(noise, slow, design, diagonal=diagonal)) is not None:
        lines = tuple(line for line in lines if line not in slow)
        total += np.diag(closed) if diagonal else closed
    if noise is not None:
        many = [line for line in lines if np.any(_stages(line, design) < 0)]
        density = dict(zip(many, _density(noise, [line.cycles for line in many], design).tolist(), strict=True))
        for part in _with_noise(noise, {line: density.get(line, 0.0) for line in lines}, design, diagonal=diagonal):
            total += part
    return np.asarray(np.diag(total).copy() if diagonal else total)


@lru_cache(maxsize=256)
def _all_gains(cycles: float, filter: WaveletFilter, count: int) -> NDArray[np.complex128]:
    smooth, wavelet = filter.scaling / np.sqrt(2.0), filter.wavelet / np.sqrt(2.0)
    gain, gains = 1.0 + 0.0j, np.empty(count, dtype=np.complex128)
    for j in range(count):
        z = np.exp(-2j * np.pi * np.fmod(np.ldexp(cycles, j), 1.0))
        gains[j] = gain * np.polyval(wavelet[::-1], z)
        gain *= complex(np.polyval(smooth[::-1], z))
    return gains


def _of_phases(noise: Model | None, lines: tuple[TermLine, ...], design: Design) -> Matrix:
    """Compute ½ Re Σ c_j c_k* (J, J), the covariance that the random phases cause; see the module docstring."""
    mean = np.zeros(design.levels.size) if noise is None else filtered.means(noise, design)
    turning = []
    for k, line in enumerate(lines):
        turning.append(line.power * line.gain**2 * _mean_turn(2.0 * line.cycles, design))
        turning.append(2.0 * mean * math.sqrt(2.0 * line.power) * line.gain * _mean_turn(line.cycles, design))
        for other in lines[:k]:
            size = 2.0 * math.sqrt(line.power * other.power)
            both = (line.gain * other.gain, line.cycles + other.cycles)
            beat = (line.gain * np.conj(other.gain), line.cycles - other.cycles)
            turning += [size * gain * _mean_turn(cycles, design) for gain, cycles in (both, beat)]
    c = np.array(turning).reshape(-1, design.levels.size)
    return np.asarray(0.5 * np.real(c.T @ np.conj(c)))


def _mean_turn(cycles: float, design: Design) -> NDArray[np.complex128]:
    """Compute the mean (J,) of e^(2πi t cycles) over the times t of the coefficients of each level."""
    levels, counts = (tuple(values.tolist()) for values in (design.levels, design.counts))
    return _mean_turns(cycles, levels, counts, samples=design.samples, decimated=design.transform == "dwt")


@lru_cache(maxsize=1024)
def _mean_turns(
    cycles: float, levels: tuple[int, ...], counts: tuple[int, ...], samples: int, decimated: bool
) -> NDArray[np.complex128]:
    count = np.array(counts, dtype=np.float64)
    if decimated:
        step = np.ldexp(1.0, np.array(levels))
        last = step * (samples >> np.array(levels)) - 1.0
    else:
        step, last = np.ones_like(count), np.full_like(count, samples - 1.0)
    # `half` and `whole` are half the angles of one step and of all steps. `still` marks steps of whole cycles.
    half, whole = (np.pi * np.fmod(step * cycles * times, 2.0) for times in (1.0, count))
    still = np.abs(np.sin(half)) < 1e-12
    size = np.where(still, np.cos(whole) / np.cos(half), np.sin(whole) / (count * np.where(still, 1.0, np.sin(half))))
    middle = last - 0.5 * step * (count - 1.0)
    return np.asarray(size * np.exp(2j * np.pi * np.fmod(middle * cycles, 1.0)))


class _Wave(OSC, register=False):
    """A Gaussian process with the covariance of a sinusoid: an oscillator without damping."""

    def exponential_sum(self, rate: float) -> ExponentialSum:
        return ExponentialSum.of_exponential(self.scale, 2j * math.pi * self.value("frequency") / rate)


def _closed_form(noise: Model, lines: Sequence[TermLine], design: Design, *, diagonal: bool) -> Matrix | None:
    """Compute 4/(M_j M_k) Σ_u n(u) R_jk(u) C_jk(u) (J, J), or its diagonal (J,), in closed form; None if there is none.
    It is what a Gaussian process with the covariance R adds to the sum of the covariances of both."""
    random = [process for process in noise.processes if process.mean(1.0) == process.mean(0.0)]
    if not lines or not random:
        return None
    curve = Model(tuple(random)).wavelet_variance(design.levels, design.rate, design.filter)
    power = np.sum([line.power * np.abs(line.gain) ** 2 for line in lines], axis=0)
    # Waves that are nowhere stronger than the noise, so that rounding of their own covariance does not matter.
    scale = float(np.min(curve / np.where(power > 0, power, np.inf), initial=1.0, where=power > 0))
    waves = [_Wave(abs(line.cycles) * design.rate, SHARPEST / 2, scale * line.power) for line in lines]
    parts = [Model((*random, *waves)), Model(tuple(random)), Model(tuple(waves))]
    if not all(gaussian.has_closed_form(part, design) for part in parts):
        return None
    both, *alone = (
        gaussian.variances(part, design) if diagonal else gaussian.covariance(part, design) for part in parts
    )
    return np.asarray((both - sum(alone)) / scale)


def _with_noise(noise: Model, lines: Mapping[TermLine, float], design: Design, *, diagonal: bool) -> list[Matrix]:
    """Compute 4/(M_j M_k) Σ_u n(u) R_jk(u) C_jk(u) (J, J), or its limit with the spectral density of the noise."""
    size, counts = design.levels.size, design.counts.astype(np.float64)
    stages = [_stages(line, design) for line in lines]
    parts = [np.zeros((size, size)) for _ in lines]
    for part, (line, density), steps in zip(parts, lines.items(), stages, strict=True):
        if np.any(steps < 0):
            square = np.abs(line.gain) ** 2
            part += 4.0 * line.power * density * np.outer(square, square) / np.maximum.outer(counts, counts)
    summed = [(part, line, steps) for part, line, steps in zip(parts, lines, stages, strict=True) if np.any(steps >= 0)]
    if not summed:
        return parts
    # The covariances of the noise are the same for all lines, and so is the spacing of lags of a level.
    lags = filtered.Lags(noise, design)
    for a in range(size):
        here = [(part, line) for part, line, steps in summed if steps[a] >= 0]
        if not here:
            continue
        stage = max(int(steps[a]) for _, _, steps in summed)
        turns = [_turns(line.cycles, stage, design.samples) for _, line in here]
        for b, first, values in lags.covariances(a, stage, a + 1 if diagonal else size):
            begin = first + (design.samples >> stage) + 1
            for (part, line), turn in zip(here, turns, strict=True):
                turn = turn[begin : begin + values.size]
                shared = line.power * np.real(np.conj(line.gain[a]) * line.gain[b] * turn)
                part[a, b] = part[b, a] = (
                    4.0
                    * filtered.weighed(values * shared, first, stage=stage, design=design, a=a, b=b)
                    / (counts[a] * counts[b])
                )
    return parts


@lru_cache(maxsize=32)
def _turns(cycles: float, stage: int, samples: int) -> NDArray[np.complex128]:
    """Return e^(iωu) at all lags u that are 2^stage apart, from −N on."""
    reach = (samples >> stage) + 1
    return freeze(np.exp(2j * np.pi * np.fmod(math.ldexp(cycles, stage) * np.arange(-reach, reach + 1), 1.0)))


def _stages(line: TermLine, design: Design) -> NDArray[np.int64]:
    """Return the exponent (J,) of the spacing 2^stage of lags by level; −1 for the spectral density instead."""
    if design.transform == "dwt":
        return design.levels - 1
    stage = max(-(-design.samples // ALL_LAGS) - 1, 0).bit_length()
    # Smallest number of lags per period of the sinusoid for which lags may be further apart.
    if stage and abs(line.cycles) * (32 << stage) > 1:
        return np.full(design.levels.size, -1)
    enough = design.levels >= stage + filtered.OVERSAMPLED if stage else np.ones(design.levels.size, dtype=np.bool_)
    return np.where(enough, stage, -1)


def _density(noise: Model, cycles: list[float], design: Design) -> Vector:
    """Compute the spectral density S (u² per cycle per sample) of the noise at frequencies that are not 0."""
    total = np.zeros(len(cycles))
    for process in noise.processes:
        if process.scale == 0:
            continue
        if process.has("psd"):
            total += design.rate * process.psd(np.abs(cycles) * design.rate, design.rate)
            continue
        if not np.any(process.generalised_covariance(np.arange(3), design.rate)):
            continue  # a drift, which has no random error
        shape = (type(process), tuple(process.nonlinear.tolist()))
        samples = min(design.samples, 2 + (process.memory(design.rate) or design.samples))
        total += process.scale * np.array([
            _summed_density(*shape, at, samples=samples, rate=design.rate) for at in cycles
        ])  # fmt: skip
    return total


@lru_cache(maxsize=256)
def _summed_density(
    kind: type[Process], nonlinear: tuple[float, ...], cycles: float, *, samples: int, rate: float
) -> float:
    """Compute the spectral density for scale coefficient 1 at ω = 2π `cycles`, Σ_m c(m) cos ωm / |1 − e^(iω)|², with
    the covariance c(m) = 2A(m) − A(m − 1) − A(m + 1) of differences and the generalised covariance A."""
    difference = _differences(kind, nonlinear, samples, rate)
    terms = difference * np.cos(2.0 * np.pi * np.fmod(cycles * np.arange(difference.size), 1.0))
    return float(2.0 * terms.sum() - terms[0]) / (4.0 * math.sin(math.pi * cycles) ** 2)


@lru_cache(maxsize=2)
def _differences(kind: type[Process], nonlinear: tuple[float, ...], samples: int, rate: float) -> Vector:
    """Compute the covariance c(m) of differences for scale coefficient 1 at the lags 0, 1, …, N − 1."""
    known = kind.standard(nonlinear).generalised_covariance(np.arange(-1, samples + 1), rate)
    return np.asarray((known[1:-1] - known[:-2]) - (known[2:] - known[1:-1]))
