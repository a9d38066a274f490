// Sums over all lags of even powers of correlations of Haar wavelet coefficients, for covariances of robust estimates.
//
// Where oscillations matter, every lag is evaluated, from tables of powers of the poles; elsewhere a Gauss rule for sums
// over integers takes a few nodes. If one oscillation outlasts all else that changes within its period, the rule takes the
// mean over its phases, and its harmonics are summed by parts.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "gmwm/lag_sums.hpp"

namespace gmwm {

inline constexpr std::size_t hermite_powers = 7;  // of correlations: 4, 6, …, 16

// variances: of the coefficients of each level, C(0) of `lag_sums`. sums: for each pair of levels, in the order of
// `lag_sums`, Σ_u n(u) Σ_r weights[r] ρ(u)^(2r + 4) with the correlation ρ of the coefficients.
struct HermiteSums {
  std::span<double> variances, sums;
};

void hermite_sums(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& process,
                  std::span<const double> weights, const HermiteSums& out);

}  // namespace gmwm
