// The kernels of the Allan family against their definitions in long double.
// Built twice: with the kernel library, and with -DGMWM_PORTABLE and the portable code.
#include "gmwm/clusters.hpp"

#include <cmath>
#include <cstddef>
#include <random>
#include <span>
#include <vector>

#include "check.hpp"

namespace {

using Values = std::vector<double>;
using Wide = long double;

// The running sum of white noise (integrals = 1) or of a random walk (2), its end tied back to zero.
Values phase(std::size_t n, int integrals) {
  std::mt19937_64 generator(n);
  Values p(n);
  double rate = 0.0;
  for (std::size_t i = 1; i < n; ++i) {
    const double u = static_cast<double>(generator() >> 11) * 0x1p-53 - 0.5;
    rate = integrals == 2 ? rate + u : u;
    p[i] = p[i - 1] + rate;
  }
  const double slope = p[n - 1] / static_cast<double>(n - 1);
  for (std::size_t i = 0; i < n; ++i) p[i] -= slope * static_cast<double>(i);
  return p;
}

Wide second(const Values& p, std::size_t i, std::size_t n) {
  return static_cast<Wide>(p[i + 2 * n]) - 2 * static_cast<Wide>(p[i + n]) + p[i];
}

double seconds(const Values& p, std::size_t n, std::size_t stride) {
  Wide total = 0;
  for (std::size_t i = 0; i + 2 * n < p.size(); i += stride) total += second(p, i, n) * second(p, i, n);
  return static_cast<double>(total);
}

double thirds(const Values& p, std::size_t n, std::size_t stride) {
  Wide total = 0;
  for (std::size_t i = 0; i + 3 * n < p.size(); i += stride) {
    const Wide w = second(p, i + n, n) - second(p, i, n);
    total += w * w;
  }
  return static_cast<double>(total);
}

double moving(const Values& p, std::size_t n) {
  Wide total = 0;
  for (std::size_t j = 0; j + 3 * n <= p.size(); ++j) {
    Wide sum = 0;
    for (std::size_t i = j; i < j + n; ++i) sum += second(p, i, n);
    total += sum * sum;
  }
  return static_cast<double>(total);
}

// By the extended phase itself, as the definition has it.
double reflected(const Values& p, std::size_t n) {
  const std::size_t size = p.size();
  std::vector<Wide> q;
  for (std::size_t k = size - 2; k >= 1; --k) q.push_back(2 * static_cast<Wide>(p[0]) - p[k]);
  for (const double value : p) q.push_back(value);
  for (std::size_t k = 1; k <= size - 2; ++k) q.push_back(2 * static_cast<Wide>(p[size - 1]) - p[size - 1 - k]);
  Wide total = 0;
  for (std::size_t i = size - 1; i < 2 * size - 3; ++i) {
    const Wide w = q[i - n] - 2 * q[i] + q[i + n];
    total += w * w;
  }
  return static_cast<double>(total);
}

void sums_are_their_definitions() {
  for (const int integrals : {1, 2})
    for (const std::size_t size : {3u, 4u, 7u, 10u, 65u, 66u, 300u, 1025u}) {
      const Values p = phase(size, integrals);
      for (std::size_t n = 1; n < size; n = n < 20 ? n + 1 : n + n / 3) {
        if (size > 2 * n) {
          CHECK_CLOSE(gmwm::second_differences(p, n, 1), seconds(p, n, 1), 1e-10);
          CHECK_CLOSE(gmwm::second_differences(p, n, n), seconds(p, n, n), 1e-10);
        }
        if (size > 3 * n) {
          CHECK_CLOSE(gmwm::third_differences(p, n, 1), thirds(p, n, 1), 1e-10);
          CHECK_CLOSE(gmwm::third_differences(p, n, n), thirds(p, n, n), 1e-10);
        }
        if (size >= 3 * n) CHECK_CLOSE(gmwm::moving_second_differences(p, n), moving(p, n), 1e-10);
        if (size >= n + 2) CHECK_CLOSE(gmwm::reflected_second_differences(p, n), reflected(p, n), 1e-10);
      }
    }
}

void octaves_are_second_differences() {
  for (const std::size_t size : {8u, 9u, 100u, 4096u, 5001u}) {
    const Values x = phase(size, 1);
    Values p(size + 1), sums;
    for (std::size_t n = 1; 2 * n <= size; n *= 2) sums.push_back(-1.0);
    gmwm::octave_second_differences(x, 0.25, p, sums);
    Wide total = 0;
    for (std::size_t k = 0; k < size; ++k) {
      total += static_cast<Wide>(x[k]) - 0.25L;
      CHECK(std::abs(p[k + 1] - static_cast<double>(total)) < 1e-9);
    }
    for (std::size_t j = 0; j < sums.size(); ++j) CHECK_CLOSE(sums[j], seconds(p, std::size_t{1} << j, 1), 1e-9);
  }
}

// A moving sum that is carried through the whole record would lose digits here: the phase is 10^7 times its
// differences.
void long_records_keep_their_digits() {
  const Values p = phase(200'000, 2);
  for (const std::size_t n : {2u, 3u, 64u}) CHECK_CLOSE(gmwm::moving_second_differences(p, n), moving(p, n), 1e-9);
}

void too_large_clusters_are_empty() {
  const Values p = phase(30, 1);
  CHECK(gmwm::second_differences(p, 15, 1) == 0.0);
  CHECK(gmwm::third_differences(p, 10, 1) == 0.0);
  CHECK(gmwm::moving_second_differences(p, 11) == 0.0);
  CHECK(gmwm::second_differences(p, 14, 1) > 0.0);
  CHECK(gmwm::third_differences(p, 9, 1) > 0.0);
  CHECK(gmwm::moving_second_differences(p, 10) > 0.0);
}

void scaling_by_a_power_of_two_is_exact() {
  const Values p = phase(1000, 2);
  for (const int power : {-40, 40}) {
    Values q(p);
    for (double& value : q) value = std::ldexp(value, power);
    const auto same = [power](double scaled, double plain) { CHECK(scaled == std::ldexp(plain, 2 * power)); };
    same(gmwm::second_differences(q, 7, 1), gmwm::second_differences(p, 7, 1));
    same(gmwm::third_differences(q, 7, 1), gmwm::third_differences(p, 7, 1));
    same(gmwm::moving_second_differences(q, 7), gmwm::moving_second_differences(p, 7));
    same(gmwm::reflected_second_differences(q, 7), gmwm::reflected_second_differences(p, 7));
  }
}

}  // namespace

int main() {
  return check::at_each_level("clusters", [] {
    sums_are_their_definitions();
    octaves_are_second_differences();
    long_records_keep_their_digits();
    too_large_clusters_are_empty();
    scaling_by_a_power_of_two_is_exact();
  });
}
