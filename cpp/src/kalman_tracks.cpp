#include <cmath>
#include <limits>

#include "gmwm/kalman_step.hpp"
#include "gmwm/pause.hpp"

namespace gmwm {

namespace {

constexpr std::size_t stride = 4096;
constexpr double unknown = std::numeric_limits<double>::infinity();

// The state of the filter between two samples: the covariance, the predicted means (k, p), and the sums for the
// regressors.
struct Standing {
  Machine<double> machine;
  std::vector<double> means;
  std::vector<double> cross;  // Σ v_a v_b / S up to here (k, k)
  std::size_t seen = 0;
};

// The results of the filter at a sample that the backward pass needs.
struct Seen {
  bool there;
  std::vector<double> v, means;       // (k), filtered means (k, p)
  std::vector<double> P, gain;        // filtered covariance (p, p), gain of the predictor (p)
  double inverse_S;
};

// Coefficients of the m regressors by least squares from the cross sums, and their covariance; false while unknown.
bool coefficients(const std::vector<double>& cross, std::size_t k, std::vector<double>& beta, std::vector<double>& cov) {
  const std::size_t m = k - 1;
  if (m == 1) {  // fast path: called at each sample of a filter
    const double own = cross[k + 1];
    if (!(own > 0)) return false;
    beta.assign(1, cross[1] / own);
    cov.assign(1, 1 / own);
    return true;
  }
  std::vector<double> a(m * m), inverse(m * m, 0.0), scale(m);
  for (std::size_t i = 0; i < m; ++i) {
    const double own = cross[(i + 1) * k + i + 1];
    if (!(own > 0)) return false;
    scale[i] = 1 / std::sqrt(own);
  }
  for (std::size_t i = 0; i < m; ++i) {
    inverse[i * m + i] = 1;
    for (std::size_t j = 0; j < m; ++j) {
      const std::size_t row = std::min(i, j) + 1, column = std::max(i, j) + 1;
      a[i * m + j] = cross[row * k + column] * scale[i] * scale[j];
    }
  }
  // Gauss-Jordan; a correlation matrix needs no pivots.
  for (std::size_t c = 0; c < m; ++c) {
    const double pivot = a[c * m + c];
    if (!(pivot > 1e-13)) return false;
    for (std::size_t j = 0; j < m; ++j) a[c * m + j] /= pivot, inverse[c * m + j] /= pivot;
    for (std::size_t i = 0; i < m; ++i) {
      if (i == c) continue;
      const double factor = a[i * m + c];
      for (std::size_t j = 0; j < m; ++j) {
        a[i * m + j] -= factor * a[c * m + j];
        inverse[i * m + j] -= factor * inverse[c * m + j];
      }
    }
  }
  beta.assign(m, 0.0);
  cov.resize(m * m);
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t j = 0; j < m; ++j) {
      cov[i * m + j] = inverse[i * m + j] * scale[i] * scale[j];
      beta[i] += cov[i * m + j] * cross[j + 1];
    }
  return true;
}

class Tracker {
 public:
  Tracker(const System& system, const Series& series, const Selection& selection, bool smooth, std::span<double> means,
          std::span<double> variances)
      : series_(series), pick_(selection), smooth_(smooth), means_(means), variances_(variances), p_(system.states),
        k_(series.count), n_(series.length),
        now_{machine_of(system), std::vector<double>(k_ * p_), std::vector<double>(k_ * k_)}, next_(p_), part_(k_),
        reach_(k_), row_(p_), effect_(p_ * p_), whole_(p_ * p_) {}

  bool run() {
    for (std::size_t t = 0; t < n_; ++t) {
      if (smooth_ && t % stride == 0) marks_.push_back(now_);
      if (!step(t)) return false;
      if (!smooth_) {
        known_ = k_ == 1 || coefficients(now_.cross, k_, beta_, covariance_);
        tell(t, seen_, nullptr, nullptr);
      }
    }
    if (smooth_) back();
    return true;
  }

