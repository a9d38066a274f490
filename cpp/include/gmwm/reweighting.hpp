// The iteration of an estimate and of its diagonal weights 1 / V_jj, for a sum of elementary processes and of processes
// with exponential autocovariances. The Python code does the same for other processes and weights.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <span>
#include <tuple>
#include <utility>
#include <vector>

#include "gmwm/exponential_search.hpp"
#include "gmwm/lags.hpp"

namespace gmwm {

// Processes whose covariances of Haar coefficients are in `gmwm/differences.hpp`; a drift has none.
enum class Elementary { white, walk, spike, drift };

// A part of the recording without a gap, or several of the same length.
struct Segment {
  std::int64_t samples;
  double times;        // how many there are
  std::size_t levels;  // how many levels have coefficients
};

struct ReweightingOptions {
  double prior, fixed, far;  // degrees of freedom of the curve; change that ends the iteration; largest step
  double cumulant;           // fourth cumulant of uniform rounding errors, relative to their squared variance
  double cutoff;             // relative singular value below which a direction of the mixing counts as zero
  std::size_t rounds, hope, mixed;
};

// What stays the same in all iterations.
struct Setting {
  std::vector<std::int64_t> levels;
  std::vector<double> observed, freedom, counts, added;  // added: relative variance beyond the model, may be empty
  double loss;                                           // factor of filled samples
  std::vector<Segment> segments;
  std::vector<Elementary> kinds;  // of the linear processes
  std::vector<double> powers;     // of their parameters in the scale
  std::vector<double> shapes;     // wavelet variances at unit scale, row by row
  std::size_t curved;             // number of processes with exponential autocovariances
  double rounding;                // relative error of each product in the residual
  ReweightingOptions options;
};

// Scales of the linear processes; parameter and scale of the others, in ascending order of correlation time.
struct Estimate {
  std::vector<double> linear;
  std::vector<std::pair<double, double>> curved;
};

struct Reweighted {
  Optimum best;
  std::vector<double> weights;  // diagonal of the matrix
  double change = 0, expected = 0;
};

class Reweighting {
 public:
  Reweighting(Setting setting, ExponentialCurve curve, SearchLimits limits);

  // Starts from an estimate, whose places are given. Nothing if the model has no noise at some level.
  std::optional<Reweighted> run(Estimate estimate, std::vector<Place> places);

  // V_jj of an estimate, without what is added and without the factor of the loss.
  std::vector<double> variances(const Estimate& at);

 private:
  std::vector<double> curve_of(const Estimate& at) const;
  std::optional<std::vector<double>> weights_of(const Estimate& at);
  ExponentialSearch search_under(const std::vector<double>& weights, double& unit) const;
  Estimate estimate_of(const Optimum& best, const std::vector<double>& weights, double unit) const;
  void sort(Estimate& estimate) const;
  const Lags& lags_of(std::size_t segment, double slowest, double fastest, bool alternating);

  Setting setting_;
  ExponentialCurve curve_;
  SearchLimits limits_;
  std::map<std::tuple<std::size_t, double, double, bool>, Lags> lags_;
};

// Combines the last estimates so that their residual would be least if the iteration were linear (Anderson 1965).
class Mixing {
 public:
  Mixing(const Setting& setting, const ExponentialCurve& curve) : setting_(setting), curve_(curve) {}
  Estimate next(const Estimate& found);

 private:
  struct Logarithms {
    std::vector<std::size_t> names;
    std::vector<double> values;
  };
  Logarithms logarithms(const Estimate& at) const;

  const Setting& setting_;
  const ExponentialCurve& curve_;
  Logarithms given_;
  std::vector<std::pair<std::vector<double>, std::vector<double>>> pairs_;
};

// The shortest x with the least |a x - b|, a given by its columns; singular values below cutoff times the largest count
// as zero.
std::vector<double> least_squares(std::vector<std::vector<double>> columns, const std::vector<double>& b, double cutoff);

}  // namespace gmwm
