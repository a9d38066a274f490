#include "gmwm/polynomial.hpp"

#include <algorithm>
#include <array>

#include "gmwm/clones.hpp"

namespace gmwm {

namespace {

constexpr std::size_t batch = 64;

// Horner's scheme for a batch of points: the inner loop runs over independent points, so that the compiler vectorises
// it.
GMWM_INLINE void horner_inline(const double* c, std::size_t n, const double* x, std::size_t m, double* out) {
  std::array<double, batch> value;
  for (std::size_t i = 0; i < m; ++i) value[i] = c[0];
  for (std::size_t k = 1; k < n; ++k)
    for (std::size_t i = 0; i < m; ++i) value[i] = value[i] * x[i] + c[k];
  std::copy_n(value.begin(), m, out);
}
constexpr Clones<horner_inline> horner{};

GMWM_INLINE void clenshaw_inline(const double* c, std::size_t n, const double* x, std::size_t m, double* out) {
  std::array<double, batch> next{}, last{}, twice;
  for (std::size_t i = 0; i < m; ++i) twice[i] = 2 * x[i];
  for (std::size_t k = n; k-- > 1;)
    for (std::size_t i = 0; i < m; ++i) {
      const double value = c[k] + twice[i] * next[i] - last[i];
      last[i] = next[i], next[i] = value;
    }
  for (std::size_t i = 0; i < m; ++i) out[i] = c[0] + x[i] * next[i] - last[i];
}
constexpr Clones<clenshaw_inline> clenshaw{};

}  // namespace

void polynomial(std::span<const double> coefficients, std::span<const double> x, std::span<double> out) {
  for (std::size_t i = 0; i < x.size(); i += batch)
    horner(coefficients.data(), coefficients.size(), x.data() + i, std::min(batch, x.size() - i), out.data() + i);
}

void chebyshev(std::span<const double> coefficients, std::span<const double> x, std::span<double> out) {
  for (std::size_t i = 0; i < x.size(); i += batch)
    clenshaw(coefficients.data(), coefficients.size(), x.data() + i, std::min(batch, x.size() - i), out.data() + i);
}

}  // namespace gmwm
