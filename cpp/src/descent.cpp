#include "gmwm/descent.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <utility>

#include "gmwm/dense.hpp"
#include "gmwm/exponential.hpp"
#include "gmwm/nonnegative.hpp"

namespace gmwm {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double noise = 1e-12;         // relative difference below which two objectives are equal up to rounding
constexpr double longest_step = 2;      // of Levenberg-Marquardt: it changes a correlation time by a factor of seven
constexpr double least_gain = 1e-9;     // relative decrease below which Newton steps converge faster
constexpr double longest_newton = 0.3;  // longest Newton step
constexpr double sharp = 1e-11;         // change of every coordinate below which Newton steps end
constexpr double slow = 0.1;            // Newton steps that shrink less need new second derivatives
constexpr std::size_t most_newton = 15, most_hessians = 6;
constexpr double difference = 1e-4;  // step of the differences of gradients
constexpr double definite = 1e-10;   // smallest eigenvalue of a positive definite matrix with unit diagonal
constexpr double negligible = 1e-150;
// A slope beyond the unit vectors, squared and relative, that is a rounding error: the scales compensate for the step, such
// as beside QN near the end where GM is white noise.
constexpr double compensated = 1e-18;

std::vector<double> scales_of(const std::vector<double>& matrix, std::size_t n) {
  std::vector<double> size(n);
  for (std::size_t k = 0; k < n; ++k) {
    size[k] = std::sqrt(std::max(matrix[k * n + k], 0.0));
    if (!(size[k] > negligible)) size[k] = 1;
  }
  return size;
}

// Solves a symmetric system, scaled to unit diagonal. Unknowns on which it does not depend are zero.
std::vector<double> solution(std::vector<double> matrix, std::vector<double> right) {
  const std::size_t n = right.size();
  const std::vector<double> size = scales_of(matrix, n);
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t j = 0; j < n; ++j) matrix[i * n + j] /= size[i] * size[j];
    if (matrix[i * n + i] == 0) matrix[i * n + i] = 1, right[i] = 0;
    right[i] /= size[i];
  }
  if (!solve_linear(matrix, right)) return std::vector<double>(n, 0.0);
  for (std::size_t i = 0; i < n; ++i) right[i] /= size[i];
  return right;
}

// Whether all eigenvalues of the matrix, scaled to unit diagonal, exceed `definite`, by Cholesky's decomposition.
bool positive_definite(std::vector<double> a, std::size_t n) {
  const std::vector<double> size = scales_of(a, n);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) a[i * n + j] /= size[i] * size[j];
  for (std::size_t k = 0; k < n; ++k) {
    double pivot = a[k * n + k] - definite;
    for (std::size_t m = 0; m < k; ++m) pivot -= a[k * n + m] * a[k * n + m];
    if (!(pivot > 0)) return false;
    a[k * n + k] = std::sqrt(pivot);
    for (std::size_t i = k + 1; i < n; ++i) {
      for (std::size_t m = 0; m < k; ++m) a[i * n + k] -= a[i * n + m] * a[k * n + m];
      a[i * n + k] /= a[k * n + k];
    }
  }
  return true;
}

// The entries of a vector that are marked.
std::vector<double> chosen(const std::vector<double>& values, const std::vector<char>& able) {
  std::vector<double> out;
  for (std::size_t k = 0; k < able.size(); ++k)
    if (able[k]) out.push_back(values[k]);
  return out;
}

// A vector with these values at the marked places, and zero elsewhere.
std::vector<double> spread(const std::vector<double>& values, const std::vector<char>& able) {
  std::vector<double> out(able.size(), 0.0);
  for (std::size_t k = 0, next = 0; k < able.size(); ++k)
    if (able[k]) out[k] = values[next++];
  return out;
}

bool any(const std::vector<char>& able) { return std::find(able.begin(), able.end(), 1) != able.end(); }

}  // namespace

ExponentialShape::ExponentialShape(ExponentialCurve curve)
    : Shape({curve.branch(0).low}, {curve.branch(0).high}), curve_(std::move(curve)) {}

bool ExponentialShape::values(const double* z, double* out) const {
  curve_.shape(0, *z, out);
  return true;
}

void ExponentialShape::slopes(const double* z, double* out) const { curve_.slope(0, *z, out); }

ArmaShape::ArmaShape(const ArmaOrders& orders, std::span<const std::int64_t> levels, std::span<const double> odd,
                     std::vector<double> low, std::vector<double> high)
    : Shape(std::move(low), std::move(high)),
      orders_(orders),
      levels_(levels.begin(), levels.end()),
      odd_(odd.begin(), odd.end()) {}

