// Built with -ffp-contract=off (CMakeLists.txt), see paths.hpp.
#include "gmwm/paths.hpp"

#include <array>

namespace gmwm {

namespace {

// Number of rows that are computed together, to hide the latency of a product and a sum.
constexpr std::size_t together = 4;

template <std::size_t K>
void autoregress_rows(double* x, std::size_t n, double phi, double first, double rest) {
  std::array<double, K> last;
  for (std::size_t k = 0; k < K; ++k) last[k] = x[k * n] *= first;
  for (std::size_t t = 1; t < n; ++t)
    for (std::size_t k = 0; k < K; ++k) x[k * n + t] = last[k] = rest * x[k * n + t] + phi * last[k];
}

template <std::size_t K>
void accumulate_rows(double* x, std::size_t n, double scale) {
  std::array<double, K> sum{};
  for (std::size_t t = 0; t < n; ++t)
    for (std::size_t k = 0; k < K; ++k) x[k * n + t] = scale * (sum[k] += x[k * n + t]);
}

// z_t = rest x_t + Σ φ_i z_{t−i} from `begin` on. The oldest term is added first, so that only the last product and sum
// depend on the previous value. With up to four coefficients, the previous values stay in registers.
template <std::size_t K, std::size_t P>
void recursion(double* x, std::size_t n, std::size_t begin, const double* phi, double rest) {
  std::array<std::array<double, K>, P> last;
  for (std::size_t i = 0; i < P; ++i)
    for (std::size_t k = 0; k < K; ++k) last[i][k] = begin < n ? x[k * n + begin - 1 - i] : 0.0;
  for (std::size_t t = begin; t < n; ++t)
    for (std::size_t k = 0; k < K; ++k) {
      double sum = rest * x[k * n + t];
      for (std::size_t i = P; i-- > 0;) sum += phi[i] * last[i][k];
      for (std::size_t i = P - 1; i > 0; --i) last[i][k] = last[i - 1][k];
      x[k * n + t] = last[0][k] = sum;
    }
}

template <std::size_t K>
void recursion(double* x, std::size_t n, std::size_t begin, std::size_t end, std::span<const double> phi,
               double rest) {
  for (std::size_t t = begin; t < end; ++t)
    for (std::size_t k = 0; k < K; ++k) {
      double sum = rest * x[k * n + t];
      for (std::size_t i = phi.size(); i >= 1; --i) sum += phi[i - 1] * x[k * n + t - i];
      x[k * n + t] = sum;
    }
}

template <std::size_t K>
void mix_rows(double* x, std::size_t n, std::span<const double> phi, std::span<const double> theta,
              const double* predictors, const double* deviations, double rest) {
  const std::size_t p = phi.size(), q = theta.size(), early = p < n ? p : n;
  for (std::size_t t = 0; t < early; ++t)
    recursion<K>(x, n, t, t + 1, std::span(predictors + t * p, t), deviations[t]);
  switch (p) {
    case 1: recursion<K, 1>(x, n, early, phi.data(), rest); break;
    case 2: recursion<K, 2>(x, n, early, phi.data(), rest); break;
    case 3: recursion<K, 3>(x, n, early, phi.data(), rest); break;
    case 4: recursion<K, 4>(x, n, early, phi.data(), rest); break;
    default: recursion<K>(x, n, early, n, phi, rest);
  }
  if (q == 0) return;
  for (std::size_t k = 0; k < K; ++k)
    for (std::size_t t = n; t-- > q;) {
      double sum = x[k * n + t];
      for (std::size_t i = 1; i <= q; ++i) sum += theta[i - 1] * x[k * n + t - i];
      x[k * n + t] = sum;
    }
}

}  // namespace

void autoregress(std::span<double> values, std::size_t n, double phi, double first, double rest) {
  std::size_t at = 0;
  for (; at + together * n <= values.size(); at += together * n)
    autoregress_rows<together>(values.data() + at, n, phi, first, rest);
  for (; at < values.size(); at += n) autoregress_rows<1>(values.data() + at, n, phi, first, rest);
}

void accumulate(std::span<double> values, std::size_t n, double scale) {
  std::size_t at = 0;
  for (; at + together * n <= values.size(); at += together * n)
    accumulate_rows<together>(values.data() + at, n, scale);
  for (; at < values.size(); at += n) accumulate_rows<1>(values.data() + at, n, scale);
}

void mix(std::span<double> values, std::size_t n, std::span<const double> phi, std::span<const double> theta,
         std::span<const double> predictors, std::span<const double> deviations, double rest) {
  std::size_t at = 0;
  for (; at + together * n <= values.size(); at += together * n)
    mix_rows<together>(values.data() + at, n, phi, theta, predictors.data(), deviations.data(), rest);
  for (; at < values.size(); at += n)
    mix_rows<1>(values.data() + at, n, phi, theta, predictors.data(), deviations.data(), rest);
}

}  // namespace gmwm
