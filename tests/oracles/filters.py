"""Wavelet filters in 60 digits: tables made orthonormal, and wavelet variances from autocovariances at all lags.

No formula of the package: the autocovariance of the scaling coefficients is filtered level by level, number by
number at lags up to L and by its exact form beyond, and what cancels is paid for in digits.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache

import mpmath as mp

from tests.oracles.arma import exponentials, multiplied

DIGITS = 100

Sequence = Callable[[int], mp.mpf]


def orthonormal(scaling: list[float], moments: int) -> list[mp.mpf]:
    """The filter with these vanishing moments next to `scaling`, by Newton steps of least length."""
    with mp.workdps(DIGITS):
        length = len(scaling)
        g = mp.matrix([mp.mpf(v) for v in scaling])
        place = [(2 * mp.mpf(i) - (length - 1)) / length for i in range(length)]
        for _ in range(9):
            rows, defect = [], []
            for k in range(length // 2):
                row = [mp.mpf(0)] * length
                for i in range(length - 2 * k):
                    row[i] += g[i + 2 * k]
                    row[i + 2 * k] += g[i]
                rows.append(row)
                defect.append(sum(g[i] * g[i + 2 * k] for i in range(length - 2 * k)) - (k == 0))
            for n in range(moments):
                row = [(-1) ** i * place[i] ** n for i in range(length)]
                rows.append(row)
                defect.append(sum(a * b for a, b in zip(row, g, strict=True)))
            if max(map(abs, defect)) < mp.mpf(10) ** (10 - DIGITS):
                break
            slopes = mp.matrix(rows)
            g -= slopes.T * mp.lu_solve(slopes * slopes.T, mp.matrix(defect))
        return list(g)


def extremal_phase(moments: int) -> list[mp.mpf]:
    """Daubechies' filter by factoring its squared gain: the zeros within the unit circle."""
    with mp.workdps(DIGITS):
        p = moments
        # Σ_k C(p−1+k, k) y^k with y = (2 − z − 1/z)/4
        gain = [mp.binomial(p - 1 + k, k) for k in range(p - 1, -1, -1)]
        with warnings.catch_warnings():  # newer mpmath wants the order named, older knows no name for it
            warnings.simplefilter("ignore", DeprecationWarning)
            roots = mp.polyroots(gain, maxsteps=500, extraprec=400)
        taps = [mp.mpf(1)]
        for y in roots:
            b = 1 - 2 * y
            pair = [b + mp.sqrt(b * b - 1), b - mp.sqrt(b * b - 1)]
            taps = multiplied(taps, [1, -min(pair, key=abs)])
        for _ in range(p):
            taps = multiplied(taps, [mp.mpf(1), mp.mpf(1)])
        taps = [mp.re(v) for v in taps]
        return [v * mp.sqrt(2) / sum(taps) for v in taps]


def _autocorrelation(filter_: list[mp.mpf]) -> list[mp.mpf]:
    n = len(filter_)
    return [sum(filter_[i] * filter_[i + abs(k)] for i in range(n - abs(k))) / 2 for k in range(1 - n, n)]


def _levels(
    g: list[mp.mpf], start: Sequence, beyond: Callable[[int, list[mp.mpf]], Sequence], levels: int, widths: int = 1
):
    """ν_j², j = 1 … levels: `start` is the autocovariance, `beyond(j, …)` its exact form at level j past `widths` L."""
    length = len(g)
    h = [(-1) ** i * g[length - 1 - i] for i in range(length)]
    smooth, detail = _autocorrelation(g), _autocorrelation(h)
    reach = range(1 - length, length)
    current, out = cache(start), []
    for j in range(levels):
        out.append(sum(current(abs(n)) * w for n, w in zip(reach, detail, strict=True)))
        near = [sum(current(abs(2 * k - n)) * w for n, w in zip(reach, smooth, strict=True))
                for k in range(widths * length + 1)]  # fmt: skip
        far = beyond(j + 1, smooth)

        def following(k: int, near: list[mp.mpf] = near, far: Sequence = far) -> mp.mpf:
            return near[k] if k < len(near) else far(k)

        current = cache(following)
    return out


def gauss_markov(g: list[mp.mpf], lam: float, levels: int) -> list[mp.mpf]:
    """ν_j² of autocovariance e^(−λ|k|)."""
    with mp.workdps(DIGITS):
        phi = mp.exp(-mp.mpf(lam))
        return _alternating(g, phi, levels)


