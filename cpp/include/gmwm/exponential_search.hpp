// The optimum of a sum of fixed processes and of processes with exponential autocovariances: branch and bound on a
// tabulated curve, then refinement on the exact curve. The Python code does the same for other processes.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "gmwm/cone.hpp"
#include "gmwm/exponential_curve.hpp"

namespace gmwm {

// Nodes of the table: u of each node, its branch, the distance to the next node (0 at the end of a branch), values and
// slopes at the nodes, and values at the midpoints of the cells.
struct ExponentialTable {
  std::span<const std::int64_t> owner;
  std::span<const double> nodes, spacing, values, slopes, middles;
};

struct Place {
  std::size_t branch;
  double u;
};

// An upper triangular root of a weighting matrix (dim x dim).
class Root {
 public:
  explicit Root(std::span<const double> rows, std::size_t dim);

  // Multiplies rows of length dim by the root.
  void weigh(const double* rows, std::size_t count, double* out) const;

 private:
  std::size_t dim_;
  std::vector<double> columns_;   // columns of the root, each padded with zeros
  std::vector<double> diagonal_;  // the root if it is diagonal, otherwise empty
};

// The table under weights: unit vectors, and bounds of their interpolation error. It depends on neither the data nor the
// fixed processes, so that the searches for several models with the same weights share it.
class WeightedTable {
 public:
  // `positive`: a vector whose inner product with every weighted wavelet variance is positive. Errors of a cell are
  // bounded by `safety` times the largest one at the midpoints of this cell and of as many `neighbours` on each side.
  WeightedTable(const ExponentialTable& table, std::span<const double> root, std::span<const double> positive,
                double safety, std::size_t neighbours);

  std::size_t nodes() const { return nodes_.size(); }
  std::size_t dim() const { return curve_->dim(); }
  std::size_t branches() const { return static_cast<std::size_t>(owner_.back()) + 1; }
  const std::shared_ptr<const Curve>& curve() const { return curve_; }
  const std::vector<double>& positive() const { return positive_; }

  // The place of a position, counted in cells.
  Place located(double position) const;

 private:
  std::vector<std::int64_t> owner_;
  std::vector<double> nodes_, spacing_, positive_;
  std::shared_ptr<const Curve> curve_;
};

struct Optimum {
  double objective = 0;
  std::vector<Place> places;
  std::vector<double> weights;  // of the unit vectors, the fixed ones first
};

struct Solved : Optimum {
  double bound = 0, relaxed = 0;  // lower bounds of the objective
  double table = 0;               // objective of the best candidate on the table
  std::size_t nodes = 0;
};

// How exactly the optimum is found; the Python module of the search states the values and their sources.
struct SearchLimits {
  double gap = 0, table_error = 0, settled = 0, flat = 0, acts_as = 0, followed = 0;
  std::size_t polishes = 0, newton_steps = 0;
  std::vector<double> widths;
};

class ExponentialSearch {
 public:
  // target and rows of `fixed` are weighted by the upper triangular root (dim x dim); `rounding`: length of the rounding
  // error of the residual.
  ExponentialSearch(ExponentialCurve curve, SearchLimits limits, std::span<const double> target,
                    std::span<const double> fixed, std::span<const double> root, double rounding);

  // The global optimum with at most k places, by at most `most` nodes; `starts`: positions of additional searches.
  Solved solve(const WeightedTable& table, std::size_t k, std::size_t most, std::span<const double> starts) const;

  // The local optimum next to the optimum of a problem with other weights.
  Optimum followed(const std::vector<Place>& places) const;

  // For each place, the end of its branch as which it acts: 1 (high), -1 (low), or 0 (neither).
  std::vector<int> acts_as(const Optimum& best) const;

  const ExponentialCurve& curve() const { return curve_; }
  const SearchLimits& limits() const { return limits_; }

 private:
  struct Piece;

  bool as_low(double objective, double least, double share) const;
  Optimum at(std::vector<Place> places) const;
  Optimum polished(std::vector<Place> places, bool tabulated) const;
  Optimum sharpened(Optimum best, std::size_t steps, double reach, bool* moved = nullptr) const;
  bool newton(std::vector<Place>& places, const std::vector<double>& weights, std::size_t steps, double reach) const;
  Optimum settled(Optimum best) const;

  ExponentialCurve curve_;
  SearchLimits limits_;
  std::size_t dim_;
  std::vector<double> target_, fixed_;
  Root root_;
  double rounding_;
};

}  // namespace gmwm
