// The biweight kernel against its definition in long double, in every version that this processor can run.
// Built twice: with the kernel library, and with -DGMWM_PORTABLE and the portable code.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <random>
#include <set>
#include <span>
#include <vector>

#include "check.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/robust.hpp"

namespace {

using Values = std::vector<double>;

Values white(std::size_t n) {
  std::mt19937_64 generator(n);
  Values x(n);
  // A uniform variate by hand: distributions of the standard library differ between implementations.
  for (double& v : x) v = static_cast<double>(generator() >> 11) * 0x1p-53 - 0.5;
  return x;
}

Values running_sum(const Values& x) {
  Values sum(x.size() + 1);
  sum[0] = 0.0;
  gmwm::running_sum(x, gmwm::mean(x).value, sum);
  return sum;
}

// |W_{j,t}| for all t, from block means of x.
Values sizes(std::span<const double> x, std::size_t level) {
  const std::size_t h = std::size_t{1} << (level - 1);
  Values out;
  for (std::size_t t = 2 * h - 1; t < x.size(); ++t) {
    long double w = 0.0L;
    for (std::size_t l = 0; l < h; ++l) w += static_cast<long double>(x[t - l]) - x[t - h - l];
    out.push_back(std::abs(static_cast<double>(w / static_cast<long double>(2 * h))));
  }
  return out;
}

gmwm::BiweightSums definition(std::span<const double> values, double limit) {
  long double cubed = 0.0L, fourth = 0.0L;
  for (const double w : values) {
    const long double v = std::min(static_cast<long double>(w) * w / limit, 1.0L), q = 1.0L - v;
    cubed += v * q * q * q;
    fourth += v * q * q * q * q;
  }
  return {static_cast<double>(cubed), static_cast<double>(fourth), static_cast<double>(values.size())};
}

// At the limit itself q is the last digit of 1, and its cube 1e-48 of what a coefficient can add.
void same(const gmwm::BiweightSums& got, const gmwm::BiweightSums& expected, double relative) {
  CHECK(std::abs(got.cubed - expected.cubed) <= relative * expected.cubed + 1e-45 * got.count);
  CHECK(std::abs(got.fourth - expected.fourth) <= relative * expected.fourth + 1e-60 * got.count);
  CHECK(got.count == expected.count);
}

void values_are_their_definition() {
  for (const std::size_t n : {1u, 3u, 7u, 8u, 9u, 1000u})
    for (const double limit : {1e-3, 0.1, 10.0}) {
      const Values x = white(n);
      same(gmwm::biweight_sums(x, limit), definition(x, limit), 1e-13);
    }
}

void levels_are_their_definition() {
  for (const std::size_t n : {8u, 100u, 4095u, 4096u, 4097u, 9000u}) {
    const Values x = white(n), sum = running_sum(x);
    std::size_t top = 0;
    while ((std::size_t{2} << top) <= n) ++top;
    for (std::size_t levels = 1; levels <= top; ++levels) {
      Values limits(levels);
      for (std::size_t k = 0; k < levels; ++k) limits[k] = std::ldexp(0.7, -static_cast<int>(k));
      std::vector<gmwm::BiweightSums> sums(levels);
      gmwm::haar_biweight_sums(sum, limits, 1, sums);
      for (std::size_t k = 0; k < levels; ++k) same(sums[k], definition(sizes(x, k + 1), limits[k]), 1e-10);
    }
  }
}

void levels_are_left_out() {
  const Values x = white(6000), sum = running_sum(x);
  Values limits(12, 0.3);
  std::vector<gmwm::BiweightSums> whole(12), part(12);
  gmwm::haar_biweight_sums(sum, limits, 1, whole);
  for (const std::size_t k : {0u, 4u, 6u, 7u, 8u, 11u}) limits[k] = 0.0;
  gmwm::haar_biweight_sums(sum, limits, 1, part);
  for (std::size_t k = 0; k < 12; ++k) {
    CHECK(part[k].fourth == (limits[k] > 0.0 ? whole[k].fourth : 0.0));
    CHECK(part[k].cubed == (limits[k] > 0.0 ? whole[k].cubed : 0.0));
  }
}

void every_other_tile_is_read() {
  const Values x = white(40'000), sum = running_sum(x);
  const Values limits = {0.5};
  std::vector<gmwm::BiweightSums> sums(1);
  gmwm::haar_biweight_sums(sum, limits, 3, sums);
  const Values w = sizes(x, 1);
  Values chosen;
  for (std::size_t k = 0; k < w.size(); ++k)
    if ((k + 2) / 4096 % 3 == 0) chosen.push_back(w[k]);
  same(sums[0], definition(chosen, 0.5), 1e-10);
}

void what_ends_before_the_beginning_is_left_out() {
  const Values x = white(9000), sum = running_sum(x);
  for (const std::size_t begin : {0u, 1u, 31u, 1000u, 4095u, 4096u, 8999u}) {
    const Values limits(9, 0.3);
    std::vector<gmwm::BiweightSums> sums(9);
    gmwm::haar_biweight_sums(sum, limits, 1, sums, begin);
    for (std::size_t k = 0; k < 9; ++k) {
      Values w = sizes(x, k + 1);
      const std::size_t first = (std::size_t{2} << k) - 1;
      if (begin > first) w.erase(w.begin(), w.begin() + static_cast<std::ptrdiff_t>(begin - first));
      same(sums[k], definition(w, 0.3), 1e-10);
    }
  }
}

void outliers_add_nothing() {
  Values x = white(1000);
  const gmwm::BiweightSums clean = gmwm::biweight_sums(x, 1.0);
  for (const double far : {2.0, 1e100, 1e300}) {
    Values y(x);
    for (std::size_t k = 0; k < 40; ++k) y.push_back(k % 2 == 0 ? far : -far);
    same(gmwm::biweight_sums(y, 1.0), {clean.cubed, clean.fourth, clean.count + 40.0}, 1e-13);
  }
}

void samples_are_coefficients() {
  const Values x = white(5000), sum = running_sum(x);
  for (const std::size_t level : {1u, 5u, 12u}) {
    const Values all = sizes(x, level);
    Values every(all.size()), some(200);
    gmwm::haar_sample(sum, level, every);
    for (std::size_t k = 0; k < all.size(); ++k) CHECK(std::abs(every[k] - all[k]) < 1e-12);
    gmwm::haar_sample(sum, level, some);
    const std::set<double> known(every.begin(), every.end());
    for (const double w : some) CHECK(known.contains(w));
    CHECK(std::set<double>(some.begin(), some.end()).size() == some.size());
  }
  // A signal whose period is that of equal steps through it: half of its coefficients are 1/2, half are 0.
  Values square(4096);
  for (std::size_t t = 0; t < square.size(); ++t) square[t] = t % 16 < 8 ? static_cast<double>(t % 2) : 0.0;
  Values sample(256);
  gmwm::haar_sample(running_sum(square), 1, sample);
  const auto large = std::count_if(sample.begin(), sample.end(), [](double w) { return w > 0.25; });
  CHECK(large > 96 && large < 160);
}

void between_counts_and_keeps() {
  const Values x = white(3000), sum = running_sum(x);
  for (const std::size_t level : {1u, 4u}) {
    Values all(x.size() - (std::size_t{1} << level) + 1), kept;
    gmwm::haar_sample(sum, level, all);
    std::sort(all.begin(), all.end());
    const double low = all[700], high = all[900];
    CHECK(gmwm::haar_between(sum, level, low, high, kept) == 701);
    std::vector<double> none;
    CHECK(gmwm::haar_between(sum, level, low, low, none) == 701 && none.empty());
    std::sort(kept.begin(), kept.end());
    CHECK(kept == Values(all.begin() + 701, all.begin() + 901));
  }
}

}  // namespace

int main() {
  return check::at_each_level("robust", [] {
    values_are_their_definition();
    levels_are_their_definition();
    levels_are_left_out();
    every_other_tile_is_read();
    what_ends_before_the_beginning_is_left_out();
    outliers_add_nothing();
    samples_are_coefficients();
    between_counts_and_keeps();
  });
}
