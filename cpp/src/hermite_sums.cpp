#include "gmwm/hermite_sums.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <utility>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/complex.hpp"
#include "gmwm/lag_pieces.hpp"
#include "gmwm/lags.hpp"

namespace gmwm {

namespace {

constexpr std::size_t block = 256;  // lags that are evaluated together
constexpr std::size_t span = 16 * block;  // lags in which a slow exponential is a polynomial
constexpr std::size_t order = 8;    // of the Gauss rule, as in lags.cpp
constexpr std::size_t powers = hermite_powers;
// Correlations below which ρ⁴ is nothing next to ρ², and below which an oscillation changes no sum of a Gauss rule.
constexpr double faint = 3e-4, silent = 1e-9;
constexpr double unseen = 1e-13;  // correlations that change no sum of lags
// Largest angle by which an oscillation may turn in a Gauss rule, so that eight of its harmonics are exact to 1e-8.
constexpr double turn = 1;
constexpr double shortest_rule = 256;  // lags of which eight nodes take less time than every lag
constexpr double gone = 40;            // exp(-40) is nothing next to 1
// Harmonics of an oscillation in its powers, and terms of the sum by parts of each.
constexpr std::size_t harmonics = 2 * powers + 2, parts = 3;
constexpr std::size_t none = static_cast<std::size_t>(-1);

using Values = std::array<double, block>;
using Polynomial = std::array<double, degree_most + 1>;

// z^l, and z^(block - 1 - l), at the lags l of a block, and z^block.
struct Powers {
  Values ahead_re, ahead_im, behind_re, behind_im;
  Complex step, back;  // back: z^-block, of poles that are not gone within a few blocks
};

GMWM_INLINE void polynomial_inline(const double* coefficients, std::size_t degree, double* values) {
  for (std::size_t l = 0; l < block; ++l) values[l] = coefficients[degree];
  constexpr double step = 1.0 / block;
  for (std::size_t r = degree; r-- > 0;)
    for (std::size_t l = 0; l < block; ++l)
      values[l] = values[l] * (step * static_cast<double>(static_cast<int>(l))) + coefficients[r];
}
constexpr Clones<polynomial_inline> polynomial_of_block{};

// Adds Re(a x) for the n numbers x.
GMWM_INLINE void real_parts_inline(Complex a, const double* re, const double* im, std::size_t n, double* values) {
  for (std::size_t l = 0; l < n; ++l) values[l] += a.re * re[l] - a.im * im[l];
}
constexpr Clones<real_parts_inline> real_parts{};

// Adds Re(a x + b y) for the numbers x and y of a whole block.
GMWM_INLINE void both_parts_inline(Complex a, Complex b, const Powers& table, double* values) {
  for (std::size_t l = 0; l < block; ++l)
    values[l] += (a.re * table.ahead_re[l] - a.im * table.ahead_im[l]) +
                 (b.re * table.behind_re[l] - b.im * table.behind_im[l]);
}
constexpr Clones<both_parts_inline> both_parts{};

GMWM_INLINE double hermite(double value, double over_unit, const double* weights) {
  const double square = value * value * over_unit;
  double total = weights[powers - 1];
  for (std::size_t r = powers - 1; r-- > 0;) total = total * square + weights[r];
  return total * square * square;
}

// cos θ at n phases, with which the mean over all phases of a polynomial of degree 2n - 1 in cos θ is exact.
template <std::size_t n>
std::array<double, n> cosines() {
  std::array<double, n> out;
  for (std::size_t k = 0; k < n; ++k) out[k] = std::cos(std::numbers::pi * (static_cast<double>(k) + 0.5) / n);
  return out;
}

// Σ (at_start + step l) T(values[l]) over n lags.
GMWM_INLINE double counted_inline(const double* values, std::size_t n, double over_unit, const double* weights,
                                  LagCount count) {
  constexpr std::size_t lanes = 32;
  double sums[lanes] = {}, risen[lanes] = {};
  std::size_t l = 0;
  for (; l + lanes <= n; l += lanes)
    for (std::size_t k = 0; k < lanes; ++k) {
      const double term = hermite(values[l + k], over_unit, weights);
      sums[k] += term;
      risen[k] += static_cast<double>(static_cast<int>(l)) * term;
    }
  double total = 0;
  for (std::size_t k = 0; k < lanes; ++k)
    total += (count.at_start + count.step * static_cast<double>(k)) * sums[k] + count.step * risen[k];
  for (; l < n; ++l)
    total += (count.at_start + count.step * static_cast<double>(l)) * hermite(values[l], over_unit, weights);
  return total;
}
constexpr Clones<counted_inline> counted{};

class Sums {
 public:
  Sums(const LagProcess& process, std::int64_t samples, std::span<const double> weights);

