#include "gmwm/cone.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gmwm/dense.hpp"

namespace gmwm {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

void sort_atoms(std::vector<Atom>& atoms) {
  std::sort(atoms.begin(), atoms.end(), [](const Atom& a, const Atom& b) { return a.position < b.position; });
}

// Atoms of the same branch that are less than a cell apart are merged.
std::vector<Atom> joined(const std::vector<Atom>& atoms, const Curve& curve) {
  std::vector<Atom> result;
  for (const Atom& atom : atoms) {
    if (result.empty() || atom.position - result.back().position > 1 ||
        &curve.branch_of(atom.position) != &curve.branch_of(result.back().position)) {
      result.push_back(atom);
      continue;
    }
    Atom& last = result.back();
    const double weight = last.weight + atom.weight;
    last = {(last.position * last.weight + atom.position * atom.weight) / weight, weight};
  }
  return result;
}

// Solves the positive definite system h x = g (n x n, row by row) by Cholesky; false if it is not positive definite.
bool solve_positive(std::vector<double> h, std::vector<double>& x, std::size_t n) {
  for (std::size_t j = 0; j < n; ++j) {
    for (std::size_t k = 0; k < j; ++k) h[j * n + j] -= h[j * n + k] * h[j * n + k];
    if (!(h[j * n + j] > 0)) return false;
    h[j * n + j] = std::sqrt(h[j * n + j]);
    for (std::size_t i = j + 1; i < n; ++i) {
      for (std::size_t k = 0; k < j; ++k) h[i * n + j] -= h[i * n + k] * h[j * n + k];
      h[i * n + j] /= h[j * n + j];
    }
  }
  for (std::size_t i = 0; i < n; ++i) {
    for (std::size_t k = 0; k < i; ++k) x[i] -= h[i * n + k] * x[k];
    x[i] /= h[i * n + i];
  }
  for (std::size_t i = n; i-- > 0;) {
    for (std::size_t k = i + 1; k < n; ++k) x[i] -= h[k * n + i] * x[k];
    x[i] /= h[i * n + i];
  }
  return true;
}

}  // namespace

Cone::Cone(std::span<const double> target, std::span<const double> fixed, std::span<const double> positive,
           std::shared_ptr<const Curve> curve)
    : dim_(target.size()),
      target_(target.begin(), target.end()),
      fixed_(fixed.begin(), fixed.end()),
      positive_(positive.begin(), positive.end()),
      shared_(std::move(curve)),
      curve_(*shared_),
      nonnegative_(target) {}

// Solves for the non-negative weights of the fixed vectors and of the atoms, starting from the weights of the atoms.
// Atoms with weight zero are not removed.
void Cone::solve_weights(std::vector<Atom>& atoms, std::vector<double>& linear) {
  const std::size_t count = fixed_.size() / std::max<std::size_t>(dim_, 1);
  linear.resize(count, 0.0);
  columns_.resize(atoms.size() * dim_);
  pointers_.clear();
  weights_.clear();
  for (std::size_t l = 0; l < count; ++l) {
    pointers_.push_back(&fixed_[l * dim_]);
    weights_.push_back(linear[l]);
  }
  for (std::size_t i = 0; i < atoms.size(); ++i) {
    curve_.at(atoms[i].position, &columns_[i * dim_]);
    pointers_.push_back(&columns_[i * dim_]);
    weights_.push_back(atoms[i].weight);
  }
  nonnegative_.solve(pointers_, weights_);
  for (std::size_t l = 0; l < count; ++l) linear[l] = weights_[l];
  for (std::size_t i = 0; i < atoms.size(); ++i) atoms[i].weight = weights_[count + i];
}

// For y = r - steepest z, <y, a> <= 0 on the cone, so that every point p of it has |b - p| >= <y, b> / |y|.
double Cone::dual_bound(double steepest) const {
  if (!std::isfinite(steepest)) return 0;
  const auto residual = nonnegative_.residual();
  double along = 0, square = 0;
  for (std::size_t j = 0; j < dim_; ++j) {
    const double y = residual[j] - steepest * positive_[j];
    along += y * target_[j];
    square += y * y;
  }
  return along > 0 && square > 0 ? along * along / square : 0;
}

