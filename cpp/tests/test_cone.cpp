// The nearest point in a cone: non-negative least squares, the tabulated curve, the relaxation and branch and bound.
#include "gmwm/cone.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include "check.hpp"
#include "gmwm/dense.hpp"

namespace {

constexpr std::size_t dim = 12;

// A curve of unit vectors on which the solver has no business to know: v_j(u) = 1 / (1 + exp(j - u)), u = 12 s / nodes.
struct Tabulated {
  std::size_t nodes = 240;
  std::vector<double> values, slopes, margins;

  static std::vector<double> exact(double u) {
    std::vector<double> v(dim);
    double square = 0;
    for (std::size_t j = 0; j < dim; ++j) {
      v[j] = 1 / (1 + std::exp(static_cast<double>(j) - u));
      square += v[j] * v[j];
    }
    for (double& x : v) x /= std::sqrt(square);
    return v;
  }

  double coordinate(double s) const { return 12 * s / static_cast<double>(nodes); }

  Tabulated() {
    const double step = 1e-5;
    for (std::size_t i = 0; i < nodes; ++i) {
      const double u = coordinate(static_cast<double>(i));
      const auto here = exact(u), before = exact(u - step), after = exact(u + step);
      for (std::size_t j = 0; j < dim; ++j) {
        values.push_back(here[j]);
        slopes.push_back((after[j] - before[j]) / (2 * step) * 12 / static_cast<double>(nodes));
      }
    }
    margins.assign(nodes - 1, 1e-6);
  }
};

void test_nonnegative() {
  const std::vector<double> a{1, 0, 0}, b{0.6, 0.8, 0}, c{0, 0, 1}, target{1, -1, 2};
  const std::vector<const double*> columns{a.data(), b.data(), c.data()};
  std::vector<double> weights;
  gmwm::NonNegative solver(target);
  solver.solve(columns, weights);
  // A negative weight is zero.
  CHECK(weights[1] == 0 && std::abs(weights[0] - 1) < 1e-15 && std::abs(weights[2] - 2) < 1e-15);
  CHECK(std::abs(solver.objective() - 1) < 1e-15);  // objective of the projection
}

// Rows of data at known distances from the cone of two columns: the answer changes at the true number of near ones.
void test_often_near() {
  const std::vector<double> columns{1, 0, 0, 0.6, 0.8, 0};
  std::vector<double> data, limits;
  for (int i = 0; i < 40; ++i) {
    const double height = 0.1 * i;
    data.insert(data.end(), {2.0 + i % 3, 1.0, height});
    limits.push_back(1.1);  // reached up to the height 1
  }
  for (int most = 0; most < 40; ++most) CHECK(gmwm::often_near(data, limits, columns, most) == (most < 11));
  CHECK(!gmwm::often_near({}, {}, columns, 0) && gmwm::often_near(data, limits, columns, -1));
}

void test_curve(const Tabulated& t, gmwm::Curve& curve) {
  double worst = 0;
  std::vector<double> value(dim);
  for (double s = 0; s <= static_cast<double>(t.nodes - 1); s += 0.37) {
    curve.at(s, value.data());
    const auto exact = Tabulated::exact(t.coordinate(s));
    for (std::size_t j = 0; j < dim; ++j) worst = std::max(worst, std::abs(value[j] - exact[j]));
  }
  CHECK(worst < 1e-6);  // the cubic stays within its margin
  // The steepest ratio must bound what a fine scan of the exact curve finds.
  std::vector<double> direction(dim), z(dim, 1.0);
  for (std::size_t j = 0; j < dim; ++j) direction[j] = std::sin(1.7 * static_cast<double>(j + 1));
  std::vector<gmwm::Peak> peaks;
  gmwm::Curve::Scratch scratch;
  const gmwm::Range range{17.3, 203.8};
  const double bound = curve.steepest(direction, range, 0, peaks, scratch);
  double found = 0;
  for (double s = range.low; s <= range.high; s += 0.01) {
    const auto exact = Tabulated::exact(t.coordinate(s));
    found = std::max(found, gmwm::dot(direction.data(), exact.data(), dim) / gmwm::dot(z.data(), exact.data(), dim));
  }
  CHECK(bound >= found && bound < found * 1.01 + 1e-4);  // the steepest ratio is a bound, and a tight one
  CHECK(!peaks.empty());  // a rising stretch has a peak
}

// Two curve points plus a fixed vector and a disturbance; search for two and for one against a brute-force grid.
void test_search(const Tabulated& t, const gmwm::Curve& curve) {
  std::vector<double> target(dim), fixed(dim, 1 / std::sqrt(static_cast<double>(dim))), z(dim, 1.0);
  const auto first = Tabulated::exact(2.5), second = Tabulated::exact(8.1);
  for (std::size_t j = 0; j < dim; ++j)
    target[j] = 3 * first[j] + 2 * second[j] + 0.5 * fixed[j] + 0.05 * std::cos(9.0 * static_cast<double>(j));
  for (const std::size_t count : {1u, 2u}) {
    gmwm::Cone cone(target, fixed, z, std::make_shared<const gmwm::Curve>(curve));
    const gmwm::Certified found = cone.search(count, 1e-4, 20000, {});
    const double objective = found.best.front().objective;
    CHECK(found.bound <= objective && found.bound >= 0.999 * objective);  // the search closes its gap
    CHECK(found.relaxed <= found.bound * (1 + 1e-12));  // more points never do worse
    double best = 1e300;
    for (double s = 0; s < static_cast<double>(t.nodes); s += 2)
      for (double r = count == 1 ? s : 0; r <= s; r += 2) {
        const auto p = Tabulated::exact(t.coordinate(s)), q = Tabulated::exact(t.coordinate(r));
        const std::vector<const double*> columns{fixed.data(), p.data(), q.data()};
        std::vector<double> weights;
        gmwm::NonNegative solver(target);
        solver.solve({columns.data(), count + 1}, weights);
        best = std::min(best, solver.objective());
      }
    CHECK(objective <= best * (1 + 1e-6));  // no grid point beats the search
    CHECK(found.bound <= best);  // the bound is below every grid point
  }
}

}  // namespace

int main() {
  return check::at_each_level("cone", [] {
    const Tabulated t;
    const std::vector<double> z(dim, 1.0);
    gmwm::Curve curve(dim, t.values, t.slopes, t.margins, z);
    test_nonnegative();
    test_often_near();
    test_curve(t, curve);
    test_search(t, curve);
  });
}
