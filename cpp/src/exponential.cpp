// The usual closed forms cancel as phi -> 1, the typical case for inertial sensors. The formulas here use lambda, x =
// lambda h and y = 1 - exp(-x), with powers of lambda and x divided out analytically. With f(x) = 2x - 2y - y², the
// wavelet variance at marginal variance 1 and phi > 0 is
//     [f(x) + 2h (sinh lambda - lambda)] / (8 h² sinh²(lambda / 2)),
// and the derivatives follow from f' = 2 y². A function below uses a power series for small arguments if the leading
// terms of its direct form cancel there.
#include "gmwm/exponential.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <numbers>

#include "gmwm/clones.hpp"

namespace gmwm {

namespace {

constexpr double white = 700;  // upper limit of lambda, as cosh(lambda) would soon overflow

constexpr double factorial(int n) {
  double product = 1;
  for (int k = 2; k <= n; ++k) product *= k;
  return product;
}

constexpr double power_of_two(int n) {
  double power = 1;
  for (int k = 0; k < n; ++k) power *= 2;
  return power;
}

// Coefficients term(first) … term(last), the highest power first.
template <int first, int last, class Term>
constexpr auto series(Term term) {
  std::array<double, last - first + 1> coefficients{};
  for (int n = first; n <= last; ++n) coefficients[static_cast<std::size_t>(last - n)] = term(n);
  return coefficients;
}

constexpr double sign(int n) { return n % 2 ? -1.0 : 1.0; }

constexpr auto f_series = series<3, 24>([](int n) { return sign(n) * (4 - power_of_two(n)) / factorial(n); });
constexpr auto g_series = series<4, 26>([](int n) { return -sign(n) * (4 - power_of_two(n)) * (n - 3) / factorial(n); });
constexpr auto k_series = series<3, 26>([](int n) { return sign(n) * (power_of_two(n) - 4) * (1 - n) / factorial(n); });
// In v²: sinh v / v; (sinh v - v)/v³; (v cosh v - sinh v)/v³; and the numerators of r and t.
constexpr auto odd_series = series<0, 10>([](int k) { return 1 / factorial(2 * k + 1); });
constexpr auto excess_series = series<1, 10>([](int k) { return 1 / factorial(2 * k + 1); });
constexpr auto coth_series = series<1, 10>([](int k) { return 2.0 * k / factorial(2 * k + 1); });
constexpr auto ratio_series = series<1, 10>([](int k) { return 2 / factorial(2 * k) - 3 / factorial(2 * k + 1); });
constexpr auto far_series = series<2, 10>([](int k) { return 1 / factorial(2 * k + 1); });
// Of 6 - 8 exp(-x) + exp(-2x)·2, from x⁴ on.
constexpr auto fourth_series = series<4, 22>([](int n) { return sign(n) * (2 * power_of_two(n) - 8) / factorial(n); });
constexpr auto rest_series = series<4, 26>([](int n) {
  return -sign(n) * power_of_two(n) / (2 * factorial(n)) +
         (n % 2 ? 2 / factorial(n) - 2 / factorial(n - 1) : 1 / factorial(n - 1));
});

template <std::size_t size, class T>
GMWM_INLINE T polynomial(const std::array<double, size>& coefficients, T x) {
  T value = coefficients[0];
  for (std::size_t k = 1; k < size; ++k) value = value * x + coefficients[k];
  return value;
}

// (1 - exp(-v))/v
double decay(double v) { return -std::expm1(-v) / v; }

// f(x)/x³ with f(x) = 2(x - y) - y²
GMWM_INLINE double curve_f(double x, double y) {
  return x < 1 ? polynomial(f_series, x) : (2 * (x - y) - y * y) / (x * x * x);
}

// (3 f(x)/x - f'(x))/x³, with f = f(x)/x³
GMWM_INLINE double curve_g(double x, double y, double f) {
  return x < 1 ? polynomial(g_series, x) : 3 * f / x - 2 * y * y / (x * x * x);
}

// (3 - 4q + q² - 4xq + 2xq²)/x³, q = exp(-x)
GMWM_INLINE double curve_k(double x) {
  if (x < 1) return polynomial(k_series, x);
  const double q = std::exp(-x);
  return (3 - (4 + 4 * x) * q + (1 + 2 * x) * q * q) / (x * x * x);
}

// 2 exp(-lambda) (sinh lambda - lambda)/lambda³
double part_s(double v) {
  if (v < 1) return 2 * std::exp(-v) * polynomial(excess_series, v * v);
  return (-std::expm1(-2 * v) - 2 * v * std::exp(-v)) / (v * v * v);
}

// (v coth v - 1)/v²
double part_z(double v) {
  if (v < 1) return polynomial(coth_series, v * v) / polynomial(odd_series, v * v);
  return (v / std::tanh(v) - 1) / (v * v);
}

// coth(lambda/2) + coth(lambda) - 3/lambda
double part_r(double v) {
  if (v < 1) return v * polynomial(ratio_series, v * v) / polynomial(odd_series, v * v);
  return 1 / std::tanh(0.5 * v) + 1 / std::tanh(v) - 3 / v;
}

// [exp(-lambda) + lambda + 2 - lambda (coth lambda + coth(lambda/2))]/lambda³
double part_t(double v) {
  if (v < 1) return polynomial(rest_series, v) / polynomial(odd_series, v * v);
  return (std::exp(-v) + v + 2 - v * (1 / std::tanh(v) + 1 / std::tanh(0.5 * v))) / (v * v * v);
}

GMWM_INLINE void positive_shapes_inline(double lambda, const double* h, std::size_t n, double factor, double* out) {
  const double q = std::exp(-lambda), s = part_s(lambda);
  for (std::size_t j = 0; j < n; ++j) {
    const double x = lambda * h[j], y = -std::expm1(-x);
    out[j] = factor * (q * h[j] * curve_f(x, y) + s / h[j]);
  }
}
constexpr Clones<positive_shapes_inline> positive_shapes{};

GMWM_INLINE void marginal_slopes_inline(double lambda, const double* h, std::size_t n, double* out) {
  const double z = part_z(0.5 * lambda), e = decay(lambda), factor = std::exp(-lambda) / (2 * e * e);
  for (std::size_t j = 0; j < n; ++j) {
    const double x = lambda * h[j], y = -std::expm1(-x), share = y / x;
    const double curve = 2 * h[j] * h[j] * (share * share - curve_f(x, y) * (1 + 0.25 * lambda * lambda * z)) + z;
    out[j] = factor * curve / h[j];
  }
}
constexpr Clones<marginal_slopes_inline> marginal_slopes{};

GMWM_INLINE void innovation_slopes_inline(double lambda, const double* h, std::size_t n, double* out) {
  const double e1 = decay(lambda), e2 = decay(2 * lambda), factor = 1 / (4 * e1 * e1 * e2);
  const double r = part_r(lambda) - 1, t = 2 * part_t(lambda);
  for (std::size_t j = 0; j < n; ++j) {
    const double x = lambda * h[j], y = -std::expm1(-x), f = curve_f(x, y);
    out[j] = factor * (h[j] * h[j] * curve_g(x, y, f) + h[j] * f * r + t / h[j]);
  }
}
constexpr Clones<innovation_slopes_inline> innovation_slopes{};

}  // namespace

double log_decay(double phi) {
  const double size = std::max(std::abs(phi), std::exp(-white));
  return size > 0.5 ? -std::log1p(size - 1) : -std::log(size);
}

void exponential_shape(double lambda, std::span<const double> h, double* out) {
  lambda = std::min(lambda, white);
  const double e = decay(lambda);
  positive_shapes(lambda, h.data(), h.size(), lambda / (2 * e * e), out);
}

void exponential_slope(double lambda, std::span<const double> h, double* out) {
  marginal_slopes(std::min(lambda, white), h.data(), h.size(), out);
}

// phi^h is negative only at h = 1, where the wavelet variance is 1/(2 (1 + phi)).
void autoregressive_shape(double phi, std::span<const double> h, double* out) {
  const double lambda = log_decay(phi), e1 = decay(lambda);
  if (!(phi < 0)) {
    positive_shapes(lambda, h.data(), h.size(), 1 / (4 * e1 * e1 * decay(2 * lambda)), out);
    return;
  }
  const double above = 1 - phi, square = above * above;
  for (std::size_t j = 0; j < h.size(); ++j) {
    const double x = lambda * h[j], y = -std::expm1(-x);
    const double smooth = 0.5 / (h[j] * square) - phi * (y / x) * (2 + y) / (2 * h[j] * above * square * e1);
    out[j] = h[j] == 1 ? 0.5 / (lambda * e1) : smooth;
  }
}

void autoregressive_slope(double phi, std::span<const double> h, double* out) {
  const double lambda = log_decay(phi), e1 = decay(lambda);
  if (!(phi < 0)) {
    innovation_slopes(lambda, h.data(), h.size(), out);
    return;
  }
  const double above = 1 - phi, cube = above * above * above;
  const double w = (1 + 2 * phi) / above - 0.5 + 0.25 * lambda * part_z(0.5 * lambda);
  for (std::size_t j = 0; j < h.size(); ++j) {
    const double x = lambda * h[j], y = -std::expm1(-x);
    const double curve = h[j] * x * curve_k(x) + (y / x) * (2 + y) * w;
    const double smooth = 1 / (h[j] * cube) - curve / (2 * h[j] * cube * e1);
    out[j] = h[j] == 1 ? -0.5 / ((lambda * e1) * (lambda * e1)) : smooth;
  }
}

// With lambda = a + i omega, c = 1 + ia/omega and x = lambda h, 4h² times the wavelet variance is
//     Re c [2h coth(lambda/2) - (6 - 8 exp(-x) + 2 exp(-2x)) / (4 sinh²(lambda/2))].
void oscillation_shape(double damping, double turn, std::span<const double> h, double* out) {
  using Complex = std::complex<double>;
  // Above half the sampling rate, the turn of an alias has the same exponentials.
  const double cycle = 2 * std::numbers::pi, alias = turn - cycle * std::nearbyint(turn / cycle);
  const Complex lambda(std::min(damping, white), alias), c(1, damping / turn), half = 0.5 * lambda;
  const Complex slow = c / std::tanh(half), sine = std::sinh(half), quick = c / (4.0 * sine * sine);
  const Complex square = std::abs(lambda) < 0.5 ? half * half : Complex(0);
  const Complex excess = square * polynomial(excess_series, square);  // sinh v / v - 1 at v = lambda/2
  const Complex less = -excess * (2.0 + excess) / ((1.0 + excess) * (1.0 + excess));
  // Re c lambda is 0 without an alias, so that the series begins with its second term.
  const double first = damping * (1 - alias / turn) + (c * lambda * less).real();
  const Complex later = c * lambda * (1.0 + less), coth = 16.0 * square * polynomial(far_series, 4.0 * square);
  for (std::size_t j = 0; j < h.size(); ++j) {
    const Complex x = lambda * h[j];
    const double s = h[j], cube = s * s * s;
    if (std::abs(x) < 0.5) {
      const Complex rest = later * (s * coth - cube * x * polynomial(fourth_series, x));
      out[j] = ((4 * s + 8 * cube) / 6 * first + rest.real()) / (4 * s * s);
    } else {
      const Complex e = std::exp(-x);
      out[j] = (2 * s * slow - (6.0 - 8.0 * e + 2.0 * e * e) * quick).real() / (4 * s * s);
    }
  }
}

}  // namespace gmwm