Relaxed Cone::solve_relaxation(const Box& box, const std::vector<Atom>& warm, double cutoff, double accuracy) {
  Relaxed result;
  for (const Atom& atom : warm)
    for (const Interval& interval : box)
      if (atom.position >= interval.range.low && atom.position <= interval.range.high) {
        result.atoms.push_back(atom);
        break;
      }
  const std::size_t count = fixed_.size() / std::max<std::size_t>(dim_, 1);
  double before = infinity;
  for (int round = 0; round < 200; ++round) {
    solve_weights(result.atoms, result.linear);
    std::erase_if(result.atoms, [](const Atom& atom) { return !(atom.weight > 0); });
    result.objective = nonnegative_.objective();
    const auto residual = nonnegative_.residual();

    double steepest = 0;
    peaks_.clear();
    const double threshold = 1e-14 * std::sqrt(result.objective);
    for (const Interval& interval : box)
      steepest = std::max(steepest, curve_.steepest(residual, interval.range, threshold, peaks_, scratch_));
    for (std::size_t l = 0; l < count; ++l)
      steepest = std::max(steepest, dot(residual.data(), &fixed_[l * dim_], dim_) /
                                        dot(positive_.data(), &fixed_[l * dim_], dim_));
    result.bound = std::max(result.bound, std::min(dual_bound(steepest), result.objective));
    if (result.bound >= cutoff || result.bound >= (1 - accuracy) * result.objective) break;
    if (round > 60 && !(result.objective < before)) break;
    before = result.objective;
    bool fresh = false;
    for (const Peak& peak : peaks_) {
      const bool known = std::any_of(result.atoms.begin(), result.atoms.end(), [&](const Atom& atom) {
        return std::abs(atom.position - peak.position) < 1e-9;
      });
      if (known) continue;
      result.atoms.push_back({peak.position, 0.0});
      fresh = true;
    }
    if (!fresh) break;
  }
  std::erase_if(result.atoms, [](const Atom& atom) { return !(atom.weight > 0); });
  sort_atoms(result.atoms);
  return result;
}

Relaxed Cone::relax() {
  Box whole;
  for (const Range& branch : curve_.branches()) whole.push_back({branch, 1});
  // A pair of neighbours represents one point between them. Merging each pair and moving it to its optimum makes the
  // bound tight immediately. Adding closer and closer points would take many rounds.
  Relaxed relaxed = solve_relaxation(whole, {}, infinity, 1e-3);
  const Point slid = refine(joined(relaxed.atoms, curve_), relaxed.atoms.size());
  Relaxed again = solve_relaxation(whole, slid.atoms, infinity, 1e-9);
  again.bound = std::max(again.bound, relaxed.bound);
  return again;
}

