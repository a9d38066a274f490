"""Two numbers for a filter that has only two: white noise and a random walk, for a stated horizon."""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np

from gmwm.datasheets.curve import ENDLESS, Curve, slope
from gmwm.datasheets.entry import Entry
from gmwm.datasheets.translation import translated
from gmwm.errors import OptionError
from gmwm.estimation.result import Fit
from gmwm.inference.intervals import as_level
from gmwm.processes.base import Process
from gmwm.units import noise_unit

_FAR = 1e6
"""Correlation times after which a process is white: its Allan variance is N²/τ but for some 1/`_FAR`."""

WHITE, WALK = 0.5, -0.5
"""Powers of the second in the units of N and K."""

GONE = 1e-6
"""A limit that is a smaller share of what there is nearby is zero but for rounding."""


def effective_noise(fit: Fit, horizon: float, level: float = 0.95) -> dict[str, Entry]:
    """N and K of the white noise and the random walk that stand for the whole model over a horizon T_h.

    A term whose correlation time is below T_h is white noise to it, one beyond it a random walk:

        N_eff² = N² + Σ lim τσ²(τ)    K_eff² = K² + Σ q_c²

    where the limit is the level of a fast term at long averaging times, 2σ²_GM/β for β far below the rate. Quantization
    noise averages out, and a ramp or a line is no noise: none is counted. A term whose correlation time is near T_h is
    neither white nor a walk, and is counted as the nearer of the two. Flicker and power-law noise have no correlation
    time: they count as the random walk that has their Allan variance at T_h, K² = 3σ²(T_h)/T_h, or, where that still
    falls there, as such white noise, N² = T_h σ²(T_h). At shorter times that walk is below the term itself, at longer
    ones above it.

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
        An upper limit where the data cannot tell it from zero.

    Raises
    ------
    OptionError
        If `horizon` is not a positive time, or `level` not between 0 and 1.
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
    level = as_level(level)
    if isinstance(horizon, bool) or not isinstance(horizon, int | float) or not 0 < horizon < math.inf:
        raise OptionError(f"horizon must be a positive time in s, got {horizon!r}")
    written, _ = translated(fit)
    curve, z = Curve.of(written), NormalDist().inv_cdf((1 + level) / 2)
    unit = fit.wavelet_variance.unit
    found = {}
    for symbol, title, power in (
        ("N_eff", "white noise density", WHITE),
        ("K_eff", "random walk", WALK),
    ):
        square = sum(_square(p, None, power, horizon, curve.rate)[0] for p in written.model.processes)
        slopes = np.array([_square(p, name, power, horizon, curve.rate)[1] for p, name in curve.moving])
        name, factor = noise_unit(power, unit)
        reach = z * curve.error(slopes)
        value = factor * math.sqrt(square)
        if reach >= square:
            high = factor * math.sqrt(square + reach)
            found[symbol] = Entry(symbol, f"{title} for {horizon:g} s", value, 0.0, high, name, upper_only=high > 0)
        else:
            by = math.exp(min(0.5 * reach / square, ENDLESS))
            found[symbol] = Entry(symbol, f"{title} for {horizon:g} s", value, value / by, value * by, name)
    return found


def counted(process: Process, horizon: float, rate: float) -> float | None:
    """`WHITE` or `WALK`, as what a term counts over a horizon; None where it does not."""
    powers = {number.time_power for number in process.physical(rate) if number.signal_power}
    if process.line(rate) is not None or (powers and not powers & {WHITE, WALK, 0.0}):
        return None
    if is_scale_free(process, rate):
        n = _steps(horizon, rate)
        here, later = process.allan_variance([n, 2 * n], rate)
        return WHITE if later < here * (1 - GONE) else WALK
    time = process.correlation_time(rate)
    return WHITE if time is not None and time < horizon else WALK


def is_scale_free(process: Process, rate: float) -> bool:
    """Whether a noise has no correlation time and is no random walk either: flicker and power-law noise."""
    if process.line(rate) is not None:
        return False
    time = process.correlation_time(rate)
    numbers = {number.time_power for number in process.physical(rate)}
    return time is None or (time == math.inf and 0.0 in numbers)


def _steps(horizon: float, rate: float) -> int:
    """The horizon in samples."""
    return max(1, round(horizon * rate))


def _square(process: Process, name: str | None, power: float, horizon: float, rate: float) -> tuple[float, float]:
    """What a process adds to N² or K², and its derivative by ln θ; by its scale where no parameter is named."""
    if process.scale == 0 or counted(process, horizon, rate) != power:
        return 0.0, 0.0
    if is_scale_free(process, rate):
        n = _steps(horizon, rate)
        factor = n / rate if power == WHITE else 3 * rate / n
        return factor * float(process.allan_variance([n], rate)[0]), factor * slope(process, name, n, rate)
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
    walk = next((number for number in process.physical(rate) if number.time_power == power), None)
    if walk is None:
        return 0.0, 0.0
    return walk.value**2, walk.value**2 * (1.0 if name is None else 2.0 * walk.slopes.get(name, 0.0))
