// Large coefficients, residuals and bends against their definitions with sorted copies.
#include "gmwm/outliers.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <random>
#include <set>
#include <vector>

#include "check.hpp"

namespace {

using Values = std::vector<double>;

Values white(std::size_t n, double tail) {
  std::mt19937_64 generator(n);
  Values x(n);
  // A uniform variate by hand: distributions of the standard library differ between implementations.
  for (double& v : x) {
    const double u = static_cast<double>(generator() >> 11) * 0x1p-53 - 0.5;
    v = u / std::pow(1.0 - 2.0 * std::abs(u) + 1e-9, tail);
  }
  return x;
}

double sorted_median(Values x) {
  std::sort(x.begin(), x.end());
  const std::size_t n = x.size();
  return n % 2 != 0 ? x[n / 2] : (x[n / 2 - 1] + x[n / 2]) / 2;
}

void medians_are_those_of_sorted_values() {
  for (const std::size_t n : {1u, 2u, 3u, 4u, 9u, 100u, 101u}) {
    Values x = white(n, 0.0);
    const double expected = sorted_median(x);
    CHECK(gmwm::median(x) == expected);
  }
}

void row_medians_are_those_of_sorted_rows() {
  for (const std::size_t length : {1u, 2u, 8u, 100u, 301u, 1000u})
    for (const double step : {0.0, 0.3}) {
      Values x = white(20 * length, 0.4);
      // A jump, so that the interval of the rows before has no median.
      for (std::size_t i = 10 * length; i < x.size(); ++i) x[i] += 3.0;
      if (step > 0.0)
        for (double& v : x) v = step * std::round(v / step);
      const Values found = gmwm::row_medians(x, length);
      CHECK(found.size() == 20);
      for (std::size_t k = 0; k < found.size(); ++k)
        CHECK(found[k] == sorted_median({x.begin() + static_cast<std::ptrdiff_t>(k * length),
                                         x.begin() + static_cast<std::ptrdiff_t>((k + 1) * length)}));
    }
}

// The distance of a value from the median of its row over the spread of the row.
double largest_ratio(const Values& row, double step) {
  const double centre = sorted_median(row), n = static_cast<double>(row.size());
  double mean = 0.0, squares = 0.0, largest = 0.0;
  for (const double v : row) mean += v / n;
  Values distance;
  for (const double v : row) {
    squares += (v - mean) * (v - mean) / n;
    distance.push_back(std::abs(v - centre));
    largest = std::max(largest, distance.back());
  }
  const double spread = std::max(std::min(std::sqrt(squares), sorted_median(distance) / 0.67449 + step), step / 2);
  return spread > 0.0 ? largest / spread : 0.0;
}

void rows_with_outliers_are_uneven() {
  constexpr std::size_t length = 500, rows = 200;
  constexpr double times = 8.0;
  for (const double tail : {0.0, 0.3, 0.6})
    for (const double step : {0.0, 0.05, 0.5}) {
      Values x = white(rows * length, tail);
      for (std::size_t i = 0; i < x.size(); i += 40 * length + 7) x[i] = 40.0;
      if (step > 0.0)
        for (double& v : x) v = step * std::round(v / step);
      const std::vector<std::int64_t> found = gmwm::uneven_rows(x, length, step, times);
      const std::set<std::int64_t> uneven(found.begin(), found.end());
      for (std::size_t k = 0; k < rows; ++k) {
        const Values row(x.begin() + static_cast<std::ptrdiff_t>(k * length),
                         x.begin() + static_cast<std::ptrdiff_t>((k + 1) * length));
        if (largest_ratio(row, step) > times) CHECK(uneven.count(static_cast<std::int64_t>(k)) == 1);
      }
      // Short tails have no others.
      if (tail == 0.0) CHECK(found.size() == 5);
    }
}

void medians_of_windows_are_those_of_sorted_values() {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  std::vector<double> x(70);
  for (std::size_t t = 0; t < x.size(); ++t) x[t] = std::cos(static_cast<double>(t * t));
  x[40] = nan;
  for (const std::size_t width : {1u, 2u, 7u, 16u, 70u}) {
    const std::vector<double> found = gmwm::window_medians(x, width);
    CHECK(found.size() == x.size() - width + 1);
    for (std::size_t k = 0; k < found.size(); ++k) {
      if (k <= 40 && k + width > 40) continue;
      std::vector<double> window(x.begin() + static_cast<std::ptrdiff_t>(k), x.begin() + static_cast<std::ptrdiff_t>(k + width));
      std::sort(window.begin(), window.end());
      CHECK(found[k] == (window[(width - 1) / 2] + window[width / 2]) / 2);
    }
  }
}

void large_coefficients_are_their_definition() {
  constexpr double quartile = 0.6744897501960817, scale = 0.25, limit = 3.5;
  for (const std::size_t n : {3u, 70u, 130u, 5000u, 40000u})
    for (const std::size_t piece : {1u, 64u, 200u, 2000u, 3001u, 100000u})
      for (const double least : {0.0, 0.05}) {
        Values path = white(n, 0.6);
        // The spread of the later half is much larger, so that the first guess of a median fails.
        for (std::size_t i = n / 2; i < n; ++i) path[i] *= 50.0;
        const gmwm::LargeCoefficients found = gmwm::large_coefficients(path, scale, piece, least, limit);
        Values w, spread;
        double energy = 0.0;
        for (std::size_t i = 0; i + 2 < n; ++i) {
          w.push_back(scale * ((path[i + 2] - path[i + 1]) - (path[i + 1] - path[i])));
          energy += w.back() * w.back();
        }
        const std::size_t whole = w.size() / piece, length = whole < 2 ? w.size() : piece;
        for (std::size_t k = 0; k < std::max<std::size_t>(whole, 1); ++k) {
          Values part(w.begin() + static_cast<std::ptrdiff_t>(k * length),
                      w.begin() + static_cast<std::ptrdiff_t>((k + 1) * length));
          for (double& one : part) one = std::abs(one);
          spread.push_back(sorted_median(part) / quartile);
        }
        if (whole >= 2 && whole * piece < w.size()) spread.push_back(spread.back());
        const double usual = std::max(sorted_median(spread), least);
        for (double& one : spread) one = std::max(one, usual);
        CHECK(found.spread == spread);
        CHECK_CLOSE(found.energy, energy, 1e-12);
        std::vector<std::int64_t> at;
        for (std::size_t i = 0; i < w.size(); ++i)
          if (usual > 0.0 && std::abs(w[i]) > limit * spread[i / length]) at.push_back(static_cast<std::int64_t>(i));
        CHECK(found.at == at);
        for (std::size_t k = 0; k < found.at.size() && k < at.size(); ++k)
          CHECK(found.w[k] == w[static_cast<std::size_t>(at[k])]);
      }
}

void nothing_is_large_without_a_spread() {
  Values path(1000, 0.0);
  path[500] = 1.0;
  const gmwm::LargeCoefficients found = gmwm::large_coefficients(path, 0.5, 64, 0.0, 3.5);
  CHECK(found.at.empty());
  CHECK(found.energy == 0.25 * 6.0);
}

void residuals_are_their_definition() {
  const Values x = white(60, 0.3), others = white(60, 0.0);
  std::vector<std::int64_t> at(60);
  for (std::size_t k = 0; k < at.size(); ++k) at[k] = static_cast<std::int64_t>(k);
  for (const std::size_t reach : {1u, 3u, 12u}) {
    Values out(at.size());
    gmwm::neighbour_residuals(x, others, at, reach, out);
    for (std::size_t t = 0; t < x.size(); ++t) {
      const std::size_t centre = std::clamp(t, reach, x.size() - reach - 1);
      Values around;
      for (std::size_t i = centre - reach; i <= centre + reach; ++i)
        if (i != t) around.push_back(others[i]);
      CHECK(out[t] == x[t] - sorted_median(around));
    }
  }
}

void bent_samples_are_their_definition() {
  for (const std::size_t n : {2u, 3u, 4u, 1000u})
    for (const std::size_t length : {1u, 100u, 300u, 5000u}) {
      const Values x = white(n, 0.3), limits = {2.0, 0.8, 5.0};
      std::set<std::int64_t> expected{0, 1, static_cast<std::int64_t>(n) - 2, static_cast<std::int64_t>(n) - 1};
      for (std::size_t t = 1; t + 1 < n; ++t)
        if (std::abs(x[t] - 0.5 * (x[t - 1] + x[t + 1])) > limits[std::min(t / length, limits.size() - 1)])
          for (std::size_t i = t - 1; i <= t + 1; ++i) expected.insert(static_cast<std::int64_t>(i));
      const std::vector<std::int64_t> found = gmwm::bent_samples(x, limits, length);
      CHECK(found == std::vector<std::int64_t>(expected.begin(), expected.end()));
    }
}

}  // namespace

int main() {
  return check::at_each_level("outliers", [] {
    medians_are_those_of_sorted_values();
    row_medians_are_those_of_sorted_rows();
    rows_with_outliers_are_uneven();
    medians_of_windows_are_those_of_sorted_values();
    large_coefficients_are_their_definition();
    nothing_is_large_without_a_spread();
    residuals_are_their_definition();
    bent_samples_are_their_definition();
  });
}
