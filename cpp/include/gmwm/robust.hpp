// Sums of Tukey's biweight over Haar coefficients, for the robust wavelet variance.
//
// With the limit (c σ)², v = min(W² / limit, 1) and q = 1 - v, the M-estimator of scale solves c² mean(v q⁴) = a. Its derivative
// along log σ² is c² (4 mean(v q³) - 5 mean(v q⁴)), so that two sums are all that a Newton step needs. Coefficients
// beyond c σ add nothing to either, however large they are.
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
  double count = 0.0;   // how many coefficients they are over
};

// Over the values of an array; limit > 0.
BiweightSums biweight_sums(std::span<const double> values, double limit);

// Over the Haar coefficients of levels 1 … limits.size(), each with its own limit; a level whose limit is 0 is left
// out, its sums are 0. Of the tiles of 4096 samples only one in `every` is read: 1 reads everything. Sizes of limits
// and sums are the same. Coefficients W_{j,t} with t < begin are left out.
void haar_biweight_sums(std::span<const double> sum, std::span<const double> limits, std::size_t every,
                        std::span<BiweightSums> sums, std::size_t begin = 0);

// |W_{j,t}| at out.size() places t, spread over the level evenly but without a period: a signal's own period must
// not be taken for its size. All of them, in order, where out.size() is their number N - 2^j + 1.
void haar_sample(std::span<const double> sum, std::size_t level, std::span<double> out);

// How many |W_{j,t}| are <= low; those in (low, high] are appended to `between`.
std::size_t haar_between(std::span<const double> sum, std::size_t level, double low, double high,
                         std::vector<double>& between);

}  // namespace gmwm
