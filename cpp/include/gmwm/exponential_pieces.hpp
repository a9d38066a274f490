// Covariances of exp(-λ |k|) at groups of lags that share their exponentials.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "gmwm/differences.hpp"

namespace gmwm {

// exp(-λ t) - 1 of the offsets t of a pattern from its first and from its last node, and the offsets.
struct Pattern {
  std::size_t size = 0;
  double length = 0;  // from the first to the last node
  double from_first[piece_nodes] = {}, from_last[piece_nodes] = {}, offset[piece_nodes] = {};
};

class PieceExponential {
 public:
  PieceExponential(const Pieces& pieces, double decay);

  // The covariances of several decay rates at the nodes of the same pieces from `begin` to `end`, which must belong to
  // one pair of levels. The values of the rates are `stride` apart.
  static void pair(std::span<const PieceExponential> parts, const Nodes& nodes, std::size_t begin, std::size_t end,
                   std::size_t stride, double* out);

 private:
  Pieces pieces_;
  double decay_;
  std::vector<Pattern> patterns_;
};

}  // namespace gmwm
