// One step of the covariance of the Kalman filter, for plain numbers and for numbers with derivatives.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/dual.hpp"
#include "gmwm/kalman.hpp"

#if defined(__SSE2__)
#include <xmmintrin.h>
#endif

namespace gmwm {

// Means that decay become subnormal numbers, with which a product takes a hundred times as long. They are replaced by
// 0.
class FlushToZero {
 public:
#if defined(__SSE2__)
  FlushToZero() : before_(_mm_getcsr()) { _mm_setcsr(before_ | 0x8040); }
  ~FlushToZero() { _mm_setcsr(before_); }
  FlushToZero(const FlushToZero&) = delete;
  FlushToZero& operator=(const FlushToZero&) = delete;

 private:
  unsigned before_;
#elif defined(__aarch64__) && defined(__GNUC__)
  FlushToZero() {
    __asm__ volatile("mrs %0, fpcr" : "=r"(before_));
    __asm__ volatile("msr fpcr, %0" : : "r"(before_ | (std::uint64_t{1} << 24)));
  }
  ~FlushToZero() { __asm__ volatile("msr fpcr, %0" : : "r"(before_)); }
  FlushToZero(const FlushToZero&) = delete;
  FlushToZero& operator=(const FlushToZero&) = delete;

 private:
  std::uint64_t before_;
#else
  FlushToZero() {}  // not trivial, so that a guard is not an unused variable
#endif
};

// A sum of logarithms, computed as the logarithm of a product whose exponent is stored separately.
class LogSum {
 public:
  GMWM_INLINE void add(double value) {
    int exponent;
    product_ *= std::frexp(value, &exponent);
    exponents_ += exponent;
    if (++count_ == 512) fold();  // 2^-512 is still a normal number
  }
  // Several values at once. The product of their ratios rarely leaves the range of normal numbers.
  template <std::size_t N>
  GMWM_INLINE void add(const std::array<double, N>& values) {
    const double first = 1 / values[0];
    double product = 1;
    for (const double value : values) product *= value * first;
    if (product > 1e-290 && product < 1e290)
      sum_ += std::log(product) + static_cast<double>(N) * std::log(values[0]);
    else
      for (const double value : values) sum_ += std::log(value);
  }
  double total() {
    fold();
    return sum_ + static_cast<double>(exponents_) * 0.69314718055994530942;
  }

 private:
  void fold() {
    sum_ += std::log(product_);
    product_ = 1;
    count_ = 0;
  }
  double product_ = 1, sum_ = 0;
  long long exponents_ = 0;
  int count_ = 0;
};

// An element of F that is not always zero.
struct Place {
  std::size_t row, column;
};

template <class T>
class Machine {
 public:
  std::size_t p;
  std::vector<Place> places;
  std::vector<T> f, Q, H, P;
  std::vector<T> M, G;  // P Hᵀ, and the gain F P Hᵀ / S
  T R, S, inverse_S;
  bool diagonal, settled = false;
  bool quick;  // F is diagonal, and no element of H is zero

  Machine(std::size_t states, std::vector<Place> where, std::vector<T> transition, std::vector<T> noise,
          std::vector<T> seen, std::vector<T> start, T observation)
      : p(states), places(std::move(where)), f(std::move(transition)), Q(std::move(noise)), H(std::move(seen)),
        P(std::move(start)), M(p), G(p), R(observation), S(0.0), inverse_S(0.0),
        diagonal(std::all_of(places.begin(), places.end(), [](const Place& at) { return at.row == at.column; })),
        quick(diagonal && std::all_of(H.begin(), H.end(), [](const T& h) { return value_of(h) != 0; })),
        work_(p * p), before_(p * p) {}

  // S, M and G of the next sample. Returns false if its innovation has zero variance.
  GMWM_INLINE bool gain() {
    S = R;
    for (std::size_t i = 0; i < p; ++i) {
      T sum = P[i * p] * H[0];
      for (std::size_t j = 1; j < p; ++j) sum += P[i * p + j] * H[j];
      M[i] = sum;
      S += H[i] * sum;
      G[i] = T(0.0);
    }
    if (!(value_of(S) > 0)) return false;
    inverse_S = inverse(S);
    for (std::size_t k = 0; k < places.size(); ++k) G[places[k].row] += f[k] * M[places[k].column];
    for (std::size_t i = 0; i < p; ++i) G[i] = G[i] * inverse_S;
    return true;
  }

  // Measurement update: P ← P − M Mᵀ / S.
  GMWM_INLINE void learn() {
    for (std::size_t i = 0; i < p; ++i) {
      const T share = M[i] * inverse_S;
      for (std::size_t j = i; j < p; ++j) {
        P[i * p + j] -= share * M[j];
        P[j * p + i] = P[i * p + j];
      }
    }
  }

