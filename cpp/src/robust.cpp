#include "gmwm/robust.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>

#include "gmwm/clones.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/haar_tile.hpp"
#include "gmwm/robust_tile.hpp"

namespace gmwm {

namespace {

GMWM_INLINE void values_inline(const double* x, std::size_t n, double limit, double* cubed, double* fourth) {
  tile::biweight_of_values(x, n, limit, *cubed, *fourth);
}
constexpr Clones<values_inline> values_clone{};

constexpr Clones<tile::biweight_of_tile> tile_clone{};

// |P_t - 2 P_{t-h} + P_{t-2h}| at the k-th position of a level: |W| before the division by 2^j.
inline double difference(std::span<const double> sum, std::size_t h, std::size_t k) {
  return std::abs(sum[k] + sum[k + 2 * h] - 2.0 * sum[k + h]);
}

// |W| of one block, and the numbers of values <= low and <= high; without branches, so that it vectorises.
GMWM_INLINE void sizes_inline(const double* p, std::size_t h, double unit, std::size_t n, double low, double high,
                              double* size, double* counts) {
  double at_low = 0.0, at_high = 0.0;
  for (std::size_t i = 0; i < n; ++i) size[i] = unit * std::abs(p[i] + p[i + 2 * h] - 2.0 * p[i + h]);
  for (std::size_t i = 0; i < n; ++i) {
    at_low += size[i] <= low ? 1.0 : 0.0;
    at_high += size[i] <= high ? 1.0 : 0.0;
  }
  counts[0] = at_low;
  counts[1] = at_high;
}
constexpr Clones<sizes_inline> sizes_clone{};

// The number of n |W| <= limit.
GMWM_INLINE std::size_t small_inline(const double* p, std::size_t h, double unit, std::size_t n, double limit) {
  std::int64_t count = 0;
  for (std::size_t i = 0; i < n; ++i) count += unit * std::abs(p[i] + p[i + 2 * h] - 2.0 * p[i + h]) <= limit;
  return static_cast<std::size_t>(count);
}
constexpr Clones<small_inline> small_clone{};

}  // namespace

BiweightSums biweight_sums(std::span<const double> values, double limit) {
  double cubed = 0.0, fourth = 0.0;
  values_clone(values.data(), values.size(), limit, &cubed, &fourth);
  return {cubed / limit, fourth / limit, static_cast<double>(values.size())};
}

void haar_biweight_sums(std::span<const double> sum, std::span<const double> limits, std::size_t every,
                        std::span<BiweightSums> sums, std::size_t begin) {
  const std::size_t levels = limits.size();
  std::array<double, max_level> scaled{}, cubed{}, fourth{}, count{};
  // Skipped levels have an infinite limit, with which no sum becomes NaN.
  for (std::size_t k = 0; k < levels; ++k)
    scaled[k] = limits[k] > 0.0 ? std::ldexp(limits[k], 2 * static_cast<int>(k + 1))
                                : std::numeric_limits<double>::infinity();
  for (std::size_t i = begin + 1, next; i < sum.size(); i = next) {
    next = std::min(tile::end(i), sum.size());
    if (i / tile::size % every != 0) continue;
    const std::size_t active = tile::active(i, levels);
    tile_clone(sum.data() + i, next - i, active, scaled.data(), cubed.data(), fourth.data());
    for (std::size_t k = 0; k < active; ++k) count[k] += static_cast<double>(next - i);
  }
  for (std::size_t k = 0; k < levels; ++k)
    sums[k] = limits[k] > 0.0 ? BiweightSums{cubed[k] / scaled[k], fourth[k] / scaled[k], count[k]} : BiweightSums{};
}

void haar_sample(std::span<const double> sum, std::size_t level, std::span<double> out) {
  const std::size_t h = std::size_t{1} << (level - 1), count = sum.size() - 2 * h;
  const double unit = std::ldexp(1.0, -static_cast<int>(level));
  if (out.size() == count) {
    for (std::size_t k = 0; k < count; ++k) out[k] = unit * difference(sum, h, k);
    return;
  }
  // One position in each of n equal cells. The position within the cell follows a golden-section sequence, which is not
  // periodic.
  const double cell = static_cast<double>(count) / static_cast<double>(out.size());
  double within = 0.5;
  for (std::size_t i = 0; i < out.size(); ++i) {
    within += 0.6180339887498949;
    within -= std::floor(within);
    const auto k = static_cast<std::size_t>((static_cast<double>(i) + within) * cell);
    out[i] = unit * difference(sum, h, std::min(k, count - 1));
  }
}

std::size_t haar_between(std::span<const double> sum, std::size_t level, double low, double high,
                         std::vector<double>& between) {
  const std::size_t h = std::size_t{1} << (level - 1), count = sum.size() - 2 * h;
  const double unit = std::ldexp(1.0, -static_cast<int>(level));
  if (!(low < high)) return small_clone(sum.data(), h, unit, count, low);
  std::array<double, 64> size;
  std::size_t below = 0;
  for (std::size_t k = 0; k < count; k += size.size()) {
    const std::size_t n = std::min(size.size(), count - k);
    double counts[2];
    sizes_clone(sum.data() + k, h, unit, n, low, high, size.data(), counts);
    below += static_cast<std::size_t>(counts[0]);
    if (counts[0] == counts[1]) continue;
    std::copy_if(size.begin(), size.begin() + static_cast<std::ptrdiff_t>(n), std::back_inserter(between),
                 [=](double s) { return s > low && s <= high; });
  }
  return below;
}

}  // namespace gmwm
