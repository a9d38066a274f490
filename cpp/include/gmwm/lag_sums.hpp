// Sums over all lags of products of covariances of Haar wavelet coefficients, in closed form.
//
// The cost does not depend on the number of lags or on the memory of the process.
#pragma once

#include <cstdint>
#include <span>

namespace gmwm {

// A process whose running sum has the covariance, up to a constant,
//   K(m) = -½ white |m| + walk (|m|³ - |m|)/12 + spikes(|m|) + Σ_p k_p(m),
// where spikes(m) is 0 beyond the end of `spikes`. k_p is the real part of amplitude times the covariance for the
// autocovariance exp(-λ |m|):
//   k(m) = -½ |m| coth(λ/2) - exp(-λ |m|) / (4 sinh²(λ/2)),
// without its first term if `bare`, which requires |λ| of at least 1/2.
struct LagProcess {
  double white = 0, walk = 0;
  std::span<const double> spikes;
  std::span<const double> amplitude_re, amplitude_im;
  std::span<const double> decay_re, decay_im;  // λ: re >= 0 (> 0 if im is 0), 0 <= im <= π
  std::span<const std::uint8_t> bare;
};

class LagTable;

// A process with real decays, whose covariances are in a table, and the factor of its covariances.
struct TableFactor {
  const LagTable* table;
  double factor;
};

// For each pair of levels, sorted by the coarser level, then the finer (or for each level, if `diagonal`):
// first = Σ_u n(u) C(u) and second = Σ_u n(u) (C(u)² + 2 C(u) D(u)). C(u) and D(u) are 2^(j+k) Cov(W_{j,t}, W_{k,t+u}) of
// the process and of the tables together, and n(u) is the number of pairs of coefficients with the lag u in a record of
// `samples` samples. Levels ascend, and the coarsest has a coefficient. They are the first levels of each table.
struct LagSums {
  std::span<double> first, second;
};

void lag_sums(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& process,
              std::span<const TableFactor> tables, const LagSums& out);

}  // namespace gmwm
