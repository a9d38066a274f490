// Polynomials modulo the autoregression and their covariances, shared by the kernels of ARMA processes.
//
// From lag m on the autocovariance follows r(k) = Σ φ_i r(k − i). So with z the shift by one lag, r(k) = L(z^k) for a
// linear functional L on polynomials modulo ψ(z) = z^m − Σ φ_i z^(m−i): L(Σ a_i z^i) = Σ a_i r(i), i < m. Sums over
// any number of lags are polynomials modulo ψ too, and a product costs O(m²) for any number of lags.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "gmwm/arma.hpp"
#include "gmwm/twofold.hpp"

namespace gmwm {

template <class T>
struct ArmaRing {
  ArmaOrders orders;
  std::size_t p, q, m;
  std::vector<std::size_t> taps;  // the i whose φ_i can be different from zero
  std::vector<T> store;
  T *ar, *ma, *r, *wide, *work, *partial, *errors, *driven;

  explicit ArmaRing(const ArmaOrders& given)
      : orders(given), p(given.full_ar()), q(given.full_ma()), m(given.states()) {
    for (std::size_t i = 1; i <= p; ++i) {
      const std::size_t season = i / orders.period, rest = i - season * orders.period;
      for (std::size_t k = 0; k <= season && k <= orders.seasonal_ar; ++k)
        if ((season - k) * orders.period + rest <= orders.ar) {
          taps.push_back(i);
          break;
        }
    }
    store.resize(2 * (p + 1) + 2 * (q + 1) + (p + 2) * 2 + 2 * m + 2 * m + (2 * m + q + p + 1));
    T* at = store.data();
    const auto take = [&at](std::size_t n) {
      T* here = at;
      at += n;
      return here;
    };
    ar = take(p + 1), ma = take(q + 1), work = take(p + q + 2), partial = take(p + 2), errors = take(p + 2);
    r = take(2 * m), wide = take(2 * m), driven = take(2 * m + q + p + 1);
  }

  // The full polynomials from the parameters θ_0, θ_1, … in the order phi, theta, seasonal phi, seasonal theta.
  GMWM_INLINE void multiply_out(const T* parameter) {
    const T *phi = parameter, *theta = phi + orders.ar, *Phi = theta + orders.ma, *Theta = Phi + orders.seasonal_ar;
    const T zero = T::of(0.0);
    for (std::size_t i = 0; i <= p; ++i) ar[i] = zero;
    for (std::size_t i = 0; i <= q; ++i) ma[i] = zero;
    for (std::size_t i = 1; i <= orders.ar; ++i) ar[i] = phi[i - 1];
    for (std::size_t k = 1; k <= orders.seasonal_ar; ++k) {
      const std::size_t at = k * orders.period;
      ar[at] = ar[at] + Phi[k - 1];
      for (std::size_t i = 1; i <= orders.ar; ++i) ar[at + i] = ar[at + i] - phi[i - 1] * Phi[k - 1];
    }
    ma[0] = T::of(1.0);
    for (std::size_t i = 1; i <= orders.ma; ++i) ma[i] = theta[i - 1];
    for (std::size_t k = 1; k <= orders.seasonal_ma; ++k) {
      const std::size_t at = k * orders.period;
      ma[at] = ma[at] + Theta[k - 1];
      for (std::size_t i = 1; i <= orders.ma; ++i) ma[at + i] = ma[at + i] + theta[i - 1] * Theta[k - 1];
    }
  }

  // Partial autocorrelations k_1 … k_p of an autoregression, and 1 − k²; `stationary` is cleared if |k| >= 1.
  GMWM_INLINE void step_down(const T* coefficients, std::size_t order, bool* stationary) {
    const T one = T::of(1.0);
    for (std::size_t i = 1; i <= order; ++i) work[i] = coefficients[i];
    for (std::size_t n = order; n >= 1; --n) {
      const T k = work[n], rest = (one - k) * (one + k);
      partial[n] = k, errors[n] = rest;
      for (std::size_t l = 0; l < T::lanes; ++l) stationary[l] = stationary[l] && rest.main().high[l] > 0.0;
      const T share = rest.inverse();
      for (std::size_t i = 1; 2 * i <= n; ++i) {
        const T a = work[i], b = work[n - i];
        work[i] = (a + k * b) * share;
        if (2 * i != n) work[n - i] = (b + k * a) * share;
      }
    }
  }

