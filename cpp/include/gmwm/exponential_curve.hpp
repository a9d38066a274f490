// Wavelet variances of processes with exponential autocovariances, along the coordinate in which they are searched.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace gmwm {

// phi = sign exp(-lambda) along a coordinate u from low to high: lambda = bend (exp(u - low) - 1 + least).
struct ExponentialBranch {
  double low, high, bend, least, sign;
  bool low_acts, high_acts;  // whether the process acts as another one at this end
};

// Wavelet variances of a process at unit scale at half-scales h, and derivatives with respect to u.
class ExponentialCurve {
 public:
  // `innovation`: unit scale is a unit innovation variance instead of a unit marginal variance.
  ExponentialCurve(std::span<const double> h, std::span<const ExponentialBranch> branches, double rate, bool innovation);

  std::size_t dim() const { return h_.size(); }
  std::size_t branches() const { return branches_.size(); }
  const ExponentialBranch& branch(std::size_t index) const { return branches_[index]; }
  std::span<const double> half_scales() const { return h_; }
  bool innovation() const { return innovation_; }

  // The parameter of the process at u: the inverse correlation time (1/s), or phi. And lambda, as it follows from it.
  double parameter(std::size_t branch, double u) const;
  double decay(double parameter) const;

  void shape_of(double parameter, double* out) const;
  void shape(std::size_t branch, double u, double* out) const { shape_of(parameter(branch, u), out); }
  void slope(std::size_t branch, double u, double* out) const;

 private:
  std::vector<double> h_;
  std::vector<ExponentialBranch> branches_;
  double rate_;
  bool innovation_;
};

}  // namespace gmwm
