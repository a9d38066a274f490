// Double-double arithmetic: numbers as the unevaluated sum of two doubles, W of them at once, and their derivatives.
//
// The relative error of a product, and that of a sum relative to |a| + |b|, is a few 2^-104. Code that uses these types
// must be compiled with -ffp-contract=off: fused multiply-add would lose the rounding error of a sum.
#pragma once

#include <cmath>
#include <cstddef>

#include "gmwm/clones.hpp"

namespace gmwm {

// Rounding error of the product s = a * b, exactly. The fma of the MinGW library rounds twice, so there the factors are
// split in halves (Dekker 1971, "A floating-point technique for extending the available precision").
GMWM_INLINE double product_error(double a, double b, double s) {
#if defined(__MINGW32__) && !defined(__FMA__)
  const double splitter = 134217729.0;  // 2^27 + 1
  const double p = splitter * a, q = splitter * b;
  const double a1 = p - (p - a), b1 = q - (q - b), a2 = a - a1, b2 = b - b1;
  return ((a1 * b1 - s) + a1 * b2 + a2 * b1) + a2 * b2;
#else
  return std::fma(a, b, -s);
#endif
}

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
      const double e = product_error(a.high[l], b.high[l], s) + (a.high[l] * b.low[l] + a.low[l] * b.high[l]);
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
