// The Kalman filter against the textbook's recursion in long doubles; its slopes against differences of its values.
#include "gmwm/kalman.hpp"

#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "check.hpp"

namespace {

using Long = long double;

// Numbers between -1 and 1, the same at each run.
class Numbers {
 public:
  double next() {
    state_ = state_ * 6364136223846793005u + 1442695040888963407u;
    return static_cast<double>(state_ >> 11) / 4503599627370496.0 - 1;
  }

 private:
  std::uint64_t state_ = 20261121;
};

// A stable system of p states, mixed or each by itself, with a start of its own.
struct Matrices {
  std::size_t p;
  std::vector<double> F, Q, H, P0;
  double R;

  gmwm::System view() const { return {p, F, Q, H, P0, R}; }
};

Matrices drawn(Numbers& numbers, std::size_t p, bool mixed) {
  Matrices m{p, std::vector<double>(p * p), std::vector<double>(p * p), std::vector<double>(p),
             std::vector<double>(p * p), 0.7};
  for (std::size_t i = 0; i < p; ++i) {
    m.H[i] = 1 + 0.3 * numbers.next();
    m.F[i * p + i] = 0.3 * numbers.next() + 0.6;
    m.Q[i * p + i] = 0.2 + 0.1 * numbers.next();
    m.P0[i * p + i] = 3 + numbers.next();
    if (mixed && i + 1 < p) m.F[i * p + i + 1] = 0.2 * numbers.next();
    if (mixed && i > 0) m.Q[i * p] = m.Q[i] = 0.05 * numbers.next();
  }
  return m;
}

struct Plain {
  std::size_t observed = 0;
  Long logs = 0;
  std::vector<Long> cross, standardised, S;
  std::vector<std::vector<Long>> v;  // of all series at each sample
};

// P ← F (P − P Hᵀ H P / S) Fᵀ + Q with all products written out.
Plain textbook(const Matrices& m, const gmwm::Series& series) {
  const std::size_t p = m.p, k = series.count;
  Plain out;
  out.cross.assign(k * k, 0);
  std::vector<Long> P(m.P0.begin(), m.P0.end()), a(k * p, 0);
  for (std::size_t t = 0; t < series.length; ++t) {
    const bool there = !std::isnan(series.row(0)[t]);
    std::vector<Long> M(p, 0), v(k, 0);
    Long S = m.R;
    for (std::size_t i = 0; i < p; ++i)
      for (std::size_t j = 0; j < p; ++j) M[i] += P[i * p + j] * m.H[j];
    for (std::size_t i = 0; i < p; ++i) S += m.H[i] * M[i];
    if (there) {
      ++out.observed;
      out.logs += std::log(S);
      for (std::size_t c = 0; c < k; ++c) {
        v[c] = series.row(c)[t];
        for (std::size_t i = 0; i < p; ++i) v[c] -= m.H[i] * a[c * p + i];
        for (std::size_t i = 0; i < p; ++i) a[c * p + i] += M[i] * v[c] / S;
      }
      for (std::size_t c = 0; c < k; ++c)
        for (std::size_t d = 0; d < k; ++d) out.cross[c * k + d] += v[c] * v[d] / S;
      for (std::size_t i = 0; i < p; ++i)
        for (std::size_t j = 0; j < p; ++j) P[i * p + j] -= M[i] * M[j] / S;
    }
    out.standardised.push_back(there ? v[0] / std::sqrt(S) : std::numeric_limits<Long>::quiet_NaN());
    out.v.push_back(v);
    out.S.push_back(S);
    std::vector<Long> moved(k * p, 0), half(p * p, 0), next(m.Q.begin(), m.Q.end());
    for (std::size_t i = 0; i < p; ++i)
      for (std::size_t j = 0; j < p; ++j) {
        for (std::size_t c = 0; c < k; ++c) moved[c * p + i] += m.F[i * p + j] * a[c * p + j];
        for (std::size_t q = 0; q < p; ++q) half[i * p + q] += m.F[i * p + j] * P[j * p + q];
      }
    for (std::size_t i = 0; i < p; ++i)
      for (std::size_t j = 0; j < p; ++j)
        for (std::size_t q = 0; q < p; ++q) next[i * p + j] += half[i * p + q] * m.F[j * p + q];
    a = moved;
    P = next;
  }
  return out;
}

enum class Gaps { none, some, steady };

// A record and k − 1 regressors; of the record samples are missing at the start, at the end, one by one and in a row,
// or one in 29, so that after each the variances are what they were after the one before without having come to rest.
std::vector<double> rows(Numbers& numbers, std::size_t k, std::size_t n, Gaps gaps) {
  std::vector<double> values(k * n);
  for (std::size_t t = 0; t < n; ++t) {
    values[t] = 2 * numbers.next() + std::sin(0.01 * static_cast<double>(t));
    for (std::size_t c = 1; c < k; ++c) values[c * n + t] = c == 1 ? 1 : static_cast<double>(t) / 100;
  }
  for (std::size_t t = 0; t < n; ++t) {
    const bool some = t < 2 || t + 1 == n || t % 97 == 50 || (t > 500 && t < 540);
    if (gaps == Gaps::some ? some : gaps == Gaps::steady && t % 29 == 28)
      values[t] = std::numeric_limits<double>::quiet_NaN();
  }
  return values;
}

void innovations_are_the_textbook_s() {
  Numbers numbers;
  for (std::size_t p = 0; p <= 6; ++p)
    for (const bool mixed : {false, true})
      for (std::size_t k = 1; k <= 3; ++k)
        for (const std::size_t n : {1u, 15u, 16u, 47u, 1500u})
          for (const Gaps gaps : {Gaps::none, Gaps::some, Gaps::steady}) {
            const Matrices m = drawn(numbers, p, mixed);
            const std::vector<double> values = rows(numbers, k, n, gaps);
            const gmwm::Series series{k, n, values};
            std::vector<double> standardised(n);
            const gmwm::Innovations got = gmwm::innovations(m.view(), series, standardised);
            const Plain expected = textbook(m, series);
            CHECK(!got.singular);
            CHECK(got.observed == expected.observed);
            CHECK(std::abs(got.log_variances - expected.logs) <= 1e-12 * (1 + std::abs(expected.logs)));
            // Of products the size is that of the largest there could be.
            for (std::size_t a = 0; a < k; ++a)
              for (std::size_t b = 0; b < k; ++b) {
                const Long most = std::sqrt(expected.cross[a * k + a] * expected.cross[b * k + b]);
                CHECK(std::abs(got.cross[a * k + b] - expected.cross[a * k + b]) <= 1e-12L * most);
              }
            for (std::size_t t = 0; t < n; ++t) {
              const Long z = expected.standardised[t];
              CHECK(std::isnan(z) ? std::isnan(standardised[t]) : std::abs(standardised[t] - z) < 1e-12L);
            }
            // Where no sample is missing, the gains have come to rest long before the end.
            if (n == 1500 && gaps == Gaps::none) CHECK(got.settled > 1000);
          }
}

// Systems along a straight line: each matrix at +s is itself and s times its slope.
Matrices moved(const Matrices& m, const std::vector<Matrices>& slopes, std::size_t l, double s) {
  Matrices out = m;
  for (std::size_t i = 0; i < m.F.size(); ++i) {
    out.F[i] += s * slopes[l].F[i];
    out.Q[i] += s * slopes[l].Q[i];
    out.P0[i] += s * slopes[l].P0[i];
  }
  for (std::size_t i = 0; i < m.H.size(); ++i) out.H[i] += s * slopes[l].H[i];
  out.R += s * slopes[l].R;
  return out;
}

// The innovations of a record whose level is known only as far as the samples before say; S = 0 where it is not at all.
struct Contrasts {
  std::vector<Long> v, S;
};

Contrasts contrasts(const Plain& plain) {
  Contrasts out;
  Long weight = 0, pull = 0;
  for (std::size_t t = 0; t < plain.S.size(); ++t) {
    const bool there = !std::isnan(plain.standardised[t]);
    const Long c = plain.v[t][1], S = plain.S[t];
    const bool known = there && weight > 0;
    out.v.push_back(known ? plain.v[t][0] - c * pull / weight : 0);
    out.S.push_back(known ? S + c * c / weight : 0);
    if (there) weight += c * c / S, pull += c * plain.v[t][0] / S;
  }
  return out;
}

void slopes_are_those_of_the_values() {
  Numbers numbers;
  const double step = 1e-4;
  for (const std::size_t p : {1u, 2u, 4u})
    for (const bool mixed : {false, true})
      for (const std::size_t count : {1u, 8u, 11u, 32u})
        for (const Gaps gaps : {Gaps::none, Gaps::some, Gaps::steady}) {
          const Matrices m = drawn(numbers, p, mixed);
          std::vector<Matrices> along;
          std::vector<double> dF, dQ, dH, dP0, dR;
          for (std::size_t l = 0; l < count; ++l) {
            along.push_back(drawn(numbers, p, mixed));
            along[l].R = numbers.next();
            dF.insert(dF.end(), along[l].F.begin(), along[l].F.end());
            dQ.insert(dQ.end(), along[l].Q.begin(), along[l].Q.end());
            dH.insert(dH.end(), along[l].H.begin(), along[l].H.end());
            dP0.insert(dP0.end(), along[l].P0.begin(), along[l].P0.end());
            dR.push_back(along[l].R);
          }
          const std::size_t n = 700, k = 3;
          const std::vector<double> values = rows(numbers, k, n, gaps);
          const gmwm::Series series{k, n, values};
          const gmwm::Score got = gmwm::score(m.view(), {count, dF, dQ, dH, dP0, dR}, series);
          const gmwm::Score one =
              gmwm::score(m.view(), {count, dF, dQ, dH, dP0, dR}, {2, n, std::span(values).first(2 * n)});
          const Plain here = textbook(m, series);
          CHECK(!got.singular && got.observed == here.observed);
          CHECK_CLOSE(got.log_variances, static_cast<double>(here.logs), 1e-12);
          CHECK_CLOSE(got.square, static_cast<double>(here.cross[0]), 1e-12);
          if (gaps == Gaps::none) CHECK(got.settled > 400);
          for (std::size_t l = 0; l < count; ++l) {
            const Plain up = textbook(moved(m, along, l, step), series);
            const Plain down = textbook(moved(m, along, l, -step), series);
            const auto slope = [&](Long above, Long below) { return static_cast<double>((above - below) / (2 * step)); };
            const auto near = [](double a, double b, double scale) { return std::abs(a - b) <= 2e-6 * scale; };
            CHECK(near(got.log_slopes[l], slope(up.logs, down.logs), static_cast<double>(n)));
            CHECK(near(got.square_slopes[l], slope(up.cross[0], down.cross[0]), static_cast<double>(n)));
            for (std::size_t a = 0; a < 2; ++a)
              for (std::size_t b = 0; b < 2; ++b) {
                const std::size_t at = (a + 1) * k + b + 1;
                const double size = static_cast<double>(std::sqrt(here.cross[(a + 1) * (k + 1)] * here.cross[(b + 1) * (k + 1)]));
                CHECK(near(got.cross_slopes[l * 4 + a * 2 + b], slope(up.cross[at], down.cross[at]), 10 * size));
              }
            // Σ ½ (S'/S)² + v'²/S, from differences of v and S: of the record as it is beside several regressors, of
            // its contrasts beside one.
            Long sum = 0, contrasted = 0;
            const Contrasts c = contrasts(here), over = contrasts(up), under = contrasts(down);
            for (std::size_t t = 0; t < n; ++t) {
              if (std::isnan(here.standardised[t])) continue;
              const Long dS = (up.S[t] - down.S[t]) / (2 * step), dv = (up.v[t][0] - down.v[t][0]) / (2 * step);
              sum += 0.5L * dS * dS / (here.S[t] * here.S[t]) + dv * dv / here.S[t];
              if (c.S[t] == 0) continue;
              const Long wide = (over.S[t] - under.S[t]) / (2 * step), e = (over.v[t] - under.v[t]) / (2 * step);
              contrasted += 0.5L * wide * wide / (c.S[t] * c.S[t]) + e * e / c.S[t];
            }
            CHECK_CLOSE(got.information[l * count + l], static_cast<double>(sum), 1e-5);
            CHECK_CLOSE(one.information[l * count + l], static_cast<double>(contrasted), 1e-5);
          }
        }
}

void information_of_white_noise_is_half_a_sample() {
  const std::size_t n = 400;
  const std::vector<double> y(n, 0.0), none, dR{2.0};
  const gmwm::Score got = gmwm::score({0, none, none, none, none, 2.0}, {1, none, none, none, none, dR}, {1, n, y});
  CHECK_CLOSE(got.information[0], n / 2.0, 1e-14);
  CHECK_CLOSE(got.log_slopes[0], 1.0 * n, 1e-14);
  CHECK(got.square == 0);
}

// Without noise of the state smoothing is regression on where it starts.
void tracks_of_a_constant_are_its_mean() {
  const std::size_t n = 10000;
  Numbers numbers;
  std::vector<double> y(n);
  double sum = 0;
  std::size_t there = 0;
  for (std::size_t t = 0; t < n; ++t) {
    y[t] = t % 7 == 0 ? std::numeric_limits<double>::quiet_NaN() : numbers.next();
    if (t % 7 != 0) sum += y[t], ++there;
  }
  const std::vector<double> one{1}, zero{0}, start{5};
  std::vector<double> means(2 * n), variances(2 * n);
  const std::vector<double> pick{1}, shares;
  CHECK(gmwm::tracks({1, one, zero, one, start, 0.5}, {1, n, y}, {1, pick, shares}, true, means, variances));
  const double precision = 1 / 5.0 + static_cast<double>(there) / 0.5;
  for (std::size_t t = 0; t < n; t += 11) {
    CHECK_CLOSE(means[t], sum / 0.5 / precision, 1e-10);
    CHECK_CLOSE(variances[t], 1 / precision, 1e-8);
    if (t % 7 != 0) CHECK(std::abs(means[n + t] - (y[t] - means[t])) < 1e-12);
  }
  CHECK(gmwm::tracks({1, one, zero, one, start, 0.5}, {1, n, y}, {1, pick, shares}, false, means, variances));
  CHECK_CLOSE(means[n - 1], sum / 0.5 / precision, 1e-10);
  CHECK(variances[0] == 5 && means[0] == 0);
}

void what_leaves_nothing_to_chance_is_said() {
  const std::vector<double> one{1}, zero{0}, y(40, 1.0);
  std::vector<double> none, means(80), variances(80);
  CHECK(gmwm::innovations({1, one, zero, one, one, 0}, {1, 40, y}, none).singular);
  CHECK(gmwm::score({1, one, zero, one, one, 0}, {1, one, one, one, one, one}, {1, 40, y}).singular);
  CHECK(!gmwm::tracks({1, one, zero, one, one, 0}, {1, 40, y}, {1, one, none}, true, means, variances));
  CHECK(gmwm::innovations({0, none, none, none, none, 0}, {1, 40, y}, none).singular);
}

}  // namespace

int main() {
  return check::at_each_level("kalman", [] {
    innovations_are_the_textbook_s();
    slopes_are_those_of_the_values();
    information_of_white_noise_is_half_a_sample();
    tracks_of_a_constant_are_its_mean();
    what_leaves_nothing_to_chance_is_said();
  });
}
