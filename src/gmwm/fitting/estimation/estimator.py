"""Fit a model by the Generalized Method of Wavelet Moments with `gmwm.fit`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import as_vector, require_rate
from gmwm.base.errors import DataError, FitWarning, ModelError, OptionError
from gmwm.base.reporting import warn
from gmwm.fitting.estimation.conditions import fit_conditions
from gmwm.fitting.estimation.conditions_fit import ConditionsFit
from gmwm.fitting.estimation.moving_condition import divide
from gmwm.fitting.estimation.problem import pose
from gmwm.fitting.estimation.result import Fit
from gmwm.fitting.estimation.reweighting import REWEIGHTED, First, WeightedSolution, settle
from gmwm.fitting.estimation.solver import final, solve, solve_sampled
from gmwm.fitting.estimation.starts import Sampled
from gmwm.fitting.estimation.weighting import Weighting, usual_weighting, weighting_matrix, weighting_remarks
from gmwm.measuring.axis_results import ResultsByAxis, signals_of
from gmwm.measuring.covariance.tails import with_tails
from gmwm.measuring.regression.against import Against, Asked
from gmwm.measuring.regression.api import regressed_variance
from gmwm.measuring.variance.api import wavelet_variance
from gmwm.measuring.variance.biweight import EFFICIENCY, require_robust
from gmwm.measuring.variance.pooling import pool
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Imu, Signal
from gmwm.theory.filters import find_filter
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.model import Model, as_model

Curve = WaveletVariance | Signal | ArrayLike  # a recording, or its wavelet variance
OneOrSeveral = Curve | Sequence[WaveletVariance] | Sequence[Signal]  # one recording, or several recordings of one unit


@overload
def fit(
    model: Model | Process | str, data: Imu | Mapping[str, Curve], rate: float | None = None, *,
    weighting: Weighting | None = None, robust: bool = False, efficiency: float = 0.6, certify: bool = True,
    start: Sampled | None = None, against: Against = None, moments: str = "haar",
) -> ResultsByAxis[Fit]: ...  # fmt: skip
@overload
def fit(
    model: Model | Process | str, data: Signal, rate: None = None, *, weighting: Weighting | None = None,
    robust: bool = False, efficiency: float = 0.6, certify: bool = True, against: Against, varies: Mapping[str, str],
) -> ConditionsFit: ...  # fmt: skip
@overload
def fit(
    model: Model | Process | str, data: OneOrSeveral, rate: float | None = None, *, weighting: Weighting | None = None,
    robust: bool = False, efficiency: float = 0.6, certify: bool = True, start: Sampled | None = None,
    against: Against = None, moments: str = "haar",
) -> Fit: ...  # fmt: skip
@overload
def fit(
    model: Model | Process | str, data: Mapping[float, Curve], rate: float | None = None,
    *, weighting: Weighting | None = None, robust: bool = False, efficiency: float = 0.6, certify: bool = True,
    varies: Mapping[str, str] | None = None,
) -> ConditionsFit: ...  # fmt: skip
def fit(
    model: Model | Process | str, data: Imu | OneOrSeveral | Mapping[str, Curve] | Mapping[float, Curve],
    rate: float | None = None, *, weighting: Weighting | None = None, robust: bool = False, efficiency: float = 0.6,
    certify: bool = True, start: Sampled | None = None, against: Against = None,
    varies: Mapping[str, str] | None = None, moments: str = "haar",
) -> Fit | ConditionsFit | ResultsByAxis[Fit]:  # fmt: skip
    """Fit a sum of noise processes to a signal or to its wavelet variance.

    The estimate is the global minimum θ̂ = argmin (ν̂ − ν(θ))ᵀ Ω (ν̂ − ν(θ)), where ν̂ is the measured wavelet
    variance, ν(θ) is the wavelet variance of the model and Ω is the weighting matrix. It needs no starting values and
    no random numbers. The fit includes a lower bound on the objective, which proves that the minimum is global.

    There is no such proof if a process has several shape parameters, for example an autoregression of order 2. Its
    parameters are then scanned, and the fit is the best local optimum that is reached from the points of the scan.

    Correlation times range from white noise (β = 40 rate) to a process that is a random walk over the whole recording
    (β = 1e-10 rate / N, or 1 − φ = 1e-5 / N). If a term is estimated at an end of this range, a remark says that it
    acts as WN or RW.

    Parameters
    ----------
    model : Model, Process or str
        Model to fit, for example ``3 * GM() + WN() + RW()`` or ``"3*GM + WN + RW"``. Values in the model are used as
        additional starting values; values in ``fixed(…)`` are not changed.
    data : WaveletVariance, Signal, (N,) array in any unit; a list of these; or mapping of condition to one of these
        Data to which the model is fitted. A list contains several recordings of one unit. The model is then fitted to
        the mean of their curves, `fit.replicates` tests whether the recordings have equal parameters, and intervals
        include the spread between them. A mapping such as ``{0.0: rest, 50.0: slow, 100.0: fast}`` contains recordings
        at known conditions, for example rates of a turntable or plateaus of a chamber.
        An Imu, an (N, k) array, or a mapping of axis to signal or curve is fitted axis by axis.
    rate : float, optional
        Sampling rate (Hz) of a plain array; 1 by default, so that times count samples.
    weighting : "diagonal", "optimal", "identity", (J,) or (J, J) array, optional
        Weighting matrix Ω, where V is the exact covariance of ν̂² under the fitted model
        (docs/validation/weighting.md):

        - "diagonal" is 1 / V_jj and the default. Standard errors are typically 3 % and at most 18 % larger than with
          "optimal".
        - "optimal" is V⁻¹. It is the default if a process has several shape parameters, for example AR(2), for which
          standard errors with "diagonal" are larger by a half or more. Its estimates have the smallest errors if the
          model is correct.
        - "identity" is for comparison only. Only the largest levels count, standard errors are many times larger, and
          confidence intervals do not have their nominal coverage.
        - An array is your own diagonal, or your own positive definite matrix. Levels with the weight 0 are left out.

        With "diagonal" and "optimal", the estimate and its weights are iterated until they agree. If the model is
        wrong, neither of them is safer. MA and ARMA models need more `moments`, or `fit_ml` with this fit as its start
        (docs/concepts/moments.md).
    robust : bool
        Whether to fit the robust wavelet variance of a signal, which outliers hardly affect. If `data` is a
        WaveletVariance, it must be robust itself.
    efficiency : float
        Efficiency of the robust wavelet variance, relative to the classical one; only with robust=True.
    certify : bool
        Whether to prove by branch and bound that no better fit exists.
    start : Sampled, optional
        Random starting values, for example ``Sampled(draws=20_000, rng=1)``, for comparison only. The fit then starts
        from the best of the draws. With `certify`, the lower bound shows by how much the draws missed the optimum.

    against : str, (N,) array, Signal, or mapping of name to these, optional
        Conditions whose effect is removed from the signal before the fit, for example
        ``{"temperature:2,lag": imu.temperature}`` or "time + season:1y + step:2000d"; see docs/howto/temperature.md.
        Intervals and tests account for what the regression removes from the noise; `fit.regression` has its
        coefficients. The recording has one offset, and a new one after a gap in which the sensor restarted. With
        "offsets" (``"time + offsets"``, ``{"trend": t, "offsets": None}``), every part without a gap has its own.
    varies : mapping of term to str, optional
        Dependence of the variance of a term on the condition, for recordings at known conditions, or for a Signal
        during which the condition in `against`, such as ``{"rate": values}``, moves. It is a sum of known functions
        with unknown coefficients that are zero or positive, for example ``{"WN": "1 + rate**2"}``. Functions are 1,
        powers of a name, abs(name), and hats(0, 25, 50), which is piecewise linear. ``{"GM.beta": "rate"}`` is the
        shape β(rate) = exp(a + b rate), and ``{"AR1.phi": "rate"}`` φ(rate) = tanh(a + b rate); a and b are searched
        on a bounded grid, without a certificate. Other terms are the same at all conditions; see
        docs/howto/conditions.md.
    moments : str
        Moments of the signal to which the model is fitted. "haar" is the wavelet variance. "haar + lags:8" adds the
        autocovariances of first differences at the lags 1 to 8, and "haar + lags:3,5" at 3 and 5 (the augmented GMWM,
        GMWM+). Standard errors of MA and ARMA models are then within 1.05 to 1.2 of maximum likelihood, instead of 2 to
        5 times as large; sensor models gain 3 % at most. Lags must reach as far as the moving average; see
        docs/concepts/moments.md. `fit.wavelet_variance` has the moment of the lag l at the level −l.

    Returns
    -------
    Fit; for an Imu or several columns a mapping of axis to Fit
        Estimates, objective with its lower bound, fitted curve and remarks. With `varies` or recordings at known
        conditions, the result is a `gmwm.estimation.ConditionsFit`.

    Raises
    ------
    ModelError
        If the model has more parameters than the data have levels, if it has no free parameter, or if the data are
        constant.
    DataError
        If the wavelet variance of the data cannot be computed (see `wavelet_variance`).
    OptionError
        If an option has an invalid value or contradicts the data.

    Warns
    -----
    FitWarning
        If a term is estimated as zero, if a term acts as another process, or if `weighting` looks like a covariance.

    References
    ----------
    Guerrier, Skaloud, Stebler and Victoria-Feser (2013), Wavelet-variance-based estimation for composite
    stochastic processes, JASA 108, 1021-1030; equation 3 of Balamuta, Guerrier, Molinari and Yang. Moments at lags:
    Guerrier, Molinari and Stebler (2016), Wavelet-based improvements for inertial sensor error modeling, IEEE Trans.
    Instrum. Meas. 65, 2693-2700.

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
    if not isinstance(data, WaveletVariance) and (signals := signals_of(data)) is not None:
        if varies is not None:
            raise OptionError(argument="varies", expected="left out for the axes of a recording", got=varies)
        options: dict[str, Any] = {"weighting": weighting, "robust": robust, "efficiency": efficiency}
        options |= {"certify": certify, "start": start, "against": against, "moments": moments}
        return ResultsByAxis(results={axis: fit(model, x, rate, **options) for axis, x in signals.items()})
    terms = as_model(model)
    if start is not None and not isinstance(start, Sampled):
        raise OptionError(
            argument="start", expected="a gmwm.estimation.Sampled object", got=start,
            advice="Write starting values into the model, for example `GM(beta=0.1)`.",
        )  # fmt: skip
    if isinstance(data, Mapping):
        return _fitted_conditions(
            terms, cast("Mapping[float, Curve]", data), rate, varies, weighting=weighting, robust=robust,
            efficiency=efficiency, certify=certify,
            others={"start": start, "against": against, "moments": None if moments == "haar" else moments},
        )  # fmt: skip
    if varies is not None:
        if not isinstance(data, Signal) or against is None or start is not None or moments != "haar":
            raise OptionError(
                "varies needs recordings at known conditions, or a Signal with the condition in against",
                argument="varies", got=varies,
                advice="Pass a mapping, for example `{{0.0: rest, 50.0: slow}}`, or `against={{'rate': values}}`.",
            )  # fmt: skip
        return _moving_condition(
            terms, data, varies, against, weighting=weighting, robust=robust, efficiency=efficiency, certify=certify
        )
    recordings = cast("OneOrSeveral", data)
    wv = measure(recordings, rate, robust, efficiency, against=against, moments=moments)
    first = None if start is None else _draws(start, wv, recordings)
    chosen = usual_weighting(terms, wv) if weighting is None else weighting
    chosen, wv = _with_weight(chosen, wv)
    result = fit_quietly(terms, wv, chosen, certify=certify, first=first)
    for remark in result.diagnostics.remarks:
        warn(FitWarning(remark), stacklevel=2)
    return result


