// The Gauss rule on integers, and the lags at which covariances are summed.
#include "gmwm/lags.hpp"

#include <array>
#include <cmath>
#include <vector>

#include "check.hpp"

int main() {
  for (const std::int64_t points : {17, 100, 4001}) {
    std::array<double, 8> nodes{}, weights{};
    gmwm::integer_rule(points, nodes, weights);
    const double middle = 0.5 * static_cast<double>(points - 1), size = static_cast<double>(points);
    for (int power = 0; power < 16; ++power) {
      double direct = 0, rule = 0;
      for (std::int64_t i = 0; i < points; ++i) direct += std::pow((static_cast<double>(i) - middle) / size, power);
      for (std::size_t i = 0; i < 8; ++i) rule += weights[i] * std::pow((nodes[i] - middle) / size, power);
      CHECK(std::abs(direct - rule) < 1e-14 * size);
    }
  }
  // The weights of a pair of levels add up to the number of pairs of coefficients.
  const std::vector<std::int64_t> levels{1, 3, 7, 10};
  for (const bool alternating : {false, true}) {
    const gmwm::Lags lags = gmwm::covariance_lags(levels, 5000, 1e-4, 0.3, alternating);
    for (std::size_t k = 0; k < levels.size(); ++k)
      for (std::size_t j = 0; j <= k; ++j) {
        double total = 0;
        for (std::size_t i = 0; i < lags.lag.size(); ++i)
          if (lags.finer[i] == static_cast<std::int64_t>(j) && lags.coarser[i] == static_cast<std::int64_t>(k))
            total += lags.weight[i];
        const double fine = 5001 - std::ldexp(1, static_cast<int>(levels[j]));
        const double coarse = 5001 - std::ldexp(1, static_cast<int>(levels[k]));
        CHECK_CLOSE(total, fine * coarse, 1e-12);
      }
  }
  return check::result("lags");
}
