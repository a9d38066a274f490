#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "gmwm/buffer.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/pyramid.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Input = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Output = nb::ndarray<nb::numpy, double, nb::ndim<1>>;

std::span<const double> view(const Input& array) { return {array.data(), array.shape(0)}; }

Output to_numpy(gmwm::AlignedArray values, std::size_t n) {
  double* data = values.get();
  auto kept = std::make_unique<gmwm::AlignedArray>(std::move(values));
  nb::capsule owner(kept.get(), [](void* p) noexcept { delete static_cast<gmwm::AlignedArray*>(p); });
  kept.release();
  return Output(data, {n}, owner);
}

void check_filters(const Input& scaling, const Input& wavelet) {
  if (scaling.shape(0) < 2 || scaling.shape(0) != wavelet.shape(0))
    throw std::invalid_argument("scaling and wavelet must have the same number of taps, 2 or more, got " +
                                std::to_string(scaling.shape(0)) + " and " + std::to_string(wavelet.shape(0)));
}

void check_same(std::size_t n, std::size_t other, std::size_t stride) {
  if (n == 0 || n != other || stride == 0)
    throw std::invalid_argument("smooth and detail must have the same size, not 0, and stride must be positive, got " +
                                std::to_string(n) + ", " + std::to_string(other) + " and " + std::to_string(stride));
}

Output pyramid_variance(const Input& x, const Input& scaling, const Input& wavelet, std::size_t levels) {
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

nb::tuple pyramid_step(const Input& smooth, const Input& scaling, const Input& wavelet, std::size_t stride) {
  check_filters(scaling, wavelet);
  const std::size_t n = smooth.shape(0);
  check_same(n, n, stride);
  gmwm::AlignedArray next = gmwm::aligned_array(n), detail = gmwm::aligned_array(n);
  {
    const nb::gil_scoped_release release;
    gmwm::pyramid_step(view(smooth), view(scaling), view(wavelet), stride, {next.get(), n}, {detail.get(), n});
  }
  return nb::make_tuple(to_numpy(std::move(next), n), to_numpy(std::move(detail), n));
}

Output pyramid_unstep(const Input& smooth, const Input& detail, const Input& scaling, const Input& wavelet,
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
        "levels"_a, "Wavelet variance of x at levels 1 ... levels by the MODWT; all NaN if a value is not finite.");
  m.def("pyramid_step", &pyramid_step, "smooth"_a.noconvert(), "scaling"_a.noconvert(), "wavelet"_a.noconvert(),
        "stride"_a, "One level of the periodic MODWT: the next scaling and the wavelet coefficients.");
  m.def("pyramid_unstep", &pyramid_unstep, "smooth"_a.noconvert(), "detail"_a.noconvert(), "scaling"_a.noconvert(),
        "wavelet"_a.noconvert(), "stride"_a, "The scaling coefficients from which pyramid_step made these.");
}
