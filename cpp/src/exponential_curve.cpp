#include "gmwm/exponential_curve.hpp"

#include <cmath>

#include "gmwm/exponential.hpp"

namespace gmwm {

ExponentialCurve::ExponentialCurve(std::span<const double> h, std::span<const ExponentialBranch> branches, double rate,
                                   bool innovation)
    : h_(h.begin(), h.end()), branches_(branches.begin(), branches.end()), rate_(rate), innovation_(innovation) {}

double ExponentialCurve::parameter(std::size_t branch, double u) const {
  const ExponentialBranch& along = branches_[branch];
  const double lambda = along.bend * (std::expm1(u - along.low) + along.least);
  return innovation_ ? along.sign * std::exp(-lambda) : rate_ * lambda;
}

double ExponentialCurve::decay(double parameter) const { return innovation_ ? log_decay(parameter) : parameter / rate_; }

void ExponentialCurve::shape_of(double parameter, double* out) const {
  if (innovation_)
    autoregressive_shape(parameter, h_, out);
  else
    exponential_shape(parameter / rate_, h_, out);
}

void ExponentialCurve::slope(std::size_t branch, double u, double* out) const {
  const ExponentialBranch& along = branches_[branch];
  const double value = parameter(branch, u);
  double by_u = std::exp(u);
  if (innovation_) {
    autoregressive_slope(value, h_, out);
    const double lambda = along.bend * (std::expm1(u - along.low) + along.least);
    by_u = -along.sign * std::exp(u - lambda);
  } else {
    exponential_slope(value / rate_, h_, out);
  }
  for (std::size_t j = 0; j < h_.size(); ++j) out[j] *= by_u;
}

}  // namespace gmwm
