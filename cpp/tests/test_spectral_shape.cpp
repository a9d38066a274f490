// Descents on exact densities, and roots of products of known factors.
#include "gmwm/spectral_shape.hpp"

#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

#include "check.hpp"

namespace {

constexpr std::size_t lags = 3, count = 60;

struct Measured {
  std::vector<double> waves, known, logs, weights;

  gmwm::SpectralData data() const { return {waves, known, logs, weights, 0.0, 2.0}; }
};

// The density of x_t = 0.5 x_{t-1} + e_t + 0.4 e_{t-1} with a variance of e of 2, and of a random walk.
Measured measured() {
  Measured found;
  found.waves.resize(2 * lags * count);
  for (std::size_t i = 0; i < count; ++i) {
    const double angle = 3.0 * static_cast<double>(i + 1) / count;
    for (std::size_t k = 0; k < lags; ++k) {
      found.waves[k * count + i] = std::cos(angle * static_cast<double>(k + 1));
      found.waves[(lags + k) * count + i] = -std::sin(angle * static_cast<double>(k + 1));
    }
    const double above = 1.16 + 0.8 * std::cos(angle), below = 1.25 - std::cos(angle);
    found.known.push_back(0.01 / std::pow(std::sin(angle / 2), 2));
    found.logs.push_back(std::log(2.0 * above / below + found.known.back()));
    found.weights.push_back(100.0);
  }
  return found;
}

void a_descent_finds_the_process() {
  const Measured from = measured();
  for (const bool free : {false, true}) {
    std::vector<double> at{0.0, -0.1, 0.1, 0.0};
    const double loss = gmwm::spectral_descent(from.data(), {1, free, 100, 0.0}, at);
    CHECK(loss < 1e-15);
    CHECK_CLOSE(at[0], std::log(2.0), 1e-6);
    CHECK_CLOSE(at[1], -0.5, 1e-6);
    CHECK_CLOSE(at[2], 0.4, 1e-6);
    CHECK(std::abs(at[3]) < 1e-6);
  }
}

void no_step_is_the_loss_itself() {
  const Measured from = measured();
  std::vector<double> at{std::log(2.0), -0.5, 0.4, 1.0};
  double expected = 0.25;
  for (std::size_t i = 0; i < count; ++i) {
    const double left = from.logs[i] - std::log(std::exp(from.logs[i]) + (std::exp(1.0) - 1.0) * from.known[i]);
    expected += 100.0 * left * left;
  }
  CHECK_CLOSE(gmwm::spectral_descent(from.data(), {1, true, 0, 0.0}, at), expected, 1e-12);
  CHECK(at[3] == 1.0);
  at[0] = 1e6;
  CHECK(gmwm::spectral_descent(from.data(), {1, true, 5, 0.0}, at) == std::numeric_limits<double>::infinity());
  CHECK(at[0] == 1e6);
}

void roots_are_counted() {
  // (z - 0.5)(z + 0.9), and (z² - 1.2 z + 0.81) with two roots of modulus 0.9.
  for (const std::vector<double>& c : {std::vector<double>{0.4, -0.45}, std::vector<double>{-1.2, 0.81}}) {
    CHECK(gmwm::roots_inside(c, 0.9001));
    CHECK(!gmwm::roots_inside(c, 0.8999));
  }
  CHECK(gmwm::roots_inside({}, 0.5));
  CHECK(!gmwm::roots_inside(std::vector<double>{std::nan("")}, 0.5));
}

}  // namespace

int main() {
  return check::at_each_level("spectral_shape", [] {
    a_descent_finds_the_process();
    no_step_is_the_loss_itself();
    roots_are_counted();
  });
}
