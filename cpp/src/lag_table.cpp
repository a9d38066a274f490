// With A, B the factors of an exponential a of the process, E, F those of an exponential b of the table, and n(i) = s + d i,
// the sum over a piece is linear in E, F, E b^n and F b^n. The factors are sums over the columns of these four times the
// four constants p, a b p², q and a q² of a row, where p = 1 / (1 - a b) and q = 1 / (b - a).
#include "gmwm/lag_table.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "gmwm/pack.hpp"

namespace gmwm {

namespace {

constexpr std::int64_t few = 16;  // lags up to which their values are stored instead of sums
constexpr std::size_t few_ends = 8;      // numbers of lags for which the values at the ends of pieces are kept
constexpr std::size_t moments = Falling::size;
constexpr double near = 0.2;      // |λ_a - λ_b| relative to λ_b, below which a sum may need a series (alike / slow)

void fill(TablePiece& piece, LagPieces& process) {
  const LagPiece& from = piece.covariance;
  const std::size_t size = process.size();
  const double n = static_cast<double>(piece.count), s = piece.pairs.at_start, d = n * piece.pairs.step;
  piece.first = from.active.empty() ? size : from.active.front();
  piece.columns.assign(4 * (size - piece.first), 0.0);
  const Complex* power = process.power(piece.count);
  for (std::size_t k = 0; k < from.active.size(); ++k) {
    const double E = from.ahead[k].re, F = from.behind[k].re, bn = power[from.active[k]].re;
    double* column = &piece.columns[4 * (from.active[k] - piece.first)];
    column[0] = E, column[1] = F, column[2] = E * bn, column[3] = F * bn;
  }
  const Falling falling(n);
  Falling::Values exponentials{};
  for (std::size_t k = 0; k < from.active.size(); ++k) {
    const std::size_t p = from.active[k];
    falling.add(process.pole(p).re, power[p].re, process.over_apart(p).re, from.ahead[k].re, from.behind[k].re, moments - 1,
                exponentials);
  }
  exponentials = falling.powers(exponentials, moments - 1);
  Falling::Values weighted{};
  for (std::size_t r = 0; r <= from.degree; ++r) {
    weighted[r] += s * from.polynomial[r];
    weighted[r + 1] += d * from.polynomial[r];
  }
  std::array<double, 2 * moments> sums;
  sums_of_powers(piece.count, degree_most + moments, sums.data());
  for (std::size_t r = 0; r <= degree_most; ++r) {
    piece.moments[r] = s * exponentials[r] + d * exponentials[r + 1];
    for (std::size_t k = 0; k < moments; ++k) piece.moments[r] += weighted[k] * sums[r + k];
  }
  piece.weights = falling.of(weighted);
}

// For each of the four factors of the columns, its products with the eight parts of the constants.
using Products = std::array<double, 32>;

GMWM_INLINE void multiply_inline(const double* columns, const double* constants, std::size_t count, double* out) {
  Pack sums[8];
  for (std::size_t l = 0; l < 8; ++l) sums[l] = Pack::load(out + 4 * l);
  for (std::size_t k = 0; k < count; ++k, columns += 4, constants += 8) {
    const Pack low = Pack::load(constants), high = Pack::load(constants + 4);
    for (std::size_t l = 0; l < 4; ++l) {
      const Pack factor = Pack::of(columns[l]);
      sums[2 * l] = sums[2 * l] + factor * low;
      sums[2 * l + 1] = sums[2 * l + 1] + factor * high;
    }
  }
  for (std::size_t l = 0; l < 8; ++l) sums[l].store(out + 4 * l);
}
constexpr Clones<multiply_inline> multiply{};

// The values D(first + i), 0 <= i < lags, at the start or at the end of a piece.
void table_values(const TablePiece& piece, std::span<const double> decays, std::int64_t first, std::int64_t lags,
                  std::vector<double>& out) {
  const LagPiece& from = piece.covariance;
  const double n = static_cast<double>(piece.count);
  out.assign(static_cast<std::size_t>(lags), 0.0);
  for (std::int64_t i = 0; i < lags; ++i) {
    const double t = static_cast<double>(first + i) / n;
    double value = 0;
    for (std::size_t r = from.degree + 1; r-- > 0;) value = value * t + from.polynomial[r];
    out[static_cast<std::size_t>(i)] = value;
  }
  const double before = static_cast<double>(first), after = static_cast<double>(piece.count - first - lags);
  for (std::size_t k = 0; k < from.active.size(); ++k) {
    const double decay = decays[from.active[k]], z = std::exp(-decay);
    double ahead = from.ahead[k].re * std::exp(-decay * before), behind = from.behind[k].re * std::exp(-decay * after);
    for (std::size_t i = 0; i < out.size(); ++i, ahead *= z, behind *= z) out[i] += ahead, out[out.size() - 1 - i] += behind;
  }
}

}  // namespace

LagTable::LagTable(std::span<const std::int64_t> levels, std::int64_t samples, bool diagonal, const LagProcess& process)
    : levels_(levels.begin(), levels.end()),
      samples_(samples),
      diagonal_(diagonal),
      decays_(process.decay_re.begin(), process.decay_re.end()) {
  LagPieces pieces(process);
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (std::size_t j = diagonal ? k : 0; j <= k; ++j) {
      const std::int64_t h = std::int64_t{1} << (levels[j] - 1), g = std::int64_t{1} << (levels[k] - 1);
      pieces.pair(h, g);
      for (const LagInterval& interval : intervals(h, g, samples)) {
        if (interval.count <= 0) continue;
        TablePiece& piece = pieces_.emplace_back();
        piece.start = interval.start, piece.count = interval.count, piece.pairs = interval.pairs;
        pieces.piece(interval.start, interval.count, piece.covariance);
        fill(piece, pieces);
        std::vector<double> values;
        if (piece.count <= few || piece.start == 0) table_values(piece, decays_, 0, std::min(piece.count, few), values);
        if (piece.start == 0) piece.centre = piece.pairs.at_start * values[0];
        if (piece.count > few) continue;
        for (std::int64_t i = 0; i < piece.count; ++i)
          values[static_cast<std::size_t>(i)] *= piece.pairs.at_start + piece.pairs.step * static_cast<double>(i);
        piece.values = std::move(values);
      }
    }
}

LagTable::Values LagTable::ends(std::int64_t lags) const {
  const std::lock_guard lock(turn_);
  if (const auto found = ends_.find(lags); found != ends_.end()) return found->second;
  const std::size_t width = 2 * static_cast<std::size_t>(lags);
  std::vector<double> all(width * pieces_.size()), values;
  for (std::size_t k = 0; k < pieces_.size(); ++k) {
    const TablePiece& piece = pieces_[k];
    if (!piece.values.empty()) continue;
    const bool whole = piece.count <= 2 * lags;
    table_values(piece, decays_, 0, whole ? piece.count : lags, values);
    const auto out = std::copy(values.begin(), values.end(), all.begin() + static_cast<std::ptrdiff_t>(k * width));
    if (whole) continue;
    table_values(piece, decays_, piece.count - lags, lags, values);
    std::copy(values.begin(), values.end(), out);
  }
  if (ends_.size() == few_ends) ends_.clear();
  return ends_[lags] = std::make_shared<const std::vector<double>>(std::move(all));
}

TableProducts::TableProducts(const LagPieces& process, const LagTable& table) : table_(table) {
  const std::span<const double> decays = table.decays();
  for (std::size_t p = 0; p < process.size(); ++p) {
    Row row{process.decay(p), process.pole(p), std::vector<double>(8 * decays.size()), {}};
    for (std::size_t q = 0; q < decays.size(); ++q) {
      const Complex sum = wrapped(row.decay + Complex{decays[q], 0}), difference = wrapped(row.decay - Complex{decays[q], 0});
      const Complex one = inverse(-expm1(-sum));
      const Complex other = norm(difference) == 0 ? Complex{} : inverse(row.pole * expm1(difference));
      const std::array<Complex, 4> each{one, exp(-sum) * one * one, other, row.pole * other * other};
      for (std::size_t l = 0; l < 4; ++l) row.constants[8 * q + 2 * l] = each[l].re, row.constants[8 * q + 2 * l + 1] = each[l].im;
      if (size(difference) < near * decays[q]) row.close.push_back({q, difference, size(difference)});
    }
    rows_.push_back(std::move(row));
  }
}

// Σ n(i) of Re(A a^i + B a^(n - 1 - i)) times the exponentials of the table; end: a^n.
double TableProducts::exponential(const Row& row, Complex A, Complex B, Complex end, const TablePiece& piece) const {
  const std::span<const double> decays = table_.decays();
  const double n = static_cast<double>(piece.count), s = piece.pairs.at_start, d = piece.pairs.step;
  const double last = s + d * (n - 1);
  Products out{};
  std::size_t from = piece.first;
  double total = 0;
  for (const auto& [q, difference, distance] : row.close) {
    if (q < piece.first || n * distance >= alike) continue;
    multiply(&piece.columns[4 * (from - piece.first)], &row.constants[8 * from], q - from, out.data());
    from = q + 1;
    const double *column = &piece.columns[4 * (q - piece.first)], E = column[0], F = column[1];
    const double* constants = &row.constants[8 * q];
    const Complex p{constants[0], constants[1]}, rising{constants[2], constants[3]};
    const double bn = std::exp(-n * decays[q]);
    const Complex xn = bn * end, plain = p - xn * p, risen = rising - xn * rising - (n * xn) * p;
    total += (plain * ((s * E) * A + (last * F) * B) + risen * (d * (E * A - F * B))).re;
    const Geometric other = near_one(difference, n);
    total += bn * std::exp(decays[q]) * (other.plain * ((s * F) * A + (last * E) * B) + other.risen * (d * (F * A - E * B))).re;
  }
  multiply(&piece.columns[4 * (from - piece.first)], &row.constants[8 * from], decays.size() - from, out.data());
  const auto at = [&](std::size_t factor, std::size_t constant) {
    return Complex{out[8 * factor + 2 * constant], out[8 * factor + 2 * constant + 1]};
  };
  // Σ over the columns of factor times (1 - x^n) p, of its rise, of factor times (b^n - a^n) q, and of its rise.
  const auto with = [&](std::size_t k) { return at(k, 0) - end * at(k + 2, 0); };
  const auto with_rise = [&](std::size_t k) { return at(k, 1) - end * (at(k + 2, 1) + n * at(k + 2, 0)); };
  const auto apart = [&](std::size_t k) { return at(k + 2, 2) - end * at(k, 2); };
  const auto apart_rise = [&](std::size_t k) { return at(k + 2, 3) - end * (at(k, 3) + n * at(k, 2)); };
  const Complex first = s * (with(0) + apart(1)) + d * (with_rise(0) + apart_rise(1));
  const Complex second = last * (with(1) + apart(0)) - d * (with_rise(1) + apart_rise(0));
  return total + (A * first + B * second).re;
}

double TableProducts::sum(const LagPiece& left, const TablePiece& piece, const Complex* power,
                          const Falling::Values& sums) const {
  double total = 0;
  for (std::size_t r = 0; r <= left.degree; ++r) total += left.polynomial[r] * piece.moments[r];
  for (std::size_t r = 0; r < moments; ++r) total += piece.weights[r] * sums[r];
  if (piece.columns.empty()) return total;
  for (std::size_t k = 0; k < left.active.size(); ++k)
    total += exponential(rows_[left.active[k]], left.ahead[k], left.behind[k], power[left.active[k]], piece);
  return total;
}

double TableProducts::echo(const LagPiece& left, const TablePiece& piece) {
  const std::span<const double> decays = table_.decays();
  const LagPiece& from = piece.covariance;
  const double n = static_cast<double>(piece.count);
  const Falling falling(n);
  double total = 0;
  for (const Echo& echo : left.echoes) {
    const Series forward = counted(echo, piece.pairs, n);
    const Complex angle{0, echo.angle};
    Series both{};
    for (std::size_t r = 0; r < moments; ++r)
      for (std::size_t s = 0; s <= from.degree; ++s) both[r + s] += from.polynomial[s] * forward[r];
    total += swept(both, moments - 1 + from.degree, angle, piece.count).re;
    // The sums with the exponentials at the end of the piece are conjugates of those at its start.
    const Series ahead = falling.of(forward);
    Series behind = falling.of(turned(forward, moments - 1, n));
    const Complex end = exp(-((n - 1) * angle));
    for (Complex& value : behind) value = conj(end * value);
    const Turned& constants = turned_by(echo.angle);
    const double turn = std::remainder(n * echo.angle, 2 * std::numbers::pi), half = std::sin(0.5 * turn);
    const Complex turned_end{std::cos(turn), -std::sin(turn)};
    for (std::size_t q = piece.first; q < decays.size(); ++q) {
      const double *column = &piece.columns[4 * (q - piece.first)], E = column[0], F = column[1];
      if (E == 0 && F == 0) continue;
      const Complex z = constants.pole[q], over = constants.over_apart[q];
      const double lost = std::expm1(-n * decays[q]);
      const Complex zn = (1 + lost) * turned_end;
      Complex moment = Complex{lost * turned_end.re - 2 * half * half, zn.im} * over;
      const Complex last = zn * over, step = z * over;
      for (std::size_t r = 0;;) {
        total += (moment * (E * ahead[r] + F * behind[r])).re;
        if (++r == moments) break;
        moment = falling.end[r] * last - falling.step[r] * (step * moment);
      }
    }
  }
  return total;
}

// z and 1 / (z - 1) of the decays of the table, turned by an angle.
const TableProducts::Turned& TableProducts::turned_by(double angle) {
  const auto [found, fresh] = turned_.try_emplace(angle);
  Turned& out = found->second;
  if (fresh)
    for (const double decay : table_.decays()) {
      const Complex sum = wrapped({decay, angle});
      out.pole.push_back(exp(-sum)), out.over_apart.push_back(inverse(expm1(-sum)));
    }
  return out;
}

}  // namespace gmwm
