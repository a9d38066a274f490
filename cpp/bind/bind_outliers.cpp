#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/outliers.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

using Indices = Input<std::int64_t, 1>;

std::tuple<Output<std::int64_t>, Result, Result, double> large_coefficients(const Vector& path, double scale,
                                                                            std::size_t piece, double least,
                                                                            double limit) {
  if (path.size() < 3 || piece == 0) throw nb::value_error("path must have 3 values or more, and piece be positive");
  gmwm::LargeCoefficients found;
  {
    const nb::gil_scoped_release release;
    found = gmwm::large_coefficients(view(path), scale, piece, least, limit);
  }
  return {to_numpy(std::move(found.at)), to_numpy(std::move(found.w)), to_numpy(std::move(found.spread)), found.energy};
}

Result row_medians(const Matrix& rows) {
  if (rows.size() == 0) throw nb::value_error("rows must have values");
  std::vector<double> medians;
  {
    const nb::gil_scoped_release release;
    medians = gmwm::row_medians(view(rows), rows.shape(1));
  }
  return to_numpy(std::move(medians));
}

Result window_medians(const Vector& x, std::size_t width) {
  if (width == 0 || x.size() < width) throw nb::value_error("x must have `width` values or more, width > 0");
  std::vector<double> medians;
  {
    const nb::gil_scoped_release release;
    medians = gmwm::window_medians(view(x), width);
  }
  return to_numpy(std::move(medians));
}

Output<std::int64_t> uneven_rows(const Matrix& rows, double step, double times) {
  if (rows.size() == 0) throw nb::value_error("rows must have values");
  std::vector<std::int64_t> found;
  {
    const nb::gil_scoped_release release;
    found = gmwm::uneven_rows(view(rows), rows.shape(1), step, times);
  }
  return to_numpy(std::move(found));
}

Result neighbour_residuals(const Vector& x, const Vector& others, const Indices& at, std::size_t reach) {
  const std::size_t n = x.size();
  if (others.size() != n || reach == 0 || n == 0 || reach > (n - 1) / 2)
    throw nb::value_error("x and others must have the same size, more than 2 reach, reach > 0");
  for (const std::int64_t place : view(at))
    if (place < 0 || place >= static_cast<std::int64_t>(n)) throw nb::value_error("a place is outside the samples");
  std::vector<double> out(at.size());
  {
    const nb::gil_scoped_release release;
    gmwm::neighbour_residuals(view(x), view(others), view(at), reach, out);
  }
  return to_numpy(std::move(out));
}

Output<std::int64_t> bent_samples(const Vector& x, const Vector& limits, std::size_t length) {
  if (x.size() < 2 || limits.size() == 0 || length == 0)
    throw nb::value_error("x must have 2 samples or more, and there must be a limit and a length");
  std::vector<std::int64_t> found;
  {
    const nb::gil_scoped_release release;
    found = gmwm::bent_samples(view(x), view(limits), length);
  }
  return to_numpy(std::move(found));
}

}  // namespace

void bind_outliers(nb::module_& m) {
  m.def("large_coefficients", &large_coefficients, "path"_a.noconvert(), "scale"_a, "piece"_a, "least"_a, "limit"_a,
        "Return the indices and the values of the second differences of a path, times `scale`, that exceed `limit` "
        "local standard deviations. Return also the standard deviation of each piece, and the sum of all squares.");
  m.def("row_medians", &row_medians, "rows"_a.noconvert(), "Return the median of each row of finite values.");
  m.def("window_medians", &window_medians, "x"_a.noconvert(), "width"_a,
        "Return the medians of all windows of `width` consecutive values; those of windows with NaN are arbitrary.");
  m.def("uneven_rows", &uneven_rows, "rows"_a.noconvert(), "step"_a, "times"_a,
        "Return the indices of the rows that can have a value further from their median than `times` spreads: the "
        "smaller one of the standard deviation and of the median distance / 0.6745 + step, and at least step / 2.");
  m.def("neighbour_residuals", &neighbour_residuals, "x"_a.noconvert(), "others"_a.noconvert(), "at"_a.noconvert(),
        "reach"_a, "Return the samples x[at] minus the median of their neighbours in `others`, `reach` on each side.");
  m.def("bent_samples", &bent_samples, "x"_a.noconvert(), "limits"_a.noconvert(), "length"_a,
        "Return the indices of the samples whose distance from the mean of their two neighbours exceeds the limit of "
        "their block, and of the samples next to them.");
}
