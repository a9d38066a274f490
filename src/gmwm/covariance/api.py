"""The covariance of the wavelet variances of a model whose values are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Matrix, Vector, as_levels, as_rate
from gmwm.covariance import filtered, gaussian, lines
from gmwm.covariance.design import Design as Design
from gmwm.covariance.segments import pooled
from gmwm.errors import OptionError
from gmwm.filters import WaveletFilter, find_filter
from gmwm.processes.model import Model, ModelLike, as_model
from gmwm.variance.biweight import biweight, require_robust
from gmwm.variance.transform import Transform, deepest_level


def covariance(model: Model, design: Design) -> Matrix:
    """V = Cov(ν̂², ν̂²) (J, J) in u⁴ of a model whose values are complete; see `wavelet_covariance`."""
    if design.segments:
        return pooled(design, lambda segment: covariance(model, segment))
    noise, waves = lines.apart(model, design)
    if noise is not model:
        own = 0.0 if noise is None else covariance(noise, design)
        return np.asarray(own + lines.excess(noise, waves, design, diagonal=False))
    if gaussian.knows(model, design):
        return gaussian.covariance(model, design)
    return filtered.covariance(model, design)


def variances(model: Model, design: Design) -> Vector:
    """The diagonal of `covariance` (J,), at about a tenth of the cost."""
    if design.segments:
        return pooled(design, lambda segment: variances(model, segment))
    noise, waves = lines.apart(model, design)
    if noise is not model:
        own = 0.0 if noise is None else variances(noise, design)
        return np.asarray(own + lines.excess(noise, waves, design, diagonal=True))
    if gaussian.knows(model, design):
        return gaussian.variances(model, design)
    return filtered.variances(model, design)


def ratio_variances(model: Model, design: Design) -> Vector:
    """Var log(ν̂_j²/ν̃_j²) (J,) of the classical over the robust estimate of a Gaussian signal, if it has no drift.

    The classical one is the first term of the Hermite expansion of the robust one. So Cov(ν̃_j², ν̂_k²) = Cov(ν̂_j²,
    ν̂_k²), and of the ratio is left what the robust one has beyond: Σ_{q = 4, 6, …} c_q Σ_u n(u) ρ_j(u)^q / M_j².
    """
    if design.segments:
        return pooled(design, lambda segment: ratio_variances(model, segment))
    lines.apart(model, design)
    if gaussian.knows(model, design):
        return gaussian.ratio_variances(model, design)
    return filtered.ratio_variances(model, design)


def wavelet_covariance(
    model: ModelLike,
    samples: int | Sequence[int],
    rate: float,
    *,
    levels: int | ArrayLike | None = None,
    filter: str | WaveletFilter = "haar",
    transform: Transform = "modwt",
    robust: bool = False,
    efficiency: float = 0.6,
) -> Matrix:
    """V = Cov(ν̂², ν̂²) of the wavelet variance of a model, for a record of any length; exact, without simulation.

    For a Gaussian signal

        V_jk = 2 / (M_j M_k) Σ_u n(u) Cov(W_{j,t}, W_{k,t+u})² + 4 μ_j μ_k Σ_u n(u) Cov(W_{j,t}, W_{k,t+u}) / (M_j M_k),

    with n(u) the number of pairs at lag u inside the record and μ_j the mean of W_j, which only a drift has. Rounding
    errors are uniform, and squares of their sums scatter less than Gaussian ones: κ₄ Σ_i S_ji S_ki is added, κ₄ = −1.2
    Q⁴, S_ji the mean square of what error i adds to the coefficients of level j. Of the robust estimate, with ρ the
    correlation at lag u,

        V_jk = ν_j² ν_k² Σ_{q = 2, 4, …} c_q Σ_u n(u) ρ^q / (M_j M_k),   c_2 = 2, Σ c_q = 2 / efficiency,

    with the same term for a drift. That rounding errors are uniform is left out there: where nothing else is felt, V is
    some 10 % too large. Levels of one or two coefficients are not estimated robustly, and are as of the classical one.

    A sinusoid of fixed amplitude is not Gaussian; 4 Σ_u n(u) R_jk(u) Cov(W_{j,t}, W_{k,t+u}) / (M_j M_k) is added, R
    the covariance of its coefficients, and what its phase makes of their squares. Robust estimates have no V then.

    Of segments s between gaps, measured together and taken for independent,

        V_jk = Σ_s M_sj M_sk V_sjk / (M_j M_k),   M_j = Σ_s M_sj,

    which is exact of white and quantization noise and of random walks, whose coefficients hold increments of their own
    segment alone; a Gauss-Markov process that outlasts a gap correlates what lies on both sides of it a little, which
    is left out, and a sinusoid is given a phase of its own in each. If more than 64 lengths differ, V_s M_s² is
    interpolated between lengths an eighth of an octave apart, which makes V of the coarsest levels up to 1 % too large.

    Parameters
    ----------
    model : Model, Process or str
        With all its values.
    samples : int or sequence of int
        Length N of the record, or that of each of its segments if it has gaps.
    rate : float
        Samples per second (Hz).
    levels : int or (J,) array, optional
        Number of levels, or the levels; all that have a coefficient by default, floor(log2 N) with the Haar filter.
    filter, transform, robust, efficiency
        How the wavelet variance is measured, as of `wavelet_variance`.

    Returns
    -------
    (J, J) array, in u⁴ for a signal in u

    Raises
    ------
    OptionError
        If the record is shorter than a level, or an option is not one of those it may be.
    MissingTheoryError
        If a process has too little theory for it.

    Examples
    --------
    >>> from gmwm import WN
    >>> wavelet_covariance(WN(sigma2=1.0), samples=1000, rate=1.0, levels=2).round(7)
    array([[0.0007505, 0.0001876],
           [0.0001876, 0.0002192]])
    >>> wavelet_covariance(WN(sigma2=1.0), samples=1000, rate=1.0, levels=1, robust=True).round(7)
    array([[0.0011196]])
    >>> wavelet_covariance(WN(sigma2=1.0), samples=(600, 400), rate=1.0, levels=1).round(7)
    array([[0.000751]])
    """
    require_robust(robust, efficiency)
    design = as_design(
        samples, rate, levels=levels, filter=filter, transform=transform, efficiency=efficiency if robust else None
    )
    return covariance(as_model(model), design)


def as_design(
    samples: int | Sequence[int],
    rate: float,
    levels: int | ArrayLike | None,
    filter: str | WaveletFilter,
    transform: Transform,
    efficiency: float | None,
) -> Design:
    """The design, checked: every level has a coefficient."""
    rate, wavelet = as_rate(rate), find_filter(filter)
    lengths = list(samples) if isinstance(samples, Sequence) else [samples]
    if not lengths or any(isinstance(n, bool) or not isinstance(n, int | np.integer) or n < 1 for n in lengths):
        raise OptionError(f"samples must be an integer of at least 2, or the lengths of segments, got {samples!r}")
    longest = int(max(lengths))
    if longest < 2:
        raise OptionError(f"samples must be an integer of at least 2, got {samples!r}")
    if transform not in ("modwt", "dwt"):
        raise OptionError(f"transform must be 'modwt' or 'dwt', got {transform!r}")
    if efficiency is not None:
        biweight(efficiency)
    deepest = deepest_level(longest, wavelet, transform)
    wanted = as_levels(max(deepest, 1) if levels is None else levels)
    if wanted[-1] > deepest:
        needed = wavelet.width(int(wanted[-1]))
        raise OptionError(f"level {wanted[-1]} needs {needed} samples, got samples={samples}; take fewer levels")
    segments = tuple(map(int, lengths)) if len(lengths) > 1 else ()
    return Design(
        levels=wanted,
        samples=sum(map(int, lengths)),
        rate=rate,
        filter=wavelet,
        transform=transform,
        efficiency=efficiency,
        segments=segments,
    )
