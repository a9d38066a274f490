"""The covariance of the wavelet variance from the data alone, Gaussian or not.

ν̂_j² is the mean of the squares S_j(t) = W_{j,t}², so Cov(ν̂_j², ν̂_k²) is the cross-spectrum of S_j and S_k at frequency
0, over M. With K sine tapers v_q over the coefficients that two levels have in common it is the mean over q of
y_j(q) y_k(q), y_j(q) = Σ_t v_q(t) [S_j(t) − ν̂_j²]. The tapers look at frequencies up to (K + 1) / (2M), which must lie
well within 2^−k, the width of what the coarser level's squares have there; so K follows from the number M / 2^k of
independent pieces of data.

Where these are few, so is what the data tell: what is missing is taken from the Gaussian covariance of the mixture of
all processes that is likeliest under the measured curve, which counts for as much as `PRIOR` tapers.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm import _core
from gmwm._arrays import Matrix, Vector
from gmwm.covariance.api import covariance
from gmwm.covariance.design import Design
from gmwm.covariance.mixture import drawn, mixture
from gmwm.errors import DataError
from gmwm.filters import WaveletFilter
from gmwm.signals import Signal
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.transform import Transform, inner_coefficients

PRIOR = 8.0
"""Tapers that the theory counts for beside those of the data."""
BANDWIDTH = 0.125
"""Frequencies that the tapers look at, as a share of 2^−k."""
MOST_TAPERS = 128
_CELLS = 2048
"""Cells that the record is summed into: tapers hardly change in one."""


def empirical_covariance(
    x: Signal | ArrayLike,
    rate: float | None = None,
    *,
    levels: int | None = None,
    filter: str | WaveletFilter = "haar",
    transform: Transform = "modwt",
) -> Matrix:
    """V = Cov(ν̂², ν̂²) of the wavelet variance of a signal, from the signal itself, whatever its law.

    Variances and correlations are

        V_jj = ν_j⁴ (K_j v̂_j + P v⁰_j) / (K_j + P),   r_jk = (K_k r̂_jk + P r⁰_jk) / (K_k + P),

    k the coarser level, with v̂ = (mean over K_j sine tapers of y_j²) / ν̂_j⁴ and r̂ from the data, v⁰ and r⁰ of a
    Gaussian mixture of processes that follows the curve, P = 8, and ν_j² where there are few data drawn to that curve.
    K_k is M_k / 2^(k + 2) (M_k / 4 of the decimated transform), 128 at most; coarse levels, where it is below 2, are
    those of the mixture. If the correlations are not positive definite they are drawn towards r⁰ until they are.

    A level has a standard error of √(2 / K_j) of its variance, 12 % at best. At the coarsest three levels V_jj is
    too large on average, by 1.3 to 2.5, as ν̂⁴ is.

    Parameters
    ----------
    x : Signal, or (N,) array in any unit
        Finite samples, at least 8 without a gap; segments of a Signal are measured together.
    rate : float
        Samples per second (Hz); taken from a Signal.
    levels : int, optional
        Number of levels J; all that have a coefficient by default.
    filter, transform
        As of `wavelet_variance`.

    Returns
    -------
    (J, J) array, in u⁴ for a signal in u

    Raises
    ------
    DataError
        If the signal cannot have a wavelet variance, or that is zero at a level, or its coefficients do not vary.
    OptionError
        If an option is not one of those it may be.

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
    wv = signal_wavelet_variance(x, rate, filter=filter, transform=transform, levels=levels)
    if not np.all(wv.variance > 0):
        zero = ", ".join(str(j) for j in wv.levels[wv.variance <= 0])
        raise DataError(
            f"the wavelet variance is zero at level {zero}: a constant or coarsely quantised signal, whose covariance "
            "cannot be had from the data; take it from a model, wavelet_covariance(model, samples, rate)"
        )
    design = Design.of(wv)
    # By a power of two, which changes no digit, so that fourth powers stay in range.
    unit = 2.0 ** np.floor(0.5 * np.log2(wv.variance.max()))
    variance = wv.variance / unit**2
    values = (x.values if isinstance(x, Signal) else np.asarray(x, dtype=np.float64)) / unit
    curve, model = mixture(variance, wv.degrees_of_freedom, design)
    theory = covariance(model, design)
    variance_share, correlation, tapers = _measured(values, variance, design)

    own = np.diag(theory)
    prior = theory / np.sqrt(np.outer(own, own))
    relative = (tapers * variance_share + PRIOR * own / curve**2) / (tapers + PRIOR)
    level = drawn(variance, wv.degrees_of_freedom, curve)
    coarser = np.minimum.outer(tapers, tapers)
    mixed = (coarser * correlation + PRIOR * prior) / (coarser + PRIOR)
    np.fill_diagonal(mixed, 1.0)
    size = level * np.sqrt(relative) * unit**2
    return np.asarray(_definite(mixed, prior) * np.outer(size, size))


