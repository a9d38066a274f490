"""The Haar wavelet variance against `numpy.cumsum` of the same array, a plain pyramid in NumPy, and PyWavelets."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

import numpy as np
import pywt
from numpy.typing import NDArray

import gmwm
from benchmarks.harness import Case
from gmwm.base import _core


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


def stationary(x: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """The same numbers by PyWavelets' stationary transform, of 2^k samples, without what it wraps around the end."""
    found = pywt.swt(x, "haar", levels, trim_approx=True, norm=True)
    inside = (w[: w.size - 2**j + 1] for j, w in enumerate(found[:0:-1], 1))
    return np.array([w @ w / w.size for w in inside])


def decimated(x: NDArray[np.float64], levels: int) -> NDArray[np.float64]:
    """The wavelet variance by PyWavelets' decimated transform, of 2^k samples."""
    found = pywt.wavedec(x, "haar", level=levels)
    return np.array([w @ w / w.size / 2**j for j, w in enumerate(found[:0:-1], 1)])


def other_hand() -> Iterable[Case]:
    """PyWavelets: a stationary transform of few levels and of all, twice as dear with each; and a decimated one."""
    for power, levels in ((20, 8), (14, 13)):
        x = np.random.default_rng(1).standard_normal(2**power)
        ours, theirs = partial(gmwm.wavelet_variance, x, 1.0, levels=levels), partial(stationary, x, levels)
        np.testing.assert_allclose(ours().variance, theirs(), rtol=1e-9)
        yield Case(f"gmwm.wavelet_variance, {levels} levels of 2^{power}", ours, "pywt.swt", theirs, 7)
    x = np.random.default_rng(1).standard_normal(2**20)
    ours, theirs = partial(gmwm.wavelet_variance, x, 1.0, levels=19, transform="dwt"), partial(decimated, x, 19)
    np.testing.assert_allclose(ours().variance, theirs(), rtol=1e-9)
    yield Case("the same, decimated, 19 levels of 2^20", ours, "pywt.wavedec", theirs, 11)


def cases() -> Iterable[Case]:
    """10^6 and 10^7 samples, all levels that exist."""
    yield from other_hand()
    for n, repeats, target in ((10**6, 31, 1.3), (10**7, 9, None)):
        x = np.random.default_rng(1).standard_normal(n)
        buffer = np.empty(n)
        levels = n.bit_length() - 1
        np.testing.assert_allclose(_core.haar_variance(x, levels)[0], pyramid(x, levels), rtol=1e-9)

        size = f"10^{len(str(n)) - 1}"
        coefficients = sum(n - 2**j + 1 for j in range(1, levels + 1))
        cumsum = partial(np.cumsum, x, out=buffer)
        kernel = partial(_core.haar_variance, x, levels)
        moved = 2 * x.nbytes  # the signal is read twice, for near and for far levels
        yield Case(
            f"kernel, {levels} levels of {size}", kernel, "np.cumsum", cumsum, repeats, target, moved, coefficients
        )
        yield Case(
            f"gmwm.wavelet_variance of {size}", partial(gmwm.wavelet_variance, x, 1.0), "np.cumsum", cumsum,
            repeats, target, moved, coefficients,
        )  # fmt: skip
        # The signal is read twice (mean, running sum), the running sum is written once.
        yield Case(
            f"running sum of {size}", partial(_core.running_sum, x), "np.cumsum", cumsum, repeats, None, 3 * x.nbytes
        )  # fmt: skip
        total = _core.running_sum(x)
        squares = partial(_core.haar_sums_of_squares, total, levels, 0, n)
        # Once through the running sum is what must be read; the caches serve most of the levels.
        yield Case(
            f"levels of {size}", squares, "np.cumsum", cumsum, repeats, None, total.nbytes, coefficients
        )  # fmt: skip
        if n == 10**7:
            # What the kernel's running sum, too large to be kept by malloc, pays at every call.
            fresh = partial(np.full, n, 1.0)
            yield Case(f"fresh pages for {size}", fresh, "pages that are there", partial(buffer.fill, 1.0), repeats)
        if n <= 10**6:
            yield Case(
                f"kernel, {levels} levels of {size}", kernel, "NumPy pyramid", partial(pyramid, x, levels), 7
            )  # fmt: skip
