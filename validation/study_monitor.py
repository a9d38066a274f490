"""Monitor of a sensor at rest: run length between false alarms, delay until a fault is seen, and kind that is named.

All signals are simulated in plain NumPy.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from gmwm.applications.monitor import Baseline, Monitor, charts
from gmwm.applications.monitor import api as monitor_api
from gmwm.theory.processes.model import Model

NAME = "monitor"
SEED = 20261124
RATE = 100.0
WANTED = 1e6
"""Samples between false alarms in the first table."""
SAMPLES = 400_000_000
RARE = 1e7
"""Samples between false alarms in the other tables: 28 h."""
REPEATS = 100
BEFORE = 60_000
"""Good samples before a fault."""
LONG = 120_000
REFERENCE = 400_000
CHUNK = 1 << 18
CHARTS = (((1.5,), 16), ((2.0, 1.25), 16), ((2.0, 1.25), 4))
"""Ratios R of variances of the charts for more noise, and lengths of their blocks in units of 2^j samples."""
SLOWEST = ("noise × 1.1", "noise × 1.5", "Gauss-Markov noise × 2")

DEG_H = np.pi / 180 / 3600
WHITE = (0.15 * np.pi / 180 / 60) ** 2 * RATE
SLOW, DECAY = (29 * DEG_H) ** 2, np.exp(-0.02 / RATE)
WALK = (5 * DEG_H / 60) ** 2 / RATE
GYRO = f"GM(beta=0.02, sigma2={SLOW!r}) + WN(sigma2={WHITE!r}) + RW(gamma2={WALK!r})"

Array = NDArray[np.float64]


class Source:
    """A good signal in chunks: white noise, and further processes with their states."""

    def __init__(self, rng: np.random.Generator, *, slow: float = 0.0, walk: float = 0.0, fast: float = 0.0) -> None:
        self._rng, self._slow, self._walk, self._fast = rng, slow, walk, fast
        self._level, self._recursion = 0.0, np.zeros(2)
        self._state = np.array([DECAY * np.sqrt(slow) * rng.standard_normal()])

    def __call__(self, n: int) -> Array:
        rng = self._rng
        x = np.sqrt(WHITE) * rng.standard_normal(n)
        if self._slow:
            step = np.sqrt(self._slow * (1 - DECAY**2))
            own, self._state = lfilter([1.0], [1.0, -DECAY], step * rng.standard_normal(n), zi=self._state)
            x += own
        if self._walk:
            path = self._level + np.cumsum(np.sqrt(self._walk) * rng.standard_normal(n))
            self._level = float(path[-1])
            x += path
        if self._fast:
            drive = np.sqrt(self._fast) * rng.standard_normal(n)
            own, self._recursion = lfilter([1.0], [1.0, -1.4, 0.6], drive, zi=self._recursion)
            x += own
        return x


GOOD: dict[str, tuple[str, dict[str, float]]] = {
    "WN": (f"WN(sigma2={WHITE!r})", {}),
    "WN + RW": (f"WN(sigma2={WHITE!r}) + RW(gamma2={1e-6 * WHITE!r})", {"walk": 1e-6 * WHITE}),
    "GM + WN + RW": (GYRO, {"slow": SLOW, "walk": WALK}),
    "AR(2) + WN": (
        f"AR(2, phi1=1.4, phi2=-0.6, sigma2={0.1 * WHITE!r}) + WN(sigma2={WHITE!r})",
        {"fast": 0.1 * WHITE},
    ),
}


def _slower(x: Array, factor: float, rng: np.random.Generator) -> None:
    """More Gauss-Markov noise, which begins at zero."""
    own = lfilter([1.0], [1.0, -DECAY], np.sqrt((factor**2 - 1) * SLOW * (1 - DECAY**2)) * rng.standard_normal(x.size))
    x += own


def _noisier(x: Array, factor: float, rng: np.random.Generator) -> None:
    x += np.sqrt((factor**2 - 1) * WHITE) * rng.standard_normal(x.size)


def _spiky(x: Array, rng: np.random.Generator) -> None:
    places = rng.random(x.size) < 1e-3
    x[places] += 6 * np.sqrt(WHITE) * rng.choice([-1.0, 1.0], int(places.sum()))


def _humming(x: Array, rng: np.random.Generator) -> None:
    phase = rng.uniform(0, 2 * np.pi)
    x += 0.3 * np.sqrt(2 * WHITE) * np.sin(2 * np.pi * 10.0 * np.arange(x.size) / RATE + phase)


def _averaged(x: Array) -> None:
    x[1:] = 0.5 * (x[1:] + x[:-1])


def _stuck(x: Array) -> None:
    x[:] = x[0]


def _raised(x: Array, by: Array | float) -> None:
    x += by


Fault = Callable[[Array, np.random.Generator], None]
FAULTS: dict[str, tuple[str, Fault]] = {
    "noise × 1.1": ("noise-up", lambda x, rng: _noisier(x, 1.1, rng)),
    "noise × 1.5": ("noise-up", lambda x, rng: _noisier(x, 1.5, rng)),
    "noise × 2": ("noise-up", lambda x, rng: _noisier(x, 2.0, rng)),
    "Gauss-Markov noise × 2": ("noise-up", lambda x, rng: _slower(x, 2.0, rng)),
    "Gauss-Markov noise × 4": ("noise-up", lambda x, rng: _slower(x, 4.0, rng)),
    "jump of 100 deg/h": ("jump", lambda x, rng: _raised(x, 100 * DEG_H)),
    "jump of 360 deg/h": ("jump", lambda x, rng: _raised(x, 360 * DEG_H)),
    "ramp of 1000 deg/h per h": ("ramp", lambda x, rng: _raised(x, 1000 * DEG_H * np.arange(x.size) / RATE / 3600)),
    "hum of 0.3 σ at 10 Hz": ("hum", _humming),
    "spikes of 6 σ, 1 in 1000": ("spike", _spiky),
    "mean of two samples": ("noise-down", lambda x, rng: _averaged(x)),
    "frozen": ("frozen", lambda x, rng: _stuck(x)),
}


def run(reduced: bool = False) -> dict[str, Any]:
    """Run lengths of good sensors, and delays and kinds of faults."""
    samples, repeats = (1_000_000, 3) if reduced else (SAMPLES, REPEATS)
    names = list(FAULTS)[:8:3] if reduced else list(FAULTS)
    before = monitor_api.REMEMBERED_S
    # Every alarm counts, also one of the same kind within an hour.
    monitor_api.REMEMBERED_S = 0.0
    try:
        lengths = [_length(k, name, samples) for k, name in enumerate(GOOD)]
        lengths.append(_length(len(GOOD), "GM + WN + RW", samples, baseline=True))
        rows = [_delay(list(FAULTS).index(name), name, repeats) for name in names]
        compared = _compared(repeats)
    finally:
        monitor_api.REMEMBERED_S = before
    return {"lengths": lengths, "rows": rows, "repeats": repeats, "charts": compared}


def _compared(repeats: int) -> list[dict[str, Any]]:
    """Delays with other charts."""
    noise, length, found = charts.NOISE, charts.BLOCKS_OF_LEVEL, []
    try:
        for ratios, blocks in CHARTS:
            charts.NOISE = (*(("noise up", 1, ratio) for ratio in ratios), noise[-1])
            charts.BLOCKS_OF_LEVEL = blocks
            charts.white_shape.cache_clear()
            rows = [_delay(list(FAULTS).index(name), name, repeats) for name in SLOWEST]
            found.append({"ratios": ratios, "blocks": blocks, "delays": [[r["median"], r["most"]] for r in rows]})
    finally:
        charts.NOISE, charts.BLOCKS_OF_LEVEL = noise, length
        charts.white_shape.cache_clear()
    return found


def _length(place: int, name: str, samples: int, *, baseline: bool = False) -> dict[str, Any]:
    text, terms = GOOD[name]
    rng = np.random.default_rng([SEED, place])
    source, known = Source(rng, **terms), None
    if baseline:
        known = {"gyro_x": Baseline.of(Model.parse(text), [source(REFERENCE)], RATE)}
    made, alarms, done = Monitor({"gyro_x": text}, WANTED / RATE, rate=RATE, baseline=known), 0, 0
    while done < samples:
        alarms += sum(event.kind != "still" for event in made.update({"gyro_x": source(CHUNK)}))
        done += CHUNK
    return {"model": name, "baseline": baseline, "samples": done, "alarms": alarms}


def _delay(place: int, name: str, repeats: int) -> dict[str, Any]:
    kind, spoil = FAULTS[name]
    blank = Monitor({"gyro_x": GYRO}, RARE / RATE, rate=RATE, baseline=None).to_dict()
    delays, right, early = [], 0, 0
    for k in range(repeats):
        rng = np.random.default_rng([SEED, 100 + place, k])
        x = Source(rng, slow=SLOW, walk=WALK)(BEFORE + LONG)
        spoil(x[BEFORE:], rng)
        made, events = Monitor.from_dict(blank), []
        for part in np.split(x, range(BEFORE, x.size, 15_000)):
            events += made.update({"gyro_x": part})
            if any(event.time >= BEFORE / RATE for event in events):
                break
        else:
            events += made.finish()
        after = [event for event in events if event.time >= BEFORE / RATE]
        early += len(events) > len(after)
        delays.append(after[0].time - BEFORE / RATE if after else np.inf)
        right += bool(after) and after[0].kind == kind
    found = np.isfinite(delays)
    return {
        "fault": name, "kind": kind, "found": float(found.mean()), "right": right / max(int(found.sum()), 1),
        "median": float(np.quantile(delays, 0.5, method="higher")),
        "most": float(np.quantile(delays, 0.9, method="higher")), "early": early,
    }  # fmt: skip


def table(result: dict[str, Any]) -> str:
    """Markdown: run lengths, delays and kinds."""
    lines = [
        f"A healthy sensor at {RATE:g} Hz is monitored. The monitor is set to one false alarm in {WANTED:g} samples. "
        "The *run length* is the number of samples for each alarm, with its standard error. Alarms in the same second "
        "are counted as one. With a baseline, variances within 10 % of it are not reported, so alarms are rarer than "
        "stated.",
        "",
        "| noise | baseline | samples | alarms | run length |",
        "|---|---|---|---|---|",
    ]
    for row in result["lengths"]:
        count = max(row["alarms"], 1)
        mean = row["samples"] / count
        lines.append(
            f"| {row['model']} | {'of ' + str(REFERENCE) + ' samples' if row['baseline'] else 'none'} | "
            f"{row['samples']:.2g} | {row['alarms']} | ({mean / 1e6:.2f} ± {mean / np.sqrt(count) / 1e6:.2f}) · 10⁶ |"
        )
    lines += [
        "",
        "A gyroscope with N = 0.15 deg/√h, Gauss-Markov noise of 29 deg/h over 50 s and K = 5 deg/h/√h has the faults "
        f"in the table. The monitor is set to one false alarm in {RARE:g} samples (28 h). The study uses "
        f"{result['repeats']} recordings of each fault. The *delay* is the time from the beginning of the fault to "
        "the first alarm. The last column has the kind of the fault, and the share of the detected faults for which "
        "it is identified correctly.",
        "",
        "| fault | found | median delay (s) | 90 % (s) | kind |",
        "|---|---|---|---|---|",
        *(
            f"| {r['fault']} | {100 * r['found']:.0f} % | {r['median']:.3g} | {r['most']:.3g} | "
            f"{r['kind']}: {100 * r['right']:.0f} % |"
            for r in result["rows"]
        ),
        "",
        f"Before the faults, the recordings have {len(result['rows']) * result['repeats'] * BEFORE:.2g} healthy "
        f"samples in total, and {sum(row['early'] for row in result['rows'])} recordings have a false alarm there.",
        "",
        "The next table has the median and the 90 % quantile of the delays (s) for other choices of the charts that "
        "detect more noise. *R* is the ratio of variances for which a chart is optimal. *Blocks* is the length of a "
        "block of level j, in units of 2^j samples. gmwm uses the last row. Two charts for each level detect small "
        "and large increases early, and short blocks detect slow noise early.",
        "",
        "| R | blocks | " + " | ".join(SLOWEST) + " |",
        "|---|---|" + "---|" * len(SLOWEST),
        *(
            f"| {' and '.join(f'{ratio:g}' for ratio in row['ratios'])} | {row['blocks']} | "
            + " | ".join(f"{median:.3g}, {most:.3g}" for median, most in row["delays"])
            + " |"
            for row in result["charts"]
        ),
        "",
        "A jump of 30 deg/h and a ramp of 100 deg/h per hour are smaller than the "
        "Gauss-Markov noise, so they are not detected as faults.",
    ]
    return "\n".join(lines)