  // Time update: P ← F P Fᵀ + Q.
  GMWM_INLINE void advance() {
    if (diagonal) {
      for (std::size_t i = 0; i < p; ++i)
        for (std::size_t j = i; j < p; ++j) {
          P[i * p + j] = f[i] * P[i * p + j] * f[j] + Q[i * p + j];
          P[j * p + i] = P[i * p + j];
        }
      return;
    }
    std::fill(work_.begin(), work_.end(), T(0.0));
    for (std::size_t k = 0; k < places.size(); ++k)
      for (std::size_t j = 0; j < p; ++j) work_[places[k].row * p + j] += f[k] * P[places[k].column * p + j];
    P = Q;
    for (std::size_t k = 0; k < places.size(); ++k)
      for (std::size_t i = 0; i <= places[k].row; ++i)
        P[i * p + places[k].row] += work_[i * p + places[k].column] * f[k];
    for (std::size_t i = 0; i < p; ++i)
      for (std::size_t j = 0; j < i; ++j) P[i * p + j] = P[j * p + i];
  }

  // A sample is missing: P may now reach an earlier value again without having converged.
  GMWM_INLINE void interrupt() {
    settled = false;
    if (p != 0) before_[0] = T(std::numeric_limits<double>::quiet_NaN());
  }

  // Whether P is the same as at the last call, up to rounding, without a missing sample since then.
  GMWM_INLINE bool same_as_before() {
    bool same = true;
    for (std::size_t i = 0; i < p && same; ++i)
      for (std::size_t j = i; j < p && same; ++j) same = close(P[i * p + j], before_[i * p + j], scale(i, j));
    if (!same) before_ = P;
    return same;
  }

  static GMWM_INLINE bool close(double now, double then, double scale) {
    return std::abs(now - then) <= 4e-16 * scale;
  }
  template <std::size_t L>
  static GMWM_INLINE bool close(const Dual<L>& now, const Dual<L>& then, double scale) {
    bool same = close(now.v, then.v, scale);
    // Derivatives are with respect to logarithms or to parameters of order one, so they have the order of magnitude of
    // the values.
    for (std::size_t l = 0; l < L; ++l)
      same = same && std::abs(now.d[l] - then.d[l]) <= 1e-13 * (scale + std::abs(now.d[l]));
    return same;
  }

 private:
  std::vector<T> work_, before_;

  GMWM_INLINE double scale(std::size_t i, std::size_t j) const {
    return std::sqrt(std::abs(value_of(P[i * p + i]) * value_of(P[j * p + j])));
  }
};

// The gains of a record without gaps, computed from the change of the covariance only, P_{t+1} − P_t = Y M Yᵀ. Its rank
// is small if the states start in their stationary distribution: 1, plus 1 for each random walk. With W = F − G H,
//   S' = S + H Y M Yᵀ Hᵀ,   G' S' = G S + F Y M Yᵀ Hᵀ,   M' = M − M Yᵀ Hᵀ H Y M / S',   Y' = W Y
// (Morf, Sidhu and Kailath 1974). The covariance itself is not updated, so early errors would persist. Therefore the
// first gains, which change fast, are computed from the covariance.
template <class T>
class Changes {
 public:
  explicit Changes(const Machine<T>& m, bool whole) : p_(m.p) {
    if (!whole || p_ == 0) return;
    // The increase of P0 by the first time update, without the decrease by the first measurement.
    Machine<T> stepped = m;
    stepped.advance();
    std::vector<std::size_t> moving;
    const auto size = [&](std::size_t i) { return std::abs(value_of(m.P[i * p_ + i])) + std::abs(value_of(m.Q[i * p_ + i])); };
    for (std::size_t i = 0; i < p_; ++i)
      for (std::size_t j = i; j < p_; ++j) {
        const double change = std::abs(value_of(stepped.P[i * p_ + j]) - value_of(m.P[i * p_ + j]));
        if (change <= 1e-12 * std::sqrt(size(i) * size(j))) continue;
        if (i != j || moving.size() == most_moving) return;
        moving.push_back(i);
      }
    r_ = 1 + moving.size();
    Y_.assign(p_ * r_, T(0.0));
    M_.assign(r_ * r_, T(0.0));
    hy_.assign(r_, T(0.0));
    w_.assign(r_, T(0.0));
    FY_.assign(p_ * r_, T(0.0));
    for (std::size_t k = 0; k < moving.size(); ++k) {
      const std::size_t i = moving[k];
      Y_[i * r_ + k + 1] = T(1.0);
      M_[(k + 1) * r_ + k + 1] = stepped.P[i * p_ + i] - m.P[i * p_ + i];
    }
  }

