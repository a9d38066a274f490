#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/sketch.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

using Counts = std::tuple<std::uint64_t, std::uint64_t, std::size_t, Output<std::int64_t>, Output<std::int64_t>>;

Output<std::int64_t> whole_numbers(const std::vector<std::uint64_t>& values) {
  return to_numpy(std::vector<std::int64_t>(values.begin(), values.end()));
}

Counts to_python(const gmwm::SketchCounts& found) {
  return {found.zeros, found.beyond, found.first, whole_numbers(found.counts), whole_numbers(found.sums)};
}

Counts sketch_values(const Vector& values) {
  gmwm::SketchCounts found;
  {
    const nb::gil_scoped_release release;
    found = gmwm::sketch_values(view(values));
  }
  return to_python(found);
}

Counts haar_sketch(const Vector& running_sum, std::size_t level, std::size_t begin, std::size_t end) {
  const std::size_t n = running_sum.shape(0);
  if (level < 1 || level > gmwm::max_level || n <= (std::size_t{1} << level))
    throw std::invalid_argument("level must be from 1 to log2 of the number of samples, got " + std::to_string(level) +
                                " for a running sum of " + std::to_string(n) + " values");
  if (begin > end || end > n - 1)
    throw std::invalid_argument("begin and end must satisfy 0 <= begin <= end <= " + std::to_string(n - 1) + ", got " +
                                std::to_string(begin) + " and " + std::to_string(end));
  gmwm::SketchCounts found;
  {
    const nb::gil_scoped_release release;
    found = gmwm::haar_sketch(view(running_sum), level, begin, end);
  }
  return to_python(found);
}

}  // namespace

void bind_sketch(nb::module_& m) {
  m.def("sketch_values", &sketch_values, "values"_a.noconvert(),
        "Count |value| in bins of 1/128 octave. Return the numbers of zeros and of infinite values, the first "
        "octave, and, for all bins from this octave on, the counts and the sums of (|value| - lower edge) / width in "
        "units of 2^-24.");
  m.def("haar_sketch", &haar_sketch, "running_sum"_a.noconvert(), "level"_a, "begin"_a, "end"_a,
        "Return `sketch_values` of the Haar coefficients W_{j,t} of one level with begin <= t < end and t >= 2^j - 1.");
}