def _fitted_conditions(
    model: Model, data: Mapping[float, Curve], rate: float | None,
    varies: Mapping[str, str] | None, *, weighting: Weighting | None, robust: bool, efficiency: float, certify: bool,
    others: Mapping[str, object],
) -> ConditionsFit:  # fmt: skip
    """Check the options of a fit to recordings at known conditions, and fit them."""
    for name, value in others.items():
        if value is not None:
            raise OptionError(argument=name, expected="left out with recordings at known conditions", got=value)
    keys: list[object] = list(data)
    bad = [key for key in keys if isinstance(key, bool) or not isinstance(key, int | float | np.number)]
    if bad or not all(math.isfinite(key) for key in data):
        raise OptionError(argument="data", expected="conditions that are finite numbers", got=bad[0] if bad else keys)
    curves = {float(condition): measure(curve, rate, robust, efficiency) for condition, curve in data.items()}
    return fit_conditions(model, curves, varies or {}, weighting=_reweighted(weighting), certify=certify)


def _reweighted(weighting: Weighting | None) -> str:
    """Return the kind of the weights of a fit at known conditions, "diagonal" by default."""
    chosen = "diagonal" if weighting is None else weighting
    if not isinstance(chosen, str) or chosen not in REWEIGHTED:
        raise OptionError(argument="weighting", expected="'diagonal' or 'optimal' with known conditions", got=weighting)
    return chosen


