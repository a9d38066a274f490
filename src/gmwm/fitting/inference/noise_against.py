"""Test whether the noise of an axis depends on a condition such as the temperature."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace

import numpy as np

from gmwm.base.arrays import Booleans, FrozenArrays, Integers, Matrix, Vector
from gmwm.base.documents import Documented
from gmwm.base.errors import DataError, FitWarning, OptionError
from gmwm.base.lazy import scipy
from gmwm.base.results import Difference, DifferenceTests
from gmwm.base.statistics import holm
from gmwm.base.text import duration_text, p_relation, p_text
from gmwm.fitting.estimation import fit
from gmwm.fitting.estimation.moving_condition import condition_of
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.covariance.mixture import mixture
from gmwm.measuring.covariance.tails import excess_covariance
from gmwm.measuring.regression.against import Against
from gmwm.measuring.regression.api import regress, without
from gmwm.measuring.regression.blocks import BlockClock
from gmwm.measuring.regression.least_squares import haar
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal
from gmwm.theory.processes.model import ModelLike


@dataclass(frozen=True)
class Slope:
    """Change of the standard deviation of noise with a condition.

    Attributes
    ----------
    value : float
        Relative change of the standard deviation σ per unit of the condition c, σ(c) = σ(c₀) e^{value (c − c₀)}.
    error : float
        Standard error of `value`.
    pvalue : float
        Two-sided p-value of the hypothesis that the noise does not depend on the condition.
    """

    value: float
    error: float
    pvalue: float


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class NoiseAgainst(FrozenArrays, Documented, DifferenceTests):
    """Dependence of the noise of an axis on a condition.

    Attributes
    ----------
    axis, condition : str
        Names of the axis and of the condition.
    unit : str
        Unit of the condition; "" if it is unknown.
    range : (lowest, highest)
        Smallest and largest value of the condition in the recording.
    levels : (J,) int array
        Levels that are tested.
    tau : (J,) array
        Scales (s) of these levels.
    slopes : tuple of Slope
        Change of the noise at each level.
    pvalue : float
        p-value of the joint test of all levels that the noise does not depend on the condition.
    terms : mapping of name to Slope
        Change of each term of the model that the data support, such as "WN".
    pvalue_terms : float or None
        p-value of the test that the slopes of the terms explain the slopes of the levels; None if there are as many
        terms as levels.
    """

    axis: str
    condition: str
    unit: str
    range: tuple[float, float]
    levels: Integers
    tau: Vector
    slopes: tuple[Slope, ...]
    pvalue: float
    terms: dict[str, Slope]
    pvalue_terms: float | None

    @property
    def tests(self) -> tuple[Difference, ...]:
        """Deviation at the highest over that at the lowest value of the condition, at each level, with 95 % limits."""
        span = self.range[1] - self.range[0]
        adjusted = holm([slope.pvalue for slope in self.slopes]).tolist()
        return tuple(
            Difference(name=f"{self.axis} at {duration_text(float(tau))}".strip(), ratio=math.exp(slope.value * span),
                       lower=math.exp((slope.value - 1.96 * slope.error) * span),
                       upper=math.exp((slope.value + 1.96 * slope.error) * span), pvalue=p, differs=p <= 0.05)
            for tau, slope, p in zip(self.tau, self.slopes, adjusted, strict=True)
        )  # fmt: skip

    def summary(self) -> str:
        """Format a table of the slopes of levels and terms in per cent per unit, with standard errors and p-values."""
        per = f"%/{self.unit}" if self.unit else "% per unit"
        verdict = "changes" if self.pvalue < 0.05 else "does not change measurably"
        lines = [
            f"The noise of {self.axis or 'the signal'} {verdict} with {self.condition} from {self.range[0]:.4g} to "
            f"{self.range[1]:.4g}{' ' + self.unit if self.unit else ''}: p {p_relation(self.pvalue)}.",
            f"  {'':<12}{per:>12}{'±':>10}{'p':>10}",
        ]
        rows = [(f"{tau:.4g} s", slope) for tau, slope in zip(self.tau, self.slopes, strict=True)]
        for name, slope in [*rows, *self.terms.items()]:
            lines.append(f"  {name:<12}{100 * slope.value:>12.3g}{100 * slope.error:>10.2g}{p_text(slope.pvalue):>10}")
        if self.pvalue_terms is not None and self.pvalue_terms < 0.05:
            lines.append(
                f"  The slopes of the terms do not explain those of the levels (p {p_relation(self.pvalue_terms)}): "
                "use those of the levels."
            )
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"NoiseAgainst({self.axis or 'signal'}, {self.condition}, p {p_relation(self.pvalue)})"


def noise_against(signal: Signal, condition: Against, *, model: ModelLike = "QN + WN + FN + RW") -> NoiseAgainst:
    """Test whether the noise of an axis depends on a condition such as the temperature.

    The effect of the condition on the mean is removed first. At each level j, the variance of the Haar coefficients W_j
    is ν_j²(c) = ν_j² e^{2 s_j (c − c̄)}, where c is the mean of the condition over the samples of a coefficient and c̄
    the mean over the recording. The slope s_j solves Σ (c − c̄) W_j² e^{−2 s_j (c − c̄)} = 0. The slopes s_k of the
    terms k follow from the slopes of the levels by generalised least squares with s_j = Σ_k (ν_jk²/ν_j²) s_k, where
    ν_jk² is the wavelet variance of term k.

    Parameters
    ----------
    signal : Signal
        Signal of the axis.
    condition : (N,) array, Signal, mapping of one name to it, or "time"
        Condition, for example ``{"temperature": imu.temperature}``. The name may have the options of `against` for its
        effect on the mean, such as "temperature:3" or "rate:exact". The condition must change slowly, because only
        scales over which it is nearly constant are used.
    model : Model or str
        Noise terms whose slopes are estimated.

    Returns
    -------
    NoiseAgainst
        Slopes of levels and terms, with tests.

    Raises
    ------
    OptionError
        If `signal` is not a Signal, or there is not exactly one condition.
    DataError
        If the condition is constant, not finite, known too inaccurately, or changes too quickly, or if the recording is
        too short.

    Notes
    -----
    In a study, the joint test at the 5 % level rejects 3 % of 160 series of noise with a constant variance, and 95 %
    intervals of the slope of white noise contain the true value in 95 % of 320 series (docs/validation/regression.md).
    A slope does not prove that the condition is the cause: noise that changes with time for another reason also has
    slopes.

    Examples
    --------
    >>> import numpy as np
    >>> from gmwm import Signal
    >>> rng = np.random.default_rng(1)
    >>> temperature = np.linspace(20.0, 40.0, 20_000)
    >>> x = np.exp(0.02 * (temperature - 30)) * rng.normal(size=20_000)
    >>> found = noise_against(Signal(x, 100.0), {"temperature": temperature})
    >>> round(found.terms["WN"].value, 3)
    0.02
    """
    if not isinstance(signal, Signal):
        raise OptionError(argument="signal", expected="a Signal, such as imu['gyro_x']", got=signal)
    term, covariates, values = condition_of(signal, condition)
    residual = without(signal, regress(signal, covariates), covariates)
    length = max(covariates.clock.length, 16)
    blocks = BlockClock.of(signal.rate, signal.segments, signal.starts, length=length)
    residual = replace(residual, values=blocks.clip(residual.values))
    wv = wavelet_variance(residual)
    design = Design.of(wv)
    used = _slow(residual, values, design)
    if not np.any(used):
        raise DataError(
            f"{term.name} changes too quickly for the scales of this recording, or the recording is too short",
            argument="condition",
            advice="Record for longer, with slower changes.",
        )
    levels = wv.levels[used]
    slopes, spread = np.array([_slope(*_parts(residual, values, level)) for level in levels.tolist()]).T
    # The covariance is measured after the dependence on the condition is removed.
    even = replace(residual, values=residual.values * np.exp(-slopes[0] * (values - np.mean(values))))
    _, noise = mixture(wv.variance, wv.degrees_of_freedom, design)
    design = replace(design, excess=excess_covariance(even, wavelet_variance(even)))
    curve = noise.wavelet_variance(wv.levels, wv.rate)[used]
    # Cov(s_j, s_k) = V_jk √(M_j M_k) / (4 ν_j² ν_k² √(K_j K_k)), with the condition's variance K_j/M_j at level j.
    relative = covariance(noise, design)[np.ix_(used, used)] / np.outer(curve, curve)
    errors = relative / np.outer(spread, spread) / 4
    inverse = np.linalg.inv(errors)
    statistic = float(slopes @ inverse @ slopes)
    names, shares = _shares(model, wv, used)
    terms, remainder = {}, statistic
    if names:
        root = np.linalg.cholesky(inverse).T
        estimates, *_ = np.linalg.lstsq(root @ shares, root @ slopes, rcond=None)
        spreads = np.sqrt(np.diag(np.linalg.pinv(shares.T @ inverse @ shares, hermitian=True)))
        terms = {name: _test(*pair) for name, *pair in zip(names, estimates, spreads, strict=True)}
        remainder = float(np.sum((root @ (slopes - shares @ estimates)) ** 2))
    free = levels.size - len(names)
    return NoiseAgainst(
        axis=signal.axis, condition=term.name, unit=term.unit, range=(float(np.min(values)), float(np.max(values))),
        levels=levels.copy(), tau=wv.tau[used],
        slopes=tuple(_test(s, e) for s, e in zip(slopes, np.sqrt(np.diag(errors)), strict=True)),
        pvalue=float(scipy.special.gammaincc(levels.size / 2, statistic / 2)), terms=terms,
        pvalue_terms=float(scipy.special.gammaincc(free / 2, remainder / 2)) if free > 0 else None,
    )  # fmt: skip


def _test(value: float, error: float) -> Slope:
    return Slope(float(value), float(error), 2 * float(scipy.special.ndtr(-abs(value) / error)))


def _shares(model: ModelLike, wv: WaveletVariance, used: Booleans) -> tuple[list[str], Matrix]:
    """Return the names of the terms that the data support, and the share (J, terms) of each in the wavelet variance."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        result = fit(model, wv, certify=False)
    errors, parts = result.sandwich.errors, {}
    for name, process in result.model.by_term.items():
        scale = f"{name}.{process.scale_parameter().name}"
        # Least ratio of a scale parameter to its standard error; the slope of a weaker term is too uncertain.
        if scale in errors and abs(result.parameters[scale]) > 4.0 * errors[scale]:
            parts[name] = (result.decomposition[name] / result.implied)[used]
    return list(parts), np.column_stack(list(parts.values())) if parts else np.zeros((int(np.sum(used)), 0))


