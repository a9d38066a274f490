#include "gmwm/spectral_shape.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/dense.hpp"

namespace gmwm {

namespace {

// out = 1 + Σ c_k wave_k, for one part of the waves.
GMWM_INLINE void combination_inline(const double* waves, std::size_t n, const double* c, std::size_t count, double one,
                                    double* out) {
  std::fill_n(out, n, one);
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t i = 0; i < n; ++i) out[i] += c[k] * waves[k * n + i];
}
constexpr Clones<combination_inline> combination{};

// out_k = factor (real_k re + imaginary_k im) for each coefficient k.
GMWM_INLINE void slopes_inline(const double* real, const double* imaginary, std::size_t n, std::size_t count,
                               const double* re, const double* im, double* out) {
  for (std::size_t k = 0; k < count; ++k)
    for (std::size_t i = 0; i < n; ++i) out[k * n + i] = real[k * n + i] * re[i] + imaginary[k * n + i] * im[i];
}
constexpr Clones<slopes_inline> slopes{};

class Descent {
 public:
  Descent(const SpectralData& data, const DescentOptions& options, std::size_t parameters)
      : data_(data), options_(options), n_(data.logs.size()), m_(parameters), q_(parameters - 2 - options.p),
        values_(6 * n_), jacobian_(m_ * n_), weighted_(n_), normal_(m_ * m_), slope_(m_) {}

  // The loss at some parameters; the arrays for the derivatives there are computed too.
  double loss(std::span<const double> at) {
    const std::size_t lags = data_.waves.size() / (2 * n_), p = options_.p;
    const double *real = data_.waves.data(), *imaginary = real + lags * n_;
    double *below_re = values_.data(), *below_im = below_re + n_, *above_re = below_im + n_, *above_im = above_re + n_,
           *left = above_im + n_, *share = left + n_;
    combination(real, n_, &at[1], p, 1.0, below_re);
    combination(imaginary, n_, &at[1], p, 0.0, below_im);
    combination(real, n_, &at[1] + p, q_, 1.0, above_re);
    combination(imaginary, n_, &at[1] + p, q_, 0.0, above_im);
    const double scale = std::exp(at[0]), slow = std::exp(at[m_ - 1]);
    double sum = 0.0;
    for (std::size_t i = 0; i < n_; ++i) {
      const double above = above_re[i] * above_re[i] + above_im[i] * above_im[i];
      const double below = below_re[i] * below_re[i] + below_im[i] * below_im[i];
      const double own = scale * above / below;
      const double total = own + slow * data_.known[i] + data_.floor;
      left[i] = data_.logs[i] - std::log(total);
      share[i] = own / total;
      sum += data_.weights[i] * left[i] * left[i];
    }
    sum += at[m_ - 1] / data_.prior * (at[m_ - 1] / data_.prior);
    return std::isfinite(sum) ? sum : std::numeric_limits<double>::infinity();
  }

  // The normal equations at the parameters of the last call of loss(), whose arrays are used up; false if they are not
  // finite.
  bool equations(std::span<const double> at) {
    const std::size_t lags = data_.waves.size() / (2 * n_), p = options_.p;
    const double *real = data_.waves.data(), *imaginary = real + lags * n_;
    double *below_re = values_.data(), *below_im = below_re + n_, *above_re = below_im + n_, *above_im = above_re + n_,
           *left = above_im + n_, *share = left + n_;
    std::copy_n(share, n_, jacobian_.data());
    // The derivative of log |a|² with respect to a_k is 2 Re(z^k / a).
    for (std::size_t i = 0; i < n_; ++i) {
      const double below = -2.0 * share[i] / (below_re[i] * below_re[i] + below_im[i] * below_im[i]);
      const double above = 2.0 * share[i] / (above_re[i] * above_re[i] + above_im[i] * above_im[i]);
      below_re[i] *= below;
      below_im[i] *= below;
      above_re[i] *= above;
      above_im[i] *= above;
    }
    slopes(real, imaginary, n_, p, below_re, below_im, &jacobian_[n_]);
    slopes(real, imaginary, n_, q_, above_re, above_im, &jacobian_[(1 + p) * n_]);
    const double slow = std::exp(at[m_ - 1]);
    for (std::size_t i = 0; options_.free && i < n_; ++i)
      jacobian_[(m_ - 1) * n_ + i] = slow * data_.known[i] * std::exp(left[i] - data_.logs[i]);
    const std::size_t used = options_.free ? m_ : m_ - 1;
    std::fill(normal_.begin(), normal_.end(), 0.0);
    std::fill(slope_.begin(), slope_.end(), 0.0);
    for (std::size_t j = 0; j < used; ++j) {
      for (std::size_t i = 0; i < n_; ++i) weighted_[i] = data_.weights[i] * jacobian_[j * n_ + i];
      for (std::size_t k = 0; k <= j; ++k)
        normal_[j * m_ + k] = normal_[k * m_ + j] = dot(weighted_.data(), &jacobian_[k * n_], n_);
      slope_[j] = dot(weighted_.data(), left, n_);
    }
    const double prior = 1.0 / (data_.prior * data_.prior);
    normal_[m_ * m_ - 1] += prior;
    slope_[m_ - 1] -= at[m_ - 1] * prior;
    return std::all_of(normal_.begin(), normal_.end(), [](double one) { return std::isfinite(one); });
  }

  double descend(std::span<double> at) {
    double here = loss(at), damping = 1e-3;
    std::vector<double> damped, step, there(m_);
    for (std::size_t count = 0; count < options_.steps; ++count) {
      if (!equations(at)) break;
      double trace = 0.0;
      for (std::size_t k = 0; k < m_; ++k) trace += normal_[k * m_ + k];
      double lower = std::numeric_limits<double>::infinity();
      bool found = false;
      for (; damping < 1e8; damping *= 4.0) {
        damped = normal_;
        step = slope_;
        for (std::size_t k = 0; k < m_; ++k) damped[k * m_ + k] += damping * (normal_[k * m_ + k] + 1e-12 * trace);
        if (!solve_linear(damped, step)) continue;
        for (std::size_t k = 0; k < m_; ++k) there[k] = at[k] + step[k];
        lower = loss(there);
        found = lower < here;
        if (found) break;
      }
      if (!found) break;
      const bool done = here - lower < options_.near * std::max(lower, 1.0);
      std::copy(there.begin(), there.end(), at.begin());
      here = lower;
      damping = std::max(damping / 6.0, 1e-9);
      if (done) break;
    }
    return here;
  }

 private:
  const SpectralData& data_;
  const DescentOptions& options_;
  std::size_t n_, m_, q_;
  std::vector<double> values_, jacobian_, weighted_, normal_, slope_;
};

}  // namespace

double spectral_descent(const SpectralData& data, const DescentOptions& options, std::span<double> parameters) {
  return Descent(data, options, parameters.size()).descend(parameters);
}

bool roots_inside(std::span<const double> c, double most) {
  // The roots divided by `most` are inside the unit circle if all reflection coefficients are below 1.
  std::vector<double> a(c.begin(), c.end()), next(c.size());
  double power = 1.0;
  for (double& one : a) one /= power *= most;
  for (std::size_t n = a.size(); n > 0; --n) {
    const double reflection = a[n - 1];
    if (!(std::abs(reflection) < 1.0)) return false;
    for (std::size_t k = 0; k + 1 < n; ++k)
      next[k] = (a[k] - reflection * a[n - 2 - k]) / (1.0 - reflection * reflection);
    std::swap(a, next);
  }
  return true;
}

}  // namespace gmwm
