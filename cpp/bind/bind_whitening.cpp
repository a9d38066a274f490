#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <cstddef>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/whitening.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

void second_order_sections(const Matrix& sections, const OutMatrix& state, const OutVector& x) {
  if (sections.shape(1) != 6 || state.shape(0) != sections.shape(0) || state.shape(1) != 2)
    throw nb::value_error("sections must be (k, 6), and their state (k, 2)");
  const nb::gil_scoped_release release;
  gmwm::second_order_sections(view(sections), view(state), view(x));
}

std::tuple<Result, Result, Result, std::size_t> subtract_initial_state(
    const Matrix& responses, const Matrix& step, double unknown, double negligible, const Matrix& power,
    const Matrix& information, const Vector& moments, std::size_t count, const OutVector& e) {
  const std::size_t p = responses.shape(0), m = moments.size();
  if (responses.size() == 0 || step.shape(0) != p || step.shape(1) != p || power.shape(0) != p || power.shape(1) != m ||
      information.shape(0) != m || information.shape(1) != m)
    throw nb::value_error("responses must be (p, n), step (p, p), power (p, m), information (m, m) and moments (m)");
  const auto copy = [](const auto& array) {
    return std::vector<double>(array.data(), array.data() + array.size());
  };
  gmwm::InitialState state{copy(power), copy(information), copy(moments), count};
  {
    const nb::gil_scoped_release release;
    gmwm::subtract_initial_state(view(responses), view(step), unknown, negligible, state, view(e));
  }
  return {to_numpy(std::move(state.power)), to_numpy(std::move(state.information)), to_numpy(std::move(state.moments)),
          state.count};
}

Result block_mean_squares(const Vector& sums, std::size_t m, std::size_t length) {
  if (m < 2 || (m & (m - 1)) != 0 || m > sums.size() || length == 0 || length > sums.size())
    throw nb::value_error("m must be a power of two from 2 on, and m and length at most the number of sums");
  std::vector<double> blocks;
  {
    const nb::gil_scoped_release release;
    blocks = gmwm::block_mean_squares(view(sums), m, length);
  }
  return to_numpy(std::move(blocks));
}

}  // namespace

void bind_whitening(nb::module_& m) {
  m.def("second_order_sections", &second_order_sections, "sections"_a.noconvert(), "state"_a.noconvert(),
        "x"_a.noconvert(), "Filter x in place by second-order sections, and update their state.");
  m.def("subtract_initial_state", &subtract_initial_state, "responses"_a.noconvert(), "step"_a.noconvert(), "unknown"_a,
        "negligible"_a, "power"_a.noconvert(), "information"_a.noconvert(), "moments"_a.noconvert(), "count"_a,
        "e"_a.noconvert(),
        "Standardise innovations e in place, without the effect of an initial state that recursive least squares "
        "estimates. Return its power, information and moments as vectors, and the number of samples so far.");
  m.def("block_mean_squares", &block_mean_squares, "sums"_a.noconvert(), "m"_a, "length"_a,
        "Return the mean squares of Haar coefficients of m sums in blocks of `length` coefficients.");
}
