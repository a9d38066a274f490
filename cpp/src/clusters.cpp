#include "gmwm/clusters.hpp"

#include <algorithm>

#include "gmwm/clones.hpp"
#include "gmwm/haar_tile.hpp"
#include "gmwm/pack.hpp"

namespace gmwm {

namespace {

// A moving sum restarts after this many times n values, but not before `shortest` values.
constexpr std::size_t renewal = 4;
constexpr std::size_t shortest = 64;

// The second difference that starts at i, for one position or for four at once.
struct Second {
  const double* p;
  std::size_t n;
  GMWM_INLINE Pack wide(std::size_t i) const {
    return Pack::load(p + i) + Pack::load(p + i + 2 * n) - Pack::of(2.0) * Pack::load(p + i + n);
  }
  GMWM_INLINE double one(std::size_t i) const { return p[i] + p[i + 2 * n] - 2.0 * p[i + n]; }
};

// The third difference that starts at i.
struct Third {
  const double* p;
  std::size_t n;
  GMWM_INLINE Pack wide(std::size_t i) const {
    return Pack::load(p + i + 3 * n) - Pack::load(p + i) +
           Pack::of(3.0) * (Pack::load(p + i + n) - Pack::load(p + i + 2 * n));
  }
  GMWM_INLINE double one(std::size_t i) const { return p[i + 3 * n] - p[i] + 3.0 * (p[i + n] - p[i + 2 * n]); }
};

template <class Difference>
GMWM_INLINE double squares(const Difference& at, std::size_t count) {
  Pack acc[4] = {};
  std::size_t i = 0;
  for (; i + 4 * Pack::size <= count; i += 4 * Pack::size)
    for (std::size_t r = 0; r < 4; ++r) {
      const Pack w = at.wide(i + r * Pack::size);
      acc[r] = acc[r] + w * w;
    }
  double rest = 0.0;
  for (; i < count; ++i) {
    const double w = at.one(i);
    rest += w * w;
  }
  return ((acc[0] + acc[1]) + (acc[2] + acc[3])).total() + rest;
}

GMWM_INLINE double second_inline(const double* p, std::size_t count, std::size_t n) {
  return squares(Second{p, n}, count);
}
constexpr Clones<second_inline> second_clone{};

GMWM_INLINE double third_inline(const double* p, std::size_t count, std::size_t n) {
  return squares(Third{p, n}, count);
}
constexpr Clones<third_inline> third_clone{};

template <class Difference>
double strided_squares(const Difference& at, std::size_t count, std::size_t stride) {
  double total = 0.0;
  for (std::size_t i = 0; i < count; i += stride) {
    const double w = at.one(i);
    total += w * w;
  }
  return total;
}

// Sum of the squares of the moving sums D_j, 0 <= j < count, of one section; D_0 is summed directly.
GMWM_INLINE double moving_inline(const double* p, std::size_t count, std::size_t n) {
  const Second second{p, n};
  const Third third{p, n};
  Pack start = {};
  double sum = 0.0;
  std::size_t i = 0;
  for (; i + Pack::size <= n; i += Pack::size) start = start + second.wide(i);
  for (; i < n; ++i) sum += second.one(i);
  sum += start.total();

  double total = sum * sum;
  // D_{j+1} = D_j + third difference at j; four steps at a time.
  Pack from = Pack::of(sum), acc = {};
  std::size_t j = 0;
  for (; j + Pack::size < count; j += Pack::size) {
    const Pack moved = from + third.wide(j).running_sum();
    acc = acc + moved * moved;
    from = moved.last();
  }
  sum = from.first();
  for (; j + 1 < count; ++j) {
    sum += third.one(j);
    total += sum * sum;
  }
  return total + acc.total();
}
constexpr Clones<moving_inline> moving_clone{};

constexpr Clones<tile::running_sum> phase_clone{};

GMWM_INLINE void octaves_inline(const double* p, std::size_t n, std::size_t octaves, double* sums) {
  tile::levels_of_tile(p, n, octaves, sums);
}
constexpr Clones<octaves_inline> octaves_clone{};

// Sum over first <= i < last; left and right return the values at n before and n after i.
template <class Left, class Right>
double turned(std::span<const double> p, std::size_t first, std::size_t last, Left left, Right right) {
  double total = 0.0;
  for (std::size_t i = first; i < last; ++i) {
    const double w = left(i) + right(i) - 2.0 * p[i];
    total += w * w;
  }
  return total;
}

}  // namespace

double second_differences(std::span<const double> p, std::size_t n, std::size_t stride) {
  if (p.size() <= 2 * n) return 0.0;
  const std::size_t count = p.size() - 2 * n;
  return stride == 1 ? second_clone(p.data(), count, n) : strided_squares(Second{p.data(), n}, count, stride);
}

void octave_second_differences(std::span<const double> x, double mean, std::span<double> p, std::span<double> sums) {
  p[0] = 0.0;
  std::fill(sums.begin(), sums.end(), 0.0);
  for (std::size_t i = 1, next; i <= x.size(); i = next) {
    next = std::min(tile::end(i), x.size() + 1);
    phase_clone(x.data() + i - 1, next - i, mean, p[i - 1], p.data() + i);
    octaves_clone(p.data() + i, next - i, tile::active(i, sums.size()), sums.data());
  }
}

double third_differences(std::span<const double> p, std::size_t n, std::size_t stride) {
  if (p.size() <= 3 * n) return 0.0;
  const std::size_t count = p.size() - 3 * n;
  return stride == 1 ? third_clone(p.data(), count, n) : strided_squares(Third{p.data(), n}, count, stride);
}

double moving_second_differences(std::span<const double> p, std::size_t n) {
  if (p.size() < 3 * n) return 0.0;
  const std::size_t count = p.size() - 3 * n + 1;
  if (n == 1) return second_differences(p, 1, 1);
  const std::size_t stretch = std::max(renewal * n, shortest);
  double total = 0.0;
  for (std::size_t j = 0; j < count; j += stretch)
    total += moving_clone(p.data() + j, std::min(stretch, count - j), n);
  return total;
}

double reflected_second_differences(std::span<const double> p, std::size_t n) {
  if (p.size() < 3) return 0.0;
  const std::size_t last = p.size() - 1;
  const double twice_first = 2.0 * p[0], twice_last = 2.0 * p[last];
  const auto inside_left = [=](std::size_t i) { return p[i - n]; };
  const auto inside_right = [=](std::size_t i) { return p[i + n]; };
  const auto beyond_left = [=](std::size_t i) { return twice_first - p[n - i]; };
  const auto beyond_right = [=](std::size_t i) { return twice_last - p[2 * last - n - i]; };
  // For i < low, the position n before i is before the first value. For i > high, the position n after i is after the
  // last.
  const std::size_t low = std::min(std::max<std::size_t>(n, 1), last), high = last > n ? last - n : 0;
  if (low <= high) {
    // For low <= i <= high, both outer positions are inside. At i = high, the right one is the last value.
    return turned(p, 1, low, beyond_left, inside_right) + second_clone(p.data() + low - n, high - low + 1, n) +
           turned(p, high + 1, last, inside_left, beyond_right);
  }
  return turned(p, 1, high + 1, beyond_left, inside_right) + turned(p, high + 1, low, beyond_left, beyond_right) +
         turned(p, low, last, inside_left, beyond_right);
}

}  // namespace gmwm