// Levinson's recursion for each polynomial; those of moving averages have the opposite sign.
template <class Number>
std::vector<Number> ArmaShape::coefficients(std::vector<Number> z) const {
  std::size_t first = 0;
  double sign = 1;
  for (const std::size_t order : {orders_.ar, orders_.ma, orders_.seasonal_ar, orders_.seasonal_ma}) {
    Number* a = z.data() + first;
    for (std::size_t n = 0; n < order; ++n) {
      const Number k = a[n] = std::tanh(a[n]);
      for (std::size_t i = 0, j = n; i < j--; ++i) {
        const Number low = a[i], high = a[j];
        a[i] = low - k * high;
        if (i != j) a[j] = high - k * low;
      }
    }
    for (std::size_t n = 0; n < order; ++n) a[n] *= sign;
    first += order, sign = -sign;
  }
  return z;
}

bool ArmaShape::values(const double* z, double* out) const {
  const std::vector<double> parameters = coefficients(std::vector<double>(z, z + size()));
  const std::size_t levels = static_cast<std::size_t>(levels_.back());
  std::vector<double> rows(levels);
  arma_shapes(orders_, parameters, 1, odd_, levels, rows);
  for (std::size_t j = 0; j < levels_.size(); ++j) out[j] = rows[static_cast<std::size_t>(levels_[j]) - 1];
  return true;
}

void ArmaShape::slopes(const double* z, double* out) const {
  const std::size_t levels = static_cast<std::size_t>(levels_.back()), dim = levels_.size(), count = size();
  std::vector<double> rows(count * levels);
  arma_slopes(orders_, coefficients(std::vector<double>(z, z + count)), 1, odd_, levels, rows);
  for (std::size_t k = 0; k < count; ++k) {
    // Derivatives of the coefficients by complex steps.
    constexpr double step = 1e-30;
    std::vector<std::complex<double>> moved(z, z + count);
    moved[k] += std::complex<double>(0, step);
    moved = coefficients(std::move(moved));
    std::fill_n(out + k * dim, dim, 0.0);
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t j = 0; j < dim; ++j)
        out[k * dim + j] += moved[i].imag() / step * rows[i * levels + static_cast<std::size_t>(levels_[j]) - 1];
  }
}

OscillatorShape::OscillatorShape(std::span<const double> half_scales, double rate, std::vector<double> low,
                                 std::vector<double> high)
    : Shape(std::move(low), std::move(high)), half_scales_(half_scales.begin(), half_scales.end()), rate_(rate) {}

bool OscillatorShape::values(const double* z, double* out) const {
  const double natural = 2 * std::numbers::pi / rate_ * std::exp(z[0]), ratio = 0.5 / (std::exp(z[1]) + 0.5);
  // At Q = 1/2, the formula is 0/0, and the next process that it describes differs by 1e-6.
  const double turn = std::max(std::sqrt((1 - ratio) * (1 + ratio)), 1e-3);
  oscillation_shape(natural * ratio, natural * turn, half_scales_, out);
  return true;
}

// Central differences of order 6.
void OscillatorShape::slopes(const double* z, double* out) const {
  constexpr double step = 0.01, factors[] = {45, -9, 1};
  const std::size_t dim = half_scales_.size();
  std::vector<double> up(dim), down(dim);
  std::fill_n(out, 2 * dim, 0.0);
  for (std::size_t k = 0; k < 2; ++k)
    for (int n = 1; n <= 3; ++n) {
      double high[] = {z[0], z[1]}, low[] = {z[0], z[1]};
      high[k] += n * step, low[k] -= n * step;
      values(high, up.data()), values(low, down.data());
      for (std::size_t j = 0; j < dim; ++j) out[k * dim + j] += factors[n - 1] * (up[j] - down[j]) / (60 * step);
    }
}

Descent::Descent(std::span<const double> target, std::span<const double> fixed, std::span<const double> root,
                 double rounding)
    : target_(target.begin(), target.end()),
      fixed_(fixed.begin(), fixed.end()),
      root_(root, target.size()),
      rounding_(rounding) {}

std::size_t Descent::coordinates(std::size_t curved) const {
  for (const auto& free : frees_) curved += free->size();
  return curved;
}

const Shape& Descent::shape(const ShapePoint& point, std::size_t k) const {
  const std::size_t curved = point.branches.size();
  return k < curved ? *branches_[point.branches[k]] : *frees_[k - curved];
}

bool Descent::as_low(double objective, double least) const {
  const double size = std::sqrt(least) + rounding_;
  return objective <= (1 + noise) * size * size;
}

