// Descents over shapes against data that a model can fit exactly, and the derivatives of shapes against differences.
#include "gmwm/descent.hpp"

#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "check.hpp"

namespace {

constexpr std::size_t levels = 12;

std::vector<double> half_scales() {
  std::vector<double> h;
  for (std::size_t j = 0; j < levels; ++j) h.push_back(std::ldexp(1.0, static_cast<int>(j)));
  return h;
}

std::unique_ptr<gmwm::Shape> markov() {
  const gmwm::ExponentialBranch branch{-12.0, 5.0, std::exp(-12.0), 1e-8, 1, true, true};
  return std::make_unique<gmwm::ExponentialShape>(gmwm::ExponentialCurve(half_scales(), {&branch, 1}, 1.0, false));
}

std::unique_ptr<gmwm::Shape> autoregression() {
  std::vector<std::int64_t> numbers;
  for (std::size_t j = 1; j <= levels; ++j) numbers.push_back(static_cast<std::int64_t>(j));
  return std::make_unique<gmwm::ArmaShape>(gmwm::ArmaOrders{2, 1, 0, 0, 1}, numbers, std::vector<double>{},
                                           std::vector<double>(3, -15.0), std::vector<double>(3, 15.0));
}

std::unique_ptr<gmwm::Shape> oscillator() {
  return std::make_unique<gmwm::OscillatorShape>(half_scales(), 1.0, std::vector<double>(2, -20.0),
                                                 std::vector<double>(2, 20.0));
}

void check_slopes(const gmwm::Shape& shape, const std::vector<double>& z) {
  std::vector<double> up(levels), down(levels), slopes(shape.size() * levels);
  shape.slopes(z.data(), slopes.data());
  for (std::size_t k = 0; k < shape.size(); ++k) {
    std::vector<double> high = z, low = z;
    high[k] += 1e-5, low[k] -= 1e-5;
    CHECK(shape.values(high.data(), up.data()) && shape.values(low.data(), down.data()));
    for (std::size_t j = 0; j < levels; ++j)
      CHECK(std::abs((up[j] - down[j]) / 2e-5 - slopes[k * levels + j]) < 1e-6 * (std::abs(up[j]) + std::abs(slopes[k * levels + j])));
  }
}

std::vector<double> unit_matrix() {
  std::vector<double> root(levels * levels, 0.0);
  for (std::size_t j = 0; j < levels; ++j) root[j * levels + j] = 1;
  return root;
}

// A descent finds the shapes of data without noise, and Newton's method all their digits.
void check_descent(std::unique_ptr<gmwm::Shape> free, const std::vector<double>& truth, const std::vector<double>& start) {
  std::vector<double> target(levels), part(levels), white(levels);
  const auto curved = markov();
  CHECK(curved->values(&truth[0], target.data()) && free->values(&truth[1], part.data()));
  for (std::size_t j = 0; j < levels; ++j) target[j] += 0.5 * part[j], white[j] = std::ldexp(0.5, -static_cast<int>(j));
  gmwm::Descent descent(target, white, unit_matrix(), 1e-15);
  descent.add_branch(markov());
  descent.add_free(std::move(free));
  CHECK(descent.coordinates(1) == truth.size());
  std::optional<gmwm::Projected> found = descent.at({{0}, start});
  CHECK(found.has_value());
  const double before = found->objective;
  found = descent.downhill(std::move(*found), 100);
  CHECK(found->objective < 1e-6 * before);
  std::optional<gmwm::Curvature> curvature;
  found = descent.sharpened(std::move(*found), curvature);
  CHECK(found->objective < 1e-20);
  for (std::size_t k = 0; k < truth.size(); ++k) CHECK(std::abs(found->point.x[k] - truth[k]) < 1e-5);
  CHECK(std::abs(found->weights[1] / found->lengths[0] - 1) < 1e-5 && std::abs(found->weights[2] / found->lengths[1] - 0.5) < 1e-5);
  CHECK(descent.at_rest(*found) || found->objective < 1e-24);
}

void tests() {
  check_slopes(*markov(), {-4.0});
  check_slopes(*autoregression(), {1.5, -0.4, 0.3});
  check_slopes(*oscillator(), {-3.0, 1.0});
  check_descent(autoregression(), {-6.0, 0.9, -0.5, 0.2}, {-5.5, 0.7, -0.4, 0.1});
  check_descent(oscillator(), {-6.0, -2.0, 1.0}, {-5.5, -2.2, 0.7});
  // No process: an autoregression with an infinite coordinate.
  gmwm::Descent none(std::vector<double>(levels, 1.0), {}, unit_matrix(), 0.0);
  none.add_free(autoregression());
  CHECK(!none.at({{}, {INFINITY, 0.0, 0.0}}));
}

}  // namespace

int main() { return check::at_each_level("descents", tests); }
