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

#include "gmwm/lag_series.hpp"
#include "gmwm/lag_table.hpp"

namespace gmwm {

namespace {

constexpr std::size_t moments = degree_most + 2;     // of the polynomial times n(u)
constexpr std::size_t power_sums = 2 * degree_most + 2;

using Polynomial = std::array<double, moments>;

constexpr std::size_t lanes = 8;  // columns are added in groups that fill the widest vectors

// Values of complex numbers, one after the other.
struct Numbers {
  std::vector<double> re, im;

  void resize(std::size_t n) { re.assign(n, 0.0), im.assign(n, 0.0); }
  void set(std::size_t k, Complex a) { re[k] = a.re, im[k] = a.im; }
  Complex at(std::size_t k) const { return {re[k], im[k]}; }
};

// The exponentials b, and after them the conjugates of those that are not real: the product of the
// real parts of two numbers is half the real part of their product and of that with the conjugate. Zeros fill the last
// group of columns.
struct Columns {
  std::vector<std::size_t> of;  // index of the exponential
  std::vector<char> conjugate;
  Numbers ahead, behind, power;  // in a piece; power: b^n
};

// Constants of the products of one exponential a with the columns.
struct Row {
  Complex a;
  Numbers x, over_one, over_apart;        // a b, 1 / (1 - a b), 1 / (b - a)
  Numbers sum, difference;                // λ of a b and of a / b
  std::vector<double> weight, size_of_sum, size_of_difference;  // weight: 0 for a pair that belongs to another row
  std::vector<std::size_t> close;         // columns for which a series may be needed
};

struct Factors {
  Complex ahead, behind, power;
  double n, at_start, at_end, step;
};

// Adds for the columns from `begin` on the sum over the lags of n(i) times the product, where no series is needed.
GMWM_INLINE void products_inline(const Row& row, const Columns& columns, const Factors& f, std::size_t begin,
                                 double* __restrict out) {
  const double *er = columns.ahead.re.data(), *ei = columns.ahead.im.data(), *fr = columns.behind.re.data(),
               *fi = columns.behind.im.data(), *br = columns.power.re.data(), *bi = columns.power.im.data(),
               *xr = row.x.re.data(), *xi = row.x.im.data(), *pr = row.over_one.re.data(), *pi = row.over_one.im.data(),
               *qr = row.over_apart.re.data(), *qi = row.over_apart.im.data(), *weight = row.weight.data(),
               *sum_size = row.size_of_sum.data(), *difference_size = row.size_of_difference.data();
  const std::size_t end = row.weight.size() / lanes * lanes;
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
    out[k] += weight[k] * (first + second);
  }
}
constexpr Clones<products_inline> products{};

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

class Sums {
 public:
  Sums(const LagProcess& process, std::int64_t samples, std::span<const TableFactor> tables);

  // Adds the sums of C and of C² + 2 C D, where D is the sum of the tables. `place` is the piece of the tables that follows.
  void pair(std::int64_t fine, std::int64_t coarse, std::size_t& place, double* first, double* second);

 private:
  double exponentials(const LagPiece& piece, LagCount count);
  Falling::Values summed(const LagPiece& piece, const Falling& falling);
  double echoed(const LagPiece& piece, LagCount count) const;
  std::pair<double, double> spikes(const LagPiece& piece, LagCount count);
  double with_table(const LagPiece& piece, std::size_t place, std::size_t table, const Falling::Values& sums);
  void at(const LagPiece& piece, std::int64_t first, std::int64_t lags, std::vector<double>& out);
  // Calls a function with the lags at both ends of a piece that the spikes reach.
  template <class Function>
  void for_ends(std::int64_t points, Function add) const {
    const std::int64_t reach = static_cast<std::int64_t>(process_.spikes());
    if (points <= 2 * reach) return add(0, points);
    add(0, reach);
    add(points - reach, reach);
  }

