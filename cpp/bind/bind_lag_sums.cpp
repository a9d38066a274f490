#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>

#include <cstdint>
#include <numbers>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/lag_sums.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;

namespace {

using Process = std::tuple<double, double, Vector, Matrix, Input<std::uint8_t, 1>>;
using Sums = std::tuple<Result, Result>;

std::span<const double> row(const Matrix& exponentials, std::size_t k) {
  return {exponentials.data() + k * exponentials.shape(1), exponentials.shape(1)};
}

gmwm::LagProcess process_of(const Process& given) {
  const auto& [white, walk, spikes, exponentials, bare] = given;
  if (exponentials.shape(0) != 4 || bare.size() != exponentials.shape(1))
    throw nb::value_error("exponentials must have four rows, and bare must be as long as one of them");
  const gmwm::LagProcess process{white, walk, view(spikes), row(exponentials, 0), row(exponentials, 1),
                                 row(exponentials, 2), row(exponentials, 3), view(bare)};
  for (std::size_t p = 0; p < bare.size(); ++p) {
    const double re = process.decay_re[p], im = process.decay_im[p];
    if (!(re >= 0 && im >= 0 && im <= std::numbers::pi && re + im > 0 && re <= 700))
      throw nb::value_error("decays must have a real part from 0 to 700 and an imaginary part from 0 to pi");
  }
  return process;
}

Sums lag_sums(Input<std::int64_t, 1> levels, std::int64_t samples, bool diagonal, const Process& left,
              const std::optional<Process>& right) {
  const std::span<const std::int64_t> wanted{levels.data(), levels.size()};
  for (std::size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i] < 1 || wanted[i] > 60 || (i > 0 && wanted[i] <= wanted[i - 1]) ||
        (std::int64_t{1} << wanted[i]) > samples)
      throw nb::value_error("levels must ascend from 1, and 2^level not exceed samples");
  const std::size_t size = wanted.size(), pairs = diagonal ? size : size * (size + 1) / 2;
  std::vector<double> first(pairs), second(pairs);
  const gmwm::LagProcess one = process_of(left);
  if (right.has_value()) {
    const gmwm::LagProcess two = process_of(*right);
    const nb::gil_scoped_release release;
    gmwm::lag_sums(wanted, samples, diagonal, one, two, {first, second});
  } else {
    const nb::gil_scoped_release release;
    gmwm::lag_sums(wanted, samples, diagonal, one, one, {first, second});
  }
  return {to_numpy(std::move(first)), to_numpy(std::move(second))};
}

}  // namespace

void bind_lag_sums(nb::module_& m) {
  m.def("lag_sums", &lag_sums, nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("diagonal"), nb::arg("left"),
        nb::arg("right").none(),
        "Sums over all lags of the covariances of Haar coefficients of one process, and of their products with those of\n"
        "another one; see `gmwm.theory.processes.exponential_sum`.");
}
