"""Find the sampling interval and the lost samples of a recording from its time stamps.

Row k has t_k = t_0 + (k + L_k) T + d_k, with L_k lost samples and a delay d_k: jitter, rounding, or time in a buffer.
So r_k = t_k / T - k = L_k + drift + d_k / T rises permanently by a loss, and briefly by a delay. Modulo 1, its phase
gives T and the drift. Without the drift, single rows, or statistics of the shortest coherent blocks (`_coherence`), are
whole levels. A level that falls within twice its rise was a late delivery."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector
from gmwm.files.clock.loss_levels import Rows, follow, least_ahead, median_of_three, row_levels


@dataclass(frozen=True)
class PhaseSearch:
    """Limits of the search for interval and lost samples, held by the study docs/validation/clocks.md."""

    coarse: float = 0.35
    """Smallest resolution of the time stamps, in sampling intervals, at which rounding hides the phase of a row."""
    regular: float = 0.35
    """Smallest coherence for single rows: exp(-2π²σ²) for a jitter of σ = 0.23 sampling intervals."""
    far_regular: float = 0.15
    """Smallest coherence at a distance of rows that refines the interval; beyond, the clock drifts too far."""
    late_share: float = 0.01
    """Largest share of rows more than 0.75 samples from their level; delays have a heavier tail than jitter."""
    steady: float = 0.85
    """Sufficient coherence of neighbouring blocks: their statistics have a standard deviation of 0.06 samples."""
    clear: float = 0.5
    """Coherence of blocks below which losses may hide: 0.53 and more with 100 losses beside jitter and rounding, less
    with a third of the rows lost and a jitter of 0.3 sampling intervals, or with delays of four intervals."""
    interval_change: float = 0.02
    """Largest relative change of the interval between phases of blocks; beyond, whole turns would be miscounted."""
    pauses: float = 2.5
    """Ratio of mean to median interval above which long intervals are pauses between bursts of rows, not losses."""
    by_chance: float = 0.3
    """Largest difference, summed over the lengths of intervals, from the geometric law of losses by chance: 0.02 with
    70 % lost, 0.2 with 30 % and 70 % in turn; above 0.38 for other clocks."""
    long_interval: float = 1.5
    """Interval, in samples, halfway between an interval without a lost sample and an interval with one."""
    long_gap: int = 256
    """Gap (samples) above which it is removed before phases are compared: the clock may drift within it."""
    first_rows: int = 1 << 17  # number of rows from which the interval is first found; all rows then refine it
    gain_of_doubling: float = 0.03  # increase of the coherence above which a block with twice the rows is preferred
    least_blocks: int = 12
    """Smallest number of blocks into which the recording is divided in the search for a better block length."""
    agrees_with_declared: float = 0.02
    """Largest relative difference at which an interval agrees with the declared interval."""
    jitter_of_declared: float = 0.1
    """Relative difference between the declared interval and one without a lost sample, jitter included."""
    slips: int = 5  # smallest number of regular steps that are taken as rounding at another rate instead of losses
    drift: tuple[float, float] = (0.01, 0.2)
    """Relative drift removed before phases are compared; below, phases follow it, above, the rate was changed."""
    lost_while_drifting: float = 0.02
    """Largest share of long intervals at which the course of the interval is measured over 16 rows."""


SEARCH = PhaseSearch()

_RUNS, _RUN = 8, 16
"""Rows come in at least 8 bursts, of fewer than 16 rows on average unless the ratio is above 4 `SEARCH.pauses`."""
_SMOOTH, _STEP, _SMOOTH_BLOCKS = 64, 8, 9
"""Rows over which the phase is averaged, step between its values, and the same number of blocks."""
RATE_TOLERANCE = 1e-2
"""Relative agreement of rates; gyroscope clocks are specified to 1 % (InvenSense specification PS-MPU-6000A)."""


@dataclass(frozen=True)
class SampleLosses:
    """Sampling interval and lost samples of time stamps without backward steps."""

    interval: float  # sampling interval in ticks
    rows: Rows  # row after each gap, and the number of samples lost there, at least 1
    lost: Rows
    width: int  # number of rows in the blocks whose statistics were compared; 1 if single rows show the lost samples
    repeated: Rows = field(default_factory=lambda: np.empty(0, dtype=np.int64))  # rows that were written twice
    unclear: bool = False  # whether the time stamps show no interval, so that lost samples are not counted


def find_losses(ticks: Vector, resolution: float, declared: float | None = None) -> SampleLosses:
    """Find the sampling interval and lost samples of ascending `ticks` (N,); `declared` decides between intervals."""
    even = _without_drift(ticks, resolution)
    if even is not None:
        losses = _steady_losses(even, resolution, declared)
        index = ticks.size - 1 + np.sum(losses.lost) - losses.repeated.size
        return replace(losses, interval=float((ticks[-1] - ticks[0]) / index))
    return _steady_losses(ticks, resolution, declared)


def _without_drift(ticks: Vector, resolution: float) -> Vector | None:
    """Return time stamps in which a slow drift of the interval is undone; None if there is none."""
    typical, lag, degree = _typical(ticks), 16, 5
    steps = np.diff(ticks)
    parts = min(64, ticks.size // 256)
    long = np.count_nonzero(steps > 1.75 * typical)
    if parts < 12 or resolution >= SEARCH.coarse * typical or long > SEARCH.lost_while_drifting * steps.size:
        return None
    rows = np.linspace(0, ticks.size - lag, parts + 1).astype(np.int64)
    apart = (ticks[lag:] - ticks[:-lag]) / (lag * typical)
    course = np.array([np.median(apart[a:b]) for a, b in pairwise(rows.tolist())])
    centre = (rows[1:] + rows[:-1] + lag) / 2
    curve = np.polynomial.Legendre.fit(centre, course, degree)
    scatter = 1.4826 * float(np.median(np.abs(course - curve(centre))))
    knots = np.linspace(0, ticks.size - 1, 16 * parts).astype(np.int64)
    local = curve(np.clip(knots, centre[0], centre[-1]))
    extent = float(np.ptp(local))
    # The curve has a standard error of about half of the scatter; a change of the rate leaves larger differences.
    if not max(SEARCH.drift[0], 4 * scatter) < extent < SEARCH.drift[1]:
        return None
    times = np.maximum.accumulate(ticks[knots])
    slow = np.concatenate([[0.0], np.cumsum(np.diff(times) * (1 / local[1:] + 1 / local[:-1]) / 2)])
    return np.asarray(np.interp(ticks, times, slow))


def _steady_losses(ticks: Vector, resolution: float, declared: float | None) -> SampleLosses:
    """Find the sampling interval and the lost samples of a clock whose interval drifts by little."""
    none = np.empty(0, dtype=np.int64)
    line = _one_line(ticks, resolution)
    contradicts = declared is not None and line is not None and abs(line / declared - 1) > RATE_TOLERANCE
    fine = line is not None and resolution < SEARCH.coarse * line
    uniform = line is not None and (fine or bool(np.all(np.abs(np.diff(ticks) - line) < 1e-2 * line)))
    if line is not None and uniform and not contradicts:
        return SampleLosses(line, none, none, 1)
    typical, burst = _typical(ticks), _burst(ticks)
    single = _between_losses(ticks, typical)
    mean = _windowed_mean(ticks, burst) if single == typical else single
    if declared is not None and contradicts:
        steps = np.diff(ticks)
        near = steps[np.abs(steps / declared - 1) < SEARCH.jitter_of_declared]
        single = float(np.median(near)) if near.size else single
    regular = _regular(ticks, single, resolution, mean)
    agrees = regular and declared and abs(regular.interval / declared - 1) < SEARCH.agrees_with_declared
    if regular and agrees and (line is None or contradicts):
        return regular  # the declared rate decides between jitter or rounding, and regular losses
    if line is not None and uniform:
        return SampleLosses(line, none, none, 1)
    if regular is not None and resolution >= SEARCH.coarse * single and _is_rounding(regular, resolution, single):
        regular = None
    if line is not None and (regular is None or not 0 < regular.rows.size + regular.repeated.size < SEARCH.slips):
        return SampleLosses(line, none, none, 1)
    if regular is not None and (declared is None or agrees):
        return regular
    interval = mean if declared is None or abs(mean / declared - 1) > 0.05 else declared
    return _in_blocks(ticks, interval, resolution, burst)


def resolution_of(ticks: Vector, spacing: float) -> float:
    """Return the largest unit of which all differences of time stamps are multiples; `spacing` if there is none."""
    steps = np.abs(np.diff(ticks))
    for decimals in range(10):
        unit = 1
        for sample in (steps[:: max(1, steps.size // 4096)], steps):  # a few steps rule out most units
            counts = sample * 10.0**decimals
            multiples = np.round(counts)
            allowed = 4 * spacing * 10.0**decimals + 1e-9 * counts + 1e-12
            if np.any(np.abs(counts - multiples) > allowed) or np.max(multiples, initial=0.0) >= 2.0**53:
                unit = 0
                break
            unit = int(np.gcd.reduce(multiples.astype(np.int64), initial=0))
        if unit:
            return unit / 10.0**decimals
    return spacing


def _typical(ticks: Vector) -> float:
    """Return the median interval of some rows."""
    first = max(ticks.size - SEARCH.first_rows, 0) // 2
    return float(np.median(np.diff(ticks[first : first + SEARCH.first_rows])))


def _between_losses(ticks: Vector, typical: float) -> float:
    """Return the interval of which all others are multiples, with the counts of losses by chance; else `typical`."""
    steps = np.diff(ticks)
    interval = float(np.quantile(steps, 1 / 8))
    for _ in range(3):
        near = steps[np.abs(steps - interval) < 0.5 * interval]
        interval = float(np.mean(near)) if near.size else 0.0
    lost = 1 - interval / float(np.mean(steps))
    # The coherence of intervals is the square of that of single rows.
    # With fewer than a quarter of the rows, any irregular log looks so.
    if not 1 / 4 < 1 - lost < 1 / SEARCH.long_interval or _coherence(ticks / interval) < SEARCH.regular**2:
        return typical
    counts = np.bincount(np.clip(np.rint(steps / interval), 0, 31).astype(np.int64), minlength=32)
    by_chance = np.append(0.0, (1 - lost) * lost ** np.arange(31))
    return interval if np.sum(np.abs(counts / steps.size - by_chance)) < SEARCH.by_chance else typical


def _burst(ticks: Vector) -> float:
    """Return the approximate number of rows in a burst; 1 if rows do not come in bursts."""
    steps = np.diff(ticks)
    rough, middle = (ticks[-1] - ticks[0]) / steps.size, _typical(ticks)
    if middle >= 0.5 * rough:
        return 1.0
    return steps.size / max(1, int(np.count_nonzero(steps > 1.5 * min(rough, 4 * middle) if middle else steps > 0)))


def _windowed_mean(ticks: Vector, burst: float) -> float:
    """Return the mean of the middle half of averages over many intervals, without those with an unusually long one."""
    steps = np.diff(ticks)
    window = max(1, min(int(max(64, min(8 * burst**2, 2048))), ticks.size // 8))
    averages = (ticks[window:] - ticks[:-window]) / window
    long = steps[steps > 0]
    if burst > 1:
        long = long[long > 1.5 * np.mean(steps)]
    unusual = np.concatenate([[0], np.cumsum(steps > 1.75 * np.median(long))]) if long.size else np.zeros(ticks.size)
    usual = averages[unusual[window:] == unusual[:-window]]
    averages = np.sort(usual if usual.size > 0.1 * averages.size else averages)
    averages = averages[averages > 0]
    quarter = averages.size // 4
    return float(np.mean(averages[quarter : averages.size - quarter])) if averages.size else 0.0


def _one_line(ticks: Vector, resolution: float) -> float | None:
    """Return the interval of a uniform clock that explains all time stamps within their resolution, or None."""
    k = np.arange(ticks.size, dtype=np.float64)
    slope = _slope(k, ticks)
    away = ticks - slope * k
    if resolution < SEARCH.coarse * slope or np.ptp(away) < 1e-3 * slope:
        return slope if np.ptp(away) <= max(1.05 * resolution, 0.5 * slope) else None
    if np.ptp(away) > 3 * resolution:
        return None
    # The range of the differences is a convex function of the slope, whose minimum a golden section search finds.
    low, high, ratio = -3 * resolution / k[-1], 3 * resolution / k[-1], (np.sqrt(5) - 1) / 2
    for _ in range(24):
        a, b = high - ratio * (high - low), low + ratio * (high - low)
        low, high = (low, b) if np.ptp(away - a * k) < np.ptp(away - b * k) else (a, high)
    middle = (low + high) / 2
    return slope + float(middle) if np.ptp(away - middle * k) <= 1.01 * resolution else None


def _slope(k: Vector, t: Vector, far: Rows | None = None) -> float:
    """Return the common slope of lines through t over k, with a free step at each of the rows `far`."""
    edges = np.concatenate([[0], [] if far is None else far, [k.size]]).astype(np.int64)
    sizes = np.diff(edges)
    c, m = (v - np.repeat(np.add.reduceat(v, edges[:-1]) / sizes, sizes) for v in (k, t))
    return float(np.dot(c, m) / max(np.dot(c, c), 1e-300))


def _regular(ticks: Vector, single: float, resolution: float, mean: float) -> SampleLosses | None:
    """Find losses from single rows if the intervals are multiples of one interval; return None if they are not."""
    if single <= 0:
        return None
    steps = np.diff(ticks)
    if mean / single > SEARCH.pauses:
        runs = int(np.count_nonzero(steps > SEARCH.long_interval * single))
        if runs >= _RUNS and (steps.size < _RUN * runs or mean / single > 4 * SEARCH.pauses):
            return None
    if resolution >= SEARCH.coarse * single:
        # The phase of rounded time stamps is not usable, so only time stamps without jitter show losses row by row.
        odd = np.count_nonzero(np.abs(steps / single - np.round(steps / single)) > 1e-6) + np.count_nonzero(steps == 0)
        if odd > max(2, 0.002 * steps.size):
            return None
    closed, far = _close_gaps(ticks, single)
    level = _whole_levels(closed, single)
    if level is None:
        interval, phase = _phase_locked(closed, single)
        if interval is None:
            return None
        x = closed / interval - np.arange(closed.size) - phase
        level = follow(x)
        if np.count_nonzero(np.abs(x - level) > 0.75) > SEARCH.late_share * x.size:
            return None
        level = _with_long_steps(level, np.diff(closed) / interval)
    return _with_closed_gaps(ticks, closed, far, level, width=1)


def _whole_levels(ticks: Vector, interval: float) -> Rows | None:
    """Return the levels of time stamps without jitter, drift and repeated rows, for which nothing is searched."""
    level = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(ticks) / interval) - 1)])
    away = ticks / interval - np.arange(ticks.size) - level
    is_whole = np.ptp(away) < 1e-2 and bool(np.all(level[1:] >= level[:-1]))
    return level.astype(np.int64) if is_whole else None


def _is_rounding(found: SampleLosses, resolution: float, single: float) -> bool:
    """Return whether the losses are so regular that they are taken as rounding at another rate."""
    apart = np.diff(found.rows)
    return bool(
        found.rows.size >= SEARCH.slips
        and np.std(apart) < 0.5 * np.mean(apart)
        and np.median(found.lost) <= np.ceil(resolution / single)
    )


def _with_long_steps(level: Rows, steps: Vector) -> Rows:
    """Remove rises and falls of levels (clock drift) without a fitting interval (in samples)."""
    rise = np.diff(level)
    near = np.abs(steps[steps < SEARCH.long_interval] - 1)
    scatter = 3 * 1.4826 * float(np.median(near)) if near.size else 0.0
    short = max(0.5, scatter)
    wide = np.concatenate([[1.0], steps, [1.0]])
    # The time stamp on one side may itself be late or early.
    beyond = np.maximum(steps, np.maximum(wide[:-2], wide[2:]) + steps - 1) - 1
    real = ((rise > 0) & (beyond >= rise - short)) | ((rise < 0) & (steps <= short))
    slips = np.cumsum(np.where(real, 0, rise), dtype=np.int64)
    return np.asarray(level - np.concatenate([np.zeros(1, dtype=np.int64), slips]))


def _close_gaps(ticks: Vector, interval: float) -> tuple[Vector, Rows]:
    """Return time stamps without their long gaps, and the rows after these gaps."""
    steps = np.diff(ticks)
    r = ticks / interval - np.arange(ticks.size)
    jumps = np.flatnonzero(steps > SEARCH.long_gap * interval)
    size = steps[jumps] / interval
    later = np.minimum(jumps + 65 + np.minimum(2 * size, 20_000).astype(np.int64), ticks.size - 1)
    stays = np.minimum.reduceat(r, np.column_stack([jumps + 1, later]).ravel())[::2] if jumps.size else np.empty(0)
    if jumps.size:
        stays = np.array([np.min(r[a + 1 : b + 1][-16:]) for a, b in zip(jumps, later, strict=True)])
    far = jumps[stays - r[jumps] > 0.5 * size]
    if not far.size:
        return ticks, far
    shift = np.zeros(ticks.size)
    shift[far + 1] = steps[far] - interval
    return ticks - np.cumsum(shift), far + 1


def _phase_locked(ticks: Vector, interval: float) -> tuple[float | None, Vector]:
    """Return the interval at which single rows are coherent, and the slow phase of the rows in samples."""
    n, first = ticks.size, max(ticks.size - SEARCH.first_rows, 0) // 2
    sample = ticks[first : first + SEARCH.first_rows]
    steps = np.diff(sample) / interval
    near = steps[np.abs(steps - 1) <= 0.5]
    # With many gaps, the median of all intervals is above the median of those without one.
    interval *= float(np.median(near)) if near.size else 1.0
    runs = np.flatnonzero(np.abs(np.diff(sample) / interval - 1) > 0.5) + 1
    within = _slope(np.arange(sample.size, dtype=np.float64), sample, runs)
    interval = within if abs(within / interval - 1) < 0.05 else interval
    for lag in (1, 4, 16, 64, 256, 1024):
        if lag > sample.size // 8:
            break
        apart = (sample[lag:] - sample[:-lag]) / interval
        mean = np.mean(np.exp(2j * np.pi * apart))
        turn, advance = float(np.angle(mean)) / (2 * np.pi), float(np.median(apart))
        if abs(mean) < max(SEARCH.far_regular, 3 / np.sqrt(apart.size)):
            break
        if abs(turn) / advance < 0.05:
            interval *= 1 + turn / advance
    edges = np.arange(0, n, _STEP)
    sizes = np.diff(edges, append=n)
    angle = 2 * np.pi * (ticks / interval)
    means = (np.add.reduceat(np.cos(angle), edges) + 1j * np.add.reduceat(np.sin(angle), edges)) / sizes
    smooth = _moving_mean(means, int(np.clip(n // 16, 16, _SMOOTH)) // _STEP + 1)
    if float(np.mean(np.abs(smooth))) < SEARCH.regular:
        return None, np.empty(0)
    phase = np.unwrap(np.angle(smooth)) / (2 * np.pi)
    return interval, np.interp(np.arange(n), edges + (sizes - 1) / 2, phase)


def _moving_mean(z: NDArray[np.complex128], width: int) -> NDArray[np.complex128]:
    """Return the moving mean over `width` values, over fewer at the ends."""
    half = width // 2
    total = np.concatenate([np.zeros(1, dtype=z.dtype), np.cumsum(z)])
    index = np.arange(z.size)
    low, high = np.maximum(index - half, 0), np.minimum(index + half + 1, z.size)
    mean: NDArray[np.complex128] = (total[high] - total[low]) / (high - low)
    return mean


def _tapered_mean(r: Vector) -> Vector:
    """Return the mean of each row with Hann weights: the start of a block within a burst then has no effect."""
    width = r.shape[1]
    weights = np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 2
    return np.asarray(r @ (weights / np.sum(weights)))


_STATISTICS: dict[str, Callable[[Vector], Vector]] = {
    "mean": _tapered_mean,
    "least": lambda r: np.asarray(np.min(r, axis=1)),
    "largest": lambda r: np.asarray(np.max(r, axis=1)),
}


def _in_blocks(ticks: Vector, interval: float, resolution: float, burst: float) -> SampleLosses:
    """Find losses from statistics of blocks of rows."""
    closed, far = _close_gaps(ticks, interval)
    n = closed.size
    # Minima and maxima of rounded time stamps are whole numbers for any interval that is a multiple of their unit.
    rounded = resolution >= SEARCH.coarse * interval
    names = ("mean",) if rounded else tuple(_STATISTICS)
    width = 4
    while width < 2 * max(burst, resolution / interval) and width < 2048:
        width *= 2
    best = (-1.0, 1, "mean", interval)
    near = dict.fromkeys(names, interval)
    while width <= 2048 and (best[0] < 0 or (best[0] < SEARCH.steady and width * SEARCH.least_blocks <= n)):
        size = max(1, min(width, n // 3))
        for name in names:
            refined = _refine(closed, near[name], size, name)
            value = _coherence(_blocks(closed, refined, size, name))
            if abs(refined / near[name] - 1) > min(SEARCH.interval_change, 0.45 / size):
                continue
            if value > 0.5:
                near[name] = refined
            # A shorter block separates losses that are near each other.
            if value - SEARCH.gain_of_doubling * np.log2(size) > best[0] - SEARCH.gain_of_doubling * np.log2(best[1]):
                best = (value, size, name, refined)
        width *= 2
    coherence, width, name, interval = best
    b = _blocks(closed, interval, width, name)
    smooth = _moving_mean(np.exp(2j * np.pi * b), min(_SMOOTH_BLOCKS, b.size))
    phase = np.unwrap(np.angle(smooth)) / (2 * np.pi)
    r = closed / interval - np.arange(n)
    horizon = int(2 * min(np.max(np.diff(r), initial=0.0), 20_000.0) / width) + 2
    centres = (np.arange(b.size) + 0.5) * width - 0.5
    steps = np.diff(closed) / interval
    for _ in range(2):
        level = least_ahead(median_of_three(np.round(b - phase)), horizon)
        rows_level = row_levels(r - np.interp(np.arange(n), centres, phase), level, width, steps)
        # The losses are now known. Without them, the statistic of each block is its phase.
        phase = _moving_median(_blocks_of(r - rows_level, width, name), _SMOOTH_BLOCKS)
    losses = _with_closed_gaps(ticks, closed, far, rows_level, width=width, name=name)
    # Losses that are not counted move the phase for good, and longer parts by more; after a delay it returns.
    longer, shorter = (np.std(np.diff(_blocks_of(r, max(1, n // parts), "mean"), 2)) for parts in (16, 64))
    return replace(losses, unclear=bool(coherence < SEARCH.clear and longer > shorter))


def _moving_median(v: Vector, width: int) -> Vector:
    """Return the running median over `width` values, with the end values repeated."""
    half = min(width, v.size) // 2
    wide = np.concatenate([np.full(half, v[0]), v, np.full(half, v[-1])])
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(wide, 2 * half + 1), axis=1))


def _blocks(ticks: Vector, interval: float, width: int, name: str) -> Vector:
    count = ticks.size // width
    r = (ticks / interval - np.arange(ticks.size))[: count * width].reshape(count, width)
    return _STATISTICS[name](r)


def _refine(ticks: Vector, interval: float, width: int, name: str) -> float:
    """Return the interval at which the statistics of blocks keep their phase."""
    lag = 1
    for _ in range(2):
        b = _blocks(ticks, interval, width, name)
        turn = _turn(b, lag)
        interval *= 1 + turn / width
    while lag * 4 <= b.size // 6 and lag < 256:
        lag *= 4
        b = _blocks(ticks, interval, width, name)
        interval *= 1 + _turn(b, lag) / (width * lag)
    return interval


def _turn(b: Vector, lag: int) -> float:
    """Return the mean change of the phase over `lag` blocks, in turns."""
    z = np.exp(2j * np.pi * b)
    return float(np.angle(np.mean(np.conj(z[:-lag]) * z[lag:]))) / (2 * np.pi)


def _coherence(b: Vector) -> float:
    """Return how well neighbouring blocks agree modulo 1: exp(-4π²σ²) for a standard deviation of σ samples."""
    z = np.exp(2j * np.pi * b)
    return float(np.abs(np.mean(np.conj(z[:-1]) * z[1:])))


def _with_closed_gaps(
    ticks: Vector, closed: Vector, far: Rows, level: Rows, width: int, name: str = "mean"
) -> SampleLosses:
    """Return the gaps from the levels of the rows, together with the long gaps that were closed."""
    index = (np.arange(ticks.size) + (level - level[0])).astype(np.float64)
    slope = _slope(index, closed, far)
    if width > 1:
        b = _blocks_of(closed / slope - index, width, name)
        centres = _blocks_of(index, width, "mean")
        begins = np.unique((far + width - 1) // width)
        slope *= 1 + _slope(centres, b, begins[(begins > 0) & (begins < b.size)])
    rise = np.diff(level, prepend=level[:1])
    if far.size:
        away = closed / slope - index
        steps = np.diff(ticks, prepend=ticks[:1]) - np.diff(closed, prepend=closed[:1])
        span = max(8, width)
        for row in far.tolist():
            sides = (away[max(0, row - span) : row], away[row : row + span])
            before, after = (float(_STATISTICS[name](side[None])[0]) for side in sides)
            rise[row] = round(rise[row] + steps[row] / slope + after - before)
    rows = np.flatnonzero(rise > 0)
    repeated = np.repeat(np.arange(rise.size), np.maximum(-rise, 0).astype(np.int64))
    return SampleLosses(slope, rows, rise[rows].astype(np.int64), width=width, repeated=repeated)


def _blocks_of(v: Vector, width: int, name: str) -> Vector:
    count = v.size // width
    return _STATISTICS[name](v[: count * width].reshape(count, width))
