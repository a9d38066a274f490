"""Estimate the covariance of the wavelet variance from the data alone, for Gaussian and other signals.

Cov(ν̂_j², ν̂_k²) is the cross-spectrum at frequency 0 of the squares S_j(t) = W_{j,t}², divided by their number M. K
sine tapers v_q estimate it, as the mean over q of y_j(q) y_k(q), y_j(q) = Σ_t v_q(t) [S_j(t) − ν̂_j²]. Their
frequencies, up to (K + 1) / (2M), must be much smaller than 2^−k, the bandwidth of the coarser level k, so K follows
from M / 2^k. Levels with few pieces are averaged with the Gaussian covariance of the likeliest mixture."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base import _core
from gmwm.base.arrays import Integers, Matrix, Vector
from gmwm.base.errors import DataError
from gmwm.measuring.covariance.api import covariance
from gmwm.measuring.covariance.design import Design
from gmwm.measuring.covariance.mixture import drawn, mixture
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.transform import Transform, inner_coefficients
from gmwm.recording.signals import Signal
from gmwm.theory.filters import WaveletFilter

GAUSSIAN_TAPERS = 8.0
"""Weight (tapers) of the Gaussian covariance; tests/covariance/test_empirical.py pins it and the next two."""
_FROM_A_MODEL = "Compute the covariance of a model with `wavelet_covariance(model, samples, rate)`."


def empirical_covariance(
    x: Signal | ArrayLike, rate: float | None = None, *, levels: int | None = None,
    filter: str | WaveletFilter = "haar", transform: Transform = "modwt",
) -> Matrix:  # fmt: skip
    """Estimate the covariance V = Cov(ν̂², ν̂²) of the wavelet variance from the signal, which need not be Gaussian.

    Variances and correlations are

        V_jj = ν_j⁴ (K_j v̂_j + P v⁰_j) / (K_j + P),   r_jk = (K_k r̂_jk + P r⁰_jk) / (K_k + P),

    where k is the coarser level and P = 8. The variances v̂ = (mean over K_j sine tapers of y_j²) / ν̂_j⁴ and the
    correlations r̂ come from the data, see the module docstring; v⁰ and r⁰ come from a Gaussian mixture of processes
    that describes the curve. At levels with few data, ν_j² is averaged with the curve of this mixture. K_k is
    M_k / 2^(k + 2) (M_k / 4 for the decimated transform), at most 128. Coarse levels with K below 2 have the values of
    the mixture. If the matrix of correlations is not positive definite, it is averaged with r⁰.

    V_jj has a relative standard error of √(2 / K_j), which is at least 12 %. At the coarsest three levels, V_jj is on
    average too large by a factor of 1.3 to 2.5, because ν̂⁴ is too large on average.

    Parameters
    ----------
    x : Signal, or (N,) array in any unit
        Finite samples, at least 8 without a gap. Segments of a Signal are used together.
    rate : float, optional
        Sampling rate (Hz), required if `x` is an array.
    levels : int, optional
        Number of levels J; by default all levels that have a coefficient.
    filter, transform
        The same as for `wavelet_variance`.

    Returns
    -------
    (J, J) array
        Covariance V, in u⁴ for a signal in the unit u.

    Raises
    ------
    DataError
        If the wavelet variance of the signal cannot be computed or is zero at a level, or the coefficients of a level
        do not vary.
    OptionError
        If an option has an invalid value.

    References
    ----------
    Serroukh, A., Walden, A. T. and Percival, D. B. (2000), Statistical properties and uses of the wavelet variance
    estimator for the scale analysis of time series, JASA 95, 184-196. Tapers: Riedel, K. S. and Sidorenko, A. (1995),
    Minimum bias multiple taper spectral estimation, IEEE Trans. Signal Processing 43, 188-195.

    Examples
    --------
    >>> import numpy as np
    >>> from gmwm.covariance import wavelet_covariance
    >>> x = np.random.default_rng(1).laplace(size=2**16)
    >>> v = empirical_covariance(x, rate=100.0, levels=6)
    >>> ratio = np.diag(v) / np.diag(wavelet_covariance("WN(sigma2=2.0)", 2**16, 100.0, levels=6))
    >>> bool(ratio[0] > 1.4), bool(ratio[5] < 1.2)
    (True, True)
    """
    x = x.fill_gaps() if isinstance(x, Signal) else x
    wv = wavelet_variance(x, rate, filter=filter, transform=transform, levels=levels)
    if not np.all(wv.variance > 0):
        zero = ", ".join(str(j) for j in wv.levels[wv.variance <= 0])
        raise DataError(
            f"the wavelet variance is zero at level {zero}, because the signal is constant or coarsely quantized, so "
            "the data do not determine its covariance",
            advice=_FROM_A_MODEL,
        )
    design = Design.of(wv)
    # Scaling by a power of two causes no rounding error and keeps fourth powers within the range of double precision.
    unit = 2.0 ** np.floor(0.5 * np.log2(wv.variance.max()))
    variance = wv.variance / unit**2
    values = (x.values if isinstance(x, Signal) else np.asarray(x, dtype=np.float64)) / unit
    curve, model = mixture(variance, wv.degrees_of_freedom, design)
    theory = covariance(model, design)
    variance_share, correlation, tapers = _measured(values, variance, design)

    own = np.diag(theory)
    prior = theory / np.sqrt(np.outer(own, own))
    relative = (tapers * variance_share + GAUSSIAN_TAPERS * own / curve**2) / (tapers + GAUSSIAN_TAPERS)
    level = drawn(variance, wv.degrees_of_freedom, curve)
    coarser = np.minimum.outer(tapers, tapers)
    mixed = (coarser * correlation + GAUSSIAN_TAPERS * prior) / (coarser + GAUSSIAN_TAPERS)
    np.fill_diagonal(mixed, 1.0)
    size = level * np.sqrt(relative) * unit**2
    return np.asarray(_definite(mixed, prior) * np.outer(size, size))


def _definite(correlation: Matrix, prior: Matrix) -> Matrix:
    """Average the correlations with the prior ones, with the smallest weight that makes them positive definite."""
    least = 0.1 * float(np.linalg.eigvalsh(prior)[0])
    for share in np.linspace(0.0, 1.0, 21):
        mixed = np.asarray((1.0 - share) * correlation + share * prior)
        if np.linalg.eigvalsh(mixed)[0] >= least:
            break
    return mixed


def _measured(values: Vector, variance: Vector, design: Design) -> tuple[Vector, Matrix, Vector]:
    """Return Var ν̂_j² / ν̂_j⁴ (J,), correlations (J, J), and numbers of tapers (J,), 0 for too few coefficients."""
    # 16 intervals for each of 128 tapers, within which a taper hardly changes.
    size, cell = design.levels.size, -(-design.samples // 2048)
    count = -(-design.samples // cell)
    apart = np.ones(size) if design.transform == "dwt" else np.ldexp(1.0, design.levels)
    # Bandwidth of the tapers relative to 2^−k, and largest number.
    tapers = np.minimum(np.floor(2 * 0.125 * design.counts / apart), 128)
    tapers[tapers < 2] = 0.0
    sums, numbers, moving = np.zeros((size, count)), np.zeros((size, count)), np.ones(size, dtype=bool)
    # Rounding error of a coefficient, a sum over the filter; that of W² is 2 |W| times as large.
    rounding = 8 * np.finfo(float).eps * float(np.abs(values).max()) * design.filter.length
    for a, (places, squares) in enumerate(_squares(values, design)):
        sums[a] = np.bincount(places // cell, squares, count)
        numbers[a] = np.bincount(places // cell, minlength=count)
        moving[a] = tapers[a] == 0 or np.ptp(squares) > 2 * rounding * np.sqrt(squares.max())
    if still := [str(j) for j, moved in zip(design.levels, moving, strict=True) if not moved]:
        raise DataError(
            f"the wavelet coefficients of level {', '.join(still)} do not vary, because the signal is a ramp or "
            "alternates without noise, so the data do not determine its covariance",
            advice=_FROM_A_MODEL,
        )
    share, correlation = np.zeros(size), np.eye(size)
    for b in np.flatnonzero(tapers):
        begin = int(np.argmax(numbers[b] > 0))
        windows = _sine_tapers(count - begin, int(tapers[b]))
        part, number = sums[: b + 1, begin:], numbers[: b + 1, begin:]
        centred = part - number * (part.sum(axis=1) / number.sum(axis=1))[:, None]
        y = centred @ windows.T
        # Subtracting the mean removes a part of the even tapers, which amounts to one taper at most.
        left = tapers[b] - np.sum(8.0 / (np.pi * np.arange(1, int(tapers[b]) + 1, 2)) ** 2)
        length = np.sqrt(np.sum(y * y, axis=1))
        share[b] = (length[b] / (variance[b] * number[b].sum())) ** 2 * (count - begin) / left
        correlation[b, : b + 1] = correlation[: b + 1, b] = (y @ y[b]) / (length * length[b])
    return share, correlation, tapers


def _squares(values: Vector, design: Design) -> Iterator[tuple[Integers, Vector]]:
    """Yield, by level, the times (samples, without gaps) and the squares of the inner coefficients."""
    segments, first = [], 0
    for length in design.lengths:
        segment = design.segment(length, design.counts)
        if segment is not None:
            segments.append((first, _squares_of(values[first : first + length], segment)))
        first += length
    for _ in design.levels:
        here = [(first, *found) for first, squares in segments if (found := next(squares, None)) is not None]
        yield np.concatenate([first + places for first, places, _ in here]), np.concatenate([w for _, _, w in here])


def _squares_of(values: Vector, design: Design) -> Iterator[tuple[Integers, Vector]]:
    """Yield, level by level, the times and the squares of the coefficients of one segment."""
    filter, wanted = design.filter, design.levels.tolist()
    if design.transform == "dwt":
        inner = inner_coefficients(values, filter, "dwt", wanted[-1])
        for j in wanted:
            last = design.samples >> j
            yield (np.arange(last - inner[j - 1].size, last) + 1 << j) - 1, inner[j - 1] ** 2
        return
    smooth, root = values - _core.mean(values), np.sqrt(2.0)
    for j in wanted:
        smooth, detail = _core.pyramid_step(smooth, filter.scaling / root, filter.wavelet / root, 1 << (j - 1))
        begin = filter.width(j) - 1
        yield np.arange(begin, design.samples), detail[begin:] ** 2


def _sine_tapers(size: int, count: int) -> Matrix:
    """Return the orthonormal sine tapers (count, n) v_q(t) = √(2/(n+1)) sin(π (q+1)(t+1)/(n+1)), with n = `size`."""
    angle = np.pi * np.outer(np.arange(1, count + 1), np.arange(1, size + 1)) / (size + 1)
    return np.asarray(np.sqrt(2.0 / (size + 1)) * np.sin(angle))
