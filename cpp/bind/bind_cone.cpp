#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/cone.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;

namespace {

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
  for (const auto& numbers : {view(target), view(fixed), view(positive), view(values), view(slopes), view(margins)})
    require(std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); }),
            "all numbers must be finite");
  return {view(target), view(fixed), view(positive),
          std::make_shared<const gmwm::Curve>(dim, view(values), view(slopes), view(margins), view(positive))};
}

void require_on_curve(const Vector& starts, const Matrix& values) {
  for (const double s : view(starts))
    require(s >= 0 && s <= static_cast<double>(values.shape(0)) - 1, "starts must lie on the curve");
}

Result positions_of(const gmwm::Point& point) {
  std::vector<double> positions;
  for (const auto& atom : point.atoms) positions.push_back(atom.position);
  return to_numpy(std::move(positions));
}

}  // namespace

void bind_cone(nb::module_& m) {
  m.def(
      "nonnegative_least_squares",
      [](Vector target, Matrix columns) {
        require(columns.shape(1) == target.size(), "each row of columns must have the length of the target");
        gmwm::NonNegative solver(view(target));
        std::vector<const double*> pointers;
        for (std::size_t k = 0; k < columns.shape(0); ++k) pointers.push_back(columns.data() + k * target.size());
        std::vector<double> x(columns.shape(0), 0.0);
        solver.solve(pointers, x);
        const double objective = solver.objective();
        return std::make_tuple(to_numpy(std::move(x)), objective);
      },
      nb::arg("target").noconvert(), nb::arg("columns").noconvert(),
      "Weights, none negative, whose sum of the rows of `columns` comes nearest to target, and the objective.");

  m.def(
      "often_near",
      [](Matrix data, Vector limits, Matrix columns, double most) {
        require(data.shape(0) == limits.size() && (limits.size() == 0 || columns.shape(1) == data.shape(1)),
                "each row of the data has a limit, and the columns are as long as the data");
        return gmwm::often_near(view(data), view(limits), view(columns), most);
      },
      nb::arg("data").noconvert(), nb::arg("limits").noconvert(), nb::arg("columns").noconvert(), nb::arg("most"),
      "Whether more than `most` rows of the data are within their limit, a squared distance, of a sum of the rows of "
      "`columns` with weights of which none is negative.");

  m.def(
      "cone_refine",
      [](Vector target, Matrix fixed, Vector positive, Matrix values, Matrix slopes, Vector margins, Vector starts) {
        require_on_curve(starts, values);
        gmwm::Cone cone = cone_of(target, fixed, positive, values, slopes, margins);
        gmwm::Point point;
        {
          nb::gil_scoped_release release;
          point = cone.refine(view(starts));
        }
        return std::make_tuple(positions_of(point), point.objective);
      },
      nb::arg("target").noconvert(), nb::arg("fixed").noconvert(), nb::arg("positive").noconvert(),
      nb::arg("values").noconvert(), nb::arg("slopes").noconvert(), nb::arg("margins").noconvert(),
      nb::arg("starts").noconvert(),
      "Descend from starts on the curve to a local optimum: its places on the curve, and the objective.");

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
          found = cone.search(count, gap, max_nodes, view(starts));
        }
        std::vector<std::tuple<double, Result>> candidates;
        for (const gmwm::Point& point : found.best) candidates.emplace_back(point.objective, positions_of(point));
        return std::make_tuple(std::move(candidates), found.bound, found.relaxed, found.nodes);
      },
      nb::arg("target").noconvert(), nb::arg("fixed").noconvert(), nb::arg("positive").noconvert(),
      nb::arg("values").noconvert(), nb::arg("slopes").noconvert(), nb::arg("margins").noconvert(), nb::arg("count"),
      nb::arg("gap"), nb::arg("max_nodes"), nb::arg("starts").noconvert(),
      "Search for the global optimum by branch and bound: the best points with their objectives, the lower bound, that "
      "of the convex relaxation, and the number of nodes.");
}
