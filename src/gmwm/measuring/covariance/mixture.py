"""Smooth curve through a wavelet variance, from the mixture of all processes with the largest likelihood.

The estimate of a level with one degree of freedom can be a thousand times too small, and its weight 1/ν̂⁴ would
dominate a fit. The variances of all processes at many correlation times maximise the chi-square likelihood of the
levels. The curve does not depend on a model, so all models are compared with the same weights."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from gmwm.base import _core
from gmwm.base.arrays import Matrix, Vector, freeze
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.theory.filters import WaveletFilter
from gmwm.theory.processes.base import Process, registry
from gmwm.theory.processes.model import Model

CURVE_FREEDOM = 30.0
"""Degrees of freedom of the smooth curve in the average with a level (tests/estimation/test_weights.py)."""


@lru_cache(maxsize=12)
def smoothed(wv: WaveletVariance) -> Vector:
    """Compute (η ν̂² + 30 ν̃²)/(η + 30) (J,), smooth curve ν̃², η degrees of freedom; ν̂² if a level is zero."""
    if not np.all(wv.variance > 0):
        return wv.variance
    unit = 2.0 ** np.floor(np.log2(wv.variance.max()))
    observed, freedom = wv.variance / unit, wv.degrees_of_freedom
    design = Design.of(wv)
    _, shapes = _candidates(tuple(wv.levels.tolist()), design.longest, wv.rate, design.filter)
    curve, _ = _likeliest(observed, freedom, shapes)
    return freeze(drawn(unit * observed, freedom, unit * curve))


def drawn(observed: Vector, freedom: Vector, curve: Vector) -> Vector:
    """Average each observed variance with the curve, which has the weight of `CURVE_FREEDOM` degrees of freedom."""
    return np.asarray((freedom * observed + CURVE_FREEDOM * curve) / (freedom + CURVE_FREEDOM))


def mixture(
    variance: Vector, freedom: Vector, design: Design, *, within: float = np.inf, random: bool = False
) -> tuple[Vector, Model]:
    """Compute the smooth curve (J,) through positive variances, and its mixture of processes as a model. `within`
    excludes drift and correlation times above it (s), but not walks and flicker noise. `random` excludes drift and
    sinusoids, whose wavelet variance is not random: V of the coarsest levels would be too small."""
    levels = tuple(design.levels.tolist())
    processes, shapes = _candidates(levels, design.longest, design.rate, design.filter)
    known = _known(levels, design.longest, rate=design.rate, filter=design.filter, within=within)
    if random:
        known = tuple(k for k in known if _is_random(processes[k]))
    curve, weights = _likeliest(variance, freedom, shapes[list(known)])
    chosen = [(processes[k], float(weight)) for k, weight in zip(known, weights, strict=True) if weight > 0]
    parts = [p.with_scale(weight) for p, weight in chosen]
    return curve, Model(tuple(parts))


@lru_cache(maxsize=64)
def _known(
    levels: tuple[int, ...], samples: int, *, rate: float, filter: WaveletFilter, within: float
) -> tuple[int, ...]:
    """Return the indices of the candidates whose covariance is known, with correlation times up to `within` (s)."""
    processes, _ = _candidates(levels, samples, rate, filter)
    return tuple(
        k for k, process in enumerate(processes)
        if process.has("generalised_covariance") and (within == np.inf or _short(process, rate, within))
    )  # fmt: skip


def _is_random(process: Process) -> bool:
    """Return whether a process is neither a drift nor a sinusoid, and sums of mixtures with it are mixtures."""
    closed = process.repeatable or not process.nonlinear_parameters()
    return closed and process.line(1.0) is None and not np.any(process.mean(np.arange(2)))


def _short(process: Process, rate: float, within: float) -> bool:
    """Return whether a process has mean zero, and a correlation time up to `within` (s), infinite or unknown."""
    time = process.correlation_time(rate)
    return not np.any(process.mean(np.arange(2))) and (time is None or time <= within or time == np.inf)


def _likeliest(observed: Vector, freedom: Vector, shapes: Matrix) -> tuple[Vector, Vector]:
    """Return the curve (J,) with the largest likelihood, and the weights (n,) of the `shapes` (n, J) in it."""
    # No wavelet variance falls much faster than that of quantization noise, which falls by a factor of four per level.
    # Tiny values would overflow; a power of two causes no rounding error.
    exponent = int(np.frexp(np.max(observed))[1])
    observed = np.ldexp(observed, -exponent)
    curve = observed.copy()
    for k in range(1, curve.size):
        curve[k] = max(curve[k], curve[k - 1] / 4)
    weights = np.zeros(len(shapes))
    for _ in range(30):
        # Fisher scoring of the gamma likelihood: least squares with weights from the last curve.
        root = np.sqrt(freedom / 2) / curve
        rows = shapes * root
        length = np.linalg.norm(rows, axis=1, keepdims=True)
        found, _ = _core.nonnegative_least_squares(root * observed, np.ascontiguousarray(rows / length))
        weights = found / length[:, 0]
        before, curve = curve, weights @ shapes
        # The curve is for weights, which need two digits; tests/estimation/test_weights.py pins fits that use it.
        if np.all(np.abs(curve - before) <= 1e-3 * before):
            break
    return np.ldexp(curve, exponent), np.ldexp(weights, exponent)


@lru_cache(maxsize=16)
def _candidates(
    levels: tuple[int, ...], samples: int, rate: float, filter: WaveletFilter
) -> tuple[tuple[Process, ...], Matrix]:
    """Return all processes with scale coefficient 1, at many correlation times, and their wavelet variances (n, J)."""
    number = np.asarray(levels, dtype=np.int64)
    kinds: dict[str, type[Process]] = {}
    for kind in registry.values():
        kinds.setdefault(kind.parametrises or kind.name, kind)
    processes: list[Process] = []
    rows = []
    for kind in kinds.values():
        if not kind.nonlinear_parameters():
            processes.append(kind.standard())
            rows.append(kind.moments(np.empty((1, 0)), number, rate, filter))
        for branch in kind.search(samples, rate):
            places = branch.values(np.linspace(branch.low, branch.high, 48))
            processes += map(kind.standard, places)
            rows.append(kind.moments(places, number, rate, filter))
    shapes = np.concatenate(rows)
    seen = np.any(shapes > 0, axis=1)
    return tuple(p for p, here in zip(processes, seen, strict=True) if here), np.asarray(shapes[seen])
