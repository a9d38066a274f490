// Built with -ffp-contract=off (CMakeLists.txt), see paths.hpp.
#include "gmwm/paths.hpp"

#include <array>

namespace gmwm {

namespace {

// Rows side by side: the latency of a product and a sum, spread over as many.
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

}  // namespace gmwm
