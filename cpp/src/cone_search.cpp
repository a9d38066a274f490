// Branch and bound over sections of the curve: the best combination of at most k of its points, with a certificate.
#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "gmwm/cone.hpp"
#include "gmwm/dense.hpp"
#include "gmwm/pause.hpp"

namespace gmwm {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double same_place = 1e-7;  // in cells: curve points closer than this count as one point

// Repeatedly replaces the two closest neighbours by their weighted mean, until at most `count` points are left.
std::vector<Atom> merged(std::vector<Atom> atoms, std::size_t count, const Curve& curve) {
  if (count == 0) return {};
  while (atoms.size() > count) {
    std::size_t at = 0;
    double closest = infinity;
    for (std::size_t i = 0; i + 1 < atoms.size(); ++i) {
      const bool apart = &curve.branch_of(atoms[i].position) != &curve.branch_of(atoms[i + 1].position);
      const double distance = atoms[i + 1].position - atoms[i].position + (apart ? 1e6 : 0);
      if (distance < closest) closest = distance, at = i;
    }
    Atom &left = atoms[at], &right = atoms[at + 1];
    const double weight = left.weight + right.weight;
    if (closest < 1e6)
      left = {(left.position * left.weight + right.position * right.weight) / weight, weight};
    else if (right.weight > left.weight)
      left = right;
    atoms.erase(atoms.begin() + static_cast<std::ptrdiff_t>(at) + 1);
  }
  return atoms;
}

}  // namespace

void Cone::remember(Certified& result, Point point) const {
  for (Point& known : result.best) {
    bool same = known.atoms.size() == point.atoms.size();
    for (std::size_t i = 0; same && i < point.atoms.size(); ++i)
      same = std::abs(known.atoms[i].position - point.atoms[i].position) < 1e-3;
    if (!same) continue;
    if (!(point.objective < known.objective)) return;
    known = std::move(result.best.back());
    result.best.pop_back();
    break;
  }
  result.best.push_back(std::move(point));
  std::sort(result.best.begin(), result.best.end(), [](const Point& a, const Point& b) { return a.objective < b.objective; });
  if (result.best.size() > 4) result.best.pop_back();
}

// Start points from a relaxed solution with too many atoms: neighbours merged down to k, and each surplus atom omitted
// in turn.
void Cone::local_searches(Certified& result, const std::vector<Atom>& atoms, std::size_t k) {
  remember(result, refine(merged(atoms, k, curve_), k));
  if (atoms.size() <= k) return;
  const std::vector<Atom> shorter = merged(atoms, k + 1, curve_);
  for (std::size_t out = 0; out < shorter.size(); ++out) {
    std::vector<Atom> rest = shorter;
    rest.erase(rest.begin() + static_cast<std::ptrdiff_t>(out));
    remember(result, refine(std::move(rest), k));
  }
}

// Divides the interval whose atoms exceed its capacity with the largest weight; no children if no interval has too many
// atoms.
std::vector<Cone::Node> Cone::split(const Node& node) const {
  std::size_t chosen = node.box.size();
  double worst = 0, cut = 0;
  for (std::size_t i = 0; i < node.box.size(); ++i) {
    const Interval& interval = node.box[i];
    std::vector<Atom> inside;
    for (const Atom& atom : node.atoms)
      if (atom.position >= interval.range.low && atom.position <= interval.range.high) inside.push_back(atom);
    std::vector<Atom> places;
    for (const Atom& atom : inside)
      if (places.empty() || atom.position - places.back().position > same_place) places.push_back(atom);
    if (places.size() <= interval.capacity) continue;
    // Split between the neighbours that one point would approximate worst: by the squared gap times the smaller weight.
    for (std::size_t a = 0; a + 1 < places.size(); ++a) {
      const double gap = places[a + 1].position - places[a].position;
      const double lighter = std::min(places[a].weight, places[a + 1].weight);
      const double score = gap * gap * lighter;
      if (!(score > worst)) continue;
      worst = score;
      chosen = i;
      const double weight = places[a].weight + places[a + 1].weight;
      const double mean = (places[a].weight * places[a].position + places[a + 1].weight * places[a + 1].position) / weight;
      cut = std::clamp(mean, places[a].position + 0.1 * gap, places[a + 1].position - 0.1 * gap);
    }
  }
  std::vector<Node> children;
  if (chosen == node.box.size()) return children;
  const Interval& interval = node.box[chosen];
  for (std::size_t left = 0; left <= interval.capacity; ++left) {
    Node child{{}, node.bound, node.atoms};
    for (std::size_t i = 0; i < node.box.size(); ++i) {
      if (i != chosen) {
        child.box.push_back(node.box[i]);
        continue;
      }
      if (left > 0) child.box.push_back({{interval.range.low, cut}, left});
      if (left < interval.capacity) child.box.push_back({{cut, interval.range.high}, interval.capacity - left});
    }
    children.push_back(std::move(child));
  }
  return children;
}

