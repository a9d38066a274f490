#include "gmwm/haar.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "gmwm/buffer.hpp"
#include "gmwm/clones.hpp"
#include "gmwm/haar_tile.hpp"

namespace gmwm {

namespace {

constexpr Clones<tile::sum> sum_clone{};
constexpr Clones<tile::copied_sum> copy_clone{};
constexpr Clones<tile::running_sum> running_sum_clone{};

GMWM_INLINE void shifted_inline(const double* x, std::size_t n, double reference, double* out) {
  for (std::size_t i = 0; i < n; ++i) out[i] = x[i] - reference;
}
constexpr Clones<shifted_inline> shifted_clone{};

// Levels with half-scales h, 2h, … of a tile, see tile::levels_of_tile. Only a processor with AVX-512 has registers for
// the wider vectors, which take a fifth less time.
constexpr Clones<tile::levels_of_tile<Pack>, tile::levels_of_tile<WidePack>> add_levels{};

// Factor from (P_t - …)² to W²: a power of two, so it is exact.
void scale_by_level(std::span<double> sums) {
  for (std::size_t k = 0; k < sums.size(); ++k) sums[k] = std::ldexp(sums[k], -2 * static_cast<int>(k + 1));
}

// A shorter record is processed as a whole: its running sum is in the second-level cache.
constexpr std::size_t short_record = std::size_t{1} << 18;
// Least number of samples by which the running sum advances before its oldest part is dropped.
constexpr std::size_t advance = std::size_t{1} << 16;
// Columns that are processed together by far_levels. Eight cache lines of a row are read at once.
constexpr std::size_t width = 64;
constexpr std::size_t rows_at_once = 32;

// A value near the mean, from one block in 32. Any such value will do: it only keeps the running sum small. Blocks from
// all over the record follow a drift, so the running sum is a few times larger than with the exact mean at most.
double near_mean(std::span<const double> x) {
  constexpr std::size_t block = 512, every = 32;
  double sum = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < x.size(); i += block * every) {
    const std::size_t n = std::min(block, x.size() - i);
    sum += sum_clone(x.data() + i, n, x[0]);
    count += n;
  }
  return x[0] + sum / static_cast<double>(count);
}

// Number of levels that are computed from a window of the running sum; far_levels computes the other ones.
//
// The window has 2^near values and is to fit into the second-level cache. The rows of far_levels have as many samples,
// and the columns of about a thousand rows are to fit there too.
std::size_t near_levels_of(std::size_t n, std::size_t levels) {
  if (n < short_record) return levels;
  return std::clamp<std::size_t>(static_cast<std::size_t>(std::bit_width(n)) - 11, 14, 17);
}

// The newest part of the running sum of n samples: at least the last `row` values, and all of a short record.
class Window {
 public:
  Window(std::size_t n, std::size_t row)
      : keep_(std::max(row, tile::size)),
        capacity_(n < short_record ? n + 1 : std::min(n + 1, keep_ + std::max(keep_, advance))),
        values_(aligned_array(capacity_)) {
    values_[0] = 0.0;
  }
  // Place of value i, which begins a tile. The older values that are kept are before it.
  double* at(std::size_t i) {
    if (i - from_ == capacity_) {
      std::copy(values_.get() + capacity_ - keep_, values_.get() + capacity_, values_.get());
      from_ = i - keep_;
    }
    return values_.get() + (i - from_);
  }

