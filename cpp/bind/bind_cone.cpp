#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cmath>
#include <tuple>

#include "gmwm/cone.hpp"

namespace nb = nanobind;

namespace {

using Vector = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Matrix = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Result = nb::ndarray<nb::numpy, double, nb::ndim<1>>;

template <class Array>
std::span<const double> span_of(const Array& array) {
  return {array.data(), array.size()};
}

Result numbers(std::size_t size) {
  auto* data = new double[size]();
  nb::capsule owner(data, [](void* p) noexcept { delete[] static_cast<double*>(p); });
  return Result(data, {size}, owner);
}

void require(bool condition, const char* message) {
  if (!condition) throw nb::value_error(message);
}

gmwm::Cone cone_of(const Vector& target, const Matrix& fixed, const Vector& positive, const Matrix& values,
                   const Matrix& slopes, const Vector& margins) {
  const std::size_t dim = target.size();
  require(fixed.shape(1) == dim && positive.size() == dim && values.shape(1) == dim && slopes.shape(1) == dim,
          "all vectors must have the length of the target");
  require(values.shape(0) == slopes.shape(0) && values.shape(0) != 1 &&
              margins.size() + (values.shape(0) > 0) == values.shape(0),
          "a curve has as many slopes as values, and one margin less");
  for (const auto& numbers : {span_of(target), span_of(fixed), span_of(positive), span_of(values), span_of(slopes), span_of(margins)})
    require(std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); }),
            "all numbers must be finite");
  return {span_of(target), span_of(fixed), span_of(positive),
          gmwm::Curve(dim, span_of(values), span_of(slopes), span_of(margins), span_of(positive))};
}

void require_on_curve(const Vector& starts, const Matrix& values) {
  for (const double s : span_of(starts))
    require(s >= 0 && s <= static_cast<double>(values.shape(0)) - 1, "starts must lie on the curve");
}

Result positions_of(const gmwm::Point& point) {
  Result result = numbers(point.atoms.size());
  for (std::size_t i = 0; i < point.atoms.size(); ++i) result.data()[i] = point.atoms[i].position;
  return result;
}

}  // namespace

void bind_cone(nb::module_& m) {
  m.def(
      "nonnegative_least_squares",
      [](Vector target, Matrix columns) {
        require(columns.shape(1) == target.size(), "each row of columns must have the length of the target");
        Result weights = numbers(columns.shape(0));
        gmwm::NonNegative solver(span_of(target));
        std::vector<const double*> pointers;
        for (std::size_t k = 0; k < columns.shape(0); ++k) pointers.push_back(columns.data() + k * target.size());
        std::vector<double> x(columns.shape(0), 0.0);
        solver.solve(pointers, x);
        std::copy(x.begin(), x.end(), weights.data());
        return std::make_tuple(weights, solver.objective());
      },
      nb::arg("target").noconvert(), nb::arg("columns").noconvert());

  m.def(
      "cone_refine",
      [](Vector target, Matrix fixed, Vector positive, Matrix values, Matrix slopes, Vector margins, Vector starts) {
        require_on_curve(starts, values);
        gmwm::Cone cone = cone_of(target, fixed, positive, values, slopes, margins);
        gmwm::Point point;
        {
          nb::gil_scoped_release release;
          point = cone.refine(span_of(starts));
        }
        return nb::make_tuple(positions_of(point), point.objective);
      },
      nb::arg("target").noconvert(), nb::arg("fixed").noconvert(), nb::arg("positive").noconvert(),
      nb::arg("values").noconvert(), nb::arg("slopes").noconvert(), nb::arg("margins").noconvert(),
      nb::arg("starts").noconvert());

  m.def(
      "cone_search",
      [](Vector target, Matrix fixed, Vector positive, Matrix values, Matrix slopes, Vector margins, std::size_t count,
         double gap, std::size_t max_nodes, Vector starts) {
        require(count > 0 && values.shape(0) > 0, "a search needs a curve, and at least one point of it");
        require_on_curve(starts, values);
        gmwm::Cone cone = cone_of(target, fixed, positive, values, slopes, margins);
        gmwm::Certified found;
        {
          nb::gil_scoped_release release;
          found = cone.search(count, gap, max_nodes, span_of(starts));
        }
        nb::list candidates;
        for (const gmwm::Point& point : found.best)
          candidates.append(nb::make_tuple(point.objective, positions_of(point)));
        return nb::make_tuple(candidates, found.bound, found.relaxed, found.nodes);
      },
      nb::arg("target").noconvert(), nb::arg("fixed").noconvert(), nb::arg("positive").noconvert(),
      nb::arg("values").noconvert(), nb::arg("slopes").noconvert(), nb::arg("margins").noconvert(), nb::arg("count"),
      nb::arg("gap"), nb::arg("max_nodes"), nb::arg("starts").noconvert());
}
