"""Validation of process arguments: lags, frequencies, path counts and random generators."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gmwm.base.arrays import Vector
from gmwm.base.errors import OptionError


def as_lags(lags: ArrayLike) -> NDArray[np.int64]:
    """Check lags, which are integers (samples) of any sign and shape, and return them as an array."""
    array = np.asarray(lags)
    if array.dtype.kind not in "iu":
        raise OptionError(
            argument="lags",
            expected="integers (samples)",
            got=lags,
            advice="Convert a time in seconds with `round(time * rate)`.",
        )
    return array.astype(np.int64)


def as_clusters(clusters: ArrayLike) -> NDArray[np.int64]:
    """Check cluster sizes, which are integers (samples) of at least 1, and return them as an array."""
    array = np.asarray(clusters)
    if array.dtype.kind not in "iu" or np.any(array < 1):
        raise OptionError(
            argument="clusters",
            expected="whole numbers of samples from 1",
            got=clusters,
            advice="Convert a time in seconds with `round(time * rate)`.",
        )
    return array.astype(np.int64)


def as_frequencies(frequencies: ArrayLike, rate: float) -> Vector:
    """Check that frequencies (Hz) are within ±rate/2, and return them as an array."""
    f = np.asarray(frequencies, dtype=np.float64)
    # The end of a grid up to the Nyquist frequency can exceed it by a rounding error.
    if not np.all(np.abs(f) <= 0.5 * rate * (1 + 1e-12)):
        raise OptionError(
            argument="frequencies",
            expected=f"within ±{rate / 2:g} Hz, which is half the rate of {rate:g} Hz",
            got=frequencies,
        )
    return f


def as_rng(rng: object) -> np.random.Generator:
    """Return `rng` if it is a NumPy Generator, or a Generator created from an integer or a SeedSequence."""
    if isinstance(rng, np.random.Generator):
        return rng
    return np.random.default_rng(rng if isinstance(rng, np.random.SeedSequence) else as_seed(rng))


def as_seed(rng: object) -> int:
    """Return `rng` if it is an integer seed, or a seed drawn from a NumPy Generator.

    Parallel work needs a seed instead of a Generator, and results record the seed.

    >>> as_seed(3), as_seed(np.random.default_rng(1)) == as_seed(np.random.default_rng(1))
    (3, True)
    """
    if isinstance(rng, np.random.Generator):
        return int(rng.integers(2**63))
    if isinstance(rng, bool) or not isinstance(rng, int | np.integer) or rng < 0:
        raise OptionError(argument="rng", expected="zero or a positive integer, or a numpy.random.Generator", got=rng)
    return int(rng)


def as_paths(n: object, paths: object) -> tuple[int, int]:
    """Check the number of samples and the number of paths, and return both; None means one path."""
    for name, value in (("n", n), ("paths", 1 if paths is None else paths)):
        if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
            raise OptionError(argument=name, expected="a positive integer", got=value)
    return int(n), 1 if paths is None else int(paths)  # type: ignore[call-overload]


def shape_of_paths(n: int, paths: int | None) -> tuple[int, ...]:
    """Return the shape of simulated paths: (n,) if `paths` is None, and (paths, n) otherwise."""
    return (n,) if paths is None else (paths, n)