 private:
  std::size_t keep_, capacity_, from_ = 0;
  AlignedArray values_;
};

// Values of the running sum that outlast the window.
struct Kept {
  double half = 0.0, last = 0.0;  // after the first half of the samples, and after all
  std::vector<double> starts;     // before sample 0, row, 2 row, …
};

// Adds the sums of squares of levels 1 … squares.size(), not yet scaled, and returns what is kept of the running sum.
Kept near_levels(std::span<const double> x, double mean, std::size_t row, std::span<double> squares) {
  const std::size_t n = x.size(), half = n / 2;
  Window window(n, row);
  Kept kept{.starts = std::vector<double>(n / row + 1)};
  // Tile by tile, so that all levels read the newest part of the running sum from the cache. The next samples are
  // requested meanwhile.
  for (std::size_t i = 1, next; i <= n; i = next) {
    next = std::min(tile::end(i), n + 1);
    double* p = window.at(i);
    running_sum_clone(x.data() + i - 1, next - i, mean, p[-1], p);
    if (i % row == 0) kept.starts[i / row] = p[0];
    if (i <= half && half < next) kept.half = p[half - i];
    kept.last = p[next - i - 1];
    add_levels(p, next - i, tile::active(i, squares.size()), squares.data(), 1, {.at = x.data() + next - 1});
  }
  return kept;
}

// Columns `first` … `first` + width - 1 of a matrix of the running sum, which has the samples t in rows: P_t is in row
// t / row and column t % row.
struct Columns {
  std::span<const double> x;
  double mean;
  std::size_t row;
  std::vector<double> carried;  // running sum before the first column of each row

  std::size_t rows() const { return (x.size() - 1) / row + 1; }
  const double* samples(std::size_t r, std::size_t first) const { return x.data() + r * row + first; }
  std::size_t size(std::size_t r, std::size_t first) const {
    return std::min(width, x.size() - std::min(x.size(), r * row + first));
  }
  void fill(std::size_t begin, std::size_t end, std::size_t first, double* out) {
    for (std::size_t r = begin; r < end; ++r) {
      const std::size_t n = size(r, first);
      if (n == 0) break;
      running_sum_clone(samples(r, first), n, mean, carried[r], out + r * width);
      carried[r] = out[r * width + n - 1];
    }
  }
};

// Adds the sums of squares of levels with half-scales row, 2 row, …, not yet scaled.
//
// These lags are rows of a matrix. If a tile of the running sum read each of them, it would read from memory, many times
// over. Here the samples are read once more, a few columns of all rows at a time, which fit into the cache and serve all
// levels. The next columns are read meanwhile, row by row, because rows with a distance of a power of two displace one
// another from the cache.
void far_levels(Columns columns, std::span<double> squares) {
  // The first coefficient of a level uses the value before sample 0, which is in no row.
  for (std::size_t k = 0; k < squares.size(); ++k) {
    const std::size_t h = std::size_t{1} << k;
    const double w = columns.carried[2 * h] - 2.0 * columns.carried[h];
    squares[k] += w * w;
  }
  const std::size_t rows = columns.rows();
  AlignedArray now = aligned_array(rows * width), later = aligned_array(rows * width);
  columns.fill(0, rows, 0, now.get());
  for (std::size_t first = 0; first < columns.row; first += width, std::swap(now, later)) {
    const std::size_t next = first + width;
    const bool more = next < columns.row;
    const unsigned shift = static_cast<unsigned>(std::countr_zero(width));
    for (std::size_t r = 0, end; r < rows; r = end) {
      end = std::min({rows, r + rows_at_once, std::bit_ceil(r + 1)});
      const std::size_t n = (end - r - 1) * width + columns.size(end - 1, first);
      // Row r has coefficients of levels with a scale of at most r rows.
      const std::size_t levels = r < 2 ? 0 : std::min<std::size_t>(std::bit_width(r) - 1, squares.size());
      const tile::Ahead ahead{more ? columns.samples(r, next) : nullptr, shift, columns.row - width};
      add_levels(now.get() + r * width, n, levels, squares.data(), width, ahead);
      if (more) columns.fill(r, end, next, later.get());
    }
  }
}

}  // namespace

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

bool copy_finite(std::span<const double> x, double* out) { return std::isfinite(copy_clone(x.data(), x.size(), out)); }

void running_sum(std::span<const double> x, double mean, std::span<double> sum) {
  for (std::size_t i = 0; i < x.size(); i += tile::size) {
    const std::size_t n = std::min(tile::size, x.size() - i);
    running_sum_clone(x.data() + i, n, mean, sum[i], sum.data() + i + 1);
  }
}

