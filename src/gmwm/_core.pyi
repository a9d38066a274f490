"""The C++ kernels (cpp/bind): contiguous float64 arrays and sizes in, arrays out. Others' types are refused."""

import numpy as np
from numpy.typing import NDArray

_Vector = NDArray[np.float64]

# haar.hpp

def clone() -> str: ...
def mean(x: _Vector) -> float: ...
def running_sum(x: _Vector) -> _Vector: ...
def haar_sums_of_squares(running_sum: _Vector, levels: int, begin: int, end: int) -> _Vector: ...
def haar_variance(x: _Vector, levels: int) -> _Vector: ...

# cone.hpp

def nonnegative_least_squares(target: _Vector, columns: _Vector) -> tuple[_Vector, float]: ...
def cone_refine(
    target: _Vector,
    fixed: _Vector,
    positive: _Vector,
    values: _Vector,
    slopes: _Vector,
    margins: _Vector,
    starts: _Vector,
) -> tuple[_Vector, float]: ...
def cone_search(
    target: _Vector,
    fixed: _Vector,
    positive: _Vector,
    values: _Vector,
    slopes: _Vector,
    margins: _Vector,
    count: int,
    gap: float,
    max_nodes: int,
    starts: _Vector,
) -> tuple[list[tuple[float, _Vector]], float, float, int]: ...
