// Autoregressive moving averages phi(B) Phi(B^s) X = theta(B) Theta(B^s) e, Var e = 1: wavelet variances and their
// derivatives, covariances, and the coefficients for sample paths.
//
//   phi(B) = 1 - phi_1 B - ... - phi_p B^p,  theta(B) = 1 + theta_1 B + ... + theta_q B^q,  the seasonal ones alike.
//
// The parameters are rows of phi, theta, seasonal phi, seasonal theta. All calculations use double-double arithmetic
// (twofold.hpp), so that results remain accurate for roots close to the unit circle. If phi or Phi is not stationary,
// the results are NaN.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace gmwm {

struct ArmaOrders {
  std::size_t ar = 0, ma = 0, seasonal_ar = 0, seasonal_ma = 0, period = 1;

  std::size_t parameters() const { return ar + ma + seasonal_ar + seasonal_ma; }
  std::size_t full_ar() const { return ar + period * seasonal_ar; }
  std::size_t full_ma() const { return ma + period * seasonal_ma; }
  // Number of states: covariances follow the recursion of the autoregression from this lag on.
  std::size_t states() const { return full_ar() > full_ma() ? full_ar() : full_ma() + 1; }
};

// Wavelet variances (rows, levels) at levels 1, 2, ... under Haar's filter if `odd` is empty, else under the filter
// whose scaling filter has the autocorrelations `odd` at lags 1, 3, 5, ..., up to a factor.
void arma_shapes(const ArmaOrders& orders, std::span<const double> parameters, std::size_t rows,
                 std::span<const double> odd, std::size_t levels, std::span<double> out);

// Their derivatives by each parameter, (rows, parameters, levels).
void arma_slopes(const ArmaOrders& orders, std::span<const double> parameters, std::size_t rows,
                 std::span<const double> odd, std::size_t levels, std::span<double> out);

// artanh of the partial autocorrelations of autoregressions with rows (phi_1, ..., phi_p); NaN where not stationary.
void arma_coordinates(std::span<const double> coefficients, std::size_t p, std::span<double> out);

// Autocovariances r(k) at ascending lags k >= 0; if `from_zero`, the differences r(k) - r(0).
void arma_autocovariance(const ArmaOrders& orders, std::span<const double> parameters,
                         std::span<const std::int64_t> lags, bool from_zero, std::span<double> out);

// Simple roots λ of the autoregression to a few digits: real ones, and of pairs of complex ones that with im > 0.
struct ArmaRoots {
  std::span<const double> re, im;
};

// Their part of the autocovariance, Re Σ amplitude exp(-decay k), where decay has an imaginary part from 0 to π.
struct ArmaExponentials {
  std::span<double> amplitude_re, amplitude_im, decay_re, decay_im;
};

// Autocovariances at lags 0 … out.size() - 1 without the part of some roots.
void arma_without(const ArmaOrders& orders, std::span<const double> parameters, const ArmaRoots& roots,
                  const ArmaExponentials& exponentials, std::span<double> out);

// Variances of sums of n successive samples, for ascending n >= 0.
void arma_block_variance(const ArmaOrders& orders, std::span<const double> parameters,
                         std::span<const std::int64_t> sizes, std::span<double> out);

// The full polynomials, phi (p,) and theta (q,), and for paths of Z = X/theta(B): the predictors of Z_t by the t
// values before it, t < p, as rows of (p, p), the nearest value first, and the standard deviations (p,) of their
// errors.
void arma_recursion(const ArmaOrders& orders, std::span<const double> parameters, std::span<double> phi,
                    std::span<double> theta, std::span<double> predictors, std::span<double> deviations);

}  // namespace gmwm
