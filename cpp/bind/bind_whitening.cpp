#include <nanobind/nanobind.h>

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

void least_squares_innovations(const Matrix& responses, double unknown, const OutMatrix& information,
                               const OutVector& moments, const OutVector& e) {
  const std::size_t m = moments.size();
  if (m == 0 || responses.shape(0) != e.size() || responses.shape(1) != m || information.shape(0) != m ||
      information.shape(1) != m)
    throw nb::value_error("responses must be (n, m), information (m, m), moments (m) and e (n), m > 0");
  const nb::gil_scoped_release release;
  gmwm::least_squares_innovations(view(responses), unknown, view(information), view(moments), view(e));
}

}  // namespace

void bind_whitening(nb::module_& m) {
  m.def("second_order_sections", &second_order_sections, "sections"_a.noconvert(), "state"_a.noconvert(),
        "x"_a.noconvert(), "Filter x in place by second-order sections, and update their state.");
  m.def("least_squares_innovations", &least_squares_innovations, "responses"_a.noconvert(), "unknown"_a,
        "information"_a.noconvert(), "moments"_a.noconvert(), "e"_a.noconvert(),
        "Standardise innovations e in place, without the effect of an initial state that recursive least squares "
        "estimates; update its information and moments.");
}
