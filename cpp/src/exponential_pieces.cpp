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
constexpr std::size_t arguments = 6;  // exponentials of a piece at most

// The place of a piece. Appends the distances whose exponentials it needs: from the end of the reach, or for each filter
// from its nearest end, and inside the overlap also to its farthest one. Returns the end of these distances.
GMWM_INLINE double* locate(double h, double hk, double first, double last, Place& place, double* to) {
  const bool after = first >= 2 * hk;
  place.beyond = after || last <= -2 * h;
  if (place.beyond) {
    place.right[0] = after;
    *to++ = after ? first - 2 * hk : -2 * h - last;
    return to;
  }
  for (int b = 0; b < 3; ++b) {
    const double from = first - b * hk + h, until = last - b * hk + h;
    const bool right = from + until >= 0;
    const double nearest = right ? from : -until, farthest = right ? until : -from;
    place.right[b] = right;
    place.inside[b] = 2 * h > nearest + farthest;
    place.depth[b] = h - std::abs(from);
    *to++ = std::max(place.inside[b] ? nearest : nearest - h, 0.0);
    if (place.inside[b]) *to++ = std::max(h - farthest, 0.0);
  }
  return to;
}

// The covariance at the nodes of a piece, without what a series gives: a constant, multiples of the exponentials of the
// distances from its first and to its last node, and a multiple of the distance from its first node.
struct Linear {
  double constant = 0, from_first = 0, from_last = 0, slope = 0;
};

// Adds the part of one filter; `powers` are exp(-λ x) - 1 of its distances. Returns the end of those used.
GMWM_INLINE const double* add_part(const Decay& at, const Place& place, int b, const double* powers, Linear& sum) {
  const double weight = b == 1 ? -2 * at.gain : at.gain, one = *powers++;
  double& near_end = place.right[b] ? sum.from_first : sum.from_last;
  double& far_end = place.right[b] ? sum.from_last : sum.from_first;
  if (!place.inside[b]) {
    sum.constant += weight * at.outside_of(one);
    near_end += weight * at.outside_of(one + 1);
    return powers;
  }
  const double other = *powers++;
  sum.constant += weight * at.inside_of(one, other, place.depth[b]);
  near_end += weight * (one + 1) * (1 - 0.5 * at.at_end);
  far_end -= weight * 0.5 * (other + 1);
  sum.slope += place.right[b] ? weight * at.sinh_decay : -weight * at.sinh_decay;
  return powers;
}

// The covariance at the nodes of one piece, of which there are at most `width`. Returns the end of the powers used.
template <std::size_t width>
GMWM_INLINE const double* of_piece(const Decay& at, const Pattern& pattern, const Place& place, const double* powers,
                                   double* value) {
  if (place.beyond) {
    const double one = *powers++, ends = at.epsilon * at.epsilon_coarse, factor = -0.5 * at.gain * ends * ends;
    const double* steps = place.right[0] ? pattern.from_first : pattern.from_last;
    for (std::size_t i = 0; i < width; ++i) value[i] = factor * (one + 1) * (steps[i] + 1);
    return powers;
  }
  Linear sum;
  for (int b = 0; b < 3; ++b) {
    if (place.inside[b] && at.by_series)
      powers += 2;
    else
      powers = add_part(at, place, b, powers, sum);
  }
  for (std::size_t i = 0; i < width; ++i)
    value[i] = sum.constant + sum.from_first * pattern.from_first[i] + sum.from_last * pattern.from_last[i] +
               sum.slope * pattern.offset[i];
  for (int b = 0; b < 3; ++b) {
    if (!place.inside[b] || !at.by_series) continue;
    const double weight = b == 1 ? -2 * at.gain : at.gain, rise = place.right[b] ? -1 : 1;
    for (std::size_t i = 0; i < width; ++i)
      value[i] += weight * at.inside_series(place.depth[b] + rise * pattern.offset[i]);
  }
  return powers;
}

