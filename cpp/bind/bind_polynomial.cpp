#include <nanobind/nanobind.h>

#include <span>
#include <stdexcept>

#include "arrays.hpp"
#include "gmwm/polynomial.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

void polynomial(const Vector& coefficients, const Vector& x, const OutVector& out) {
  if (coefficients.shape(0) == 0) throw std::invalid_argument("coefficients must not be empty");
  if (x.shape(0) != out.shape(0)) throw std::invalid_argument("out must be as long as x");
  gmwm::polynomial({coefficients.data(), coefficients.shape(0)}, {x.data(), x.shape(0)}, {out.data(), out.shape(0)});
}

void chebyshev(const Matrix& coefficients, const OutMatrix& x) {
  const std::size_t size = coefficients.shape(1), width = x.shape(1);
  if (size == 0 || coefficients.shape(0) != x.shape(0)) throw std::invalid_argument("each row of x needs coefficients");
  for (std::size_t row = 0; row < x.shape(0); ++row) {
    const auto values = view(x).subspan(row * width, width);
    gmwm::chebyshev(view(coefficients).subspan(row * size, size), values, values);
  }
}

}  // namespace

void bind_polynomial(nb::module_& m) {
  m.def("polynomial", &polynomial, "coefficients"_a.noconvert(), "x"_a.noconvert(), "out"_a.noconvert(),
        "Write the polynomial with these coefficients, highest power first, at each x to out, which may be x.");
  m.def("chebyshev", &chebyshev, "coefficients"_a.noconvert(), "x"_a.noconvert(),
        "Replace x by sums of Chebyshev polynomials. Each row has its own coefficients, lowest degree first.");
}