def oscillator(g: list[mp.mpf], frequency: float, quality: float, rate: float, levels: int) -> list[mp.mpf]:
    """ν_j² of a damped oscillator of variance 1, whose autocovariance is Re (1 − iα/ω) e^((−α + iω)|k|)."""
    with mp.workdps(DIGITS):
        natural, ratio = 2 * mp.pi * mp.mpf(frequency) / mp.mpf(rate), 1 / (2 * mp.mpf(quality))
        damping, turn = natural * ratio, natural * mp.sqrt(1 - ratio**2)
        terms = _alternating(g, mp.exp(mp.mpc(-damping, turn)), levels)
        return [(mp.mpc(1, -damping / turn) * v).real for v in terms]


def autoregression(g: list[mp.mpf], phi: float, levels: int) -> list[mp.mpf]:
    """ν_j² of an AR(1) process with innovation variance 1."""
    with mp.workdps(DIGITS):
        phi = mp.mpf(phi)
        return [v / (1 - phi * phi) for v in _alternating(g, phi, levels)]


def _alternating(g: list[mp.mpf], phi: mp.mpf, levels: int) -> list[mp.mpf]:
    reach = range(1 - len(g), len(g))
    factor = [mp.mpf(1)]

    def beyond(level: int, smooth: list[mp.mpf]) -> Sequence:
        below = phi ** (2 ** (level - 1))
        factor[0] *= sum(w * below ** (-n) for n, w in zip(reach, smooth, strict=True))
        scale, power = factor[0], phi ** (2**level)
        return lambda k: scale * power**k

    if phi == 0:
        return _levels(g, lambda k: mp.mpf(k == 0), lambda level, smooth: lambda k: mp.mpf(0), levels)
    return _levels(g, lambda k: phi**k, beyond, levels)


def white(g: list[mp.mpf], levels: int) -> list[mp.mpf]:
    """ν_j² of white noise of variance 1."""
    with mp.workdps(DIGITS):
        return _levels(g, lambda k: mp.mpf(k == 0), lambda level, smooth: lambda k: mp.mpf(0), levels)


def quantization(g: list[mp.mpf], levels: int) -> list[mp.mpf]:
    """ν_j² of e_t − e_{t−1}, Var e = 1."""
    with mp.workdps(DIGITS):
        start = [mp.mpf(2), mp.mpf(-1)]
        return _levels(g, lambda k: start[k] if k < 2 else mp.mpf(0), lambda level, smooth: lambda k: mp.mpf(0), levels)


def walk(g: list[mp.mpf], levels: int) -> list[mp.mpf]:
    """ν_j² of a random walk, −½E(X_{t+k} − X_t)² = −|k|/2."""
    with mp.workdps(DIGITS):
        return _levels(g, lambda k: -mp.mpf(k) / 2, lambda level, smooth: lambda k: -mp.mpf(k) * 2**level / 2, levels)


def drift(g: list[mp.mpf], levels: int) -> list[mp.mpf]:
    """ν_j² of the ramp t, −½(X_{t+k} − X_t)² = −k²/2."""
    reach = range(1 - len(g), len(g))
    constant = [mp.mpf(0)]

    def beyond(level: int, smooth: list[mp.mpf]) -> Sequence:
        constant[0] -= mp.mpf(4) ** (level - 1) * sum(w * n * n for n, w in zip(reach, smooth, strict=True)) / 2
        offset = constant[0]
        return lambda k: offset - mp.mpf(4) ** level * k * k / 2

    with mp.workdps(DIGITS):
        return _levels(g, lambda k: -mp.mpf(k) * k / 2, beyond, levels)


def sinusoid(g: list[mp.mpf], frequency: float, rate: float, levels: int) -> list[mp.mpf]:
    """ν_j² of a sinusoid of mean square 1: squared gains, with the taps as they stand."""
    with mp.workdps(DIGITS):
        length, smooth, cycles, out = len(g), mp.mpf(1), mp.mpf(frequency) / mp.mpf(rate), []
        h = [(-1) ** i * g[length - 1 - i] for i in range(length)]
        for j in range(levels):
            z = mp.expjpi(2 * mp.mpf(2) ** j * cycles)
            gain, rest = (abs(mp.fsum(v * z**i for i, v in enumerate(taps))) ** 2 / 2 for taps in (h, g))
            out.append(smooth * gain)
            smooth *= rest
        return out