  // Autocovariances r(0) … r(2m − 1) from the autocovariances of the autoregression without moving average, whose first
  // values follow from Levinson's recursion.
  GMWM_INLINE void covariances(bool* stationary) {
    const std::size_t most = 2 * m + q;
    step_down(ar, p, stationary);
    T error = T::of(1.0);
    for (std::size_t n = 1; n <= p; ++n) error = error * errors[n].inverse();
    driven[0] = error;
    for (std::size_t n = 1; n <= p && n < most; ++n) {
      // work holds the predictor of order n − 1, `error` its variance.
      T next = partial[n] * error;
      for (std::size_t i = 1; i < n; ++i) next = next + work[i] * driven[n - i];
      driven[n] = next;
      for (std::size_t i = 1; 2 * i <= n; ++i) {
        const T a = work[i], b = work[n - i];
        work[i] = a - partial[n] * b;
        if (2 * i != n) work[n - i] = b - partial[n] * a;
      }
      work[n] = partial[n];
      error = error * errors[n];
    }
    for (std::size_t n = p + 1; n < most; ++n) {
      driven[n] = T::of(0.0);
      for (const std::size_t i : taps) driven[n] = driven[n] + ar[i] * driven[n - i];
    }
    for (std::size_t n = 0; n < 2 * m; ++n) r[n] = T::of(0.0);
    for (std::size_t lag = 0; lag <= q; ++lag) {
      T weight = T::of(0.0);
      for (std::size_t i = 0; i + lag <= q; ++i) weight = weight + ma[i] * ma[i + lag];
      for (std::size_t n = 0; n < 2 * m; ++n) {
        T both = driven[n > lag ? n - lag : lag - n];
        if (lag > 0) both = both + driven[n + lag];
        r[n] = r[n] + weight * both;
      }
    }
  }

  // c = a b modulo ψ; c may be a or b.
  GMWM_INLINE void product(const T* a, const T* b, T* c) {
    for (std::size_t n = 0; n < m; ++n) wide[n] = a[0] * b[n];
    for (std::size_t n = m; n + 1 < 2 * m; ++n) wide[n] = T::of(0.0);
    for (std::size_t i = 1; i < m; ++i)
      for (std::size_t n = 0; n < m; ++n) wide[i + n] = wide[i + n] + a[i] * b[n];
    for (std::size_t n = 2 * m - 2; n >= m; --n)
      for (const std::size_t i : taps) wide[n - i] = wide[n - i] + ar[i] * wide[n];
    for (std::size_t n = 0; n < m; ++n) c[n] = wide[n];
  }

  // a z modulo ψ, in place.
  GMWM_INLINE void shift(T* a) {
    const T top = a[m - 1];
    for (std::size_t n = m - 1; n >= 1; --n) a[n] = a[n - 1];
    a[0] = T::of(0.0);
    for (const std::size_t i : taps) a[m - i] = a[m - i] + ar[i] * top;
  }

  // L(a).
  GMWM_INLINE T at(const T* a) const {
    T sum = a[0] * r[0];
    for (std::size_t n = 1; n < m; ++n) sum = sum + a[n] * r[n];
    return sum;
  }

  // L(z a b).
  GMWM_INLINE T later(const T* a, const T* b) const {
    T sum = T::of(0.0);
    for (std::size_t i = 0; i < m; ++i) {
      T part = b[0] * r[i + 1];
      for (std::size_t n = 1; n < m; ++n) part = part + b[n] * r[i + n + 1];
      sum = sum + a[i] * part;
    }
    return sum;
  }

  GMWM_INLINE void constant(double value, T* a) const {
    for (std::size_t n = 0; n < m; ++n) a[n] = T::of(n == 0 ? value : 0.0);
  }
};

}  // namespace gmwm
