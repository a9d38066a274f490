// Vectors of four and of eight doubles, for SIMD in the kernels.
#pragma once

#include <cstddef>

#include "gmwm/clones.hpp"

// Whether to use the vector extension of the compiler with shuffles: Clang, and GCC from version 12 on. With GCC 11,
// vectors are half as fast as an array.
#if defined(__has_builtin) && !defined(GMWM_PORTABLE)
#if __has_builtin(__builtin_shufflevector)
#define GMWM_HAS_VECTORS
#endif
#endif

namespace gmwm {

// A vector of four doubles. GCC and Clang keep the vector type in registers; a loop over an array is not always
// vectorised, and wider types are very slow on processors without such registers. Such processors are those without
// AVX: the registers of ARM and of WebAssembly hold two doubles.
#if defined(GMWM_HAS_VECTORS) && GMWM_HAS_CLONES
struct Pack {
  static constexpr std::size_t size = 4;
  typedef double Values __attribute__((vector_size(32)));
  typedef double Memory __attribute__((vector_size(32), aligned(8), may_alias));
  Values v;

  static GMWM_INLINE Pack of(double a) { return {Values{a, a, a, a}}; }
  static GMWM_INLINE Pack load(const double* p) { return {*reinterpret_cast<const Memory*>(p)}; }
  GMWM_INLINE void store(double* p) const { *reinterpret_cast<Memory*>(p) = v; }
  GMWM_INLINE Pack operator+(const Pack& o) const { return {v + o.v}; }
  GMWM_INLINE Pack operator-(const Pack& o) const { return {v - o.v}; }
  GMWM_INLINE Pack operator*(const Pack& o) const { return {v * o.v}; }
  GMWM_INLINE double first() const { return v[0]; }
  GMWM_INLINE Pack last() const { return {__builtin_shufflevector(v, v, 3, 3, 3, 3)}; }
  GMWM_INLINE double total() const { return (v[0] + v[2]) + (v[1] + v[3]); }
  // (v0, v0 + v1, v0 + v1 + v2, v0 + v1 + v2 + v3)
  GMWM_INLINE Pack running_sum() const {
    const Values zero = {};
    const Values pairs = v + __builtin_shufflevector(zero, v, 0, 4, 2, 6);
    return {pairs + __builtin_shufflevector(zero, pairs, 0, 1, 5, 5)};
  }
};

// A vector of eight doubles, for the version x86-64-v4 only, with the operations of the Haar kernel.
struct WidePack {
  static constexpr std::size_t size = 8;
  typedef double Values __attribute__((vector_size(64)));
  typedef double Memory __attribute__((vector_size(64), aligned(8), may_alias));
  Values v;

  static GMWM_INLINE WidePack of(double a) { return {Values{a, a, a, a, a, a, a, a}}; }
  static GMWM_INLINE WidePack load(const double* p) { return {*reinterpret_cast<const Memory*>(p)}; }
  GMWM_INLINE WidePack operator+(const WidePack& o) const { return {v + o.v}; }
  GMWM_INLINE WidePack operator-(const WidePack& o) const { return {v - o.v}; }
  GMWM_INLINE WidePack operator*(const WidePack& o) const { return {v * o.v}; }
  GMWM_INLINE double total() const { return ((v[0] + v[4]) + (v[2] + v[6])) + ((v[1] + v[5]) + (v[3] + v[7])); }
};
#elif defined(GMWM_HAS_VECTORS)
struct Pack {
  static constexpr std::size_t size = 4;
  typedef double Values __attribute__((vector_size(16)));
  typedef double Memory __attribute__((vector_size(16), aligned(8), may_alias));
  Values low, high;

  static GMWM_INLINE Values at(const double* p) { return *reinterpret_cast<const Memory*>(p); }
  static GMWM_INLINE Pack of(double a) { return {Values{a, a}, Values{a, a}}; }
  static GMWM_INLINE Pack load(const double* p) { return {at(p), at(p + 2)}; }
  GMWM_INLINE void store(double* p) const {
    *reinterpret_cast<Memory*>(p) = low;
    *reinterpret_cast<Memory*>(p + 2) = high;
  }
  GMWM_INLINE Pack operator+(const Pack& o) const { return {low + o.low, high + o.high}; }
  GMWM_INLINE Pack operator-(const Pack& o) const { return {low - o.low, high - o.high}; }
  GMWM_INLINE Pack operator*(const Pack& o) const { return {low * o.low, high * o.high}; }
  GMWM_INLINE double first() const { return low[0]; }
  GMWM_INLINE Pack last() const { return of(high[1]); }
  GMWM_INLINE double total() const {
    const Values sum = low + high;
    return sum[0] + sum[1];
  }
  GMWM_INLINE Pack running_sum() const {
    const Values zero = {};
    const Values start = low + __builtin_shufflevector(zero, low, 0, 2);
    const Values end = high + __builtin_shufflevector(zero, high, 0, 2);
    return {start, end + __builtin_shufflevector(start, start, 1, 1)};
  }
};
#else
struct Pack {
  static constexpr std::size_t size = 4;
  double v[size];

  static GMWM_INLINE Pack of(double a) { return {{a, a, a, a}}; }
  static GMWM_INLINE Pack load(const double* p) { return {{p[0], p[1], p[2], p[3]}}; }
  GMWM_INLINE void store(double* p) const {
    for (std::size_t l = 0; l < size; ++l) p[l] = v[l];
  }
  GMWM_INLINE Pack operator+(const Pack& o) const {
    return {{v[0] + o.v[0], v[1] + o.v[1], v[2] + o.v[2], v[3] + o.v[3]}};
  }
  GMWM_INLINE Pack operator-(const Pack& o) const {
    return {{v[0] - o.v[0], v[1] - o.v[1], v[2] - o.v[2], v[3] - o.v[3]}};
  }
  GMWM_INLINE Pack operator*(const Pack& o) const {
    return {{v[0] * o.v[0], v[1] * o.v[1], v[2] * o.v[2], v[3] * o.v[3]}};
  }
  GMWM_INLINE double first() const { return v[0]; }
  GMWM_INLINE Pack last() const { return of(v[3]); }
  GMWM_INLINE double total() const { return (v[0] + v[2]) + (v[1] + v[3]); }
  GMWM_INLINE Pack running_sum() const {
    const double low = v[0] + v[1];
    return {{v[0], low, low + v[2], low + (v[2] + v[3])}};
  }
};
#endif
#if !GMWM_HAS_CLONES
using WidePack = Pack;
#endif

}  // namespace gmwm