std::optional<Projected> Descent::at(ShapePoint point) const {
  const std::size_t dim = target_.size(), count = point.branches.size() + frees_.size();
  std::vector<double> rows(count * dim);
  Projected found;
  found.units.resize(count * dim);
  for (std::size_t k = 0, first = 0; k < count; first += shape(point, k).size(), ++k)
    if (!shape(point, k).values(&point.x[first], &rows[k * dim])) return std::nullopt;
  root_.weigh(rows.data(), count, found.units.data());
  std::vector<const double*> columns;
  for (std::size_t l = 0; l < fixed_.size(); l += dim) columns.push_back(&fixed_[l]);
  for (std::size_t k = 0; k < count; ++k) {
    double* unit = &found.units[k * dim];
    const double length = std::sqrt(dot(unit, unit, dim));
    if (!std::isfinite(length)) return std::nullopt;
    found.lengths.push_back(length);
    // A process whose wavelet variance is zero, such as a sinusoid at a zero of the filters, gets no weight.
    for (std::size_t j = 0; length > 0 && j < dim; ++j) unit[j] /= length;
    columns.push_back(unit);
  }
  NonNegative solver(target_);
  solver.solve(columns, found.weights);
  found.objective = solver.objective();
  found.residual.assign(solver.residual().begin(), solver.residual().end());
  found.point = std::move(point);
  return found;
}

// Derivatives (coordinates, dim) of the sum of weights times unit vectors at constant lengths.
std::vector<double> Descent::slopes(const Projected& found) const {
  const std::size_t dim = target_.size(), linear = fixed_.size() / dim;
  std::vector<double> rows(found.point.x.size() * dim, 0.0), out(rows.size());
  for (std::size_t k = 0, first = 0; k < found.lengths.size(); ++k) {
    const Shape& part = shape(found.point, k);
    const double share = found.weights[linear + k] / (found.lengths[k] > 0 ? found.lengths[k] : 1.0);
    double* row = &rows[first * dim];
    if (share > 0) part.slopes(&found.point.x[first], row);
    for (std::size_t j = 0; j < part.size() * dim; ++j) row[j] *= share;
    first += part.size();
  }
  root_.weigh(rows.data(), found.point.x.size(), out.data());
  return out;
}

std::vector<double> Descent::gradient(const Projected& found, const std::vector<double>& slopes) const {
  std::vector<double> out(found.point.x.size());
  for (std::size_t k = 0; k < out.size(); ++k)
    out[k] = -dot(&slopes[k * target_.size()], found.residual.data(), target_.size());
  return out;
}

// Marks coordinates of processes with a weight for which a step does not leave the branch.
std::vector<char> Descent::moving(const Projected& found, const std::vector<double>& gradient) const {
  const std::size_t linear = fixed_.size() / target_.size(), curved = found.point.branches.size();
  std::vector<char> able;
  for (std::size_t k = 0; k < found.lengths.size(); ++k)
    able.insert(able.end(), shape(found.point, k).size(), found.weights[linear + k] > 0);
  for (std::size_t k = 0; k < curved; ++k) {
    const Shape& along = shape(found.point, k);
    const double u = found.point.x[k];
    if ((u <= along.low(0) && gradient[k] > 0) || (u >= along.high(0) && gradient[k] < 0)) able[k] = 0;
  }
  return able;
}

ShapePoint Descent::moved(const ShapePoint& point, const std::vector<double>& step) const {
  ShapePoint there = point;
  for (std::size_t k = 0, first = 0; first < there.x.size(); first += shape(point, k).size(), ++k)
    for (std::size_t i = 0; i < shape(point, k).size(); ++i) {
      double& x = there.x[first + i];
      x = std::min(std::max(x + step[first + i], shape(point, k).low(i)), shape(point, k).high(i));
    }
  return there;
}

// Subtracts from the rows their projection on the unit vectors, because the scales compensate for this part.
void Descent::project(const Projected& found, std::vector<double>& rows) const {
  const std::size_t dim = target_.size(), linear = fixed_.size() / dim;
  std::vector<double> basis;
  const auto take_out = [&](double* row) {
    for (std::size_t b = 0; b < basis.size(); b += dim) {
      const double along = dot(&basis[b], row, dim);
      for (std::size_t j = 0; j < dim; ++j) row[j] -= along * basis[b + j];
    }
  };
  for (std::size_t k = 0; k < found.weights.size(); ++k) {
    if (!(found.weights[k] > 0)) continue;
    const double* unit = k < linear ? &fixed_[k * dim] : &found.units[(k - linear) * dim];
    std::vector<double> row(unit, unit + dim);
    take_out(row.data()), take_out(row.data());
    const double length = std::sqrt(dot(row.data(), row.data(), dim));
    if (!(length > 0)) continue;
    for (double& value : row) value /= length;
    basis.insert(basis.end(), row.begin(), row.end());
  }
  for (std::size_t k = 0; k < rows.size(); k += dim) take_out(&rows[k]);
}

