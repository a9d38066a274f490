// The covariance of Haar wavelet coefficients of two levels between two kinks, as a polynomial plus exponentials.
//
// Lags are measured from the centre of symmetry, v = u - (h_k - h_j) >= 0. h is the half-scale of the finer level and g
// that of the coarser one. With the second difference f(y) of K over the finer level,
//   C(v) = f(v + g) - 2 f(v) + f(v - g),   f(y) = K(y - h) - 2 K(y) + K(y + h).
// An exponential with |λ| h >= 1/2 contributes its closed form to f. For a slower one, terms cancel in the closed form,
// and f(y) = W e^(-λ(|y| - h)) + κ(h - |y|), where κ(d) = (sinh λd - d sinh λ) / (2 sinh²(λ/2)) for d > 0 has a short
// series. If |λ| g < 1/2, the remaining terms W cancel in C too, and C is W (1 - z^g)² e^(-λ(v - h - g)) + χ(g - v) plus
// terms of κ, where z = e^(-λ) and χ(y) = 2 sinh²(λh/2) sinh(λy) / sinh²(λ/2) for y > 0.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <utility>
#include <vector>

#include "gmwm/complex.hpp"
#include "gmwm/lag_sums.hpp"

namespace gmwm {

// |λ| times a length below which an exponential is a polynomial over that length, to 1e-12 with this degree.
inline constexpr double slow = 0.5;
inline constexpr std::size_t degree_most = 11;
// |ln z^h|, or |ln z^g|, below which an exponential that is not slow is an echo. Above, three digits are lost at most.
inline constexpr double periodic = 0.05;

// n(start + i) = at_start + step i pairs of coefficients.
struct LagCount {
  double at_start, step;
};

// The lags start … start + count - 1 between two kinks; empty if `count` is not positive.
struct LagInterval {
  std::int64_t start, count;
  LagCount pairs;
};

// The intervals of a pair of levels in a record of `samples` samples.
std::array<LagInterval, 5> intervals(std::int64_t h, std::int64_t g, std::int64_t samples);

// Re e^(-i angle l) Σ_r series[r] (l / count)^r at the lag start + l: an exponential whose period nearly divides h. It nearly
// cancels in the coefficients, as a slow one does: with λ = ρ + iθ, where θ is a multiple of 2π/h, ρ takes the place of λ.
struct Echo {
  double angle = 0;
  std::array<Complex, degree_most + 1> series{};
};

// C(start + i) = Σ_r polynomial[r] (i / count)^r + Σ Re(ahead z^i + behind z^(count - 1 - i)) for 0 <= i < count, without
// the spikes.
struct LagPiece {
  std::int64_t start = 0, count = 0;
  std::array<double, degree_most + 1> polynomial{};
  std::size_t degree = 0;
  std::vector<std::size_t> active;  // exponentials that are not part of the polynomial
  std::vector<Complex> ahead, behind;
  std::vector<Echo> echoes;  // beside the polynomial and the exponentials
};

// The exponentials of a process, and its covariance at pairs of levels.
class LagPieces {
 public:
  explicit LagPieces(const LagProcess& process);

  // Selects a pair of levels h <= g.
  void pair(std::int64_t h, std::int64_t g);
  // Writes the lags start … start + count - 1, which lie between two kinks.
  void piece(std::int64_t start, std::int64_t count, LagPiece& out);
  // z^exponent of all exponentials; valid until the next pair of levels. Those of short lags serve all pairs of a level.
  const Complex* power(std::int64_t exponent);
  // Contribution of the spikes to C(v).
  double spike(std::int64_t v) const;

  std::size_t size() const { return decay_.size(); }
  std::size_t spikes() const { return process_.spikes.size(); }
  Complex decay(std::size_t p) const { return decay_[p]; }
  Complex pole(std::size_t p) const { return pole_[p]; }
  Complex over_apart(std::size_t p) const { return over_apart_[p]; }  // 1 / (z - 1)
  bool real(std::size_t p) const { return real_[p]; }

 private:
  using Series = std::array<double, degree_most + 1>;
  enum class Speed : std::uint8_t { fast, swing, echo, between, still };

  // z^exponent for some exponents, of which the first `used` are valid.
  struct Powers {
    std::vector<std::pair<std::int64_t, std::vector<Complex>>> all;
    std::size_t used = 0;
  };

  // Of a level with half-scale h: z^h - 1, W, ρ of an echo and, of slow exponentials, the coefficients of κ in powers of
  // d / h and the factor of sinh in χ.
  struct Level {
    std::vector<Complex> lost, outside, bend, rest;
    std::vector<Series> corner;
    std::vector<Speed> speed;  // fast, echo or between
    Powers powers;
  };

  Level& level(std::int64_t half);
  void fill(double h, Level& out) const;
  void add(Complex coefficient, Complex decay_of_count, LagPiece& out) const;
  void echo(std::size_t p, Complex end, LagPiece& out) const;
  void straight(double at_start, double step, LagPiece& out) const;
  void corner(const Series& series, double weight, bool rising, double ratio, LagPiece& out) const;
  void walk(LagPiece& out) const;

  LagProcess process_;
  std::vector<Complex> amplitude_, decay_, pole_, over_apart_, weight_;  // weight: the factor w of z^|m| in K
  std::vector<double> slope_, size_;  // size: |λ|
  std::vector<char> real_;
  std::int64_t h_ = 0, g_ = 0;
  std::map<std::int64_t, Level> levels_;  // by half-scale
  Level* fine_ = nullptr;
  std::vector<Complex> tail_, rest_;  // of the pair of levels, as `speed_`; rest: ρ of an echo, or of a swing of period g
  std::vector<Speed> speed_;
  Powers powers_;
  std::vector<Complex> ahead_, behind_;
};

}  // namespace gmwm
