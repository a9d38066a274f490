"""The Haar wavelet variance against `numpy.cumsum` of the same array, and against a plain pyramid in NumPy."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
from numpy.typing import NDArray

import gmwm
from benchmarks.harness import Case
from gmwm import _core


def pyramid(x: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """The same numbers by plain NumPy: sums of 2, 4, 8 … neighbours, and their differences.

    It is given the benefit of buffers of its own: fresh arrays at every level cost several times more.
    """
    variance = np.empty(levels)
    sums, spare, difference = x.copy(), np.empty_like(x), np.empty_like(x)
    n = x.size
    for k in range(levels):
        h = 2**k
        m = n - h
        w = np.subtract(sums[h:n], sums[:m], out=difference[:m])
        variance[k] = w @ w / m / 4 ** (k + 1)
        np.add(sums[h:n], sums[:m], out=spare[:m])
        sums, spare, n = spare, sums, m
    return variance


def cases() -> Iterable[Case]:
    """10^6 and 10^7 samples, all levels that exist."""
    for n, repeats, target in ((10**6, 31, 1.3), (10**7, 9, None)):
        x = np.random.default_rng(1).standard_normal(n)
        buffer = np.empty(n)
        levels = n.bit_length() - 1
        np.testing.assert_allclose(_core.haar_variance(x, levels), pyramid(x, levels), rtol=1e-9)

        size = f"10^{len(str(n)) - 1}"
        coefficients = sum(n - 2**j + 1 for j in range(1, levels + 1))
        cumsum = partial(np.cumsum, x, out=buffer)
        kernel = partial(_core.haar_variance, x, levels)
        # The signal is read twice (mean, running sum), the running sum is written once.
        moved = 3 * x.nbytes
        yield Case(
            f"kernel, {levels} levels of {size}", kernel, "np.cumsum", cumsum, repeats, target, moved, coefficients
        )
        yield Case(
            f"gmwm.wavelet_variance of {size}", partial(gmwm.wavelet_variance, x, 1.0), "np.cumsum", cumsum,
            repeats, target, moved, coefficients,
        )  # fmt: skip
        yield Case(f"running sum of {size}", partial(_core.running_sum, x), "np.cumsum", cumsum, repeats, None, moved)
        total = _core.running_sum(x)
        squares = partial(_core.haar_sums_of_squares, total, levels, 0, n)
        # Once through the running sum is what must be read; the caches serve most of the levels.
        yield Case(
            f"levels of {size}", squares, "np.cumsum", cumsum, repeats, None, total.nbytes, coefficients
        )  # fmt: skip
        if n <= 10**6:
            yield Case(
                f"kernel, {levels} levels of {size}", kernel, "NumPy pyramid", partial(pyramid, x, levels), 7
            )  # fmt: skip
