// Sums over the lags of a piece: powers, geometric series, and polynomials times exponentials.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>

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

// The functions i! / ((i - r)! n^r), which are sums of powers of i / n.
struct Falling {
  static constexpr std::size_t size = degree_most + 2;
  using Values = std::array<double, size>;

  explicit Falling(double n) {
    end[0] = 1, step[0] = 0;
    for (std::size_t r = 1; r < size; ++r) step[r] = static_cast<double>(r) / n, end[r] = end[r - 1] * (1 - step[r - 1]);
  }

  // Adds to out[r], r <= highest, the sum over 0 <= i < n of function r times Re(a z^i + b z^(n - 1 - i)). zn is z^n, and
  // over is 1 / (z - 1). Summation by parts:
  //   (z - 1) M_r = (function r at n) z^n - (r / n) z M_(r-1),   (z - 1) B_r = (r / n) B_(r-1) - (function r at n).
  template <class Number>
  void add(Number z, Number zn, Number over, Number a, Number b, std::size_t highest, Values& out) const {
    const Number last = zn * over, turn = z * over;
    Number ahead = last - over, behind = ahead;
    out[0] += real(a * ahead + b * behind);
    for (std::size_t r = 1; r <= highest; ++r) {
      ahead = end[r] * last - step[r] * (turn * ahead);
      behind = step[r] * (over * behind) - end[r] * over;
      out[r] += real(a * ahead + b * behind);
    }
  }

  // Sums with powers of i / n, up to `highest`, from sums with these functions.
  Values powers(const Values& sums, std::size_t highest) const {
    Values out{};
    for (std::size_t s = highest + 1; s-- > 0;) {
      // out[r]: sums of function s times power r, from those of function s + 1.
      double before = std::exchange(out[0], sums[s]);
      for (std::size_t r = 1; r + s <= highest; ++r) before = std::exchange(out[r], before + step[s] * out[r - 1]);
    }
    return out;
  }

  // A polynomial in powers of i / n, as a sum of these functions.
  template <class Coefficients>
  Coefficients of(const Coefficients& polynomial) const {
    Coefficients out{};
    for (std::size_t r = size; r-- > 0;) {
      // i / n times function s is function s + 1, and s / n times function s.
      for (std::size_t s = size - 1; s >= 1; --s) out[s] = step[s] * out[s] + out[s - 1];
      out[0] = polynomial[r];
    }
    return out;
  }

  Values end, step;  // values at i = n, and r / n

 private:
  static double real(double a) { return a; }
  static double real(Complex a) { return a.re; }
};

}  // namespace gmwm