 private:
  // Filters sample t and stores the result in seen_.
  bool step(std::size_t t) {
    pause_();
    Machine<double>& m = now_.machine;
    const double* y = series_.row(0);
    seen_.there = y[t] == y[t];
    if (seen_.there && !m.settled && !m.gain()) return false;
    seen_.inverse_S = m.inverse_S;
    seen_.gain = m.G;
    seen_.v.assign(k_, 0.0);
    seen_.means = now_.means;
    for (std::size_t a = 0; a < k_; ++a) {
      double* mean = now_.means.data() + a * p_;
      if (seen_.there) {
        double e = series_.row(a)[t];
        for (std::size_t i = 0; i < p_; ++i) e -= m.H[i] * mean[i];
        for (std::size_t i = 0; i < p_; ++i) seen_.means[a * p_ + i] += m.M[i] * e * m.inverse_S;
        seen_.v[a] = e;
      }
      std::fill(next_.begin(), next_.end(), 0.0);
      for (std::size_t q = 0; q < m.places.size(); ++q)
        next_[m.places[q].row] += m.f[q] * seen_.means[a * p_ + m.places[q].column];
      std::copy(next_.begin(), next_.end(), mean);
    }
    if (seen_.there)
      for (std::size_t a = 0; a < k_; ++a)
        for (std::size_t b = a; b < k_; ++b) now_.cross[a * k_ + b] += seen_.v[a] * seen_.v[b] * m.inverse_S;
    if (m.settled && seen_.there) {
      seen_.P = filtered_;
      return true;
    }
    if (!seen_.there) m.interrupt();
    if (seen_.there) m.learn();
    seen_.P = m.P;
    m.advance();
    now_.seen = seen_.there ? now_.seen + 1 : 0;
    if (now_.seen != 0 && now_.seen % check_every == 0 && m.same_as_before()) {
      filtered_ = seen_.P;
      m.settled = m.gain();
    }
    return true;
  }

  // Backward pass with r and N of Durbin and Koopman, from the last sample to the first. The filter is repeated for
  // each block.
  void back() {
    known_ = k_ == 1 || coefficients(now_.cross, k_, beta_, covariance_);
    std::vector<double> r(k_ * p_), N(p_ * p_);
    std::vector<Seen> kept(std::min(stride, n_));
    for (std::size_t mark = marks_.size(); mark-- > 0;) {
      const std::size_t first = mark * stride, last = std::min(first + stride, n_);
      now_ = std::move(marks_[mark]);
      marks_.pop_back();
      now_.machine.settled = false;  // its constants are not stored; it converges again to the same gain
      for (std::size_t t = first; t < last; ++t) {
        step(t);
        kept[t - first] = seen_;
      }
      for (std::size_t t = last; t-- > first;) {
        pause_();
        tell(t, kept[t - first], &r, &N);
        before(kept[t - first], r, N);
      }
    }
  }

  // r ← H v/S + Lᵀ r, N ← HᵀH/S + Lᵀ N L, L = F − G H; only F if the sample is missing.
  void before(const Seen& seen, std::vector<double>& r, std::vector<double>& N) {
    const Machine<double>& m = now_.machine;
    const double there = seen.there ? 1.0 : 0.0;
    for (std::size_t a = 0; a < k_; ++a) {
      double* own = r.data() + a * p_;
      double pull = seen.v[a] * seen.inverse_S;
      for (std::size_t i = 0; i < p_; ++i) pull -= seen.gain[i] * own[i];
      std::fill(next_.begin(), next_.end(), 0.0);
      for (std::size_t q = 0; q < m.places.size(); ++q) next_[m.places[q].column] += m.f[q] * own[m.places[q].row];
      for (std::size_t i = 0; i < p_; ++i) own[i] = next_[i] + there * m.H[i] * pull;
    }
    // whole = Lᵀ, row by row: (F − G H)ᵀ.
    std::fill(whole_.begin(), whole_.end(), 0.0);
    for (std::size_t q = 0; q < m.places.size(); ++q) whole_[m.places[q].column * p_ + m.places[q].row] = m.f[q];
    if (seen.there)
      for (std::size_t i = 0; i < p_; ++i)
        for (std::size_t j = 0; j < p_; ++j) whole_[i * p_ + j] -= m.H[i] * seen.gain[j];
    for (std::size_t i = 0; i < p_; ++i)
      for (std::size_t j = 0; j < p_; ++j) {
        double sum = 0;
        for (std::size_t q = 0; q < p_; ++q) sum += whole_[i * p_ + q] * N[q * p_ + j];
        effect_[i * p_ + j] = sum;
      }
    for (std::size_t i = 0; i < p_; ++i)
      for (std::size_t j = i; j < p_; ++j) {
        double sum = there * m.H[i] * m.H[j] * seen.inverse_S;
        for (std::size_t q = 0; q < p_; ++q) sum += effect_[i * p_ + q] * whole_[j * p_ + q];
        N[i * p_ + j] = N[j * p_ + i] = sum;
      }
  }

