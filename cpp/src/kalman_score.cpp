#include <array>
#include <cstring>

#include "gmwm/kalman_step.hpp"
#include "gmwm/pause.hpp"

namespace gmwm {

namespace {

constexpr std::size_t block = 256;

template <std::size_t L>
struct Line {
  std::vector<Dual<L>> mean, next;
};

// The information about a single unknown level before a sample: Σ c²/S and Σ c v/S; the estimate of the level is their
// ratio.
template <std::size_t L>
struct Known {
  Dual<L> weight{0.0}, pull{0.0};
};

// The sums of one pass.
template <std::size_t L>
struct Sums {
  Known<L> known;
  std::array<double, L> log_slopes{}, square_slopes{};
  std::array<double, L * L> information{};
  std::vector<double> cross, cross_slopes;  // (m, m), (m, m, L)
  std::size_t used;                         // number of derivatives in use, of L
  double square = 0;
};

template <std::size_t L>
Machine<Dual<L>> machine_of(const System& s, const Slopes& d) {
  const std::size_t p = s.states, pp = p * p;
  const auto number = [&](std::span<const double> values, std::span<const double> slopes, std::size_t size, std::size_t i) {
    Dual<L> out(values[i]);
    for (std::size_t l = 0; l < d.count; ++l) out.d[l] = slopes[l * size + i];
    return out;
  };
  const auto numbers = [&](std::span<const double> values, std::span<const double> slopes, std::size_t size) {
    std::vector<Dual<L>> out(size);
    for (std::size_t i = 0; i < size; ++i) out[i] = number(values, slopes, size, i);
    return out;
  };
  std::vector<Place> places;
  std::vector<Dual<L>> f;
  for (std::size_t i = 0; i < p; ++i)
    for (std::size_t j = 0; j < p; ++j) {
      const Dual<L> entry = number(s.F, d.F, pp, i * p + j);
      const bool moves = std::any_of(entry.d, entry.d + L, [](double slope) { return slope != 0; });
      if (i != j && entry.v == 0 && !moves) continue;
      places.push_back({i, j});
      f.push_back(entry);
    }
  Dual<L> noise(s.R);
  for (std::size_t l = 0; l < d.count; ++l) noise.d[l] = d.R[l];
  return {p, std::move(places), std::move(f), numbers(s.Q, d.Q, pp), numbers(s.H, d.H, p), numbers(s.P0, d.P0, pp), noise};
}

// v with its derivatives, and the means after one step: with the gain, or without it if the sample is missing.
template <std::size_t L>
GMWM_INLINE Dual<L> moved(const Machine<Dual<L>>& m, double y, bool seen, Line<L>& line) {
  Dual<L> e(seen ? y : 0.0);
  for (std::size_t i = 0; i < m.p; ++i) {
    if (seen) e -= m.H[i] * line.mean[i];
    line.next[i] = Dual<L>(0.0);
  }
  for (std::size_t k = 0; k < m.places.size(); ++k)
    line.next[m.places[k].row] += m.f[k] * line.mean[m.places[k].column];
  if (seen)
    for (std::size_t i = 0; i < m.p; ++i) line.next[i] += m.G[i] * e;
  line.mean.swap(line.next);
  return e;
}

// A block with a constant gain, for P states with diagonal F. The L derivatives of v follow the v of each sample.
template <std::size_t P, std::size_t L>
GMWM_INLINE void settled_diagonal(const Machine<Dual<L>>& m, const double* y, std::size_t n, Line<L>& line, double* v,
                                  double* slopes) {
  std::array<Dual<L>, P> a, f, g, h;
  for (std::size_t i = 0; i < P; ++i) a[i] = line.mean[i], f[i] = m.f[i], g[i] = m.G[i], h[i] = m.H[i];
  for (std::size_t t = 0; t < n; ++t) {
    Dual<L> e(y[t]);
    for (std::size_t i = 0; i < P; ++i) e -= h[i] * a[i];
    for (std::size_t i = 0; i < P; ++i) a[i] = f[i] * a[i] + g[i] * e;
    v[t] = e.v;
    for (std::size_t l = 0; l < L; ++l) slopes[t * L + l] = e.d[l];
  }
  for (std::size_t i = 0; i < P; ++i) line.mean[i] = a[i];
}

template <std::size_t L>
GMWM_INLINE void settled_block(const Machine<Dual<L>>& m, const double* y, std::size_t n, Line<L>& line, double* v,
                               double* slopes) {
  switch (m.diagonal ? m.p : 0) {
    case 1: return settled_diagonal<1>(m, y, n, line, v, slopes);
    case 2: return settled_diagonal<2>(m, y, n, line, v, slopes);
    case 3: return settled_diagonal<3>(m, y, n, line, v, slopes);
    default:
      for (std::size_t t = 0; t < n; ++t) {
        const Dual<L> e = moved(m, y[t], true, line);
        v[t] = e.v;
        for (std::size_t l = 0; l < L; ++l) slopes[t * L + l] = e.d[l];
      }
  }
}

// Adds the contribution of a sample to the information, from v and S with their derivatives.
template <std::size_t L>
GMWM_INLINE void inform(Sums<L>& sums, const Dual<L>& v, const Dual<L>& S, double weight) {
  for (std::size_t a = 0; a < sums.used; ++a) {
    const double first = 0.5 * S.d[a] * weight * weight, second = v.d[a] * weight;
    for (std::size_t b = 0; b < L; ++b) sums.information[a * L + b] += first * S.d[b] + second * v.d[b];
  }
}

// The same if each sample contains an unknown level with the factor c: the estimate of the level so far is subtracted
// from v, and its variance is added to S. The first sample that depends on the level contributes nothing.
template <std::size_t L>
GMWM_INLINE void inform(Sums<L>& sums, const Dual<L>& v, const Dual<L>& c, const Dual<L>& S, const Dual<L>& inverse) {
  Known<L>& known = sums.known;
  if (known.weight.v > 0) {
    const Dual<L> reach = c * gmwm::inverse(known.weight);
    const Dual<L> wide = S + c * reach;
    inform(sums, v - reach * known.pull, wide, 1 / wide.v);
  } else if (c.v == 0) {
    inform(sums, v, S, inverse.v);
  }
  const Dual<L> share = c * inverse;
  known.weight += share * c;
  known.pull += share * v;
}

// Adds the contribution of one sample, from v (k) and S with their derivatives.
template <std::size_t L>
GMWM_INLINE void gather(Sums<L>& sums, const std::vector<Dual<L>>& v, const Dual<L>& S, const Dual<L>& inverse) {
  const double weight = inverse.v;
  const Dual<L>& e = v[0];
  const double z = e.v * e.v * weight;
  sums.square += z;
  for (std::size_t l = 0; l < L; ++l) {
    const double share = S.d[l] * weight;
    sums.log_slopes[l] += share;
    sums.square_slopes[l] += 2 * e.v * e.d[l] * weight - z * share;
  }
  const std::size_t m = v.size() - 1;
  if (m == 1)
    inform(sums, e, v[1], S, inverse);
  else
    inform(sums, e, S, weight);
  for (std::size_t a = 0; a < m; ++a)
    for (std::size_t b = 0; b < m; ++b) {
      const Dual<L> product = v[a + 1] * v[b + 1] * inverse;
      sums.cross[a * m + b] += product.v;
      for (std::size_t l = 0; l < L; ++l) sums.cross_slopes[(a * m + b) * L + l] += product.d[l];
    }
}

// Whether a regressor has no effect any more, such as the initial level of a random walk after many samples.
inline bool nothing_left(const double* v, const double* slopes, std::size_t n, std::size_t L) {
  const auto none = [](double value) { return value == 0; };
  return std::all_of(v, v + n, none) && std::all_of(slopes, slopes + n * L, none);
}

template <std::size_t L>
GMWM_INLINE Dual<L> number(const double* v, const double* slopes, std::size_t t) {
  Dual<L> out(v[t]);
  for (std::size_t l = 0; l < L; ++l) out.d[l] = slopes[t * L + l];
  return out;
}

// Adds the contribution of a block of n samples with constant S.
template <std::size_t L>
GMWM_INLINE void gather_block(Sums<L>& sums, std::size_t k, std::size_t n, const double* v, const double* slopes,
                              const Dual<L>& S, const Dual<L>& inverse) {
  double square = 0;
  std::array<double, L> product{};
  std::array<double, L * L> outer{};
  const bool level = k == 2 && !nothing_left(v + block, slopes + block * L, n, L);
  for (std::size_t t = 0; t < n; ++t) {
    const double e = v[t];
    const double* d = slopes + t * L;
    square += e * e;
    for (std::size_t l = 0; l < L; ++l) product[l] += e * d[l];
    if (level) {
      inform(sums, number<L>(v, slopes, t), number<L>(v + block, slopes + block * L, t), S, inverse);
      continue;
    }
    for (std::size_t a = 0; a < sums.used; ++a)
      for (std::size_t b = 0; b < L; ++b) outer[a * L + b] += d[a] * d[b];
  }
  const double weight = inverse.v, all = static_cast<double>(n);
  sums.square += square * weight;
  for (std::size_t a = 0; a < L; ++a) {
    const double share = S.d[a] * weight;
    sums.log_slopes[a] += all * share;
    sums.square_slopes[a] += (2 * product[a] - square * share) * weight;
    for (std::size_t b = 0; b < L && !level; ++b)
      sums.information[a * L + b] += 0.5 * all * share * S.d[b] * weight + outer[a * L + b] * weight;
  }
  const std::size_t m = k - 1;
  for (std::size_t a = 0; a < m; ++a)
    for (std::size_t b = 0; b < m; ++b) {
      const double *u = v + (a + 1) * block, *w = v + (b + 1) * block;
      const double *du = slopes + (a + 1) * block * L, *dw = slopes + (b + 1) * block * L;
      Dual<L> total(0.0);
      for (std::size_t t = 0; t < n; ++t) {
        total.v += u[t] * w[t];
        for (std::size_t l = 0; l < L; ++l) total.d[l] += u[t] * dw[t * L + l] + du[t * L + l] * w[t];
      }
      total = total * inverse;
      sums.cross[a * m + b] += total.v;
      for (std::size_t l = 0; l < L; ++l) sums.cross_slopes[(a * m + b) * L + l] += total.d[l];
    }
}

template <std::size_t L>
GMWM_INLINE void pass(Machine<Dual<L>>& m, const Series& series, Sums<L>& sums, Score& out) {
  const std::size_t k = series.count, n = series.length;
  const double* y = series.row(0);
  std::vector<Line<L>> lines(k, Line<L>{std::vector<Dual<L>>(m.p, Dual<L>(0.0)), std::vector<Dual<L>>(m.p)});
  std::vector<double> v(k * block), slopes(k * block * L);
  std::vector<Dual<L>> e(k);
  LogSum logs;
  double settled_log = 0;
  std::size_t seen = 0;
  Changes<Dual<L>> changes(m, observed_run(y, n) == n);
  Pause pause(256);
  for (std::size_t t = 0; t < n;) {
    pause();
    if (m.settled) {
      const std::size_t some = observed_run(y + t, std::min(block, n - t));
      for (std::size_t a = 0; a < k; ++a)
        settled_block(m, series.row(a) + t, some, lines[a], &v[a * block], &slopes[a * block * L]);
      gather_block(sums, k, some, v.data(), slopes.data(), m.S, m.inverse_S);
      out.observed += some;
      out.settled += some;
      settled_log += static_cast<double>(some) * std::log(m.S.v);
      t += some;
      if (t == n || some == block) continue;
      m.settled = false;
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
      logs.add(m.S.v);
      ++out.observed;
    }
    for (std::size_t a = 0; a < k; ++a) e[a] = moved(m, series.row(a)[t], there, lines[a]);
    if (there) gather(sums, e, m.S, m.inverse_S);
    ++t;
    if (changes.running()) {
      changes.step(m);
      m.settled = ++seen % check_every == 0 && changes.same_as_before(m);
      continue;
    }
    if (there) m.learn();
    m.advance();
    if (!there) m.interrupt();
    seen = there ? seen + 1 : 0;
    if (seen != 0 && seen % check_every == 0 && m.same_as_before()) {
      m.settled = m.gain();
      seen = 0;
    }
  }
  out.log_variances = logs.total() + settled_log;
}

constexpr Clones<pass<8>> pass_8{};
constexpr Clones<pass<16>> pass_16{};
constexpr Clones<pass<32>> pass_32{};

template <std::size_t L, class Pass>
Score scored(const System& system, const Slopes& slopes, const Series& series, Pass pass) {
  const std::size_t m = series.count - 1, used = slopes.count;
  Machine<Dual<L>> machine = machine_of<L>(system, slopes);
  Sums<L> sums;
  sums.used = used;
  sums.cross.assign(m * m, 0.0);
  sums.cross_slopes.assign(m * m * L, 0.0);
  Score out;
  pass(machine, series, sums, out);
  out.square = sums.square;
  out.log_slopes.assign(sums.log_slopes.begin(), sums.log_slopes.begin() + used);
  out.square_slopes.assign(sums.square_slopes.begin(), sums.square_slopes.begin() + used);
  out.information.resize(used * used);
  for (std::size_t a = 0; a < used; ++a)
    std::copy_n(sums.information.data() + a * L, used, out.information.data() + a * used);
  out.cross = std::move(sums.cross);
  out.cross_slopes.resize(used * m * m);
  for (std::size_t l = 0; l < used; ++l)
    for (std::size_t i = 0; i < m * m; ++i) out.cross_slopes[l * m * m + i] = sums.cross_slopes[i * L + l];
  return out;
}

}  // namespace

Score score(const System& system, const Slopes& slopes, const Series& series) {
  const FlushToZero guard;
  if (slopes.count <= 8) return scored<8>(system, slopes, series, pass_8);
  if (slopes.count <= 16) return scored<16>(system, slopes, series, pass_16);
  return scored<32>(system, slopes, series, pass_32);
}

}  // namespace gmwm
