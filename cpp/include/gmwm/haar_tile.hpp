// The inner loops of the Haar kernel, inlined into every version (src/haar.cpp) and tested in each.
#pragma once

#include <algorithm>
#include <bit>
#include <cstddef>

#include "gmwm/clones.hpp"
#include "gmwm/pack.hpp"

namespace gmwm::tile {

// Samples of a tile: 32 KiB of the running sum, so that the values which the levels share stay in the first-level
// cache.
inline constexpr std::size_t size = 4096;
// Levels that are processed together. They share the values at lags 0, 2h, 4h …, with K + 2 reads instead of 3 K.
inline constexpr std::size_t fused = 5;

// Sum of x[i] - origin, with several partial sums at once.
GMWM_INLINE double sum(const double* x, std::size_t n, double origin) {
  const Pack from = Pack::of(origin);
  Pack acc[4] = {};
  std::size_t i = 0;
  for (; i + 4 * Pack::size <= n; i += 4 * Pack::size)
    for (std::size_t r = 0; r < 4; ++r) acc[r] = acc[r] + (Pack::load(x + i + r * Pack::size) - from);
  double rest = 0.0;
  for (; i < n; ++i) rest += x[i] - origin;
  return ((acc[0] + acc[1]) + (acc[2] + acc[3])).total() + rest;
}

// Copies x to out, and returns the sum, with several partial sums at once.
GMWM_INLINE double copied_sum(const double* x, std::size_t n, double* out) {
  Pack acc[4] = {};
  std::size_t i = 0;
  for (; i + 4 * Pack::size <= n; i += 4 * Pack::size)
    for (std::size_t r = 0; r < 4; ++r) {
      const Pack values = Pack::load(x + i + r * Pack::size);
      values.store(out + i + r * Pack::size);
      acc[r] = acc[r] + values;
    }
  double rest = 0.0;
  for (; i < n; ++i) rest += out[i] = x[i];
  return ((acc[0] + acc[1]) + (acc[2] + acc[3])).total() + rest;
}

// out[k] = base + Σ_{s<=k} (x[s] - mean). If the values were added one by one, each addition would wait for the
// previous one. Here, four values are summed first, and only one addition in four depends on the previous one.
GMWM_INLINE void running_sum(const double* x, std::size_t n, double mean, double base, double* out) {
  std::size_t k = 0;
  const Pack centre = Pack::of(mean);
  Pack from = Pack::of(base);
  for (; k + Pack::size <= n; k += Pack::size) {
    const Pack local = (Pack::load(x + k) - centre).running_sum();
    (from + local).store(out + k);
    from = from + local.last();
  }
  double sum = from.first();
  for (; k < n; ++k) out[k] = sum += x[k] - mean;
}

// Values that are needed next, and are requested from memory while a tile is processed: value i of the tile stands for
// the value at[i + (i >> shift) * skip]. These are consecutive values, or columns of a matrix with rows far apart.
struct Ahead {
  const double* at = nullptr;
  unsigned shift = 63;
  std::size_t skip = 0;
};

GMWM_INLINE void request(const Ahead& ahead, std::size_t i) {
#if defined(__GNUC__)
  __builtin_prefetch(ahead.at + (i >> ahead.shift) * ahead.skip + i, 0, 2);
#else
  (void)ahead, (void)i;
#endif
}

// Adds to sums[k], k < K, the sum over i < n of (p[i] - 2 p[i - h_k] + p[i - 2 h_k])², h_k = h 2^k.
template <std::size_t K, class Values, bool requests = false>
GMWM_INLINE void second_differences(const double* p, std::size_t n, std::size_t h, double* sums,
                                    const Ahead& ahead = {}) {
  const Values two = Values::of(2.0);
  Values acc[K] = {};
  std::size_t i = 0;
  for (; i + Values::size <= n; i += Values::size) {
    const double* at = p + i;
    if constexpr (requests) request(ahead, i);
    const Values now = Values::load(at);
    Values half = Values::load(at - h);
    for (std::size_t k = 0; k < K; ++k) {
      const Values full = Values::load(at - (h << (k + 1)));
      const Values w = now + full - two * half;
      acc[k] = acc[k] + w * w;
      half = full;
    }
  }
  for (std::size_t k = 0; k < K; ++k) {
    double total = acc[k].total();
    for (std::size_t m = i; m < n; ++m) {
      const double* at = p + m;
      const double w = *at + *(at - (h << (k + 1))) - 2.0 * *(at - (h << k));
      total += w * w;
    }
    sums[k] += total;
  }
}

// Processes levels with half-scales h, 2h, … of one tile; p[-h 2^levels] must be readable. The differences are not yet
// divided by 2^j. `Values` is the vector that suits the processor.
template <class Values = Pack>
GMWM_INLINE void levels_of_tile(const double* p, std::size_t n, std::size_t levels, double* sums, std::size_t h = 1,
                                const Ahead& ahead = {}) {
  std::size_t k = 0;
  if (ahead.at != nullptr && levels >= fused) {
    second_differences<fused, Values, true>(p, n, h, sums, ahead);
    k = fused;
  }
  for (; k + fused <= levels; k += fused) second_differences<fused, Values>(p, n, h << k, sums + k);
  switch (levels - k) {
    case 4: second_differences<4, Values>(p, n, h << k, sums + k); break;
    case 3: second_differences<3, Values>(p, n, h << k, sums + k); break;
    case 2: second_differences<2, Values>(p, n, h << k, sums + k); break;
    case 1: second_differences<1, Values>(p, n, h << k, sums + k); break;
    default: break;
  }
}

// The end of the tile that starts at index i of the running sum. Tiles end at multiples of their size, and within the
// first of these also at powers of two, so that a level has either all coefficients of a tile or none.
inline std::size_t end(std::size_t i) {
  return i < size ? std::bit_ceil(i + 1) : (i / size + 1) * size;
}

// Number of levels that have coefficients at index i >= 1 of the running sum: levels with 2^j <= i.
inline std::size_t active(std::size_t i, std::size_t levels) {
  return std::min<std::size_t>(levels, static_cast<std::size_t>(std::bit_width(i)) - 1);
}

}  // namespace gmwm::tile
