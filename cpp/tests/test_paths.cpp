// Recursions in place: each row against the recursion as it is written down, for any number of rows.
#include "gmwm/paths.hpp"

#include <cstddef>
#include <vector>

#include "check.hpp"

namespace {

// Numbers of both signs that no two rows share.
std::vector<double> some(std::size_t size) {
  std::vector<double> values(size);
  unsigned state = 1;
  for (double& v : values) {
    state = state * 1664525u + 1013904223u;
    v = static_cast<double>(state >> 8) / 8388608.0 - 1.0;
  }
  return values;
}

void rows(std::size_t count, std::size_t n) {
  const double phi = -0.9, first = 2.5, rest = 0.3, scale = 7.0;
  const std::vector<double> x = some(count * n);
  std::vector<double> filtered = x, summed = x;
  gmwm::autoregress(filtered, n, phi, first, rest);
  gmwm::accumulate(summed, n, scale);
  for (std::size_t k = 0; k < count; ++k) {
    double y = 0.0, sum = 0.0;
    for (std::size_t t = 0; t < n; ++t) {
      const double e = x[k * n + t];
      y = t == 0 ? first * e : phi * y + rest * e;
      sum += e;
      CHECK(std::abs(filtered[k * n + t] - y) <= 1e-14);
      CHECK(std::abs(summed[k * n + t] - scale * sum) <= 1e-13 * static_cast<double>(n));
    }
  }
}

// As it is written down: a beginning, a recursion, and a moving average of what came of it.
void mixed(std::size_t count, std::size_t n, std::size_t p) {
  const std::vector<double> all{0.5, -0.3, 0.2, -0.1, 0.3}, theta{0.7, -0.4};
  const std::vector<double> phi(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(p)), deviations(p, 2.5);
  std::vector<double> predictors(p * p);
  for (std::size_t i = 0; i < p * p; ++i) predictors[i] = 0.3 / static_cast<double>(i + 1);
  const std::vector<double> x = some(count * n);
  std::vector<double> out = x;
  gmwm::mix(out, n, phi, theta, predictors, deviations, 0.9);
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<double> z(n);
    for (std::size_t t = 0; t < n; ++t) {
      z[t] = (t < p ? deviations[t] : 0.9) * x[k * n + t];
      for (std::size_t i = 1; i <= p && i <= t; ++i)
        z[t] += (t < p ? predictors[p * t + i - 1] : phi[i - 1]) * z[t - i];
    }
    for (std::size_t t = 2; t < n; ++t)
      CHECK(std::abs(out[k * n + t] - (z[t] + 0.7 * z[t - 1] - 0.4 * z[t - 2])) <= 1e-13);
  }
}

// A path is the same alone and among others.
void alone() {
  const std::size_t n = 100;
  std::vector<double> among = some(7 * n);
  std::vector<double> row(among.begin() + static_cast<std::ptrdiff_t>(2 * n),
                          among.begin() + static_cast<std::ptrdiff_t>(3 * n));
  gmwm::autoregress(among, n, 0.99, 7.0, 0.1);
  gmwm::autoregress(row, n, 0.99, 7.0, 0.1);
  for (std::size_t t = 0; t < n; ++t) CHECK(among[2 * n + t] == row[t]);
}

}  // namespace

int main() {
  return check::at_each_level("paths", [] {
    for (std::size_t count = 0; count <= 9; ++count)
      for (const std::size_t n : {1, 2, 3, 50}) {
        rows(count, n);
        for (std::size_t p = 0; p <= 5; ++p) mixed(count, n, p);
      }
    alone();
  });
}