def power(g: list[mp.mpf], epsilon: mp.mpf, levels: int) -> list[mp.mpf]:
    """ν_j² of a running sum of covariance |m|^(2+ε)/(2(2^ε − 1)): second differences, by powers of 1/k far out."""
    terms, reach = 24, range(1 - len(g), len(g))
    with mp.workdps(DIGITS):
        # A logarithm is the difference of two powers that are next to each other.
        eps = mp.mpf(epsilon) or mp.mpf(10) ** -60
        scale = -1 / (2 * (mp.mpf(2) ** eps - 1))
        tail = [2 * scale * mp.binomial(2 + eps, 2 * s + 2) for s in range(terms)]

        @cache
        def start(k: int) -> mp.mpf:
            return scale * (mp.mpf(k + 1) ** (2 + eps) - 2 * mp.mpf(k) ** (2 + eps) + mp.mpf(abs(k - 1)) ** (2 + eps))

        def beyond(level: int, smooth: list[mp.mpf]) -> Sequence:
            if level == 1:
                moments = [sum(w * mp.mpf(n) ** (2 * i) for n, w in zip(reach, smooth, strict=True))
                           for i in range(terms)]  # fmt: skip
                table[:] = [[mp.mpf(2) ** (eps - 2 * t) * mp.binomial(eps - 2 * s, 2 * (t - s)) * moments[t - s]
                             for s in range(t + 1)] for t in range(terms)]  # fmt: skip
            tail[:] = [sum(a * b for a, b in zip(row, tail, strict=False)) for row in table]
            here = list(tail)

            @cache
            def far(k: int) -> mp.mpf:
                y, total = mp.mpf(k) ** -2, mp.mpf(0)
                for a in reversed(here):
                    total = total * y + a
                return total * mp.mpf(k) ** eps

            return far

        table: list[list[mp.mpf]] = []
        return _levels(g, start, beyond, levels, widths=2)


def arma(g: list[mp.mpf], theta: list[float], orders: tuple[int, int, int, int, int], levels: int) -> list[mp.mpf]:
    """ν_j² of an ARMA process with innovation variance 1: exponentials, and what is left at the first lags."""
    with mp.workdps(DIGITS):
        pairs, early = exponentials(tuple(map(mp.mpf, theta)), orders, DIGITS)
        weights, reach = [weight for weight, _ in pairs], range(1 - len(g), len(g))

        def start(k: int) -> mp.mpf:
            return mp.re(sum(w * root**k for w, root in pairs)) + (early[k] if k < len(early) else 0)

        def beyond(level: int, smooth: list[mp.mpf]) -> Sequence:
            powers = [root ** (2**level) for _, root in pairs]
            for i, (_, root) in enumerate(pairs):
                below = root ** (2 ** (level - 1))
                weights[i] *= sum(w * below ** (-n) for n, w in zip(reach, smooth, strict=True))
            here = list(weights)
            return lambda k: mp.re(sum((w * power**k for w, power in zip(here, powers, strict=True)), mp.mpf(0)))

        return _levels(g, start, beyond, levels, widths=1 + len(early) // len(g))


ARMA = {
    "AR(2)": (2, 0, 0, 0, 1),
    "MA(1)": (0, 1, 0, 0, 1),
    "ARMA(2,1)": (2, 1, 0, 0, 1),
    "SARMA(1,1,1,0,4)": (1, 1, 1, 0, 4),
}
"""Orders p, q, P, Q and the period of those that laws are tested on."""

SHAPES: dict[str, Callable[[list[mp.mpf], list[float], float, int], list[mp.mpf]]] = {
    "WN": lambda g, theta, rate, levels: white(g, levels),
    "QN": lambda g, theta, rate, levels: quantization(g, levels),
    "RW": lambda g, theta, rate, levels: walk(g, levels),
    "DR": lambda g, theta, rate, levels: drift(g, levels),
    "AR1": lambda g, theta, rate, levels: autoregression(g, theta[0], levels),
    "GM": lambda g, theta, rate, levels: gauss_markov(g, theta[0] / rate, levels),
    "OSC": lambda g, theta, rate, levels: oscillator(g, theta[0], theta[1], rate, levels),
    "FN": lambda g, theta, rate, levels: [v * mp.ln(2) / mp.pi for v in power(g, mp.mpf(0), levels)],
    "PL": lambda g, theta, rate, levels: power(g, mp.mpf(theta[0]) - 1, levels),
    "FGN": lambda g, theta, rate, levels: [
        v * (1 - mp.mpf(2) ** (2 * mp.mpf(theta[0]) - 2)) for v in power(g, 2 * mp.mpf(theta[0]) - 2, levels)
    ],
    "SIN": lambda g, theta, rate, levels: sinusoid(g, theta[0], rate, levels),
    **{
        name: lambda g, theta, rate, levels, orders=orders: arma(g, theta, orders, levels)
        for name, orders in ARMA.items()
    },
}
"""Wavelet variance at scale coefficient 1, levels 1 … J, of each process that has its own under every filter."""
STRIDES = {"PL": 5, "FGN": 9, **dict.fromkeys(ARMA, 5)}
"""Of processes whose sums take long: every how many of the places are looked at."""
