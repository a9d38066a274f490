"""SciPy and Polars, imported when something of them is used: together they take 0.5 s; and the reader of TOML."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if sys.version_info >= (3, 11):
    import tomllib as tomllib
else:
    pass

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
