"""SciPy, whose packages are imported when one of their functions is used: together they take 0.3 s."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import scipy as scipy
    import scipy.fft
    import scipy.interpolate
    import scipy.linalg
    import scipy.optimize
    import scipy.signal
    import scipy.special
    import scipy.stats
else:
    from importlib import import_module

    class _Packages:
        def __getattr__(self, name: str) -> object:
            package = self.__dict__[name] = import_module(f"scipy.{name}")
            return package

    scipy = _Packages()
