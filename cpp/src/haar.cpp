#include "gmwm/haar.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>

#include "gmwm/buffer.hpp"
#include "gmwm/clones.hpp"
#include "gmwm/haar_tile.hpp"

namespace gmwm {

namespace {

GMWM_CLONES double sum_clone(const double* x, std::size_t n, double origin) { return tile::sum(x, n, origin); }

GMWM_CLONES void running_sum_clone(const double* x, std::size_t n, double mean, double base, double* out) {
  tile::running_sum(x, n, mean, base, out);
}

GMWM_CLONES void levels_clone(const double* p, std::size_t n, std::size_t levels, double* sums) {
  tile::levels_of_tile(p, n, levels, sums);
}

GMWM_CLONES void far_clone(const double* p, std::size_t n, std::size_t h, std::size_t levels, double* sums) {
  tile::levels_of_tile(p, n, levels, sums, h);
}

// Factor from (P_t - …)² to W²: a power of two, so it is exact.
void scale_by_level(std::span<double> sums) {
  for (std::size_t k = 0; k < sums.size(); ++k) sums[k] = std::ldexp(sums[k], -2 * static_cast<int>(k + 1));
}

// Sums of squares over indices first <= i < last of the running sum (i = t + 1 >= 1), not yet scaled.
void add_squares(const double* sum, std::size_t first, std::size_t last, std::span<double> squares) {
  for (std::size_t i = first, next; i < last; i = next) {
    next = std::min(tile::end(i), last);
    levels_clone(sum + i, next - i, tile::active(i, squares.size()), squares.data());
  }
}

// Levels from `near` + 1 on have half-scales that are multiples of a row of 2^near values. A tile of the running sum
// would read each of them from a place of its own, beyond the caches if the recording is long. Here, a few columns of all
// rows are copied next to each other, and serve all these levels.
constexpr std::size_t near = 14;
constexpr std::size_t row = std::size_t{1} << near;
constexpr std::size_t long_record = std::size_t{1} << 22;  // shorter ones are in the caches
constexpr std::size_t strip_size = std::size_t{1} << 16;   // values in the columns: half a second-level cache

// Sums of squares of levels near + 1, … over all indices of the running sum of n + 1 values, not yet scaled.
void add_far_squares(const double* sum, std::size_t n, std::span<double> squares) {
  const std::size_t rows = n / row + 1;
  const std::size_t width = std::clamp(std::bit_floor(strip_size / rows), 2 * Pack::size, row);
  const AlignedArray strip = aligned_array(rows * width);
  for (std::size_t column = 0; column < row; column += width) {
    std::size_t count = 0;
    for (std::size_t r = 0; r < rows; ++r) {
      const std::size_t from = r * row + column;
      if (from > n) break;
      const std::size_t some = std::min(width, n + 1 - from);
      std::copy_n(sum + from, some, strip.get() + count);
      count += some;
    }
    // The first index of a level with half-scale h is 2 h, where the next level of the strip begins.
    for (std::size_t first = 2 * width; first < count; first *= 2) {
      const std::size_t last = std::min(2 * first, count);
      const auto reach = static_cast<std::size_t>(std::bit_width(first / width)) - 1;
      const std::size_t levels = std::min(reach, squares.size());
      for (std::size_t i = first; i < last; i += tile::size)
        far_clone(strip.get() + i, std::min(tile::size, last - i), width, levels, squares.data());
    }
  }
}

// Sum of (p[i] - 2 p[i + h] + p[i + 2h])² over i < n.
GMWM_CLONES double block_squares_clone(const double* p, std::size_t n, std::size_t h) {
  double part[8] = {}, sum = 0.0;
  std::size_t i = 0;
  for (; i + 8 <= n; i += 8)
    for (std::size_t r = 0; r < 8; ++r) {
      const double w = p[i + r] - 2.0 * p[i + r + h] + p[i + r + 2 * h];
      part[r] += w * w;
    }
  for (; i < n; ++i) {
    const double w = p[i] - 2.0 * p[i + h] + p[i + 2 * h];
    sum += w * w;
  }
  for (const double one : part) sum += one;
  return sum;
}

}  // namespace

#if GMWM_HAS_CLONES
// One function for each target of the clones: the loader selects it in the same way as it selects a clone.
namespace {
__attribute__((target("default"))) const char* version() { return "default"; }
__attribute__((target("arch=x86-64-v3"))) const char* version() { return "x86-64-v3"; }
__attribute__((target("arch=x86-64-v4"))) const char* version() { return "x86-64-v4"; }
}  // namespace
const char* running_clone() { return version(); }
#else
const char* running_clone() { return "portable"; }
#endif

Mean mean(std::span<const double> x) {
  const double count = static_cast<double>(x.size());
  // Relative to the first value, so that the mean of a constant is exact and a large offset loses no precision.
  const double sum = sum_clone(x.data(), x.size(), x[0]);
  if (std::isfinite(sum)) return {x[0] + sum / count, true};
  // Either a value is not finite, or the sum of finite values overflows. Only in these cases, check each value.
  if (!std::all_of(x.begin(), x.end(), [](double v) { return std::isfinite(v); }))
    return {std::numeric_limits<double>::quiet_NaN(), false};
  double scaled = 0.0;
  for (const double v : x) scaled += v / count;
  return {scaled, true};
}

void running_sum(std::span<const double> x, double mean, std::span<double> sum) {
  for (std::size_t i = 0; i < x.size(); i += tile::size) {
    const std::size_t n = std::min(tile::size, x.size() - i);
    running_sum_clone(x.data() + i, n, mean, sum[i], sum.data() + i + 1);
  }
}

void haar_sums_of_squares(std::span<const double> sum, std::size_t begin, std::size_t end, std::span<double> sums) {
  std::array<double, max_level> storage{};
  const std::span<double> squares{storage.data(), sums.size()};
  add_squares(sum.data(), begin + 1, end + 1, squares);
  scale_by_level(squares);
  for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += squares[k];
}

void haar_block_squares(std::span<const double> sum, std::size_t block, std::size_t levels, std::span<double> out) {
  for (std::size_t b = 0; b * levels < out.size(); ++b)
    for (std::size_t k = 0; k < levels; ++k)
      out[b * levels + k] = block_squares_clone(sum.data() + b * block, block, std::size_t{1} << k) *
                            std::ldexp(1.0 / static_cast<double>(block), -2 * static_cast<int>(k + 1));
}

void haar_variance(std::span<const double> x, std::span<double> variance) {
  const Mean centre = mean(x);
  if (!centre.finite) {
    std::fill(variance.begin(), variance.end(), std::numeric_limits<double>::quiet_NaN());
    return;
  }
  const AlignedArray sum = aligned_array(x.size() + 1);
  sum[0] = 0.0;
  std::fill(variance.begin(), variance.end(), 0.0);
  const bool far = x.size() >= long_record && variance.size() > near;
  const std::span<double> at_once = far ? variance.first(near) : variance;
  // Tile by tile, so that all levels read the newest part of the running sum from the cache.
  for (std::size_t i = 1, next; i <= x.size(); i = next) {
    next = std::min((i / tile::size + 1) * tile::size, x.size() + 1);
    running_sum_clone(x.data() + i - 1, next - i, centre.value, sum[i - 1], sum.get() + i);
    add_squares(sum.get(), i, next, at_once);
  }
  if (far) add_far_squares(sum.get(), x.size(), variance.subspan(near));
  scale_by_level(variance);
  for (std::size_t k = 0; k < variance.size(); ++k)
    variance[k] /= static_cast<double>(x.size() - (std::size_t{1} << (k + 1)) + 1);
}

}  // namespace gmwm
