#include "gmwm/exponential_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "gmwm/clones.hpp"
#include "gmwm/dense.hpp"
#include "gmwm/pack.hpp"

namespace gmwm {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double curvature_step = 1e-3;  // an error of the second derivative only slows the convergence
constexpr double sharp = 1e-12;          // change of u at which Newton's method ends: near its rounding error

constexpr std::size_t lanes = 2 * Pack::size;

constexpr std::size_t padded(std::size_t dim) { return (dim + lanes - 1) / lanes * lanes; }

// The rows times an upper triangular matrix, of which the columns are given, padded with zeros.
GMWM_INLINE void multiply_inline(const double* rows, std::size_t count, const double* columns, std::size_t dim,
                                 double* out) {
  const std::size_t stride = padded(dim);
  double values[lanes];
  for (std::size_t i = 0; i < count; ++i, rows += dim, out += dim)
    for (std::size_t j = 0; j < dim; j += lanes) {
      Pack low = Pack::of(0), high = low;
      for (std::size_t m = j; m < dim; ++m) {
        const Pack x = Pack::of(rows[m]);
        low = low + x * Pack::load(columns + m * stride + j);
        high = high + x * Pack::load(columns + m * stride + j + Pack::size);
      }
      low.store(values), high.store(values + Pack::size);
      std::copy_n(values, std::min(lanes, dim - j), out + j);
    }
}
constexpr Clones<multiply_inline> multiply{};

GMWM_INLINE void multiply_diagonal_inline(const double* rows, std::size_t count, const double* diagonal,
                                          std::size_t dim, double* out) {
  for (std::size_t i = 0; i < count; ++i, rows += dim, out += dim)
    for (std::size_t j = 0; j < dim; ++j) out[j] = rows[j] * diagonal[j];
}
constexpr Clones<multiply_diagonal_inline> multiply_diagonal{};

double length(const double* v, std::size_t n) { return std::sqrt(dot(v, v, n)); }

// Scales a weighted value to length one, and its derivative with it.
void to_unit(double* value, double* slope, std::size_t n) {
  const double size = length(value, n);
  for (std::size_t j = 0; j < n; ++j) value[j] /= size, slope[j] /= size;
  const double along = dot(value, slope, n);
  for (std::size_t j = 0; j < n; ++j) slope[j] -= along * value[j];
}

}  // namespace

Root::Root(std::span<const double> rows, std::size_t dim) : dim_(dim), columns_(dim * padded(dim), 0.0) {
  bool diagonal = true;
  for (std::size_t i = 0; i < dim_; ++i)
    for (std::size_t j = 0; j < dim_; ++j) {
      columns_[j * padded(dim_) + i] = rows[i * dim_ + j];
      diagonal = diagonal && (i == j || rows[i * dim_ + j] == 0);
    }
  for (std::size_t i = 0; diagonal && i < dim_; ++i) diagonal_.push_back(rows[i * dim_ + i]);
}

void Root::weigh(const double* rows, std::size_t count, double* out) const {
  if (diagonal_.empty())
    multiply(rows, count, columns_.data(), dim_, out);
  else
    multiply_diagonal(rows, count, diagonal_.data(), dim_, out);
}

ExponentialSearch::ExponentialSearch(ExponentialCurve curve, SearchLimits limits, std::span<const double> target,
                                     std::span<const double> fixed, std::span<const double> root, double rounding)
    : curve_(std::move(curve)),
      limits_(std::move(limits)),
      dim_(target.size()),
      target_(target.begin(), target.end()),
      fixed_(fixed.begin(), fixed.end()),
      root_(root, target.size()),
      rounding_(rounding) {}

bool ExponentialSearch::as_low(double objective, double least, double share) const {
  const double size = std::sqrt(least) + rounding_;
  return objective <= (1 + share) * size * size;
}

// The optimal weights with the processes at given places.
Optimum ExponentialSearch::at(std::vector<Place> places) const {
  const std::size_t linear = fixed_.size() / dim_;
  std::vector<double> rows(places.size() * dim_), shape(dim_);
  std::vector<const double*> pointers;
  for (std::size_t l = 0; l < linear; ++l) pointers.push_back(&fixed_[l * dim_]);
  for (std::size_t i = 0; i < places.size(); ++i) {
    double* row = &rows[i * dim_];
    curve_.shape(places[i].branch, places[i].u, shape.data());
    root_.weigh(shape.data(), 1, row);
    const double size = length(row, dim_);
    for (std::size_t j = 0; j < dim_; ++j) row[j] /= size;
    pointers.push_back(row);
  }
  NonNegative solver(target_);
  Optimum found;
  found.weights.assign(pointers.size(), 0.0);
  solver.solve(pointers, found.weights);
  found.objective = solver.objective();
  found.places = std::move(places);
  return found;
}

