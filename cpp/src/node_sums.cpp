// Sums of covariances of wavelet coefficients over the lags of each pair of levels.
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/differences.hpp"
#include "gmwm/exponential_pieces.hpp"

namespace gmwm {

namespace {

constexpr std::size_t block = 16;  // nodes that are summed together

// The sums of `node_sums` over the n nodes of one pair of levels.
GMWM_INLINE void add_nodes_inline(const double* const* shapes, const double* scales, std::size_t count,
                                  const double* weight, std::size_t n, double& first, double& second) {
  double lanes[2][block] = {};
  double total[block];
  for (std::size_t i = 0; i < n; i += block) {
    const std::size_t width = std::min(block, n - i);
    for (std::size_t l = 0; l < block; ++l) total[l] = 0;
    for (std::size_t k = 0; k < count; ++k) {
      const double* shape = shapes[k] + i;
      if (width == block)
        for (std::size_t l = 0; l < block; ++l) total[l] += scales[k] * shape[l];
      else
        for (std::size_t l = 0; l < width; ++l) total[l] += scales[k] * shape[l];
    }
    if (width == block)
      for (std::size_t l = 0; l < block; ++l) {
        const double product = weight[i + l] * total[l];
        lanes[0][l] += product, lanes[1][l] += product * total[l];
      }
    else
      for (std::size_t l = 0; l < width; ++l) {
        const double product = weight[i + l] * total[l];
        lanes[0][l] += product, lanes[1][l] += product * total[l];
      }
  }
  first = second = 0;
  for (std::size_t l = 0; l < block; ++l) first += lanes[0][l], second += lanes[1][l];
}
constexpr Clones<add_nodes_inline> add_nodes{};

}  // namespace

void node_sums(std::span<const double* const> shapes, const Exponentials& exponentials, std::span<const double> scales,
               std::span<const double> weight, std::span<const std::int64_t> starts, const NodeSums& out) {
  const auto begin_of = [&](std::size_t pair) {
    return pair < starts.size() ? static_cast<std::size_t>(starts[pair]) : weight.size();
  };
  std::vector<PieceExponential> parts;
  for (const double decay : exponentials.decays) parts.emplace_back(exponentials.pieces, decay);
  std::size_t longest = 0;
  for (std::size_t pair = 0; pair < starts.size(); ++pair)
    longest = std::max(longest, begin_of(pair + 1) - begin_of(pair));
  // The covariances of one pair stay in the near caches, unlike those of all pairs.
  std::vector<double> values(parts.size() * longest);
  std::vector<const double*> every(shapes.size() + parts.size());
  const auto& first_of = exponentials.pieces.first;
  std::size_t piece = 0;
  for (std::size_t pair = 0; pair < starts.size(); ++pair) {
    const std::size_t begin = begin_of(pair), end = begin_of(pair + 1), from = piece;
    for (std::size_t k = 0; k < shapes.size(); ++k) every[k] = shapes[k] + begin;
    while (!parts.empty() && piece < first_of.size() && static_cast<std::size_t>(first_of[piece]) < end) ++piece;
    if (begin < end) PieceExponential::pair(parts, exponentials.nodes, from, piece, longest, values.data());
    for (std::size_t k = 0; k < parts.size(); ++k) every[shapes.size() + k] = &values[k * longest];
    add_nodes(every.data(), scales.data(), every.size(), weight.data() + begin, end - begin, out.first[pair],
              out.second[pair]);
  }
}

}  // namespace gmwm