// One damped Newton step of the positions of the atoms, with their weights eliminated; false if it finds no descent. At
// an optimum <r, g'> = 0, which makes the Hessian of the reduced objective 2 x_i x_k <P g'_i, P g'_k> - 2 x_i <r,
// g''_i> on the diagonal, P the projection off the active columns (variable projection, Golub and Pereyra 1973).
bool Cone::descend(std::vector<Atom>& atoms, Point& point) {
  const std::size_t n = atoms.size();
  std::vector<double> value(dim_), slope(n * dim_), curvature(dim_);
  std::vector<double> gradient(n), hessian(n * n), bend(n);
  const auto residual = nonnegative_.residual();
  std::vector<char> held(n, 0);
  double steepness = 0;
  for (std::size_t i = 0; i < n; ++i) {
    double* g = &slope[i * dim_];
    curve_.at(atoms[i].position, value.data(), g, curvature.data());
    gradient[i] = atoms[i].weight * dot(residual.data(), g, dim_);  // minus half the gradient
    bend[i] = -atoms[i].weight * dot(residual.data(), curvature.data(), dim_);
    const Range& branch = curve_.branch_of(atoms[i].position);
    held[i] = (atoms[i].position <= branch.low && gradient[i] < 0) || (atoms[i].position >= branch.high && gradient[i] > 0);
    if (!held[i]) steepness = std::max(steepness, std::abs(gradient[i]));
    nonnegative_.project_out({g, dim_});
    for (std::size_t j = 0; j < dim_; ++j) g[j] *= atoms[i].weight;
  }
  if (steepness <= 1e-15 * point.objective) return false;
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < n; ++k) hessian[i * n + k] = dot(&slope[i * dim_], &slope[k * dim_], dim_);

  for (double damping = 0; damping < 1e12; damping = damping > 0 ? damping * 8 : 1e-3) {
    std::vector<double> h = hessian, step = gradient;
    for (std::size_t i = 0; i < n; ++i) {
      h[i * n + i] += bend[i] + damping * (hessian[i * n + i] + std::abs(bend[i]));
      if (!held[i]) continue;
      for (std::size_t k = 0; k < n; ++k) h[i * n + k] = h[k * n + i] = 0;
      h[i * n + i] = 1;
      step[i] = 0;
    }
    if (!solve_positive(h, step, n)) continue;
    double longest = 0;
    for (const double s : step) longest = std::max(longest, std::abs(s));
    if (!(longest < infinity)) continue;
    std::vector<Atom> moved = atoms;
    for (std::size_t i = 0; i < n; ++i) {
      const Range& branch = curve_.branch_of(atoms[i].position);
      const double by = step[i] * std::min(1.0, 12 / longest);
      moved[i].position = std::clamp(atoms[i].position + by, branch.low, branch.high);
    }
    Point next;
    next.linear = point.linear;
    solve_weights(moved, next.linear);
    next.objective = nonnegative_.objective();
    if (next.objective < point.objective) {
      const bool worth = point.objective - next.objective > 1e-13 * point.objective;
      atoms = moved;
      point.objective = next.objective;
      point.linear = next.linear;
      return worth;
    }
    if (longest < 1e-9) break;
  }
  solve_weights(atoms, point.linear);  // restore the previous solution
  return false;
}

// Moves atoms of weight zero to the position where another curve point lowers the objective most; false if none does.
bool Cone::fill_up(std::vector<Atom>& atoms, std::size_t k) {
  std::erase_if(atoms, [](const Atom& atom) { return !(atom.weight > 0); });
  if (atoms.size() >= k) return false;
  const auto residual = nonnegative_.residual();
  peaks_.clear();
  for (const Range& branch : curve_.branches())
    curve_.steepest(residual, branch, 1e-10 * std::sqrt(nonnegative_.objective()), peaks_, scratch_);
  if (peaks_.empty()) return false;
  const auto best = std::max_element(peaks_.begin(), peaks_.end(),
                                     [](const Peak& a, const Peak& b) { return a.value < b.value; });
  atoms.push_back({best->position, 0.0});
  return true;
}

// A local optimum with at most k curve points, starting from the given points.
Point Cone::refine(std::vector<Atom> atoms, std::size_t k) {
  Point point;
  solve_weights(atoms, point.linear);
  point.objective = nonnegative_.objective();
  double reached = infinity;
  for (int round = 0; round < 20; ++round) {
    std::erase_if(atoms, [](const Atom& atom) { return !(atom.weight > 0); });
    for (int step = 0; step < 60 && !atoms.empty() && descend(atoms, point); ++step)
      std::erase_if(atoms, [](const Atom& atom) { return !(atom.weight > 0); });
    if (!(point.objective < (1 - 1e-9) * reached) || !fill_up(atoms, k)) break;
    reached = point.objective;
    solve_weights(atoms, point.linear);
    point.objective = nonnegative_.objective();
  }
  std::erase_if(atoms, [](const Atom& atom) { return !(atom.weight > 0); });
  sort_atoms(atoms);
  point.atoms = std::move(atoms);
  return point;
}

Point Cone::refine(std::span<const double> positions) {
  std::vector<Atom> atoms;
  for (const double position : positions) atoms.push_back({position, 0.0});
  sort_atoms(atoms);
  return refine(std::move(atoms), positions.size());
}

}  // namespace gmwm
