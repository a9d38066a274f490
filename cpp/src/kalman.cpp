#include "gmwm/kalman.hpp"

#include <array>
#include <limits>

#include "gmwm/kalman_step.hpp"
#include "gmwm/pause.hpp"

namespace gmwm {

Machine<double> machine_of(const System& system) {
  const std::size_t p = system.states;
  std::vector<Place> places;
  std::vector<double> f;
  for (std::size_t i = 0; i < p; ++i)
    for (std::size_t j = 0; j < p; ++j)
      if (i == j || system.F[i * p + j] != 0) {
        places.push_back({i, j});
        f.push_back(system.F[i * p + j]);
      }
  return {p,
          std::move(places),
          std::move(f),
          {system.Q.begin(), system.Q.end()},
          {system.H.begin(), system.H.end()},
          {system.P0.begin(), system.P0.end()},
          system.R};
}

namespace {

constexpr std::size_t block = 512;

struct Run {
  Machine<double> machine;
  Series series;
  std::vector<double> means;  // predicted, (k, p)
  std::vector<double> next;   // (p)
  std::vector<double> v;      // innovations of a block (k, block)
};

// v and the next means of K series with a constant gain, for P states with diagonal F. Several series at once hide the
// latency of the recursion.
template <std::size_t P, std::size_t K>
GMWM_INLINE void settled_diagonal(Run& run, std::size_t t0, std::size_t n) {
  const Machine<double>& m = run.machine;
  std::array<double, P> f, g, h;
  std::array<std::array<double, P>, K> a;
  std::array<const double*, K> y;
  std::array<double*, K> v;
  for (std::size_t i = 0; i < P; ++i) f[i] = m.f[i], g[i] = m.G[i], h[i] = m.H[i];
  for (std::size_t k = 0; k < K; ++k) {
    y[k] = run.series.row(k) + t0;
    v[k] = run.v.data() + k * block;
    for (std::size_t i = 0; i < P; ++i) a[k][i] = run.means[k * P + i];
  }
  for (std::size_t t = 0; t < n; ++t)
    for (std::size_t k = 0; k < K; ++k) {
      double e = y[k][t];
      for (std::size_t i = 0; i < P; ++i) e -= h[i] * a[k][i];
      for (std::size_t i = 0; i < P; ++i) a[k][i] = f[i] * a[k][i] + g[i] * e;
      v[k][t] = e;
    }
  for (std::size_t k = 0; k < K; ++k)
    for (std::size_t i = 0; i < P; ++i) run.means[k * P + i] = a[k][i];
}

// v_t, and the means after one step: with the gain, or without it if the sample is missing.
GMWM_INLINE double moved(const Machine<double>& m, double y, bool seen, double* mean, double* next) {
  double e = seen ? y : 0.0;
  for (std::size_t i = 0; i < m.p; ++i) {
    e -= seen ? m.H[i] * mean[i] : 0.0;
    next[i] = 0;
  }
  for (std::size_t k = 0; k < m.places.size(); ++k) next[m.places[k].row] += m.f[k] * mean[m.places[k].column];
  for (std::size_t i = 0; i < m.p; ++i) mean[i] = next[i] + (seen ? m.G[i] * e : 0.0);
  return e;
}

// The first samples, in which the gain still changes: P states with diagonal F, K series, n samples without gaps.
// Writes v (K, block), 1/S and S of each sample. Returns false if an innovation has zero variance. Operations that do
// not need 1/S are done during the division: F (P − M Mᵀ/S) Fᵀ + Q = (F P Fᵀ + Q) − (F M)(F M)ᵀ/S.
template <std::size_t P, std::size_t K>
GMWM_INLINE bool changing_diagonal(Run& run, std::size_t t0, std::size_t n, double* weights, double* variances) {
  Machine<double>& m = run.machine;
  std::array<double, P> f, h;
  std::array<std::array<double, P>, P> C, Q, ff;
  std::array<std::array<double, P>, K> a;
  std::array<const double*, K> y;
  for (std::size_t i = 0; i < P; ++i) f[i] = m.f[i], h[i] = m.H[i];
  for (std::size_t i = 0; i < P; ++i) {
    for (std::size_t j = 0; j < P; ++j) {
      C[i][j] = h[i] * m.P[i * P + j] * h[j];
      Q[i][j] = h[i] * m.Q[i * P + j] * h[j];
      ff[i][j] = f[i] * f[j];
    }
    for (std::size_t k = 0; k < K; ++k) a[k][i] = h[i] * run.means[k * P + i];
  }
  for (std::size_t k = 0; k < K; ++k) y[k] = run.series.row(k) + t0;
  bool good = true;
  for (std::size_t t = 0; t < n; ++t) {
    std::array<double, P> M, fM;
    std::array<std::array<double, P>, P> A, B;
    double S = m.R;
    for (std::size_t i = 0; i < P; ++i) {
      M[i] = 0;
      for (std::size_t j = 0; j < P; ++j) M[i] += i < j ? C[i][j] : C[j][i];
      S += M[i];
      fM[i] = f[i] * M[i];
    }
    good = good && S > 0;
    const double weight = 1 / S;
    for (std::size_t i = 0; i < P; ++i)
      for (std::size_t j = i; j < P; ++j) A[i][j] = ff[i][j] * C[i][j] + Q[i][j], B[i][j] = fM[i] * fM[j];
    for (std::size_t k = 0; k < K; ++k) {
      double e = y[k][t];
      for (std::size_t i = 0; i < P; ++i) e -= a[k][i];
      for (std::size_t i = 0; i < P; ++i) a[k][i] = f[i] * a[k][i] + fM[i] * (weight * e);
      run.v[k * block + t] = e;
    }
    for (std::size_t i = 0; i < P; ++i)
      for (std::size_t j = i; j < P; ++j) C[i][j] = A[i][j] - B[i][j] * weight;
    weights[t] = weight;
    variances[t] = S;
  }
  for (std::size_t i = 0; i < P; ++i) {
    for (std::size_t j = i; j < P; ++j) m.P[i * P + j] = m.P[j * P + i] = C[i][j] / (h[i] * h[j]);
    for (std::size_t k = 0; k < K; ++k) run.means[k * P + i] = a[k][i] / h[i];
  }
  return good;
}

// The result of this loop, or nothing if there is no such loop for this system.
enum class Quick { none, good, singular };

GMWM_INLINE Quick changing_block(Run& run, std::size_t t, std::size_t n, double* weights, double* variances) {
  if (!run.machine.quick || run.series.count > 2) return Quick::none;
  bool good;
  switch (run.machine.p * 2 + run.series.count - 1) {
    case 2: good = changing_diagonal<1, 1>(run, t, n, weights, variances); break;
    case 3: good = changing_diagonal<1, 2>(run, t, n, weights, variances); break;
    case 4: good = changing_diagonal<2, 1>(run, t, n, weights, variances); break;
    case 5: good = changing_diagonal<2, 2>(run, t, n, weights, variances); break;
    case 6: good = changing_diagonal<3, 1>(run, t, n, weights, variances); break;
    case 7: good = changing_diagonal<3, 2>(run, t, n, weights, variances); break;
    case 8: good = changing_diagonal<4, 1>(run, t, n, weights, variances); break;
    case 9: good = changing_diagonal<4, 2>(run, t, n, weights, variances); break;
    default: return Quick::none;
  }
  return good ? Quick::good : Quick::singular;
}

GMWM_INLINE void settled_block(Run& run, std::size_t t, std::size_t n) {
  const Machine<double>& m = run.machine;
  const std::size_t count = run.series.count;
  switch (m.diagonal && count <= 2 ? m.p * 2 + count - 1 : 0) {
    case 2: return settled_diagonal<1, 1>(run, t, n);
    case 3: return settled_diagonal<1, 2>(run, t, n);
    case 4: return settled_diagonal<2, 1>(run, t, n);
    case 5: return settled_diagonal<2, 2>(run, t, n);
    case 6: return settled_diagonal<3, 1>(run, t, n);
    case 7: return settled_diagonal<3, 2>(run, t, n);
    case 8: return settled_diagonal<4, 1>(run, t, n);
    case 9: return settled_diagonal<4, 2>(run, t, n);
    default:
      for (std::size_t k = 0; k < count; ++k)
        for (std::size_t i = 0; i < n; ++i)
          run.v[k * block + i] =
              moved(m, run.series.row(k)[t + i], true, run.means.data() + k * m.p, run.next.data());
  }
}

// Σ v_a v_b of a block, with several partial sums at once.
GMWM_INLINE double product(const double* a, const double* b, std::size_t n) {
  std::array<double, 8> sums{};
  std::size_t t = 0;
  for (; t + 8 <= n; t += 8)
    for (std::size_t k = 0; k < 8; ++k) sums[k] += a[t + k] * b[t + k];
  for (; t < n; ++t) sums[0] += a[t] * b[t];
  double total = 0;
  for (const double sum : sums) total += sum;
  return total;
}

GMWM_INLINE void filter_inline(Run& run, std::span<double> standardised, Innovations& out) {
  Machine<double>& m = run.machine;
  const std::size_t k = run.series.count, n = run.series.length;
  const double* y = run.series.row(0);
  LogSum logs;
  double settled_log = 0, root = 0;
  std::size_t seen = 0;
  std::array<double, check_every> weights, variances;
  Changes<double> changes(m, observed_run(y, n) == n);
  Pause pause(256);
  for (std::size_t t = 0; t < n;) {
    pause();
    if (!m.settled && !changes.running() && n - t >= check_every && observed_run(y + t, check_every) == check_every) {
      const Quick quick = changing_block(run, t, check_every, weights.data(), variances.data());
      if (quick == Quick::singular) {
        out.singular = true;
        return;
      }
      if (quick == Quick::good) {
        for (std::size_t i = 0; i < check_every; ++i) {
          for (std::size_t a = 0; a < k; ++a)
            for (std::size_t b = a; b < k; ++b)
              out.cross[a * k + b] += run.v[a * block + i] * run.v[b * block + i] * weights[i];
          if (!standardised.empty()) standardised[t + i] = run.v[i] * std::sqrt(weights[i]);
        }
        logs.add(variances);
        out.observed += check_every;
        t += check_every;
        if (m.same_as_before()) {
          m.settled = m.gain();
          root = std::sqrt(m.inverse_S);
        }
        seen = 0;
        continue;
      }
    }
    if (m.settled) {
      const std::size_t some = observed_run(y + t, std::min(block, n - t));
      settled_block(run, t, some);
      for (std::size_t a = 0; a < k; ++a)
        for (std::size_t b = a; b < k; ++b)
          out.cross[a * k + b] += product(&run.v[a * block], &run.v[b * block], some) * m.inverse_S;
      if (!standardised.empty())
        for (std::size_t i = 0; i < some; ++i) standardised[t + i] = run.v[i] * root;
      out.observed += some;
      out.settled += some;
      settled_log += static_cast<double>(some) * std::log(m.S);
      t += some;
      if (t == n || some == block) continue;
      m.settled = false;  // a sample is missing here; P is the covariance for the next sample
    }
    const bool there = y[t] == y[t];
    if (there) {
      if (!changes.running()) {
        if (!m.gain()) {
          out.singular = true;
          return;
        }
        changes.watch(m);
      }
      logs.add(m.S);
      ++out.observed;
    }
    for (std::size_t a = 0; a < k; ++a)
      run.v[a * block] = moved(m, run.series.row(a)[t], there, run.means.data() + a * m.p, run.next.data());
    if (there) {
      for (std::size_t a = 0; a < k; ++a)
        for (std::size_t b = a; b < k; ++b) out.cross[a * k + b] += run.v[a * block] * run.v[b * block] * m.inverse_S;
      if (!changes.running()) m.learn();
    }
    if (!standardised.empty())
      standardised[t] = there ? run.v[0] * std::sqrt(m.inverse_S) : std::numeric_limits<double>::quiet_NaN();
    ++t;
    if (changes.running()) {
      changes.step(m);
      m.settled = ++seen % check_every == 0 && changes.same_as_before(m);
      root = std::sqrt(m.inverse_S);
      continue;
    }
    m.advance();
    if (!there) m.interrupt();
    seen = there ? seen + 1 : 0;
    if (seen != 0 && seen % check_every == 0 && m.same_as_before()) {
      m.settled = m.gain();
      root = std::sqrt(m.inverse_S);
      seen = 0;
    }
  }
  out.log_variances = logs.total() + settled_log;
}
constexpr Clones<filter_inline> filter{};

}  // namespace

Innovations innovations(const System& system, const Series& series, std::span<double> standardised) {
  const FlushToZero guard;
  const std::size_t k = series.count;
  Run run{machine_of(system), series, std::vector<double>(k * system.states), std::vector<double>(system.states),
          std::vector<double>(k * block)};
  Innovations out;
  out.cross.assign(k * k, 0.0);
  filter(run, standardised, out);
  for (std::size_t a = 0; a < k; ++a)
    for (std::size_t b = 0; b < a; ++b) out.cross[a * k + b] = out.cross[b * k + a];
  return out;
}

}  // namespace gmwm
