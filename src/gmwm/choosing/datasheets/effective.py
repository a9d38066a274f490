"""Effective white noise and random walk of a fit over a time horizon, for filters that use only these two numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from gmwm.base.errors import DataError, OptionError
from gmwm.base.units import noise_unit
from gmwm.choosing.datasheets.curve import ENDLESS, Curve, slope
from gmwm.choosing.datasheets.entry import Entry
from gmwm.choosing.datasheets.equivalent_terms import translated
from gmwm.choosing.datasheets.limits import hidden
from gmwm.fitting.estimation.result import Fit
from gmwm.recording.options import as_confidence
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.physical import Physical

_FAR = 1e6
"""Averaging time, in correlation times, at which N of a fast process is computed. There, its Allan variance differs
from N²/τ by 1e-6."""

WHITE, WALK = 0.5, -0.5
"""Powers of time in the units of N and K."""

GONE = 1e-6
"""Relative difference of Allan variances below which the difference counts as a rounding error."""


@dataclass(frozen=True)
class Use:
    """Properties of the filter or simulator that uses the two numbers.

    Parameters
    ----------
    horizon : float
        Time horizon T_h (s).
    flicker : str
        Name of its own parameter for flicker noise, so that the two numbers must not include it; "" if it has none.
    """

    horizon: float
    flicker: str = ""


def effective_noise(fit: Fit, horizon: float, level: float = 0.95) -> dict[str, Entry]:
    """Compute the white noise N_eff and the random walk K_eff that approximate a whole model over a time horizon T_h.

    A term is treated as white noise if its correlation time is below T_h, otherwise as a random walk:

        N_eff² = N² + Σ lim τσ²(τ)    K_eff² = K² + Σ q_c²

    The first sum is over the fast terms. σ²(τ) is the Allan variance of a term, and the limit for τ → ∞ of τσ²(τ) is
    2σ²_GM/β for a Gauss-Markov term if β is far below the sampling rate. The second sum is over the slow terms.
    Quantization noise averages out, and a drift or a sinusoid is not noise, so these are not included. A term whose
    correlation time is near T_h is neither white noise nor a random walk; the rule above is only an approximation then.

    Flicker and power-law noise have no correlation time, and slow terms other than Gauss-Markov have no q_c. They are
    replaced by a process with the same Allan variance at T_h. If their Allan variance does not fall at T_h, this is a
    random walk with K² = 3σ²(T_h)/T_h. If it falls, flicker and power-law noise are replaced by white noise with
    N² = T_h σ²(T_h), and any other slow term by the sum of white noise and random walk that has the same Allan variance
    at T_h and at T_h/2. At τ < T_h, the Allan deviation of the random walk that replaces flicker noise is √(τ/T_h)
    times the Allan deviation of the flicker noise.

    Parameters
    ----------
    fit : Fit
    horizon : float
        Time horizon T_h (s), which is the time between corrections of the filter from other sensors.
    level : float
        Confidence level, from 0.5 to below 1.

    Returns
    -------
    mapping of "N_eff" and "K_eff" to Entry
        An entry is an upper limit if the data cannot distinguish it from zero. Its value is never zero, because a
        filter would treat zero as exact. If the model has no such noise, the noise is added to the model, and the value
        is the upper limit `high` from its fit. The value is infinite if the data give no upper limit.

    Raises
    ------
    OptionError
        If `fit` is not a Fit, `horizon` is not a positive time, or `level` is out of range.
    MissingTheoryError
        If the covariance or the Allan variance of a process is unknown.

    Examples
    --------
    >>> import gmwm
    >>> truth = gmwm.GM(beta=50.0, sigma2=1e-6) + gmwm.RW(gamma2=1e-10)
    >>> fit = gmwm.fit("GM + RW", gmwm.Signal(truth.simulate(100_000, 100.0, rng=2), 100.0, "rad/s"))
    >>> found = effective_noise(fit, horizon=10.0)["N_eff"]
    >>> found.low < 2.02e-4 < found.high
    True
    """
    if not isinstance(fit, Fit):
        raise OptionError(
            f"fit must be a Fit, because limits need data; got {type(fit).__name__}",
            argument="fit",
            got=fit,
            advice="Pass `gmwm.fit(model, data)`, or an axis of a calibration.",
        )
    level = as_confidence(level, "level")
    entries = noise_in_use(fit, Use(checked_horizon(horizon)), level)
    return {symbol: entry if entry.value > 0 else _at_most(fit, entry, level) for symbol, entry in entries.items()}


def _at_most(fit: Fit, entry: Entry, level: float) -> Entry:
    """Return an entry whose value is zero with its upper limit as value; infinite if the data give no limit."""
    try:
        high = max(entry.high or 0.0, hidden(fit, entry, level))
    except DataError:
        high = math.inf
    return replace(entry, value=high, low=0.0, high=high, upper_only=True)


def checked_horizon(horizon: float) -> float:
    """Return a time horizon (s) as float. Raises an OptionError if it is not positive and finite."""
    if isinstance(horizon, bool) or not isinstance(horizon, int | float) or not 0 < horizon < math.inf:
        raise OptionError(argument="horizon", expected="a positive time (s)", got=horizon)
    return float(horizon)


def noise_in_use(fit: Fit, use: Use, level: float) -> dict[str, Entry]:
    """Compute N_eff and K_eff like `effective_noise`, but with the value zero if the model has no such noise."""
    written, _ = translated(fit)
    curve, z = Curve.of(written), NormalDist().inv_cdf((1 + level) / 2)
    unit = fit.wavelet_variance.unit
    found = {}
    for symbol, title, power in (
        ("N_eff", "white noise density", WHITE),
        ("K_eff", "random walk", WALK),
    ):
        square = sum(_square(p, None, power=power, use=use, rate=curve.rate)[0] for p in written.model.processes)
        slopes = np.array([_square(p, name, power=power, use=use, rate=curve.rate)[1] for p, name in curve.moving])
        name, factor = noise_unit(power, unit)
        # As in the datasheet, whether a term may be zero depends only on the standard error of its scale parameter, not
        # on that of its correlation time.
        scales = np.array([is_scale(p, name) for p, name in curve.moving], dtype=np.bool_)
        seen = z * curve.error(np.where(scales, slopes, 0.0)) < square
        reach = z * curve.error(slopes)
        value = factor * math.sqrt(square)
        if not seen:
            high = factor * math.sqrt(square + reach)
            found[symbol] = Entry(
                symbol=symbol,
                title=f"{title} for {use.horizon:g} s",
                value=value,
                low=0.0,
                high=high,
                unit=name,
                upper_only=high > 0,
            )
        else:
            by = math.exp(min(0.5 * reach / square, ENDLESS))
            found[symbol] = Entry(
                symbol=symbol,
                title=f"{title} for {use.horizon:g} s",
                value=value,
                low=value / by,
                high=value * by,
                unit=name,
            )
    return found


def counted(process: Process, use: Use, rate: float) -> tuple[float, ...]:
    """Return which of N and K include a process: `WHITE`, `WALK`, both or neither."""
    powers = {number.time_power for number in process.physical(rate) if number.signal_power}
    if process.line(rate) is not None or (powers and not powers & {WHITE, WALK, 0.0}):
        return ()
    if use.flicker and is_flicker(process, rate):
        return ()
    if not by_deviation(process, use.horizon, rate):
        time = process.correlation_time(rate)
        return (WHITE,) if time is not None and time < use.horizon else (WALK,)
    n = _steps(use.horizon, rate)
    here, later = process.allan_variance([n, 2 * n], rate)
    if later >= here * (1 - GONE):
        return (WALK,)
    if is_scale_free(process, rate):
        return (WHITE,)
    half = max(1, n // 2)
    short, long = process.allan_variance([half, 2 * half], rate)
    return (WHITE, WALK) if 2 * long - short > GONE * short else (WHITE,)


def is_scale_free(process: Process, rate: float) -> bool:
    """Return whether a process has no correlation time and is not a random walk, like flicker and power-law noise."""
    if process.line(rate) is not None:
        return False
    time = process.correlation_time(rate)
    return time is None or (time == math.inf and is_flicker(process, rate))


def is_flicker(process: Process, rate: float) -> bool:
    """Return whether a process has a flat Allan deviation, because a datasheet number of it has no power of time."""
    return any(number.signal_power and number.time_power == 0 for number in process.physical(rate)) and (
        process.line(rate) is None
    )


def by_deviation(process: Process, horizon: float, rate: float) -> bool:
    """Return whether N and K of a process are computed from its Allan deviation.

    This is the case if it has no correlation time, or if it is slower than the time horizon and has no q_c.
    """
    if process.line(rate) is not None:
        return False
    if is_scale_free(process, rate):
        return True
    time = process.correlation_time(rate)
    return time is not None and time >= horizon and _walk(process, rate) is None


def is_scale(process: Process, name: str | None) -> bool:
    """Return whether a free parameter is the scale of a process; None is the scale of a term estimated as zero."""
    return name is None or name == process.scale_parameter().name


def _walk(process: Process, rate: float) -> Physical | None:
    return next((number for number in process.physical(rate) if number.time_power == WALK), None)


def _steps(time: float, rate: float) -> int:
    """Convert a time (s) to a number of samples, which is at least 1."""
    return max(1, round(time * rate))


def _readings(process: Process, power: float, use: Use, rate: float) -> list[tuple[int, float]]:
    """Return pairs (n, factor). The sum of the Allan variances at n samples times their factors is N² or K²."""
    n, powers = _steps(use.horizon, rate), counted(process, use, rate)
    if len(powers) == 2:
        # Solve σ²(τ) = N²/τ + K²τ/3 at τ = T_h/2 and τ = T_h.
        half = max(1, n // 2)
        time = half / rate
        short, long = (4 * time / 3, -2 * time / 3) if power == WHITE else (-1 / time, 2 / time)
        return [(half, short), (2 * half, long)]
    return [(n, n / rate if power == WHITE else 3 * rate / n)]


def _square(process: Process, name: str | None, power: float, use: Use, rate: float) -> tuple[float, float]:
    """Return the contribution of a process to N² or K², and its derivative.

    The derivative is with respect to the logarithm of the parameter `name`, or to the scale if `name` is None.
    """
    if process.scale == 0 or power not in counted(process, use, rate):
        return 0.0, 0.0
    if by_deviation(process, use.horizon, rate):
        readings = _readings(process, power, use, rate)
        values = process.allan_variance([n for n, _ in readings], rate)
        value = sum(factor * float(at) for (_, factor), at in zip(readings, values, strict=True))
        return value, sum(factor * slope(process, name, n, rate) for n, factor in readings)
    if power == WHITE:
        # The difference between τσ²(τ) and its limit is proportional to 1/τ, so the values at two τ give the limit.
        near = math.ceil(_FAR * max(1.0, (process.correlation_time(rate) or 0.0) * rate))
        far = 4 * near
        levels = process.allan_variance([near, far], rate) * np.array([near, far]) / rate
        slopes = [n / rate * slope(process, name, n, rate) for n in (near, far)]
        limit = (4 * float(levels[1]) - float(levels[0])) / 3
        if limit <= GONE * float(levels[0]):
            return 0.0, 0.0
        return limit, (4 * slopes[1] - slopes[0]) / 3
    walk = _walk(process, rate)
    assert walk is not None
    return walk.value**2, walk.value**2 * (1.0 if name is None else 2.0 * walk.slopes.get(name, 0.0))
