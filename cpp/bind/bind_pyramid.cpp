#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>

#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "arrays.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/pyramid.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

void check_filters(const Vector& scaling, const Vector& wavelet) {
  if (scaling.shape(0) < 2 || scaling.shape(0) != wavelet.shape(0))
    throw std::invalid_argument("scaling and wavelet must have the same number of taps, 2 or more, got " +
                                std::to_string(scaling.shape(0)) + " and " + std::to_string(wavelet.shape(0)));
}

void check_same(std::size_t n, std::size_t other, std::size_t stride) {
  if (n == 0 || n != other || stride == 0)
    throw std::invalid_argument("smooth and detail must have the same size, not 0, and stride must be positive, got " +
                                std::to_string(n) + ", " + std::to_string(other) + " and " + std::to_string(stride));
}

Result pyramid_variance(const Vector& x, const Vector& scaling, const Vector& wavelet, std::size_t levels) {
  check_filters(scaling, wavelet);
  const std::size_t n = x.shape(0), reach = scaling.shape(0) - 1;
  // The first and last condition together: n - (2^levels - 1) reach >= 1, without overflow.
  if (levels < 1 || levels > gmwm::max_level || n == 0 || ((std::size_t{1} << levels) - 1) > (n - 1) / reach)
    throw std::invalid_argument("levels must be positive and leave a coefficient, got " + std::to_string(levels) +
                                " for " + std::to_string(n) + " samples and " + std::to_string(reach + 1) + " taps");
  gmwm::AlignedArray variance = gmwm::aligned_array(levels);
  {
    const nb::gil_scoped_release release;
    gmwm::pyramid_variance(view(x), view(scaling), view(wavelet), {variance.get(), levels});
  }
  return to_numpy(std::move(variance), levels);
}

std::pair<Result, Result> pyramid_step(const Vector& smooth, const Vector& scaling, const Vector& wavelet,
                                       std::size_t stride) {
  check_filters(scaling, wavelet);
  const std::size_t n = smooth.shape(0);
  check_same(n, n, stride);
  gmwm::AlignedArray next = gmwm::aligned_array(n), detail = gmwm::aligned_array(n);
  {
    const nb::gil_scoped_release release;
    gmwm::pyramid_step(view(smooth), view(scaling), view(wavelet), stride, {next.get(), n}, {detail.get(), n});
  }
  return {to_numpy(std::move(next), n), to_numpy(std::move(detail), n)};
}

Result pyramid_unstep(const Vector& smooth, const Vector& detail, const Vector& scaling, const Vector& wavelet,
                      std::size_t stride) {
  check_filters(scaling, wavelet);
  const std::size_t n = smooth.shape(0);
  check_same(n, detail.shape(0), stride);
  gmwm::AlignedArray before = gmwm::aligned_array(n);
  {
    const nb::gil_scoped_release release;
    gmwm::pyramid_unstep(view(smooth), view(detail), view(scaling), view(wavelet), stride, {before.get(), n});
  }
  return to_numpy(std::move(before), n);
}

}  // namespace

void bind_pyramid(nb::module_& m) {
  m.def("pyramid_variance", &pyramid_variance, "x"_a.noconvert(), "scaling"_a.noconvert(), "wavelet"_a.noconvert(),
        "levels"_a,
        "Return the MODWT wavelet variance of x at levels 1 ... levels. All are NaN if a value is not finite.");
  m.def("pyramid_step", &pyramid_step, "smooth"_a.noconvert(), "scaling"_a.noconvert(), "wavelet"_a.noconvert(),
        "stride"_a, "Compute one level of the periodic MODWT. Return its scaling and its wavelet coefficients.");
  m.def("pyramid_unstep", &pyramid_unstep, "smooth"_a.noconvert(), "detail"_a.noconvert(), "scaling"_a.noconvert(),
        "wavelet"_a.noconvert(), "stride"_a,
        "Invert `pyramid_step`: return the scaling coefficients of the level before.");
}
