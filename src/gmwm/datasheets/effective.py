"""Two numbers for a filter that has only two: white noise and a random walk, for a stated horizon."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import numpy as np

from gmwm.datasheets.curve import ENDLESS, Curve, slope
from gmwm.datasheets.entry import Entry
from gmwm.datasheets.equivalent_terms import translated
from gmwm.datasheets.limits import hidden
from gmwm.errors import DataError, OptionError
from gmwm.estimation.result import Fit
from gmwm.options import as_confidence
from gmwm.processes.base import Process
from gmwm.processes.physical import Physical
from gmwm.units import noise_unit

_FAR = 1e6
"""Correlation times after which a process is white: its Allan variance is N²/τ but for some 1/`_FAR`."""

WHITE, WALK = 0.5, -0.5
"""Powers of the second in the units of N and K."""

GONE = 1e-6
"""A limit that is a smaller share of what there is nearby is zero but for rounding."""

_AT_ITS_TIME = 4 * math.exp(-1.0) - math.exp(-2.0) - 1
"""Allan variance of a Gauss-Markov process of variance 1 at its correlation time."""


@dataclass(frozen=True)
class Use:
    """What a filter or a simulator makes of two numbers.

    Parameters
    ----------
    horizon : float
        T_h (s).
    time : float or None
        Correlation time (s) of the Gauss-Markov bias that K drives there; None where it is a random walk.
    flicker : str
        Its parameter for flicker noise, which then is not counted; "" where it has none.
    """

    horizon: float
    time: float | None = None
    flicker: str = ""


def effective_noise(fit: Fit, horizon: float, level: float = 0.95) -> dict[str, Entry]:
    """N and K of the white noise and the random walk that stand for the whole model over a horizon T_h.

    A term whose correlation time is below T_h is white noise to it, one beyond it a random walk:

        N_eff² = N² + Σ lim τσ²(τ)    K_eff² = K² + Σ q_c²

    where the limit is the level of a fast term at long averaging times, 2σ²_GM/β for β far below the rate. Quantization
    noise averages out, and a ramp or a line is no noise: none is counted. A term whose correlation time is near T_h is
    neither white nor a walk, and is counted as the nearer of the two.

    Flicker and power-law noise have no correlation time, and other slow terms than Gauss-Markov's no driving noise q_c:
    they count as the random walk that has their Allan variance at T_h, K² = 3σ²(T_h)/T_h, or, where that still falls
    there, as such white noise, N² = T_h σ²(T_h); of a slow term whose Allan variance falls at T_h, which holds both, as
    the two that have it at T_h and at half of T_h. Beside flicker noise such a walk is √(τ/T_h) as large at τ.

    Parameters
    ----------
    fit : Fit
    horizon : float
        T_h in s: how long a filter relies on the sensor alone.
    level : float
        Confidence level.

    Returns
    -------
    mapping of "N_eff" and "K_eff" to Entry
        An upper limit where the data cannot tell it from zero. The value is never zero, which a filter would take for
        knowledge: where the model has nothing of the kind, or it is estimated as zero, it is the limit `high`, as the
        exporters write it, found in the model with such a term added; infinite where the data give none.

    Raises
    ------
    OptionError
        If `fit` is not one, `horizon` is not a positive time, or `level` not between 0 and 1.
    MissingTheoryError
        If the covariance or the Allan variance of a process is not known.

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
            f"fit must be a Fit, got {type(fit).__name__}; the numbers come with limits, which take data: "
            "gmwm.fit(model, data), or calibration[axis]"
        )
    level = as_confidence(level, "level")
    entries = noise_in_use(fit, Use(checked_horizon(horizon)), level)
    return {symbol: entry if entry.value > 0 else _at_most(fit, entry, level) for symbol, entry in entries.items()}


def _at_most(fit: Fit, entry: Entry, level: float) -> Entry:
    """The limit in place of a zero."""
    try:
        high = max(entry.high or 0.0, hidden(fit, entry, level))
    except DataError:
        high = math.inf
    return replace(entry, value=high, low=0.0, high=high, upper_only=True)