  double variance(std::int64_t h);
  double pair(std::int64_t h, std::int64_t g);

 private:
  // An exponential of a piece at the first lag of a block, and at its last.
  struct Moving {
    std::size_t p, place;  // in the process, and in the piece
    Complex ahead, behind;
  };

  double piece(LagCount count);
  double lag_by_lag(std::int64_t begin, std::int64_t end, LagCount count);
  double rules(std::int64_t begin, std::int64_t end, LagCount count);
  double rule(std::int64_t begin, std::int64_t points, LagCount count);
  double term(double lag) const;
  Complex swing(double lag) const;
  double harmonics_from(std::int64_t begin, LagCount count) const;
  double least_turn(std::size_t k) const;
  void start(std::int64_t begin);
  void step(std::int64_t begin);
  Complex last_of_block(const Moving& next, std::int64_t begin) const;
  double fill(std::int64_t begin, std::size_t lags);
  double echoes(std::int64_t begin);
  double at(double lag) const;
  const Powers& table(std::size_t p);

  LagPieces process_;
  std::int64_t samples_;
  std::array<double, powers> weights_;
  std::vector<Powers> tables_;
  std::vector<std::size_t> table_of_;  // of each exponential, from 1; 0: not yet computed
  std::map<std::int64_t, double> variances_;
  std::map<std::int64_t, std::array<std::array<double, order>, 2>> rules_;
  LagPiece piece_;
  std::size_t lasting_ = none;  // place in the piece of an oscillation of which rules take the mean over its phases
  double unit_ = 1;  // √s
  Polynomial smooth_{};  // in powers of (i - begin_) / span
  std::size_t degree_ = 0;
  std::int64_t begin_ = 0;
  Values values_{};
  std::vector<Moving> moving_;
  std::vector<Powers> echo_tables_;
};

Sums::Sums(const LagProcess& process, std::int64_t samples, std::span<const double> weights)
    : process_(process), samples_(samples), table_of_(process_.size(), 0) {
  weights_.fill(0);
  std::copy_n(weights.begin(), std::min(weights.size(), powers), weights_.begin());
}

// e^(-λ n), for n >= 0.
Complex shrunk(Complex decay, double n) {
  if (decay.re * n > 700) return {};
  return exp(-multiple(n, decay));
}

// The polynomial in the variable b + s t instead of t; returns the sum of the sizes of its coefficients.
template <class Number, class Size>
double moved(std::array<Number, degree_most + 1>& polynomial, std::size_t degree, double b, double s, Size size) {
  for (std::size_t r = 0; r < degree; ++r)
    for (std::size_t k = degree; k-- > r;) polynomial[k] += b * polynomial[k + 1];
  double total = 0, factor = 1;
  for (std::size_t r = 0; r <= degree; ++r, factor *= s) {
    polynomial[r] = factor * polynomial[r];
    total += size(polynomial[r]);
  }
  return total;
}

// Whether an oscillation turns so fast that a Gauss rule for it would take longer than every lag.
bool is_fast(Complex decay) { return turn / decay.im < shortest_rule; }

double size_of(Complex a) { return std::abs(a.re) + std::abs(a.im); }

const Powers& Sums::table(std::size_t p) {
  if (table_of_[p] == 0) {
    Powers& powers_of_pole = tables_.emplace_back();
    table_of_[p] = tables_.size();
    for (std::size_t l = 0; l < block; ++l) {
      const Complex power = shrunk(process_.decay(p), static_cast<double>(l));
      powers_of_pole.ahead_re[l] = powers_of_pole.behind_re[block - 1 - l] = power.re;
      powers_of_pole.ahead_im[l] = powers_of_pole.behind_im[block - 1 - l] = power.im;
    }
    constexpr double size = static_cast<double>(block);
    const Complex decay = process_.decay(p);
    powers_of_pole.step = shrunk(decay, size);
    if (decay.re * size < 10) powers_of_pole.back = exp(multiple(size, decay));
  }
  return tables_[table_of_[p] - 1];
}

// C(start + x) at a real number x, without spikes and echoes, and without an oscillation whose mean is taken.
double Sums::at(double lag) const {
  const double n = static_cast<double>(piece_.count), t = lag / n;
  double value = 0;
  for (std::size_t r = piece_.degree + 1; r-- > 0;) value = value * t + piece_.polynomial[r];
  const auto add = [&](Complex factor, Complex decay, double distance) {
    if (decay.re * distance > gone) return;
    const double modulus = std::exp(-decay.re * distance);
    if (decay.im == 0)
      value += factor.re * modulus;
    else
      value += modulus * (factor.re * std::cos(decay.im * distance) + factor.im * std::sin(decay.im * distance));
  };
  for (std::size_t k = 0; k < piece_.active.size(); ++k) {
    if (k == lasting_) continue;
    const Complex decay = process_.decay(piece_.active[k]);
    if (norm(piece_.ahead[k]) > 0) add(piece_.ahead[k], decay, lag);
    if (norm(piece_.behind[k]) > 0) add(piece_.behind[k], decay, n - 1 - lag);
  }
  return value;
}

// Prepares the `span` of blocks that begins at a lag: what is smooth in it as one polynomial, and the other exponentials.
void Sums::start(std::int64_t begin) {
  constexpr double size = static_cast<double>(span);
  const double n = static_cast<double>(piece_.count), first = static_cast<double>(begin), rest = n - first;
  smooth_ = piece_.polynomial, degree_ = piece_.degree, begin_ = begin;
  moved(smooth_, degree_, first / n, size / n, [](double x) { return std::abs(x); });
  moving_.clear();
  for (std::size_t k = 0; k < piece_.active.size(); ++k) {
    const Complex decay = process_.decay(piece_.active[k]), behind = piece_.behind[k];
    Moving next{piece_.active[k], k, {}, {}};
    if (norm(piece_.ahead[k]) > 0) next.ahead = piece_.ahead[k] * shrunk(decay, first);
    const bool rises = norm(behind) > 0;
    const double most = rises ? size_of(behind) * std::exp(-decay.re * std::max(rest - size, 0.0)) : 0.0;
    if (size_of(next.ahead) + most < unseen * unit_) continue;
    if (decay.im == 0 && decay.re * size < slow) {
      const double back = rises ? behind.re * std::exp(-decay.re * (rest - 1)) : 0.0;
      double term = 1;
      for (std::size_t r = 0; r <= degree_most; term *= decay.re * size / static_cast<double>(++r)) {
        smooth_[r] += (back + (r % 2 == 0 ? next.ahead.re : -next.ahead.re)) * term;
        degree_ = std::max(degree_, r);
        if (term < 1e-18) break;
      }
      continue;
    }
    if (rises) next.behind = last_of_block(next, begin);
    moving_.push_back(next);
  }
}

// An exponential that rises, at the last lag of a block; 0 if the piece ends in the block.
Complex Sums::last_of_block(const Moving& next, std::int64_t begin) const {
  const std::int64_t rest = piece_.count - begin - static_cast<std::int64_t>(block);
  return rest < 0 ? Complex{} : piece_.behind[next.place] * shrunk(process_.decay(next.p), static_cast<double>(rest));
}

// Moves the exponentials by a block, to the one that begins at a lag.
void Sums::step(std::int64_t begin) {
  for (Moving& next : moving_) {
    const Powers& powers_of_pole = table(next.p);
    next.ahead *= powers_of_pole.step;
    if (norm(powers_of_pole.back) > 0)
      next.behind *= powers_of_pole.back;
    else
      next.behind = last_of_block(next, begin);
  }
}

// Writes C of a block; returns a bound of its size.
double Sums::fill(std::int64_t begin, std::size_t lags) {
  constexpr double size = static_cast<double>(span);
  Polynomial local = smooth_;
  std::size_t degree = degree_;
  double bound = moved(local, degree, static_cast<double>(begin - begin_) / size, static_cast<double>(block) / size,
                       [](double x) { return std::abs(x); });
  const bool last = begin + static_cast<std::int64_t>(block) > piece_.count;
  for (Moving& next : moving_) {
    if (last) next.behind = piece_.behind[next.place];
    bound += size_of(next.ahead) + size_of(next.behind);
  }
  if (bound < faint * unit_ && piece_.echoes.empty() && process_.spikes() == 0) return bound;
  while (degree > 0 && std::abs(local[degree]) < 1e-16 * unit_) --degree;
  polynomial_of_block(local.data(), degree, values_.data());
  for (const Moving& next : moving_) {
    if (size_of(next.ahead) + size_of(next.behind) < unseen * unit_) continue;
    const Powers& powers_of_pole = table(next.p);
    if (!last) {
      both_parts(next.ahead, next.behind, powers_of_pole, values_.data());
      continue;
    }
    const std::size_t shift = block - lags;
    real_parts(next.ahead, powers_of_pole.ahead_re.data(), powers_of_pole.ahead_im.data(), lags, values_.data());
    real_parts(next.behind, powers_of_pole.behind_re.data() + shift, powers_of_pole.behind_im.data() + shift, lags,
               values_.data());
  }
  if (!piece_.echoes.empty()) bound += echoes(begin);
  const std::int64_t reach = static_cast<std::int64_t>(process_.spikes());
  if (reach > 0)
    for (std::size_t l = 0; l < lags; ++l) {
      const std::int64_t i = begin + static_cast<std::int64_t>(l);
      if (i >= reach && i < piece_.count - reach) {
        l += static_cast<std::size_t>(piece_.count - reach - i) - 1;
        continue;
      }
      const double spike = process_.spike(piece_.start + i);
      values_[l] += spike;
      bound += std::abs(spike);
    }
  return bound;
}

double Sums::echoes(std::int64_t begin) {
  const double n = static_cast<double>(piece_.count), size = static_cast<double>(block);
  double bound = 0;
  for (std::size_t k = 0; k < piece_.echoes.size(); ++k) {
    const Echo& echo = piece_.echoes[k];
    std::array<Complex, degree_most + 1> local = echo.series;
    bound += moved(local, degree_most, static_cast<double>(begin) / n, size / n, size_of);
    const double angle = std::remainder(echo.angle * static_cast<double>(begin), 2 * std::numbers::pi);
    const Complex turned = exp({0, -angle});
    std::size_t degree = degree_most;
    while (degree > 0 && size_of(local[degree]) < 1e-16 * unit_) --degree;
    const Powers& powers_of_echo = echo_tables_[k];
    for (std::size_t l = 0; l < block; ++l) {
      const double t = static_cast<double>(l) / size;
      Complex sum = local[degree];
      for (std::size_t r = degree; r-- > 0;) sum = t * sum + local[r];
      values_[l] += (turned * sum * Complex{powers_of_echo.ahead_re[l], powers_of_echo.ahead_im[l]}).re;
    }
  }
  return bound;
}

double Sums::lag_by_lag(std::int64_t begin, std::int64_t end, LagCount count) {
  double total = 0;
  const double over_unit = 1 / (unit_ * unit_);
  for (const std::int64_t first = begin; begin < end; begin += static_cast<std::int64_t>(block)) {
    if ((begin - first) % static_cast<std::int64_t>(span) == 0)
      start(begin);
    else
      step(begin);
    const std::int64_t rest = std::min<std::int64_t>(piece_.count - begin, static_cast<std::int64_t>(block));
    if (fill(begin, static_cast<std::size_t>(rest)) < faint * unit_) continue;
    const LagCount here{count.at_start + count.step * static_cast<double>(begin), count.step};
    total += counted(values_.data(), static_cast<std::size_t>(std::min(rest, end - begin)), over_unit, weights_.data(), here);
  }
  return total;
}

// The oscillation whose mean is taken, as a number that turns by -ω a lag.
Complex Sums::swing(double lag) const {
  const Complex decay = process_.decay(piece_.active[lasting_]);
  const double rest = static_cast<double>(piece_.count) - 1 - lag;
  return piece_.ahead[lasting_] * exp(-(lag * decay)) + conj(piece_.behind[lasting_] * exp(-(rest * decay)));
}

// T(C) at a lag, or its mean over the phases of an oscillation.
double Sums::term(double lag) const {
  static const auto phases = cosines<powers + 2>();
  const double over_unit = 1 / (unit_ * unit_), value = at(lag);
  if (lasting_ == none) return hermite(value, over_unit, weights_.data());
  const double amplitude = gmwm::size(swing(lag));
  double total = 0;
  for (const double phase : phases) total += hermite(value + amplitude * phase, over_unit, weights_.data());
  return total / static_cast<double>(phases.size());
}

// What the harmonics of an oscillation add to the sum over all lags from `begin` on, if they ended slowly. With
// g(u) = n(u) times the factor of z^u, Σ_{u ≥ a} z^u g(u) = z^a Σ_r z^r Δ^r g(a) / (1 - z)^(r + 1).
double Sums::harmonics_from(std::int64_t begin, LagCount count) const {
  constexpr std::size_t size = powers + 2 + harmonics / 2;
  static const auto phases = cosines<size>();
  const double over_unit = 1 / (unit_ * unit_), omega = process_.decay(piece_.active[lasting_]).im;
  std::array<std::array<double, parts>, harmonics> factors{};
  Complex first;
  for (std::size_t r = 0; r < parts; ++r) {
    const double lag = static_cast<double>(begin + static_cast<std::int64_t>(r)), value = at(lag);
    const Complex turned = swing(lag);
    if (r == 0) first = turned;
    for (const double phase : phases) {
      const double here = hermite(value + gmwm::size(turned) * phase, over_unit, weights_.data());
      double before = 1, cosine = phase;  // cos kθ
      for (std::size_t k = 0; k < harmonics; ++k) {
        factors[k][r] += 2.0 / size * (count.at_start + count.step * lag) * here * cosine;
        before = std::exchange(cosine, 2 * phase * cosine - before);
      }
    }
  }
  if (norm(first) == 0) return 0;
  double total = 0;
  const Complex unit = (1 / gmwm::size(first)) * first;
  Complex angle{1, 0};
  for (std::size_t k = 0; k < harmonics; ++k) {
    angle *= unit;
    const Complex less = expm1({0, -wrapped({0, static_cast<double>(k + 1) * omega}).im}), over = inverse(-less);
    Complex factor = angle * over;
    for (std::size_t r = 0; r < parts; ++r, factor *= (Complex{1, 0} + less) * over) {
      total += factors[k][0] * factor.re;
      for (std::size_t s = 0; s + 1 < parts; ++s) factors[k][s] = factors[k][s + 1] - factors[k][s];
    }
  }
  return total;
}

// The smallest |1 - z^k| of the harmonics of an oscillation.
double Sums::least_turn(std::size_t k) const {
  const double omega = process_.decay(piece_.active[k]).im;
  double least = 2;
  for (std::size_t r = 1; r <= harmonics; ++r)
    least = std::min(least, 2 * std::abs(std::sin(0.5 * static_cast<double>(r) * omega)));
  return least;
}

double Sums::rule(std::int64_t begin, std::int64_t points, LagCount count) {
  const double first = static_cast<double>(begin);
  double total = 0;
  const auto add = [&](double lag, double weight) { total += weight * (count.at_start + count.step * lag) * term(lag); };
  if (points <= static_cast<std::int64_t>(2 * order)) {
    for (std::int64_t i = 0; i < points; ++i) add(first + static_cast<double>(i), 1);
    return total;
  }
  const auto [place, fresh] = rules_.try_emplace(points);
  auto& [nodes, weights] = place->second;
  if (fresh) integer_rule(points, nodes, weights);
  for (std::size_t k = 0; k < order; ++k) add(first + nodes[k], weights[k]);
  return total;
}

// The lags between two others by rules, each no longer than its distance from the end where an exponential begins.
double Sums::rules(std::int64_t begin, std::int64_t end, LagCount count) {
  double fastest = 0, angle = 0;
  bool from_front = false, from_back = false;
  for (std::size_t k = 0; k < piece_.active.size(); ++k) {
    const Complex decay = process_.decay(piece_.active[k]);
    if (is_fast(decay) && k != lasting_) continue;
    fastest = std::max(fastest, decay.re);
    if (k != lasting_) angle = std::max(angle, decay.im);
    from_front = from_front || norm(piece_.ahead[k]) > 0, from_back = from_back || norm(piece_.behind[k]) > 0;
  }
  const std::int64_t n = piece_.count;
  const std::int64_t longest = angle > 0 ? static_cast<std::int64_t>(std::min(turn / angle, 4e18)) : n;
  const auto next = [&](std::int64_t distance) {
    double cut = std::max(2 / fastest, static_cast<double>(order));
    while (cut <= static_cast<double>(distance)) cut *= 2;
    return static_cast<std::int64_t>(std::min(cut, 4e18));
  };
  const std::int64_t middle = !from_front ? 0 : !from_back ? n : n / 2;
  double total = 0;
  while (begin < end) {
    std::int64_t to = std::min(end, begin + longest);
    if (fastest > 0) {
      if (begin < middle) {
        to = std::min(to, std::max(std::min(next(begin), middle), begin + 1));
      } else if (from_back) {
        // The largest cut below the distance from the end.
        const std::int64_t distance = n - begin;
        double cut = std::max(2 / fastest, static_cast<double>(order));
        if (static_cast<double>(distance) > cut) {
          while (2 * cut < static_cast<double>(distance)) cut *= 2;
          to = std::min(to, std::max(n - static_cast<std::int64_t>(cut), begin + 1));
        }
      }
    }
    total += rule(begin, to - begin, count);
    begin = to;
  }
  return total;
}

double Sums::piece(LagCount count) {
  const std::int64_t n = piece_.count;
  // Lags after which a factor that decays is smaller than `share` of the smallest that matters.
  const auto reach = [&](Complex factor, Complex decay, double share) {
    const double size = size_of(factor) * share / (silent * unit_);
    if (!(size > 1)) return std::int64_t{0};
    const double lags = std::log(size) / decay.re;
    return lags < static_cast<double>(n) ? static_cast<std::int64_t>(lags) + 1 : n;
  };
  const std::int64_t spikes = std::min(n, static_cast<std::int64_t>(process_.spikes()));
  struct Ends {
    std::int64_t front, back;
    void extend(std::int64_t front_reach, std::int64_t back_reach) {
      front = std::max(front, front_reach), back = std::max(back, back_reach);
    }
  };
  Ends ends{spikes, spikes}, others = ends;
  std::size_t longest = none;
  for (std::size_t k = 0, most = 0; k < piece_.active.size(); ++k) {
    const Complex decay = process_.decay(piece_.active[k]);
    if (!is_fast(decay)) continue;
    const std::int64_t front = reach(piece_.ahead[k], decay, 1), back = reach(piece_.behind[k], decay, 1);
    ends.extend(front, back);
    if (static_cast<std::size_t>(front + back) > most) most = static_cast<std::size_t>(front + back), longest = k;
  }
  if (!piece_.echoes.empty()) {
    ends = {n, 0};
  } else if (longest != none && ends.front + ends.back > static_cast<std::int64_t>(span)) {
    // The rest of a sum by parts falls with this power of the ratio of a decay and the turn of the oscillation.
    const double least = least_turn(longest);
    const auto share = [&](double speed) { return std::pow(std::min(speed / least, 1.0), static_cast<double>(parts)); };
    for (std::size_t r = 1; r <= piece_.degree; ++r)
      others.extend(reach({piece_.polynomial[r], 0}, {}, share(static_cast<double>(r) / static_cast<double>(n))), 0);
    for (std::size_t k = 0; k < piece_.active.size(); ++k) {
      const Complex decay = process_.decay(piece_.active[k]);
      const double left = k == longest ? share(decay.re) : is_fast(decay) ? 1.0 : share(gmwm::size(decay));
      others.extend(reach(piece_.ahead[k], decay, left), reach(piece_.behind[k], decay, left));
    }
    others.back += static_cast<std::int64_t>(parts);  // lags of which the sum by parts takes differences
    const std::int64_t shorter = std::min(ends.front + ends.back, n) - static_cast<std::int64_t>(block);
    if (least > turn / shortest_rule && others.front + others.back < shorter) lasting_ = longest, ends = others;
  }
  if (ends.front + ends.back + static_cast<std::int64_t>(block) > n) ends = {n, 0};
  const auto [front, back] = ends;
  echo_tables_.resize(piece_.echoes.size());
  for (std::size_t k = 0; k < piece_.echoes.size(); ++k)
    for (std::size_t l = 0; l < block; ++l) {
      const Complex power = exp({0, -std::remainder(piece_.echoes[k].angle * static_cast<double>(l), 2 * std::numbers::pi)});
      echo_tables_[k].ahead_re[l] = power.re, echo_tables_[k].ahead_im[l] = power.im;
    }
  double total = lag_by_lag(0, front, count) + rules(front, n - back, count) + lag_by_lag(n - back, n, count);
  if (lasting_ != none) total += harmonics_from(front, count) - harmonics_from(n - back, count);
  lasting_ = none;
  return total;
}

double Sums::variance(std::int64_t h) {
  const auto [place, fresh] = variances_.try_emplace(h, 0.0);
  if (fresh) {
    process_.pair(h, h);
    process_.piece(0, h, piece_);
    double value = at(0) + process_.spike(0);
    for (const Echo& echo : piece_.echoes) value += echo.series[0].re;
    place->second = value;
  }
  return place->second;
}

double Sums::pair(std::int64_t h, std::int64_t g) {
  const double size = variance(h) * variance(g);
  if (!(size > 0)) return 0;
  unit_ = std::sqrt(size);
  process_.pair(h, g);
  double total = 0;
  for (const LagInterval& interval : intervals(h, g, samples_)) {
    if (interval.count <= 0) continue;
    process_.piece(interval.start, interval.count, piece_);
    total += 2 * piece(interval.pairs);
    if (interval.start > 0) continue;
    // The lag at the centre of symmetry occurs once.
    double centre = at(0) + process_.spike(0);
    for (const Echo& echo : piece_.echoes) centre += echo.series[0].re;
    total -= interval.pairs.at_start * hermite(centre, 1 / size, weights_.data());
  }
  return total;
}

}  // namespace

void hermite_sums(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& process,
                  std::span<const double> weights, const HermiteSums& out) {
  Sums sums(process, samples, weights);
  std::size_t place = 0;
  for (std::size_t k = 0; k < levels.size(); ++k) {
    const std::int64_t g = std::int64_t{1} << (levels[k] - 1);
    out.variances[k] = sums.variance(g);
    for (std::size_t j = diagonal ? k : 0; j <= k; ++j) out.sums[place++] = sums.pair(std::int64_t{1} << (levels[j] - 1), g);
  }
}

}  // namespace gmwm
