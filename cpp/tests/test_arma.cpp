// ARMA kernels: closed forms, sums over filters in long double, two kernels against one another, next to unit roots.
#include "gmwm/arma.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "check.hpp"

namespace {

using gmwm::ArmaOrders;

std::vector<double> shapes(const ArmaOrders& orders, const std::vector<double>& parameters, std::size_t levels,
                           const std::vector<double>& odd = {}) {
  std::vector<double> out(levels);
  gmwm::arma_shapes(orders, parameters, 1, odd, levels, out);
  return out;
}

std::vector<double> slopes(const ArmaOrders& orders, const std::vector<double>& parameters, std::size_t levels) {
  std::vector<double> out(parameters.size() * levels);
  gmwm::arma_slopes(orders, parameters, 1, {}, levels, out);
  return out;
}

std::vector<double> autocovariance(const ArmaOrders& orders, const std::vector<double>& parameters,
                                   const std::vector<std::int64_t>& lags, bool from_zero = false) {
  std::vector<double> out(lags.size());
  gmwm::arma_autocovariance(orders, parameters, lags, from_zero, out);
  return out;
}

// sigma2 ((1 + theta)^2 tau - 6 theta)/tau^2
void moving_average() {
  for (const double theta : {-0.9, 0.0, 0.6, 1.0 - 1e-9}) {
    const ArmaOrders orders{0, 1};
    const std::vector<double> values = shapes(orders, {theta}, 20), by = slopes(orders, {theta}, 20);
    for (int j = 1; j <= 20; ++j) {
      const double tau = std::ldexp(1.0, j), one = 1.0 + theta;
      CHECK_CLOSE(values[static_cast<std::size_t>(j - 1)], (one * one * tau - 6 * theta) / (tau * tau), 1e-15);
      CHECK(std::abs(by[static_cast<std::size_t>(j - 1)] - (2 * one * tau - 6) / (tau * tau)) <= 1e-15);
    }
  }
}

// Next to a unit root the process is a random walk, gamma2 (tau^2 + 2)/(12 tau), until it has time to return.
void walk() {
  const double delta = 1e-15;
  const std::vector<double> values = shapes({1, 0}, {1.0 - delta}, 25);
  for (int j = 1; j <= 25; ++j) {
    const double tau = std::ldexp(1.0, j);
    CHECK_CLOSE(values[static_cast<std::size_t>(j - 1)], (tau * tau + 2) / (12 * tau), 2 * delta * tau);
  }
}

// The sum over all pairs of taps of the level filter.
void sums() {
  const ArmaOrders orders{2, 1, 1, 1, 3};
  const std::vector<double> parameters{0.9, -0.5, 0.3, 0.7, -0.4};
  std::vector<std::int64_t> lags(64);
  for (std::size_t k = 0; k < lags.size(); ++k) lags[k] = static_cast<std::int64_t>(k);
  const std::vector<double> r = autocovariance(orders, parameters, lags), values = shapes(orders, parameters, 6);
  for (std::size_t j = 1; j <= 6; ++j) {
    const std::size_t tau = std::size_t{1} << j;
    long double sum = 0;
    for (std::size_t a = 0; a < tau; ++a)
      for (std::size_t b = 0; b < tau; ++b)
        sum += ((a < tau / 2) == (b < tau / 2) ? 1.0L : -1.0L) * static_cast<long double>(r[a > b ? a - b : b - a]);
    CHECK_CLOSE(values[j - 1], static_cast<double>(sum / static_cast<long double>(tau * tau)), 1e-13);
  }
}

// Haar's filter given by its autocorrelation 1/2 at lag 1 goes another way to the same numbers.
void filters() {
  const ArmaOrders orders{3, 2};
  for (const double delta : {0.1, 1e-5, 1e-9}) {
    // (1 - (1 - delta) z)(1 - 0.4 z)(1 + 0.7 z)
    const double a = 1.0 - delta;
    const std::vector<double> parameters{a - 0.3, 0.28 + 0.3 * a, -0.28 * a, 0.5, -0.2};
    const std::vector<double> one = shapes(orders, parameters, 30), other = shapes(orders, parameters, 30, {0.5});
    for (std::size_t j = 0; j < 30; ++j) CHECK_CLOSE(one[j], other[j], 1e-14);
  }
}

// Rows side by side are what they are alone; those that are not stationary, and only those, are NaN.
void rows() {
  const ArmaOrders orders{2, 1};
  std::vector<double> parameters, out(20 * 7), by(20 * 3 * 7);
  for (int i = 0; i < 20; ++i) parameters.insert(parameters.end(), {1.4 - 0.05 * i, i == 11 ? -1.0 : -0.6, 0.1 * i});
  gmwm::arma_shapes(orders, parameters, 20, {}, 7, out);
  gmwm::arma_slopes(orders, parameters, 20, {}, 7, by);
  for (std::size_t i = 0; i < 20; ++i) {
    const std::vector<double> row(parameters.begin() + static_cast<std::ptrdiff_t>(3 * i),
                                  parameters.begin() + static_cast<std::ptrdiff_t>(3 * i + 3));
    const std::vector<double> alone = shapes(orders, row, 7);
    for (std::size_t j = 0; j < 7; ++j) {
      CHECK(std::isnan(out[7 * i + j]) == (i == 11));
      if (i == 11) continue;
      CHECK(out[7 * i + j] == alone[j]);
      for (std::size_t k = 0; k < 3; ++k) {
        std::vector<double> up = row, down = row;
        up[k] += 1e-5, down[k] -= 1e-5;
        const double slope = (shapes(orders, up, 7)[j] - shapes(orders, down, 7)[j]) / 2e-5;
        CHECK(std::abs(by[(3 * i + k) * 7 + j] - slope) <= 1e-6 * (alone[j] + std::abs(slope)));
      }
    }
  }
}

// p^n by squares: std::pow has 53 bits with some libraries.
long double power_of(long double p, std::int64_t n) {
  long double power = 1;
  for (; n > 0; n /= 2, p *= p)
    if (n % 2 != 0) power *= p;
  return power;
}

// Lags by steps and by leaps, and sums of samples, against the closed forms of order one.
void lags() {
  const double phi = 0.999;
  const std::vector<std::int64_t> at{0, 1, 2, 10, 11, 5000, 5001, 100000};
  const std::vector<double> r = autocovariance({1, 0}, {phi}, at), from = autocovariance({1, 0}, {phi}, at, true);
  std::vector<double> sums(at.size());
  const std::vector<double> parameters{phi};
  gmwm::arma_block_variance({1, 0}, parameters, at, sums);
  const long double p = static_cast<long double>(phi), s2 = 1 / (1 - p * p);
  for (std::size_t k = 0; k < at.size(); ++k) {
    const long double n = static_cast<long double>(at[k]), power = power_of(p, at[k]);
    CHECK_CLOSE(r[k], static_cast<double>(s2 * power), 1e-14);
    CHECK_CLOSE(from[k], static_cast<double>(s2 * (power - 1)), 1e-14);
    const long double sum = s2 * (n * (1 + p) / (1 - p) - 2 * p * (1 - power) / ((1 - p) * (1 - p)));
    CHECK(std::abs(static_cast<long double>(sums[k]) - sum) <= 1e-12L * (sum + 1));
  }
}

// k = tanh z: an autoregression of order two has k_2 = phi_2 and k_1 = phi_1/(1 - phi_2).
void coordinates() {
  const std::vector<double> rows{1.4, -0.6, 0.2, 0.8, 1.0 - 1e-9, 0.0};
  std::vector<double> out(rows.size());
  gmwm::arma_coordinates(rows, 2, out);
  CHECK_CLOSE(out[0], std::atanh(1.4 / 1.6), 1e-14);
  CHECK_CLOSE(out[1], std::atanh(-0.6), 1e-15);
  CHECK(std::isnan(out[2]) && std::isnan(out[3]));
  const double below = 1.0 - (1.0 - 1e-9);
  CHECK_CLOSE(out[4], 0.5 * std::log((2.0 - below) / below), 1e-15);
}

}  // namespace

int main() {
  return check::at_each_level("arma", [] {
    moving_average();
    walk();
    sums();
    filters();
    rows();
    lags();
    coordinates();
  });
}