// A decay rate at one pair of levels.
struct Rate {
  Decay at;
  const Pattern* patterns;
};

// Pieces of one pair of levels, for several decay rates whose values are `stride` apart. The first value is that of the
// first piece; `lag` is that of all nodes.
GMWM_INLINE void of_pieces_inline(const Rate* rates, std::size_t count, const double* lag, const std::int64_t* first,
                                  const std::int64_t* kind, std::size_t size, std::size_t stride, double* out) {
  double distances[together * arguments], powers[together * arguments], value[piece_nodes];
  Place places[together];
  const std::int64_t base = size > 0 ? first[0] : 0;
  const double h = rates[0].at.h, hk = rates[0].at.hk;
  for (std::size_t begin = 0; begin < size; begin += together, first += together, kind += together) {
    const std::size_t pieces = std::min(together, size - begin);
    double* end = distances;
    for (std::size_t p = 0; p < pieces; ++p) {
      const double start = lag[first[p]];
      end = locate(h, hk, start, start + rates[0].patterns[kind[p]].length, places[p], end);
    }
    const std::size_t needed = static_cast<std::size_t>(end - distances);
    for (std::size_t k = 0; k < count; ++k) {
      const Decay& at = rates[k].at;
      for (std::size_t i = 0; i < needed; ++i) powers[i] = expm1_below(-at.decay * distances[i]);
      const double* next = powers;
      double* own = out + k * stride;
      for (std::size_t p = 0; p < pieces; ++p) {
        const Pattern& pattern = rates[k].patterns[kind[p]];
        if (pattern.size <= piece_nodes / 2)
          next = of_piece<piece_nodes / 2>(at, pattern, places[p], next, value);
        else
          next = of_piece<piece_nodes>(at, pattern, places[p], next, value);
        double* to = own + (first[p] - base);
        for (std::size_t i = 0; i < pattern.size; ++i) to[i] = value[i];
      }
    }
  }
}
constexpr Clones<of_pieces_inline> of_pieces{};

GMWM_INLINE void find_powers_inline(double decay, Pattern& pattern) {
  for (std::size_t i = 0; i < piece_nodes; ++i) pattern.from_first[i] = expm1_below(-decay * pattern.offset[i]);
  for (std::size_t i = 0; i < piece_nodes; ++i)
    pattern.from_last[i] = expm1_below(-decay * std::max(pattern.length - pattern.offset[i], 0.0));
}
constexpr Clones<find_powers_inline> find_powers{};

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

void PieceExponential::pair(std::span<const PieceExponential> parts, const Nodes& nodes, std::size_t begin,
                            std::size_t end, std::size_t stride, double* out) {
  if (parts.empty() || begin == end) return;
  const Pieces& pieces = parts[0].pieces_;
  const auto node = static_cast<std::size_t>(pieces.first[begin]);
  std::vector<Rate> rates;
  for (const PieceExponential& part : parts)
    rates.push_back({Decay(nodes.fine[node], nodes.coarse[node], part.decay_), part.patterns_.data()});
  of_pieces(rates.data(), rates.size(), nodes.lag.data(), &pieces.first[begin], &pieces.pattern[begin], end - begin,
            stride, out);
}

void exponential_differences(const Nodes& nodes, const Pieces& pieces, double decay, std::span<double> out) {
  const PieceExponential whole(pieces, decay);
  const std::size_t count = pieces.first.size();
  for (std::size_t begin = 0, end; begin < count; begin = end) {
    const auto node = [&](std::size_t piece) { return static_cast<std::size_t>(pieces.first[piece]); };
    const double h = nodes.fine[node(begin)], hk = nodes.coarse[node(begin)];
    for (end = begin + 1; end < count && nodes.fine[node(end)] == h && nodes.coarse[node(end)] == hk;) ++end;
    PieceExponential::pair({&whole, 1}, nodes, begin, end, 0, &out[node(begin)]);
  }
}

}  // namespace gmwm
