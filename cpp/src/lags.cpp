#include "gmwm/lags.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>

namespace gmwm {

namespace {

constexpr std::size_t order = 8;  // 7 is the least that reaches 1e-8
constexpr double reach = 40;      // exp(-40) is nothing next to 1

struct Rule {
  std::array<double, order> nodes;
  std::array<double, order> weights;
};

class Collector {
 public:
  Collector(Lags& lags, std::int64_t finer, std::int64_t coarser, std::int64_t fine, std::int64_t coarse,
            std::int64_t samples, double slowest, double fastest, bool alternating)
      : lags_(lags), finer_(finer), coarser_(coarser), fine_(fine), coarse_(coarse), samples_(samples),
        alternating_(alternating) {
    if (fastest > 0)
      for (double cut = std::max(2 / fastest, 1.0);; cut *= 2) {
        cuts_.push_back(static_cast<std::int64_t>(std::min(cut, 4e18)));
        if (cut >= reach / slowest || cut > static_cast<double>(samples)) break;
      }
  }

  void one(std::int64_t lag) { add(static_cast<double>(lag), 1, lag & 1); }

  // All integers strictly between two kinks, divided where exponentials from either end need it.
  void between(std::int64_t low, std::int64_t high, std::unordered_map<std::int64_t, Rule>& rules) {
    const std::int64_t middle = low + (high - low) / 2;
    std::vector<std::int64_t> starts{low + 1};
    for (const std::int64_t cut : cuts_)
      if (low + 1 + cut < middle) starts.push_back(low + 1 + cut);
    for (auto cut = cuts_.rbegin(); cut != cuts_.rend(); ++cut)
      if (high - *cut > middle) starts.push_back(high - *cut);
    starts.push_back(high);
    for (std::size_t i = 0; i + 1 < starts.size(); ++i) piece(starts[i], starts[i + 1] - starts[i], rules);
  }

 private:
  void piece(std::int64_t start, std::int64_t points, std::unordered_map<std::int64_t, Rule>& rules) {
    if (points <= static_cast<std::int64_t>(2 * order)) {
      for (std::int64_t i = 0; i < points; ++i) one(start + i);
    } else if (alternating_) {
      lattice(start, 2, (points + 1) / 2, rules);
      lattice(start + 1, 2, points / 2, rules);
    } else {
      lattice(start, 1, points, rules);
    }
  }

  // The integers start, start + stride, …
  void lattice(std::int64_t start, int stride, std::int64_t points, std::unordered_map<std::int64_t, Rule>& rules) {
    auto found = rules.find(points);
    if (found == rules.end()) {
      found = rules.emplace(points, Rule{}).first;
      integer_rule(points, found->second.nodes, found->second.weights);
    }
    for (std::size_t i = 0; i < order; ++i)
      add(static_cast<double>(start) + stride * found->second.nodes[i], found->second.weights[i], start & 1);
  }

  // n(u): how many t have both coefficients inside the record.
  void add(double lag, double weight, bool odd) {
    const double first = std::max(static_cast<double>(fine_ - 1), static_cast<double>(coarse_ - 1) - lag);
    const double last = static_cast<double>(samples_ - 1) - std::max(lag, 0.0);
    const double pairs = last - first + 1;
    if (!(pairs > 0)) return;
    lags_.finer.push_back(finer_);
    lags_.coarser.push_back(coarser_);
    lags_.lag.push_back(lag);
    lags_.weight.push_back(weight * pairs);
    lags_.odd.push_back(odd);
  }

  Lags& lags_;
  std::int64_t finer_, coarser_, fine_, coarse_, samples_;
  bool alternating_;
  std::vector<std::int64_t> cuts_;
};

}  // namespace

// Eigenvalues and first components of the eigenvectors of the Jacobi matrix with zero diagonal and squared
// off-diagonal i²(M² - i²) / (4 (4i² - 1)), by implicit QL (Golub and Welsch 1969; discrete Legendre polynomials).
void integer_rule(std::int64_t points, std::span<double> nodes, std::span<double> weights) {
  const int n = static_cast<int>(nodes.size());
  const double size = static_cast<double>(points);
  std::vector<double> off(nodes.size(), 0.0);
  for (int i = 1; i < n; ++i) {
    const double square = static_cast<double>(i) * i;
    off[i - 1] = std::sqrt(square * (1 - square / (size * size)) / (4 * (4 * square - 1)));
  }
  for (int i = 0; i < n; ++i) nodes[i] = 0, weights[i] = i == 0;
  for (int l = 0; l < n; ++l)
    for (int sweep = 0; sweep < 60; ++sweep) {
      int m = l;
      while (m + 1 < n && std::abs(off[m]) > 1e-17) ++m;
      if (m == l) break;
      double g = (nodes[l + 1] - nodes[l]) / (2 * off[l]);
      double r = std::hypot(g, 1.0);
      g = nodes[m] - nodes[l] + off[l] / (g + std::copysign(r, g));
      double s = 1, c = 1, p = 0;
      int i = m - 1;
      for (; i >= l; --i) {
        double f = s * off[i];
        const double b = c * off[i];
        r = std::hypot(f, g);
        off[i + 1] = r;
        if (r == 0) {
          nodes[i + 1] -= p;
          off[m] = 0;
          break;
        }
        s = f / r;
        c = g / r;
        g = nodes[i + 1] - p;
        r = (nodes[i] - g) * s + 2 * c * b;
        p = s * r;
        nodes[i + 1] = g + p;
        g = c * r - b;
        f = weights[i + 1];
        weights[i + 1] = s * weights[i] + c * f;
        weights[i] = c * weights[i] - s * f;
      }
      if (r == 0 && i >= l) continue;
      nodes[l] -= p;
      off[l] = g;
      off[m] = 0;
    }
  for (int i = 0; i < n; ++i) {
    nodes[i] = nodes[i] * size + (size - 1) / 2;
    weights[i] = size * weights[i] * weights[i];
  }
}

Lags covariance_lags(std::span<const std::int64_t> levels, std::int64_t samples, double slowest, double fastest,
                     bool alternating) {
  Lags lags;
  std::unordered_map<std::int64_t, Rule> rules;
  for (std::size_t k = 0; k < levels.size(); ++k)
    for (std::size_t j = 0; j <= k; ++j) {
      const std::int64_t fine = std::int64_t{1} << levels[j], coarse = std::int64_t{1} << levels[k];
      const std::int64_t least = coarse - samples, most = samples - fine;
      std::vector<std::int64_t> kinks{least, most, 0, coarse - fine};
      for (const std::int64_t b : {std::int64_t{0}, coarse / 2, coarse})
        for (const std::int64_t a : {std::int64_t{0}, fine / 2, fine}) kinks.push_back(b - a);
      std::sort(kinks.begin(), kinks.end());
      kinks.erase(std::unique(kinks.begin(), kinks.end()), kinks.end());
      std::erase_if(kinks, [&](std::int64_t u) { return u < least || u > most; });
      Collector collect(lags, static_cast<std::int64_t>(j), static_cast<std::int64_t>(k), fine, coarse, samples, slowest,
                        fastest, alternating);
      for (std::size_t i = 0; i < kinks.size(); ++i) {
        collect.one(kinks[i]);
        if (i + 1 == kinks.size()) break;
        // Without exponentials nothing is left beyond the reach of the two filters.
        if (fastest > 0 || (kinks[i] >= -fine && kinks[i + 1] <= coarse)) collect.between(kinks[i], kinks[i + 1], rules);
      }
    }
  return lags;
}

}  // namespace gmwm
