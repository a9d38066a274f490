// Sums over the lags of a piece: powers, geometric series, and polynomials times exponentials.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "gmwm/complex.hpp"
#include "gmwm/lag_pieces.hpp"

namespace gmwm {

inline constexpr double alike = 0.1;  // |ln x| n below which the closed form of Σ i x^i would lose more than 2 digits

// Σ x^i and Σ i x^i, x = exp(-decay), for 0 <= i < n.
struct Geometric {
  Complex plain, risen;
};

// For |decay| n < `alike`.
Geometric near_one(Complex decay, double n);

// Σ (i / n)^r over 0 <= i < n, for r < `highest`.
void sums_of_powers(std::int64_t n, std::size_t highest, double* out);

// Coefficients of a polynomial times n(i), in powers of i / n.
using Series = std::array<Complex, 2 * degree_most + 2>;

// Σ P(i / n) exp(-decay i) for 0 <= i < n, for a polynomial of this degree.
Complex swept(const Series& polynomial, std::size_t degree, Complex decay, std::int64_t count);

// A series times n(i) = pairs.at_start + pairs.step i, in powers of i / n.
Series counted(const Echo& echo, LagCount pairs, double n);

// The same polynomial in powers of (n - 1 - i) / n.
template <class Coefficients>
Coefficients turned(const Coefficients& forward, std::size_t highest, double n) {
  Coefficients backward{};
  const double turn = (n - 1) / n;
  for (std::size_t r = highest + 1; r-- > 0;) {
    for (std::size_t s = highest; s >= 1; --s) backward[s] = turn * backward[s] - backward[s - 1];
    backward[0] = turn * backward[0] + forward[r];
  }
  return backward;
}

}  // namespace gmwm