Projected Descent::downhill(Projected best, std::size_t steps) const {
  const std::size_t dim = target_.size();
  double damping = 1e-3;
  for (std::size_t round = 0; round < steps; ++round) {
    const std::vector<double> every = slopes(best), along = gradient(best, every);
    std::vector<char> able = moving(best, along);
    std::vector<double> rows = every, kept;
    project(best, rows);
    for (std::size_t k = 0; k < able.size(); ++k) {
      const double *row = &rows[k * dim], *slope = &every[k * dim];
      able[k] = able[k] && dot(row, row, dim) > compensated * dot(slope, slope, dim);
      if (able[k]) kept.insert(kept.end(), row, row + dim);
    }
    if (!any(able)) break;
    std::vector<double> downward = chosen(along, able);
    for (double& value : downward) value = -value;
    const std::size_t n = downward.size();
    std::vector<double> square(n * n);
    for (std::size_t a = 0; a < n; ++a)
      for (std::size_t b = 0; b <= a; ++b)
        square[a * n + b] = square[b * n + a] = dot(&kept[a * dim], &kept[b * dim], dim);
    std::optional<Projected> better;
    for (; damping < 1e10; damping *= 8) {
      std::vector<double> matrix = square;
      for (std::size_t k = 0; k < n; ++k)
        matrix[k * n + k] += damping * (square[k * n + k] + std::numeric_limits<double>::min());
      std::vector<double> step = solution(std::move(matrix), downward);
      for (double& value : step) value = std::clamp(value, -longest_step, longest_step);
      better = at(moved(best.point, spread(step, able)));
      if (better && better->objective < best.objective) break;
      better.reset();
    }
    if (!better) break;
    const double gain = 1 - better->objective / best.objective;
    best = std::move(*better);
    damping = std::max(damping / 10, 1e-9);
    if (gain < least_gain) break;
  }
  return best;
}

// The Hessian for the marked coordinates, by differences of gradients; false unless it is positive definite.
bool Descent::second_derivatives(const Projected& best, const std::vector<char>& able,
                                 std::vector<double>& hessian) const {
  const std::size_t n = static_cast<std::size_t>(std::count(able.begin(), able.end(), 1));
  if (n == 0) return false;
  std::vector<double> rows;
  for (std::size_t k = 0; k < able.size(); ++k) {
    if (!able[k]) continue;
    std::vector<double> sides[2];
    for (const int side : {0, 1}) {
      ShapePoint point = best.point;
      point.x[k] += side ? -difference : difference;
      const std::optional<Projected> there = at(std::move(point));
      if (!there) return false;
      sides[side] = chosen(gradient(*there, slopes(*there)), able);
    }
    for (std::size_t i = 0; i < n; ++i) rows.push_back((sides[0][i] - sides[1][i]) / (2 * difference));
  }
  hessian.resize(n * n);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t j = 0; j < n; ++j) hessian[i * n + j] = (rows[i * n + j] + rows[j * n + i]) / 2;
  return positive_definite(hessian, n);
}

Projected Descent::sharpened(Projected best, std::optional<Curvature>& curvature) const {
  double before = infinity;
  std::size_t computed = 0;
  for (std::size_t round = 0; round < most_newton; ++round) {
    const std::vector<double> along = gradient(best, slopes(best));
    std::vector<char> able = moving(best, along);
    for (std::size_t k = 0; k < best.point.branches.size(); ++k) {
      const Shape& branch = shape(best.point, k);
      if (!(branch.low(0) < best.point.x[k] && best.point.x[k] < branch.high(0))) able[k] = 0;
    }
    const bool fresh = !curvature || curvature->able != able;
    if (fresh) {
      Curvature here{able, {}};
      if (computed == most_hessians || !second_derivatives(best, able, here.hessian)) break;
      curvature = std::move(here), ++computed;
    }
    std::vector<double> downward = chosen(along, able);
    for (double& value : downward) value = -value;
    const std::vector<double> step = solution(curvature->hessian, std::move(downward));
    double size = 0;
    for (const double move : step) size = std::max(size, std::abs(move));
    std::optional<Projected> trial;
    if (size < longest_newton) trial = at(moved(best.point, spread(step, able)));
    if (!trial || !as_low(trial->objective, best.objective)) {
      if (fresh) break;
      curvature.reset();
      continue;
    }
    best = std::move(*trial);
    if (size < sharp) break;
    if (size > slow * before) curvature.reset();
    before = size;
  }
  return best;
}

bool Descent::at_rest(const Projected& found) const {
  const std::size_t dim = target_.size();
  const std::vector<double> every = slopes(found), along = gradient(found, every);
  const std::vector<char> able = moving(found, along);
  const double data = std::sqrt(dot(target_.data(), target_.data(), dim));
  for (std::size_t k = 0; k < able.size(); ++k)
    if (able[k] && !(std::abs(along[k]) <= 1e-10 * data * std::sqrt(dot(&every[k * dim], &every[k * dim], dim))))
      return false;
  return true;
}

}  // namespace gmwm
