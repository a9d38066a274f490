#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/descent.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

using Indices = Input<std::int64_t, 1>;

void require(bool condition, const char* message) {
  if (!condition) throw nb::value_error(message);
}

bool finite(std::span<const double> numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

// A shape whose variances and derivatives are computed by Python functions of its coordinates.
class GivenShape final : public gmwm::Shape {
 public:
  GivenShape(std::size_t dim, nb::object values, nb::object slopes, std::vector<double> low, std::vector<double> high)
      : Shape(std::move(low), std::move(high)), dim_(dim), values_(std::move(values)), slopes_(std::move(slopes)) {}

  bool values(const double* z, double* out) const override {
    const nb::object found = values_(copied(z));
    if (found.is_none()) return false;
    copy(nb::cast<Vector>(found), dim_, out);
    return true;
  }
  void slopes(const double* z, double* out) const override {
    copy(nb::cast<Matrix>(slopes_(copied(z))), size() * dim_, out);
  }

 private:
  Result copied(const double* z) const { return to_numpy(std::vector<double>(z, z + size())); }
  template <class Array>
  static void copy(const Array& array, std::size_t count, double* out) {
    require(array.size() == count, "a shape has a value for each level, and a derivative by each coordinate");
    std::copy_n(array.data(), count, out);
  }

  std::size_t dim_;
  nb::object values_, slopes_;
};

// The descent, and whether it calls Python functions.
struct Kernel {
  gmwm::Descent descent;
  bool given = false;
};

using Found = std::tuple<double, Result, Result, Result>;
using Curved = std::tuple<std::vector<bool>, std::vector<double>>;

Kernel kernel_of(Vector target, Matrix fixed, Matrix root, double rounding) {
  const std::size_t dim = target.size();
  require(dim > 0 && fixed.shape(1) == dim && root.shape(0) == dim && root.shape(1) == dim,
          "all vectors must have the length of the target");
  for (const auto& numbers : {view(target), view(fixed), view(root)}) require(finite(numbers), "all numbers must be finite");
  return {gmwm::Descent(view(target), view(fixed), view(root), rounding)};
}

std::pair<std::vector<double>, std::vector<double>> ends_of(const Matrix& ends) {
  require(ends.shape(1) == 2 && ends.shape(0) > 0, "each coordinate has two ends");
  std::pair<std::vector<double>, std::vector<double>> found;
  for (std::size_t k = 0; k < ends.shape(0); ++k) {
    require(ends.data()[2 * k] < ends.data()[2 * k + 1], "the ends must ascend");
    found.first.push_back(ends.data()[2 * k]), found.second.push_back(ends.data()[2 * k + 1]);
  }
  return found;
}

void add_exponential(Kernel& kernel, Vector half_scales, Vector branch, double rate, bool innovation) {
  require(half_scales.size() == kernel.descent.dim(), "each level has a half-scale");
  require(branch.size() == 5 && finite(view(branch)) && branch.data()[0] < branch.data()[1] && branch.data()[2] > 0 && rate > 0,
          "a branch has five numbers, and must ascend");
  const double* row = branch.data();
  const gmwm::ExponentialBranch along{row[0], row[1], row[2], row[3], row[4], false, false};
  kernel.descent.add_branch(std::make_unique<gmwm::ExponentialShape>(
      gmwm::ExponentialCurve(view(half_scales), {&along, 1}, rate, innovation)));
}

void add_arma(Kernel& kernel, const std::array<std::size_t, 5>& given, Indices levels, Vector odd, Matrix ends) {
  const gmwm::ArmaOrders orders{given[0], given[1], given[2], given[3], given[4]};
  require(levels.size() == kernel.descent.dim() && ends.shape(0) == orders.parameters() && orders.period >= 1 &&
              std::all_of(given.begin(), given.end(), [](std::size_t n) { return n <= 1024; }),
          "there is a level for each number of the target, and a coordinate for each order");
  for (std::size_t j = 0; j < levels.size(); ++j)
    require(levels.data()[j] > (j ? levels.data()[j - 1] : 0) && levels.data()[j] <= 60, "levels must ascend from 1");
  auto [low, high] = ends_of(ends);
  kernel.descent.add_free(
      std::make_unique<gmwm::ArmaShape>(orders, view(levels), view(odd), std::move(low), std::move(high)));
}

void add_oscillator(Kernel& kernel, Vector half_scales, double rate, Matrix ends) {
  require(half_scales.size() == kernel.descent.dim() && ends.shape(0) == 2 && rate > 0,
          "each level has a half-scale, and there are two coordinates");
  auto [low, high] = ends_of(ends);
  kernel.descent.add_free(
      std::make_unique<gmwm::OscillatorShape>(view(half_scales), rate, std::move(low), std::move(high)));
}

void add_given(Kernel& kernel, nb::object values, nb::object slopes, Matrix ends, bool branch) {
  require(PyCallable_Check(values.ptr()) && PyCallable_Check(slopes.ptr()), "a shape is given by two functions");
  require(!branch || ends.shape(0) == 1, "a branch has one coordinate");
  auto [low, high] = ends_of(ends);
  auto shape = std::make_unique<GivenShape>(kernel.descent.dim(), std::move(values), std::move(slopes), std::move(low),
                                            std::move(high));
  kernel.given = true;
  if (branch)
    kernel.descent.add_branch(std::move(shape));
  else
    kernel.descent.add_free(std::move(shape));
}

gmwm::ShapePoint point_of(const Kernel& kernel, const Indices& branches, const Vector& x) {
  require(x.size() == kernel.descent.coordinates(branches.size()), "a point has a number for each coordinate");
  gmwm::ShapePoint point;
  for (const std::int64_t branch : view(branches)) {
    require(branch >= 0 && branch < static_cast<std::int64_t>(kernel.descent.branches()), "there is no such branch");
    point.branches.push_back(static_cast<std::size_t>(branch));
  }
  point.x.assign(x.data(), x.data() + x.size());
  return point;
}

Found as_tuple(gmwm::Projected found) {
  return {found.objective, to_numpy(std::move(found.point.x)), to_numpy(std::move(found.weights)),
          to_numpy(std::move(found.lengths))};
}

// Without the lock, unless Python functions are called.
template <class Work>
auto unlocked(const Kernel& kernel, Work work) {
  std::optional<nb::gil_scoped_release> release;
  if (!kernel.given) release.emplace();
  return work();
}

std::optional<Found> downhill(const Kernel& kernel, Indices branches, Vector x, std::size_t steps) {
  gmwm::ShapePoint point = point_of(kernel, branches, x);
  std::optional<gmwm::Projected> found = unlocked(kernel, [&] {
    std::optional<gmwm::Projected> start = kernel.descent.at(std::move(point));
    return start ? std::optional(kernel.descent.downhill(std::move(*start), steps)) : std::nullopt;
  });
  if (!found) return std::nullopt;
  return as_tuple(std::move(*found));
}

using Sharp = std::tuple<Found, std::optional<Curved>, bool>;

std::optional<Sharp> sharpen(const Kernel& kernel, Indices branches, Vector x, std::optional<Curved> curved) {
  gmwm::ShapePoint point = point_of(kernel, branches, x);
  std::optional<gmwm::Curvature> curvature;
  if (curved) {
    const auto& [able, hessian] = *curved;
    const auto count = static_cast<std::size_t>(std::count(able.begin(), able.end(), true));
    require(able.size() == x.size() && hessian.size() == count * count,
            "second derivatives belong to the coordinates that are marked");
    curvature = {{able.begin(), able.end()}, hessian};
  }
  bool rest = false;
  std::optional<gmwm::Projected> found = unlocked(kernel, [&] {
    std::optional<gmwm::Projected> start = kernel.descent.at(std::move(point));
    if (!start) return start;
    start = kernel.descent.sharpened(std::move(*start), curvature);
    rest = kernel.descent.at_rest(*start);
    return start;
  });
  if (!found) return std::nullopt;
  std::optional<Curved> then;
  if (curvature) then = Curved{{curvature->able.begin(), curvature->able.end()}, std::move(curvature->hessian)};
  return Sharp{as_tuple(std::move(*found)), std::move(then), rest};
}

}  // namespace

