"""The covariance of the wavelet variance of a Gaussian signal, exact, from its model."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm import _core
from gmwm._arrays import Matrix, as_levels, as_rate
from gmwm.errors import OptionError
from gmwm.processes.differences import LagGrid
from gmwm.processes.model import Model, ModelLike, as_model


def wavelet_covariance(model: ModelLike, samples: int, rate: float, *, levels: int | ArrayLike | None = None) -> Matrix:
    """V = Cov(ν̂², ν̂²) of the Haar MODWT wavelet variance of a model, for a record of any length.

    For a Gaussian signal

        V_jk = 2 / (M_j M_k) Σ_u n(u) Cov(W_{j,t}, W_{k,t+u})² + 4 μ_j μ_k Σ_u n(u) Cov(W_{j,t}, W_{k,t+u}) / (M_j M_k),

    with n(u) the number of pairs at lag u inside the record and μ_j the mean of W_j, which only a drift has. The
    sums run over all lags: kinks one by one, a Gauss rule for integers in each smooth piece between.

    Parameters
    ----------
    model : Model, Process or str
        With all its values.
    samples : int
        Length N of the record.
    rate : float
        Samples per second (Hz).
    levels : int or (J,) array, optional
        Number of levels, or the levels; all floor(log2 N) by default.

    Returns
    -------
    (J, J) array, in u⁴ for a signal in u

    Raises
    ------
    OptionError
        If the record is shorter than a level.
    MissingTheoryError
        If a process has no closed form of it.

    Examples
    --------
    >>> from gmwm import WN
    >>> wavelet_covariance(WN(sigma2=1.0), samples=1000, rate=1.0, levels=2).round(7)
    array([[0.0007505, 0.0001876],
           [0.0001876, 0.0002192]])
    """
    whole, rate = as_model(model), as_rate(rate)
    if isinstance(samples, bool) or not isinstance(samples, int | np.integer) or samples < 2:
        raise OptionError(f"samples must be an integer of at least 2, got {samples!r}")
    wanted = as_levels(int(samples).bit_length() - 1 if levels is None else levels)
    if wanted[-1] >= int(samples).bit_length():
        raise OptionError(
            f"level {wanted[-1]} needs {1 << int(wanted[-1])} samples, got samples={samples}; take fewer levels"
        )
    return _covariance(whole, int(samples), rate, wanted)


def _covariance(model: Model, samples: int, rate: float, levels: NDArray[np.int64]) -> Matrix:
    present = [process for process in model.processes if process.scale > 0]
    decays = [decay for process in present for decay in process.decays(rate)]
    finer, coarser, lag, weight, odd = _core.covariance_lags(
        levels, samples, min((abs(d) for d in decays), default=0.0), max((abs(d) for d in decays), default=0.0),
        any(d < 0 for d in decays),
    )  # fmt: skip
    half = np.ldexp(1.0, levels - 1)
    at = LagGrid(half[finer], half[coarser], lag, odd.astype(bool))
    covariance = np.zeros_like(lag)
    for process in present:
        covariance += process.coefficient_covariance(at, rate)
    covariance /= 4 * at.fine * at.coarse
    size = levels.size
    counts = samples - 2 * half + 1
    mean = half / 2 * sum(float(process.mean(1.0) - process.mean(0.0)) for process in model.processes)
    terms = 2 * covariance**2
    if np.any(mean):
        terms += 4 * mean[finer] * mean[coarser] * covariance
    upper = np.bincount(finer * size + coarser, weight * terms, size * size).reshape(size, size)
    return np.asarray((np.triu(upper) + np.triu(upper, 1).T) / np.outer(counts, counts))
