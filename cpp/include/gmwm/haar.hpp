// Haar wavelet variance from one running sum.
//
// With P_t = Σ_{s<=t} (x_s - mean), P_{-1} = 0 and h = 2^(j-1), the maximal-overlap coefficient is
//     W_{j,t} = (P_t - 2 P_{t-h} + P_{t-2h}) / 2^j,    t = 2^j - 1 … N - 1,
// so that all levels read the same N + 1 values and write no intermediate results. The mean cancels. It is removed
// nevertheless, because a large running sum has large rounding errors.
//
// The largest value of the running sum determines the rounding error, relative to 2^j times the coefficient. At 10^6
// samples, the relative error is 1e-14 for white noise, 6e-11 at level 1 of a random walk (less at other levels), and
// 8e-6 at level 1 of a drift without noise, whose running sum grows with N².
//
// The steps are also separate functions, so that threads can share one running sum, each with its own range of t.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// Largest level of any signal: 2^62 samples are more than memory can hold.
inline constexpr std::size_t max_level = 62;

struct Mean {
  double value;  // NaN if not finite
  bool finite;   // whether all values of x are finite, even if their sum overflows
};

// Mean of x (not empty) in one pass, and whether all values are finite.
Mean mean(std::span<const double> x);

// Copies x (not empty) to out, and returns whether all values are finite and their sum does not overflow.
bool copy_finite(std::span<const double> x, double* out);

// sum[k + 1] = sum[k] + x[k] - mean, continuing from sum[0], which the caller sets.
// Sizes: x n, sum n + 1.
void running_sum(std::span<const double> x, double mean, std::span<double> sum);

// Adds to sums[j - 1], for j = 1 … sums.size(), the sum of W_{j,t}² over begin <= t < end, t >= 2^j - 1.
// `sum` is the running sum of the whole signal, sum[t + 1] = P_t; end <= sum.size() - 1.
void haar_sums_of_squares(std::span<const double> sum, std::size_t begin, std::size_t end, std::span<double> sums);

// Sums of the first samples of a panel: sums[k] = Σ of the first `first` + k `step` values. The last sum is over all.
struct Marks {
  std::size_t first, step;
  std::span<double> sums;  // not empty; the ranges of all sums but the last end inside the panel
};

// squares[j - 1] = sum of W_{j,t}², for j = 1 … squares.size(), over the coefficients that end in the panel x (not empty).
// `before` has the samples before the panel, and 2^squares.size() <= before.size() + x.size(). The running sum is not
// stored. `before` and the marks are relative to `reference`, and x is not.
void haar_panel(std::span<const double> before, std::span<const double> x, double reference, const Marks& marks,
                std::span<double> squares);

// out[b levels + j - 1] = mean of the squares of the coefficients of level j that begin in block b, for all blocks of
// `block` samples. Coefficients of the last block need (blocks * block + 2^levels) <= sum.size() - 1 samples.
void haar_block_squares(std::span<const double> sum, std::size_t block, std::size_t levels, std::span<double> out);

// variance[j - 1] = mean of W_{j,t}² over the N - 2^j + 1 coefficients, for j = 1 … variance.size();
// 2^variance.size() <= x.size(). Returns the mean rise per sample, from the means of the two halves of x. All are NaN if
// a value of x is not finite, or if a sum of values overflows.
//
// The running sum of a long record is not stored. Near levels use a window of it. For far levels, the samples are read
// again, in columns of a matrix whose rows are as long as the window.
double haar_variance(std::span<const double> x, std::span<double> variance);

}  // namespace gmwm
