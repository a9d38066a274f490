// The Haar kernel against its definition in long double, in every version that this processor can run.
// Built twice: with the kernel library, and with -DGMWM_PORTABLE and the portable code.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "check.hpp"
#include "gmwm/buffer.hpp"
#include "gmwm/clones.hpp"
#include "gmwm/haar.hpp"

namespace {

using Values = std::vector<double>;

enum class Kind { white, walk, drift };

Values signal(Kind kind, std::size_t n, double offset = 0.0) {
  std::mt19937_64 generator(n);
  Values x(n);
  double level = 0.0;
  for (std::size_t t = 0; t < n; ++t) {
    // A uniform variate by hand: distributions of the standard library differ between implementations.
    const double u = static_cast<double>(generator() >> 11) * 0x1p-53 - 0.5;
    level += u;
    x[t] = offset + (kind == Kind::white ? u : kind == Kind::walk ? level : 0.3 * static_cast<double>(t) + u);
  }
  return x;
}

std::size_t top_level(std::size_t n) { return static_cast<std::size_t>(std::bit_width(n)) - 1; }

// Sum of W_{j,t}² over begin <= t < end by the definition: means of two adjacent blocks of x.
double sum_of_squares(std::span<const double> x, std::size_t level, std::size_t begin, std::size_t end) {
  const std::size_t h = std::size_t{1} << (level - 1);
  long double total = 0.0L;
  for (std::size_t t = std::max(begin, 2 * h - 1); t < end; ++t) {
    long double w = 0.0L;
    for (std::size_t l = 0; l < h; ++l) w += static_cast<long double>(x[t - l]) - x[t - h - l];
    w /= static_cast<long double>(2 * h);
    total += w * w;
  }
  return static_cast<double>(total);
}

void variance_is_its_definition() {
  for (const Kind kind : {Kind::white, Kind::walk, Kind::drift})
    for (const std::size_t n : {2u, 3u, 4u, 7u, 8u, 100u, 1023u, 1024u, 1025u, 4095u, 4096u, 4097u, 5000u}) {
      const Values x = signal(kind, n);
      Values variance(top_level(n));
      gmwm::haar_variance(x, variance);
      for (std::size_t j = 1; j <= variance.size(); ++j) {
        const double count = static_cast<double>(n - (std::size_t{1} << j) + 1);
        // A drift's running sum grows with n², and the last digit of it is what level 1 is made of.
        CHECK_CLOSE(variance[j - 1], sum_of_squares(x, j, 0, n) / count, kind == Kind::drift ? 2e-11 : 1e-12);
      }
    }
}

void ranges_add_up() {
  const std::size_t n = 10'007;
  const Values x = signal(Kind::white, n);
  const std::size_t levels = top_level(n);
  Values sum(n + 1), whole(levels), parts(levels);
  sum[0] = 0.0;
  gmwm::running_sum(x, gmwm::mean(x).value, sum);
  gmwm::haar_sums_of_squares(sum, 0, n, whole);
  const std::size_t cuts[] = {0, 0, 1, 2, 3, 1000, 4095, 4096, 4097, 9999, n};
  for (std::size_t c = 0; c + 1 < std::size(cuts); ++c) {
    Values part(levels);
    gmwm::haar_sums_of_squares(sum, cuts[c], cuts[c + 1], part);
    gmwm::haar_sums_of_squares(sum, cuts[c], cuts[c + 1], parts);
    CHECK(part[levels - 1] == 0.0 || cuts[c + 1] >= (std::size_t{1} << levels));
    CHECK_CLOSE(part[2], sum_of_squares(x, 3, cuts[c], cuts[c + 1]), 1e-12);
  }
  for (std::size_t k = 0; k < levels; ++k) CHECK_CLOSE(parts[k], whole[k], 1e-13);
}

void running_sum_continues() {
  const Values x = signal(Kind::white, 9000, 9810.0);
  const gmwm::Mean centre = gmwm::mean(x);
  Values whole(x.size() + 1), halves(x.size() + 1);
  whole[0] = halves[0] = 0.0;
  gmwm::running_sum(x, centre.value, whole);
  const std::span<const double> values(x);
  const std::span<double> target(halves);
  gmwm::running_sum(values.first(4321), centre.value, target.first(4322));
  gmwm::running_sum(values.subspan(4321), centre.value, target.subspan(4321));
  long double expected = 0.0L;
  for (std::size_t t = 0; t < x.size(); ++t) {
    expected += static_cast<long double>(x[t]) - centre.value;
    CHECK(std::abs(whole[t + 1] - static_cast<double>(expected)) < 1e-11);
    CHECK(std::abs(halves[t + 1] - static_cast<double>(expected)) < 1e-11);
  }
}

void scaling_by_a_power_of_two_is_exact() {
  const Values x = signal(Kind::walk, 5000);
  const std::size_t levels = top_level(x.size());
  Values plain(levels), scaled(levels);
  gmwm::haar_variance(x, plain);
  for (const int power : {-40, 40}) {
    Values y(x);
    for (double& v : y) v = std::ldexp(v, power);
    gmwm::haar_variance(y, scaled);
    for (std::size_t k = 0; k < levels; ++k) CHECK(scaled[k] == std::ldexp(plain[k], 2 * power));
  }
}

void a_constant_is_zero() {
  const Values x(5000, 0.1);
  Values variance(top_level(x.size()), -1.0);
  gmwm::haar_variance(x, variance);
  for (const double v : variance) CHECK(v == 0.0);
}

void mean_knows_what_is_finite() {
  Values x = signal(Kind::white, 1000, 9810.0);
  CHECK(gmwm::mean(x).finite);
  CHECK_CLOSE(gmwm::mean(x).value, 9810.0, 1e-5);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    for (const std::size_t at : {std::size_t{0}, std::size_t{501}, x.size() - 1}) {
      Values y(x);
      y[at] = bad;
      CHECK(!gmwm::mean(y).finite);
      Values variance(9);
      gmwm::haar_variance(y, variance);
      for (const double v : variance) CHECK(std::isnan(v));
    }
  }
  const Values huge(100, 1.5e308);
  CHECK(gmwm::mean(huge).finite);
  CHECK(gmwm::mean(huge).value == 1.5e308);
  const Values wide = {1.5e308, -1.5e308, 1.5e308, -1.5e308};
  CHECK(gmwm::mean(wide).finite);
  CHECK(gmwm::mean(wide).value == 0.0);
}

