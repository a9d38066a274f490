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

void chebyshev(const Matrix& coefficients, const Matrix& x, const OutMatrix& out) {
  if (coefficients.shape(0) == 0 || coefficients.shape(1) != x.shape(1))
    throw std::invalid_argument("each column of x needs coefficients");
  if (x.shape(0) != out.shape(0) || x.shape(1) != out.shape(1)) throw std::invalid_argument("out must have the shape of x");
  gmwm::chebyshev(view(coefficients), view(x), x.shape(1), view(out));
}

}  // namespace

void bind_polynomial(nb::module_& m) {
  m.def("polynomial", &polynomial, "coefficients"_a.noconvert(), "x"_a.noconvert(), "out"_a.noconvert(),
        "Write the polynomial with these coefficients, highest power first, at each x to out, which may be x.");
  m.def("chebyshev", &chebyshev, "coefficients"_a.noconvert(), "x"_a.noconvert(), "out"_a.noconvert(),
        "Write the sums of Chebyshev polynomials to out. Each column has its own coefficients, lowest degree first.");
}
