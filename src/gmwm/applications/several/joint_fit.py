"""Fit a model of several signals at once: `gmwm.fit_joint`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from numpy.typing import ArrayLike

from gmwm.applications.several.certificate import Prover
from gmwm.applications.several.fitting import JointSolution, chosen_signals, measured_at, settle
from gmwm.applications.several.joint_result import JointFit
from gmwm.applications.several.moments import lag_products
from gmwm.applications.several.search import descend
from gmwm.applications.several.terms import joint_terms
from gmwm.base.errors import OptionError
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.processes.model import ModelLike


def fit_joint(
    model: ModelLike, x: Imu | Mapping[str, Signal | ArrayLike], rate: float | None = None, *,
    axes: str | Sequence[str] | None = None, levels: int | Sequence[int] | None = None, certify: bool | float = False,
) -> JointFit:  # fmt: skip
    """Fit a sum of noise processes to several signals at once, including the noise that they share.

    Each term p of the model has a shape κ_p(τ), the wavelet variance of its process at unit scale, and a covariance
    matrix Σ_p of its noise in the d signals:

        Γ_j = Σ_p κ_p(τ_j) Σ_p,

    with Γ_j the covariance matrix of the wavelet coefficients at level j. A plain term such as "RW" is independent
    noise of each signal: Σ_p is diagonal. "common(RW)" is one process that occurs in all signals with a factor for each
    signal: Σ_p = ℓℓᵀ, with ℓ (d,) the vector of factors. "shared(RW)" allows any positive semidefinite Σ_p. For given
    shapes, the fit is a convex problem. Correlation times are searched from several starting values. The weight matrix
    is the inverse of the exact covariance matrix of all wavelet variances and cross-covariances under the model.

    Parameters
    ----------
    model : str or Model
        The terms, such as "common(RW) + GM + shared(WN)". A shape parameter with a value in fixed(…) is not estimated.
    x : Imu, or mapping of name to Signal or (N,) array
        Two to twelve signals that were sampled together.
    rate : float, optional
        Sampling rate (Hz); only for plain arrays.
    axes : str or sequence of str, optional
        The signals to use, such as "gyro" or ["gyro_x", "accel_z"]; all by default.
    levels : int or sequence of int, optional
        The levels to use, or the number of finest levels to use. By default, all levels with at least five coefficients
        per scale are used. Leave out fine levels that the noise model does not describe, for example levels that a
        low-pass filter in the sensor changes.

    certify : bool or float
        Whether to compute a lower bound on the objective by branch and bound, for a model with unknown correlation
        times. A number is the time limit (s); True is 60 s. The computation takes a few seconds for one Gauss-Markov
        term of three signals, and up to several minutes for two. If the time is not enough, the bound is not tight, and
        `fit.proved` is False. A model without unknown correlation times always has a bound.

    Returns
    -------
    JointFit

    Raises
    ------
    ModelError
        If the model cannot be read, or a term cannot be shared.
    DataError
        If the signals are not synchronous, or too short for the model.
    OptionError
        If an axis or a level does not exist.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), JASA 108, 1021-1030, for one signal. The measured rejection
    rates of the tests and the coverage of the intervals are in docs/validation/joint.md.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> supply = np.cumsum(0.02 * rng.normal(size=20_000))
    >>> shares = {"x": 1.0, "y": -0.5, "z": 0.8}
    >>> units = {axis: rng.normal(size=20_000) + share * supply for axis, share in shares.items()}
    >>> found = fit_joint("shared(RW) + WN", units, rate=100.0)
    >>> found.correlation["RW"].round(1)
    array([[ 1., -1.,  1.],
           [-1.,  1., -1.],
           [ 1., -1.,  1.]])
    >>> found.shared("RW").pvalue < 0.001
    True
    """
    if certify is not False and (not isinstance(certify, int | float) or not certify > 0):
        raise OptionError(argument="certify", expected="True, False or a positive time (s)", got=certify)
    seconds = 60.0 if certify is True else float(certify)
    terms = joint_terms(model)
    signals = chosen_signals(x, rate, axes)
    unknowns = len(terms) + sum(term.branch is not None for term in terms)
    settled = settle(terms, measured_at(signals, levels, unknowns))
    bounds, settled = _bounds(settled, seconds)
    return JointFit.of(settled, {name: signal.unit for name, signal in signals.items()}, bounds)


def _bounds(settled: JointSolution, seconds: float) -> tuple[tuple[float, float] | None, JointSolution]:
    """Return `JointFit.lower_bound` and `JointFit.relaxed_bound`, or None without a proof, and the best fit."""
    problem, estimate = settled.problem, settled.estimate
    if not problem.search_places:
        convex = problem.solve(estimate.u)
        bound = min(convex.objective - convex.gap, estimate.objective)
        return (bound, bound), settled
    if not seconds:
        return None, settled
    single = any(term.kind == "common" for term in problem.terms)
    proof = Prover(problem).prove(descend(problem, estimate.u) if single else estimate, seconds)
    if not single and proof.best.objective < estimate.objective:
        products = lag_products(problem.processes(proof.best.u), problem.design)
        settled = replace(settled, estimate=proof.best, products=products)
    return (proof.lower_bound, proof.relaxed_bound), settled