Certified Cone::search(std::size_t k, double gap, std::size_t max_nodes, std::span<const double> starts) {
  // 20 points are shared among four branches in more than 10^3 ways, and a model has at most one for two levels.
  if (k > 16) throw std::invalid_argument("a search has at most 16 points");
  Certified result;
  const Relaxed root = relax();
  result.relaxed = root.bound;
  local_searches(result, root.atoms, k);
  for (std::size_t i = 0; k > 0 && i + k <= starts.size(); i += k) {
    remember(result, refine(starts.subspan(i, k)));
  }
  // Objectives below the squared error of the table cannot be distinguished from zero.
  const double resolution = 4 * curve_.largest_margin() * curve_.largest_margin() * dot(target_.data(), target_.data(), dim_);
  const auto cutoff = [&] { return (1 - gap) * result.best.front().objective - resolution; };
  const auto later = [](const Node& a, const Node& b) { return a.bound > b.bound; };  // heap: smallest bound on top

  std::vector<Node> open;
  const auto push = [&](Node node) {
    open.push_back(std::move(node));
    std::push_heap(open.begin(), open.end(), later);
  };
  // One box for each distribution of the k points over the branches of the curve.
  std::vector<Box> boxes{{}};
  std::vector<std::size_t> left{k};
  const auto& branches = curve_.branches();
  for (std::size_t b = 0; b < branches.size(); ++b) {
    std::vector<Box> more;
    std::vector<std::size_t> rest;
    for (std::size_t i = 0; i < boxes.size(); ++i)
      for (std::size_t take = b + 1 == branches.size() ? left[i] : 0; take <= left[i]; ++take) {
        more.push_back(boxes[i]);
        rest.push_back(left[i] - take);
        if (take > 0) more.back().push_back({branches[b], take});
      }
    boxes = std::move(more);
    left = std::move(rest);
  }
  for (Box& box : boxes) push({std::move(box), root.bound, root.atoms});

  double closed = infinity;  // smallest bound of the nodes that were not divided
  Pause pause(1);
  while (!open.empty() && result.nodes < max_nodes && open.front().bound < cutoff()) {
    pause();
    std::pop_heap(open.begin(), open.end(), later);
    Node node = std::move(open.back());
    open.pop_back();
    ++result.nodes;
    const Relaxed relaxed = solve_relaxation(node.box, node.atoms, cutoff(), gap / 8);
    node.bound = std::max(node.bound, relaxed.bound);
    node.atoms = relaxed.atoms;
    if (node.bound >= cutoff()) {
      closed = std::min(closed, node.bound);
      continue;
    }
    std::vector<Node> children = split(node);
    remember(result, refine(merged(relaxed.atoms, k, curve_), k));
    if (children.empty()) closed = std::min(closed, node.bound);
    for (Node& child : children) push(std::move(child));
  }
  result.bound = std::min(closed, result.best.front().objective);
  if (!open.empty()) result.bound = std::min(result.bound, open.front().bound);
  return result;
}

}  // namespace gmwm