void buffers_are_aligned() {
  for (const std::size_t n : {std::size_t{1}, std::size_t{1000}, gmwm::huge_page}) {
    const gmwm::AlignedArray values = gmwm::aligned_array(n);
    const auto address = reinterpret_cast<std::uintptr_t>(values.get());
    CHECK(address % gmwm::cache_line == 0);
    CHECK(n < gmwm::huge_page || address % gmwm::huge_page == 0);
    values[0] = values[n - 1] = 1.0;
  }
}

#if GMWM_HAS_CLONES && defined(__GLIBC__)
void level_is_that_of_the_compiler() {
  const bool v3 = __builtin_cpu_supports("x86-64-v3"), v4 = __builtin_cpu_supports("x86-64-v4");
  CHECK(gmwm::level == (v4 ? gmwm::Level::v4 : v3 ? gmwm::Level::v3 : gmwm::Level::portable));
}
#else
void level_is_that_of_the_compiler() { CHECK(GMWM_HAS_CLONES || gmwm::level == gmwm::Level::portable); }
#endif

void versions_agree() {
  const gmwm::Level highest = gmwm::level;
  const Values p = signal(Kind::walk, 9001);
  const std::size_t levels = 12, first = std::size_t{1} << levels;
  Values expected(levels), got(levels);
  gmwm::haar_sums_of_squares(p, first, p.size() - 1, got);
  gmwm::level = gmwm::Level::portable;
  gmwm::haar_sums_of_squares(p, first, p.size() - 1, expected);
  gmwm::level = highest;
  for (std::size_t k = 0; k < levels; ++k) CHECK_CLOSE(got[k], expected[k], 1e-13);
}

// Far levels of a long record have code of their own. The record ends within a row of 2^14 samples, at its end, at its
// beginning, within the columns that are processed together, and between two of them.
void far_levels_are_sums_over_the_whole_running_sum() {
  constexpr std::size_t row = std::size_t{1} << 14, shortest = std::size_t{1} << 18;
  for (const std::size_t n : {shortest, shortest + 1, shortest + 63, shortest + 64, 2 * shortest - 1, 5 * row * 7 + 12345,
                              63 * row, 64 * row - 1, 64 * row, 100 * row + 128, 300 * row + 16383}) {
    const Values x = signal(n % 2 == 0 ? Kind::white : Kind::walk, n, 9810.0);
    const std::size_t levels = top_level(n);
    Values variance(levels), sums(levels), total(n + 1), fewer(levels - 1);
    const double rise = gmwm::haar_variance(x, variance);
    gmwm::haar_variance(x, fewer);
    gmwm::running_sum(x, gmwm::mean(x).value, total);
    gmwm::haar_sums_of_squares(total, 0, n, sums);
    // The rounding error of level 1 of a random walk is 6e-11 at 10^6 samples, see haar.hpp.
    const double tolerance = n % 2 == 0 ? 1e-12 : 2e-10;
    for (std::size_t k = 0; k < levels; ++k)
      CHECK_CLOSE(variance[k], sums[k] / static_cast<double>(n - (std::size_t{1} << (k + 1)) + 1), tolerance);
    for (std::size_t k = 0; k + 1 < levels; ++k) CHECK_CLOSE(fewer[k], variance[k], 1e-13);
    const double half = static_cast<double>(n / 2), rest = static_cast<double>(n) - half;
    const double expected = ((total[n] - total[n / 2]) / rest - total[n / 2] / half) / (static_cast<double>(n) / 2.0);
    CHECK(std::abs(rise - expected) < 1e-12 * (std::abs(expected) + 1e-3));
  }
}

