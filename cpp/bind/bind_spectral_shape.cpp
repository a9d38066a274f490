#include <nanobind/nanobind.h>

#include <algorithm>
#include <cstddef>

#include "arrays.hpp"
#include "gmwm/spectral_shape.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

double spectral_descent(const Cube& waves, const Matrix& data, double floor, double prior, std::size_t p, bool free,
                        std::size_t steps, double near, const OutVector& parameters) {
  const std::size_t n = waves.shape(2), m = parameters.size();
  if (waves.shape(0) != 2 || n == 0 || data.shape(0) != 3 || data.shape(1) != n)
    throw nb::value_error("waves must be (2, lags, n), and data (3, n), n > 0");
  if (m < 2 + p || std::max(p, m - 2 - p) > waves.shape(1))
    throw nb::value_error("parameters must be scale, a, b and slow, with at most as many coefficients as lags");
  const nb::gil_scoped_release release;
  const auto row = [&](std::size_t k) { return view(data).subspan(k * n, n); };
  const gmwm::SpectralData measured{view(waves), row(0), row(1), row(2), floor, prior};
  const gmwm::DescentOptions options{p, free, steps, near};
  return gmwm::spectral_descent(measured, options, view(parameters));
}

bool roots_inside(const Vector& coefficients, double most) {
  if (!(most > 0.0)) throw nb::value_error("most must be positive");
  return gmwm::roots_inside(view(coefficients), most);
}

}  // namespace

void bind_spectral_shape(nb::module_& m) {
  m.def("spectral_descent", &spectral_descent, "waves"_a.noconvert(), "data"_a.noconvert(), "floor"_a, "prior"_a, "p"_a,
        "free"_a, "steps"_a, "near"_a, "parameters"_a.noconvert(),
        "Move the parameters scale, a, b and slow in place to a local minimum of the loss of the ARMA density, and "
        "return the loss. The rows of `data` are the known part, the logarithms and the weights.");
  m.def("roots_inside", &roots_inside, "coefficients"_a.noconvert(), "most"_a,
        "Return whether all roots of the polynomial 1, c_1, c_2, … have a modulus below `most`.");
}
