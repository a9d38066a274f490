// Between two kinks both covariances are a polynomial plus exponentials, and n(u) is linear. Products of exponentials are
// geometric sums, with and without a factor i:
//   Σ x^i = (1 - x^n) / (1 - x),   Σ i x^i = (x Σ x^i - n x^n) / (1 - x),
//   Σ a^i b^(n-1-i) = (b^n - a^n) / (b - a),   Σ i a^i b^(n-1-i) = (a Σ a^i b^(n-1-i) - n a^n) / (b - a).
// The denominators come from the decays. If x^n or (a/b)^n is near 1, terms cancel, and a series about the middle is
// used. Products of a power of i and an exponential follow from summation by parts, and products of an echo (see
// gmwm/lag_pieces.hpp) from the same sums.
#include "gmwm/lag_sums.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include "gmwm/lag_pieces.hpp"

namespace gmwm {

namespace {

constexpr std::size_t moments = degree_most + 2;     // of the polynomial times n(u)
constexpr std::size_t power_sums = 2 * degree_most + 2;
constexpr double alike = 0.1;  // |ln x| n below which the closed form of Σ i x^i would lose more than 2 digits

using Polynomial = std::array<double, moments>;

// n(start + i) = at_start + step i.
struct Count {
  double at_start, step;
};

// Σ x^i and Σ i x^i, x = exp(-decay), for 0 <= i < n.
struct Geometric {
  Complex plain, risen;
};

// For |decay| n < `alike`.
Geometric near_one(Complex decay, double n) {
  const double square = n * n, m = n - 1;
  if (norm(decay) == 0) return {{n, 0}, {0.5 * n * m, 0}};
  const Complex plain = expm1(-(n * decay)) * inverse(expm1(-decay));
  const double s2 = n * (square - 1) / 12, s4 = s2 * (3 * square - 7) / 20;
  const double s6 = s2 * ((3 * square - 18) * square + 31) / 112;
  const Complex y = decay * decay;
  const Complex odd = decay * (Complex{s2, 0} + (1.0 / 6) * (y * (Complex{s4, 0} + (1.0 / 20) * (s6 * y))));
  return {plain, (0.5 * m) * plain - exp((-0.5 * m) * decay) * odd};
}

// Values of complex numbers, one after the other.
struct Numbers {
  std::vector<double> re, im;