def _moving_condition(
    model: Model, signal: Signal, varies: Mapping[str, str], against: Against, *, weighting: Weighting | None,
    robust: bool, efficiency: float, certify: bool,
) -> ConditionsFit:  # fmt: skip
    """Fit a model to a recording during which the condition `against` changes."""
    from gmwm.fitting.estimation.varies import parse_varies

    _, _, named = parse_varies(varies)
    name, bins = divide(signal, against, robust=robust, efficiency=efficiency)
    if named not in ("condition", name):
        raise OptionError(argument="varies", expected=f"functions of {name}, as in against", got=named)
    curves = {float(np.mean(c)): wv for c, wv in zip(bins.conditions, bins.curves, strict=True)}
    result = fit_conditions(model, curves, varies, weighting=_reweighted(weighting), certify=certify, bins=bins)
    return replace(result, condition=name)


def _with_weight(weighting: Weighting, wv: WaveletVariance) -> tuple[Weighting, WaveletVariance]:
    """Leave out the levels whose weights of the user are all zero."""
    if isinstance(weighting, str):
        return weighting, wv
    matrix = np.asarray(weighting)
    if matrix.shape not in ((len(wv),), (len(wv), len(wv))) or matrix.dtype.kind not in "iuf":
        return weighting, wv
    used = matrix != 0 if matrix.ndim == 1 else np.any(matrix != 0, axis=0)
    if np.all(used) or not np.any(used):
        return weighting, wv
    return matrix[used] if matrix.ndim == 1 else matrix[np.ix_(used, used)], wv.only(wv.levels[used].tolist())


