// Sums of squared differences of a phase, from which Allan, Hadamard, modified and total variances follow.
//
// The phase p is the running sum of a signal (or a measured phase); n is the cluster size in samples. A line in the
// phase cancels in all of them, and a parabola in third differences; remove it beforehand all the same, since what
// is left of it costs digits. One call is one cluster size, so that a caller can stop between two of them.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// Σ (p[i + 2n] - 2 p[i + n] + p[i])² over i = 0, stride, 2 stride, …, i + 2n < p.size(). Allan: stride 1 or n.
double second_differences(std::span<const double> p, std::size_t n, std::size_t stride);

// The phase of x, p[k + 1] = p[k] + x[k] - mean with p[0] = 0, and at once sums[j] = Σ (p[i + 2n] - 2 p[i + n] + p[i])²
// over all i at n = 2^j: while a tile of the phase is in the cache. Sizes: x N, p N + 1, 2^sums.size() <= N.
void octave_second_differences(std::span<const double> x, double mean, std::span<double> p, std::span<double> sums);

// Σ (p[i + 3n] - 3 p[i + 2n] + 3 p[i + n] - p[i])² over i = 0, stride, … Hadamard: stride 1 or n.
double third_differences(std::span<const double> p, std::size_t n, std::size_t stride);

// Σ over j of the squares of D_j = Σ_{j<=i<j+n} (p[i + 2n] - 2 p[i + n] + p[i]), for all j with j + 3n <= p.size().
// A moving sum, in time that does not grow with n; it starts afresh every few n values, and so drags no rounding
// error through the record. Modified Allan.
double moving_second_differences(std::span<const double> p, std::size_t n);

// Σ over 0 < i < p.size() - 1 of (q(i + n) - 2 p[i] + q(i - n))², where q is p, and beyond both its ends p turned by
// half a turn about its end value: q(-k) = 2 p[0] - p[k]. For n <= p.size() - 2. Total variance.
double reflected_second_differences(std::span<const double> p, std::size_t n);

}  // namespace gmwm