  void resize(std::size_t n) { re.assign(n, 0.0), im.assign(n, 0.0); }
  void set(std::size_t k, Complex a) { re[k] = a.re, im[k] = a.im; }
  Complex at(std::size_t k) const { return {re[k], im[k]}; }
};

// The exponentials b of the right process, and after them the conjugates of those that are not real: the product of the
// real parts of two numbers is half the real part of their product and of that with the conjugate.
struct Columns {
  std::vector<std::size_t> of;  // index of the exponential
  std::vector<char> conjugate;
  Numbers ahead, behind, power;  // in a piece; power: b^n
};

// Constants of the products of one exponential a of the left process with the columns.
struct Row {
  Complex a;
  std::size_t plain = 0, conjugates = 0;  // first column of each kind
  Numbers x, over_one, over_apart;        // a b, 1 / (1 - a b), 1 / (b - a)
  Numbers sum, difference;                // λ of a b and of a / b
  std::vector<double> weight, size_of_sum, size_of_difference;
  std::vector<std::size_t> close;         // columns for which a series may be needed
};

struct Factors {
  Complex ahead, behind, power;
  double n, at_start, at_end, step;
};

// For the columns begin … end - 1: the sum over the lags of n(i) times the product, where no series is needed.
GMWM_CLONES void products(const Row& row, const Columns& columns, const Factors& f, std::size_t begin, std::size_t end,
                          double* out) {
  const double *er = columns.ahead.re.data(), *ei = columns.ahead.im.data(), *fr = columns.behind.re.data(),
               *fi = columns.behind.im.data(), *br = columns.power.re.data(), *bi = columns.power.im.data(),
               *xr = row.x.re.data(), *xi = row.x.im.data(), *pr = row.over_one.re.data(), *pi = row.over_one.im.data(),
               *qr = row.over_apart.re.data(), *qi = row.over_apart.im.data(), *weight = row.weight.data(),
               *sum_size = row.size_of_sum.data(), *difference_size = row.size_of_difference.data();
  for (std::size_t k = begin; k < end; ++k) {
    const Complex e{er[k], ei[k]}, b{fr[k], fi[k]}, bn{br[k], bi[k]};
    const Complex X = f.ahead * e, Y = f.behind * b, U = f.ahead * b, W = f.behind * e;
    const Complex xn = f.power * bn, p{pr[k], pi[k]}, q{qr[k], qi[k]};
    const Complex with = (Complex{1, 0} - xn) * p, with_risen = (Complex{xr[k], xi[k]} * with - f.n * xn) * p;
    const Complex against = (bn - f.power) * q, against_risen = (row.a * against - f.n * f.power) * q;
    const Complex one = with * (f.at_start * X + f.at_end * Y) + with_risen * (f.step * (X - Y));
    const Complex two = against * (f.at_start * U + f.at_end * W) + against_risen * (f.step * (U - W));
    const double first = sum_size[k] * f.n < alike ? 0.0 : one.re;
    const double second = difference_size[k] * f.n < alike ? 0.0 : two.re;
    out[k] = weight[k] * (first + second);
  }
}

// The same for one column where a series is needed. `turned` is b^(n-1).
double close_products(const Row& row, const Columns& columns, const Factors& f, std::size_t k, Complex turned) {
  const Complex e = columns.ahead.at(k), b = columns.behind.at(k);
  double total = 0;
  if (row.size_of_sum[k] * f.n < alike) {
    const Geometric with = near_one(row.sum.at(k), f.n);
    const Complex X = f.ahead * e, Y = f.behind * b;
    total += (with.plain * (f.at_start * X + f.at_end * Y) + with.risen * (f.step * (X - Y))).re;
  }
  if (row.size_of_difference[k] * f.n < alike) {
    const Geometric against = near_one(row.difference.at(k), f.n);
    const Complex U = f.ahead * b, W = f.behind * e;
    total += (turned * (against.plain * (f.at_start * U + f.at_end * W) + against.risen * (f.step * (U - W)))).re;
  }
  return row.weight[k] * total;
}

using Series = std::array<Complex, 2 * degree_most + 2>;

void sums_of_powers(std::int64_t n, std::size_t highest, double* out);

// Σ P(i / n) exp(-decay i) for 0 <= i < n, for a polynomial of this degree.
Complex swept(const Series& polynomial, std::size_t degree, Complex decay, std::int64_t count) {
  decay = wrapped(decay);
  const double n = static_cast<double>(count);
  Complex total{};
  if (n * size(decay) < slow) {
    std::array<double, 3 * degree_most + 3> sums;
    sums_of_powers(count, degree + degree_most + 1, sums.data());
    for (std::size_t r = 0; r <= degree; ++r) {
      Complex power{1, 0};
      for (std::size_t s = 0; s <= degree_most; power *= (-n / static_cast<double>(++s)) * decay)
        total += sums[r + s] * (polynomial[r] * power);
    }
    return total;
  }
  const Complex z = exp(-decay), zn = exp(-(n * decay)), over = inverse(expm1(-decay));
  std::array<Complex, 2 * degree_most + 2> moment;
  moment[0] = expm1(-(n * decay)) * over;
  total = polynomial[0] * moment[0];
  for (std::size_t r = 1; r <= degree; ++r) {
    Complex sum{};
    double factor = 1;
    for (std::size_t s = r; s-- > 0;) {
      factor *= static_cast<double>(s + 1) / (static_cast<double>(r - s) * n);
      sum += factor * moment[s];
    }
    moment[r] = (zn - z * sum) * over;
    total += polynomial[r] * moment[r];
  }
  return total;
}

class Sums {
 public:
  Sums(const LagProcess& left, const LagProcess& right, std::int64_t samples, bool same);

