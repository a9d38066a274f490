// Where to evaluate the covariance of two levels' Haar coefficients, so that its sums over all lags are exact to
// rounding: every kink and the lags within its memory one by one, and a Gauss rule for the uniform measure on integers
// in each smooth piece between.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "gmwm/buffer.hpp"

namespace gmwm {

struct Lags {
  std::vector<std::int64_t> starts;  // first node of each pair of levels; sorted by the coarser level, then the finer
  std::size_t size = 0;
  AlignedArray fine;                // h of the finer level
  AlignedArray coarse;              // h of the coarser level (or of the same level)
  AlignedArray lag;                 // u of Cov(W_fine,t, W_coarse,t+u): an integer, or a node between integers
  AlignedArray weight;              // weight of the lag in the sum over all pairs (t, t + u) inside the record
  // Pieces of `gmwm/differences.hpp`: first nodes, patterns, and the offsets of the patterns.
  std::vector<std::int64_t> piece_first, piece_pattern, pattern_begins;
  std::vector<double> pattern_offsets;
  std::vector<std::uint8_t> odd;    // whether the node represents odd lags; empty unless alternating
};

// The pairs of levels, and the form of the covariance between its kinks.
struct Smoothness {
  double slowest = 0;        // polynomial, plus exponentials in the distance to a kink with rates from slowest
  double fastest = 0;        // to fastest (0, 0: none); exponentials continue beyond the overlap of the filters
  bool alternating = false;  // different functions at even and odd lags, each with its own nodes
  bool diagonal = false;     // pairs of a level with itself only
  std::int64_t memory = 0;   // within so many lags of a kink it is any function: every integer lag is a node
};

// levels: ascending.
Lags covariance_lags(std::span<const std::int64_t> levels, std::int64_t samples, const Smoothness& smooth);

// Gauss rule with `nodes` nodes for the sum over the integers 0 … points - 1: exact for polynomials below degree
// 2 nodes. Writes nodes and weights.
void integer_rule(std::int64_t points, std::span<double> nodes, std::span<double> weights);

}  // namespace gmwm
