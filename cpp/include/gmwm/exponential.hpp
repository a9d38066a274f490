// Haar wavelet variances of the autocovariance phi^|k|, phi = ±exp(-lambda), and their derivatives, at full accuracy
// from lambda = 1e-300 to white noise.
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

// One value for each half-scale h, written to out: of the marginal variance 1, with phi = exp(-lambda), and the
// derivative with respect to lambda.
void exponential_shape(double lambda, std::span<const double> h, double* out);
void exponential_slope(double lambda, std::span<const double> h, double* out);

// The same of an autoregression with innovation variance 1, and the derivative with respect to phi, -1 < phi < 1.
void autoregressive_shape(double phi, std::span<const double> h, double* out);
void autoregressive_slope(double phi, std::span<const double> h, double* out);

// The same of the autocovariance exp(-a|k|) [cos ωk + (a/ω) sin ω|k|], with the damping a and the turn ω > 0 per sample.
void oscillation_shape(double damping, double turn, std::span<const double> h, double* out);

// -ln|phi|, accurate for |phi| near 1, up to 700, where exp(-lambda) is below the rounding error of 1.
double log_decay(double phi);

}  // namespace gmwm