// The local optimum on the exact curve next to the places: on pieces of curve, ever shorter and at last exact to rounding,
// then by Newton's method. After a search on a table, only the last two lengths are needed.
Optimum ExponentialSearch::polished(std::vector<Place> places, bool tabulated) const {
  std::vector<double> shape(dim_), positive(dim_);
  const std::span<const double> widths(limits_.widths);
  for (const double width : tabulated ? widths.last(std::min<std::size_t>(widths.size(), 2)) : widths) {
    double before = infinity;
    for (std::size_t round = 0; round < limits_.polishes && !places.empty(); ++round) {
      const std::size_t count = places.size();
      std::vector<double> values(2 * count * dim_), slopes(2 * count * dim_), margins(2 * count - 1, 0.0);
      std::vector<double> starts(count), positions(count);
      for (std::size_t i = 0; i < count; ++i) {
        const auto& [branch, u] = places[i];
        const ExponentialBranch& along = curve_.branch(branch);
        starts[i] = std::min(std::max(u - width / 2, along.low), along.high - width);
        positions[i] = std::clamp((u - starts[i]) / width, 0.0, 1.0) + 2 * static_cast<double>(i);
        if (i > 0) margins[2 * i - 1] = -1;
        for (std::size_t end = 0; end < 2; ++end) {
          const double place = starts[i] + static_cast<double>(end) * width;
          double *value = &values[(2 * i + end) * dim_], *slope = &slopes[(2 * i + end) * dim_];
          curve_.shape(branch, place, shape.data());
          root_.weigh(shape.data(), 1, value);
          curve_.slope(branch, place, shape.data());
          root_.weigh(shape.data(), 1, slope);
          to_unit(value, slope, dim_);
          for (std::size_t j = 0; j < dim_; ++j) slope[j] *= width;
        }
      }
      // A refinement uses no bound, so any direction serves as the positive one.
      Cone cone(target_, fixed_, positive, std::make_shared<const Curve>(dim_, values, slopes, margins, positive));
      const Point moved = cone.refine(positions);
      std::vector<Place> next;
      bool leaving = false;
      for (const Atom& atom : moved.atoms) {
        const std::size_t piece = std::min(static_cast<std::size_t>(atom.position) / 2, count - 1);
        const double share = atom.position - 2 * static_cast<double>(piece);
        const Place place{places[piece].branch, starts[piece] + share * width};
        const ExponentialBranch& along = curve_.branch(place.branch);
        leaving = leaving || ((share == 0 || share == 1) && along.low < place.u && place.u < along.high);
        next.push_back(place);
      }
      places = std::move(next);
      if (!leaving || moved.objective >= (1 - limits_.settled) * before) break;
      before = moved.objective;
    }
  }
  return sharpened(at(std::move(places)), limits_.newton_steps, limits_.widths.back());
}

// The optimum after Newton's method if its objective is not larger; `moved`: whether it is.
Optimum ExponentialSearch::sharpened(Optimum best, std::size_t steps, double reach, bool* moved) const {
  std::vector<Place> places = best.places;
  if (moved) *moved = false;
  if (!newton(places, best.weights, steps, reach)) return best;
  Optimum sharp_one = at(std::move(places));
  if (!as_low(sharp_one.objective, best.objective, limits_.settled)) return best;
  if (moved) *moved = true;
  return sharp_one;
}

