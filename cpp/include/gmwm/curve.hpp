// A tabulated curve of unit vectors g(s): values and slopes at the nodes s = 0, 1, 2, …, cubic interpolation between
// them, and for each cell a bound on the interpolation error. This file does not depend on the meaning of the curve.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gmwm {

struct Range {
  double low;
  double high;
};

// The largest value of <direction, g(s)> in one stretch of s.
struct Peak {
  double position;
  double value;
};

class Curve {
 public:
  // values, slopes: nodes x dim, row by row; margins: nodes - 1 bounds of |g - cubic|, negative for cells that do not
  // belong to the curve (between two branches). `positive`: a vector z with <z, g(s)> > 0 everywhere.
  Curve(std::size_t dim, std::span<const double> values, std::span<const double> slopes,
        std::span<const double> margins, std::span<const double> positive);

  std::size_t dim() const { return dim_; }
  std::size_t nodes() const { return nodes_; }
  const std::vector<Range>& branches() const { return branches_; }
  const Range& branch_of(double s) const;
  double largest_margin() const;

  // g and, if requested, its first two derivatives at s.
  void at(double s, double* value, double* slope = nullptr, double* curvature = nullptr) const;

  // Scratch space of `steepest`, for repeated calls.
  struct Scratch {
    std::vector<double> p, d, most;
  };

  // An upper bound of <direction, g(s)> / <z, g(s)> over s in [low, high], including the margins, or 0 if it is
  // negative; and the largest local maxima of <direction, g(s)> above `threshold`, at most one for each run of rising
  // cells.
  double steepest(std::span<const double> direction, Range range, double threshold, std::vector<Peak>& peaks,
                  Scratch& scratch) const;

 private:
  struct Cell {
    double p0, p1, d0, d1;  // values and slopes of a cubic at both ends
    double operator()(double t) const;
    Peak maximum(double from, double to) const;
  };

  std::size_t dim_;
  std::size_t nodes_;
  std::vector<double> values_, slopes_;      // node by node: for evaluation at one position
  std::vector<double> batches_;              // both, batch by batch of nodes: for inner products over many nodes
  std::vector<double> margins_;
  std::vector<double> least_;  // lower bound of <z, g> in each cell
  std::vector<Range> branches_;
};

}  // namespace gmwm
