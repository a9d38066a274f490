#include "gmwm/pyramid.hpp"

#include <algorithm>
#include <limits>

#include "gmwm/buffer.hpp"
#include "gmwm/clones.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/pack.hpp"

namespace gmwm {

namespace {

// Samples of a partial sum of squares. Partial sums are added to the total, so that the rounding error does not grow
// with N.
constexpr std::size_t tile_size = 4096;
// Number of packs at once: enough independent sums to hide the latency of an addition.
constexpr std::size_t side = 3;

// v[i] <- Σ_m g_m v[i + m stride] for i < n, with both filters reversed, so that each value is read before it is
// overwritten. Returns the sum of the squares of Σ_m h_m v[i + m stride].
GMWM_INLINE double smooth_in_place_inline(double* v, std::size_t n, std::size_t stride, const double* g,
                                          const double* h, std::size_t length) {
  double total = 0.0;
  std::size_t i = 0;
  Pack squares[side] = {};
  for (; i + side * Pack::size <= n; i += side * Pack::size) {
    Pack low[side] = {}, high[side] = {};
    const double* at = v + i;
    for (std::size_t m = 0; m < length; ++m, at += stride) {
      const Pack gm = Pack::of(g[m]), hm = Pack::of(h[m]);
      for (std::size_t r = 0; r < side; ++r) {
        const Pack value = Pack::load(at + r * Pack::size);
        low[r] = low[r] + gm * value;
        high[r] = high[r] + hm * value;
      }
    }
    for (std::size_t r = 0; r < side; ++r) {
      low[r].store(v + i + r * Pack::size);
      squares[r] = squares[r] + high[r] * high[r];
    }
  }
  for (std::size_t r = 0; r < side; ++r) total += squares[r].total();
  for (; i < n; ++i) {
    double low = 0.0, high = 0.0;
    for (std::size_t m = 0; m < length; ++m) {
      low += g[m] * v[i + m * stride];
      high += h[m] * v[i + m * stride];
    }
    v[i] = low;
    total += high * high;
  }
  return total;
}
constexpr Clones<smooth_in_place_inline> smooth_in_place{};

// out[i] (+)= Σ_l f_l x[i + places[l]] for i < n.
GMWM_INLINE void filtered_inline(const double* x, const std::size_t* places, const double* f, std::size_t length,
                                 std::size_t n, bool add, double* out) {
  std::size_t i = 0;
  for (; i + side * Pack::size <= n; i += side * Pack::size) {
    Pack sum[side] = {};
    for (std::size_t r = 0; add && r < side; ++r) sum[r] = Pack::load(out + i + r * Pack::size);
    for (std::size_t l = 0; l < length; ++l) {
      const Pack tap = Pack::of(f[l]);
      for (std::size_t r = 0; r < side; ++r) sum[r] = sum[r] + tap * Pack::load(x + i + places[l] + r * Pack::size);
    }
    for (std::size_t r = 0; r < side; ++r) sum[r].store(out + i + r * Pack::size);
  }
  for (; i < n; ++i) {
    double sum = add ? out[i] : 0.0;
    for (std::size_t l = 0; l < length; ++l) sum += f[l] * x[i + places[l]];
    out[i] = sum;
  }
}
constexpr Clones<filtered_inline> filtered{};

// The signal twice in a row, so that each periodic shift by less than N is a contiguous part.
void twice(std::span<const double> x, double* out) {
  std::copy(x.begin(), x.end(), out);
  std::copy(x.begin(), x.end(), out + x.size());
}

// Taps of the filters, and the position of the value for each tap: shifted by l * stride to the left or the right,
// modulo n.
struct Shifts {
  std::unique_ptr<std::size_t[]> places;

  Shifts(std::size_t length, std::size_t stride, std::size_t n, bool back) : places(new std::size_t[length]) {
    for (std::size_t l = 0; l < length; ++l) {
      const std::size_t shift = (l * (stride % n)) % n;
      places[l] = back ? (n - shift) % n : shift;
    }
  }
};

}  // namespace

void pyramid_variance(std::span<const double> x, std::span<const double> scaling, std::span<const double> wavelet,
                      std::span<double> variance) {
  const Mean centre = mean(x);
  if (!centre.finite) {
    std::fill(variance.begin(), variance.end(), std::numeric_limits<double>::quiet_NaN());
    return;
  }
  const std::size_t length = scaling.size();
  const AlignedArray taps = aligned_array(2 * length);
  std::reverse_copy(scaling.begin(), scaling.end(), taps.get());
  std::reverse_copy(wavelet.begin(), wavelet.end(), taps.get() + length);
  const AlignedArray v = aligned_array(x.size());
  for (std::size_t i = 0; i < x.size(); ++i) v[i] = x[i] - centre.value;
  std::size_t n = x.size();
  for (std::size_t j = 0; j < variance.size(); ++j) {
    const std::size_t stride = std::size_t{1} << j;
    n -= (length - 1) * stride;
    double total = 0.0;
    for (std::size_t i = 0; i < n; i += tile_size)
      total += smooth_in_place(v.get() + i, std::min(tile_size, n - i), stride, taps.get(), taps.get() + length, length);
    variance[j] = total / static_cast<double>(n);
  }
}

void pyramid_step(std::span<const double> smooth, std::span<const double> scaling, std::span<const double> wavelet,
                  std::size_t stride, std::span<double> next_smooth, std::span<double> detail) {
  const std::size_t n = smooth.size();
  const AlignedArray both = aligned_array(2 * n);
  twice(smooth, both.get());
  const Shifts back(scaling.size(), stride, n, true);
  filtered(both.get(), back.places.get(), scaling.data(), scaling.size(), n, false, next_smooth.data());
  filtered(both.get(), back.places.get(), wavelet.data(), wavelet.size(), n, false, detail.data());
}

void pyramid_unstep(std::span<const double> next_smooth, std::span<const double> detail,
                    std::span<const double> scaling, std::span<const double> wavelet, std::size_t stride,
                    std::span<double> smooth) {
  const std::size_t n = next_smooth.size();
  const AlignedArray both = aligned_array(2 * n);
  const Shifts ahead(scaling.size(), stride, n, false);
  twice(next_smooth, both.get());
  filtered(both.get(), ahead.places.get(), scaling.data(), scaling.size(), n, false, smooth.data());
  twice(detail, both.get());
  filtered(both.get(), ahead.places.get(), wavelet.data(), wavelet.size(), n, true, smooth.data());
}

}  // namespace gmwm
