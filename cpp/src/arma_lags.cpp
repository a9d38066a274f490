// Built with -ffp-contract=off (CMakeLists.txt), see twofold.hpp.
#include <bit>
#include <cmath>
#include <limits>

#include "gmwm/arma.hpp"
#include "gmwm/arma_ring.hpp"

namespace gmwm {

namespace {

using T = Twofold<1>;

ArmaRing<T> ring_of(const ArmaOrders& orders, std::span<const double> parameters) {
  ArmaRing<T> ring(orders);
  std::vector<T> given(orders.parameters() + 1);
  for (std::size_t k = 0; k < orders.parameters(); ++k) given[k] = T::of(parameters[k]);
  ring.multiply_out(given.data());
  bool stationary = true;
  ring.covariances(&stationary);
  if (!stationary) ring.r[0] = T::of(std::numeric_limits<double>::quiet_NaN());
  return ring;
}

std::size_t bits(std::int64_t n) { return static_cast<std::size_t>(std::bit_width(static_cast<std::uint64_t>(n))); }

// A complex number of twice the digits.
struct Twin {
  T re = T::of(0.0), im = T::of(0.0);

  friend Twin operator+(const Twin& a, const Twin& b) { return {a.re + b.re, a.im + b.im}; }
  friend Twin operator-(const Twin& a, const Twin& b) { return {a.re - b.re, a.im - b.im}; }
  friend Twin operator*(const Twin& a, const Twin& b) {
    return {a.re * b.re - a.im * b.im, a.re * b.im + a.im * b.re};
  }
  Twin inverse() const {
    const T over = (re * re + im * im).inverse();
    return {re * over, T::of(0.0) - im * over};
  }
};

// Σ z^k over k < h, z^h and the variance of a sum of h samples, updated for increasing h.
struct Sum {
  ArmaRing<T>& ring;
  std::vector<T> S, u, work;
  T variance = T::of(0.0);
  std::int64_t h = 0;

  explicit Sum(ArmaRing<T>& over) : ring(over), S(over.m), u(over.m), work(over.m) { clear(); }

  void clear() {
    ring.constant(0.0, S.data());
    ring.constant(1.0, u.data());
    variance = T::of(0.0), h = 0;
  }
  void one_more() {
    variance = variance + ring.r[0] + 2.0 * ring.later(S.data(), one().data());
    ring.shift(S.data());
    S[0] = S[0] + T::of(1.0);
    ring.shift(u.data());
    ++h;
  }
  void twice() {
    variance = 2.0 * (variance + ring.later(S.data(), S.data()));
    ring.product(S.data(), u.data(), work.data());
    for (std::size_t n = 0; n < ring.m; ++n) S[n] = S[n] + work[n];
    ring.product(u.data(), u.data(), u.data());
    h *= 2;
  }
  void reach(std::int64_t size) {
    if (size - h > static_cast<std::int64_t>(6 * bits(size))) {
      clear();
      for (std::size_t bit = bits(size); bit-- > 0;) {
        twice();
        if (size >> bit & 1) one_more();
      }
    }
    while (h < size) one_more();
  }