void bind_descent(nb::module_& m) {
  nb::class_<Kernel>(m, "Descent", "Local optima of a sum of fixed processes and of processes with shapes.")
      .def(nb::new_(&kernel_of), "target"_a.noconvert(), "fixed"_a.noconvert(), "root"_a.noconvert(), "rounding"_a)
      .def("add_exponential", &add_exponential, "half_scales"_a.noconvert(), "branch"_a.noconvert(), "rate"_a,
           "innovation"_a, "Add a branch (low, high, bend, least, sign) of processes with exponential autocovariances.")
      .def("add_arma", &add_arma, "orders"_a, "levels"_a.noconvert(), "odd"_a.noconvert(), "ends"_a.noconvert(),
           "Add an ARMA process with free coefficients.")
      .def("add_oscillator", &add_oscillator, "half_scales"_a.noconvert(), "rate"_a, "ends"_a.noconvert(),
           "Add a damped oscillator with free frequency and quality.")
      .def("add_given", &add_given, "values"_a, "slopes"_a, "ends"_a.noconvert(), "branch"_a,
           "Add a branch, or a process, by functions of the coordinates: the variances (or None) and their derivatives.")
      .def("downhill", &downhill, "branches"_a.noconvert(), "x"_a.noconvert(), "steps"_a,
           "Move a point by Levenberg-Marquardt steps: the objective, coordinates, weights, and lengths; None if there is "
           "no such process.")
      .def("sharpen", &sharpen, "branches"_a.noconvert(), "x"_a.noconvert(), "curvature"_a.none(),
           "Move a point by Newton steps: the same, the coordinates of the last second derivatives and these, and whether "
           "the gradient there is a rounding error.");
}
