// With y = |u - b + h_j| at the offsets b = 0, h_k, 2 h_k of the coarser filter, d = h_j - y, and D the covariance of
// the running sum differenced over the finer filter, the result is D(u) - 2 D(u - h_k) + D(u - 2 h_k). D is only
// defined up to terms that cancel in this difference. Here, D is 0 at d = 0:
//   white noise  -max(d, 0)                      random walk  -h² d / 2 + (d³ - d) / 6 where d > 0.
// Of exp(-λ |k|), times 2 sinh²(λ/2), with a = λh, x = λy, ε = 1 - exp(-a):
//   d <= 0:  ε² (1 - exp(λd)) / 2
//   d > 0:   ε (cosh x - cosh a) - (sinh x - x) + (sinh a - a) - d (sinh λ - λ).
#include "gmwm/differences.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "gmwm/clones.hpp"

namespace gmwm {

namespace {

constexpr std::size_t block = 16;

// exp(z) - 1 for z <= 0, to rounding; no branch, so that loops over it vectorise.
GMWM_INLINE double expm1_below(double z) {
  constexpr double shift = 0x1.8p52, high = 0x1.62e42fefa3800p-1, low = 0x1.ef35793c76730p-45;
  z = std::max(z, -700.0);
  const double shifted = z * 0x1.71547652b82fep0 + shift;
  const double k = shifted - shift;
  const double r = (z - k * high) - k * low;
  // Not a loop over coefficients, which would keep loops over this function from being vectorised.
  double p = 1.0 / 6227020800.0;
  p = p * r + 1.0 / 479001600, p = p * r + 1.0 / 39916800, p = p * r + 1.0 / 3628800, p = p * r + 1.0 / 362880;
  p = p * r + 1.0 / 40320, p = p * r + 1.0 / 5040, p = p * r + 1.0 / 720, p = p * r + 1.0 / 120;
  p = p * r + 1.0 / 24, p = p * r + 1.0 / 6, p = p * r + 0.5, p = p * r + 1.0;
  const double power = std::bit_cast<double>((std::bit_cast<std::int64_t>(shifted) + 1023) << 52);
  return power * (p * r) + (power - 1);
}

// cosh x - 1 and sinh x - x where |x| <= 1.
GMWM_INLINE void short_series(double x, double& cosh_part, double& sinh_part) {
  const double s = x * x;
  double c = 1.0 / 6402373705728000, h = 1.0 / 121645100408832000;
  for (const double term : {1.0 / 20922789888000, 1.0 / 87178291200, 1.0 / 479001600, 1.0 / 3628800, 1.0 / 40320,
                            1.0 / 720, 1.0 / 24, 0.5})
    c = c * s + term;
  for (const double term : {1.0 / 355687428096000, 1.0 / 1307674368000, 1.0 / 6227020800, 1.0 / 39916800,
                            1.0 / 362880, 1.0 / 5040, 1.0 / 120, 1.0 / 6})
    h = h * s + term;
  cosh_part = c * s;
  sinh_part = h * s * x;
}

double sinh_excess(double x) {
  if (x > 1) return std::sinh(x) - x;
  double cosh_part, sinh_part;
  short_series(x, cosh_part, sinh_part);
  return sinh_part;
}

// The constants of exp(-λ |k|) for one pair of levels.
struct Decay {
  double h, hk, decay;
  double gain, epsilon, epsilon_coarse, cosh_part, sinh_part, excess, sinh_decay, at_end;
  bool by_series;
  double powers[block];  // exp(-λ i) - 1, so that a block of successive lags needs one exponential

  Decay(double fine, double coarse, double rate) : h(fine), hk(coarse), decay(rate) {
    const double half = std::sinh(0.5 * rate), a = rate * fine;
    gain = 0.5 / (half * half);
    epsilon = -std::expm1(-a);
    epsilon_coarse = -std::expm1(-rate * coarse);
    excess = sinh_excess(rate);
    sinh_decay = std::sinh(rate);
    by_series = a <= 1;
    cosh_part = sinh_part = 0;
    if (by_series) short_series(a, cosh_part, sinh_part);
    at_end = std::exp(-a);
    for (std::size_t i = 0; i < block; ++i) powers[i] = std::expm1(-rate * static_cast<double>(i));
  }

  GMWM_INLINE double outside(double d) const { return outside_of(expm1_below(decay * std::min(d, 0.0))); }

  // Of exp(λ d) - 1.
  GMWM_INLINE double outside_of(double part) const { return -0.5 * epsilon * epsilon * part; }

  // a <= 1.
  GMWM_INLINE double inside_series(double d) const {
    d = std::max(d, 0.0);
    double c, s;
    short_series(decay * (h - d), c, s);
    return epsilon * (c - cosh_part) - (s - sinh_part) - d * excess;
  }

  // a > 1: nothing cancels in exp(-x) - exp(-a) cosh x.
  GMWM_INLINE double inside_direct(double d) const {
    d = std::max(d, 0.0);
    return inside_of(expm1_below(-decay * (h - d)), expm1_below(-decay * d), d);
  }

