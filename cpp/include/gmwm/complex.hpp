// Complex numbers without the checks for infinities that std::complex makes in every product.
#pragma once

#include <cmath>
#include <numbers>

#include "gmwm/clones.hpp"

namespace gmwm {

struct Complex {
  double re = 0, im = 0;

  friend GMWM_INLINE Complex operator+(Complex a, Complex b) { return {a.re + b.re, a.im + b.im}; }
  friend GMWM_INLINE Complex operator-(Complex a, Complex b) { return {a.re - b.re, a.im - b.im}; }
  friend GMWM_INLINE Complex operator-(Complex a) { return {-a.re, -a.im}; }
  friend GMWM_INLINE Complex operator*(Complex a, Complex b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
  }
  friend GMWM_INLINE Complex operator*(double a, Complex b) { return {a * b.re, a * b.im}; }
  Complex& operator+=(Complex b) { return *this = *this + b; }
  Complex& operator*=(Complex b) { return *this = *this * b; }
};

inline Complex conj(Complex a) { return {a.re, -a.im}; }
inline double norm(Complex a) { return a.re * a.re + a.im * a.im; }
inline double size(Complex a) { return std::hypot(a.re, a.im); }
// 1 / a. Components near the ends of the range of doubles are scaled first.
inline Complex inverse(Complex a) {
  const double scale = 1 / std::fmax(std::abs(a.re), std::abs(a.im));
  const Complex b = scale * a;
  return (scale / norm(b)) * conj(b);
}
// The same number with an imaginary part between -π and π.
inline Complex wrapped(Complex a) { return {a.re, std::remainder(a.im, 2 * std::numbers::pi)}; }
// n a for an integer n, where a has an imaginary part between 0 and π. Multiples of π are exact.
inline Complex multiple(double n, Complex a) {
  return {n * a.re, a.im == std::numbers::pi ? std::fmod(n, 2.0) * a.im : n * a.im};
}
// Real results are exactly real: for an imaginary part of 0 and of ±π.
inline Complex exp(Complex a) {
  const double size = std::exp(a.re);
  if (a.im == 0) return {size, 0};
  if (std::abs(a.im) == std::numbers::pi) return {-size, 0};
  return {size * std::cos(a.im), size * std::sin(a.im)};
}
inline Complex expm1(Complex a) {
  const double grown = std::expm1(a.re);
  if (a.im == 0) return {grown, 0};
  if (std::abs(a.im) == std::numbers::pi) return {-2 - grown, 0};
  const double half = std::sin(0.5 * a.im);
  return {grown * std::cos(a.im) - 2 * half * half, (grown + 1) * std::sin(a.im)};
}
inline Complex sinh(Complex a) { return 0.5 * (expm1(a) - expm1(-a)); }
inline Complex cosh(Complex a) { return 0.5 * (exp(a) + exp(-a)); }

}  // namespace gmwm
