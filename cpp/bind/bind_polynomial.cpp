#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <span>
#include <stdexcept>

#include "gmwm/polynomial.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Input = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void polynomial(const Input& coefficients, const Input& x, const Output& out) {
  if (coefficients.shape(0) == 0) throw std::invalid_argument("coefficients must not be empty");
  if (x.shape(0) != out.shape(0)) throw std::invalid_argument("out must be as long as x");
  gmwm::polynomial({coefficients.data(), coefficients.shape(0)}, {x.data(), x.shape(0)}, {out.data(), out.shape(0)});
}

}  // namespace

void bind_polynomial(nb::module_& m) {
  m.def("polynomial", &polynomial, "coefficients"_a.noconvert(), "x"_a.noconvert(), "out"_a.noconvert(),
        "Write the polynomial with these coefficients, highest power first, at each x to out, which may be x.");
}