// Minimises over weights and places together. Weights that are zero stay zero, places at an end of their branch stay
// there, and no step may be longer than `reach`. False if there is nothing to move, or the steps diverge.
bool ExponentialSearch::newton(std::vector<Place>& places, const std::vector<double>& weights, std::size_t steps,
                               double reach) const {
  const std::size_t linear = fixed_.size() / dim_, count = places.size();
  std::vector<std::size_t> moving;
  for (std::size_t i = 0; i < count; ++i) {
    const ExponentialBranch& along = curve_.branch(places[i].branch);
    if (along.low < places[i].u && places[i].u < along.high) moving.push_back(i);
    if (!(weights[linear + i] > 0)) return false;
  }
  if (moving.empty()) return false;
  std::vector<double> rows, x, sizes;
  for (std::size_t l = 0; l < linear; ++l)
    if (weights[l] > 0) {
      rows.insert(rows.end(), &fixed_[l * dim_], &fixed_[l * dim_] + dim_);
      x.push_back(weights[l]);
    }
  const std::size_t active = x.size(), total = active + count, size = total + moving.size();
  x.insert(x.end(), weights.begin() + static_cast<std::ptrdiff_t>(linear), weights.end());
  rows.resize((size + 2 * count) * dim_);  // unit vectors; the slopes that move, times weights; all slopes and bends
  double* slopes = &rows[size * dim_];
  double* bends = &rows[(size + count) * dim_];
  std::vector<double> shape(dim_), other(dim_), residual(dim_);
  for (std::size_t step = 0; step < steps; ++step) {
    for (std::size_t i = 0; i < count; ++i) {
      const auto& [branch, u] = places[i];
      double *value = &rows[(active + i) * dim_], *slope = slopes + i * dim_, *bend = bends + i * dim_;
      curve_.shape(branch, u, shape.data());
      root_.weigh(shape.data(), 1, value);
      curve_.slope(branch, u, shape.data());
      root_.weigh(shape.data(), 1, slope);
      curve_.slope(branch, u + curvature_step, shape.data());
      curve_.slope(branch, u - curvature_step, other.data());
      for (std::size_t j = 0; j < dim_; ++j) shape[j] = (shape[j] - other[j]) / (2 * curvature_step);
      root_.weigh(shape.data(), 1, bend);
      if (step == 0) sizes.push_back(length(value, dim_));
      for (std::size_t j = 0; j < dim_; ++j) value[j] /= sizes[i], slope[j] /= sizes[i], bend[j] /= sizes[i];
    }
    residual = target_;
    for (std::size_t k = 0; k < total; ++k)
      for (std::size_t j = 0; j < dim_; ++j) residual[j] -= x[k] * rows[k * dim_ + j];
    for (std::size_t m = 0; m < moving.size(); ++m)
      for (std::size_t j = 0; j < dim_; ++j)
        rows[(total + m) * dim_ + j] = x[active + moving[m]] * slopes[moving[m] * dim_ + j];
    std::vector<double> hessian(size * size), gradient(size);
    for (std::size_t a = 0; a < size; ++a) {
      gradient[a] = dot(&rows[a * dim_], residual.data(), dim_);
      for (std::size_t b = 0; b <= a; ++b)
        hessian[a * size + b] = hessian[b * size + a] = dot(&rows[a * dim_], &rows[b * dim_], dim_);
    }
    for (std::size_t m = 0; m < moving.size(); ++m) {
      const std::size_t at = total + m, which = active + moving[m];
      hessian[at * size + at] -= x[which] * dot(bends + moving[m] * dim_, residual.data(), dim_);
      hessian[which * size + at] -= dot(slopes + moving[m] * dim_, residual.data(), dim_);
      hessian[at * size + which] = hessian[which * size + at];
    }
    if (!solve_linear(hessian, gradient)) return false;
    for (std::size_t k = 0; k < total; ++k) x[k] += gradient[k];
    double longest = 0;
    bool inside = true;
    for (std::size_t m = 0; m < moving.size(); ++m) {
      Place& place = places[moving[m]];
      const double move = gradient[total + m];
      place.u += move;
      const ExponentialBranch& along = curve_.branch(place.branch);
      inside = inside && std::abs(move) <= reach && along.low <= place.u && place.u <= along.high;
      longest = std::max(longest, std::abs(move));
    }
    if (!inside) return false;
    if (longest < sharp) break;
  }
  return true;
}

Optimum ExponentialSearch::followed(const std::vector<Place>& places) const {
  bool moved = false;
  Optimum there = sharpened(at(places), 1, limits_.followed, &moved);
  return moved || places.empty() ? there : polished(places, false);
}

// Places move to an end of their branch if the objective is flat up to that end.
Optimum ExponentialSearch::settled(Optimum best) const {
  for (std::size_t i = 0; i < best.places.size(); ++i) {
    const ExponentialBranch& along = curve_.branch(best.places[i].branch);
    for (const double end : {along.high, along.low}) {
      std::vector<Place> places = best.places;
      places[i].u = end;
      Optimum there = at(std::move(places));
      if (!as_low(there.objective, best.objective, limits_.flat)) continue;
      best = std::move(there);
      break;
    }
  }
  return best;
}

std::vector<int> ExponentialSearch::acts_as(const Optimum& best) const {
  std::vector<int> found(best.places.size(), 0);
  for (std::size_t i = 0; i < found.size(); ++i) {
    // Clang 14 captures no structured binding.
    const double u = best.places[i].u;
    const ExponentialBranch& along = curve_.branch(best.places[i].branch);
    const auto acts = [&](bool high) {
      if (!(high ? along.high_acts : along.low_acts)) return false;
      const double end = high ? along.high : along.low;
      if (u == end) return true;
      std::vector<Place> places = best.places;
      places[i].u = end;
      return as_low(at(std::move(places)).objective, best.objective, limits_.acts_as);
    };
    // The end at which it is comes first.
    const bool low_first = u == along.low && u != along.high;
    if (acts(!low_first))
      found[i] = low_first ? -1 : 1;
    else if (acts(low_first))
      found[i] = low_first ? 1 : -1;
  }
  return found;
}

