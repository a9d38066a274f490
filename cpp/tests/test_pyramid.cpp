// The pyramid against the definition, tap by tap.

#include "gmwm/pyramid.hpp"

#include <cmath>
#include <cstddef>
#include <limits>
#include <random>
#include <vector>

#include "check.hpp"
#include "gmwm/haar.hpp"

namespace {

using Values = std::vector<double>;

Values signal(std::size_t n, double offset = 0.0) {
  std::mt19937_64 generator(n);
  Values x(n);
  for (double& v : x) v = offset + static_cast<double>(generator() >> 11) * 0x1p-53 - 0.5;
  return x;
}

// d4 / sqrt(2) and Haar's, from their closed forms.
Values scaling(std::size_t length) {
  if (length == 2) return {0.5, 0.5};
  const double r = std::sqrt(3.0);
  return {(1 + r) / 8, (3 + r) / 8, (3 - r) / 8, (1 - r) / 8};
}

Values wavelet(std::size_t length) {
  const Values g = scaling(length);
  Values h(length);
  for (std::size_t l = 0; l < length; ++l) h[l] = (l % 2 == 0 ? 1.0 : -1.0) * g[length - 1 - l];
  return h;
}

// Σ_l f_l x[(t - l s) mod N].
Values periodic(const Values& x, const Values& f, std::size_t stride) {
  Values out(x.size());
  for (std::size_t t = 0; t < x.size(); ++t) {
    long double sum = 0.0L;
    for (std::size_t l = 0; l < f.size(); ++l) {
      const std::size_t shift = (l * stride) % x.size();
      sum += static_cast<long double>(f[l]) * x[(t + x.size() - shift) % x.size()];
    }
    out[t] = static_cast<double>(sum);
  }
  return out;
}

void variance_is_its_definition() {
  for (const std::size_t length : {2u, 4u})
    for (const std::size_t n : {8u, 25u, 46u, 1000u, 4099u, 9001u}) {
      const Values g = scaling(length), h = wavelet(length);
      for (const double offset : {0.0, 9810.0}) {
        const Values x = signal(n, offset);
        std::size_t levels = 0;
        while (((std::size_t{2} << levels) - 1) * (length - 1) < n) ++levels;
        Values variance(levels);
        gmwm::pyramid_variance(x, g, h, variance);
        // The same values go round in the periodic transform, but for the first (2^j - 1)(L - 1).
        Values v = signal(n);
        for (std::size_t j = 0; j < levels; ++j) {
          const Values w = periodic(v, h, std::size_t{1} << j);
          v = periodic(v, g, std::size_t{1} << j);
          long double total = 0.0L;
          const std::size_t first = ((std::size_t{2} << j) - 1) * (length - 1);
          for (std::size_t t = first; t < n; ++t) total += static_cast<long double>(w[t]) * w[t];
          CHECK_CLOSE(variance[j], static_cast<double>(total) / static_cast<double>(n - first),
                      offset == 0.0 ? 1e-12 : 1e-8);
        }
      }
    }
}

void haar_is_the_running_sum() {
  const Values x = signal(5000);
  Values pyramid(12), sums(12);
  gmwm::pyramid_variance(x, scaling(2), wavelet(2), pyramid);
  gmwm::haar_variance(x, sums);
  for (std::size_t j = 0; j < pyramid.size(); ++j) CHECK_CLOSE(pyramid[j], sums[j], 1e-11);
}

void steps_go_round_and_back() {
  for (const std::size_t length : {2u, 4u})
    for (const std::size_t n : {1u, 2u, 3u, 7u, 12u, 13u, 1000u})
      for (const std::size_t stride : {1u, 2u, 8u, 1024u}) {
        const Values x = signal(n), g = scaling(length), h = wavelet(length);
        Values smooth(n), detail(n), back(n);
        gmwm::pyramid_step(x, g, h, stride, smooth, detail);
        const Values v = periodic(x, g, stride), w = periodic(x, h, stride);
        gmwm::pyramid_unstep(smooth, detail, g, h, stride, back);
        for (std::size_t t = 0; t < n; ++t) {
          CHECK(std::abs(smooth[t] - v[t]) < 1e-15);
          CHECK(std::abs(detail[t] - w[t]) < 1e-15);
          CHECK(std::abs(back[t] - x[t]) < 1e-14);
        }
      }
}

void what_is_not_finite_is_told() {
  Values x = signal(100), variance(3);
  x[57] = std::numeric_limits<double>::infinity();
  gmwm::pyramid_variance(x, scaling(4), wavelet(4), variance);
  for (const double v : variance) CHECK(std::isnan(v));
}

}  // namespace

int main() {
  return check::at_each_level("pyramid", [] {
    variance_is_its_definition();
    haar_is_the_running_sum();
    steps_go_round_and_back();
    what_is_not_finite_is_told();
  });
}
