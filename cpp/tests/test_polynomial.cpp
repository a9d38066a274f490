// Polynomials against their roots and against long double, for sizes around those of a batch.
#include "gmwm/polynomial.hpp"

#include <cmath>
#include <cstddef>
#include <vector>

#include "check.hpp"

int main() {
  return check::at_each_level("polynomial", [] {
    const std::vector<double> cubic{1, -6, 11, -6};  // (x - 1)(x - 2)(x - 3)
    std::vector<double> out(3);
    gmwm::polynomial(cubic, std::vector<double>{1, 2, 3}, out);
    for (const double v : out) CHECK(v == 0);

    const std::vector<double> c{0.3, -0.7, 1.1, 2.0};
    for (const int size : {0, 1, 63, 64, 65, 200}) {
      std::vector<double> x(static_cast<std::size_t>(size));
      for (std::size_t i = 0; i < x.size(); ++i) x[i] = static_cast<double>(i) / 100;
      const std::vector<double> at = x;
      gmwm::polynomial(c, x, x);  // in place
      for (std::size_t i = 0; i < x.size(); ++i) {
        const long double v = at[i], expected = ((0.3L * v - 0.7L) * v + 1.1L) * v + 2.0L;
        CHECK(std::abs(static_cast<long double>(x[i]) - expected) < 1e-14L);
      }
    }

    // T_k(cos a) = cos ka.
    for (const std::size_t size : {1u, 64u, 70u}) {
      constexpr std::size_t degree = 30;
      std::vector<double> terms(degree + 1), x(size);
      for (std::size_t k = 0; k < terms.size(); ++k) terms[k] = std::sin(1.3 * static_cast<double>(k));
      for (std::size_t i = 0; i < size; ++i) x[i] = std::cos(0.1 * static_cast<double>(i));
      const std::vector<double> at = x;
      gmwm::chebyshev(terms, x, x);  // in place
      for (std::size_t i = 0; i < size; ++i) {
        double expected = 0;
        for (std::size_t k = 0; k <= degree; ++k) expected += terms[k] * std::cos(static_cast<double>(k) * std::acos(at[i]));
        CHECK(std::abs(x[i] - expected) < 1e-11);
      }
    }
  });
}