  void pair(std::int64_t fine, std::int64_t coarse, double* first, double* second);

 private:
  LagPieces& right_of() { return same_ ? left_ : right_; }
  double exponentials(const LagPiece& left, const LagPiece& right, Count count);
  double plain(const LagPiece& piece, Count count);
  double echoed(const LagPiece& echoes, const LagPiece& other, const LagPieces& of, Count count) const;
  double mixed(const LagPiece& polynomial, const LagPiece& exponential, LagPieces& of, Count count);
  std::pair<double, double> spikes(const LagPiece& left, const LagPiece& right, Count count);
  void at(const LagPiece& piece, LagPieces& of, std::int64_t first, std::int64_t lags, std::vector<double>& out);

  LagPieces left_, right_;
  std::int64_t samples_;
  bool same_;
  Columns columns_;
  std::vector<Row> rows_;
  LagPiece left_piece_, right_piece_;
  std::vector<double> left_values_, right_values_, products_;
};

Sums::Sums(const LagProcess& left, const LagProcess& right, std::int64_t samples, bool same)
    : left_(left), right_(right), samples_(samples), same_(same) {
  std::vector<std::size_t> conjugate_of(right_.size());
  for (std::size_t q = 0; q < right_.size(); ++q) columns_.of.push_back(q), columns_.conjugate.push_back(false);
  for (std::size_t q = 0; q < right_.size(); ++q) {
    conjugate_of[q] = columns_.of.size();
    if (!right_.real(q)) columns_.of.push_back(q), columns_.conjugate.push_back(true);
  }
  const std::size_t size = columns_.of.size();
  for (Numbers* numbers : {&columns_.ahead, &columns_.behind, &columns_.power}) numbers->resize(size);
  products_.resize(size);
  for (std::size_t p = 0; p < left_.size(); ++p) {
    Row row;
    const Complex decay = left_.decay(p);
    row.a = exp(-decay);
    row.plain = same ? p : 0;
    row.conjugates = left_.real(p) ? size : same ? conjugate_of[p] : right_.size();
    for (Numbers* numbers : {&row.x, &row.over_one, &row.over_apart, &row.sum, &row.difference}) numbers->resize(size);
    row.weight.resize(size), row.size_of_sum.resize(size), row.size_of_difference.resize(size);
    for (std::size_t k = 0; k < size; ++k) {
      const std::size_t q = columns_.of[k];
      const Complex other = columns_.conjugate[k] ? conj(right_.decay(q)) : right_.decay(q), b = exp(-other);
      const Complex sum = wrapped(decay + other), difference = wrapped(decay - other);
      row.weight[k] = (same && q > p ? 2.0 : 1.0) * (left_.real(p) || right_.real(q) ? 1.0 : 0.5);
      row.x.set(k, row.a * b), row.sum.set(k, sum), row.difference.set(k, difference);
      row.over_one.set(k, norm(sum) == 0 ? Complex{} : inverse(-expm1(-sum)));
      row.over_apart.set(k, norm(difference) == 0 ? Complex{} : inverse(row.a * expm1(difference)));
      row.size_of_sum[k] = gmwm::size(sum), row.size_of_difference[k] = gmwm::size(difference);
      if (std::min(row.size_of_sum[k], row.size_of_difference[k]) < alike) row.close.push_back(k);
    }
    rows_.push_back(std::move(row));
  }
}

// Σ n(i) of the products of exponentials.
double Sums::exponentials(const LagPiece& left, const LagPiece& right, Count count) {
  if (left.active.empty() || right.active.empty()) return 0;
  const double n = static_cast<double>(left.count), end = count.at_start + count.step * (n - 1);
  const Complex* power = right_of().power(right.count);
  const Complex* turned = right_of().power(right.count - 1);
  std::size_t l = 0;
  for (std::size_t k = 0; k < columns_.of.size(); ++k) {
    const std::size_t q = columns_.of[k];
    if (l == right.active.size() || right.active[l] > q) l = 0;
    while (l < right.active.size() && right.active[l] < q) ++l;
    const bool active = l < right.active.size() && right.active[l] == q, conjugate = columns_.conjugate[k];
    const auto turn = [=](Complex a) { return conjugate ? conj(a) : a; };
    columns_.ahead.set(k, active ? turn(right.ahead[l]) : Complex{});
    columns_.behind.set(k, active ? turn(right.behind[l]) : Complex{});
    columns_.power.set(k, active ? turn(power[q]) : Complex{});
  }
  power = left_.power(left.count);
  double total = 0;
  for (std::size_t k = 0; k < left.active.size(); ++k) {
    const std::size_t p = left.active[k];
    const Row& row = rows_[p];
    const Factors factors{left.ahead[k], left.behind[k], power[p], n, count.at_start, end, count.step};
    const std::size_t plain = right_of().size(), all = columns_.of.size();
    const std::size_t first = std::max(row.plain, right.active.front());
    products(row, columns_, factors, first, plain, products_.data());
    for (std::size_t c = first; c < plain; ++c) total += products_[c];
    products(row, columns_, factors, row.conjugates, all, products_.data());
    for (std::size_t c = row.conjugates; c < all; ++c) total += products_[c];
    for (const std::size_t c : row.close) {
      if (c < (c < plain ? row.plain : row.conjugates)) continue;
      if (std::min(row.size_of_sum[c], row.size_of_difference[c]) * n >= alike) continue;
      const Complex last = turned[columns_.of[c]];
      total += close_products(row, columns_, factors, c, columns_.conjugate[c] ? conj(last) : last);
    }
  }
  return total;
}

// n(i) times a polynomial, in powers of i / n.
Polynomial times_count(const LagPiece& piece, Count count) {
  Polynomial out{};
  const double slope = count.step * static_cast<double>(piece.count);
  for (std::size_t r = 0; r <= piece.degree; ++r) {
    out[r] += count.at_start * piece.polynomial[r];
    out[r + 1] += slope * piece.polynomial[r];
  }
  return out;
}

// Σ (i / n)^r for r < `highest`.
void sums_of_powers(std::int64_t n, std::size_t highest, double* out) {
  const double size = static_cast<double>(n);
  if (n <= 64) {
    std::fill(out, out + highest, 0.0);
    for (std::int64_t i = 0; i < n; ++i) {
      double power = 1;
      for (std::size_t r = 0; r < highest; ++r, power *= static_cast<double>(i) / size) out[r] += power;
    }
    return;
  }
  // Euler and Maclaurin: B_2l / (2l)!.
  constexpr std::array<double, 6> terms{1.0 / 12, -1.0 / 720, 1.0 / 30240, -1.0 / 1209600, 1.0 / 47900160,
                                        -691.0 / 1307674368000};
  for (std::size_t r = 0; r < highest; ++r) {
    double total = size / static_cast<double>(r + 1) - (r > 0 ? 0.5 : 0.0), factor = static_cast<double>(r) / size;
    for (std::size_t l = 0; l < terms.size() && factor != 0; ++l) {
      // At r = 2l - 1 the derivative is a constant, which is the same at both ends.
      const double order = static_cast<double>(r) - static_cast<double>(2 * l + 1);
      if (order <= 0) break;
      total += terms[l] * factor;
      factor *= order * (order - 1) / (size * size);
    }
    out[r] = total;
  }
}

// Σ n(i) of the product of the polynomials; first: Σ n(i) of the left one.
double polynomials(const LagPiece& left, const LagPiece& right, Count count, double* first) {
  const Polynomial weighted = times_count(left, count);
  std::array<double, power_sums + 1> both{}, sums;
  const std::size_t highest = left.degree + 1 + right.degree;
  for (std::size_t r = 0; r <= left.degree + 1; ++r)
    for (std::size_t s = 0; s <= right.degree; ++s) both[r + s] += weighted[r] * right.polynomial[s];
  sums_of_powers(left.count, highest + 1, sums.data());
  double total = 0;
  for (std::size_t r = 0; r <= highest; ++r) total += both[r] * sums[r];
  *first = 0;
  for (std::size_t r = 0; r <= left.degree + 1; ++r) *first += weighted[r] * sums[r];
  return total;
}

// Σ n(i) of the products of the polynomial of one process and the exponentials of the other.
double Sums::mixed(const LagPiece& polynomial, const LagPiece& exponential, LagPieces& of, Count count) {
  if (exponential.active.empty()) return 0;
  const Polynomial forward = times_count(polynomial, count);
  const std::size_t highest = polynomial.degree + 1;
  // The same in powers of (n - 1 - i) / n: forward at τ - t.
  Polynomial backward{};
  const double n = static_cast<double>(polynomial.count), turn = (n - 1) / n;
  for (std::size_t r = highest + 1; r-- > 0;) {
    for (std::size_t s = highest; s >= 1; --s) backward[s] = turn * backward[s] - backward[s - 1];
    backward[0] = turn * backward[0] + forward[r];
  }
  // M_r = Σ (i / n)^r z^i by summation by parts: (z - 1) M_r = z^n - z Σ_{s<r} C(r, s) n^(s-r) M_s.
  std::array<std::array<double, moments>, moments> factors;
  for (std::size_t r = 1; r <= highest; ++r) {
    double factor = 1;
    for (std::size_t s = r; s-- > 0; factors[r][s] = factor)
      factor *= static_cast<double>(s + 1) / (static_cast<double>(r - s) * n);
  }
  std::array<Complex, moments> moment;
  const Complex* power = of.power(exponential.count);
  double total = 0;
  for (std::size_t k = 0; k < exponential.active.size(); ++k) {
    const std::size_t p = exponential.active[k];
    const Complex zn = power[p], z = of.pole(p), over = of.over_apart(p);
    moment[0] = (zn - Complex{1, 0}) * over;
    Complex ahead = forward[0] * moment[0], behind = backward[0] * moment[0];
    for (std::size_t r = 1; r <= highest; ++r) {
      Complex sum{};
      for (std::size_t s = 0; s < r; ++s) sum += factors[r][s] * moment[s];
      moment[r] = (zn - z * sum) * over;
      ahead += forward[r] * moment[r], behind += backward[r] * moment[r];
    }
    total += (exponential.ahead[k] * ahead + exponential.behind[k] * behind).re;
  }
  return total;
}

// A series times n(i).
Series counted(const Echo& echo, Count count, double n) {
  Series out{};
  for (std::size_t r = 0; r <= degree_most; ++r) {
    out[r] += count.at_start * echo.series[r];
    out[r + 1] += (n * count.step) * echo.series[r];
  }
  return out;
}

// Σ n(i) of the products of the echoes of one process with the polynomial and the exponentials of the other.
double Sums::echoed(const LagPiece& echoes, const LagPiece& other, const LagPieces& of, Count count) const {
  const std::int64_t points = other.count;
  const double n = static_cast<double>(points), m = n - 1, turn = m / n;
  constexpr std::size_t highest = degree_most + 1;
  double total = 0;
  for (const Echo& echo : echoes.echoes) {
    const Series one = counted(echo, count, n);
    const Complex angle{0, echo.angle};
    Series both{}, backward{};
    for (std::size_t r = 0; r <= highest; ++r)
      for (std::size_t s = 0; s <= std::min(other.degree, degree_most); ++s) both[r + s] += other.polynomial[s] * one[r];
    total += swept(both, highest + other.degree, angle, points).re;
    if (other.active.empty()) continue;
    for (std::size_t r = highest + 1; r-- > 0;) {
      for (std::size_t s = highest; s >= 1; --s) backward[s] = turn * backward[s] - backward[s - 1];
      backward[0] = turn * backward[0] + one[r];
    }
    const Complex end = exp(-(m * angle));
    for (std::size_t k = 0; k < other.active.size(); ++k)
      for (const bool conjugate : {false, true}) {
        const Complex decay = conjugate ? conj(of.decay(other.active[k])) : of.decay(other.active[k]);
        const Complex E = conjugate ? conj(other.ahead[k]) : other.ahead[k];
        const Complex F = conjugate ? conj(other.behind[k]) : other.behind[k];
        const Complex sum = E * swept(one, highest, decay + angle, points) +
                            F * end * swept(backward, highest, decay - angle, points);
        total += 0.5 * sum.re;
      }
  }
  return total;
}

// Σ n(i) of the products of echoes.
double of_echoes(const LagPiece& left, const LagPiece& right, Count count) {
  const double n = static_cast<double>(left.count);
  constexpr std::size_t highest = degree_most + 1;
  double total = 0;
  for (const Echo& a : left.echoes)
    for (const Echo& b : right.echoes) {
      const Series one = counted(a, count, n);
      Series both{}, conjugate{};
      for (std::size_t r = 0; r <= highest; ++r)
        for (std::size_t s = 0; s <= degree_most; ++s) {
          both[r + s] += one[r] * b.series[s];
          conjugate[r + s] += one[r] * conj(b.series[s]);
        }
      const Complex sum = swept(both, highest + degree_most, {0, a.angle + b.angle}, left.count) +
                          swept(conjugate, highest + degree_most, {0, a.angle - b.angle}, left.count);
      total += 0.5 * sum.re;
    }
  return total;
}

// Σ n(i) of the exponentials and the echoes.
double Sums::plain(const LagPiece& piece, Count count) {
  const double n = static_cast<double>(piece.count), end = count.at_start + count.step * (n - 1);
  const Complex* power = left_.power(piece.count);
  double total = 0;
  for (std::size_t k = 0; k < piece.active.size(); ++k) {
    const std::size_t p = piece.active[k];
    const Complex zn = power[p], z = left_.pole(p), over = left_.over_apart(p);
    const Complex all = (zn - Complex{1, 0}) * over, risen = (n * zn - z * all) * over;
    total += (all * (count.at_start * piece.ahead[k] + end * piece.behind[k]) +
              risen * (count.step * (piece.ahead[k] - piece.behind[k])))
                 .re;
  }
  for (const Echo& echo : piece.echoes)
    total += swept(counted(echo, count, n), degree_most + 1, {0, echo.angle}, piece.count).re;
  return total;
}

// The values C(start + first + i), 0 <= i < lags, without spikes.
void Sums::at(const LagPiece& piece, LagPieces& of, std::int64_t first, std::int64_t lags, std::vector<double>& out) {
  const double n = static_cast<double>(piece.count);
  out.assign(static_cast<std::size_t>(lags), 0.0);
  for (std::int64_t i = 0; i < lags; ++i) {
    const double t = static_cast<double>(first + i) / n;
    double value = 0;
    for (std::size_t r = piece.degree + 1; r-- > 0;) value = value * t + piece.polynomial[r];
    for (const Echo& echo : piece.echoes) {
      Complex sum{};
      for (std::size_t r = degree_most + 1; r-- > 0;) sum = t * sum + echo.series[r];
      value += (sum * exp({0, -std::remainder(echo.angle * static_cast<double>(first + i), 2 * std::numbers::pi)})).re;
    }
    out[static_cast<std::size_t>(i)] = value;
  }
  const Complex *start = of.power(first), *end = of.power(piece.count - first - lags);
  for (std::size_t k = 0; k < piece.active.size(); ++k) {
    const std::size_t p = piece.active[k];
    const Complex z = of.pole(p);
    Complex ahead = piece.ahead[k] * start[p], behind = piece.behind[k] * end[p];
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] += ahead.re, out[out.size() - 1 - i] += behind.re;
      ahead *= z, behind *= z;
    }
  }
}

