"""Fuse an array of sensors into one virtual sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from gmwm import _core
from gmwm._arrays import Matrix, Vector
from gmwm._text import duration_text
from gmwm.covariance.api import covariance
from gmwm.covariance.mixture import mixture
from gmwm.errors import DataError, OptionError
from gmwm.joint.fusion_result import VirtualAxis, VirtualSensor
from gmwm.joint.matrices import WaveletMatrices, wavelet_matrices
from gmwm.joint.sensor_array import like_axes
from gmwm.signals import Imu, Signal

SPARE = 2.0
"""Degrees of freedom beyond the number of sensors that weights need: with 1, their expected loss is infinite."""


def fuse(
    x: Sequence[Imu] | Mapping[str, Imu | Signal | ArrayLike] | Imu,
    rate: float | None = None,
    *,
    horizon: float,
    nonnegative: bool = False,
) -> VirtualSensor:
    """Compute the weights of the best virtual sensor of an array: the weighted sum of like axes of least noise.

    The weights minimise the wavelet variance at the scale `horizon` among all weights with sum 1, which leave any
    motion unchanged:

        w = Γ̂⁻¹ 1 / (1ᵀ Γ̂⁻¹ 1),

    with Γ̂ the covariance matrix of the Haar coefficients of all signals at this scale, interpolated between the two
    nearest levels. Unlike inverse variances, Γ̂ takes into account noise that the sensors share.

    The weights are estimated from the recording, so its own wavelet variance wᵀ Γ̂_j w is too small. At the scale of
    the weights, with η degrees of freedom, its expected value is (η − d + 1)/η · (η − d)/(η − 1) of the one in other
    recordings, and `variance` is corrected for it. At other scales j the correction is weaker by the regression of
    ν̂²_j on ν̂² at the scale of the weights.

    Parameters
    ----------
    x : sequence of Imu, or mapping
        A recording at rest of each of d units, sampled together; like axes are fused. Or a mapping of names such as
        "gyro_x[2]" to signals or (N,) arrays. Signals whose names have no brackets are all of one axis.
    rate : float
        Sampling rate (Hz); only for plain arrays.
    horizon : float
        Scale (s) at which the variance is minimal.
    nonnegative : bool
        Whether to allow no negative weight. Negative weights remove noise that sensors share, but increase errors of
        scale factor and alignment.

    Returns
    -------
    VirtualSensor

    Raises
    ------
    DataError
        If the signals are not synchronous, or differ in their units.
    OptionError
        If the recording is too short for weights at this scale.

    References
    ----------
    Bates and Granger (1969), The combination of forecasts, Operational Research Quarterly 20, 451-468. Accuracy of the
    prediction: docs/validation/fusion.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> supply = rng.normal(size=20_000)
    >>> units = {f"gyro_x[{k}]": rng.normal(size=20_000) + share * supply for k, share in enumerate((0.2, 1.0, 2.0))}
    >>> virtual = fuse(units, rate=100.0, horizon=1.0)
    >>> virtual["gyro_x"].weights.round(1), f"{virtual['gyro_x'].gain[0]:.2f}"
    (array([ 0.9,  0.3, -0.3]), '1.49')
    """
    horizon = _as_horizon(horizon)
    found = {}
    for axis, signals in like_axes(x, rate).items():
        measured = wavelet_matrices({name: signal.fill_gaps() for name, signal in signals.items()})
        unit = next(iter(signals.values())).unit
        found[axis] = _static(axis, measured, unit, horizon, nonnegative=nonnegative)
    return VirtualSensor(axes=found, horizon=horizon)


def _as_horizon(horizon: float) -> float:
    if isinstance(horizon, bool) or not isinstance(horizon, int | float) or not 0 < horizon < np.inf:
        raise OptionError(argument="horizon", expected="a positive time (s)", got=horizon)
    return float(horizon)


def _static(axis: str, measured: WaveletMatrices, unit: str, horizon: float, *, nonnegative: bool) -> VirtualAxis:
    """The best weights of one axis at the scale `horizon`."""
    gamma, d = measured.values, len(measured.names)
    shares = _shares(measured, horizon)
    target = np.einsum("j,jab->ab", shares, gamma)
    weights = best_weights(target, nonnegative=nonnegative)
    own = np.einsum("a,jab,b->j", weights, gamma, weights)
    optimism = _optimism(measured, own, shares, d=int(np.count_nonzero(weights)))
    return VirtualAxis(
        axis=axis,
        members=measured.names,
        unit=unit,
        weights=weights,
        levels=measured.design.levels,
        rate=measured.design.rate,
        variance=own * optimism,
        average=gamma.sum(axis=(1, 2)) / d**2,
        each=np.einsum("jaa->aj", gamma),
        optimism=optimism,
    )


def _shares(measured: WaveletMatrices, horizon: float) -> Vector:
    """Shares (J,) of the two levels nearest to a scale, linear in its logarithm."""
    at = np.log2(horizon * measured.design.rate) - measured.design.levels[0]
    if not 0 <= at <= measured.design.levels.size - 1:
        low, high = (duration_text(measured.tau[k]) for k in (0, -1))
        raise OptionError(
            f"the scale {horizon:g} s is outside the scales of the recording, {low} to {high}",
            argument="horizon", got=horizon, advice="Choose a scale {--horizon} inside.",
        )  # fmt: skip
    shares = np.zeros(measured.design.levels.size)
    k = min(int(at), shares.size - 2) if shares.size > 1 else 0
    shares[k] = 1 - (at - k)
    if shares.size > 1:
        shares[k + 1] = at - k
    return shares


def best_weights(gamma: Matrix, *, nonnegative: bool = False) -> Vector:
    """The weights (d,) with sum 1 that minimise wᵀ Γ w.

    Raises
    ------
    DataError
        If Γ is singular.
    """
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
        found, _ = _core.nonnegative_least_squares(towards, np.ascontiguousarray(rows))
        weights = found / np.linalg.norm(root, axis=1) / size
    else:
        weights = np.linalg.solve(root.T, towards) / size
    return np.asarray(weights / weights.sum())


def _optimism(measured: WaveletMatrices, own: Vector, shares: Vector, d: int) -> Vector:
    """Factor (J,) from the wavelet variance in the recording itself to the expected one in others.

    With Γ̂ of η degrees of freedom, E 1/(1ᵀΓ̂⁻¹1) = (η − d + 1)/η · 1/(1ᵀΓ⁻¹1), and E wᵀΓw = (η − 1)/(η − d) · 1/(1ᵀΓ⁻¹1)
    (Basak, Jagannathan and Ma 2009, Management Science 55, 990-1002, with a known mean).
    """
    design = measured.design
    curve, model = mixture(own, design.degrees_of_freedom, design, random=True)
    relative = covariance(model, design) / np.outer(curve, curve)
    parts = shares * curve / (shares @ curve)
    scatter = float(parts @ relative @ parts)
    eta = 2 / scatter
    if eta < d + SPARE:
        fitting = measured.tau[2 / np.diag(relative) >= d + SPARE]
        longest = f"of at most {duration_text(fitting[-1])}" if fitting.size else ""
        raise OptionError(
            f"weights of {d} sensors need {d + SPARE:g} degrees of freedom at the scale of the horizon; the recording "
            f"has {eta:.1f}",
            argument="horizon",
            advice="Use a horizon {longest}, or a longer recording." if longest else "Use a longer recording.",
            longest=longest,
        )
    at_weights = eta / (eta - d + 1) * (eta - 1) / (eta - d)
    regression = np.clip(relative @ parts / scatter, 0.0, 1.0)
    return np.asarray(1 / (1 - regression + regression / at_weights))
