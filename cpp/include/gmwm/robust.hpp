// Sums of Tukey's biweight over Haar coefficients, for the robust wavelet variance.
//
// With the limit (c σ)², v = min(W² / limit, 1) and q = 1 - v, the M-estimator of scale solves c² mean(v q⁴) = a. Its
// derivative with respect to log σ² is c² (4 mean(v q³) - 5 mean(v q⁴)), so a Newton step needs only two sums.
// Coefficients beyond c σ do not contribute to either sum, even if they are infinite.
//
// `sum` is always the running sum of the whole signal, sum[t + 1] = P_t, sum[0] = 0 (haar.hpp).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gmwm {

struct BiweightSums {
  double cubed = 0.0;   // Σ v q³
  double fourth = 0.0;  // Σ v q⁴
  double count = 0.0;   // number of coefficients in the sums
};

// Sums over the values of an array; limit > 0.
BiweightSums biweight_sums(std::span<const double> values, double limit);

// Sums over the Haar coefficients of levels 1 … limits.size(), each with its own limit. Levels with limit 0 are
// skipped; their sums are 0. Only one in `every` tiles of 4096 samples is read; 1 reads all. limits and sums have the
// same size. Coefficients W_{j,t} with t < begin are skipped.
void haar_biweight_sums(std::span<const double> sum, std::span<const double> limits, std::size_t every,
                        std::span<BiweightSums> sums, std::size_t begin = 0);

// |W_{j,t}| at out.size() positions t, spread over the level evenly but not periodically: with periodic positions, a
// periodic signal would give a biased sample. If out.size() is N - 2^j + 1, all coefficients in order.
void haar_sample(std::span<const double> sum, std::size_t level, std::span<double> out);

// Number of |W_{j,t}| <= low; values in (low, high] are appended to `between`.
std::size_t haar_between(std::span<const double> sum, std::size_t level, double low, double high,
                         std::vector<double>& between);

}  // namespace gmwm
