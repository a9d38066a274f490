// The inner loops of the biweight kernel, inlined into every version (src/robust.cpp) and tested in each.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "gmwm/clones.hpp"
#include "gmwm/pack.hpp"

namespace gmwm::tile {

// Levels that are processed together. Each needs two sums, a limit and its inverse in registers; AVX2 has 16 registers.
inline constexpr std::size_t biweight_fused = 3;

// The elementwise minimum, also for infinite p.
GMWM_INLINE Pack smaller(const Pack& p, const Pack& limit) {
#if defined(GMWM_HAS_VECTORS) && GMWM_HAS_CLONES
  return {p.v < limit.v ? p.v : limit.v};
#elif defined(GMWM_HAS_VECTORS)
  return {p.low < limit.low ? p.low : limit.low, p.high < limit.high ? p.high : limit.high};
#else
  Pack out = limit;
  for (std::size_t l = 0; l < Pack::size; ++l) out.v[l] = std::min(p.v[l], limit.v[l]);
  return out;
#endif
}

// Adds u q³ to cubed and u q⁴ to fourth, with u = min(w², limit) and q = 1 - u / limit. A minimum of w², and not of q, is
// correct even if w² overflows. It also does not use the multipliers, which are the bottleneck.
GMWM_INLINE void biweight(const Pack& w, const Pack& limit, const Pack& inverse, Pack& cubed, Pack& fourth) {
  const Pack u = smaller(w * w, limit);
  const Pack q = Pack::of(1.0) - u * inverse;
  const Pack term = (u * q) * (q * q);
  cubed = cubed + term;
  fourth = fourth + term * q;
}

GMWM_INLINE void biweight(double w, double limit, double inverse, double& cubed, double& fourth) {
  const double u = std::min(w * w, limit), q = 1.0 - u * inverse, term = (u * q) * (q * q);
  cubed += term;
  fourth += term * q;
}

// Adds the sums over the values x.
GMWM_INLINE void biweight_of_values(const double* x, std::size_t n, double limit, double& cubed, double& fourth) {
  const double inverse = 1.0 / limit;
  const Pack high = Pack::of(limit), scale = Pack::of(inverse);
  Pack a[2] = {}, b[2] = {};
  std::size_t i = 0;
  for (; i + 2 * Pack::size <= n; i += 2 * Pack::size)
    for (std::size_t s = 0; s < 2; ++s) biweight(Pack::load(x + i + s * Pack::size), high, scale, a[s], b[s]);
  cubed += (a[0] + a[1]).total();
  fourth += (b[0] + b[1]).total();
  for (; i < n; ++i) biweight(x[i], limit, inverse, cubed, fourth);
}

// Adds the sums over i < n of w = p[i] - 2 p[i - h_k] + p[i - 2 h_k], k < K, h_k = h 2^k.
template <std::size_t K>
GMWM_INLINE void biweight_of_differences(const double* p, std::size_t n, std::size_t h, const double* limit,
                                         double* cubed, double* fourth) {
  Pack a[K] = {}, b[K] = {}, high[K], scale[K];
  for (std::size_t k = 0; k < K; ++k) {
    high[k] = Pack::of(limit[k]);
    scale[k] = Pack::of(1.0 / limit[k]);
  }
  std::size_t i = 0;
  for (; i + Pack::size <= n; i += Pack::size) {
    const double* at = p + i;
    const Pack now = Pack::load(at);
    Pack half = Pack::load(at - h);
    for (std::size_t k = 0; k < K; ++k) {
      const Pack full = Pack::load(at - (h << (k + 1)));
      biweight((now - half) - (half - full), high[k], scale[k], a[k], b[k]);
      half = full;
    }
  }
  for (std::size_t k = 0; k < K; ++k) {
    cubed[k] += a[k].total();
    fourth[k] += b[k].total();
    for (std::size_t m = i; m < n; ++m) {
      const double* at = p + m;
      biweight(*at + *(at - (h << (k + 1))) - 2.0 * *(at - (h << k)), limit[k], 1.0 / limit[k], cubed[k], fourth[k]);
    }
  }
}

// Processes the levels k + 1 … k + K of which the limit is finite: together, or one by one if only some are left.
template <std::size_t K>
GMWM_INLINE void biweight_group(const double* p, std::size_t n, std::size_t k, const double* limit, double* cubed,
                                double* fourth) {
  if (std::all_of(limit + k, limit + k + K, [](double v) { return std::isfinite(v); }))
    return biweight_of_differences<K>(p, n, std::size_t{1} << k, limit + k, cubed + k, fourth + k);
  for (std::size_t m = k; m < k + K; ++m)
    if (std::isfinite(limit[m])) biweight_of_differences<1>(p, n, std::size_t{1} << m, limit + m, cubed + m, fourth + m);
}

// Processes levels 1 … levels of one tile; p[-2^levels] must be readable. The limits apply to differences before the
// division by 2^j.
GMWM_INLINE void biweight_of_tile(const double* p, std::size_t n, std::size_t levels, const double* limit,
                                  double* cubed, double* fourth) {
  std::size_t k = 0;
  for (; k + biweight_fused <= levels; k += biweight_fused)
    biweight_group<biweight_fused>(p, n, k, limit, cubed, fourth);
  for (; k < levels; ++k) biweight_group<1>(p, n, k, limit, cubed, fourth);
}

}  // namespace gmwm::tile