  GMWM_INLINE bool running() const { return running_; }

  // Update Y and M with the gains of the next sample, which are computed from the covariance.
  GMWM_INLINE void watch(const Machine<T>& m) {
    if (r_ == 0) return;
    if (seen_++ == 0) {
      for (std::size_t i = 0; i < p_; ++i) Y_[i * r_] = m.G[i];
      M_[0] = T(0.0);
      M_[0] -= m.S;
    } else {
      spread(m);
      turn(m.inverse_S, before_);
    }
    before_ = m.G;
    running_ = seen_ == warm_up;
  }

  // S, 1/S and G of the next sample from the values of this sample.
  GMWM_INLINE void step(Machine<T>& m) {
    spread(m);
    T S = m.S;
    for (std::size_t k = 0; k < r_; ++k) S += hy_[k] * w_[k];
    const T inverse_S = inverse(S), share = m.S * inverse_S;
    for (std::size_t i = 0; i < p_; ++i) {
      before_[i] = m.G[i];
      T sum = FY_[i * r_] * w_[0];
      for (std::size_t k = 1; k < r_; ++k) sum += FY_[i * r_ + k] * w_[k];
      m.G[i] = m.G[i] * share + sum * inverse_S;
    }
    m.S = S;
    m.inverse_S = inverse_S;
    turn(inverse_S, before_);
  }

  // Whether the gains are the same as at the last call, up to rounding.
  GMWM_INLINE bool same_as_before(const Machine<T>& m) {
    bool same = Machine<T>::close(m.S, S_then_, std::abs(value_of(m.S)));
    for (std::size_t i = 0; i < p_ && same; ++i)
      same = Machine<T>::close(m.G[i], G_then_[i], std::abs(value_of(m.G[i])));
    if (!same) {
      S_then_ = m.S;
      G_then_ = m.G;
    }
    return same;
  }

 private:
  static constexpr std::size_t most_moving = 2, warm_up = 64;
  std::size_t p_, r_ = 0, seen_ = 0;
  bool running_ = false;
  std::vector<T> Y_, M_, hy_, w_, FY_, before_, G_then_;
  T S_then_ = T(0.0);

  // H Y, M Yᵀ Hᵀ and F Y.
  GMWM_INLINE void spread(const Machine<T>& m) {
    for (std::size_t k = 0; k < r_; ++k) {
      T sum = m.H[0] * Y_[k];
      for (std::size_t i = 1; i < p_; ++i) sum += m.H[i] * Y_[i * r_ + k];
      hy_[k] = sum;
    }
    for (std::size_t a = 0; a < r_; ++a) {
      T sum = M_[a * r_] * hy_[0];
      for (std::size_t b = 1; b < r_; ++b) sum += M_[a * r_ + b] * hy_[b];
      w_[a] = sum;
    }
    if (m.diagonal) {
      for (std::size_t i = 0; i < p_; ++i)
        for (std::size_t k = 0; k < r_; ++k) FY_[i * r_ + k] = m.f[i] * Y_[i * r_ + k];
      return;
    }
    for (T& value : FY_) value = T(0.0);
    for (std::size_t q = 0; q < m.places.size(); ++q)
      for (std::size_t k = 0; k < r_; ++k)
        FY_[m.places[q].row * r_ + k] += m.f[q] * Y_[m.places[q].column * r_ + k];
  }

  // M and Y of the next step, with the gain of this step.
  GMWM_INLINE void turn(const T& inverse_S, const std::vector<T>& gain) {
    for (std::size_t a = 0; a < r_; ++a) {
      const T share = w_[a] * inverse_S;
      for (std::size_t b = 0; b < r_; ++b) M_[a * r_ + b] -= share * w_[b];
    }
    for (std::size_t i = 0; i < p_; ++i)
      for (std::size_t k = 0; k < r_; ++k) {
        Y_[i * r_ + k] = FY_[i * r_ + k];
        Y_[i * r_ + k] -= gain[i] * hy_[k];
      }
  }
};

constexpr std::size_t check_every = 16;
constexpr std::size_t most_states = 64;

Machine<double> machine_of(const System& system);

// Number of consecutive samples from t on that are not missing, at most `most`.
GMWM_INLINE std::size_t observed_run(const double* y, std::size_t most) {
  std::size_t k = 0;
  while (k < most && y[k] == y[k]) ++k;
  return k;
}

}  // namespace gmwm
