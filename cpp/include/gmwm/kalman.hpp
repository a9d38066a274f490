// Gaussian likelihood of a state-space model, and estimates of its states, by the Kalman filter:
//   x_{t+1} = F x_t + w_t, Var w = Q;   y_t = H x_t + v_t, Var v = R;   x_0 of mean zero and covariance P0.
//
// The filter is applied to several series: the record, and regressors (an unknown constant, a ramp). From the results,
// the caller computes the coefficients of the regressors by least squares. A NaN in the record is a missing sample: the
// filter predicts the states without an update.
//
// As soon as the covariance of the states does not change any more, the gain is constant, and a sample costs no more
// than the recursion of the means. After a missing sample, the covariance has to converge again.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gmwm {

struct System {
  std::size_t states;                  // p
  std::span<const double> F, Q, H, P0;  // (p, p), (p, p), (p), (p, p), row by row
  double R;
};

// Derivatives of a system by `count` parameters: (count, p, p), …, (count, p), (count).
struct Slopes {
  std::size_t count;
  std::span<const double> F, Q, H, P0, R;
};

// Rows of n samples, one after the other; the first is the record.
struct Series {
  std::size_t count, length;
  std::span<const double> values;

  const double* row(std::size_t k) const { return values.data() + k * length; }
};

struct Innovations {
  std::size_t observed = 0;
  std::size_t settled = 0;    // samples that were filtered with a constant gain
  double log_variances = 0;   // Σ log S_t, S_t the variance of the innovation
  std::vector<double> cross;  // Σ v_a v_b / S_t of all pairs of series (k, k)
  bool singular = false;      // whether an innovation has zero variance, so that the likelihood does not exist
};

// standardised: output v_t / √S_t of the record (n), NaN at missing samples; empty if not needed.
Innovations innovations(const System& system, const Series& series, std::span<double> standardised);

struct Score {
  std::size_t observed = 0;
  std::size_t settled = 0;
  double log_variances = 0, square = 0;             // Σ log S_t, Σ v_t² / S_t of the record
  std::vector<double> log_slopes, square_slopes;    // their derivatives (L)
  // Σ ½ S'_a S'_b / S² + v'_a v'_b / S (L, L). With one regressor, v and S include the uncertainty of its coefficient
  // given the samples before. This gives the information of the contrasts, which do not depend on the coefficient.
  std::vector<double> information;
  std::vector<double> cross, cross_slopes;          // Σ c_a c_b / S of the regressors (m, m), derivatives (L, m, m)
  bool singular = false;
};

constexpr std::size_t most_slopes = 32;

// At most `most_slopes` parameters.
Score score(const System& system, const Slopes& slopes, const Series& series);

struct Selection {
  std::size_t count;                // g: number of linear combinations of states
  std::span<const double> states;   // (g, p): weights of the states
  std::span<const double> shares;   // (g, m): weights of the regressors themselves
};

// Means and variances (g + 1, n) of the selected combinations, given the record up to each sample, or given the whole
// record (smooth). The last row is for the observation noise v. A combination that is not determined yet has infinite
// variance. Memory: the outputs, and one state of the filter for each 4096 samples. Returns false if an innovation has
// zero variance.
bool tracks(const System& system, const Series& series, const Selection& selection, bool smooth, std::span<double> means,
            std::span<double> variances);

}  // namespace gmwm
