#include "gmwm/exponential_pieces.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/decay.hpp"

namespace gmwm {

namespace {

// Where a piece lies: beyond the reach of the filters, or for each filter of the coarser level, whether it is inside the
// overlap, on which side of the middle, and the depth d of its first node.
struct Place {
  bool beyond, right[3], inside[3];
  double depth[3];
};

constexpr std::size_t together = 32;  // pieces whose exponentials are computed at once
constexpr std::size_t arguments = 6;

// The place of a piece, and the distances whose exponentials it needs: from the nearest and to the farthest end of each
// filter, or from the end of the reach.
GMWM_INLINE void locate(double h, double hk, double first, double last, Place& place, double* to) {
  for (std::size_t k = 0; k < arguments; ++k) to[k] = 0;
  const bool after = first >= 2 * hk;
  place.beyond = after || last <= -2 * h;
  if (place.beyond) {
    place.right[0] = after;
    to[0] = after ? first - 2 * hk : -2 * h - last;
    return;
  }
  for (int b = 0; b < 3; ++b) {
    const double from = first - b * hk + h, until = last - b * hk + h;
    const bool right = from + until >= 0;
    const double nearest = right ? from : -until, farthest = right ? until : -from;
    place.right[b] = right;
    place.inside[b] = 2 * h > nearest + farthest;
    place.depth[b] = h - std::abs(from);
    to[2 * b] = std::max(place.inside[b] ? nearest : nearest - h, 0.0);
    to[2 * b + 1] = place.inside[b] ? std::max(h - farthest, 0.0) : 0.0;
  }
}

GMWM_INLINE double product(double one, double other) { return one + other + one * other; }

// The covariance at the nodes of one piece, of which there are at most `width`; `powers` are exp(-λ x) - 1 of its
// distances.
template <std::size_t width>
GMWM_INLINE void of_piece(const Decay& at, const Pattern& pattern, const Place& place, const double* powers,
                          double* value) {
  for (std::size_t i = 0; i < width; ++i) value[i] = 0;
  if (place.beyond) {
    if (powers[0] == -1) return;
    const double* steps = place.right[0] ? pattern.from_first : pattern.from_last;
    const double ends = at.epsilon * at.epsilon_coarse, factor = -0.5 * at.gain * ends * ends;
    for (std::size_t i = 0; i < width; ++i) value[i] = factor * (product(powers[0], steps[i]) + 1);
    return;
  }
  for (int b = 0; b < 3; ++b) {
    const double weight = b == 1 ? -2 * at.gain : at.gain, one = powers[2 * b], other = powers[2 * b + 1];
    const double* near_steps = place.right[b] ? pattern.from_first : pattern.from_last;
    if (!place.inside[b]) {
      for (std::size_t i = 0; i < width; ++i) value[i] += weight * at.outside_of(product(one, near_steps[i]));
      continue;
    }
    const double* far_steps = place.right[b] ? pattern.from_last : pattern.from_first;
    const double depth = place.depth[b], rise = place.right[b] ? -1 : 1;
    if (at.by_series)
      for (std::size_t i = 0; i < width; ++i) value[i] += weight * at.inside_series(depth + rise * pattern.offset[i]);
    else
      for (std::size_t i = 0; i < width; ++i)
        value[i] += weight * at.inside_of(product(one, near_steps[i]), product(other, far_steps[i]),
                                          depth + rise * pattern.offset[i]);
  }
}

// Pieces of one pair of levels, of which the first one begins with the first value of `out`.
GMWM_CLONES void of_pieces(const Decay& at, const Pattern* patterns, const double* lag, const std::int64_t* first,
                           const std::int64_t* kind, std::size_t count, double* out) {
  double powers[together * arguments], value[piece_nodes];
  Place places[together];
  const std::int64_t base = count > 0 ? first[0] : 0;
  for (std::size_t begin = 0; begin < count; begin += together, first += together, kind += together) {
    const std::size_t pieces = std::min(together, count - begin);
    for (std::size_t p = 0; p < pieces; ++p) {
      const double start = lag[first[p]];
      locate(at.h, at.hk, start, start + patterns[kind[p]].length, places[p], powers + arguments * p);
    }
    for (std::size_t i = 0; i < arguments * pieces; ++i) powers[i] = expm1_below(-at.decay * powers[i]);
    for (std::size_t p = 0; p < pieces; ++p) {
      const Pattern& own = patterns[kind[p]];
      if (own.size <= piece_nodes / 2)
        of_piece<piece_nodes / 2>(at, own, places[p], powers + arguments * p, value);
      else
        of_piece<piece_nodes>(at, own, places[p], powers + arguments * p, value);
      double* to = out + (first[p] - base);
      for (std::size_t i = 0; i < own.size; ++i) to[i] = value[i];
    }
  }
}

GMWM_CLONES void find_powers(double decay, Pattern& pattern) {
  for (std::size_t i = 0; i < piece_nodes; ++i) pattern.from_first[i] = expm1_below(-decay * pattern.offset[i]);
  for (std::size_t i = 0; i < piece_nodes; ++i)
    pattern.from_last[i] = expm1_below(-decay * std::max(pattern.length - pattern.offset[i], 0.0));
}

std::vector<Pattern> patterns_of(const Pieces& pieces, double decay) {
  std::vector<Pattern> patterns(pieces.begins.size() - 1);
  for (std::size_t k = 0; k < patterns.size(); ++k) {
    Pattern& pattern = patterns[k];
    const double* offset = &pieces.offsets[static_cast<std::size_t>(pieces.begins[k])];
    pattern.size = static_cast<std::size_t>(pieces.begins[k + 1] - pieces.begins[k]);
    pattern.length = offset[pattern.size - 1];
    std::copy_n(offset, pattern.size, pattern.offset);
    find_powers(decay, pattern);
  }
  return patterns;
}

}  // namespace

PieceExponential::PieceExponential(const Pieces& pieces, double decay)
    : pieces_(pieces), decay_(decay), patterns_(patterns_of(pieces, decay)) {}

void PieceExponential::pair(const Nodes& nodes, std::size_t begin, std::size_t end, double* out) const {
  const auto node = static_cast<std::size_t>(pieces_.first[begin]);
  of_pieces(Decay(nodes.fine[node], nodes.coarse[node], decay_), patterns_.data(), nodes.lag.data(),
            &pieces_.first[begin], &pieces_.pattern[begin], end - begin, out);
}

void exponential_differences(const Nodes& nodes, const Pieces& pieces, double decay, std::span<double> out) {
  const PieceExponential whole(pieces, decay);
  const std::size_t count = pieces.first.size();
  for (std::size_t begin = 0, end; begin < count; begin = end) {
    const auto node = [&](std::size_t piece) { return static_cast<std::size_t>(pieces.first[piece]); };
    const double h = nodes.fine[node(begin)], hk = nodes.coarse[node(begin)];
    for (end = begin + 1; end < count && nodes.fine[node(end)] == h && nodes.coarse[node(end)] == hk;) ++end;
    whole.pair(nodes, begin, end, &out[node(begin)]);
  }
}

}  // namespace gmwm
