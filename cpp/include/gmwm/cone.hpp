// The nearest point to b in a cone spanned by a few fixed vectors and by points of a curve: with any number of curve
// points (convex), or with at most k of them (not convex: branch and bound over stretches of the curve).
//
//     minimise |b - sum_l c_l a_l - sum_i x_i g(s_i)|²   over c, x >= 0 and positions s_i
//
// Lower bounds come from the dual problem. They include the error margins of the tabulated curve, which limit how tight
// they are.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "gmwm/curve.hpp"
#include "gmwm/nonnegative.hpp"

namespace gmwm {

struct Atom {
  double position;
  double weight;
};

struct Point {
  double objective = 0;
  std::vector<double> linear;  // weights of the fixed vectors
  std::vector<Atom> atoms;     // ascending positions
};

struct Relaxed : Point {
  double bound = 0;  // lower bound of the distance of all points of the relaxed cone
};

struct Certified {
  std::vector<Point> best;  // distinct local optima, best first
  double bound = 0;         // lower bound for combinations of at most k curve points
  double relaxed = 0;       // lower bound for any number of curve points
  std::size_t nodes = 0;    // nodes of the search tree that were solved
};

class Cone {
 public:
  // fixed: rows of length dim, about unit norm; positive: z with <z, .> > 0 on the whole cone.
  // Several cones can share a curve.
  Cone(std::span<const double> target, std::span<const double> fixed, std::span<const double> positive,
       std::shared_ptr<const Curve> curve);

  // The convex relaxation: any number of curve points at any positions.
  Relaxed relax();

  // The local optimum that starts from the given curve points, with the same number of points.
  Point refine(std::span<const double> positions);

  // The optimum with at most k curve points. Stops when the best point is within `gap` (relative) of the bound, or
  // after `max_nodes`. `starts`: start positions (k each) of additional local searches.
  Certified search(std::size_t k, double gap, std::size_t max_nodes, std::span<const double> starts);

 private:
  struct Interval {
    Range range;
    std::size_t capacity;
  };
  using Box = std::vector<Interval>;
  struct Node {
    Box box;
    double bound;
    std::vector<Atom> atoms;
  };

  Relaxed solve_relaxation(const Box& box, const std::vector<Atom>& warm, double cutoff, double accuracy);
  void solve_weights(std::vector<Atom>& atoms, std::vector<double>& linear);
  Point refine(std::vector<Atom> atoms, std::size_t k);
  bool descend(std::vector<Atom>& atoms, Point& point);
  bool fill_up(std::vector<Atom>& atoms, std::size_t k);
  double dual_bound(double steepest) const;
  void remember(Certified& result, Point point) const;
  void local_searches(Certified& result, const std::vector<Atom>& atoms, std::size_t k);
  std::vector<Node> split(const Node& node) const;

  std::size_t dim_;
  std::vector<double> target_;
  std::vector<double> fixed_;
  std::vector<double> positive_;
  std::shared_ptr<const Curve> shared_;
  const Curve& curve_;
  Curve::Scratch scratch_;
  NonNegative nonnegative_;
  std::vector<Peak> peaks_;
  std::vector<double> columns_;
  std::vector<const double*> pointers_;
  std::vector<double> weights_;
};

}  // namespace gmwm
