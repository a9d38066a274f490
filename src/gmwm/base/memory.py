"""Give freed memory back to the operating system."""

from __future__ import annotations

import ctypes
from functools import cache
from typing import Any


def return_memory() -> None:
    """Return the memory of freed arrays below 32 MB, which the GNU C library keeps although it does not always fit
    later. Otherwise, a calibration of six axes of 6 million samples in chunks needs 160 MB more."""
    trim = _trim()
    if trim is not None:
        trim(0)


@cache
def _trim() -> Any:
    try:
        return ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):
        return None
