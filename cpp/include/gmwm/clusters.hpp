// Sums of squared differences of a phase, from which Allan, Hadamard, modified and total variances follow.
//
// The phase p is the running sum of a signal (or a measured phase); n is the cluster size in samples. A line in the
// phase cancels in all of them, and a parabola in third differences. Remove it beforehand nevertheless, because large
// values reduce the relative precision of the differences. One call computes one cluster size, so that a caller can be
// interrupted between two.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// Σ (p[i + 2n] - 2 p[i + n] + p[i])² over i = 0, stride, 2 stride, …, i + 2n < p.size(). Allan: stride 1 or n.
double second_differences(std::span<const double> p, std::size_t n, std::size_t stride);

// The phase of x, p[k + 1] = p[k] + x[k] - mean with p[0] = 0, and in the same pass, while a tile of the phase is in
// the cache, sums[j] = Σ (p[i + 2n] - 2 p[i + n] + p[i])² over all i at n = 2^j. Sizes: x N, p N + 1, 2^sums.size() <=
// N.
void octave_second_differences(std::span<const double> x, double mean, std::span<double> p, std::span<double> sums);

// Σ (p[i + 3n] - 3 p[i + 2n] + 3 p[i + n] - p[i])² over i = 0, stride, … Hadamard: stride 1 or n.
double third_differences(std::span<const double> p, std::size_t n, std::size_t stride);

// Σ over j of the squares of D_j = Σ_{j<=i<j+n} (p[i + 2n] - 2 p[i + n] + p[i]), for all j with j + 3n <= p.size().
// This is a moving sum, so the time does not grow with n. It restarts every few n values, so that rounding errors do
// not accumulate over the record. Modified Allan.
double moving_second_differences(std::span<const double> p, std::size_t n);

// Σ over 0 < i < p.size() - 1 of (q(i + n) - 2 p[i] + q(i - n))², where q extends p beyond both ends by point
// reflection about the end value: q(-k) = 2 p[0] - p[k]. For n <= p.size() - 2. Total variance.
double reflected_second_differences(std::span<const double> p, std::size_t n);

}  // namespace gmwm
