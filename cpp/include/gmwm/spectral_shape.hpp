// Least-squares fit of the logarithm of the power spectral density of an ARMA process to a measured density.
//
// The density is e^scale |b|² / |a|² + e^slow known + floor, with a = 1 + Σ a_k z^k, b = 1 + Σ b_k z^k, |z| = 1. The loss
// is Σ weight (log measured - log density)² + (slow / prior)².
#pragma once

#include <cstddef>
#include <span>

namespace gmwm {

struct SpectralData {
  std::span<const double> waves;  // the real parts of z^k at all frequencies for k = 1, 2, …, then the imaginary parts
  std::span<const double> known, logs, weights;  // one value per frequency
  double floor = 0.0;
  double prior = 1.0;
};

struct DescentOptions {
  std::size_t p = 0;       // number of coefficients of a
  bool free = false;       // whether slow is fitted
  std::size_t steps = 0;   // largest number of steps
  double near = 0.0;       // the relative decrease of the loss at which the descent ends
};

// Moves the parameters (scale, a, b, slow) to a local minimum by the Levenberg-Marquardt method, and returns the loss,
// infinity if it is not finite at the start. waves has 2 L n values for n frequencies, L >= p and L >= the number of
// coefficients of b.
double spectral_descent(const SpectralData& data, const DescentOptions& options, std::span<double> parameters);

// Whether all roots of z^n + c_1 z^(n-1) + … + c_n have a modulus below `most`, by the Schur-Cohn recursion.
bool roots_inside(std::span<const double> c, double most);

}  // namespace gmwm
