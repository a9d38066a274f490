"""Fitting a model: the Generalized Method of Wavelet Moments."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from gmwm._arrays import Matrix
from gmwm.errors import FitWarning, ModelError, OptionError
from gmwm.estimation.problem import pose, to_find
from gmwm.estimation.result import Diagnostics, Fit
from gmwm.estimation.reweighting import REWEIGHTED, First, Settled, settle
from gmwm.estimation.solver import estimated, final, solve, solve_near, solve_sampled
from gmwm.estimation.starts import Sampled
from gmwm.estimation.weighting import Weighting, usual_weighting, weighting_matrix, weighting_remarks
from gmwm.filters import find_filter
from gmwm.processes.base import Process
from gmwm.processes.equivalence import likeness
from gmwm.processes.model import Model, as_model
from gmwm.remarks import Quantity, Remark
from gmwm.signals import Signal
from gmwm.variance.api import signal_wavelet_variance
from gmwm.variance.biweight import EFFICIENCY, require_robust
from gmwm.variance.result import WaveletVariance

NEAR = 1e-6
"""Change of the curve (relative) from which on a test does not feel the weights."""


def fit(
    model: Model | Process | str,
    data: WaveletVariance | Signal | ArrayLike,
    rate: float | None = None,
    *,
    weighting: Weighting | None = None,
    robust: bool = False,
    efficiency: float = 0.6,
    certify: bool = True,
    start: Sampled | None = None,
) -> Fit:
    """Fit a sum of latent processes to a signal or to its wavelet variance.

    θ̂ = argmin (ν̂ − ν(θ))ᵀ Ω (ν̂ − ν(θ)), the global minimum: no starting values and no random numbers are
    needed, and the fit carries a lower bound that proves it. A process with several parameters of its shape, as an
    autoregression of order 2, has no such proof: it is the best of the local optima that a scan of all its shapes leads
    to, each with all other processes at their best. Correlation times are sought from where a process is
    white noise (β = 40 rate) to where it is a random walk to this record (β = 1e-10 rate / N; 1 − φ = 1e-5 / N);
    a term that ends there is reported as acting as WN or RW.

    Parameters
    ----------
    model : Model, Process or str
        What to fit, as ``3 * GM() + WN() + RW()`` or ``"3*GM + WN + RW"``. Values given in it are tried as
        starting values too; those in ``fixed(…)`` are held.
    data : WaveletVariance, Signal, or (N,) array in any unit
        What to fit it to.
    rate : float, optional
        Samples per second (Hz); needed with a plain array only.
    weighting : "diagonal", "optimal", "identity", (J,) or (J, J) array, optional
        Ω: 1 / V_jj or V⁻¹ with the exact covariance V of ν̂² under the fitted model (the estimate and its weights
        are iterated until they agree), the identity, or your own. "optimal" has the smallest errors if the model
        is right; those of "diagonal", which takes less time, are 3 % larger, 18 % at worst, but of a process with
        several parameters of its shape, as AR(2), by a half and more. So the default is "optimal" where the model has
        one, else "diagonal". Where the model is wrong, neither is the safer (docs/validation/weighting.md).
        "identity" sees the largest levels alone: errors are many times larger, and intervals do not cover; for
        comparison only.
    robust, efficiency : bool, float
        Whether to measure a signal by the robust wavelet variance, which outliers do not reach, and its efficiency;
        a WaveletVariance is what it is, and asking for a robust fit to a classical one is an error, as is an efficiency
        without robust=True.
    certify : bool
        Whether to prove by branch and bound that no better fit exists; False skips the proof.
    start : Sampled, optional
        Start from random draws as the paper does, ``Sampled(draws=20_000, rng=1)``, and descend from the best of them.
        For comparison only; where there is a proof, it then tells what the draws have missed.

    Returns
    -------
    Fit

    Raises
    ------
    ModelError
        If the model has more parameters than there are levels, or nothing to estimate, or the data are constant.
    DataError
        If the data cannot be used (see `wavelet_variance`).
    OptionError
        If an option is not one of those it may be, or contradicts the data.

    Warns
    -----
    FitWarning
        If a term is not supported by the data or acts as another process, or the weights look like a covariance.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), Wavelet-variance-based estimation for composite
    stochastic processes, JASA 108, 1021-1030; equation 3 of Balamuta, Guerrier, Molinari and Yang.

    Examples
    --------
    >>> import numpy as np
    >>> from gmwm import RW, WN, fit
    >>> rng = np.random.default_rng(3)
    >>> truth = WN(sigma2=4e-6) + RW(gamma2=1e-10)
    >>> found = fit(WN() + RW(), truth.simulate(100_000, 100.0, rng), rate=100.0)
    >>> print(f"{found.parameters['WN.sigma2']:.2e}")
    4.00e-06
    """
    wanted = as_model(model)
    if start is not None and not isinstance(start, Sampled):
        raise OptionError(f"start must be Sampled(draws=…, rng=…), got {start!r}; values to start from go in the model")
    wv = measured(data, rate, robust, efficiency)
    first = None if start is None else _draws(start, wv, data)
    chosen = usual_weighting(wanted) if weighting is None else weighting
    found = _fitted(wanted, wv, chosen, certify=certify, first=first)
    for remark in found.diagnostics.remarks:
        warnings.warn(FitWarning(remark), stacklevel=2)
    return found


def refitted(fit: Fit, wv: WaveletVariance) -> Fit:
    """The model of a fit, fitted to almost the same data; "diagonal" stands in for weights of the user."""
    if fit.weighting not in REWEIGHTED:
        return _fitted(fit.model, wv, "diagonal", certify=False)
    settled = settle(
        fit.model, wv, fit.weighting, certify=False, start=fit.model, fixed=NEAR,
        first=solve_near, search=not any(len(to_find(process)) > 1 for process in fit.model.processes),
    )  # fmt: skip
    return as_fit(settled, wv, fit.weighting)


def _draws(start: Sampled, wv: WaveletVariance, data: WaveletVariance | Signal | ArrayLike) -> First:
    """The first solution from random draws; drifts go by the range of the data, or by their rise if that is known."""
    if isinstance(data, WaveletVariance):
        spread = abs(wv.slope or 0.0)
    else:
        values = np.asarray(data.values if isinstance(data, Signal) else data, dtype=np.float64)
        spread = float(np.ptp(values)) / values.size
    return lambda problem: solve_sampled(problem, wv, start, spread)


def _fitted(
    model: Model, wv: WaveletVariance, weighting: Weighting, *, certify: bool, first: First | None = None
) -> Fit:
    if isinstance(weighting, str) and weighting in REWEIGHTED:
        return as_fit(settle(model, wv, weighting, certify=certify, first=first), wv, weighting)
    matrix = weighting_matrix(weighting, wv)
    problem = pose(model, wv, matrix)
    solution = solve(problem, certify=certify) if first is None else final(problem, first(problem), certify=certify)
    settled = Settled(problem, solution, weighting_remarks(matrix, wv))
    return as_fit(settled, wv, weighting if isinstance(weighting, str) else "matrix")


def measured(
    data: WaveletVariance | Signal | ArrayLike, rate: float | None, robust: bool, efficiency: float
) -> WaveletVariance:
    """The wavelet variance that models are fitted to: that of a signal, or one that no option contradicts."""
    if isinstance(data, WaveletVariance):
        if rate is not None and rate != data.rate:
            raise OptionError(f"rate={rate:g} contradicts the wavelet variance's {data.rate:g} Hz; leave rate out")
        wv = _as_measured(data, robust, efficiency)
    else:
        wv = signal_wavelet_variance(data, rate, robust=robust, efficiency=efficiency)
    if not np.any(wv.variance > 0):
        raise ModelError("a constant signal has no noise to model: its wavelet variance is zero at every level")
    return wv


def _as_measured(wv: WaveletVariance, robust: bool, efficiency: float) -> WaveletVariance:
    """The wavelet variance itself; options that belong to measuring must not contradict it."""
    if robust and not wv.robust:
        raise OptionError(
            "robust=True asks for robust fits of a classical wavelet variance; pass the signal, or measure it with "
            "wavelet_variance(x, robust=True)"
        )
    if not wv.robust:
        require_robust(robust, efficiency)
    elif efficiency not in (EFFICIENCY, wv.efficiency):
        raise OptionError(
            f"efficiency={efficiency!r} contradicts the wavelet variance's {wv.efficiency:g}; leave it out, "
            "or pass the signal"
        )
    return wv


def as_fit(settled: Settled, wv: WaveletVariance, weighting: str) -> Fit:
    """A solved problem in the words of its model."""
    problem, solution = settled.problem, settled.solution
    processes = estimated(problem, solution, wv.slope).processes
    model = Model(processes).sorted(wv.rate)
    label = {id(process): term for term, process in zip(model.terms, model.processes, strict=True)}
    found = {label[id(processes[place])]: term for place, term in zip(problem.shaped, solution.terms, strict=True)}
    free = (*problem.linear, *problem.shaped)
    acts_as = {name: term.acts_as for name, term in sorted(found.items()) if term.acts_as is not None}
    zero = tuple(sorted(label[id(processes[place])] for place in free if processes[place].scale == 0))
    remarks = (*_of_terms(model, acts_as, zero, wv, problem.matrix), *settled.remarks)
    diagnostics = Diagnostics(
        acts_as=acts_as, not_supported=zero, nodes=solution.nodes, start=solution.start, remarks=remarks
    )
    return Fit(
        wavelet_variance=wv,
        model=model,
        parameters={name: v for name, v in model.parameters.items() if v is not None},
        objective=solution.objective,
        lower_bound=solution.lower_bound,
        relaxed_bound=solution.relaxed_bound,
        implied=model.wavelet_variance(wv.levels, wv.rate, wv.filter),
        decomposition=model.decomposition(wv.levels, wv.rate, wv.filter),
        weighting=weighting,
        weighting_matrix=problem.matrix,
        diagnostics=diagnostics,
    )


def _of_terms(
    model: Model, acts_as: Mapping[str, str], zero: Sequence[str], wv: WaveletVariance, matrix: Matrix
) -> Iterator[Remark]:
    """What to know about each term: what it acts as, whether the data support it, and what its process says."""
    processes = dict(zip(model.terms, model.processes, strict=True))
    for term, name in acts_as.items():
        like = likeness(
            processes[term], name, levels=wv.levels, rate=wv.rate, filter=find_filter(wv.filter), matrix=matrix
        )
        if like is None:
            yield Remark.of("acts-as", wv.axis, term=term, process=name, known="no")
        else:
            parameter = like.scale_parameter()
            yield Remark.of(
                "acts-as",
                wv.axis,
                term=term,
                process=name,
                known="yes",
                parameter=f"{like.name}.{parameter.name}",
                amount=Quantity(like.value(parameter.name), parameter.unit(wv.unit)),
            )
    for term in zero:
        yield Remark.of("term-zero", wv.axis, term=term)
    for term, process in processes.items():
        if process.scale > 0 and term not in acts_as:
            yield from (remark.about(wv.axis) for remark in process.remarks(term, wv.samples, wv.rate))