  // Of exp(-λ (h - d)) - 1 and exp(-λ d) - 1.
  GMWM_INLINE double inside_of(double to_middle, double to_end, double d) const {
    return (to_middle + 1) * (1 - 0.5 * at_end) - at_end - 0.5 * to_end + 0.5 * at_end * at_end - d * sinh_decay;
  }

  // Where the filters do not overlap any more, the covariance decays exponentially with the distance of the two blocks.
  GMWM_INLINE double beyond(double u) const {
    const double distance = std::max(u - 2 * hk, -2 * h - u);
    const double ends = epsilon * epsilon_coarse;
    return -0.5 * ends * ends * (expm1_below(-decay * std::max(distance, 0.0)) + 1);
  }
};

// d at one of the three offsets, for a block of lags, and whether all or none of the lags are inside the overlap.
struct Depths {
  double d[block];
  double least, most;
};

GMWM_INLINE void depths(const double* u, double h, double offset, Depths& to) {
  for (std::size_t i = 0; i < block; ++i) to.d[i] = h - std::abs(u[i] - offset + h);
  to.least = to.most = to.d[0];
  for (std::size_t i = 1; i < block; ++i) {
    to.least = std::min(to.least, to.d[i]);
    to.most = std::max(to.most, to.d[i]);
  }
}

// exp(-λ (x + i)) - 1 for i = 0, 1, …, or in reverse order if `back`. No terms cancel: all are negative.
GMWM_INLINE void successive(const Decay& at, double x, bool back, double* out) {
  const double first = expm1_below(-at.decay * x);
  for (std::size_t i = 0; i < block; ++i) {
    const double step = at.powers[back ? block - 1 - i : i];
    out[i] = first + step + first * step;
  }
}

// As `add_difference`, for lags one sample apart between which d only rises or only falls.
GMWM_INLINE void add_successive(const Decay& at, const Depths& depth, double weight, double* out) {
  const bool rising = depth.d[1] > depth.d[0];
  double end[block], middle[block];
  if (depth.most <= 0) {
    successive(at, -depth.most, rising, end);
    for (std::size_t i = 0; i < block; ++i) out[i] += weight * at.outside_of(end[i]);
    return;
  }
  successive(at, depth.least, !rising, end);
  successive(at, at.h - depth.most, rising, middle);
  for (std::size_t i = 0; i < block; ++i) out[i] += weight * at.inside_of(middle[i], end[i], depth.d[i]);
}

// Adds weight · D to a block.
GMWM_INLINE void add_difference(const Decay& at, const Depths& depth, double weight, bool unit, double* out) {
  // d changes direction in the middle of the filter.
  const bool monotone = unit && std::abs(depth.d[block - 1] - depth.d[0]) == block - 1;
  if (monotone && (depth.most <= 0 || (depth.least > 0 && !at.by_series))) {
    add_successive(at, depth, weight, out);
    return;
  }
  if (depth.most <= 0) {
    for (std::size_t i = 0; i < block; ++i) out[i] += weight * at.outside(depth.d[i]);
    return;
  }
  double inside[block];
  if (at.by_series)
    for (std::size_t i = 0; i < block; ++i) inside[i] = at.inside_series(depth.d[i]);
  else
    for (std::size_t i = 0; i < block; ++i) inside[i] = at.inside_direct(depth.d[i]);
  if (depth.least > 0) {
    for (std::size_t i = 0; i < block; ++i) out[i] += weight * inside[i];
    return;
  }
  for (std::size_t i = 0; i < block; ++i) {
    const double outside = at.outside(depth.d[i]);
    out[i] += weight * (depth.d[i] > 0 ? inside[i] : outside);
  }
}

GMWM_CLONES void exponential_block(const Decay& at, const double* u, double* out) {
  double beyond[block], value[block] = {};
  std::size_t count = 0;
  for (std::size_t i = 0; i < block; ++i) count += u[i] >= 2 * at.hk || u[i] <= -2 * at.h;
  if (count < block) {
    bool unit = true;
    for (std::size_t i = 1; i < block; ++i) unit = unit && u[i] == u[i - 1] + 1;
    Depths depth;
    for (int b = 0; b < 3; ++b) {
      depths(u, at.h, b * at.hk, depth);
      add_difference(at, depth, b == 1 ? -2 : 1, unit, value);
    }
    if (count == 0) {
      for (std::size_t i = 0; i < block; ++i) out[i] = at.gain * value[i];
      return;
    }
  }
  for (std::size_t i = 0; i < block; ++i) beyond[i] = at.beyond(u[i]);
  for (std::size_t i = 0; i < block; ++i)
    out[i] = at.gain * (u[i] >= 2 * at.hk || u[i] <= -2 * at.h ? beyond[i] : value[i]);
}

// The second difference of D(h, d) over the coarser filter, exactly zero where the filters do not overlap.
template <class Difference>
GMWM_INLINE void within_reach(const Nodes& nodes, Difference difference, double* out) {
  const double *fine = nodes.fine.data(), *coarse = nodes.coarse.data(), *lag = nodes.lag.data();
  for (std::size_t i = 0; i < nodes.lag.size(); ++i) {
    const double h = fine[i], hk = coarse[i], u = lag[i];
    const double value = difference(h, h - std::abs(u + h)) - 2 * difference(h, h - std::abs(u - hk + h)) +
                         difference(h, h - std::abs(u - 2 * hk + h));
    out[i] = u >= 2 * hk || u <= -2 * h ? 0.0 : value;
  }
}

GMWM_CLONES void white_clone(const Nodes& nodes, double* out) {
  within_reach(nodes, [](double, double d) { return -std::max(d, 0.0); }, out);
}

GMWM_CLONES void walk_clone(const Nodes& nodes, double* out) {
  within_reach(
      nodes,
      [](double h, double d) {
        const double inside = std::max(d, 0.0);
        return -0.5 * h * h * d + (inside * inside * inside - inside) / 6;
      },
      out);
}

GMWM_CLONES void spike_clone(const Nodes& nodes, double* out) {
  const double *fine = nodes.fine.data(), *coarse = nodes.coarse.data(), *lag = nodes.lag.data();
  for (std::size_t i = 0; i < nodes.lag.size(); ++i) {
    const double h = fine[i], hk = coarse[i], u = lag[i];
    double sum = 0;
    for (int b = 0; b < 3; ++b) {
      const double m = u - b * hk;
      const double spikes = (m == 0 ? 1.0 : 0.0) - (m == -h ? 2.0 : 0.0) + (m == -2 * h ? 1.0 : 0.0);
      sum += b == 1 ? -2 * spikes : spikes;
    }
    out[i] = sum;
  }
}

// exp(-λ t) - 1 of the offsets t of a pattern from its first and from its last node, and the offsets.
struct Pattern {
  std::size_t size = 0;
  double length = 0;  // from the first to the last node
  double from_first[piece_nodes] = {}, from_last[piece_nodes] = {}, offset[piece_nodes] = {};
};

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

// The sums of `node_sums` over the nodes of one pair of levels.
GMWM_CLONES void add_nodes(const double* const* shapes, const double* scales, std::size_t count, const double* weight,
                           std::size_t begin, std::size_t end, double& first, double& second) {
  double lanes[2][block] = {};
  double total[block];
  for (std::size_t i = begin; i < end; i += block) {
    const std::size_t width = std::min(block, end - i);
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

// Pieces of one pair of levels.
GMWM_CLONES void of_pieces(const Decay& at, const Pattern* patterns, const double* lag, const std::int64_t* first,
                           const std::int64_t* kind, std::size_t count, double* out) {
  double powers[together * arguments], value[piece_nodes];
  Place places[together];
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
      double* to = out + first[p];
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

void exponential_differences(const Nodes& nodes, const Pieces& pieces, double decay, std::span<double> out) {
  const std::vector<Pattern> patterns = patterns_of(pieces, decay);
  const std::size_t count = pieces.first.size();
  for (std::size_t begin = 0, end; begin < count; begin = end) {
    const auto node = [&](std::size_t piece) { return static_cast<std::size_t>(pieces.first[piece]); };
    const double h = nodes.fine[node(begin)], hk = nodes.coarse[node(begin)];
    for (end = begin + 1; end < count && nodes.fine[node(end)] == h && nodes.coarse[node(end)] == hk;) ++end;
    of_pieces(Decay(h, hk, decay), patterns.data(), nodes.lag.data(), &pieces.first[begin], &pieces.pattern[begin],
              end - begin, out.data());
  }
}

void white_differences(const Nodes& nodes, std::span<double> out) { white_clone(nodes, out.data()); }

void walk_differences(const Nodes& nodes, std::span<double> out) { walk_clone(nodes, out.data()); }

void spike_differences(const Nodes& nodes, std::span<double> out) { spike_clone(nodes, out.data()); }

void exponential_differences(const Nodes& nodes, double decay, std::span<double> out) {
  const std::size_t n = nodes.lag.size();
  for (std::size_t first = 0, end; first < n; first = end) {
    const double h = nodes.fine[first], hk = nodes.coarse[first];
    for (end = first + 1; end < n && nodes.fine[end] == h && nodes.coarse[end] == hk;) ++end;
    const Decay at(h, hk, decay);
    std::size_t i = first;
    for (; i + block <= end; i += block) exponential_block(at, &nodes.lag[i], &out[i]);
    if (i == end) continue;
    double u[block], value[block];
    for (std::size_t l = 0; l < block; ++l) u[l] = nodes.lag[std::min(i + l, end - 1)];
    exponential_block(at, u, value);
    std::copy(value, value + (end - i), &out[i]);
  }
}

void node_sums(std::span<const double* const> shapes, std::span<const double> scales, std::span<const double> weight,
               std::span<const std::int64_t> starts, const NodeSums& out) {
  for (std::size_t pair = 0; pair < starts.size(); ++pair) {
    const auto begin = static_cast<std::size_t>(starts[pair]);
    const auto end = pair + 1 < starts.size() ? static_cast<std::size_t>(starts[pair + 1]) : weight.size();
    add_nodes(shapes.data(), scales.data(), shapes.size(), weight.data(), begin, end, out.first[pair], out.second[pair]);
  }
}

}  // namespace gmwm
