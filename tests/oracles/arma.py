"""Autocovariances of ARMA processes in many digits: sums of exponentials, by the roots of φ, which must be single."""

from __future__ import annotations

import warnings
from functools import lru_cache
from itertools import pairwise

import mpmath as mp


def multiplied(a: list[mp.mpf], b: list[mp.mpf]) -> list[mp.mpf]:
    out = [mp.mpf(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            out[i + j] += x * y
    return out


def polynomials(theta: list[mp.mpf], orders: tuple[int, int, int, int, int]) -> tuple[list[mp.mpf], list[mp.mpf]]:
    """φ(B)Φ(B^s) and θ(B)Θ(B^s) from their coefficients, lowest power first."""
    p, q, seasonal_p, seasonal_q, period = orders
    ends = (0, p, p + q, p + q + seasonal_p, p + q + seasonal_p + seasonal_q)
    phi, ma, seasonal_phi, seasonal_ma = ([mp.mpf(v) for v in theta[a:b]] for a, b in pairwise(ends))

    def spread(values: list[mp.mpf], sign: int, by: int) -> list[mp.mpf]:
        out = [mp.mpf(1)] + [mp.mpf(0)] * (by * len(values))
        for k, v in enumerate(values, 1):
            out[k * by] = sign * v
        return out

    return (
        multiplied(spread(phi, -1, 1), spread(seasonal_phi, -1, period)),
        multiplied(spread(ma, 1, 1), spread(seasonal_ma, 1, period)),
    )


@lru_cache(maxsize=4096)
def exponentials(
    theta: tuple[mp.mpf, ...], orders: tuple[int, int, int, int, int], digits: int
) -> tuple[list[tuple[mp.mpc, mp.mpc]], list[mp.mpf]]:
    """r(k) = Σ A λ^k + c(k): pairs (A, λ), and c(k) at lags 0, 1, … as long as it is not zero."""
    with mp.workdps(digits):
        ar, ma = polynomials(list(theta), orders)
        while ar[-1] == 0:
            ar.pop()
        with warnings.catch_warnings():  # newer mpmath wants the order named, older knows no name for it
            warnings.simplefilter("ignore", DeprecationWarning)
            roots = mp.polyroots(ar, maxsteps=2000, extraprec=4 * digits) if len(ar) > 1 else []
        q = len(ma) - 1
        driven = []
        for i, root in enumerate(roots):
            weight = 1 / (1 - root * root)
            for j, other in enumerate(roots):
                if j != i:
                    weight /= (1 - other / root) * (1 - other * root)
            driven.append(weight)

        def alone(k: int) -> mp.mpf:
            return mp.re(sum(w * r ** abs(k) for w, r in zip(driven, roots, strict=True))) if roots else mp.mpf(k == 0)

        def product(lag: int) -> mp.mpf:
            return sum(ma[i] * ma[i + lag] for i in range(q + 1 - lag))

        def gain(z: mp.mpc) -> mp.mpc:
            return sum(c * z**i for i, c in enumerate(ma))

        pairs = [(w * gain(r) * gain(1 / r), r) for w, r in zip(driven, roots, strict=True)]
        early = [
            sum(product(abs(j)) * alone(k - j) for j in range(-q, q + 1)) - mp.re(sum(a * r**k for a, r in pairs))
            for k in range(max(0, q - len(roots) + 1))
        ]
        return pairs, early
