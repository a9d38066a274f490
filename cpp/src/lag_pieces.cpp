#include "gmwm/lag_pieces.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <numbers>

namespace gmwm {

namespace {

// Exponent beyond which an exponential is zero: e^-70 times any number of lags is negligible beside its part at a kink.
constexpr double gone = 70;

constexpr std::array<double, degree_most + 1> inverse_factorial = [] {
  std::array<double, degree_most + 1> values{};
  double product = 1;
  for (std::size_t r = 0; r <= degree_most; ++r) values[r] = 1 / product, product *= static_cast<double>(r + 1);
  return values;
}();

// Binomial coefficients, by row.
constexpr std::array<std::array<double, degree_most + 1>, degree_most + 1> binomials = [] {
  std::array<std::array<double, degree_most + 1>, degree_most + 1> values{};
  for (std::size_t r = 0; r <= degree_most; ++r)
    for (std::size_t s = 0; s <= r; ++s) values[r][s] = s == 0 ? 1 : values[r - 1][s - 1] + (s < r ? values[r - 1][s] : 0);
  return values;
}();

// x / sinh x for small x.
Complex over_sinh(Complex x) {
  const Complex y = x * x;
  Complex total{1, 0};
  for (int k = 8; k >= 1; --k) total = Complex{1, 0} + (1.0 / (2 * k * (2 * k + 1))) * (y * total);
  return inverse(total);
}

}  // namespace

std::array<LagInterval, 5> intervals(std::int64_t h, std::int64_t g, std::int64_t samples) {
  const std::int64_t end = samples - h - g + 1;
  std::array<std::int64_t, 6> kinks{0, h, g - h, g, g + h, end};
  std::sort(kinks.begin(), kinks.end() - 1);
  const double all = static_cast<double>(samples - 2 * g + 1);
  std::array<LagInterval, 5> out;
  for (std::size_t k = 0; k < out.size(); ++k) {
    const std::int64_t start = kinks[k];
    out[k] = {start, std::min(kinks[k + 1], end) - start,
              start < g - h ? LagCount{all, 0} : LagCount{static_cast<double>(end - start), -1}};
  }
  return out;
}

LagPieces::LagPieces(const LagProcess& process) : process_(process) {
  const std::size_t n = process.decay_re.size();
  for (std::size_t p = 0; p < n; ++p) {
    const Complex decay{process.decay_re[p], process.decay_im[p]}, a{process.amplitude_re[p], process.amplitude_im[p]};
    const bool back = decay.im > 0.5 * std::numbers::pi;
    // 1 - z and 1 + z, accurate for z near 1 and near -1.
    const Complex less = -expm1(-decay);
    const Complex more = back ? -expm1(-Complex{decay.re, decay.im - std::numbers::pi}) : Complex{2, 0} - less;
    const Complex over = inverse(less);
    decay_.push_back(decay);
    amplitude_.push_back(a);
    pole_.push_back(exp(-decay));
    over_apart_.push_back(-over);
    size_.push_back(gmwm::size(decay));
    real_.push_back(decay.im == 0 || decay.im == std::numbers::pi);
    weight_.push_back(-(a * pole_.back() * over * over));
    slope_.push_back(process.bare[p] ? 0.0 : -0.5 * (a * more * over).re);
  }
  tail_.resize(n), ahead_.resize(n), behind_.resize(n);
}

const Complex* LagPieces::power(std::int64_t exponent) {
  // The vectors stay in place, because they are moved and not copied if `all` grows.
  auto& [all, used] = std::abs(exponent) <= h_ + 1 ? fine_->powers : powers_;
  for (std::size_t k = 0; k < used; ++k)
    if (all[k].first == exponent) return all[k].second.data();
  if (used == all.size()) all.emplace_back(0, std::vector<Complex>(size()));
  auto& [key, values] = all[used++];
  key = exponent;
  const double n = static_cast<double>(exponent);
  for (std::size_t p = 0; p < size(); ++p) {
    const double lost = decay_[p].re * n, modulus = lost > gone ? 0.0 : std::exp(-lost), angle = decay_[p].im;
    if (angle == 0)
      values[p] = {modulus, 0};
    else if (real_[p])
      values[p] = {exponent % 2 == 0 ? modulus : -modulus, 0};
    else
      values[p] = modulus == 0 ? Complex{} : Complex{modulus * std::cos(angle * n), -modulus * std::sin(angle * n)};
  }
  return values.data();
}

void LagPieces::pair(std::int64_t h, std::int64_t g) {
  powers_.used = 0;
  h_ = h, g_ = g, fine_ = &level(h);
  const Level &fine = *fine_, &coarse = level(g);
  rest_ = fine.rest, speed_ = fine.speed;
  for (std::size_t p = 0; p < size(); ++p) {
    tail_[p] = fine.outside[p] * coarse.lost[p] * coarse.lost[p];
    if (speed_[p] == Speed::fast && g > h && coarse.speed[p] == Speed::echo)
      speed_[p] = Speed::swing, rest_[p] = coarse.rest[p];
    else if (speed_[p] == Speed::between && coarse.speed[p] == Speed::between)
      speed_[p] = Speed::still;
  }
}

LagPieces::Level& LagPieces::level(std::int64_t half) {
  const auto [found, fresh] = levels_.try_emplace(half);
  if (fresh) fill(static_cast<double>(half), found->second);
  return found->second;
}

void LagPieces::fill(double h, Level& out) const {
  for (std::vector<Complex>* each : {&out.lost, &out.outside, &out.bend, &out.rest}) each->resize(size());
  out.corner.resize(size()), out.speed.resize(size());
  for (std::size_t p = 0; p < size(); ++p) {
    const Complex decay = decay_[p];
    out.lost[p] = expm1(-multiple(h, decay));
    const Complex ratio = out.lost[p] * inverse(expm1(-decay));
    out.outside[p] = -(amplitude_[p] * pole_[p] * ratio * ratio);
    out.speed[p] = h * size_[p] < slow ? Speed::between : Speed::fast;
    if (out.speed[p] == Speed::fast) {
      const Complex turned = wrapped(multiple(h, decay));
      out.rest[p] = (1 / h) * turned;
      if (h > 1 && gmwm::size(turned) < periodic) out.speed[p] = Speed::echo;
      continue;
    }
    // a λ^(r-2) (λ/2 / sinh(λ/2))² 2 (d^r - d) / r! for r = 3, 5, …
    const Complex share = over_sinh(0.5 * decay);
    Complex factor = (2 * h * h * h) * (amplitude_[p] * decay * share * share);
    const Complex step = (h * h) * (decay * decay);
    Series& series = out.corner[p];
    double linear = 0, over_h = 1 / (h * h);
    for (std::size_t r = 3; r <= degree_most; r += 2, factor *= step, over_h /= h * h) {
      series[r] = factor.re * inverse_factorial[r];
      linear -= series[r] * over_h;
    }
    series[1] = linear;
    // 2 sinh²(λh/2) / sinh²(λ/2), times the amplitude.
    const Complex both = over_sinh((0.5 * h) * decay), quotient = h * (share * inverse(both));
    out.bend[p] = 2 * (amplitude_[p] * quotient * quotient);
  }
}

// Adds Re(coefficient exp(-decay_of_count i / count)) to the polynomial.
void LagPieces::add(Complex coefficient, Complex decay_of_count, LagPiece& out) const {
  const Complex step = -decay_of_count;
  const double ratio = gmwm::size(step), least = 1e-18;
  double left = 1;
  for (std::size_t r = 0; r <= degree_most; ++r) {
    out.polynomial[r] += coefficient.re * inverse_factorial[r];
    out.degree = std::max(out.degree, r);
    coefficient *= step;
    left *= ratio;
    if (left * inverse_factorial[r] < least) break;
  }
}

// Adds at_start + step i.
void LagPieces::straight(double at_start, double step, LagPiece& out) const {
  out.polynomial[0] += at_start;
  out.polynomial[1] += step * static_cast<double>(out.count);
  out.degree = std::max<std::size_t>(out.degree, 1);
}

// Adds weight Σ_r series[r] (d / h)^r, r odd, with d = i if `rising`, else d = h - i; ratio: count / h.
void LagPieces::corner(const Series& series, double weight, bool rising, double ratio, LagPiece& out) const {
  std::size_t last = degree_most;
  while (last > 1 && std::abs(series[last]) < 1e-18 * std::abs(series[3])) --last;
  Series powers = series;
  if (!rising) {
    // (1 - x)^r, with even r missing
    powers.fill(0);
    for (std::size_t r = 1; r <= last; r += 2)
      for (std::size_t s = 0; s <= degree_most; ++s) powers[s] += series[r] * binomials[r][s];
  }
  for (std::size_t r = 0; r <= last; ++r, weight *= rising ? ratio : -ratio) out.polynomial[r] += weight * powers[r];
  out.degree = std::max(out.degree, last);
}

// White noise and the random walk.
void LagPieces::walk(LagPiece& out) const {
  const double a = static_cast<double>(out.start), h = static_cast<double>(h_), g = static_cast<double>(g_);
  const double slope = -0.5 * process_.white, ratio = static_cast<double>(out.count) / h;
  const Series series{0, -process_.walk * h / 6, 0, process_.walk * h * h * h / 6};
  const auto bent = [&](double weight, bool rising, double d, double step) {
    if (process_.white != 0) straight(2 * weight * slope * d, 2 * weight * slope * step, out);
    if (process_.walk != 0) corner(series, weight, rising, ratio, out);
  };
  if (out.start == 0) bent(-2, false, h, -1);
  if (out.start >= g_ - h_ && out.start < g_) bent(1, true, a - (g - h), 1);
  if (out.start >= g_ && out.start < g_ + h_) bent(1, false, h - (a - g), -1);
  if (process_.walk != 0 && out.start < g_) straight(process_.walk * h * h * (g - a), -process_.walk * h * h, out);
}

void LagPieces::piece(std::int64_t start, std::int64_t count, LagPiece& out) {
  out.start = start, out.count = count, out.degree = 0;
  out.polynomial.fill(0);
  out.active.clear(), out.ahead.clear(), out.behind.clear(), out.echoes.clear();
  walk(out);
  const std::int64_t h = h_, g = g_, last = start + count - 1;
  const double n = static_cast<double>(count), ratio = n / static_cast<double>(h);
  const bool beyond = start >= g + h, middle = start == 0;
  const bool rising = start >= g - h && start < g, falling = start >= g && start < g + h;
  std::fill(ahead_.begin(), ahead_.end(), Complex{});
  std::fill(behind_.begin(), behind_.end(), Complex{});
  const auto outside = [&](std::vector<Complex>& to, double weight, std::int64_t distance) {
    const Complex* z = power(distance - h);
    for (std::size_t p = 0; p < size(); ++p)
      if (speed_[p] != Speed::still) to[p] += weight * (fine_->outside[p] * z[p]);
  };
  // The side of f on which |y| rises or falls from `near` to `far`: the larger |y| is at i = 0 if `rising`.
  const auto inside = [&](double weight, bool toward, std::int64_t near, std::int64_t far) {
    // z^(h - |y|), z^(h + |y|) and z^|y|, each with the end of the piece at which it is largest.
    const Complex *close = power(h - far), *wide = power(h + near), *own = power(near);
    std::vector<Complex>&from = toward ? behind_ : ahead_, &into = toward ? ahead_ : behind_;
    Series corners{};
    bool bent = false;
    for (std::size_t p = 0; p < size(); ++p) {
      if (speed_[p] <= Speed::echo) {
        const Complex w = weight * weight_[p];
        if (speed_[p] != Speed::echo) {
          into[p] += w * close[p];
          from[p] += w * (wide[p] - 2 * own[p]);
        }
        const double at = toward ? static_cast<double>(h - far) : static_cast<double>(h - near);
        if (slope_[p] != 0) straight(2 * weight * slope_[p] * at, (toward ? 2 : -2) * weight * slope_[p], out);
      } else {
        for (std::size_t r = 0; r <= degree_most; ++r) corners[r] += fine_->corner[p][r];
        bent = true;
      }
    }
    if (bent) corner(corners, weight, toward, ratio, out);
    bool between = false;
    for (std::size_t p = 0; p < size(); ++p) between = between || speed_[p] == Speed::between || speed_[p] == Speed::echo;
    if (!between) return;
    const Complex* z = power(near - h);
    for (std::size_t p = 0; p < size(); ++p)
      if (speed_[p] == Speed::between || speed_[p] == Speed::echo) from[p] += weight * (fine_->outside[p] * z[p]);
  };
  if (beyond) {
    const Complex* z = power(start - g - h);
    for (std::size_t p = 0; p < size(); ++p) ahead_[p] = tail_[p] * z[p];
  } else {
    outside(ahead_, 1, start + g);
    if (middle) inside(-2, false, 0, last);
    if (!middle) outside(ahead_, -2, start);
    if (rising) inside(1, true, g - last, g - start);
    if (falling) inside(1, false, start - g, last - g);
    if (!rising && !falling) outside(behind_, 1, g - last);
    for (std::size_t p = 0; p < size(); ++p) {
      if (speed_[p] != Speed::still) continue;
      const Complex decay = decay_[p];
      const double a = static_cast<double>(start), top = static_cast<double>(g);
      add(tail_[p] * exp((top + static_cast<double>(h) - a) * decay), n * decay, out);
      if (start >= g) continue;
      // sinh λ(g - a - i) and its derivatives
      const Complex even = fine_->bend[p] * sinh((top - a) * decay), odd = -(fine_->bend[p] * cosh((top - a) * decay));
      Complex power{1, 0};
      double left = 1;
      for (std::size_t r = 0; r <= degree_most; ++r) {
        out.polynomial[r] += inverse_factorial[r] * ((r % 2 == 0 ? even : odd) * power).re;
        out.degree = std::max(out.degree, r);
        power *= n * decay;
        left *= n * size_[p];
        if (r > 0 && left * inverse_factorial[r] < 1e-18) break;
      }
    }
  }
  const Complex* end = power(count - 1);
  for (std::size_t p = 0; p < size(); ++p) {
    if ((speed_[p] == Speed::echo || speed_[p] == Speed::swing) && !beyond) {
      const bool rest = n * gmwm::size(rest_[p]) < slow;
      if (rest || (speed_[p] == Speed::echo && (middle || rising || falling))) echo(p, end[p], out);
      if (rest) continue;
    }
    if (norm(ahead_[p]) == 0 && norm(behind_[p]) == 0) continue;
    const Complex decay = n * decay_[p];
    if (n * size_[p] < slow) {
      if (norm(ahead_[p]) > 0) add(ahead_[p], decay, out);
      if (norm(behind_[p]) > 0) add(behind_[p] * end[p], -decay, out);
      continue;
    }
    out.active.push_back(p);
    out.ahead.push_back(ahead_[p]);
    out.behind.push_back(behind_[p]);
  }
}

// Near a kink: w (z^d - z^(-d)) with d = h - |y|. The exponentials of the piece too, if they are slow in it.
void LagPieces::echo(std::size_t p, Complex end, LagPiece& out) const {
  const double n = static_cast<double>(out.count), h = static_cast<double>(h_), ratio = n / h;
  const Complex rest = rest_[p], back = conj(rest), w = weight_[p];
  Echo echo;
  echo.angle = decay_[p].im - rest.im;
  if (n * gmwm::size(rest) < slow) {
    Complex first = ahead_[p], second = conj(behind_[p] * end);
    for (std::size_t r = 0; r <= degree_most; ++r, first *= -(n * rest), second *= n * back)
      echo.series[r] += inverse_factorial[r] * (first + second);
  }
  out.echoes.push_back(echo);
  if (speed_[p] != Speed::echo) return;
  // Σ_r (conj(w) (-conj(ρ))^r - w ρ^r) d^r / r!, in powers of d / h.
  std::array<Complex, degree_most + 1> series;
  Complex one = conj(w), two = w;
  for (std::size_t r = 0; r <= degree_most; ++r, one *= -(h * back), two *= h * rest)
    series[r] = inverse_factorial[r] * (one - two);
  const auto add = [&](double weight, bool rising) {
    std::array<Complex, degree_most + 1> shifted{};
    if (rising) {
      double power = weight;
      for (std::size_t r = 0; r <= degree_most; ++r, power *= ratio) shifted[r] = power * conj(series[r]);
    } else {
      for (std::size_t r = degree_most + 1; r-- > 0;) {
        for (std::size_t s = degree_most; s >= 1; --s) shifted[s] += -ratio * shifted[s - 1];
        shifted[0] += weight * series[r];
      }
    }
    for (std::size_t r = 0; r <= degree_most; ++r) out.echoes.back().series[r] += shifted[r];
  };
  if (out.start == 0) add(-2, false);
  if (out.start >= g_ - h_ && out.start < g_) add(1, true);
  if (out.start >= g_ && out.start < g_ + h_) add(1, false);
}

double LagPieces::spike(std::int64_t v) const {
  const std::int64_t reach = static_cast<std::int64_t>(spikes());
  const auto at = [&](std::int64_t m) {
    m = std::abs(m);
    return m < reach ? process_.spikes[static_cast<std::size_t>(m)] : 0.0;
  };
  const auto difference = [&](std::int64_t y) { return at(y - h_) - 2 * at(y) + at(y + h_); };
  return difference(v + g_) - 2 * difference(v) + difference(v - g_);
}

}  // namespace gmwm
