"""The C++ kernels (cpp/bind): contiguous float64 arrays and sizes in, arrays out. Others' types are refused."""

import numpy as np
from numpy.typing import NDArray

_Vector = NDArray[np.float64]
_Matrix = NDArray[np.float64]
_Cube = NDArray[np.float64]

# haar.hpp

def clone() -> str: ...
def mean(x: _Vector) -> float: ...
def running_sum(x: _Vector) -> _Vector: ...
def haar_sums_of_squares(running_sum: _Vector, levels: int, begin: int, end: int) -> _Vector: ...
def haar_variance(x: _Vector, levels: int) -> _Vector: ...

# clusters.hpp

def octave_second_differences(x: _Vector, octaves: int) -> tuple[_Vector, _Vector]: ...
def second_differences(phase: _Vector, n: int, stride: int = 1) -> float: ...
def third_differences(phase: _Vector, n: int, stride: int = 1) -> float: ...
def moving_second_differences(phase: _Vector, n: int) -> float: ...
def reflected_second_differences(phase: _Vector, n: int) -> float: ...

# robust.hpp

def biweight_sums(values: _Vector, limit: float) -> tuple[float, float]: ...
def haar_biweight_sums(
    running_sum: _Vector, limits: _Vector, every: int, begin: int = 0
) -> tuple[_Vector, _Vector, _Vector]: ...
def haar_sample(running_sum: _Vector, level: int, size: int) -> _Vector: ...
def haar_between(running_sum: _Vector, level: int, low: float, high: float) -> tuple[int, _Vector]: ...

# sketch.hpp

_Counts = tuple[int, int, int, NDArray[np.int64], NDArray[np.int64]]

def sketch_values(values: _Vector) -> _Counts: ...
def haar_sketch(running_sum: _Vector, level: int, begin: int, end: int) -> _Counts: ...

# pyramid.hpp

def pyramid_variance(x: _Vector, scaling: _Vector, wavelet: _Vector, levels: int) -> _Vector: ...
def pyramid_step(smooth: _Vector, scaling: _Vector, wavelet: _Vector, stride: int) -> tuple[_Vector, _Vector]: ...
def pyramid_unstep(smooth: _Vector, detail: _Vector, scaling: _Vector, wavelet: _Vector, stride: int) -> _Vector: ...

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

# lags.hpp

def covariance_lags(
    levels: NDArray[np.int64], samples: int, slowest: float, fastest: float, alternating: bool, diagonal: bool
) -> tuple[NDArray[np.int64], _Vector, _Vector, _Vector, _Vector, NDArray[np.uint8]]: ...

# differences.hpp

def white_differences(fine: _Vector, coarse: _Vector, lag: _Vector) -> _Vector: ...
def walk_differences(fine: _Vector, coarse: _Vector, lag: _Vector) -> _Vector: ...
def spike_differences(fine: _Vector, coarse: _Vector, lag: _Vector) -> _Vector: ...
def exponential_differences(fine: _Vector, coarse: _Vector, lag: _Vector, decay: float) -> _Vector: ...

# paths.hpp

def autoregress(values: _Matrix, phi: float, first: float, rest: float) -> None: ...
def accumulate(values: _Matrix, scale: float) -> None: ...
def mix(
    values: _Matrix, phi: _Vector, theta: _Vector, predictors: _Matrix, deviations: _Vector, rest: float
) -> None: ...

# kalman.hpp

most_slopes: int

def kalman_innovations(
    F: _Matrix, Q: _Matrix, H: _Vector, R: float, P0: _Matrix, series: _Matrix, standardised: _Vector
) -> tuple[bool, int, int, float, _Vector]: ...
def kalman_score(
    F: _Matrix,
    Q: _Matrix,
    H: _Vector,
    R: float,
    P0: _Matrix,
    dF: _Cube,
    dQ: _Cube,
    dH: _Matrix,
    dR: _Vector,
    dP0: _Cube,
    series: _Matrix,
) -> tuple[bool, int, int, float, float, _Vector, _Vector, _Vector, _Vector, _Vector]: ...
def kalman_tracks(
    F: _Matrix,
    Q: _Matrix,
    H: _Vector,
    R: float,
    P0: _Matrix,
    series: _Matrix,
    states: _Matrix,
    shares: _Matrix,
    smooth: bool,
    means: _Matrix,
    variances: _Matrix,
) -> bool: ...

# arma.hpp

_Orders = tuple[int, int, int, int, int]

def arma_shapes(orders: _Orders, parameters: _Matrix, odd: _Vector, out: _Matrix) -> None: ...
def arma_slopes(orders: _Orders, parameters: _Matrix, odd: _Vector, out: NDArray[np.float64]) -> None: ...
def arma_coordinates(coefficients: _Matrix, out: _Matrix) -> None: ...
def arma_autocovariance(
    orders: _Orders, parameters: _Vector, lags: NDArray[np.int64], from_zero: bool, out: _Vector
) -> None: ...
def arma_block_variance(orders: _Orders, parameters: _Vector, sizes: NDArray[np.int64], out: _Vector) -> None: ...
def arma_recursion(
    orders: _Orders, parameters: _Vector, phi: _Vector, theta: _Vector, predictors: _Matrix, deviations: _Vector
) -> None: ...

# polynomial.hpp

def polynomial(coefficients: _Vector, x: _Vector, out: _Vector) -> None: ...