  LagPieces process_;
  std::int64_t samples_;
  std::span<const TableFactor> tables_;
  std::vector<TableProducts> with_tables_;
  std::vector<LagTable::Values> ends_;  // of the tables, where the spikes reach
  Columns columns_;
  std::vector<Row> rows_;
  LagPiece piece_;
  std::vector<double> values_, products_;
};

Sums::Sums(const LagProcess& process, std::int64_t samples, std::span<const TableFactor> tables)
    : process_(process), samples_(samples), tables_(tables) {
  for (const TableFactor& entry : tables) {
    with_tables_.emplace_back(process_, *entry.table);
    ends_.push_back(process_.spikes() > 0 ? entry.table->ends(static_cast<std::int64_t>(process_.spikes())) : nullptr);
  }
  for (const bool conjugate : {false, true})
    for (std::size_t q = 0; q < process_.size(); ++q)
      if (!conjugate || !process_.real(q)) columns_.of.push_back(q), columns_.conjugate.push_back(conjugate);
  const std::size_t size = (columns_.of.size() + lanes - 1) / lanes * lanes;
  for (Numbers* numbers : {&columns_.ahead, &columns_.behind, &columns_.power}) numbers->resize(size);
  products_.resize(size);
  for (std::size_t p = 0; p < process_.size(); ++p) {
    Row row;
    const Complex decay = process_.decay(p);
    row.a = exp(-decay);
    for (Numbers* numbers : {&row.x, &row.over_one, &row.over_apart, &row.sum, &row.difference}) numbers->resize(size);
    row.weight.resize(size), row.size_of_sum.resize(size), row.size_of_difference.resize(size);
    for (std::size_t k = 0; k < columns_.of.size(); ++k) {
      const std::size_t q = columns_.of[k];
      if (q < p || (columns_.conjugate[k] && process_.real(p))) continue;
      const Complex other = columns_.conjugate[k] ? conj(process_.decay(q)) : process_.decay(q), b = exp(-other);
      const Complex sum = wrapped(decay + other), difference = wrapped(decay - other);
      row.weight[k] = (q > p ? 2.0 : 1.0) * (process_.real(p) || process_.real(q) ? 1.0 : 0.5);
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
double Sums::exponentials(const LagPiece& piece, LagCount count) {
  if (piece.active.empty()) return 0;
  const double n = static_cast<double>(piece.count), end = count.at_start + count.step * (n - 1);
  const Complex *power = process_.power(piece.count), *turned = process_.power(piece.count - 1);
  std::size_t l = 0;
  for (std::size_t k = 0; k < columns_.of.size(); ++k) {
    const std::size_t q = columns_.of[k];
    if (l == piece.active.size() || piece.active[l] > q) l = 0;
    while (l < piece.active.size() && piece.active[l] < q) ++l;
    const bool active = l < piece.active.size() && piece.active[l] == q, conjugate = columns_.conjugate[k];
    const auto turn = [=](Complex a) { return conjugate ? conj(a) : a; };
    columns_.ahead.set(k, active ? turn(piece.ahead[l]) : Complex{});
    columns_.behind.set(k, active ? turn(piece.behind[l]) : Complex{});
    columns_.power.set(k, active ? turn(power[q]) : Complex{});
  }
  double total = 0;
  std::fill(products_.begin(), products_.end(), 0.0);
  for (std::size_t k = 0; k < piece.active.size(); ++k) {
    const std::size_t p = piece.active[k];
    const Row& row = rows_[p];
    const Factors factors{piece.ahead[k], piece.behind[k], power[p], n, count.at_start, end, count.step};
    products(row, columns_, factors, p / lanes * lanes, products_.data());
    for (const std::size_t c : row.close) {
      if (std::min(row.size_of_sum[c], row.size_of_difference[c]) * n >= alike) continue;
      const Complex last = turned[columns_.of[c]];
      total += close_products(row, columns_, factors, c, columns_.conjugate[c] ? conj(last) : last);
    }
  }
  for (const double product : products_) total += product;
  return total;
}

// n(i) times a polynomial, in powers of i / n.
Polynomial times_count(const LagPiece& piece, LagCount count) {
  Polynomial out{};
  const double slope = count.step * static_cast<double>(piece.count);
  for (std::size_t r = 0; r <= piece.degree; ++r) {
    out[r] += count.at_start * piece.polynomial[r];
    out[r + 1] += slope * piece.polynomial[r];
  }
  return out;
}

// Σ n(i) of the square of the polynomial; first: Σ n(i) of the polynomial.
double polynomials(const LagPiece& piece, LagCount count, double* first) {
  const std::size_t degree = piece.degree;
  std::array<double, power_sums> sums;
  sums_of_powers(piece.count, 2 * degree + 2, sums.data());
  const double slope = count.step * static_cast<double>(piece.count);
  for (std::size_t r = 0; r <= 2 * degree; ++r) sums[r] = count.at_start * sums[r] + slope * sums[r + 1];
  double total = 0;
  *first = 0;
  for (std::size_t r = 0; r <= degree; ++r) {
    double others = 0;
    for (std::size_t s = r + 1; s <= degree; ++s) others += piece.polynomial[s] * sums[r + s];
    total += piece.polynomial[r] * (piece.polynomial[r] * sums[2 * r] + 2 * others);
    *first += piece.polynomial[r] * sums[r];
  }
  return total;
}

// The sums of the functions of `falling` and the exponentials.
Falling::Values Sums::summed(const LagPiece& piece, const Falling& falling) {
  const std::size_t highest = tables_.empty() ? piece.degree + 1 : Falling::size - 1;
  const Complex* power = process_.power(piece.count);
  Falling::Values sums{};
  for (std::size_t k = 0; k < piece.active.size(); ++k) {
    const std::size_t p = piece.active[k];
    falling.add(process_.pole(p), power[p], process_.over_apart(p), piece.ahead[k], piece.behind[k], highest, sums);
  }
  return sums;
}

// Σ n(i) of the products of the polynomial and the exponentials.
double mixed(const LagPiece& piece, LagCount count, const Falling& falling, const Falling::Values& sums) {
  if (piece.active.empty()) return 0;
  const Polynomial weighted = times_count(piece, count);
  const Falling::Values powers = falling.powers(sums, piece.degree + 1);
  double total = 0;
  for (std::size_t r = 0; r <= piece.degree + 1; ++r) total += weighted[r] * powers[r];
  return total;
}

// Σ n(i) of the products of the echoes with the polynomial and the exponentials.
double Sums::echoed(const LagPiece& piece, LagCount count) const {
  const std::int64_t points = piece.count;
  const double n = static_cast<double>(points);
  constexpr std::size_t highest = degree_most + 1;
  double total = 0;
  for (const Echo& echo : piece.echoes) {
    const Series forward = counted(echo, count, n);
    const Complex angle{0, echo.angle};
    Series both{};
    for (std::size_t r = 0; r <= highest; ++r)
      for (std::size_t s = 0; s <= std::min(piece.degree, degree_most); ++s) both[r + s] += piece.polynomial[s] * forward[r];
    total += swept(both, highest + piece.degree, angle, points).re;
    if (piece.active.empty()) continue;
    const Series backward = turned(forward, highest, n);
    const Complex end = exp(-((n - 1) * angle));
    for (std::size_t k = 0; k < piece.active.size(); ++k)
      for (const bool conjugate : {false, true}) {
        const auto turn = [=](Complex a) { return conjugate ? conj(a) : a; };
        const Complex decay = turn(process_.decay(piece.active[k]));
        const Complex sum = turn(piece.ahead[k]) * swept(forward, highest, decay + angle, points) +
                            turn(piece.behind[k]) * end * swept(backward, highest, decay - angle, points);
        total += 0.5 * sum.re;
      }
  }
  return total;
}

// Σ n(i) of the products of echoes.
double of_echoes(const LagPiece& piece, LagCount count) {
  const double n = static_cast<double>(piece.count);
  constexpr std::size_t highest = degree_most + 1;
  double total = 0;
  for (const Echo& a : piece.echoes)
    for (const Echo& b : piece.echoes) {
      const Series one = counted(a, count, n);
      Series both{}, conjugate{};
      for (std::size_t r = 0; r <= highest; ++r)
        for (std::size_t s = 0; s <= degree_most; ++s) {
          both[r + s] += one[r] * b.series[s];
          conjugate[r + s] += one[r] * conj(b.series[s]);
        }
      const Complex sum = swept(both, highest + degree_most, {0, a.angle + b.angle}, piece.count) +
                          swept(conjugate, highest + degree_most, {0, a.angle - b.angle}, piece.count);
      total += 0.5 * sum.re;
    }
  return total;
}

// Σ n(i) of the exponentials and the echoes.
double plain(const LagPiece& piece, LagCount count, const Falling::Values& sums) {
  const double n = static_cast<double>(piece.count);
  double total = count.at_start * sums[0] + count.step * n * sums[1];
  for (const Echo& echo : piece.echoes)
    total += swept(counted(echo, count, n), degree_most + 1, {0, echo.angle}, piece.count).re;
  return total;
}

// The values C(start + first + i), 0 <= i < lags, without spikes.
void Sums::at(const LagPiece& piece, std::int64_t first, std::int64_t lags, std::vector<double>& out) {
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
  const Complex *start = process_.power(first), *end = process_.power(piece.count - first - lags);
  for (std::size_t k = 0; k < piece.active.size(); ++k) {
    const std::size_t p = piece.active[k];
    const Complex z = process_.pole(p);
    Complex ahead = piece.ahead[k] * start[p], behind = piece.behind[k] * end[p];
    for (std::size_t i = 0; i < out.size(); ++i) {
      out[i] += ahead.re, out[out.size() - 1 - i] += behind.re;
      ahead *= z, behind *= z;
    }
  }
}

// What the spikes add near the two kinks, to the sum of the covariance and to that of its square.
std::pair<double, double> Sums::spikes(const LagPiece& piece, LagCount count) {
  double sum = 0, total = 0;
  for_ends(piece.count, [&](std::int64_t first, std::int64_t lags) {
    at(piece, first, lags, values_);
    for (std::int64_t i = 0; i < lags; ++i) {
      const double spike = process_.spike(piece.start + first + i);
      const double n = count.at_start + count.step * static_cast<double>(first + i);
      sum += n * spike;
      total += n * spike * (2 * values_[static_cast<std::size_t>(i)] + spike);
    }
  });
  return {sum, total};
}

// Σ n(i) of the products with a table.
double Sums::with_table(const LagPiece& piece, std::size_t place, std::size_t table, const Falling::Values& sums) {
  const TablePiece& other = tables_[table].table->piece(place);
  const bool spiked = process_.spikes() > 0;
  double total = 0;
  if (!other.values.empty()) {
    at(piece, 0, piece.count, values_);
    for (std::int64_t i = 0; i < piece.count; ++i)
      total += other.values[static_cast<std::size_t>(i)] *
               (values_[static_cast<std::size_t>(i)] + (spiked ? process_.spike(piece.start + i) : 0.0));
    return total;
  }
  total = with_tables_[table].sum(piece, other, process_.power(piece.count), sums);
  if (!piece.echoes.empty()) total += with_tables_[table].echo(piece, other);
  if (!spiked) return total;
  const double* value = ends_[table]->data() + 2 * process_.spikes() * place;
  for_ends(piece.count, [&](std::int64_t first, std::int64_t lags) {
    for (std::int64_t i = 0; i < lags; ++i)
      total += (other.pairs.at_start + other.pairs.step * static_cast<double>(first + i)) * *value++ *
               process_.spike(piece.start + first + i);
  });
  return total;
}

void Sums::pair(std::int64_t h, std::int64_t g, std::size_t& place, double* first, double* second) {
  process_.pair(h, g);
  double sum = 0, product = 0;
  for (const LagInterval& interval : intervals(h, g, samples_)) {
    if (interval.count <= 0) continue;
    process_.piece(interval.start, interval.count, piece_);
    const LagCount count = interval.pairs;
    const Falling falling(static_cast<double>(piece_.count));
    const Falling::Values sums = summed(piece_, falling);
    double straight = 0, centre = 0;
    double part = polynomials(piece_, count, &straight) + exponentials(piece_, count) + of_echoes(piece_, count) +
                  2 * (mixed(piece_, count, falling, sums) + echoed(piece_, count));
    sum += 2 * (straight + plain(piece_, count, sums));
    if (process_.spikes() > 0) {
      const auto [spiked, product_of_spikes] = spikes(piece_, count);
      sum += 2 * spiked;
      part += product_of_spikes;
    }
    product += 2 * part;
    if (interval.start == 0) {
      // The lag at the centre of symmetry occurs once.
      at(piece_, 0, 1, values_);
      centre = values_[0] + process_.spike(0);
      sum -= count.at_start * centre;
      product -= count.at_start * centre * centre;
    }
    for (std::size_t k = 0; k < tables_.size(); ++k) {
      const double table_centre = tables_[k].table->piece(place).centre;
      product += 2 * tables_[k].factor * (2 * with_table(piece_, place, k, sums) - centre * table_centre);
    }
    ++place;
  }
  *first = sum;
  *second = product;
}

}  // namespace

void lag_sums(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& process,
              std::span<const TableFactor> tables, const LagSums& out) {
  Sums sums(process, samples, tables);
  std::size_t place = 0, piece = 0;
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (std::size_t j = diagonal ? k : 0; j <= k; ++j, ++place)
      sums.pair(std::int64_t{1} << (levels[j] - 1), std::int64_t{1} << (levels[k] - 1), piece, &out.first[place],
                &out.second[place]);
}

}  // namespace gmwm
