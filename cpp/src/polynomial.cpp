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

}  // namespace

void polynomial(std::span<const double> coefficients, std::span<const double> x, std::span<double> out) {
  for (std::size_t i = 0; i < x.size(); i += batch)
    horner(coefficients.data(), coefficients.size(), x.data() + i, std::min(batch, x.size() - i), out.data() + i);
}

}  // namespace gmwm
