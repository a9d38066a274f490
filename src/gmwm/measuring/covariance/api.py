"""Exact covariance of the wavelet variance of a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import get_args

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import Matrix, Vector, as_levels, as_rate
from gmwm.base.errors import OptionError
from gmwm.measuring.covariance import filtered, gaussian, lagged, lines
from gmwm.measuring.covariance.design import Design as Design
from gmwm.measuring.covariance.segments import pooled
from gmwm.measuring.variance.biweight import biweight, require_robust
from gmwm.measuring.variance.transform import Transform, deepest_level
from gmwm.recording.options import one_of
from gmwm.theory.filters import WaveletFilter, find_filter
from gmwm.theory.processes.model import Model, ModelLike, as_model


def covariance(model: Model, design: Design, *, diagonal: bool = False) -> Matrix:
    """Compute V = Cov(ν̂², ν̂²) (J, J), in u⁴; its `diagonal` (J,) takes a tenth of the time."""
    if design.gaussian is not design:
        bare = design.loss_factor * covariance(model, design.gaussian, diagonal=diagonal)
        if (added := design.added) is None:
            return np.asarray(bare)
        curve = model.wavelet_variance(design.levels, design.rate, design.filter)
        return np.asarray(bare + (np.diag(added) * curve**2 if diagonal else added * np.outer(curve, curve)))
    if design.segments:
        return pooled(design, lambda segment: covariance(model, segment, diagonal=diagonal))
    if design.filter.lags:
        v = lagged.covariance(model, design, covariance(model, design.without_lags))
        return np.diag(v).copy() if diagonal else v
    noise, waves = lines.apart(model, design)
    if noise is not model:
        own = 0.0 if noise is None else covariance(noise, design, diagonal=diagonal)
        return np.asarray(own + lines.excess(noise, waves, design, diagonal=diagonal))
    if gaussian.knows(model, design):
        return gaussian.variances(model, design) if diagonal else gaussian.covariance(model, design)
    return filtered.variances(model, design) if diagonal else filtered.covariance(model, design)


def covariances(model: Model, *designs: Design) -> list[Matrix]:
    """Compute `covariance` for designs that differ only in their excess and their model error."""
    bare = designs[0].loss_factor * covariance(model, designs[0].gaussian)
    if all(design.added is None for design in designs):
        return [bare] * len(designs)
    curve = model.wavelet_variance(designs[0].levels, designs[0].rate, designs[0].filter)
    square = np.outer(curve, curve)
    return [bare if design.added is None else bare + design.added * square for design in designs]


def variances(model: Model, design: Design) -> Vector:
    """Compute the diagonal (J,) of `covariance`, in u⁴."""
    return covariance(model, design, diagonal=True)


def ratio_variances(model: Model, design: Design) -> Vector:
    """Compute Var log(ν̂_j²/ν̃_j²) (J,) of the classical and the robust estimate, for a Gaussian signal without drift.

    ν̂_j² is the first term of the Hermite expansion of ν̃_j², so Cov(ν̃_j², ν̂_k²) = Cov(ν̂_j², ν̂_k²). The variance is
    the rest of the expansion, Σ_{q = 4, 6, …} c_q Σ_u n(u) ρ_j(u)^q / M_j²."""
    if design.gaussian is not design:
        return np.asarray(design.loss_factor * ratio_variances(model, design.gaussian))
    if design.segments:
        return pooled(design, lambda segment: ratio_variances(model, segment))
    lines.apart(model, design)
    if gaussian.knows(model, design):
        return gaussian.ratio_variances(model, design)
    return filtered.ratio_variances(model, design)


def wavelet_covariance(
    model: ModelLike, samples: int | Sequence[int], rate: float, *, levels: int | ArrayLike | None = None,
    filter: str | WaveletFilter = "haar", transform: Transform = "modwt", robust: bool = False, efficiency: float = 0.6,
) -> Matrix:  # fmt: skip
    """Compute the exact covariance V = Cov(ν̂², ν̂²) of the wavelet variance of a model, without simulation.

    For a Gaussian signal,

        V_jk = 2 / (M_j M_k) Σ_u n(u) Cov(W_{j,t}, W_{k,t+u})² + 4 μ_j μ_k Σ_u n(u) Cov(W_{j,t}, W_{k,t+u}) / (M_j M_k),

    where M_j is the number of coefficients W_j of level j, n(u) is the number of pairs of coefficients at lag u in the
    recording, and μ_j is the mean of W_j, which is 0 unless the model has a drift. The errors of quantization noise are
    uniform and have smaller fourth moments. For them, κ₄ Σ_i S_ji S_ki is added, where κ₄ = −1.2 Q⁴ and S_ji is the
    mean square of the contribution of error i to the coefficients of level j.

    For the robust estimate, with the correlation ρ of the two coefficients at lag u,

        V_jk = ν_j² ν_k² Σ_{q = 2, 4, …} c_q Σ_u n(u) ρ^q / (M_j M_k),   c_2 = 2, Σ c_q = 2 / efficiency,

    and the same term for a drift. The term with κ₄ is neglected here, which makes V about 10 % too large for pure
    quantization noise. Levels with one or two coefficients are not estimated robustly; their V is the V of the
    classical estimate.

    A sinusoid of fixed amplitude is not Gaussian. It adds 4 Σ_u n(u) R_jk(u) Cov(W_{j,t}, W_{k,t+u}) / (M_j M_k), where
    R is the covariance of its coefficients, and a variance from its random phase. For the robust estimate, V cannot be
    computed for a model with a sinusoid.

    If the recording has segments s between gaps, they are treated as independent:

        V_jk = Σ_s M_sj M_sk V_sjk / (M_j M_k),   M_j = Σ_s M_sj.

    This is exact for white noise, quantization noise and random walks. It neglects the correlation of a Gauss-Markov
    process across a gap, and the phase of a sinusoid is independent in each segment. If the segments have more than 64
    different lengths, V_s M_s² is interpolated between lengths that are an eighth of an octave apart. This makes V of
    the coarsest levels up to 1 % too large.

    Parameters
    ----------
    model : Model, Process or str
        Model whose parameters all have values.
    samples : int or sequence of int
        Length N of the recording, or the length of each segment if it has gaps.
    rate : float
        Sampling rate (Hz).
    levels : int or (J,) array, optional
        Number of levels, or the levels; by default all levels that have a coefficient, floor(log2 N) with the Haar
        filter.
    filter, transform, robust, efficiency
        The same as for `wavelet_variance`.

    Returns
    -------
    (J, J) array
        Covariance V, in u⁴ for a signal in the unit u.

    Raises
    ------
    OptionError
        If the recording is too short for a level, or an option has an invalid value.
    MissingTheoryError
        If a process does not define the required theory.

    References
    ----------
    Percival (1995), On estimation of the wavelet variance, Biometrika 82, 619-631. docs/validation/covariance.md
    compares V with simulations.

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
    samples: int | Sequence[int], rate: float, levels: int | ArrayLike | None, filter: str | WaveletFilter,
    transform: Transform, efficiency: float | None,
) -> Design:  # fmt: skip
    """Create a design from the arguments of `wavelet_covariance`, and check that every level has a coefficient."""
    rate, wavelet = as_rate(rate), find_filter(filter)
    lengths = list(samples) if isinstance(samples, Sequence) else [samples]
    whole = [n for n in lengths if isinstance(n, int | np.integer) and not isinstance(n, bool) and n >= 1]
    if not lengths or len(whole) < len(lengths) or max(whole) < 2:
        raise OptionError(
            argument="samples", expected="a whole number of at least 2, or the lengths of segments", got=samples
        )
    longest = int(max(lengths))
    one_of(transform, "transform", get_args(Transform))
    if efficiency is not None:
        biweight(efficiency)
    deepest = deepest_level(longest, wavelet, transform)
    wanted = as_levels(max(deepest, 1) if levels is None else levels)
    if wanted[-1] > deepest:
        needed = wavelet.width(int(wanted[-1]))
        raise OptionError(
            f"level {wanted[-1]} needs {needed} samples; got {samples}", argument="samples", got=samples,
            advice="Use fewer {--levels}, or more samples.",
        )  # fmt: skip
    segments = tuple(map(int, lengths)) if len(lengths) > 1 else ()
    return Design(
        levels=wanted, samples=sum(map(int, lengths)), rate=rate, filter=wavelet, transform=transform,
        efficiency=efficiency, segments=segments,
    )  # fmt: skip
