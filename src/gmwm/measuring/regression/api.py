"""Regress one axis on the temperature, on time or on other conditions of the recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Matrix, Vector, as_rate, as_vector, require_rate
from gmwm.base.errors import DataError, OptionError
from gmwm.base.lazy import scipy
from gmwm.measuring.regression.against import HOUR_S, TIME, WARM_UP, Asked
from gmwm.measuring.regression.covariates import Covariates
from gmwm.measuring.regression.least_squares import COLLINEAR_CONDITION, NoiseMixtures, RegressionDesign, Weighted
from gmwm.measuring.regression.result import Points, Regression
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.biweight import EFFICIENCY
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.gaps.gaps import restarts
from gmwm.recording.signals import Signal

TEMPERATURE_PVALUE = 0.05
"""With the automatic choice, the temperature is used if the p-value of its F test is below this level."""
COLUMN_PVALUE = 0.01  # the automatic choice adds a column if the p-value of its t test is below this level
DIFFERENT_ERRORS = 4.0
"""A remark is made if coefficients of long and of all scales differ by more standard errors (of the former)."""
OPTIMISM = 2.0
"""The variances of the coefficients are too small by a factor of about 1 + OPTIMISM/(3 + degrees of freedom), because
the weights come from the same data. Chosen in simulations with other seeds than docs/validation/regression.md."""


def regress(signal: Signal, covariates: Covariates) -> Regression:
    """Regress a signal on covariates that were prepared for a signal with the same times; see `regress_axis`."""
    means = covariates.clock.means(signal.values, clipped=True)
    return regress_axis(means, covariates, axis=signal.axis, unit=signal.unit)


def regress_axis(
    means: Vector, covariates: Covariates, *, axis: str = "", unit: str = "", automatic: bool = False
) -> Regression:
    """Regress block means (n,) on covariates by generalised least squares; noise and coefficients jointly.

    Standard errors account for slow noise, so that two walks seem unrelated. If `automatic`, only a significant
    temperature is used; its square, rate of change and cube are added at the 1 % level."""
    regression = regress_means(means, covariates, axis=axis, unit=unit)
    if automatic:
        regression = (
            replace(regression, applied=False)
            if regression.pvalue >= TEMPERATURE_PVALUE
            else _extend(regression, means, covariates)
        )
    return replace(regression, coarse=_coarse(regression, means, covariates.having(regression.terms)))


def _coarse(regression: Regression, means: Vector, covariates: Covariates) -> tuple[float, float, float] | None:
    """Return the coefficient from the longer half of scales, its standard error, and the shortest scale (s), if it is
    significantly farther from 0: correlated reading errors make it too small at short scales."""
    if not regression.terms[0].is_measured or regression.terms[0].exact:
        return None
    clock = covariates.clock
    levels = max(int(np.count_nonzero(clock.present())).bit_length() - 1, 0)
    first = (covariates.unknown_levels + levels) // 2
    try:
        other = regress_means(means, replace(covariates, lowest=clock.length.bit_length() + first))
    except DataError:
        return None
    (name, *_) = regression
    coefficient, long = regression[name], other[name]
    # The coefficient from all scales is efficient, so the difference has a smaller variance than the other coefficient.
    differ = abs(long.value - coefficient.value) > DIFFERENT_ERRORS * long.error
    if not differ or abs(long.value) < abs(coefficient.value):
        return None
    return long.value, long.error, clock.length * 2**first / clock.rate


def _extend(regression: Regression, means: Vector, covariates: Covariates) -> Regression:
    """Add the square, the rate of change and the cube of the temperature if they are significant."""
    for change in ({"degree": 2}, {"lag": True}, {"degree": 3}):
        term = regression.terms[0]
        if change.get("degree") == 3 and term.degree != 2:
            continue
        larger = covariates.having((replace(term, **change),))
        try:
            wider = regress_means(means, larger, axis=regression.axis, unit=regression.unit)
        except DataError:
            continue
        new = "temperature lag" if "lag" in change else f"temperature^{change['degree']}"
        if wider[new].pvalue < COLUMN_PVALUE:
            regression = wider
    return regression


def regress_means(means: Vector, covariates: Covariates, *, axis: str = "", unit: str = "") -> Regression:
    """Regress block means (n,) of an axis on covariates, without the automatic choice; see `regress_axis`."""
    # Smallest number of degrees of freedom of a standard error, from the same simulations. The formula returns 1 if the
    # data can neither show nor exclude a slow process; an effect of five standard errors would then not be significant.
    fewest = 2.0
    clock = covariates.clock
    present = clock.present()
    solved = _iterate(means, covariates, present, clock.whole())
    weighted, noise, design = solved.weighted, solved.noise, solved.weighted.design
    beta, lags = weighted.estimate(means), noise.covariances(len(means))
    parts = [weighted.covariances(part) for part in lags]
    covariance = noise.average(parts)
    freedoms = [max(noise.freedom_of([part[:, k, k] for part in parts]), fewest) for k in range(beta.size)]
    factors = np.sqrt(1 + OPTIMISM / (3 + np.array(freedoms)))
    covariance = covariance * np.outer(factors, factors)
    inverse = np.linalg.pinv(covariance, hermitian=True)
    freedom = max(noise.freedom_of([np.einsum("ab,kba->k", inverse, part) for part in parts]), fewest)
    statistic = float(beta @ inverse @ beta) / beta.size
    residuals = means - covariates.matrix(solved.tau, smooth=True) @ beta
    raw, remaining = design.variances(means), design.variances(residuals)
    counts = clock.counts[present]
    inside = clock.length.bit_length() - 1
    first = covariates.basis.terms[0]
    at = covariates.means.get(first.name, clock.times / (first.seconds if first.name == TIME else HOUR_S))
    points = Points(at=_thin(at[present]), before=_thin(means[present]), after=_thin(residuals[present]))
    tau, tau_error = solved.tau, None
    if tau is not None:
        k = [column.name for column in covariates.basis.columns].index(WARM_UP)
        tau_error = tau * float(np.sqrt(covariance[k + 1, k + 1]) / abs(beta[k])) if beta[k] else None
    return Regression(
        axis=axis, unit=unit, basis=covariates.basis, estimates=tuple(beta.tolist()), covariance=covariance,
        freedoms=tuple(freedoms), statistic=statistic, freedom=freedom,
        pvalue=float(scipy.special.fdtrc(beta.size, freedom, statistic)), ranges=dict(covariates.ranges),
        mean=float(np.average(residuals[present], weights=counts)), tau=tau, tau_error=tau_error,
        block=covariates.block / clock.rate, rate=clock.rate, kept=np.concatenate([np.ones(inside), solved.kept]),
        points=points, share=np.concatenate([np.zeros(inside), np.clip(1 - remaining / raw, 0.0, 1.0)]),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Iteration:
    """Result of the iteration: the regression, the noise, the share of it that is left, and tau of a warm-up (s)."""

    weighted: Weighted
    noise: NoiseMixtures
    kept: Vector
    tau: float | None


def _iterate(means: Vector, covariates: Covariates, present: np.ndarray, whole: np.ndarray) -> _Iteration:
    """Estimate noise, weights and coefficients; residuals that jump at a gap (restart) get another offset."""
    iteration = _rounds(means, covariates, present, whole)
    places = np.flatnonzero(present)
    lost = np.diff(places) - 1
    if covariates.own_offsets or not np.any(lost):
        return iteration
    residuals = means - covariates.matrix(iteration.tau, smooth=True) @ iteration.weighted.estimate(means)
    after = np.flatnonzero(lost) + 1
    restarted = restarts(residuals[places], after, lost[after - 1], ())
    if not np.any(restarted):
        return iteration
    return _rounds(means, covariates, present, whole, restarted=tuple(places[after[restarted]].tolist()))


def _rounds(
    means: Vector, covariates: Covariates, present: np.ndarray, whole: np.ndarray, restarted: tuple[int, ...] = ()
) -> _Iteration:
    """Estimate noise, weights and coefficients in turn. The first estimate of the noise includes the effects."""
    warm = any(term.name == WARM_UP for term in covariates.basis.terms)
    times = covariates.clock.times[present]
    tau = (times[-1] - times[0]) / 3 if warm else None
    offsets = covariates.own_offsets
    design = RegressionDesign(covariates.matrix(tau), present, whole, offsets=offsets, restarts=restarted)
    # The pass band of level j is centred at the frequency 2^-(j + 1/2), in cycles per block.
    unknown = covariates.unknown_levels
    highest = 0.5 ** (unknown + 1.5) if unknown else 0.5
    scales = 2.0 ** np.arange(1, design.levels + 1)
    freedom = np.maximum(design.counts / scales, 1.0)
    shares, variances = np.ones(design.levels), design.variances(means)
    # Rounds of noise, weights and coefficients; the third one changes a standard error by less than 1 %.
    for _ in range(4):
        if not np.all(variances > 0):
            raise DataError("the signal is constant at some scale, so that it cannot be regressed", argument="against")
        noise = NoiseMixtures.of(variances / shares, freedom * shares, len(means))
        weights = design.weights(noise.psd, highest)
        if warm:
            tau = _time_constant(means, covariates, design, weights)
            design = RegressionDesign(covariates.matrix(tau), present, whole, offsets=offsets, restarts=restarted)
        weighted = design.under(weights)
        if weighted.condition > COLLINEAR_CONDITION:
            names = ", ".join(column.name for column in covariates.basis.columns)
            raise DataError(
                f"the columns {names} describe nearly the same course in this recording, so that their effects cannot "
                "be separated",
                argument="against",
                advice="Use fewer of them, or leave `offsets` out." if offsets else "Use fewer of them.",
            )
        beta = weighted.estimate(means)
        spread = weighted.covariance_rows(noise.average(noise.covariances(len(means))))
        shares = np.clip(1 - weighted.removed_variance(spread) / noise.curve, 0.1, 1.0)
        variances = design.variances(means - covariates.matrix(tau, smooth=True) @ beta)
    return _Iteration(weighted, noise, shares, tau)


def _time_constant(means: Vector, covariates: Covariates, design: RegressionDesign, weights: Sequence[Vector]) -> float:
    """Return the time constant (s) of the warm-up with the smallest weighted sum of squares, from two nested grids."""
    times = covariates.clock.times[design.present]
    span, step = float(times[-1] - times[0]), covariates.clock.length / covariates.clock.rate
    # Leave out the column of the derivative with respect to the time constant, which is constant during the search.
    first = [column.name for column in covariates.basis.columns].index(f"{WARM_UP} tau")

    def gain(tau: float) -> float:
        columns: Matrix = np.delete(covariates.matrix(tau), first, axis=1)
        under = replace(design, columns=columns).under(weights)
        beta = under.estimate(means)
        return float(beta @ under.information @ beta)

    grid = np.geomspace(4 * step, 1.5 * span, 24)
    best = int(np.argmax([gain(tau) for tau in grid]))
    ratio = grid[1] / grid[0]
    finer = grid[best] * np.geomspace(1 / ratio, ratio, 13)
    return float(finer[int(np.argmax([gain(tau) for tau in finer]))])


def regressed_variance(
    data: WaveletVariance | Signal | ArrayLike, rate: float | None, asked: Asked, *, robust: bool = False,
    efficiency: float = EFFICIENCY,
) -> WaveletVariance:  # fmt: skip
    """Estimate the wavelet variance of a signal without the effect of covariates (attribute `regression`)."""
    if isinstance(data, WaveletVariance):
        raise OptionError(
            "against needs the samples; got a WaveletVariance",
            argument="against",
            advice="Pass the signal, or leave {--against} out.",
        )
    if not isinstance(data, Signal):
        data = Signal(as_vector(data, "data"), as_rate(rate))
    require_rate(rate, data.rate)
    covariates = Covariates.of(asked.terms, dict(asked.arrays or {}), data)
    regression = regress(data, covariates)
    residuals = without(data, regression, covariates)
    return regression.corrected(wavelet_variance(residuals, robust=robust, efficiency=efficiency))


def restate(
    regression: Regression, signal: Signal, covariates: Covariates, estimates: Vector, *, covariance: Matrix,
    freedoms: tuple[float, ...], freedom: float,
) -> Regression:  # fmt: skip
    """Return a regression with other estimates, covariance and freedom, and their joint test and residuals."""
    clock = covariates.clock
    present = clock.present()
    means = clock.means(signal.values, clipped=True)
    residuals = means - covariates.having(regression.terms).matrix(regression.tau, smooth=True) @ estimates
    statistic = float(estimates @ np.linalg.pinv(covariance, hermitian=True) @ estimates) / estimates.size
    return replace(
        regression, estimates=tuple(estimates.tolist()), covariance=covariance, freedoms=freedoms, freedom=freedom,
        statistic=statistic, pvalue=float(scipy.special.fdtrc(estimates.size, freedom, statistic)),
        mean=float(np.average(residuals[present], weights=clock.counts[present])),
        points=replace(regression.points, after=_thin(residuals[present])),
    )  # fmt: skip


def _thin(values: Vector) -> Vector:
    """Return the means of up to `POINTS` consecutive parts of nearly equal length."""
    edges = np.linspace(0, values.size, min(256, values.size) + 1).astype(np.int64)
    return np.asarray(np.add.reduceat(values, edges[:-1]) / np.diff(edges))


def effect_of(regression: Regression, covariates: Covariates, first: int, last: int) -> Vector:
    """Return the effect of the covariates at the samples first … last − 1."""
    return covariates.having(regression.terms).effect(np.array(regression.estimates), regression.tau, first, last)


def without(signal: Signal, regression: Regression, covariates: Covariates, first: int = 0) -> Signal:
    """Subtract the effect of the covariates, zero at their reference values, from a part that begins at `first`."""
    values = signal.values - effect_of(regression, covariates, first, first + len(signal))
    return replace(signal, values=values)