  // Means and variances of all sums at sample t, from the filter results, and from r and N of the later samples.
  void tell(std::size_t t, const Seen& seen, const std::vector<double>* r, const std::vector<double>* N) {
    const Machine<double>& m = now_.machine;
    for (std::size_t g = 0; g < pick_.count; ++g) {
      const double* weights = pick_.states.data() + g * p_;
      double variance = 0;
      for (std::size_t j = 0; j < p_; ++j) {
        row_[j] = 0;  // of the weights times P
        for (std::size_t i = 0; i < p_; ++i) row_[j] += weights[i] * seen.P[i * p_ + j];
        variance += row_[j] * weights[j];
      }
      // next = weights P Fᵀ
      if (r != nullptr) {
        std::fill(next_.begin(), next_.end(), 0.0);
        for (std::size_t q = 0; q < m.places.size(); ++q) next_[m.places[q].row] += m.f[q] * row_[m.places[q].column];
        for (std::size_t i = 0; i < p_; ++i)
          for (std::size_t j = 0; j < p_; ++j) variance -= next_[i] * (*N)[i * p_ + j] * next_[j];
      }
      for (std::size_t a = 0; a < k_; ++a) {
        double mean = 0;
        for (std::size_t i = 0; i < p_; ++i) mean += weights[i] * seen.means[a * p_ + i];
        if (r != nullptr)
          for (std::size_t i = 0; i < p_; ++i) mean += next_[i] * (*r)[a * p_ + i];
        part_[a] = mean;
      }
      put(g, t, variance, pick_.shares.data() + g * (k_ - 1));
    }
    double variance = m.R;
    std::fill(part_.begin(), part_.end(), 0.0);
    if (seen.there) {
      double weight = seen.inverse_S;
      for (std::size_t a = 0; a < k_; ++a) {
        double pull = seen.v[a] * seen.inverse_S;
        if (r != nullptr)
          for (std::size_t i = 0; i < p_; ++i) pull -= seen.gain[i] * (*r)[a * p_ + i];
        part_[a] = m.R * pull;
      }
      if (N != nullptr)
        for (std::size_t i = 0; i < p_; ++i)
          for (std::size_t j = 0; j < p_; ++j) weight += seen.gain[i] * (*N)[i * p_ + j] * seen.gain[j];
      variance -= m.R * m.R * weight;
    }
    put(pick_.count, t, variance, nullptr);
  }

  // A sum of states: the value of the record minus the contribution of the regressors, plus their direct contribution.
  void put(std::size_t g, std::size_t t, double variance, const double* shares) {
    double mean = part_[0];
    const std::size_t m = k_ - 1;
    variance = std::max(variance, 0.0);
    bool touched = false;
    for (std::size_t a = 0; a < m; ++a) {
      reach_[a] = (shares == nullptr ? 0.0 : shares[a] * series_.row(a + 1)[t]) - part_[a + 1];
      touched = touched || reach_[a] != 0;
    }
    if (touched && known_) {
      for (std::size_t a = 0; a < m; ++a) {
        mean += reach_[a] * beta_[a];
        for (std::size_t b = 0; b < m; ++b) variance += reach_[a] * covariance_[a * m + b] * reach_[b];
      }
    } else if (touched) {
      variance = unknown;
      mean = std::numeric_limits<double>::quiet_NaN();
    }
    means_[g * n_ + t] = mean;
    variances_[g * n_ + t] = variance;
  }

  const Series& series_;
  const Selection& pick_;
  bool smooth_, known_ = true;
  std::span<double> means_, variances_;
  std::size_t p_, k_, n_;
  Standing now_;
  Seen seen_;
  std::vector<Standing> marks_;
  Pause pause_{256};
  std::vector<double> filtered_, next_, part_, reach_, row_, effect_, whole_, beta_, covariance_;
};

}  // namespace

bool tracks(const System& system, const Series& series, const Selection& selection, bool smooth, std::span<double> means,
            std::span<double> variances) {
  const FlushToZero guard;
  return Tracker(system, series, selection, smooth, means, variances).run();
}

}  // namespace gmwm
