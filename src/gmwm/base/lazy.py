"""Work that is done when it is needed: values that a result computes once; and imports of SciPy and Polars, which
together take 0.5 s, and of the reader of TOML."""

from __future__ import annotations

import sys
from collections.abc import Callable, Hashable
from typing import TYPE_CHECKING, TypeVar

if sys.version_info >= (3, 11):
    import tomllib as tomllib
else:
    import tomli as tomllib  # noqa: F401  # for other modules

if TYPE_CHECKING:
    import polars as polars
    import scipy as scipy
    import scipy.fft
    import scipy.interpolate
    import scipy.linalg
    import scipy.optimize
    import scipy.signal
    import scipy.special
    import scipy.stats
else:
    from pkgutil import resolve_name

    class _LazyLibrary:
        """A library whose packages, or other names, are found when they are used; `mark` stands before such a name."""

        def __init__(self, name: str, mark: str) -> None:
            self._name, self._mark = name, mark

        def __getattr__(self, name: str) -> object:
            value = self.__dict__[name] = resolve_name(f"{self._name}{self._mark}{name}")
            return value

    scipy, polars = _LazyLibrary("scipy", "."), _LazyLibrary("polars", ":")

T = TypeVar("T")


def once_per_result(result: object, what: str, options: Hashable, compute: Callable[[], T]) -> T:
    """Return a value that depends on a result and on options, and compute it the first time."""
    values: dict[tuple[str, Hashable], T] = result.__dict__.setdefault("_computed", {})
    if (what, options) not in values:
        values[what, options] = compute()
    return values[what, options]