def _draws(start: Sampled, wv: WaveletVariance, data: OneOrSeveral) -> First:
    """Return the solver that starts from random draws, with drifts scaled by the range of samples or the slope."""
    if isinstance(data, WaveletVariance) or wv.recordings:
        spread = abs(wv.slope or 0.0)
    else:
        values = np.asarray(data.values if isinstance(data, Signal) else data, dtype=np.float64)
        spread = float(np.ptp(values)) / values.size
    return lambda problem: solve_sampled(problem, wv, start, spread)


def fit_quietly(
    model: Model, wv: WaveletVariance, weighting: Weighting, *, certify: bool, first: First | None = None
) -> Fit:
    """Fit a model like `fit`, but without Python warnings, because threads share the warning filters."""
    if isinstance(weighting, str) and weighting in REWEIGHTED:
        return Fit.of(settle(model, wv, weighting, certify=certify, first=first), wv, weighting)
    matrix = weighting_matrix(weighting, wv)
    problem = pose(model, wv, matrix)
    solution = solve(problem, certify=certify) if first is None else final(problem, first(problem), certify=certify)
    settled = WeightedSolution(problem, solution, weighting_remarks(matrix, wv))
    return Fit.of(settled, wv, weighting if isinstance(weighting, str) else "matrix")


def measure(
    data: OneOrSeveral, rate: float | None, robust: bool, efficiency: float, against: Against = None,
    moments: str = "haar",
) -> WaveletVariance:  # fmt: skip
    """Return the wavelet variance to fit, pooled for several recordings; OptionError if options contradict the data."""
    conditions = Asked.of(against)
    if conditions.terms and moments != "haar":
        raise OptionError(
            argument="moments", expected="'haar' together with against", got=moments,
            advice="Use `fit_ml(…, against=…)`, which has the errors of maximum likelihood, or leave {--moments} out.",
        )  # fmt: skip
    several = _several(data)
    if several is None:
        return _measure(cast("Curve", data), rate, robust, efficiency, asked=conditions, moments=moments)
    if not several:
        raise DataError(argument="data", expected="at least one recording", got=data)
    if any(term.is_measured for term in conditions.terms):
        raise OptionError(
            "against has an array, which belongs to one recording, but there are several",
            argument="against",
            advice="Remove its effect from each recording by `wavelet_variance(x, against=…)`, and pass the curves.",
        )
    curves = [_measure(recording, rate, robust, efficiency, asked=conditions, moments=moments) for recording in several]
    return pool({str(k): wv for k, wv in enumerate(curves, start=1)})