namespace {

// Bounds of the interpolation error: `safety` times the largest one at the midpoints of a cell and its neighbours.
std::vector<double> margins_of(const std::vector<double>& values, const std::vector<double>& slopes,
                               std::vector<double> middles, std::span<const double> spacing, std::size_t dim,
                               double safety, std::size_t neighbours) {
  const std::size_t cells = spacing.size();
  std::vector<double> error(cells, 0.0), margins(cells, -1.0);
  for (std::size_t c = 0; c < cells; ++c) {
    if (spacing[c] == 0) continue;
    double* middle = &middles[c * dim];
    const double size = length(middle, dim);
    const double *p0 = &values[c * dim], *p1 = p0 + dim, *d0 = &slopes[c * dim], *d1 = d0 + dim;
    for (std::size_t j = 0; j < dim; ++j)
      middle[j] = middle[j] / size - ((p0[j] + p1[j]) / 2 + spacing[c] * (d0[j] - d1[j]) / 8);
    error[c] = length(middle, dim);
  }
  for (std::size_t c = 0; c < cells; ++c) {
    if (spacing[c] == 0) continue;
    const std::size_t from = c < neighbours ? 0 : c - neighbours;
    const std::size_t to = std::min(c + neighbours + 1, cells);
    const double worst = *std::max_element(&error[from], &error[from] + (to - from));
    margins[c] = safety * worst + 4 * std::numeric_limits<double>::epsilon();
  }
  return margins;
}

}  // namespace

WeightedTable::WeightedTable(const ExponentialTable& table, std::span<const double> root,
                             std::span<const double> positive, double safety, std::size_t neighbours)
    : owner_(table.owner.begin(), table.owner.end()),
      nodes_(table.nodes.begin(), table.nodes.end()),
      spacing_(table.spacing.begin(), table.spacing.end()),
      positive_(positive.begin(), positive.end()) {
  const std::size_t nodes = nodes_.size(), dim = positive_.size();
  std::vector<double> values(nodes * dim), slopes(nodes * dim), middles((nodes - 1) * dim);
  const Root weights(root, dim);
  weights.weigh(table.values.data(), nodes, values.data());
  weights.weigh(table.slopes.data(), nodes, slopes.data());
  weights.weigh(table.middles.data(), nodes - 1, middles.data());
  for (std::size_t i = 0; i < nodes; ++i) to_unit(&values[i * dim], &slopes[i * dim], dim);
  const std::vector<double> margins = margins_of(values, slopes, std::move(middles), spacing_, dim, safety, neighbours);
  // Slopes per cell. The cells of a branch are equal, so either neighbour of a node gives its spacing.
  for (std::size_t i = 0; i < nodes; ++i) {
    double step = spacing_[std::min(i, nodes - 2)];
    if (step == 0) step = spacing_[i - 1];
    for (std::size_t j = 0; j < dim; ++j) slopes[i * dim + j] *= step;
  }
  curve_ = std::make_shared<const Curve>(dim, values, slopes, margins, positive_);
}

Place WeightedTable::located(double position) const {
  std::size_t cell = std::min(static_cast<std::size_t>(std::max(position, 0.0)), nodes_.size() - 2);
  if (spacing_[cell] == 0 && position <= static_cast<double>(cell)) --cell;
  return {static_cast<std::size_t>(owner_[cell]),
          nodes_[cell] + (position - static_cast<double>(cell)) * spacing_[cell]};
}

Solved ExponentialSearch::solve(const WeightedTable& table, std::size_t k, std::size_t most,
                                std::span<const double> starts) const {
  Cone cone(target_, fixed_, table.positive(), table.curve());
  const Certified certified = cone.search(k, limits_.gap, most, starts);

  Solved best;
  best.table = certified.best.front().objective;
  best.objective = infinity;
  for (const Point& candidate : certified.best) {
    if (!(candidate.objective <= (1 + limits_.table_error) * best.table)) continue;
    std::vector<Place> places;
    for (const Atom& atom : candidate.atoms) places.push_back(table.located(atom.position));
    Optimum there = polished(std::move(places), true);
    if (there.objective < best.objective) static_cast<Optimum&>(best) = std::move(there);
  }
  static_cast<Optimum&>(best) = settled(std::move(static_cast<Optimum&>(best)));
  best.bound = certified.bound, best.relaxed = certified.relaxed, best.nodes = certified.nodes;
  return best;
}

}  // namespace gmwm