def _definite(correlation: Matrix, prior: Matrix) -> Matrix:
    """The correlations, drawn towards the prior ones as far as they must be to be those of anything."""
    least = 0.1 * float(np.linalg.eigvalsh(prior)[0])
    for share in np.linspace(0.0, 1.0, 21):
        mixed = np.asarray((1.0 - share) * correlation + share * prior)
        if np.linalg.eigvalsh(mixed)[0] >= least:
            break
    return mixed


# --- from the data ------------------------------------------------------------------------------------


def _measured(values: Vector, variance: Vector, design: Design) -> tuple[Vector, Matrix, Vector]:
    """Var ν̂_j² / ν̂_j⁴ (J,), correlations (J, J), and the number of tapers of each level (J,), which may be 0."""
    size, cell = design.levels.size, -(-design.samples // _CELLS)
    count = -(-design.samples // cell)
    apart = np.ones(size) if design.transform == "dwt" else np.ldexp(1.0, design.levels)
    tapers = np.minimum(np.floor(2 * BANDWIDTH * design.counts / apart), MOST_TAPERS)
    tapers[tapers < 2] = 0.0
    sums, numbers, moving = np.zeros((size, count)), np.zeros((size, count)), np.ones(size, dtype=bool)
    # Of a coefficient, a sum of as many products as the filter is long: its square by twice the root times that.
    rounding = 8 * np.finfo(float).eps * float(np.abs(values).max()) * design.filter.length
    for a, (places, squares) in enumerate(_squares(values, design)):
        sums[a] = np.bincount(places // cell, squares, count)
        numbers[a] = np.bincount(places // cell, minlength=count)
        moving[a] = tapers[a] == 0 or np.ptp(squares) > 2 * rounding * np.sqrt(squares.max())
    if still := [str(j) for j, moved in zip(design.levels, moving, strict=True) if not moved]:
        raise DataError(
            f"the wavelet coefficients of level {', '.join(still)} do not vary: a ramp or an alternating signal "
            "without noise, whose covariance cannot be had from the data; take it from a model, "
            "wavelet_covariance(model, samples, rate)"
        )
    share, correlation = np.zeros(size), np.eye(size)
    for b in np.flatnonzero(tapers):
        begin = int(np.argmax(numbers[b] > 0))
        windows = _sine_tapers(count - begin, int(tapers[b]))
        part, number = sums[: b + 1, begin:], numbers[: b + 1, begin:]
        centred = part - number * (part.sum(axis=1) / number.sum(axis=1))[:, None]
        y = centred @ windows.T
        # Subtracting the mean has taken from the even tapers, one of them in all if there are many.
        left = tapers[b] - np.sum(8.0 / (np.pi * np.arange(1, int(tapers[b]) + 1, 2)) ** 2)
        length = np.sqrt(np.sum(y * y, axis=1))
        share[b] = (length[b] / (variance[b] * number[b].sum())) ** 2 * (count - begin) / left
        correlation[b, : b + 1] = correlation[: b + 1, b] = (y @ y[b]) / (length * length[b])
    return share, correlation, tapers


def _squares(values: Vector, design: Design) -> Iterator[tuple[NDArray[np.int64], Vector]]:
    """Times and squares of the coefficients that no boundary reaches, level by level; times count gaps for nothing."""
    segments, first = [], 0
    for length in design.lengths:
        segment = design.segment(length, design.counts)
        if segment is not None:
            segments.append((first, _squares_of(values[first : first + length], segment)))
        first += length
    for _ in design.levels:
        here = [(first, *found) for first, squares in segments if (found := next(squares, None)) is not None]
        yield np.concatenate([first + places for first, places, _ in here]), np.concatenate([w for _, _, w in here])


def _squares_of(values: Vector, design: Design) -> Iterator[tuple[NDArray[np.int64], Vector]]:
    """The same of one segment."""
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
    """v_q(t) = √(2/(n+1)) sin(π (q+1)(t+1)/(n+1)), q = 0 … count − 1, orthonormal: (count, n)."""
    angle = np.pi * np.outer(np.arange(1, count + 1), np.arange(1, size + 1)) / (size + 1)
    return np.asarray(np.sqrt(2.0 / (size + 1)) * np.sin(angle))
