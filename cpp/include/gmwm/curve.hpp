// A curve of unit vectors g(s), tabulated: values and slopes at the nodes s = 0, 1, 2, …, a cubic between, and for
// each cell a bound on how far the cubic is from the curve. What the curve stands for is not known here.
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
  // values, slopes: nodes x dim, row by row; margins: nodes - 1 bounds of |g - cubic|, negative for a cell that is
  // no part of the curve (between two branches). `positive`: a vector z with <z, g(s)> > 0 everywhere.
  Curve(std::size_t dim, std::span<const double> values, std::span<const double> slopes,
        std::span<const double> margins, std::span<const double> positive);

  std::size_t dim() const { return dim_; }
  std::size_t nodes() const { return nodes_; }
  const std::vector<Range>& branches() const { return branches_; }
  const Range& branch_of(double s) const;
  double largest_margin() const;

  // g and, where wanted, its first two derivatives at s.
  void at(double s, double* value, double* slope = nullptr, double* curvature = nullptr) const;

  // max over s in [low, high] of <direction, g(s)> / <z, g(s)>, rounded up by the margins, if positive, else 0; and
  // the largest local maxima of <direction, g(s)> above `threshold`, at most one in a run of rising cells.
  double steepest(std::span<const double> direction, Range range, double threshold, std::vector<Peak>& peaks);

 private:
  struct Cell {
    double p0, p1, d0, d1;  // values and slopes of a cubic at both ends
    double operator()(double t) const;
    double control_maximum() const;
    Peak maximum(double from, double to) const;
  };

  std::size_t dim_;
  std::size_t nodes_;
  std::vector<double> values_, slopes_;      // node by node: for evaluation at one place
  std::vector<double> values_t_, slopes_t_;  // dimension by dimension: for inner products over many nodes
  std::vector<double> margins_;
  std::vector<double> least_;  // lower bound of <z, g> in each cell
  std::vector<Range> branches_;
  std::vector<double> p_, d_;
};

}  // namespace gmwm
