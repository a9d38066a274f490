// Sample paths of first-order recursions, made in place of the noise that drives them.
//
// Several rows go side by side, for each value waits for the one before it. Products and sums are rounded one by one,
// never fused, and in this order: a seed gives the same path on every processor.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// Each row x of n values becomes y_0 = first x_0, y_t = phi y_{t-1} + rest x_t. values.size() is a multiple of n >= 1.
void autoregress(std::span<double> values, std::size_t n, double phi, double first, double rest);

// Each row x of n values becomes y_t = scale (x_0 + … + x_t). values.size() is a multiple of n >= 1.
void accumulate(std::span<double> values, std::size_t n, double scale);

}  // namespace gmwm