void haar_sums_of_squares(std::span<const double> sum, std::size_t begin, std::size_t end, std::span<double> sums) {
  std::array<double, max_level> squares{};
  for (std::size_t i = begin + 1, next; i <= end; i = next) {
    next = std::min(tile::end(i), end + 1);
    add_levels(sum.data() + i, next - i, tile::active(i, sums.size()), squares.data(), 1, {});
  }
  scale_by_level({squares.data(), sums.size()});
  for (std::size_t k = 0; k < sums.size(); ++k) sums[k] += squares[k];
}

void haar_block_squares(std::span<const double> sum, std::size_t block, std::size_t levels, std::span<double> out) {
  for (std::size_t b = 0; b * levels < out.size(); ++b) {
    const auto squares = out.subspan(b * levels, levels);
    std::fill(squares.begin(), squares.end(), 0.0);
    for (std::size_t k = 0; k < levels; ++k) {
      const std::size_t h = std::size_t{1} << k;
      add_levels(sum.data() + b * block + 2 * h, block, 1, &squares[k], h, {});
      squares[k] /= static_cast<double>(block);
    }
    scale_by_level(squares);
  }
}

void haar_panel(std::span<const double> before, std::span<const double> x, double reference, const Marks& marks,
                std::span<double> squares) {
  const std::size_t m = before.size(), n = m + x.size();
  const double mean_of_x = x.size() < short_record ? mean(x).value : near_mean(x), centre = mean_of_x - reference;
  Window window(n, std::size_t{1} << squares.size());
  const AlignedArray values = aligned_array(tile::size);
  std::fill(squares.begin(), squares.end(), 0.0);
  double start = 0.0;  // running sum before x
  std::size_t k = 0;   // marks that are passed
  for (std::size_t i = 1, next; i <= n; i = next) {
    next = std::min(tile::end(i), n + 1);
    if (i <= m) next = std::min(next, m + 1);
    double* p = window.at(i);
    const std::size_t some = next - i;
    if (i <= m) {
      running_sum_clone(before.data() + i - 1, some, centre, p[-1], p);
      start = p[some - 1];
      continue;
    }
    const double* from = x.data() + (i - 1 - m);
    shifted_clone(from, some, reference, values.get());
    running_sum_clone(values.get(), some, centre, p[-1], p);
    add_levels(p, some, tile::active(i, squares.size()), squares.data(), 1, {.at = from + some});
    for (; k + 1 < marks.sums.size() && m + marks.first + k * marks.step < next; ++k) {
      const std::size_t passed = marks.first + k * marks.step;
      // Before the first sample of x, the sum is 0.
      marks.sums[k] = passed == 0 ? 0.0 : p[m + passed - i] - start + centre * static_cast<double>(passed);
    }
    marks.sums.back() = p[some - 1] - start + centre * static_cast<double>(x.size());
  }
  scale_by_level(squares);
}

double haar_variance(std::span<const double> x, std::span<double> variance) {
  const std::size_t near = near_levels_of(x.size(), variance.size());
  const std::size_t row = std::size_t{1} << near;
  const double centre = x.size() < short_record ? mean(x).value : near_mean(x);
  std::fill(variance.begin(), variance.end(), 0.0);
  Kept kept = near_levels(x, centre, row, variance.first(std::min(near, variance.size())));
  if (!std::isfinite(kept.last)) {
    std::fill(variance.begin(), variance.end(), std::numeric_limits<double>::quiet_NaN());
    return std::numeric_limits<double>::quiet_NaN();
  }
  if (variance.size() > near) far_levels({x, centre, row, std::move(kept.starts)}, variance.subspan(near));
  scale_by_level(variance);
  const double n = static_cast<double>(x.size());
  for (std::size_t k = 0; k < variance.size(); ++k) variance[k] /= n - std::ldexp(1.0, static_cast<int>(k) + 1) + 1.0;
  const double first = static_cast<double>(x.size() / 2), second = n - first;
  // The means of the two halves are N/2 samples apart.
  return ((kept.last - kept.half) / second - kept.half / first) / (n / 2.0);
}

}  // namespace gmwm
