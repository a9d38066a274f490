"""Gaussian likelihoods and conditional distributions from whole covariance matrices; nothing recursive, no filter.

Covariances are those of the definitions: of moving averages of white noise where a process is one. What is unknown
without a distribution (a level) is integrated out, a drift's slope is at its best.
"""

from __future__ import annotations

from functools import cache

import mpmath as mp
import numpy as np
from scipy.linalg import cho_factor, cho_solve, toeplitz
from scipy.signal import lfilter


def _polynomials(process):
    """AR and MA polynomials of a process with orders, multiplied out: 1 − φ₁z − …, 1 + θ₁z + …"""
    period = int(process.name.rstrip(")").rpartition(",")[2]) if process.name.startswith("SARMA") else 1
    product = {"phi": np.ones(1), "theta": np.ones(1)}
    for name, value in process.values.items():
        family = name.rstrip("0123456789")
        base = family.removeprefix("s")
        if base not in product:
            continue
        order = int(name[len(family) :])
        power = order * (period if family.startswith("s") else 1)
        parts = product.setdefault((family, base), np.ones(1))
        parts = np.pad(parts, (0, max(power + 1 - parts.size, 0)))
        parts[power] = -value if base == "phi" else value
        product[family, base] = parts
    for key, parts in list(product.items()):
        if isinstance(key, tuple):
            product[key[1]] = np.convolve(product[key[1]], parts)
    return product["phi"], product["theta"]


@cache
def covariance(process, n: int, rate: float):
    """Covariance (n, n) of a term; that of a walk from the sample before its first."""
    k, v = np.arange(n), process.values
    match process.name.partition("(")[0]:
        case "WN":
            return v["sigma2"] * np.eye(n)
        case "QN":
            return v["q2"] * toeplitz(np.r_[2.0, -1.0, np.zeros(n - 2)])
        case "RW":
            return v["gamma2"] * np.minimum.outer(k + 1.0, k + 1.0)
        case "DR":
            return np.zeros((n, n))
        case "GM":
            return v["sigma2"] * np.exp(-v["beta"] / rate * toeplitz(k))
        case "OSC":
            omega, t = 2 * np.pi * v["frequency"], toeplitz(k) / rate
            a = omega / 2 / v["quality"]
            turn = np.sqrt(omega**2 - a**2)
            return v["sigma2"] * np.exp(-a * t) * (np.cos(turn * t) + a / turn * np.sin(turn * t))
        case "AR1":
            return v["sigma2"] / (1 - v["phi"] ** 2) * v["phi"] ** toeplitz(k)
        case "SIN":
            return process.scale * np.cos(2 * np.pi * v["frequency"] / rate * toeplitz(k))
        case "AR" | "MA" | "ARMA" | "SARMA":
            ar, ma = _polynomials(process)
            weights = lfilter(ma, ar, np.r_[1.0, np.zeros(4_000)])
            assert abs(weights[-1]) < 1e-14
            return v["sigma2"] * toeplitz([weights[: weights.size - j] @ weights[j:] for j in range(n)])
    raise NotImplementedError(process.name)


def design(model, n: int, *, mean: float | None):
    """Known course (n,), levels (n, m) that are integrated out, and drifts (n, d) whose slope is free."""
    t = np.arange(n, dtype=float)
    names = [p.name for p in model.processes]
    known = np.full(n, mean or 0.0)
    slopes = []
    for process in model.processes:
        if process.name == "DR":
            if process.is_fixed("omega"):
                known += process.values["omega"] * t
            else:
                slopes.append(t)
    flat = [np.ones(n)] if mean is None or "RW" in names else []
    return known, np.array(flat).reshape(-1, n).T, np.array(slopes).reshape(-1, n).T


def loglikelihood(model, x, rate: float, *, mean: float | None = None) -> float:
    """log p of the samples that are there; with levels −½ [N log 2π + log|C| + log|XᵀC⁻¹X| + rᵀC⁻¹r]."""
    x = np.asarray(x, dtype=float)
    there = np.isfinite(x)
    known, flat, slopes = design(model, x.size, mean=mean)
    C = sum(covariance(p, x.size, rate) for p in model.processes)[np.ix_(there, there)]
    y, flat, slopes = (x - known)[there], flat[there], slopes[there]
    factor = cho_factor(C, lower=True)
    logs = 2 * np.sum(np.log(np.diag(factor[0])))
    every = np.hstack([flat, slopes])
    if every.shape[1]:
        weighted = cho_solve(factor, every)
        y = y - every @ np.linalg.solve(every.T @ weighted, weighted.T @ y)
    if flat.shape[1]:
        logs += np.linalg.slogdet(flat.T @ cho_solve(factor, flat))[1]
    return float(-0.5 * (y.size * np.log(2 * np.pi) + logs + y @ cho_solve(factor, y)))


def precise(kernel, x, *, level: bool, digits: int = 60) -> mp.mpf:
    """The same in many digits for a stationary autocovariance kernel(k), with or without an unknown level."""
    with mp.workdps(digits):
        n = len(x)
        r = [kernel(k) for k in range(n)]
        C = mp.matrix(n, n)
        for i in range(n):
            for j in range(n):
                C[i, j] = r[abs(i - j)]
        L = mp.cholesky(C)
        logs = 2 * mp.fsum(mp.log(L[i, i]) for i in range(n))
        y, one = _whitened(L, x), _whitened(L, [1] * n)
        square = mp.fsum(v * v for v in y)
        if level:
            weight = mp.fsum(v * v for v in one)
            square -= mp.fsum(a * b for a, b in zip(one, y, strict=True)) ** 2 / weight
            logs += mp.log(weight)
        return -(n * mp.log(2 * mp.pi) + logs + square) / 2


def _whitened(L, x):
    out = []
    for i in range(len(x)):
        out.append((mp.mpf(x[i]) - mp.fsum(L[i, j] * out[j] for j in range(i))) / L[i, i])
    return out


def conditional(model, x, rate: float, wanted, *, mean: float | None = None, level: bool = False, upto=None):
    """Mean and standard deviation (n,) of a sum of terms at each sample, given all samples, or those up to each.

    wanted: which terms are summed (by their place); level: whether the unknown level is part of the sum; upto: "now"
    for what is known at each sample. Infinite where nothing determines it. Drifts are known.
    """
    x = np.asarray(x, dtype=float)
    n, there = x.size, np.isfinite(x)
    known, flat, _ = design(model, n, mean=mean)
    parts = [covariance(p, n, rate) for p in model.processes]
    total, own = sum(parts), sum((parts[k] for k in wanted), np.zeros((n, n)))
    share = flat * level
    means, errors = np.zeros(n), np.zeros(n)
    for t in range(n):
        seen = there & (np.arange(n) <= t) if upto == "now" else there
        m, v = 0.0, own[t, t]
        a = share[t]
        if seen.any():
            inverse = np.linalg.inv(total[np.ix_(seen, seen)])
            X, y, k = flat[seen], (x - known)[seen], own[t, seen]
            a = a - k @ inverse @ X
            v -= k @ inverse @ k
            b = np.zeros(X.shape[1])
            if X.shape[1]:
                spread = np.linalg.inv(X.T @ inverse @ X)
                b = spread @ X.T @ inverse @ y
                v += a @ spread @ a
            m = share[t] @ b + k @ inverse @ (y - X @ b)
        elif np.any(a != 0):
            v = np.inf
        means[t], errors[t] = m, np.sqrt(max(v, 0.0))
    return means, errors
