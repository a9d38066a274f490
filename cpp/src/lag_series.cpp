#include "gmwm/lag_series.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

namespace gmwm {

namespace {

constexpr std::int64_t few = 64;  // lags up to which powers are summed one by one, once for each number of them
using Powers = std::array<double, 3 * degree_most + 3>;  // the sums of 0 to the highest power that is needed

std::vector<Powers> few_sums() {
  std::vector<Powers> all(static_cast<std::size_t>(few + 1));
  for (std::int64_t n = 1; n <= few; ++n)
    for (std::int64_t i = 0; i < n; ++i) {
      double power = 1, ratio = static_cast<double>(i) / static_cast<double>(n);
      for (double& sum : all[static_cast<std::size_t>(n)]) sum += power, power *= ratio;
    }
  return all;
}

}  // namespace

Geometric near_one(Complex decay, double n) {
  const double square = n * n, m = n - 1;
  if (norm(decay) == 0) return {{n, 0}, {0.5 * n * m, 0}};
  const Complex plain = expm1(-(n * decay)) * inverse(expm1(-decay));
  const double s2 = n * (square - 1) / 12, s4 = s2 * (3 * square - 7) / 20;
  const double s6 = s2 * ((3 * square - 18) * square + 31) / 112;
  const Complex y = decay * decay;
  const Complex odd = decay * (Complex{s2, 0} + (1.0 / 6) * (y * (Complex{s4, 0} + (1.0 / 20) * (s6 * y))));
  return {plain, (0.5 * m) * plain - exp((-0.5 * m) * decay) * odd};
}

void sums_of_powers(std::int64_t n, std::size_t highest, double* out) {
  const double size = static_cast<double>(n);
  if (n <= few) {
    static const std::vector<Powers> known = few_sums();
    const Powers& sums = known[static_cast<std::size_t>(n)];
    std::copy(sums.begin(), sums.begin() + static_cast<std::ptrdiff_t>(highest), out);
    return;
  }
  // Euler and Maclaurin: B_2l / (2l)!.
  constexpr std::array<double, 6> terms{1.0 / 12, -1.0 / 720, 1.0 / 30240, -1.0 / 1209600, 1.0 / 47900160,
                                        -691.0 / 1307674368000};
  for (std::size_t r = 0; r < highest; ++r) {
    double total = size / static_cast<double>(r + 1) - (r > 0 ? 0.5 : 0.0), factor = static_cast<double>(r) / size;
    for (std::size_t l = 0; l < terms.size() && factor > 1e-17 * size; ++l) {
      // At r = 2l - 1 the derivative is a constant, which is the same at both ends.
      const double order = static_cast<double>(r) - static_cast<double>(2 * l + 1);
      if (order <= 0) break;
      total += terms[l] * factor;
      factor *= order * (order - 1) / (size * size);
    }
    out[r] = total;
  }
}

Complex swept(const Series& polynomial, std::size_t degree, Complex decay, std::int64_t count) {
  decay = wrapped(decay);
  const double n = static_cast<double>(count);
  Complex total{};
  if (n * size(decay) < slow) {
    std::array<double, 3 * degree_most + 3> sums;
    sums_of_powers(count, degree + degree_most + 1, sums.data());
    for (std::size_t r = 0; r <= degree; ++r) {
      Complex power{1, 0};
      for (std::size_t s = 0; s <= degree_most; power *= (-n / static_cast<double>(++s)) * decay)
        total += sums[r + s] * (polynomial[r] * power);
    }
    return total;
  }
  const Complex z = exp(-decay), zn = exp(-(n * decay)), over = inverse(expm1(-decay));
  std::array<Complex, 2 * degree_most + 2> moment;
  moment[0] = expm1(-(n * decay)) * over;
  total = polynomial[0] * moment[0];
  for (std::size_t r = 1; r <= degree; ++r) {
    Complex sum{};
    double factor = 1;
    for (std::size_t s = r; s-- > 0;) {
      factor *= static_cast<double>(s + 1) / (static_cast<double>(r - s) * n);
      sum += factor * moment[s];
    }
    moment[r] = (zn - z * sum) * over;
    total += polynomial[r] * moment[r];
  }
  return total;
}

Series counted(const Echo& echo, LagCount pairs, double n) {
  Series out{};
  for (std::size_t r = 0; r <= degree_most; ++r) {
    out[r] += pairs.at_start * echo.series[r];
    out[r + 1] += (n * pairs.step) * echo.series[r];
  }
  return out;
}

}  // namespace gmwm
