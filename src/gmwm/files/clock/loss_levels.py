"""Estimate the whole number of samples lost before each row from noisy values of `sampling_interval`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gmwm.base.arrays import Vector

Rows = NDArray[np.int64]

# The thresholds are pinned by the study of clocks, docs/validation/clocks.md.

_SOON = 64
"""Largest number of rows that are delivered late together, unless a longer interval shows that there are more."""
_STATES = 3  # number of levels above and below the first guess among which the path is searched
_DOUBTFUL = 0.45
"""Difference from the first guess (samples) above which a level is doubtful. A wrong level differs by 0.5 or more."""
_KEEP, _MARGIN = 64, 32
"""Rows of each part in which the path is searched, and rows on each side that are searched with it."""
_RISE, _AT_STEP = 8.0, 2.0
"""Cost of a rise, in mean deviations of a row, and by how much it is lower at the longest interval."""


def follow(x: Vector) -> Rows:
    """Return the levels, whole numbers, that fit x = levels + noise best, by dynamic programming. The levels decrease
    only where a row was written twice: there they fall below the levels of all recent rows."""
    rough = _median_of_five(np.round(x))
    past = np.concatenate([rough[:1], least_ahead(rough[::-1], _SOON)[::-1][:-1]])
    fallen = np.cumsum(np.maximum(past - rough, 0.0))
    horizon = int(_SOON + 2 * min(np.max(np.diff(x), initial=0.0), 2000.0))
    guess = least_ahead(rough + fallen, horizon) - fallen
    if np.max(np.abs(x - guess)) <= _DOUBTFUL:
        return np.asarray(guess.astype(np.int64))
    # A rise that is followed by a fall within `_SOON` rows is a late delivery.
    path = _best_path(x, guess.astype(np.int64))
    return np.asarray((least_ahead(path + fallen, _SOON) - fallen).astype(np.int64))


def _median_of_five(v: Vector) -> Vector:
    """Return the running median of five values. It does not change a sequence that never decreases."""
    if v.size < 5 or np.all(v[1:] >= v[:-1]):
        return v
    wide = np.concatenate([v[:1], v[:1], v, v[-1:], v[-1:]])
    a, b, c, d, e = (wide[k : k + v.size] for k in range(5))
    low, high = np.maximum(np.minimum(a, b), np.minimum(d, e)), np.minimum(np.maximum(a, b), np.maximum(d, e))
    least, most = np.minimum(low, high), np.maximum(low, high)
    return np.asarray(np.maximum(least, np.minimum(most, c)))


def least_ahead(v: Vector, width: int) -> Vector:
    """Return the minimum of each value and the `width` values after it."""
    width = min(width, v.size)
    out, reach = v, 1
    while reach < width:
        step = min(reach, width - reach)
        out = np.minimum(out, np.concatenate([out[step:], np.full(step, np.inf)]))
        reach += step
    return out


def _best_path(x: Vector, guess: Rows) -> Rows:
    """Return the levels of least squared distance from x plus a cost for each rise, searched near doubtful rows."""
    away, n = x - guess, x.size
    sigma = float(np.clip(1.4826 * np.median(np.abs(away)), 0.03, 0.3))
    share = np.count_nonzero(np.diff(guess) > 0) / n
    price = float(np.clip(1 - np.log(max(share, 1e-4)), 2.0, 8.0))
    doubtful = np.flatnonzero(np.abs(away) > _DOUBTFUL)
    parts = np.unique(np.concatenate([np.maximum(doubtful - 8, 0), np.minimum(doubtful + 8, n - 1)]) // _KEEP)
    out, states = guess.copy(), np.arange(-_STATES, _STATES + 1)
    for group in np.array_split(parts * _KEEP, max(1, parts.size // 4096)):
        rows = group[:, None] + np.arange(-_MARGIN, _KEEP + _MARGIN)
        inside = np.clip(rows, 0, n - 1)
        cost = np.minimum(0.5 * ((away[inside][..., None] - states) / sigma) ** 2, 12.0)
        cost[(rows < 0) | (rows >= n)] = 0.0
        steps = np.diff(guess[inside], axis=1)
        path = _viterbi(cost, steps, price)
        keep = (rows >= group[:, None]) & (rows < np.minimum(group[:, None] + _KEEP, n))
        out[rows[keep]] += states[path[keep]]
    return out


def _viterbi(cost: Vector, steps: Rows, price: float) -> Rows:
    """Return the state of each row on the path of lowest cost; `steps` is the rise of the guess between rows."""
    count, length, size = cost.shape
    value = cost[:, 0].copy()
    back = np.zeros((length, count, size), dtype=np.int8)
    index = np.arange(size)
    for k in range(1, length):
        best = np.minimum.accumulate(value, axis=1)
        # argmin of the running minimum
        new = np.concatenate([np.ones((count, 1), dtype=bool), value[:, 1:] < best[:, :-1]], axis=1)
        where = np.maximum.accumulate(np.where(new, index, 0), axis=1)
        same = index + steps[:, k - 1, None]  # the state of the row before at the same level
        at = np.clip(same, 0, size - 1)
        stay = np.where(same == at, np.take_along_axis(value, at, 1), np.inf)
        below = np.clip(same - 1, -1, size - 1)
        low = np.maximum(below, 0)
        rise = np.where(below >= 0, np.take_along_axis(best, low, 1) + price, np.inf)
        down = np.clip(same + 1, 0, size - 1)
        fall = np.where(same + 1 == down, np.take_along_axis(value, down, 1) + 3 * price, np.inf)
        choice = np.stack([stay, rise, fall])
        pick = np.argmin(choice, axis=0)
        source = np.where(pick == 0, at, np.where(pick == 1, np.take_along_axis(where, low, 1), down))
        value = np.take_along_axis(choice, pick[None], 0)[0] + cost[:, k]
        value = np.where(np.isfinite(value), value, 1e12)
        back[k] = source
    path = np.empty((count, length), dtype=np.int64)
    path[:, -1] = np.argmin(value, axis=1)
    lines = np.arange(count)
    for k in range(length - 1, 0, -1):
        path[:, k - 1] = back[k, lines, path[:, k]]
    return path


def median_of_three(v: Vector) -> Vector:
    """Return the running median of three values. It does not change a sequence that never decreases."""
    if v.size < 3:
        return v
    a, b, c = v[:-2], v[1:-1], v[2:]
    out = v.copy()
    out[1:-1] = np.maximum(np.minimum(a, b), np.minimum(np.maximum(a, b), c))
    return out


def row_levels(x: Vector, level: Vector, width: int, steps: Vector) -> Rows:
    """Return the level of each row from the level of each block of `width` rows. Each rise is at the row where it fits
    the values `x` best, preferably after a long interval (`steps`)."""
    level = np.maximum.accumulate(level)
    d = x[: level.size * width] - np.repeat(level, width)
    up, down = (max(float(np.mean(np.maximum(v, 0.0))), 0.05) for v in (d, -d))

    def cost(values: Vector) -> Vector:
        return np.minimum(np.where(values > 0, values / up, -values / down), 6.0)

    rises = np.flatnonzero(np.diff(level) > 0) + 1
    groups = np.split(rises, np.flatnonzero(np.diff(rises) > 2) + 1) if rises.size else []
    rise = np.zeros(x.size)
    for group in groups:
        low, high = max(1, int(group[0] - 2) * width), min(x.size, int(group[-1] + 2) * width)
        old, new = level[group[0] - 1], level[group[-1]]
        levels = np.unique(np.concatenate([[old], level[group], np.arange(old, min(new, old + 16)), [new]]))
        longest = steps[low - 1 : high - 1]
        price = _RISE - _AT_STEP * longest / np.max(longest)
        costs = np.stack([cost(x[low:high] - height) for height in levels])
        last = -x.size - 8 - width  # before all rows that could belong to the same loss
        for row, a, b in _cheapest(costs, price):
            jump, row = levels[b] - levels[a], low + row
            # Rows between two rises that belong to the same loss; in long blocks, an eighth of a block.
            if row - last <= max(8, width // 8):  # one gap that delayed rows split in two
                jump, rise[last] = jump + rise[last], 0.0
                row = max(row, last, key=lambda one: float(steps[one - 1]))
            rise[row], last = jump, row
    return np.cumsum(rise).astype(np.int64)


def _cheapest(costs: Vector, price: Vector) -> list[tuple[int, int, int]]:
    """Return the cheapest path of levels: the first row after each rise, and the levels around it, for `costs` (M, n)
    by level and row, and `price` (n,) of a rise."""
    total = np.concatenate([np.zeros((costs.shape[0], 1)), np.cumsum(costs, axis=1)], axis=1)[:, :-1]
    values, sources, rows = [total[0]], [np.zeros(total.shape[1], dtype=int)], [np.zeros(total.shape[1], dtype=int)]
    index = np.arange(total.shape[1])
    for j in range(1, costs.shape[0]):
        below = np.stack(values)
        source = np.argmin(below, axis=0)
        enter = below[source, index] + price - total[j]
        least = np.minimum.accumulate(enter)
        row = np.maximum.accumulate(np.where(enter <= least, index, 0))
        values.append(least + total[j])
        sources.append(source)
        rows.append(row)
    path, j, k = [], costs.shape[0] - 1, total.shape[1] - 1
    while j > 0:
        k = int(rows[j][k])
        i = int(sources[j][k])
        path.append((k, i, j))
        j = i
    return path[::-1]
