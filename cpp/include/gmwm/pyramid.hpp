// The maximal-overlap wavelet transform (MODWT) by the pyramid algorithm, for any filter.
//
// With V_0 = x, stride s = 2^(j-1) and filters of L taps that carry the factor 1/sqrt(2),
//     W_{j,t} = Σ_l h_l V_{j-1,t-sl},    V_{j,t} = Σ_l g_l V_{j-1,t-sl}.
// The wavelet variance only uses coefficients that need no value outside the signal, t >= (2^j - 1)(L - 1). The
// transform is periodic, with t - sl modulo N, and its inverse is V_{j-1,t} = Σ_l (h_l W_{j,t+sl} + g_l V_{j,t+sl}).
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// variance[j - 1] = mean of W_{j,t}² over the N - (2^j - 1)(L - 1) coefficients that need no value outside x, which
// must be at least one; the mean of x is removed first. All NaN if a value of x is not finite.
void pyramid_variance(std::span<const double> x, std::span<const double> scaling, std::span<const double> wavelet,
                      std::span<double> variance);

// One level of the periodic transform at this stride. All of size N, none overlapping.
void pyramid_step(std::span<const double> smooth, std::span<const double> scaling, std::span<const double> wavelet,
                  std::size_t stride, std::span<double> next_smooth, std::span<double> detail);

// The inverse of this level.
void pyramid_unstep(std::span<const double> next_smooth, std::span<const double> detail,
                    std::span<const double> scaling, std::span<const double> wavelet, std::size_t stride,
                    std::span<double> smooth);

}  // namespace gmwm
