#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>

#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "arrays.hpp"
#include "gmwm/clusters.hpp"
#include "gmwm/haar.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {


std::pair<Result, Result> octave_second_differences(const Vector& x, std::size_t octaves) {
  const std::size_t n = x.shape(0);
  if (octaves < 1 || octaves > gmwm::max_level || (std::size_t{1} << octaves) > n)
    throw std::invalid_argument("octaves must be from 1 to log2 of the number of samples, got " +
                                std::to_string(octaves) + " for " + std::to_string(n) + " samples");
  gmwm::AlignedArray phase = gmwm::aligned_array(n + 1), sums = gmwm::aligned_array(octaves);
  {
    const nb::gil_scoped_release release;
    const std::span<const double> values{x.data(), n};
    gmwm::octave_second_differences(values, gmwm::mean(values).value, {phase.get(), n + 1}, {sums.get(), octaves});
  }
  return {to_numpy(std::move(phase), n + 1), to_numpy(std::move(sums), octaves)};
}

void check(const Vector& phase, std::size_t n, std::size_t stride, std::size_t most) {
  if (n < 1 || n > most)
    throw std::invalid_argument("n must be from 1 to " + std::to_string(most) + " for " +
                                std::to_string(phase.shape(0)) + " values of the phase, got " + std::to_string(n));
  if (stride < 1) throw std::invalid_argument("stride must be positive, got 0");
}

// Largest cluster size for which differences of this order fit into the phase.
std::size_t largest(const Vector& phase, std::size_t order) {
  return phase.shape(0) == 0 ? 0 : (phase.shape(0) - 1) / order;
}

double second_differences(const Vector& phase, std::size_t n, std::size_t stride) {
  check(phase, n, stride, largest(phase, 2));
  const nb::gil_scoped_release release;
  return gmwm::second_differences({phase.data(), phase.shape(0)}, n, stride);
}

double third_differences(const Vector& phase, std::size_t n, std::size_t stride) {
  check(phase, n, stride, largest(phase, 3));
  const nb::gil_scoped_release release;
  return gmwm::third_differences({phase.data(), phase.shape(0)}, n, stride);
}

double moving_second_differences(const Vector& phase, std::size_t n) {
  check(phase, n, 1, phase.shape(0) / 3);
  const nb::gil_scoped_release release;
  return gmwm::moving_second_differences({phase.data(), phase.shape(0)}, n);
}

double reflected_second_differences(const Vector& phase, std::size_t n) {
  check(phase, n, 1, phase.shape(0) < 3 ? 0 : phase.shape(0) - 2);
  const nb::gil_scoped_release release;
  return gmwm::reflected_second_differences({phase.data(), phase.shape(0)}, n);
}

}  // namespace

void bind_clusters(nb::module_& m) {
  m.def("octave_second_differences", &octave_second_differences, "x"_a.noconvert(), "octaves"_a,
        "Return the running sum of x - mean(x), N + 1 values that start with 0, and the sums of its squared second "
        "differences at the lags 1, 2, 4, ... If a value is not finite, all values but the first are NaN.");
  m.def("second_differences", &second_differences, "phase"_a.noconvert(), "n"_a, "stride"_a = 1,
        "Return the sum of the squared second differences of the phase at lag n, at every stride-th index.");
  m.def("third_differences", &third_differences, "phase"_a.noconvert(), "n"_a, "stride"_a = 1,
        "Return the sum of the squared third differences of the phase at lag n, at every stride-th index.");
  m.def("moving_second_differences", &moving_second_differences, "phase"_a.noconvert(), "n"_a,
        "Return the sum of the squared moving sums, over n values, of the second differences at lag n.");
  m.def("reflected_second_differences", &reflected_second_differences, "phase"_a.noconvert(), "n"_a,
        "Return the sum of the squared second differences at lag n of the phase, which is extended beyond its ends by "
        "point reflection.");
}