def _several(data: object) -> list[Curve] | None:
    """Return the list of recordings; None if `data` is a single recording, which may also be a list of numbers."""
    if isinstance(data, list | tuple) and all(isinstance(x, WaveletVariance | Signal | np.ndarray) for x in data):
        return list(data)
    return None


def _measure(
    data: Curve, rate: float | None, robust: bool, efficiency: float, *, asked: Asked, moments: str
) -> WaveletVariance:
    if asked.terms:
        wv = regressed_variance(data, rate, asked, robust=robust, efficiency=efficiency)
    elif isinstance(data, WaveletVariance):
        require_rate(rate, data.rate, "wavelet variance")
        wv = _as_measured(data, robust, efficiency)
        if find_filter(moments).lags and wv.filter != find_filter(moments).name:
            raise OptionError(
                argument="moments", expected="left out for a wavelet variance, which has its own moments", got=moments,
                advice="Pass the signal.",
            )  # fmt: skip
    else:
        signal = data if isinstance(data, Signal) else as_vector(data, "x")
        wv = wavelet_variance(signal, rate, filter=moments, robust=robust, efficiency=efficiency)
        wv = with_tails(wv, signal if isinstance(signal, Signal) else Signal(signal, wv.rate))
    if not np.any(wv.variance > np.finfo(np.float64).tiny):
        raise ModelError(
            "the signal is constant, or too small for double precision: its wavelet variance is zero at every level",
            advice="Check that the sensor was recording, that the right column was read, and its unit.",
        )
    return wv


def _as_measured(wv: WaveletVariance, robust: bool, efficiency: float) -> WaveletVariance:
    """Check that `robust` and `efficiency` do not contradict a wavelet variance, and return it."""
    if robust and not wv.robust:
        raise OptionError(
            argument="robust", expected="False if the data are a classical wavelet variance", got=robust,
            advice="Pass the signal, or its robust wavelet variance.",
        )  # fmt: skip
    if not wv.robust:
        require_robust(robust, efficiency)
    elif efficiency not in (EFFICIENCY, wv.efficiency):
        raise OptionError(
            argument="efficiency", expected=f"{wv.efficiency:g}, the efficiency of the wavelet variance",
            got=efficiency, advice="Leave {--efficiency} out, or pass the signal.",
        )  # fmt: skip
    return wv
