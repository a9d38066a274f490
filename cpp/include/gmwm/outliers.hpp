// Scans over all samples for outliers: large wavelet coefficients, and samples that differ from their neighbours.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace gmwm {

// Median of n > 0 finite values; the mean of the two middle values if n is even. The values are reordered.
double median(std::span<double> values);

// Median of each of the rows of `length` values. It is fast if neighbouring rows have nearly the same median.
std::vector<double> row_medians(std::span<const double> x, std::size_t length);

// Indices of the rows of `length` values that can have a value further from their median than `times` spreads: the
// smaller one of the standard deviation and of the median distance / 0.6745 + step, and at least step / 2. Bounds of the
// median leave out the others, nearly all rows of noise without outliers.
std::vector<std::int64_t> uneven_rows(std::span<const double> x, std::size_t length, double step, double times);

// Coefficients w_i = scale (p[i + 2] - 2 p[i + 1] + p[i]) of a path that exceed `limit` local standard deviations.
struct LargeCoefficients {
  std::vector<std::int64_t> at;
  std::vector<double> w;
  std::vector<double> spread;  // local standard deviation of each piece
  double energy = 0.0;         // Σ w_i² over all coefficients
};

// The local standard deviation of a piece of `piece` coefficients is the median of |w| / 0.6745 in it, or the median
// over all pieces, or `least`, whichever is largest. An incomplete last piece has the median of the piece before. If
// there are not two whole pieces, all coefficients are one piece. No coefficient is large if a standard deviation is 0.
// The path has at least 3 values.
LargeCoefficients large_coefficients(std::span<const double> path, double scale, std::size_t piece, double least,
                                     double limit);

// Medians of all windows of `width` consecutive values; x has `width` > 0 values or more. If a value is NaN, the medians
// of the windows with it are arbitrary.
std::vector<double> window_medians(std::span<const double> x, std::size_t width);

// out[k] = x[at[k]] - median of the 2 reach nearest neighbours among `others`, `reach` on each side except next to an
// end. x and others have the same size, more than 2 reach.
void neighbour_residuals(std::span<const double> x, std::span<const double> others, std::span<const std::int64_t> at,
                         std::size_t reach, std::span<double> out);

// Indices of the samples whose distance from the mean of their two neighbours exceeds their limit, and of the samples
// next to them. The first and the last sample are always among them. Blocks of `length` samples have one limit each;
// the last one applies to all later samples.
std::vector<std::int64_t> bent_samples(std::span<const double> x, std::span<const double> limits, std::size_t length);

}  // namespace gmwm