def _slow(signal: Signal, values: Vector, design: Design) -> Booleans:
    """Return the levels (J,) with enough degrees of freedom and nearly constant condition in a coefficient."""
    # Least degrees of freedom of a level: the joint test then rejects 3 % at 5 % (docs/validation/regression.md).
    least_freedom = 30.0
    mask, total = np.zeros(design.levels.size, dtype=bool), float(np.var(values))
    for k, (level, freedom) in enumerate(zip(design.levels.tolist(), design.degrees_of_freedom, strict=True)):
        if freedom >= least_freedom:
            away = np.concatenate([_running(values[a:b], 1 << level) for a, b in _long(signal, level)])
            away -= np.mean(away)
            variance = float(np.mean(away**2))
            # If the condition is rarely far from its mean, the slope has fewer degrees of freedom.
            few = freedom * variance**2 < least_freedom * float(np.mean(away**4))
            # The condition must change slowly: least share of its variance in means over a scale.
            mask[k] = variance >= 0.5 * total and not few
    return mask


def _parts(signal: Signal, values: Vector, level: int) -> tuple[Integers, Vector, Vector]:
    """Divide the coefficients of a level into parts: their number, sum of squares, and mean condition in each part."""
    pieces = [
        (haar(signal.values[a:b] - np.mean(signal.values[a:b]), level) ** 2, _running(values[a:b], 1 << level))
        for a, b in _long(signal, level)
    ]
    # Mean squares of 4096 parts of each level make the cost independent of the recording's length.
    length = max(sum(squares.size for squares, _ in pieces) // 4096, 1)
    counts, sums, means = [], [], []
    for squares, condition in pieces:
        edges = np.arange(0, squares.size, length)
        counts.append(np.diff(np.append(edges, squares.size)))
        sums.append(np.add.reduceat(squares, edges))
        means.append(np.add.reduceat(condition, edges) / counts[-1])
    return np.concatenate(counts), np.concatenate(sums), np.concatenate(means)


def _slope(counts: Integers, sums: Vector, means: Vector) -> tuple[float, float]:
    """Return a level's relative change of spread per unit of the condition, and the condition's spread."""
    away = means - np.average(means, weights=counts)
    spread = float(np.sqrt(np.average(away**2, weights=counts)))
    c, slope = away / spread, 0.0
    for _ in range(20):
        now = sums * np.exp(-2 * slope * c)
        step = float(c @ now / (2 * (c**2 @ now)))
        slope += float(np.clip(step, -1.0, 1.0))
        if abs(step) < 1e-10:
            break
    return slope / spread, spread


def _long(signal: Signal, level: int) -> list[tuple[int, int]]:
    """Return the first sample and the end of each segment that is long enough for a coefficient of a level."""
    return [(a, b) for a, b in signal.segments if b - a >= 1 << level]


def _running(values: Vector, width: int) -> Vector:
    """Return the means of all runs of `width` values."""
    sums = np.concatenate([[0.0], np.cumsum(values - values[0])])
    return np.asarray(values[0] + (sums[width:] - sums[:-width]) / width)
