// Forward-mode automatic differentiation: a number with its derivatives by L parameters.
#pragma once

#include <cstddef>

#include "gmwm/clones.hpp"

namespace gmwm {

template <std::size_t L>
struct alignas(64) Dual {
  double d[L];
  double v;

  Dual() = default;
  GMWM_INLINE Dual(double value) : d{}, v(value) {}

  GMWM_INLINE Dual& operator+=(const Dual& o) {
    for (std::size_t l = 0; l < L; ++l) d[l] += o.d[l];
    v += o.v;
    return *this;
  }
  GMWM_INLINE Dual& operator-=(const Dual& o) {
    for (std::size_t l = 0; l < L; ++l) d[l] -= o.d[l];
    v -= o.v;
    return *this;
  }
};

template <std::size_t L>
GMWM_INLINE Dual<L> operator*(const Dual<L>& a, const Dual<L>& b) {
  Dual<L> out;
  for (std::size_t l = 0; l < L; ++l) out.d[l] = a.d[l] * b.v + a.v * b.d[l];
  out.v = a.v * b.v;
  return out;
}

template <std::size_t L>
GMWM_INLINE Dual<L> operator+(const Dual<L>& a, const Dual<L>& b) {
  Dual<L> out = a;
  return out += b;
}

template <std::size_t L>
GMWM_INLINE Dual<L> operator-(const Dual<L>& a, const Dual<L>& b) {
  Dual<L> out = a;
  return out -= b;
}

// 1 / a.
template <std::size_t L>
GMWM_INLINE Dual<L> inverse(const Dual<L>& a) {
  Dual<L> out;
  out.v = 1 / a.v;
  const double slope = -out.v * out.v;
  for (std::size_t l = 0; l < L; ++l) out.d[l] = slope * a.d[l];
  return out;
}

GMWM_INLINE double inverse(double a) { return 1 / a; }
GMWM_INLINE double value_of(double a) { return a; }

template <std::size_t L>
GMWM_INLINE double value_of(const Dual<L>& a) {
  return a.v;
}

}  // namespace gmwm