 private:
  const std::vector<T>& one() {
    ring.constant(1.0, work.data());
    return work;
  }
};

}  // namespace

void arma_autocovariance(const ArmaOrders& orders, std::span<const double> parameters,
                         std::span<const std::int64_t> lags, bool from_zero, std::span<double> out) {
  ArmaRing<T> ring = ring_of(orders, parameters);
  const std::size_t m = ring.m;
  // r(k) … r(k + m − 1) in a ring buffer, the first at `start`.
  std::vector<T> window(ring.r, ring.r + m), moved(m), power(m);
  const T zero = from_zero ? ring.r[0] : T::of(0.0);
  std::size_t start = 0;
  std::int64_t k = 0;
  for (std::size_t at = 0; at < lags.size(); ++at) {
    const std::int64_t gap = lags[at] - k;
    const std::size_t cost = 4 * m * (bits(gap) + 1);
    if (gap > static_cast<std::int64_t>(cost)) {
      ring.constant(1.0, power.data());
      for (std::size_t bit = bits(gap); bit-- > 0;) {
        ring.product(power.data(), power.data(), power.data());
        if (gap >> bit & 1) ring.shift(power.data());
      }
      for (std::size_t n = 0; n < m; ++n) {
        T sum = T::of(0.0);
        for (std::size_t i = 0; i < m; ++i) sum = sum + power[i] * window[(start + i) % m];
        moved[n] = sum;
        ring.shift(power.data());
      }
      window = moved, start = 0, k = lags[at];
    }
    for (; k < lags[at]; ++k) {
      T next = T::of(0.0);
      for (const std::size_t i : ring.taps) {
        const std::size_t place = start + m - i;
        next = next + ring.ar[i] * window[place < m ? place : place - m];
      }
      window[start] = next;
      start = start + 1 == m ? 0 : start + 1;
    }
    out[at] = (window[start] - zero).high[0];
  }
}

void arma_without(const ArmaOrders& orders, std::span<const double> parameters, const ArmaRoots& roots,
                  const ArmaExponentials& exponentials, std::span<double> out) {
  constexpr int newton_steps = 6;
  ArmaRing<T> ring = ring_of(orders, parameters);
  const std::size_t p = ring.p, m = ring.m;
  const T one = T::of(1.0);
  std::vector<Twin> lambdas, terms;
  for (std::size_t at = 0; at < roots.re.size(); ++at) {
    const bool real = roots.im[at] == 0;
    Twin x{T::of(roots.re[at]), T::of(roots.im[at])}, slope{};
    for (int step = 0; step < newton_steps; ++step) {
      Twin value{one};
      slope = {};
      for (std::size_t i = 1; i <= p; ++i) slope = slope * x + value, value = value * x - Twin{ring.ar[i]};
      if (step + 1 < newton_steps) x = x - value * slope.inverse();
    }
    // θ(λ) θ(1/λ) λ^(p - 1) / (P'(λ) φ(λ)), P(x) = x^p φ(1/x).
    const Twin inverse = x.inverse();
    Twin phi, theta, theta_inverse, power{one};
    for (std::size_t i = p; i >= 1; --i) phi = (phi + Twin{ring.ar[i]}) * x;
    phi = Twin{one} - phi;
    for (std::size_t i = ring.q + 1; i-- > 0;) {
      theta = theta * x + Twin{ring.ma[i]};
      theta_inverse = theta_inverse * inverse + Twin{ring.ma[i]};
    }
    for (std::size_t i = 1; i < p; ++i) power = power * x;
    Twin term = theta * theta_inverse * power * (slope * phi).inverse();
    // Of a pair of complex roots, the real part is twice that of one root.
    if (!real) term = {2.0 * term.re, 2.0 * term.im};
    terms.push_back(term);
    lambdas.push_back(x);
    const double lost = (one - (x.re * x.re + x.im * x.im)).high[0];
    exponentials.decay_re[at] = -0.5 * std::log1p(-lost);
    exponentials.decay_im[at] = std::atan2(x.im.high[0], x.re.high[0]);
    exponentials.amplitude_re[at] = term.re.high[0];
    // The exponential of the conjugate root is exp(-λ) for λ with a positive imaginary part.
    exponentials.amplitude_im[at] = -term.im.high[0];
  }
  // r(k) … r(k + m − 1), the oldest at `start`.
  std::vector<T> window(ring.r, ring.r + m);
  for (std::size_t k = 0, start = 0; k < out.size(); ++k) {
    T rest = window[start], next = T::of(0.0);
    for (std::size_t at = 0; at < terms.size(); ++at) {
      rest = rest - terms[at].re;
      terms[at] = terms[at] * lambdas[at];
    }
    out[k] = rest.high[0];
    for (const std::size_t i : ring.taps) next = next + ring.ar[i] * window[(start + m - i) % m];
    window[start] = next;
    start = (start + 1) % m;
  }
}

void arma_block_variance(const ArmaOrders& orders, std::span<const double> parameters,
                         std::span<const std::int64_t> sizes, std::span<double> out) {
  ArmaRing<T> ring = ring_of(orders, parameters);
  Sum sum(ring);
  for (std::size_t at = 0; at < sizes.size(); ++at) {
    sum.reach(sizes[at]);
    out[at] = sum.variance.high[0];
  }
}

void arma_recursion(const ArmaOrders& orders, std::span<const double> parameters, std::span<double> phi,
                    std::span<double> theta, std::span<double> predictors, std::span<double> deviations) {
  ArmaRing<T> ring = ring_of(orders, parameters);
  const std::size_t p = ring.p;
  for (std::size_t i = 1; i <= p; ++i) phi[i - 1] = ring.ar[i].high[0];
  for (std::size_t i = 1; i <= ring.q; ++i) theta[i - 1] = ring.ma[i].high[0];
  T error = ring.driven[0];
  std::vector<T> predictor(p + 1), before;
  for (std::size_t n = 0; n < p; ++n) {
    // The predictor from n values, and the variance of its error.
    for (std::size_t i = 1; i <= p; ++i) predictors[n * p + i - 1] = i <= n ? predictor[i].high[0] : 0.0;
    deviations[n] = std::sqrt(error.high[0]);
    before = predictor;
    const T k = ring.partial[n + 1];
    for (std::size_t i = 1; i <= n; ++i) predictor[i] = before[i] - k * before[n + 1 - i];
    predictor[n + 1] = k;
    error = error * ring.errors[n + 1];
  }
}

}  // namespace gmwm