// What the spikes of both processes add near the two kinks, to the sum of the left covariance and to that of products.
std::pair<double, double> Sums::spikes(const LagPiece& left, const LagPiece& right, Count count) {
  const std::int64_t reach = static_cast<std::int64_t>(std::max(left_.spikes(), right_.spikes()));
  if (reach == 0) return {0, 0};
  double sum = 0, total = 0;
  const auto add = [&](std::int64_t first, std::int64_t lags) {
    at(left, left_, first, lags, left_values_);
    if (!same_) at(right, right_, first, lags, right_values_);
    const std::vector<double>& others = same_ ? left_values_ : right_values_;
    for (std::int64_t i = 0; i < lags; ++i) {
      const std::int64_t v = left.start + first + i;
      const std::size_t place = static_cast<std::size_t>(i);
      const double one = left_.spike(v), two = same_ ? one : right_.spike(v);
      const double n = count.at_start + count.step * static_cast<double>(first + i);
      sum += n * one;
      total += n * (left_values_[place] * two + one * others[place] + one * two);
    }
  };
  const std::int64_t points = left.count;
  if (points <= 2 * reach) {
    add(0, points);
  } else {
    add(0, reach);
    add(points - reach, reach);
  }
  return {sum, total};
}

void Sums::pair(std::int64_t h, std::int64_t g, double* first, double* second) {
  left_.pair(h, g);
  if (!same_) right_.pair(h, g);
  const std::int64_t end = samples_ - h - g + 1;
  std::array<std::int64_t, 6> kinks{0, h, g - h, g, g + h, end};
  std::sort(kinks.begin(), kinks.end() - 1);
  double sum = 0, product = 0;
  for (std::size_t k = 0; k + 1 < kinks.size(); ++k) {
    const std::int64_t start = kinks[k], stop = std::min(kinks[k + 1], end);
    if (start >= stop) continue;
    left_.piece(start, stop - start, left_piece_);
    if (!same_) right_.piece(start, stop - start, right_piece_);
    const LagPiece &left = left_piece_, &right = same_ ? left_piece_ : right_piece_;
    const double all = static_cast<double>(samples_ - 2 * g + 1);
    const Count count = start < g - h ? Count{all, 0} : Count{static_cast<double>(end - start), -1};
    double straight = 0;
    double part = polynomials(left, right, count, &straight) + exponentials(left, right, count);
    sum += 2 * (straight + plain(left, count));
    part += of_echoes(left, right, count);
    if (same_) {
      part += 2 * (mixed(left, left, left_, count) + echoed(left, left, left_, count));
    } else {
      part += echoed(left, right, right_, count) + echoed(right, left, left_, count);
      part += mixed(left, right, right_, count) + mixed(right, left, left_, count);
    }
    const auto [spiked, product_of_spikes] = spikes(left, right, count);
    sum += 2 * spiked;
    product += 2 * (part + product_of_spikes);
    if (start == 0) {
      // The lag at the centre of symmetry occurs once.
      at(left, left_, 0, 1, left_values_);
      const double one = left_values_[0] + left_.spike(0);
      double two = one;
      if (!same_) at(right, right_, 0, 1, right_values_), two = right_values_[0] + right_.spike(0);
      sum -= count.at_start * one;
      product -= count.at_start * one * two;
    }
  }
  *first = sum;
  *second = product;
}

}  // namespace

void lag_sums(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& left,
              const LagProcess& right, const LagSums& out) {
  Sums sums(left, right, samples, &left == &right);
  std::size_t place = 0;
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (std::size_t j = diagonal ? k : 0; j <= k; ++j, ++place)
      sums.pair(std::int64_t{1} << (levels[j] - 1), std::int64_t{1} << (levels[k] - 1), &out.first[place],
                &out.second[place]);
}

}  // namespace gmwm
