// The Gaussian likelihood of a signal that hidden states drive, and the states themselves, by the Kalman filter:
//   x_{t+1} = F x_t + w_t, Var w = Q;   y_t = H x_t + v_t, Var v = R;   x_0 of mean zero and covariance P0.
//
// Several series pass the same filter: the record, and regressors (an unknown constant, a ramp) whose coefficients the
// caller then knows the least squares of. Where the record is NaN no sample was taken: states go on, nothing is learned.
//
// Once the covariance of the states no longer changes, in any of its digits, all gains are kept, and a sample costs no
// more than the recursion of the means. A missing sample ends that for a while.
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

// Derivatives of a system by so many parameters: (count, p, p), …, (count, p), (count).
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
  std::size_t settled = 0;    // samples that were filtered with gains kept
  double log_variances = 0;   // Σ log S_t, S_t the variance of the innovation
  std::vector<double> cross;  // Σ v_a v_b / S_t of all pairs of series (k, k)
  bool singular = false;      // an innovation without variance: the model leaves nothing to chance
};

// standardised: v_t / √S_t of the record, NaN where it is missing; (n), or empty if it is not wanted.
Innovations innovations(const System& system, const Series& series, std::span<double> standardised);

struct Score {
  std::size_t observed = 0;
  std::size_t settled = 0;
  double log_variances = 0, square = 0;             // Σ log S_t, Σ v_t² / S_t of the record
  std::vector<double> log_slopes, square_slopes;    // their derivatives (L)
  // Σ ½ S'_a S'_b / S² + v'_a v'_b / S (L, L); with one regressor v and S are those of a record whose level is known only
  // as far as the samples before say, which is the information that the contrasts hold.
  std::vector<double> information;
  std::vector<double> cross, cross_slopes;          // Σ c_a c_b / S of the regressors (m, m), derivatives (L, m, m)
  bool singular = false;
};

constexpr std::size_t most_slopes = 32;

// At most `most_slopes` parameters.
Score score(const System& system, const Slopes& slopes, const Series& series);

struct Selection {
  std::size_t count;                // g sums of states that are wanted
  std::span<const double> states;   // (g, p): weights of the states
  std::span<const double> shares;   // (g, m): weights of the regressors themselves
};

// The selected sums given the record up to each sample, or given all of it (smooth): their means and variances
// (g + 1, n), the last row those of the observation noise v. What is not determined yet has an infinite variance.
// Memory: the outputs, and one state for each 4096 samples. False if some innovation has no variance.
bool tracks(const System& system, const Series& series, const Selection& selection, bool smooth, std::span<double> means,
            std::span<double> variances);

}  // namespace gmwm
