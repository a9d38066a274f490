#include "gmwm/outliers.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "gmwm/buffer.hpp"
#include "gmwm/clones.hpp"
#include "gmwm/dense.hpp"

namespace gmwm {

namespace {

constexpr double quartile = 0.6744897501960817;
// Values that are compared before a branch.
constexpr std::size_t tile = 64;
// Half the width of the interval in which the median of a piece is expected, relative to the median of the piece before
// and to 1 / sqrt(n). It is four standard deviations of the difference of the medians for correlated coefficients.
constexpr double width = 8.0;

double second_difference(const double* p, std::size_t i, double scale) {
  return scale * ((p[i + 2] - p[i + 1]) - (p[i + 1] - p[i]));
}

// Their absolute values.
GMWM_INLINE void second_differences_inline(const double* p, std::size_t n, double scale, double* size) {
  for (std::size_t i = 0; i < n; ++i) size[i] = std::abs(scale * ((p[i + 2] - p[i + 1]) - (p[i + 1] - p[i])));
}
constexpr Clones<second_differences_inline> second_differences{};

GMWM_INLINE std::size_t count_below(const double* x, std::size_t n, double limit) {
  double count = 0.0;
  for (std::size_t i = 0; i < n; ++i) count += x[i] <= limit ? 1.0 : 0.0;
  return static_cast<std::size_t>(count);
}

constexpr Clones<count_below> count_up_to{};

// Copies the values in (low, high] to `between`, which has room for all, and returns their number and that of the values
// up to `low`. Without branches, because half of the values are up to `low`.
GMWM_INLINE void split_inline(const double* x, std::size_t n, double low, double high, double* between,
                              std::size_t* counts) {
  std::size_t inside = 0;
  for (std::size_t i = 0; i < n; ++i) {
    between[inside] = x[i];
    inside += static_cast<std::size_t>((x[i] > low) & (x[i] <= high));
  }
  counts[0] = count_below(x, n, low);
  counts[1] = inside;
}
constexpr Clones<split_inline> split{};

double middle(std::span<double> values, std::size_t below, std::size_t total) {
  // The value of rank total / 2 of all, of which `below` are smaller than these.
  const auto at = values.begin() + static_cast<std::ptrdiff_t>(total / 2 - below);
  std::nth_element(values.begin(), at, values.end());
  return total % 2 != 0 ? *at : (*std::max_element(values.begin(), at) + *at) / 2;
}

// The median of |w| of a piece, selected among the few values in an interval about a guess.
double median_near(std::span<const double> size, double guess, std::vector<double>& scratch) {
  const std::size_t n = size.size();
  const double margin = width / std::sqrt(static_cast<double>(n));
  if (margin < 0.9 && guess > 0.0) {
    std::size_t counts[2];
    scratch.resize(n + 1);
    split(size.data(), n, guess * (1.0 - margin), guess * (1.0 + margin), scratch.data(), counts);
    const auto [below, inside] = counts;
    // Both middle values must be in the interval.
    if (below + 1 <= n / 2 && below + inside > n / 2) return middle(std::span{scratch}.first(inside), below, n);
  }
  scratch.assign(size.begin(), size.end());
  return median(scratch);
}

// Sums, ends and medians that are computed side by side.
constexpr std::size_t lanes = 16;

// Pairs of rows, the smaller value first: Batcher's merge exchange sort (Knuth, The Art of Computer Programming, volume
// 3, algorithm 5.2.2 M). All sets are sorted by the same exchanges, so that a vector has a value of each.
std::vector<std::array<std::size_t, 2>> exchanges_of(std::size_t n) {
  std::vector<std::array<std::size_t, 2>> pairs;
  for (std::size_t p = 1; p < n; p *= 2)
    for (std::size_t k = p; k > 0; k /= 2)
      for (std::size_t j = k % p; j + k < n; j += 2 * k)
        for (std::size_t i = j; i < std::min(j + k, n - k); ++i)
          if (i / (2 * p) == (i + k) / (2 * p)) pairs.push_back({i, i + k});
  return pairs;
}

GMWM_INLINE void exchange_inline(double* rows, const std::array<std::size_t, 2>* pairs, std::size_t count) {
  for (std::size_t c = 0; c < count; ++c) {
    double *low = rows + pairs[c][0] * lanes, *high = rows + pairs[c][1] * lanes, a[lanes], b[lanes];
    for (std::size_t k = 0; k < lanes; ++k) {
      a[k] = low[k] < high[k] ? low[k] : high[k];
      b[k] = low[k] < high[k] ? high[k] : low[k];
    }
    for (std::size_t k = 0; k < lanes; ++k) low[k] = a[k];
    for (std::size_t k = 0; k < lanes; ++k) high[k] = b[k];
  }
}
constexpr Clones<exchange_inline> exchange{};

// Sum, smallest and largest of n values.
GMWM_INLINE void range_inline(const double* x, std::size_t n, double* out) {
  double sum[lanes] = {}, low[lanes], high[lanes];
  for (std::size_t k = 0; k < lanes; ++k) low[k] = high[k] = x[0];
  std::size_t i = 0;
  for (; i + lanes <= n; i += lanes)
    for (std::size_t k = 0; k < lanes; ++k) {
      sum[k] += x[i + k];
      low[k] = x[i + k] < low[k] ? x[i + k] : low[k];
      high[k] = x[i + k] > high[k] ? x[i + k] : high[k];
    }
  for (; i < n; ++i) {
    sum[0] += x[i];
    low[0] = std::min(low[0], x[i]);
    high[0] = std::max(high[0], x[i]);
  }
  out[0] = 0.0;
  for (const double part : sum) out[0] += part;
  out[1] = *std::min_element(low, low + lanes);
  out[2] = *std::max_element(high, high + lanes);
}
constexpr Clones<range_inline> range{};

// Σ (x - mean)².
GMWM_INLINE void about_inline(const double* x, std::size_t n, double mean, double* squares) {
  double sum[lanes] = {};
  std::size_t i = 0;
  for (; i + lanes <= n; i += lanes)
    for (std::size_t k = 0; k < lanes; ++k) sum[k] += (x[i + k] - mean) * (x[i + k] - mean);
  for (; i < n; ++i) sum[0] += (x[i] - mean) * (x[i] - mean);
  *squares = 0.0;
  for (const double part : sum) *squares += part;
}
constexpr Clones<about_inline> squares_about{};

// The number of values from `low` to `high`.
GMWM_INLINE std::size_t inside_inline(const double* x, std::size_t n, double low, double high) {
  std::int64_t count = 0;
  for (std::size_t i = 0; i < n; ++i) count += (x[i] >= low) & (x[i] <= high);
  return static_cast<std::size_t>(count);
}
constexpr Clones<inside_inline> count_inside{};

bool may_be_uneven(const double* x, std::size_t n, double step, double times) {
  double of[3], squares;
  range(x, n, of);
  const double mean = of[0] / static_cast<double>(n), infinity = std::numeric_limits<double>::infinity();
  squares_about(x, n, mean, &squares);
  const double deviation = std::sqrt(squares / static_cast<double>(n));
  // The median of rounded values is up to half a step from that of the noise.
  const double margin = 0.1 * deviation + step / 2;
  // More than half of the values on each side of an interval: both middle ones are in it.
  if (count_inside(x, n, -infinity, mean + margin) <= n / 2 || count_inside(x, n, mean - margin, infinity) <= n / 2)
    return true;
  // The largest distance from the median, with more than the rounding error of all these numbers.
  const double distance = (std::max(of[2] - mean, mean - of[1]) + margin) * (1.0 + 1e-6) / times;
  if (distance <= step / 2) return false;
  if (distance > deviation) return true;
  // At least half of the values must be so far from the median.
  const double far = quartile * (distance - step);
  return far > 0.0 && count_inside(x, n, mean - margin - far, mean + margin + far) >= n / 2;
}

}  // namespace

double median(std::span<double> values) { return middle(values, 0, values.size()); }

std::vector<double> row_medians(std::span<const double> x, std::size_t length) {
  std::vector<double> medians, scratch(length + 1);
  medians.reserve(x.size() / length);
  // Ranks on each side of the median in whose values the next median is expected: four standard deviations in noise.
  const auto reach = static_cast<std::size_t>(3.0 * std::sqrt(static_cast<double>(length)));
  const bool guesses = reach < length / 4;
  double before = 0.0, after = -1.0;  // no interval yet
  for (std::size_t k = 0; k + length <= x.size(); k += length) {
    if (before <= after) {
      std::size_t counts[2];
      // Just below the lower end, so that values at it are inside.
      const double low = std::nextafter(medians.back() - before, -std::numeric_limits<double>::infinity());
      split(x.data() + k, length, low, medians.back() + after, scratch.data(), counts);
      if (counts[0] + 1 <= length / 2 && counts[0] + counts[1] > length / 2) {
        medians.push_back(middle(std::span{scratch}.first(counts[1]), counts[0], length));
        continue;
      }
    }
    std::copy_n(x.begin() + static_cast<std::ptrdiff_t>(k), length, scratch.begin());
    medians.push_back(middle(std::span{scratch}.first(length), 0, length));
    if (!guesses) continue;
    const auto first = scratch.begin(), centre = first + static_cast<std::ptrdiff_t>(length / 2);
    const auto low = centre - static_cast<std::ptrdiff_t>(reach), high = centre + static_cast<std::ptrdiff_t>(reach);
    std::nth_element(first, low, centre);
    std::nth_element(centre, high, first + static_cast<std::ptrdiff_t>(length));
    before = medians.back() - *low;
    after = *high - medians.back();
  }
  return medians;
}

std::vector<std::int64_t> uneven_rows(std::span<const double> x, std::size_t length, double step, double times) {
  std::vector<std::int64_t> rows;
  for (std::size_t k = 0; (k + 1) * length <= x.size(); ++k)
    if (may_be_uneven(x.data() + k * length, length, step, times)) rows.push_back(static_cast<std::int64_t>(k));
  return rows;
}

LargeCoefficients large_coefficients(std::span<const double> path, double scale, std::size_t piece, double least,
                                     double limit) {
  const std::size_t n = path.size() - 2;
  std::vector<double> scratch;
  const AlignedArray sizes = aligned_array(n);
  const std::span<const double> size(sizes.get(), n);
  LargeCoefficients found;
  second_differences(path.data(), n, scale, sizes.get());
  found.energy = dot(sizes.get(), sizes.get(), n);
  const std::size_t whole = n / piece, pieces = whole < 2 ? 1 : whole + (whole * piece < n ? 1 : 0);
  if (whole < 2) piece = n;
  double guess = 0.0;
  for (std::size_t k = 0; k < std::max<std::size_t>(whole, 1) && found.spread.size() < pieces; ++k) {
    guess = median_near(size.subspan(k * piece, piece), guess, scratch);
    found.spread.push_back(guess / quartile);
  }
  if (found.spread.size() < pieces) found.spread.push_back(found.spread.back());
  scratch = found.spread;
  const double usual = std::max(median(scratch), least);
  for (double& one : found.spread) one = std::max(one, usual);
  if (!(usual > 0.0)) return found;
  for (std::size_t k = 0; k < pieces; ++k) {
    const double edge = limit * found.spread[k];
    const std::size_t last = std::min((k + 1) * piece, n);
    for (std::size_t i = k * piece; i < last; i += tile) {
      const std::size_t end = std::min(i + tile, last);
      if (count_up_to(size.data() + i, end - i, edge) == end - i) continue;
      for (std::size_t t = i; t < end; ++t)
        if (size[t] > edge) {
          found.at.push_back(static_cast<std::int64_t>(t));
          found.w.push_back(second_difference(path.data(), t, scale));
        }
    }
  }
  return found;
}

std::vector<double> window_medians(std::span<const double> x, std::size_t width) {
  const auto pairs = exchanges_of(width);
  std::vector<double> rows(width * lanes), out(x.size() - width + 1);
  for (std::size_t first = 0; first < out.size(); first += lanes) {
    const std::size_t count = std::min(lanes, out.size() - first);
    for (std::size_t j = 0; j < width; ++j) std::copy_n(&x[first + j], count, &rows[j * lanes]);
    exchange(rows.data(), pairs.data(), pairs.size());
    const double *high = &rows[width / 2 * lanes], *low = width % 2 != 0 ? high : high - lanes;
    for (std::size_t k = 0; k < count; ++k) out[first + k] = (low[k] + high[k]) / 2;
  }
  return out;
}

void neighbour_residuals(std::span<const double> x, std::span<const double> others, std::span<const std::int64_t> at,
                         std::size_t reach, std::span<double> out) {
  const auto pairs = exchanges_of(2 * reach);
  std::vector<double> rows(2 * reach * lanes);
  for (std::size_t first = 0; first < at.size(); first += lanes) {
    const std::size_t count = std::min(lanes, at.size() - first);
    for (std::size_t k = 0; k < count; ++k) {
      const auto place = static_cast<std::size_t>(at[first + k]);
      const std::size_t begin = std::clamp(place, reach, x.size() - reach - 1) - reach;
      double* to = rows.data() + k;
      for (std::size_t i = begin; i < place; ++i, to += lanes) *to = others[i];
      for (std::size_t i = place + 1; i <= begin + 2 * reach; ++i, to += lanes) *to = others[i];
    }
    exchange(rows.data(), pairs.data(), pairs.size());
    const double *low = rows.data() + (reach - 1) * lanes, *high = low + lanes;
    for (std::size_t k = 0; k < count; ++k)
      out[first + k] = x[static_cast<std::size_t>(at[first + k])] - (low[k] + high[k]) / 2;
  }
}

std::vector<std::int64_t> bent_samples(std::span<const double> x, std::span<const double> limits, std::size_t length) {
  const std::size_t n = x.size(), last = n - 1;
  std::vector<std::int64_t> found;
  std::size_t next = 0;  // the first sample that is not among those found, nor before them
  const auto add = [&](std::size_t i) {
    for (std::size_t k = std::max(next, i - std::min<std::size_t>(i, 1)); k <= std::min(i + 1, last); ++k)
      found.push_back(static_cast<std::int64_t>(k));
    next = std::min(i + 1, last) + 1;
  };
  add(0);
  for (std::size_t block = 0; block < limits.size(); ++block) {
    const std::size_t stop = block + 1 < limits.size() ? std::min((block + 1) * length, last) : last;
    const double limit = limits[block];
    for (std::size_t t = std::max<std::size_t>(block * length, 1); t < stop; ++t)
      if (std::abs(x[t] - 0.5 * (x[t - 1] + x[t + 1])) > limit) add(t);
  }
  if (n > 1) add(last);
  return found;
}

}  // namespace gmwm
