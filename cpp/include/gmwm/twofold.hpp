// Double-double arithmetic: numbers as the unevaluated sum of two doubles, W of them at once, and their derivatives.
//
// The relative error of a product, and that of a sum relative to |a| + |b|, is a few 2^-104. Code that uses these types
// must be compiled with -ffp-contract=off: fused multiply-add would lose the rounding error of a sum.
#pragma once

#include <cmath>
#include <cstddef>

#include "gmwm/clones.hpp"

namespace gmwm {

template <std::size_t W>
struct Twofold {
  static constexpr std::size_t lanes = W;
  double high[W], low[W];

  static GMWM_INLINE Twofold of(double a) {
    Twofold c;
    for (std::size_t l = 0; l < W; ++l) c.high[l] = a, c.low[l] = 0.0;
    return c;
  }
  friend GMWM_INLINE Twofold operator+(const Twofold& a, const Twofold& b) {
    Twofold c;
    for (std::size_t l = 0; l < W; ++l) {
      const double s = a.high[l] + b.high[l], t = s - a.high[l];
      const double e = ((a.high[l] - (s - t)) + (b.high[l] - t)) + (a.low[l] + b.low[l]);
      c.high[l] = s + e;
      c.low[l] = e - (c.high[l] - s);
    }
    return c;
  }
  friend GMWM_INLINE Twofold operator-(const Twofold& a, const Twofold& b) {
    Twofold c;
    for (std::size_t l = 0; l < W; ++l) c.high[l] = -b.high[l], c.low[l] = -b.low[l];
    return a + c;
  }
  friend GMWM_INLINE Twofold operator*(const Twofold& a, const Twofold& b) {
    Twofold c;
    for (std::size_t l = 0; l < W; ++l) {
      const double s = a.high[l] * b.high[l];
      const double e = std::fma(a.high[l], b.high[l], -s) + (a.high[l] * b.low[l] + a.low[l] * b.high[l]);
      c.high[l] = s + e;
      c.low[l] = e - (c.high[l] - s);
    }
    return c;
  }
  // Multiplication by a power of two, which is exact.
  friend GMWM_INLINE Twofold operator*(double power, const Twofold& a) {
    Twofold c;
    for (std::size_t l = 0; l < W; ++l) c.high[l] = power * a.high[l], c.low[l] = power * a.low[l];
    return c;
  }
  GMWM_INLINE Twofold inverse() const {
    Twofold y;
    for (std::size_t l = 0; l < W; ++l) y.high[l] = 1.0 / high[l], y.low[l] = 0.0;
    return y + y * (of(1.0) - *this * y);
  }
  GMWM_INLINE double shown(std::size_t l) const { return high[l]; }
  GMWM_INLINE const Twofold& main() const { return *this; }
};

// A number and its derivative in one direction, which can differ between lanes.
template <std::size_t W>
struct Sloped {
  static constexpr std::size_t lanes = W;
  Twofold<W> value, slope;

  static GMWM_INLINE Sloped of(double a) { return {Twofold<W>::of(a), Twofold<W>::of(0.0)}; }
  friend GMWM_INLINE Sloped operator+(const Sloped& a, const Sloped& b) {
    return {a.value + b.value, a.slope + b.slope};
  }
  friend GMWM_INLINE Sloped operator-(const Sloped& a, const Sloped& b) {
    return {a.value - b.value, a.slope - b.slope};
  }
  friend GMWM_INLINE Sloped operator*(const Sloped& a, const Sloped& b) {
    return {a.value * b.value, a.value * b.slope + a.slope * b.value};
  }
  friend GMWM_INLINE Sloped operator*(double power, const Sloped& a) { return {power * a.value, power * a.slope}; }
  GMWM_INLINE Sloped inverse() const {
    const Twofold<W> y = value.inverse();
    return {y, Twofold<W>::of(0.0) - y * y * slope};
  }
  GMWM_INLINE double shown(std::size_t l) const { return slope.high[l]; }
  GMWM_INLINE const Twofold<W>& main() const { return value; }
};

}  // namespace gmwm
