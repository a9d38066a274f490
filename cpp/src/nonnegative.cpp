#include "gmwm/nonnegative.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "gmwm/clones.hpp"
#include "gmwm/dense.hpp"

namespace gmwm {

namespace {

// a - c b
GMWM_INLINE void subtract(double* a, double c, const double* b, std::size_t n) {
  std::size_t i = 0;
  for (; i + Pack::size <= n; i += Pack::size) (Pack::load(a + i) - Pack::of(c) * Pack::load(b + i)).store(a + i);
  for (; i < n; ++i) a[i] -= c * b[i];
}

// Projects columns out of a vector, some of them together, so that their products do not wait for each other.
GMWM_INLINE void take_out_inline(const double* columns, std::size_t n, std::size_t count, double* vector, double* r) {
  constexpr std::size_t together = 8;
  double along[together];
  for (std::size_t from = 0; from < count; from += together) {
    const std::size_t size = std::min(together, count - from);
    for (std::size_t k = 0; k < size; ++k) along[k] = dot_product(columns + (from + k) * n, vector, n);
    for (std::size_t k = 0; k < size; ++k) subtract(vector, along[k], columns + (from + k) * n, n);
    for (std::size_t k = 0; r && k < size; ++k) r[from + k] += along[k];
  }
}
constexpr Clones<take_out_inline> take_out{};

// Makes column k of q orthogonal to the k columns before it, twice; adds the coefficients to r. Returns its length
// before and after.
struct Lengths {
  double before, after;
};

GMWM_INLINE Lengths orthogonalise_inline(double* columns, std::size_t n, std::size_t k, double* r) {
  double* q = columns + k * n;
  const double before = std::sqrt(dot_product(q, q, n));
  for (int pass = 0; pass < 2; ++pass) take_out_inline(columns, n, k, q, r);
  return {before, std::sqrt(dot_product(q, q, n))};
}
constexpr Clones<orthogonalise_inline> orthogonalise{};

}  // namespace

NonNegative::NonNegative(std::span<const double> target)
    : target_(target.begin(), target.end()), residual_(target_) {
  objective_ = dot(target_.data(), target_.data(), target_.size());
  target_norm_ = std::sqrt(objective_);
}

// Gram-Schmidt, each column twice: the passive columns may be nearly parallel (neighbours on a curve). Each column only
// depends on the columns before it, so the first columns that are the same as in the last call are not computed again.
// Returns false, and removes the column from the passive set, if a column depends on the previous ones.
bool NonNegative::least_squares(std::span<const double* const> columns) {
  const std::size_t n = target_.size();
  const std::size_t m = passive_.size();
  if (a_.size() < m * n) {
    a_.resize(m * n), q_.resize(m * n), r_.resize(m * (m + 1) / 2), along_.resize(m), left_.resize((m + 1) * n);
    std::copy(target_.begin(), target_.end(), left_.begin());
  }
  std::size_t k = 0;
  while (k < known_ && k < m && std::equal(&a_[k * n], &a_[k * n] + n, columns[passive_[k]])) ++k;
  for (known_ = k; k < m; known_ = ++k) {
    const double* a = columns[passive_[k]];
    double *q = &q_[k * n], *r = &r_[k * (k + 1) / 2], *left = &left_[(k + 1) * n];
    std::copy(a, a + n, &a_[k * n]);
    std::copy(a, a + n, q);
    std::fill(r, r + k, 0.0);
    const auto [before, norm] = orthogonalise(q_.data(), n, k, r);
    if (!(norm > 1e-12 * before)) {
      blocked_[passive_[k]] = 1;
      passive_.erase(passive_.begin() + static_cast<std::ptrdiff_t>(k));
      return false;
    }
    r[k] = norm;
    for (std::size_t t = 0; t < n; ++t) q[t] /= norm;
    std::copy(left - n, left, left);
    along_[k] = dot(q, left, n);
    for (std::size_t t = 0; t < n; ++t) left[t] -= along_[k] * q[t];
  }
  std::copy(&left_[m * n], &left_[m * n] + n, residual_.begin());
  z_.assign(along_.begin(), along_.begin() + static_cast<std::ptrdiff_t>(m));
  for (k = m; k-- > 0;) {
    const double* r = &r_[k * (k + 1) / 2];
    z_[k] /= r[k];
    for (std::size_t i = 0; i < k; ++i) z_[i] -= r[i] * z_[k];
  }
  return true;
}

// Moves from the feasible weights towards the unconstrained solution on the passive columns. Columns whose weight
// reaches zero become active. Returns false if no column did: then the weights are the solution on the passive columns.
bool NonNegative::advance(std::vector<double>& weights) {
  double step = 1;
  for (std::size_t k = 0; k < passive_.size(); ++k) {
    const double w = weights[passive_[k]];
    if (z_[k] <= 0) step = std::min(step, w / (w - z_[k]));
  }
  if (std::isnan(step)) step = 0;  // 0/0: a column that entered with weight zero and whose solution is zero
  std::size_t kept = 0;
  for (std::size_t k = 0; k < passive_.size(); ++k) {
    const std::size_t index = passive_[k];
    const double w = weights[index];
    const bool out = z_[k] <= 0 && (w <= 0 || w / (w - z_[k]) <= step);
    weights[index] = out ? 0.0 : w + step * (z_[k] - w);
    if (!out) passive_[kept++] = index;
    if (out && w <= 0) blocked_[index] = 1;  // it entered and would leave immediately: rounding, not descent
  }
  const bool left = kept < passive_.size();
  passive_.resize(kept);
  return left;
}

void NonNegative::solve(std::span<const double* const> columns, std::vector<double>& weights) {
  const std::size_t n = target_.size();
  const std::size_t m = columns.size();
  weights.resize(m, 0.0);
  blocked_.assign(m, 0);
  passive_.clear();
  for (std::size_t k = 0; k < m; ++k)
    if (weights[k] > 0) passive_.push_back(k);

  for (std::size_t rounds = 30 + 10 * m;; --rounds) {
    while (!passive_.empty()) {
      if (!least_squares(columns)) {
        for (std::size_t k = 0; k < m; ++k)
          if (blocked_[k]) weights[k] = 0;
      } else if (!advance(weights)) {
        break;
      }
    }
    if (passive_.empty()) residual_ = target_;

    std::size_t best = m;
    double steepest = 1e-14 * target_norm_;
    for (std::size_t k = 0; k < m; ++k) {
      if (weights[k] > 0 || blocked_[k]) continue;
      const double slope = dot(columns[k], residual_.data(), n);
      if (slope > steepest) {
        steepest = slope;
        best = k;
      }
    }
    if (best == m || rounds == 0) break;
    passive_.push_back(best);
  }
  objective_ = dot(residual_.data(), residual_.data(), n);
}

bool often_near(std::span<const double> data, std::span<const double> limits, std::span<const double> columns,
                double most) {
  const std::size_t n = limits.size();
  if (n == 0) return most < 0;
  const std::size_t dim = data.size() / n;
  std::vector<const double*> pointers;
  for (std::size_t k = 0; k < columns.size(); k += dim) pointers.push_back(&columns[k]);
  std::vector<std::size_t> open(n);
  std::iota(open.begin(), open.end(), std::size_t{0});
  std::vector<double> weights(pointers.size(), 0.0);
  while (most >= 0 && most < static_cast<double>(open.size())) {
    // The weights of the last row are a good start.
    NonNegative solver(data.subspan(open.front() * dim, dim));
    solver.solve(pointers, weights);
    if (solver.objective() <= limits[open.front()]) most -= 1;
    // No column has a positive product with this residual, so its product with other data bounds their distance.
    const auto residual = solver.residual();
    open.erase(open.begin());
    std::erase_if(open, [&](std::size_t i) {
      const double along = std::max(dot(&data[i * dim], residual.data(), dim), 0.0);
      return along * along > limits[i] * solver.objective();
    });
  }
  return most < 0;
}

void NonNegative::project_out(std::span<double> vector) const {
  take_out(q_.data(), target_.size(), passive_.size(), vector.data(), nullptr);
}

}  // namespace gmwm
