#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <span>
#include <stdexcept>
#include <string>

#include "gmwm/clusters.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Input = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

void check(const Input& phase, std::size_t n, std::size_t stride, std::size_t most) {
  if (n < 1 || n > most)
    throw std::invalid_argument("n must be from 1 to " + std::to_string(most) + " for " +
                                std::to_string(phase.shape(0)) + " values of the phase, got " + std::to_string(n));
  if (stride < 1) throw std::invalid_argument("stride must be positive, got 0");
}

// Largest cluster size whose differences of this order fit.
std::size_t largest(const Input& phase, std::size_t order) {
  return phase.shape(0) == 0 ? 0 : (phase.shape(0) - 1) / order;
}

double second_differences(const Input& phase, std::size_t n, std::size_t stride) {
  check(phase, n, stride, largest(phase, 2));
  const nb::gil_scoped_release release;
  return gmwm::second_differences({phase.data(), phase.shape(0)}, n, stride);
}

double third_differences(const Input& phase, std::size_t n, std::size_t stride) {
  check(phase, n, stride, largest(phase, 3));
  const nb::gil_scoped_release release;
  return gmwm::third_differences({phase.data(), phase.shape(0)}, n, stride);
}

double moving_second_differences(const Input& phase, std::size_t n) {
  check(phase, n, 1, phase.shape(0) / 3);
  const nb::gil_scoped_release release;
  return gmwm::moving_second_differences({phase.data(), phase.shape(0)}, n);
}

double reflected_second_differences(const Input& phase, std::size_t n) {
  check(phase, n, 1, phase.shape(0) < 3 ? 0 : phase.shape(0) - 2);
  const nb::gil_scoped_release release;
  return gmwm::reflected_second_differences({phase.data(), phase.shape(0)}, n);
}

}  // namespace

void bind_clusters(nb::module_& m) {
  m.def("second_differences", &second_differences, "phase"_a.noconvert(), "n"_a, "stride"_a = 1,
        "Sum of the squared second differences of the phase at lag n, at every stride-th place.");
  m.def("third_differences", &third_differences, "phase"_a.noconvert(), "n"_a, "stride"_a = 1,
        "Sum of the squared third differences of the phase at lag n, at every stride-th place.");
  m.def("moving_second_differences", &moving_second_differences, "phase"_a.noconvert(), "n"_a,
        "Sum of the squares of the moving sums, over n places, of the second differences at lag n.");
  m.def("reflected_second_differences", &reflected_second_differences, "phase"_a.noconvert(), "n"_a,
        "Sum of the squared second differences at lag n of the phase, continued beyond its ends by half a turn.");
}
