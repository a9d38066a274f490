// Power series of the closed forms, at many points.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// out_i = c_0 x_i^(n-1) + ... + c_(n-1), highest power first; out may be x.
void polynomial(std::span<const double> coefficients, std::span<const double> x, std::span<double> out);

// Sum of Chebyshev polynomials T_k by Clenshaw's recurrence: out_i = sum_k c_k T_k(x_i); out may be x.
void chebyshev(std::span<const double> coefficients, std::span<const double> x, std::span<double> out);

}  // namespace gmwm
