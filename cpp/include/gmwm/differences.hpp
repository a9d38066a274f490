// Covariances of Haar wavelet coefficients of the elementary processes at pairs of levels and lags, node by node.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// Half-scales h_j <= h_k of the levels and lags u between their coefficients, all of one size. Fastest where nodes of
// one pair of levels stand together.
struct Nodes {
  std::span<const double> fine;
  std::span<const double> coarse;
  std::span<const double> lag;
};

// 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) of white noise and of a random walk of variance 1, written to out.
void white_differences(const Nodes& nodes, std::span<double> out);
void walk_differences(const Nodes& nodes, std::span<double> out);

// Of e_t - e_{t-1}, e white noise of variance 1: spikes at nine lags.
void spike_differences(const Nodes& nodes, std::span<double> out);

// Of autocovariance exp(-decay |k|), decay > 0.
void exponential_differences(const Nodes& nodes, double decay, std::span<double> out);

// Of a process with the autocovariances r(0), r(1), …, r(L) and none beyond. Lags that are not integers must lie at
// least L away from the kinks.
void short_memory_differences(const Nodes& nodes, std::span<const double> autocovariance, std::span<double> out);

}  // namespace gmwm