// Panels of any length give the sums of the whole recording; the shortest has one sample, the longest a window that moves.
void panels_add_up() {
  const double reference = 9810.0;
  const std::size_t n = 700'000, levels = 10, reach = (std::size_t{1} << levels) - 1, step = 512;
  const Values x = signal(Kind::white, n, reference);
  Values total(n + 1), whole(levels), parts(levels), shifted(x);
  for (double& v : shifted) v -= reference;
  gmwm::running_sum(x, gmwm::mean(x).value, total);
  gmwm::haar_sums_of_squares(total, 0, n, whole);
  const std::size_t cuts[] = {0, 1, 2, 1000, 1023, 1024, 5000, 9096, 400'000, n};
  for (std::size_t c = 0; c + 1 < std::size(cuts); ++c) {
    const std::size_t begin = cuts[c], end = cuts[c + 1], kept = std::min(begin, reach), first = (step - begin % step) % step;
    const std::size_t marks = first > end - begin ? 0 : (end - begin - first) / step + 1;
    Values squares(std::min(levels, top_level(kept + end - begin))), sums(marks + 1, -1.0);
    gmwm::haar_panel(std::span(shifted).subspan(begin - kept, kept), std::span(x).subspan(begin, end - begin), reference,
                     {first, step, sums}, squares);
    for (std::size_t k = 0; k < squares.size(); ++k) parts[k] += squares[k];
    for (std::size_t k = 0; k <= marks; ++k) {
      const std::size_t count = k == marks ? end - begin : first + k * step;
      long double expected = 0.0L;
      for (std::size_t t = begin; t < begin + count; ++t) expected += shifted[t];
      CHECK(std::abs(sums[k] - static_cast<double>(expected)) < 1e-9);
    }
  }
  for (std::size_t k = 0; k < levels; ++k) CHECK_CLOSE(parts[k], whole[k], 1e-12);
}

// The running sum of a long record is relative to a value near the mean, from some of the samples.
void a_long_record_keeps_its_digits() {
  const std::size_t n = 300'000;
  for (const Kind kind : {Kind::white, Kind::walk, Kind::drift}) {
    const Values x = signal(kind, n, 9810.0);
    Values variance(top_level(n));
    gmwm::haar_variance(x, variance);
    for (const std::size_t j : {1u, 2u, 5u, 9u}) {
      const double count = static_cast<double>(n - (std::size_t{1} << j) + 1);
      CHECK_CLOSE(variance[j - 1], sum_of_squares(x, j, 0, n) / count, kind == Kind::drift ? 1e-6 : 1e-10);
    }
    const Values constant(n, 9810.1);
    gmwm::haar_variance(constant, variance);
    for (const double v : variance) CHECK(v == 0.0);
  }
}

void the_rise_is_that_of_a_line() {
  for (const std::size_t n : {std::size_t{9}, std::size_t{5000}, std::size_t{400'001}}) {
    Values x(n), variance(top_level(n));
    for (std::size_t t = 0; t < n; ++t) x[t] = 9810.0 + 0.25 * static_cast<double>(t);
    CHECK_CLOSE(gmwm::haar_variance(x, variance), 0.25, 1e-12);
    x[n / 3] = std::numeric_limits<double>::infinity();
    CHECK(std::isnan(gmwm::haar_variance(x, variance)));
    for (const double v : variance) CHECK(std::isnan(v));
  }
}

}  // namespace

void blocks_are_their_definition() {
  for (const Kind kind : {Kind::white, Kind::walk})
    for (const std::size_t block : {1u, 7u, 8u, 128u}) {
      const std::size_t n = 1000, levels = 6, blocks = (n - (std::size_t{1} << levels)) / block;
      const Values x = signal(kind, n);
      Values sum(n + 1, 0.0), out(blocks * levels);
      gmwm::running_sum(x, gmwm::mean(x).value, sum);
      gmwm::haar_block_squares(sum, block, levels, out);
      for (std::size_t b = 0; b < blocks; ++b)
        for (std::size_t level = 1; level <= levels; ++level) {
          // A coefficient that begins at sample i ends at sample i + 2^level - 1.
          const std::size_t end = b * block + (std::size_t{1} << level) - 1;
          const double expected = sum_of_squares(x, level, end, end + block) / static_cast<double>(block);
          CHECK(std::abs(out[b * levels + level - 1] - expected) <= 1e-9 * expected + 1e-15);
        }
    }
}

int main() {
  level_is_that_of_the_compiler();
  return check::at_each_level("haar", [] {
    variance_is_its_definition();
    blocks_are_their_definition();
    ranges_add_up();
    running_sum_continues();
    scaling_by_a_power_of_two_is_exact();
    a_constant_is_zero();
    mean_knows_what_is_finite();
    buffers_are_aligned();
    versions_agree();
    far_levels_are_sums_over_the_whole_running_sum();
    panels_add_up();
    a_long_record_keeps_its_digits();
    the_rise_is_that_of_a_line();
  });
}
