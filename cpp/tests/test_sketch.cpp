// The counts of |W| against a map filled one value after another from its definition.
// Built twice: with the kernel library, and with -DGMWM_PORTABLE and the portable code.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <map>
#include <random>
#include <span>
#include <thread>
#include <utility>
#include <vector>

#include "check.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/sketch.hpp"

namespace {

using Values = std::vector<double>;
using Map = std::map<long, std::pair<std::uint64_t, std::uint64_t>>;

Values white(std::size_t n) {
  std::mt19937_64 generator(n);
  Values x(n);
  for (double& v : x) v = static_cast<double>(generator() >> 11) * 0x1p-53 - 0.5;
  return x;
}

// Octave and place in it from frexp, not from the bits; bin -1 counts zeros, -2 what is infinite.
Map definition(std::span<const double> values) {
  Map out;
  for (const double value : values) {
    const double w = std::abs(value);
    if (w < 0x1p-1029) {
      ++out[-1].first;
    } else if (!(w <= std::numeric_limits<double>::max())) {
      ++out[-2].first;
    } else {
      int power = 0;
      // Subnormal numbers share the width of the bins of the smallest octave.
      const double m = w < 0x1p-1022 ? w * 0x1p1022 : std::frexp(w, &power) * 2.0 - 1.0;
      const long octave = w < 0x1p-1022 ? 0 : power + 1022;
      const double place = m * 128.0, below = (place - std::floor(place)) * 0x1p24;
      auto& [count, sum] = out[octave * 128 + static_cast<long>(place)];
      ++count;
      sum += static_cast<std::uint64_t>(below);
    }
  }
  return out;
}

Map as_map(const gmwm::SketchCounts& found) {
  Map out;
  if (found.zeros != 0) out[-1].first = found.zeros;
  if (found.beyond != 0) out[-2].first = found.beyond;
  for (std::size_t k = 0; k < found.counts.size(); ++k)
    if (found.counts[k] != 0)
      out[static_cast<long>(found.first * gmwm::sketch_octave + k)] = {found.counts[k], found.sums[k]};
  return out;
}

void values_fall_where_they_belong() {
  Values x = white(5001);
  CHECK(as_map(gmwm::sketch_values(x)) == definition(x));
  // Every octave there is, and their ends.
  for (int power = -1074; power <= 1023; ++power)
    for (const double m : {1.0, 1.5, 1.9999999, 1.0 + 1.0 / 128}) x.push_back(-std::ldexp(m, power));
  const double infinity = std::numeric_limits<double>::infinity();
  x.insert(x.end(), {0.0, -0.0, infinity, -infinity, std::numeric_limits<double>::quiet_NaN(),
                     std::numeric_limits<double>::max(), std::numeric_limits<double>::denorm_min()});
  CHECK(as_map(gmwm::sketch_values(x)) == definition(x));
  CHECK(as_map(gmwm::sketch_values(std::span(x).first(0))).empty());
  // The scratch that calls share was left blank.
  CHECK(as_map(gmwm::sketch_values({x.data(), 3})) == definition({x.data(), 3}));
}

void only_the_octaves_in_use_come_back() {
  const Values x{0.0, 1.0, 3.0, std::numeric_limits<double>::infinity()};
  const gmwm::SketchCounts found = gmwm::sketch_values(x);
  CHECK(found.first == 1023);
  CHECK(found.counts.size() == 2 * gmwm::sketch_octave);
  const Values nothing(10, 0.0);
  CHECK(gmwm::sketch_values(nothing).counts.empty());
  CHECK(gmwm::sketch_values(nothing).zeros == 10);
}

void more_than_a_word_holds() {
  // Three million values in one bin, each with the largest sum a value can have.
  const Values x(3000000, std::nextafter(1.0 + 1.0 / 128, 0.0));
  const gmwm::SketchCounts found = gmwm::sketch_values(x);
  CHECK(found.counts[0] == x.size());
  CHECK(found.sums[0] == x.size() * ((std::uint64_t{1} << 24) - 1));
}

void haar_coefficients_are_those_of_the_running_sum() {
  const Values x = white(9000);
  Values sum(x.size() + 1);
  sum[0] = 0.0;
  gmwm::running_sum(x, gmwm::mean(x).value, sum);
  for (const std::size_t level : {1u, 2u, 5u, 13u}) {
    const std::size_t h = std::size_t{1} << (level - 1);
    for (const auto& [begin, end] : {std::pair<std::size_t, std::size_t>{0, 9000}, {3, 4}, {4096, 8999}, {5, 5}}) {
      Values w;
      for (std::size_t t = std::max(begin, 2 * h - 1); t < end; ++t)
        w.push_back(std::ldexp(sum[t + 1] + sum[t + 1 - 2 * h] - 2.0 * sum[t + 1 - h], -static_cast<int>(level)));
      CHECK(as_map(gmwm::haar_sketch(sum, level, begin, end)) == definition(w));
    }
  }
}

void each_thread_counts_for_itself() {
  const Values x = white(400000);
  Map one, two;
  std::thread other([&] { one = as_map(gmwm::sketch_values({x.data(), 200000})); });
  two = as_map(gmwm::sketch_values({x.data() + 200000, 200000}));
  other.join();
  CHECK(one == definition({x.data(), 200000}));
  CHECK(two == definition({x.data() + 200000, 200000}));
}

}  // namespace

int main() {
  return check::at_each_level("sketch", [] {
    values_fall_where_they_belong();
    only_the_octaves_in_use_come_back();
    more_than_a_word_holds();
    haar_coefficients_are_those_of_the_running_sum();
    each_thread_counts_for_itself();
  });
}
