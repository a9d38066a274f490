// Non-negative least squares for a handful of columns: min |b - sum_i x_i a_i|, x >= 0 (Lawson and Hanson 1974).
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gmwm {

// A solver for repeated problems with a few columns of the same length. It owns its scratch space, so that later solves
// allocate no memory. The columns should have about unit norm.
class NonNegative {
 public:
  explicit NonNegative(std::span<const double> target);

  // Columns are not copied and must exist until the solve ends. `weights` contains a feasible start (zeros can become
  // positive) and, afterwards, the solution.
  void solve(std::span<const double* const> columns, std::vector<double>& weights);

  std::span<const double> residual() const { return residual_; }
  double objective() const { return objective_; }

  // v minus its projection onto the columns with positive weight in the last solve.
  void project_out(std::span<double> vector) const;

 private:
  bool least_squares(std::span<const double* const> columns);
  bool advance(std::vector<double>& weights);

  std::vector<double> target_;
  std::vector<double> residual_;
  double objective_ = 0;
  double target_norm_ = 0;
  std::vector<std::size_t> passive_;
  std::size_t known_ = 0;      // number of columns of the last decomposition
  std::vector<double> a_;      // these columns, one after the other
  std::vector<double> q_;      // their orthonormal basis
  std::vector<double> r_;      // upper triangle, column by column
  std::vector<double> along_;  // coefficients of the target in the basis
  std::vector<double> left_;   // the target, and what is left of it after each column of the basis
  std::vector<double> z_;      // unconstrained solution on the passive columns
  std::vector<char> blocked_;
};

// Whether, of the rows of `data`, more than `most` have a squared distance of at most their limit from the nearest sum of
// rows of `columns` with non-negative weights. Rows of the data whose answer is most likely positive should be first.
bool often_near(std::span<const double> data, std::span<const double> limits, std::span<const double> columns, double most);

}  // namespace gmwm
