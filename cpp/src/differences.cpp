// With y = |u - b + h_j| at the offsets b = 0, h_k, 2 h_k of the coarser filter, d = h_j - y, and D the covariance of
// the running sum differenced over the finer filter, the result is D(u) - 2 D(u - h_k) + D(u - 2 h_k). D is only
// defined up to terms that cancel in this difference. Here, D is 0 at d = 0:
//   white noise  -max(d, 0)                      random walk  -h² d / 2 + (d³ - d) / 6 where d > 0
//   exponential autocovariance  in gmwm/decay.hpp.
#include "gmwm/differences.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "gmwm/clones.hpp"
#include "gmwm/decay.hpp"

namespace gmwm {

namespace {

constexpr std::size_t block = BlockDecay::block;

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
GMWM_INLINE void successive(const BlockDecay& at, double x, bool back, double* out) {
  const double first = expm1_below(-at.decay * x);
  for (std::size_t i = 0; i < block; ++i) {
    const double step = at.powers[back ? block - 1 - i : i];
    out[i] = first + step + first * step;
  }
}

// As `add_difference`, for lags one sample apart between which d only rises or only falls.
GMWM_INLINE void add_successive(const BlockDecay& at, const Depths& depth, double weight, double* out) {
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
GMWM_INLINE void add_difference(const BlockDecay& at, const Depths& depth, double weight, bool unit, double* out) {
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

GMWM_INLINE void exponential_block_inline(const BlockDecay& at, const double* u, double* out) {
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
constexpr Clones<exponential_block_inline> exponential_block{};

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

GMWM_INLINE void white_inline(const Nodes& nodes, double* out) {
  within_reach(nodes, [](double, double d) { return -std::max(d, 0.0); }, out);
}
constexpr Clones<white_inline> white_clone{};

GMWM_INLINE void walk_inline(const Nodes& nodes, double* out) {
  within_reach(
      nodes,
      [](double h, double d) {
        const double inside = std::max(d, 0.0);
        return -0.5 * h * h * d + (inside * inside * inside - inside) / 6;
      },
      out);
}
constexpr Clones<walk_inline> walk_clone{};

GMWM_INLINE void spike_inline(const Nodes& nodes, double* out) {
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
constexpr Clones<spike_inline> spike_clone{};

}  // namespace

void white_differences(const Nodes& nodes, std::span<double> out) { white_clone(nodes, out.data()); }

void walk_differences(const Nodes& nodes, std::span<double> out) { walk_clone(nodes, out.data()); }

void spike_differences(const Nodes& nodes, std::span<double> out) { spike_clone(nodes, out.data()); }

void exponential_differences(const Nodes& nodes, double decay, std::span<double> out) {
  const std::size_t n = nodes.lag.size();
  for (std::size_t first = 0, end; first < n; first = end) {
    const double h = nodes.fine[first], hk = nodes.coarse[first];
    for (end = first + 1; end < n && nodes.fine[end] == h && nodes.coarse[end] == hk;) ++end;
    const BlockDecay at(h, hk, decay);
    std::size_t i = first;
    for (; i + block <= end; i += block) exponential_block(at, &nodes.lag[i], &out[i]);
    if (i == end) continue;
    double u[block], value[block];
    for (std::size_t l = 0; l < block; ++l) u[l] = nodes.lag[std::min(i + l, end - 1)];
    exponential_block(at, u, value);
    std::copy(value, value + (end - i), &out[i]);
  }
}

namespace {

// Second differences of q(m) = m² (|m|^ε - 1)/ε; m² ln|m| for ε = 0. Far from the kink, they are series in the inverse
// square of the lag, whose terms fall by a factor of 16.
class PowerLaw {
 public:
  PowerLaw(double epsilon, std::span<const double, power_terms> falling) : epsilon_(epsilon) {
    std::copy(falling.begin(), falling.end(), falling_.begin());
    std::array<double, 2 * power_terms + 3> factorial{1.0};
    for (std::size_t n = 1; n < factorial.size(); ++n) factorial[n] = static_cast<double>(n) * factorial[n - 1];
    for (std::size_t k = 1; k <= power_terms; ++k)
      for (std::size_t i = 1; i + k <= power_terms + 1; ++i)
        table_[k - 1][i - 1] = falling_[i + k - 2] * factorial[2 * (i + k)] / (factorial[2 * k] * factorial[2 * i]);
  }

  // By one and then by `step` ≥ 1, at lags t ≥ 0.
  double twice(double step, double t) const {
    if (t < near * (1 + step)) return bend(t + step) - 2 * bend(t) + bend(std::abs(t - step));
    const double y = 1 / (t * t), z = (step / t) * (step / t);
    std::array<double, power_terms> inner{};
    for (std::size_t k = power_terms; k >= 1; --k)
      for (std::size_t i = 0; i < power_terms; ++i) inner[i] = inner[i] * y + table_[k - 1][i];
    double total = 0;
    for (std::size_t i = power_terms; i >= 1; --i) total = (total + inner[i - 1]) * z;
    return 4 * power(t) * total;
  }

 private:
  static constexpr double near = 4;  // lag, over the step of the difference, from which the series is used

  double power(double t) const { return epsilon_ == 0 ? 1.0 : std::exp(epsilon_ * std::log(t)); }
  double grown(double x) const { return epsilon_ == 0 ? x : std::expm1(epsilon_ * x) / epsilon_; }
  double q(double m) const { return m > 0 ? m * m * grown(std::log(m)) : 0.0; }

  double bend(double t) const {
    if (t < near) return q(t + 1) - 2 * q(t) + q(std::abs(t - 1));
    const double y = 1 / (t * t), log = std::log(t);
    double tail = 0;
    for (std::size_t k = power_terms; k >= 1; --k) tail = (tail + falling_[k - 1]) * y;
    return 2 * grown(log) + power(t) * (3 + epsilon_ + 2 * tail);
  }

  double epsilon_;
  std::array<double, power_terms> falling_;
  std::array<std::array<double, power_terms>, power_terms> table_{};  // coefficients of y^k z^i
};

}  // namespace

void power_differences(const Nodes& nodes, double epsilon, std::span<const double, power_terms> falling,
                       std::span<double> out) {
  const PowerLaw law(epsilon, falling);
  double fine = 1, factor = 1;
  for (std::size_t i = 0; i < out.size(); ++i) {
    if (nodes.fine[i] != fine) fine = nodes.fine[i], factor = std::pow(fine, 2 + epsilon);
    const double coarse = nodes.coarse[i], middle = std::abs((nodes.lag[i] + fine - coarse) / fine);
    out[i] = factor * law.twice(coarse / fine, middle);
  }
}

}  // namespace gmwm
