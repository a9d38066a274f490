"""Fuse an array of sensors into one virtual sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import product
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from gmwm.applications.several.conic import least_squares
from gmwm.applications.several.fitting import JointSolution, errors, measured_at, misfit, settle
from gmwm.applications.several.fusion_result import (
    ArrayNoise,
    DifferenceFilter,
    VirtualAxis,
    VirtualSensor,
    like_axes,
    wavelet_variance,
)
from gmwm.applications.several.matrices import WaveletMatrices, entries, moment_covariance, stack, wavelet_matrices
from gmwm.applications.several.search import joint_terms
from gmwm.base import _core
from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.errors import DataError, ModelError, OptionError
from gmwm.base.text import duration_text
from gmwm.measuring.covariance.api import covariance
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.variance.api import wavelet_variance as measure_variance
from gmwm.recording.gaps import fill_gaps
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import ModelLike

LEAST_FOR_WEIGHTS = 3.0
"""Least coefficients per scale of a level. Coarse levels improve the weights (docs/validation/fusion.md)."""

Design = Callable[[ArrayNoise], DifferenceFilter]
"""Function that designs a filter, or static weights, for the noise of an array."""


def fit_array(signals: Mapping[str, Signal], model: ModelLike | None) -> JointSolution:
    """Return the joint fit of a model; without one, of WN + RW + k·GM with the smallest k that fits. If none does, QN
    is added; if none fits then, the fit is the best one."""
    if model is not None:
        terms = joint_terms(model)
        return settle(terms, measured_at(signals, None, len(terms), least=LEAST_FOR_WEIGHTS))
    measured = measured_at(signals, None, 2, least=LEAST_FOR_WEIGHTS)
    best: tuple[float, JointSolution] | None = None
    for rounding, count in product(("", " + QN"), range(3)):
        terms = joint_terms("shared(WN) + shared(RW)" + (f" + {count}*shared(GM)" if count else "") + rounding)
        if measured.design.levels.size <= len(terms) + count:
            continue
        try:
            solution = settle(terms, measured)
        except ModelError:  # no noise in some combination of the signals, as far as the weights can tell
            continue
        tested = misfit(solution)
        if tested.pvalue >= 0.01:
            return solution
        # Like Akaike's criterion, the score adds 2 for each parameter (the degrees of freedom decrease by 1).
        score = tested.statistic - 2 * (tested.df or 0)
        if best is None or score < best[0]:
            best = score, solution
    if best is None:
        raise DataError(
            "the units have nearly the same signal: what they share, such as motion, hides the noise of each",
            argument="x", advice="Compute the weights from a recording at rest, and fuse this one with {--apply}.",
        )  # fmt: skip
    return best[1]


def noise_of(settled: JointSolution, sigmas: Matrix | None = None) -> ArrayNoise:
    """Return the noise of an array with one scale factor for all signals (see `unit_of`); equal shapes are added."""
    problem = settled.problem
    shapes = problem.processes(settled.estimate.u)
    scale = float(np.exp(np.mean(np.log(settled.unit))))
    relative = settled.unit / scale
    matrices = settled.estimate.sigmas if sigmas is None else sigmas
    terms: dict[tuple[Any, ...], tuple[Process, Matrix]] = {}
    for process, sigma in zip(shapes, matrices / np.outer(relative, relative), strict=True):
        key = (type(process), *process.nonlinear.tolist())
        terms[key] = (process, sigma + terms[key][1] if key in terms else sigma)
    processes, merged = zip(*terms.values(), strict=True)
    return ArrayNoise(processes, np.array(merged), problem.design.rate)


def shrunk(settled: JointSolution, sigmas: Matrix, scatter: Vector) -> Matrix:
    """Return covariance matrices, shared and common ones shrunk to a multiple of the identity, for stable inverses, by
    variance over squared distance ≤ 1 (Ledoit and Wolf 2004, Journal of Multivariate Analysis 88, 365-411)."""
    out = sigmas.copy()
    for place, term in enumerate(settled.problem.terms):
        if term.kind != "own":
            target = np.trace(sigmas[place]) / sigmas.shape[-1] * np.eye(sigmas.shape[-1])
            distance = float(np.sum((sigmas[place] - target) ** 2))
            share = min(1.0, scatter[place] / distance) if distance > 0 else 1.0
            out[place] = (1 - share) * sigmas[place] + share * target
    return out


def scatters(settled: JointSolution) -> Vector:
    """Return the total estimation variance (P,) of the entries of each matrix, unconstrained except if common."""
    inside, tangent = errors(settled, inside=True), errors(settled)
    choices = [tangent if term.kind == "common" else inside for term in settled.problem.terms]
    rows, columns = entries(settled.problem.d)
    times = np.where(rows == columns, 1.0, 2.0)
    return np.array([float(times @ np.diag(errors_of.of_matrix(k))) for k, errors_of in enumerate(choices)])


def unit_of(settled: JointSolution) -> float:
    """Return the factor that converts variances of the model from `noise_of` to the units of the signals."""
    return float(np.exp(-2 * np.mean(np.log(settled.unit))))


def optimism(settled: JointSolution, design: Design, levels: Integers) -> Vector:
    """Return the factor (J,) ≥ 1 of the variance in other recordings over the predicted one, by a parametric bootstrap.
    Filters are designed for matrices estimated from moments drawn under the fitted model."""
    problem, scatter = settled.problem, scatters(settled)
    centre = shrunk(settled, settled.estimate.sigmas, scatter)
    truth = noise_of(settled, centre)
    fitted = stack(np.einsum("pj,pab->jab", problem.shapes(settled.estimate.u), centre))
    wavelet = problem.design.loss_factor * moment_covariance(centre, settled.products)
    size = np.sqrt(np.diag(wavelet))
    root = np.linalg.cholesky(wavelet / np.outer(size, size) + 1e-13 * np.eye(size.size)) * size[:, None]
    columns = problem.columns(problem.shapes(settled.estimate.u))
    rng = np.random.default_rng(0)
    achieved, predicted = np.zeros(levels.size), np.zeros(levels.size)
    for _ in range(40):  # the relative error of the factor is then about 1 % (docs/validation/fusion.md)
        drawn = problem.root @ (fitted + root @ rng.standard_normal(size.size))
        sigmas = least_squares(columns, drawn, problem.cone, gap=1e-6).sigmas
        filter = design(noise_of(settled, shrunk(settled, sigmas, scatter)))
        achieved += wavelet_variance(truth, filter, levels)
        predicted += wavelet_variance(noise_of(settled, sigmas), filter, levels)
    return np.asarray(np.maximum(achieved / predicted, 1.0))


Horizon: TypeAlias = float | tuple[float, float]  # scale (s), or lowest and highest scale of a range
SPARE_FREEDOM = 2.0
"""Degrees of freedom that d weights need beyond d. With d + 1, the expected variance elsewhere is infinite."""


def fuse(
    x: Sequence[Imu] | Mapping[str, Imu | Signal | ArrayLike] | Imu, rate: float | None = None, *,
    horizon: Horizon | None = None, model: ModelLike | None = None, nonnegative: bool = False,
) -> VirtualSensor:  # fmt: skip
    """Fuse an array of sensors of the same type into one virtual sensor with less noise.

    The signals of each axis are averaged with weights whose sum is 1, so that the motion is not changed. By default, a
    Kalman filter also estimates the slow noise from the differences between the signals, which do not depend on the
    motion, and subtracts it. At every scale, the wavelet variance of the result is within a few per cent of the
    smallest variance that static weights reach at this scale. The filter needs a joint model of the noise, see
    `fit_joint`.

    With `horizon`, the virtual sensor is the weighted sum with the smallest wavelet variance at this scale,

        w = Γ̂⁻¹ 1 / (1ᵀ Γ̂⁻¹ 1).

    Γ̂ is the covariance matrix of the Haar wavelet coefficients of all signals at this scale, interpolated between the
    two nearest levels. Unlike weights by inverse variances, these weights take into account noise that the sensors
    share.

    With a range of scales, `horizon=(1.0, 600.0)`, Γ̂ is the sum of the matrices at the levels in the range, each
    divided by the wavelet variance of the average of all signals at its level. The weights therefore minimise the mean
    of the squared inverse gain over the average. `horizon=inf` with a `model` minimises the random walk of the fused
    signal (Vaccaro and Zaki 2017).

    Weights that are estimated from a recording fit the noise of this recording, so the weighted sum has less noise in
    it than in other recordings. The attribute `variance` is corrected for this. If Γ̂ has η degrees of freedom, the
    expected variance wᵀ Γ̂ w at the scale of the weights is (η − d + 1)/η · (η − d)/(η − 1) times the variance in other
    recordings. At another scale, the correction is reduced according to the regression of its wavelet variance on the
    one at the scale of the weights. With a model, the correction follows from a parametric bootstrap.

    Parameters
    ----------
    x : sequence of Imu, or mapping
        A recording at rest of each of d units, sampled together; gmwm fuses the axes with the same name. Alternatively,
        a mapping of names such as "gyro_x[2]" to signals or (N,) arrays. If the names have no brackets, all signals
        belong to one axis. Arrays of the axes of an IMU are in rad/s and m/s².
    rate : float
        Sampling rate (Hz); only for plain arrays.
    horizon : float, or (float, float), optional
        Scale (s), or lowest and highest scale of a range, at which static weights minimise the wavelet variance; inf
        for the slowest noise of a `model`. By default, a Kalman filter is used.
    model : str, optional
        Joint model of the noise, such as "WN + shared(RW)". By default, a Kalman filter uses the model WN + RW + k·GM
        with all terms shared and the smallest k for which it fits, or with QN if none fits. Static weights use the
        measured covariance matrices by default; a model makes the weights for long horizons more accurate.
    nonnegative : bool
        Whether to restrict the weights to values of at least 0; only with `horizon`. Negative weights remove noise that
        the sensors share, but increase the errors from scale factor and misalignment.

    Raises
    ------
    DataError
        If the signals are not synchronous, or differ in their units.
    OptionError
        If the recording is too short for weights at this scale.

    References
    ----------
    Bates and Granger (1969), The combination of forecasts, Operational Research Quarterly 20, 451-468; Vaccaro and Zaki
    (2017), Reduced-drift virtual gyro from an array of low-cost gyros, Sensors 17, 352. The accuracy of the predicted
    variance is in docs/validation/fusion.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> supply = rng.normal(size=20_000)
    >>> units = {f"gyro_x[{k}]": rng.normal(size=20_000) + share * supply for k, share in enumerate((0.2, 1.0, 2.0))}
    >>> virtual = fuse(units, rate=100.0, horizon=1.0)
    >>> virtual["gyro_x"].weights.round(2), f"{virtual['gyro_x'].gain[0]:.2f}"
    (array([ 0.68,  0.37, -0.05]), '1.39')
    """
    if horizon is not None:
        horizon = _checked(horizon, model)
    elif nonnegative:
        raise OptionError(argument="nonnegative", expected="given with {--horizon}", got=nonnegative)
    virtual = {}
    for axis, signals in like_axes(x, rate).items():
        filled = fill_gaps(signals)
        if horizon is not None and model is None:
            virtual[axis] = _static(axis, filled, horizon, nonnegative=nonnegative)
        else:
            virtual[axis] = _from_model(axis, filled, horizon, model=model, nonnegative=nonnegative)
    return VirtualSensor(axes=virtual, horizon=horizon)


def _checked(horizon: Horizon, model: ModelLike | None) -> Horizon:
    """Return the scale or the range of scales of the weights as numbers."""
    ends = horizon if isinstance(horizon, tuple) else (horizon,)
    numbers = all(isinstance(end, int | float) and not isinstance(end, bool) and end > 0 for end in ends)
    ordered = numbers and (not isinstance(horizon, tuple) or (len(ends) == 2 and ends[0] < ends[1] < np.inf))
    if not ordered or (ends[0] == np.inf and model is None):
        expected = "a positive time (s), a range such as (1.0, 600.0), or inf with a model"
        raise OptionError(argument="horizon", expected=expected, got=horizon)
    return (float(ends[0]), float(ends[1])) if len(ends) == 2 else float(ends[0])


def _from_model(
    axis: str, signals: Mapping[str, Signal], horizon: Horizon | None, *, model: ModelLike | None, nonnegative: bool
) -> VirtualAxis:
    """Return the Kalman filter, or the static weights, of one axis from a joint model."""
    settled = fit_array(signals, model)
    measured = settled.measured
    levels, d = measured.design.levels, len(measured.names)
    noise, scale = noise_of(settled), unit_of(settled)
    # At level 40, the slowest process is all of the noise.
    places, shares = levels, np.ones(levels.size) / noise.static(np.full(d, 1 / d), levels)
    if horizon == np.inf:
        places, shares = np.array([40]), np.ones(1)
    elif horizon is not None:
        shares = _shares(measured, horizon)

    def target(noise: ArrayNoise) -> Matrix:
        shapes = np.array([process.wavelet_variance(places, noise.rate) for process in noise.processes])
        return np.asarray(np.einsum("pj,j,pab->ab", shapes, shares, noise.sigmas))

    def design(noise: ArrayNoise) -> DifferenceFilter:
        if horizon is None:
            return noise.filter()
        return DifferenceFilter.static(best_weights(target(noise), nonnegative=nonnegative))

    best = noise_of(settled, shrunk(settled, settled.estimate.sigmas, scatters(settled)))
    filter = design(best)
    factor = optimism(settled, design, levels)
    first = next(iter(signals.values()))
    fused = VirtualAxis(
        axis=axis, members=measured.names, unit=first.unit, weights=filter.weights, levels=levels, rate=first.rate,
        samples=len(first), variance=scale * factor * wavelet_variance(noise, filter, levels),
        average=scale * noise.static(np.full(d, 1 / d), levels),
        each=scale * np.array([noise.static(row, levels) for row in np.eye(d)]), measured=np.zeros(levels.size),
        optimism=factor, filter=filter if filter.C.size else None,
        without=losses(target(best), nonnegative=nonnegative),
        model=" + ".join(map(str, settled.problem.terms)), pvalue=misfit(settled).pvalue,
    )  # fmt: skip
    own_variance = measure_variance(fused.apply(signals), levels=int(levels[-1])).variance
    return replace(fused, measured=own_variance[levels - 1])


def _static(axis: str, signals: Mapping[str, Signal], horizon: Horizon, *, nonnegative: bool) -> VirtualAxis:
    """Return the static weights of one axis for the scale or range `horizon`, from the measured covariance matrices."""
    measured = wavelet_matrices(signals)
    gamma, d = measured.values, len(measured.names)
    shares = _shares(measured, horizon)
    target = np.einsum("j,jab->ab", shares, gamma)
    weights = best_weights(target, nonnegative=nonnegative)
    variance = np.einsum("a,jab,b->j", weights, gamma, weights)
    optimism = _optimism(measured, variance, shares, d=int(np.count_nonzero(weights)))
    return VirtualAxis(
        axis=axis, members=measured.names, unit=next(iter(signals.values())).unit, weights=weights,
        levels=measured.design.levels, rate=measured.design.rate, samples=measured.design.samples,
        variance=variance * optimism, average=gamma.sum(axis=(1, 2)) / d**2, each=np.einsum("jaa->aj", gamma),
        measured=variance, optimism=optimism, without=losses(target, nonnegative=nonnegative),
    )  # fmt: skip


def _shares(measured: WaveletMatrices, horizon: Horizon) -> Vector:
    """Return the weights (J,) of matrices: two levels around a scale, or a range over variances of the average."""
    count = measured.design.levels.size
    for end in horizon if isinstance(horizon, tuple) else (horizon,):
        at = np.log2(end * measured.design.rate) - measured.design.levels[0]
        if not -1e-9 <= at <= count - 1 + 1e-9:
            low, high = (duration_text(measured.tau[k]) for k in (0, -1))
            raise OptionError(
                f"the scale {end:g} s is outside the scales of the recording, {low} to {high}",
                argument="horizon", got=horizon, advice="Pass {--horizon} with a scale inside.",
            )  # fmt: skip
    if isinstance(horizon, tuple):
        inside = (measured.tau >= horizon[0] * (1 - 1e-9)) & (measured.tau <= horizon[1] * (1 + 1e-9))
        if not np.any(inside):
            raise OptionError(argument="horizon", expected="a range with a scale 2^j / rate", got=horizon)
        return np.where(inside, 1 / measured.values.mean(axis=(1, 2)), 0.0)
    shares = np.zeros(count)
    k = min(int(at), count - 2) if count > 1 else 0
    shares[k] = 1 - (at - k)
    if count > 1:
        shares[k + 1] = at - k
    return shares


def losses(gamma: Matrix, *, nonnegative: bool = False) -> Vector:
    """Return the ratios (d,) by which the smallest deviation √(wᵀ Γ w) grows if one signal is left out."""

    def least(matrix: Matrix) -> float:
        weights = best_weights(matrix, nonnegative=nonnegative)
        return float(weights @ matrix @ weights)

    rows = range(len(gamma))
    reduced = [least(np.delete(np.delete(gamma, k, axis=0), k, axis=1)) for k in rows]
    return np.sqrt(np.array(reduced) / least(gamma))


def best_weights(gamma: Matrix, *, nonnegative: bool = False) -> Vector:
    """Return the weights w (d,) with sum 1 that minimise wᵀ Γ w."""
    size = np.sqrt(np.diag(gamma))
    try:
        root = np.linalg.cholesky(gamma / np.outer(size, size))
    except np.linalg.LinAlgError as error:
        raise DataError(
            "a signal is a weighted sum of the others", argument="x", advice="Leave out copies of a signal."
        ) from error
    towards: Vector = np.linalg.solve(root, 1 / size).astype(np.float64)
    if nonnegative:
        rows = root / np.linalg.norm(root, axis=1, keepdims=True)
        solution, _ = _core.nonnegative_least_squares(towards, np.ascontiguousarray(rows))
        weights = solution / np.linalg.norm(root, axis=1) / size
    else:
        weights = np.linalg.solve(root.T, towards) / size
    return np.asarray(weights / weights.sum())


def _optimism(measured: WaveletMatrices, variance: Vector, shares: Vector, d: int) -> Vector:
    """Return the factor (J,) from the wavelet variance in the recording itself to the expected one in other recordings.
    If the estimate Γ̂ has η degrees of freedom, E 1/(1ᵀΓ̂⁻¹1) = (η − d + 1)/η · 1/(1ᵀΓ⁻¹1) and E wᵀΓw = (η − 1)/(η − d)
    · 1/(1ᵀΓ⁻¹1), with the true matrix Γ (Basak, Jagannathan and Ma 2009, Management Science 55, 990-1002)."""
    design = measured.design
    curve, model = mixture(variance, design.degrees_of_freedom, design, random=True)
    relative = covariance(model, design) / np.outer(curve, curve)
    parts = shares * curve / (shares @ curve)
    scatter = float(parts @ relative @ parts)
    eta = 2 / scatter
    if eta < d + SPARE_FREEDOM:
        fitting = measured.tau[2 / np.diag(relative) >= d + SPARE_FREEDOM]
        longest = f"of at most {duration_text(fitting[-1])}" if fitting.size else ""
        raise OptionError(
            f"weights of {d} sensors need {d + SPARE_FREEDOM:g} degrees of freedom at the scale of the horizon; the "
            f"recording has {eta:.1f}",
            argument="horizon",
            advice="Use a horizon {longest}, or a longer recording." if longest else "Use a longer recording.",
            longest=longest,
        )
    at_weights = eta / (eta - d + 1) * (eta - 1) / (eta - d)
    regression = np.clip(relative @ parts / scatter, 0.0, 1.0)
    return np.asarray(1 / (1 - regression + regression / at_weights))
