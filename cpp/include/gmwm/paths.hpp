// Sample paths of linear recursions, computed in place: the driving noise is replaced by the path.
//
// Several rows are computed together, because each value of a row depends on the previous one. Each product and each
// sum is rounded separately, never fused, and in a fixed order, so that a seed gives the same path on every processor.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// Each row x of n values becomes y_0 = first x_0, y_t = phi y_{t-1} + rest x_t. values.size() is a multiple of n >= 1.
void autoregress(std::span<double> values, std::size_t n, double phi, double first, double rest);

// Each row x of n values becomes y_t = scale (x_0 + … + x_t). values.size() is a multiple of n >= 1.
void accumulate(std::span<double> values, std::size_t n, double scale);

// Each row x of n values becomes first z_t = sum_i predictors(t, i) z_{t-i} + deviations_t x_t for t < p = phi.size(),
// predictors (p, p), and z_t = sum_i phi_i z_{t-i} + rest x_t from t = p on; then y_t = z_t + sum_i theta_i z_{t-i} for
// t >= theta.size(). The first theta.size() values are intermediate results and have no meaning.
void mix(std::span<double> values, std::size_t n, std::span<const double> phi, std::span<const double> theta,
         std::span<const double> predictors, std::span<const double> deviations, double rest);

}  // namespace gmwm
