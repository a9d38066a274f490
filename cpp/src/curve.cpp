#include "gmwm/curve.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gmwm/clones.hpp"
#include "gmwm/dense.hpp"
#include "gmwm/pack.hpp"

namespace gmwm {

namespace {

// Nodes that are multiplied together. Their values and slopes are adjacent, dimension by dimension.
constexpr std::size_t batch = 2 * Pack::size;

// Inner products of a direction with the values and the slopes of the nodes of batches, written to p and d.
GMWM_INLINE void products_inline(const double* nodes, const double* direction, std::size_t dim, std::size_t batches,
                                 double* p, double* d) {
  for (std::size_t b = 0; b < batches; ++b, p += batch, d += batch) {
    Pack p0 = Pack::of(0), p1 = p0, d0 = p0, d1 = p0;
    for (std::size_t j = 0; j < dim; ++j, nodes += 2 * batch) {
      const Pack y = Pack::of(direction[j]);
      p0 = p0 + y * Pack::load(nodes);
      p1 = p1 + y * Pack::load(nodes + Pack::size);
      d0 = d0 + y * Pack::load(nodes + batch);
      d1 = d1 + y * Pack::load(nodes + batch + Pack::size);
    }
    p0.store(p), p1.store(p + Pack::size);
    d0.store(d), d1.store(d + Pack::size);
  }
}
constexpr Clones<products_inline> products{};

// An upper bound of a cubic on a cell: the largest of its Bernstein coefficients.
GMWM_INLINE double control_maximum(double p0, double p1, double d0, double d1) {
  return std::max(std::max(p0, p0 + d0 / 3), std::max(p1, p1 - d1 / 3));
}

// The upper bounds of the cells between successive nodes.
GMWM_INLINE void control_maxima_inline(const double* p, const double* d, std::size_t cells, double* most) {
  for (std::size_t i = 0; i < cells; ++i) most[i] = control_maximum(p[i], p[i + 1], d[i], d[i + 1]);
}
constexpr Clones<control_maxima_inline> control_maxima{};

}  // namespace

double Curve::Cell::operator()(double t) const {
  const double u = 1 - t;
  return u * u * ((1 + 2 * t) * p0 + t * d0) + t * t * ((1 + 2 * u) * p1 - u * d1);
}

Peak Curve::Cell::maximum(double from, double to) const {
  Peak best{from, (*this)(from)};
  const auto consider = [&](double t) {
    if (!(t > from && t <= to)) return;
    const double value = (*this)(t);
    if (value > best.value) best = {t, value};
  };
  consider(to);
  // Derivative of the cubic a t³ + b t² + d0 t + p0.
  const double a = 2 * (p0 - p1) + d0 + d1;
  const double b = 3 * (p1 - p0) - 2 * d0 - d1;
  const double discriminant = b * b - 3 * a * d0;
  if (discriminant >= 0) {
    const double q = -(b + std::copysign(std::sqrt(discriminant), b));
    if (q != 0) consider(d0 / q);
    if (a != 0) consider(q / (3 * a));
  }
  return best;
}

Curve::Curve(std::size_t dim, std::span<const double> values, std::span<const double> slopes,
             std::span<const double> margins, std::span<const double> positive)
    : dim_(dim),
      nodes_(dim ? values.size() / dim : 0),
      values_(values.begin(), values.end()),
      slopes_(slopes.begin(), slopes.end()),
      batches_((nodes_ + batch - 1) / batch * batch * 2 * dim, 0.0),
      margins_(margins.begin(), margins.end()),
      least_(margins.size()) {
  for (std::size_t i = 0; i < nodes_; ++i)
    for (std::size_t j = 0; j < dim_; ++j) {
      double* at = &batches_[(i / batch * dim_ + j) * 2 * batch + i % batch];
      at[0] = values_[i * dim_ + j];
      at[batch] = slopes_[i * dim_ + j];
    }
  const double norm = std::sqrt(dot(positive.data(), positive.data(), dim_));
  std::size_t first = 0;
  for (std::size_t i = 0; i + 1 < nodes_; ++i) {
    if (margins_[i] < 0) {
      branches_.push_back({static_cast<double>(first), static_cast<double>(i)});
      first = i + 1;
      continue;
    }
    const double p0 = dot(positive.data(), &values_[i * dim_], dim_), d0 = dot(positive.data(), &slopes_[i * dim_], dim_);
    const double p1 = dot(positive.data(), &values_[(i + 1) * dim_], dim_);
    const double d1 = dot(positive.data(), &slopes_[(i + 1) * dim_], dim_);
    least_[i] = -control_maximum(-p0, -p1, -d0, -d1) - margins_[i] * norm;
  }
  if (nodes_) branches_.push_back({static_cast<double>(first), static_cast<double>(nodes_ - 1)});
}

const Range& Curve::branch_of(double s) const {
  for (const Range& branch : branches_)
    if (s <= branch.high) return branch;
  return branches_.back();
}

double Curve::largest_margin() const {
  double largest = 0;
  for (const double margin : margins_) largest = std::max(largest, margin);
  return largest;
}

void Curve::at(double s, double* value, double* slope, double* curvature) const {
  std::size_t cell = std::min(static_cast<std::size_t>(std::max(s, 0.0)), nodes_ - 2);
  if (margins_[cell] < 0 && cell > 0) --cell;  // the last node of a branch belongs to the cell before it
  const double t = s - static_cast<double>(cell), u = 1 - t;
  const double* p0 = &values_[cell * dim_];
  const double* d0 = &slopes_[cell * dim_];
  const double *p1 = p0 + dim_, *d1 = d0 + dim_;
  for (std::size_t j = 0; j < dim_; ++j) {
    const double rise = p1[j] - p0[j];
    value[j] = u * u * ((1 + 2 * t) * p0[j] + t * d0[j]) + t * t * ((1 + 2 * u) * p1[j] - u * d1[j]);
    if (slope) slope[j] = 6 * t * u * rise + u * (1 - 3 * t) * d0[j] - t * (2 - 3 * t) * d1[j];
    if (curvature) curvature[j] = 6 * (1 - 2 * t) * rise + (6 * t - 4) * d0[j] + (6 * t - 2) * d1[j];
  }
}

double Curve::steepest(std::span<const double> direction, Range range, double threshold, std::vector<Peak>& peaks,
                       Scratch& scratch) const {
  const auto first = static_cast<std::size_t>(range.low);
  const auto last = std::min(static_cast<std::size_t>(std::ceil(range.high)), nodes_ - 1);
  const std::size_t from = first / batch, to = last / batch + 1;
  scratch.p.resize(nodes_ + batch), scratch.d.resize(nodes_ + batch), scratch.most.resize(nodes_);
  double *p = scratch.p.data(), *d = scratch.d.data(), *most = scratch.most.data();
  products(&batches_[from * dim_ * 2 * batch], direction.data(), dim_, to - from, p + from * batch, d + from * batch);
  control_maxima(p + first, d + first, last - first, most + first);
  const double length = std::sqrt(dot(direction.data(), direction.data(), dim_));
  double ratio = 0;
  bool rising = false;  // inside a run of cells whose maxima are above the threshold
  for (std::size_t i = first; i < std::max(last, first + 1); ++i) {
    std::size_t c = i;
    if (i + 1 >= nodes_ || margins_[i] < 0) {  // the range is a single point at the end of a branch
      if (range.high > range.low || i == 0) continue;
      c = i - 1;
    }
    if (last == first) {
      for (std::size_t k = c; k <= c + 1; ++k) {
        p[k] = dot(direction.data(), &values_[k * dim_], dim_);
        d[k] = dot(direction.data(), &slopes_[k * dim_], dim_);
      }
      control_maxima(p + c, d + c, 1, most + c);
    }
    const double margin = margins_[c] * length;
    if (most[c] + margin <= 0) {
      rising = false;
      continue;
    }
    const Cell cell{p[c], p[c + 1], d[c], d[c + 1]};
    const double start = static_cast<double>(c);
    // In a run of rising cells, a cell that cannot exceed the ratio and the peak so far changes neither.
    const bool whole = range.low <= start && range.high >= start + 1;
    if (whole && rising && !peaks.empty() && most[c] <= peaks.back().value && most[c] + margin <= ratio * least_[c] &&
        std::max(cell.p0, cell.p1) > threshold)
      continue;
    const Peak peak = cell.maximum(std::max(range.low - start, 0.0), std::min(range.high - start, 1.0));
    // If the margin leaves no positive lower bound of <z, g>, no upper bound can be proven.
    if (peak.value + margin > 0)
      ratio = std::max(ratio, least_[c] > 0 ? (peak.value + margin) / least_[c] : std::numeric_limits<double>::infinity());
    if (peak.value <= threshold) {
      rising = false;
    } else if (!rising || peaks.empty()) {
      peaks.push_back({start + peak.position, peak.value});
      rising = true;
    } else if (peak.value > peaks.back().value) {
      peaks.back() = {start + peak.position, peak.value};
    }
  }
  return ratio;
}

}  // namespace gmwm
