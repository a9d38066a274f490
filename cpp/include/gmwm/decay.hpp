// The covariance of the running sum of a process with autocovariance exp(-λ |k|), differenced over the finer of two Haar
// filters, and the constants of one pair of levels.
//
// With d, y and D of src/differences.cpp, a = λh, x = λy and ε = 1 - exp(-a), D times 2 sinh²(λ/2) is
//   d <= 0:  ε² (1 - exp(λd)) / 2
//   d > 0:   ε (cosh x - cosh a) - (sinh x - x) + (sinh a - a) - d (sinh λ - λ).
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "gmwm/bits.hpp"
#include "gmwm/clones.hpp"

namespace gmwm {

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
  const double power = bit_cast<double>((bit_cast<std::int64_t>(shifted) + 1023) << 52);
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

inline double sinh_excess(double x) {
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

// The same for blocks of successive lags, which need one exponential each.
struct BlockDecay : Decay {
  static constexpr std::size_t block = 16;

  double powers[block];  // exp(-λ i) - 1

  BlockDecay(double fine, double coarse, double rate) : Decay(fine, coarse, rate) {
    for (std::size_t i = 0; i < block; ++i) powers[i] = std::expm1(-rate * static_cast<double>(i));
  }
};

}  // namespace gmwm
