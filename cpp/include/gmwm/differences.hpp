// Covariances of the Haar wavelet coefficients of elementary processes, at given pairs of levels and lags.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace gmwm {

// Half-scales h_j <= h_k of the levels and lags u between their coefficients, all of the same size. It is fastest if
// nodes of one pair of levels are adjacent.
struct Nodes {
  std::span<const double> fine;
  std::span<const double> coarse;
  std::span<const double> lag;
};

// 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) of white noise and of a random walk of variance 1, written to out.
void white_differences(const Nodes& nodes, std::span<double> out);
void walk_differences(const Nodes& nodes, std::span<double> out);

// The same of e_t - e_{t-1} for white noise e of variance 1: nonzero at nine lags only.
void spike_differences(const Nodes& nodes, std::span<double> out);

// The same of power-law noise, whose running sum has the covariance q(m) = m² (|m|^ε - 1)/ε. `falling` are the binomial
// coefficients C(2 + ε, 2k)/ε for k = 2, 3, …, 16.
inline constexpr std::size_t power_terms = 15;
void power_differences(const Nodes& nodes, double epsilon, std::span<const double, power_terms> falling,
                       std::span<double> out);

// The same of a process with autocovariance exp(-decay |k|), decay > 0.
void exponential_differences(const Nodes& nodes, double decay, std::span<double> out);

// Groups of adjacent nodes of one pair of levels without a kink between the first and the last one. The lags of a group
// are those of its first node plus the offsets of a pattern, from 0 on; many groups share a pattern.
struct Pieces {
  std::span<const std::int64_t> first;    // first node of each piece, ascending
  std::span<const std::int64_t> pattern;  // pattern of each piece
  std::span<const std::int64_t> begins;   // first offset of each pattern, and the number of all offsets
  std::span<const double> offsets;        // ascending in each pattern
};

// Largest number of nodes of a piece.
inline constexpr std::size_t piece_nodes = 16;

// As `exponential_differences`, with six exponentials for each piece instead of six for each node. Every node must be in
// one piece.
void exponential_differences(const Nodes& nodes, const Pieces& pieces, double decay, std::span<double> out);

// Exponentials exp(-decay |k|) at the nodes of pieces; each piece belongs to one pair of levels.
struct Exponentials {
  Nodes nodes;
  Pieces pieces;
  std::span<const double> decays;
};

// Sums over the nodes of each pair of levels: Σ weight c and Σ weight c² of c = Σ scale shape. `starts`: the first node of
// each pair. The exponentials follow the shapes, and are computed pair by pair.
struct NodeSums {
  std::span<double> first, second;
};

void node_sums(std::span<const double* const> shapes, const Exponentials& exponentials, std::span<const double> scales,
               std::span<const double> weight, std::span<const std::int64_t> starts, const NodeSums& out);

// Of a process with the autocovariances r(0), r(1), …, r(L) and none beyond. Lags that are not integers must lie at
// least L away from the kinks.
void short_memory_differences(const Nodes& nodes, std::span<const double> autocovariance, std::span<double> out);

}  // namespace gmwm
