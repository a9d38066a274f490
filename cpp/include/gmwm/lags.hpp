// Where to evaluate the covariance of two levels' Haar coefficients, so that its sums over all lags are exact to
// rounding: every kink by itself, and a Gauss rule for the uniform measure on integers in each smooth piece between.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace gmwm {

struct Lags {
  std::vector<std::int64_t> finer;    // index of the finer level of the pair, into `levels`
  std::vector<std::int64_t> coarser;  // index of the coarser one (or the same)
  std::vector<double> lag;            // u of Cov(W_finer,t, W_coarser,t+u): an integer, or a node between integers
  std::vector<double> weight;         // of the lag in the sum over all pairs (t, t + u) inside the record
  std::vector<std::int8_t> odd;       // whether the node stands for odd lags: of single lags, and if alternating
};

// levels: ascending. The covariance is polynomial between its kinks, plus exponentials in the distance to a kink with
// rates from slowest to fastest (0, 0: none); where there are exponentials, it does not end at the filters' reach.
// `alternating`: it is one such function at even lags and another at odd ones, so each has nodes of its own.
Lags covariance_lags(std::span<const std::int64_t> levels, std::int64_t samples, double slowest, double fastest,
                     bool alternating);

// Gauss rule with `nodes` nodes for the sum over the integers 0 … points - 1: exact for polynomials below degree
// 2 nodes. Writes nodes and weights.
void integer_rule(std::int64_t points, std::span<double> nodes, std::span<double> weights);

}  // namespace gmwm