def checked_horizon(horizon: float) -> float:
    """A positive time in s."""
    if isinstance(horizon, bool) or not isinstance(horizon, int | float) or not 0 < horizon < math.inf:
        raise OptionError(f"horizon must be a positive time in s, got {horizon!r}")
    return float(horizon)


def noise_in_use(fit: Fit, use: Use, level: float) -> dict[str, Entry]:
    """`effective_noise` for a consumer, zero where the model has nothing of the kind.

    To a Gauss-Markov bias, flicker noise and what else is counted by its Allan deviation counts as such a bias that has
    it at their correlation time T: K² = 2σ²(T)/(0.336 T), T the term's own where it has one.
    """
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
        # As in the datasheet, a term is told from zero by its scale, however little its time is known.
        scales = np.array([_is_scale(p, name) for p, name in curve.moving], dtype=np.bool_)
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
    """`WHITE`, `WALK` or both, as what a term counts; none where it does not."""
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
    """Whether a noise has no correlation time and is no random walk either: flicker and power-law noise."""
    if process.line(rate) is not None:
        return False
    time = process.correlation_time(rate)
    return time is None or (time == math.inf and is_flicker(process, rate))


def is_flicker(process: Process, rate: float) -> bool:
    """Whether a noise says of itself that its Allan deviation is flat."""
    return any(number.signal_power and number.time_power == 0 for number in process.physical(rate)) and (
        process.line(rate) is None
    )


def by_deviation(process: Process, horizon: float, rate: float) -> bool:
    """Whether a noise is counted by its Allan deviation: it has no correlation time, or is slow and has no q_c."""
    if process.line(rate) is not None:
        return False
    if is_scale_free(process, rate):
        return True
    time = process.correlation_time(rate)
    return time is not None and time >= horizon and _walk(process, rate) is None


def _is_scale(process: Process, name: str | None) -> bool:
    return name is None or name == process.scale_parameter().name


def _walk(process: Process, rate: float) -> Physical | None:
    return next((number for number in process.physical(rate) if number.time_power == WALK), None)


def _steps(time: float, rate: float) -> int:
    """A time in samples."""
    return max(1, round(time * rate))


def _readings(process: Process, power: float, use: Use, rate: float) -> list[tuple[int, float]]:
    """Samples n and factors by which Allan variances at them add up to N² or K², of a term counted by them."""
    n, powers = _steps(use.horizon, rate), counted(process, use, rate)
    if len(powers) == 2:
        # σ²(τ) = N²/τ + K²τ/3 at half the horizon and at all of it.
        half = max(1, n // 2)
        time = half / rate
        short, long = (4 * time / 3, -2 * time / 3) if power == WHITE else (-1 / time, 2 / time)
        return [(half, short), (2 * half, long)]
    if power == WHITE:
        return [(n, n / rate)]
    if use.time is None:
        return [(n, 3 * rate / n)]
    own = process.correlation_time(rate)
    n = _steps(use.time if own is None else min(own, use.time), rate)
    return [(n, 2 * rate / (n * _AT_ITS_TIME))]


def _square(process: Process, name: str | None, power: float, use: Use, rate: float) -> tuple[float, float]:
    """What a process adds to N² or K², and its derivative by ln θ; by its scale where no parameter is named."""
    if process.scale == 0 or power not in counted(process, use, rate):
        return 0.0, 0.0
    if by_deviation(process, use.horizon, rate):
        readings = _readings(process, power, use, rate)
        values = process.allan_variance([n for n, _ in readings], rate)
        value = sum(factor * float(at) for (_, factor), at in zip(readings, values, strict=True))
        return value, sum(factor * slope(process, name, n, rate) for n, factor in readings)
    if power == WHITE:
        # What is left of τσ²(τ) beyond its limit goes as 1/τ: two places tell the limit, which is zero where all goes.
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
