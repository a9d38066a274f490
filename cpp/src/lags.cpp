#include "gmwm/lags.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <unordered_map>
#include <utility>

#include "gmwm/differences.hpp"

namespace gmwm {

namespace {

constexpr std::size_t order = 8;  // 7 is the least that reaches 1e-8
constexpr double gone = 40;       // exp(-40) is nothing next to 1
// Shorter pieces than this would only divide lags that are nodes one by one anyway.
constexpr double shortest = order;

struct Rule {
  std::array<double, order> nodes;
  std::array<double, order> weights;
};

using Rules = std::unordered_map<std::int64_t, Rule>;

// A sequence of integers with a constant stride: each one is a node if they are few, else a Gauss rule gives the nodes.
struct Piece {
  std::int64_t start;
  std::int64_t points;
  const Rule* rule;  // nullptr: one by one
  int stride;

  std::size_t nodes() const { return rule == nullptr ? static_cast<std::size_t>(points) : order; }
};

// The pieces of all pairs of levels, one after the other.
class Collector {
 public:
  Collector(std::int64_t samples, const Smoothness& smooth) : samples_(samples), smooth_(smooth) {
    if (smooth.fastest > 0)
      for (double cut = std::max(2 / smooth.fastest, shortest);; cut *= 2) {
        cuts_.push_back(static_cast<std::int64_t>(std::min(cut, 4e18)));
        if (cut >= gone / smooth.slowest || cut > static_cast<double>(samples)) break;
      }
  }

  void pair(std::int64_t fine, std::int64_t coarse) {
    const std::int64_t least = coarse - samples_, most = samples_ - fine;
    // Those of the filters, of which 0 and coarse - fine are also those of the number of pairs; then the record's ends.
    std::array<std::int64_t, 11> kinks;
    std::size_t count = 0;
    for (const std::int64_t b : {std::int64_t{0}, coarse / 2, coarse})
      for (const std::int64_t a : {std::int64_t{0}, fine / 2, fine}) kinks[count++] = b - a;
    std::sort(kinks.begin(), kinks.begin() + count);
    const auto filters_end = std::unique(kinks.begin(), kinks.begin() + count);
    std::array<std::int64_t, 9> filters;
    const std::span<const std::int64_t> own{filters.begin(), std::copy(kinks.begin(), filters_end, filters.begin())};
    auto end = filters_end;
    *end++ = least, *end++ = most;
    std::sort(kinks.begin(), end);
    end = std::unique(kinks.begin(), end);
    end = std::remove_if(kinks.begin(), end, [&](std::int64_t u) { return u < least || u > most; });
    for (auto kink = kinks.begin(); kink != end; ++kink) {
      one(*kink, 1);
      if (kink + 1 != end) gap({kink[0], kink[1], kink[0] >= -fine, kink[1] <= coarse}, own);
    }
  }

  const std::vector<Piece>& pieces() const { return pieces_; }

 private:
  void one(std::int64_t lag, std::int64_t points) {
    if (points > 0) pieces_.push_back({lag, points, nullptr, 1});
  }

  // The integers strictly between two kinks, and whether exponentials come from the one and the other.
  struct Gap {
    std::int64_t low, high;
    bool from_low, from_high;
  };

  // Those within the memory of a kink of the filters one by one, the rest by rules.
  void gap(const Gap& at, std::span<const std::int64_t> filters) {
    std::int64_t start = at.low + 1, end = at.high;
    if (smooth_.memory > 0) {
      // Kinks beyond the ends of the record count too.
      const auto next = std::lower_bound(filters.begin(), filters.end(), at.high);
      if (next != filters.begin()) start = std::clamp(next[-1] + smooth_.memory + 1, start, end);
      if (next != filters.end()) end = std::clamp(*next - smooth_.memory, start, end);
    }
    one(at.low + 1, start - at.low - 1);
    // Without exponentials nothing is left beyond the reach of the two filters.
    // Beyond it the exponentials come from its end alone: the ends of the record are none of theirs.
    if ((at.from_low && at.from_high) || smooth_.fastest > 0) between(at, start, end);
    one(end, at.high - end);
  }

  // The integers from start to before end, divided where exponentials from the one or the other kink need it.
  void between(const Gap& at, std::int64_t start, std::int64_t end) {
    const std::int64_t middle = !at.from_low ? at.low : !at.from_high ? at.high : at.low + (at.high - at.low) / 2;
    const auto up_to = [&](std::int64_t next) {
      if (next > start) piece(start, next - start), start = next;
    };
    for (const std::int64_t cut : cuts_) {
      if (at.low + 1 + cut >= middle) break;
      up_to(std::min(at.low + 1 + cut, end));
    }
    for (auto cut = cuts_.rbegin(); cut != cuts_.rend(); ++cut)
      if (at.high - *cut > middle) up_to(std::min(at.high - *cut, end));
    up_to(end);
  }

  void piece(std::int64_t start, std::int64_t points) {
    if (points <= static_cast<std::int64_t>(2 * order)) {
      one(start, points);
    } else if (smooth_.alternating) {
      pieces_.push_back({start, (points + 1) / 2, rule((points + 1) / 2), 2});
      pieces_.push_back({start + 1, points / 2, rule(points / 2), 2});
    } else {
      pieces_.push_back({start, points, rule(points), 1});
    }
  }

  const Rule* rule(std::int64_t points) {
    const auto [found, fresh] = rules_.try_emplace(points);
    if (fresh) integer_rule(points, found->second.nodes, found->second.weights);
    return &found->second;
  }

  std::int64_t samples_;
  const Smoothness& smooth_;
  std::vector<std::int64_t> cuts_;
  std::vector<Piece> pieces_;
  Rules rules_;
};

// Numbers the patterns of offsets: 0, 1, … of adjacent lags, and the nodes of rules.
class Patterns {
 public:
  explicit Patterns(Lags& lags) : lags_(lags) { lags.pattern_begins.push_back(0); }

  // The nodes of a piece from `place` on.
  void add(const Piece& piece, std::size_t place) {
    if (piece.rule != nullptr) {
      enter(place, rules_[{piece.rule, piece.stride}], order, [&](std::size_t i) {
        return piece.stride * (piece.rule->nodes[i] - piece.rule->nodes[0]);
      });
      return;
    }
    for (std::size_t done = 0, points = static_cast<std::size_t>(piece.points); done < points; done += piece_nodes) {
      const std::size_t size = std::min(points - done, piece_nodes);
      enter(place + done, adjacent_[size], size, [](std::size_t i) { return static_cast<double>(i); });
    }
  }

 private:
  // `number` is that of the pattern, from 1; 0 for a new one.
  template <class Offset>
  void enter(std::size_t place, std::int64_t& number, std::size_t size, Offset offset) {
    if (number == 0) {
      for (std::size_t i = 0; i < size; ++i) lags_.pattern_offsets.push_back(offset(i));
      lags_.pattern_begins.push_back(static_cast<std::int64_t>(lags_.pattern_offsets.size()));
      number = static_cast<std::int64_t>(lags_.pattern_begins.size()) - 1;
    }
    lags_.piece_first.push_back(static_cast<std::int64_t>(place));
    lags_.piece_pattern.push_back(number - 1);
  }

  Lags& lags_;
  std::array<std::int64_t, piece_nodes + 1> adjacent_{};
  std::map<std::pair<const Rule*, int>, std::int64_t> rules_;
};

// Writes the nodes of one pair; returns where the next pair starts.
std::size_t write(std::span<const Piece> pieces, std::int64_t fine, std::int64_t coarse, std::int64_t samples,
                  std::size_t place, Lags& lags, Patterns& patterns) {
  const std::size_t start = place;
  for (const Piece& piece : pieces) {
    patterns.add(piece, place);
    const double first = static_cast<double>(piece.start);
    if (piece.rule == nullptr)
      for (std::int64_t i = 0; i < piece.points; ++i, ++place) {
        lags.lag[place] = first + static_cast<double>(i);
        lags.weight[place] = 1;
        if (!lags.odd.empty()) lags.odd[place] = (piece.start + i) & 1;
      }
    else
      for (std::size_t i = 0; i < order; ++i, ++place) {
        lags.lag[place] = first + piece.stride * piece.rule->nodes[i];
        lags.weight[place] = piece.rule->weights[i];
        if (!lags.odd.empty()) lags.odd[place] = piece.start & 1;
      }
  }
  // n(u): the number of t for which both coefficients are inside the record.
  const double inner = static_cast<double>(fine - 1), outer = static_cast<double>(coarse - 1);
  for (std::size_t i = start; i < place; ++i) {
    const double u = lags.lag[i];
    lags.weight[i] *= static_cast<double>(samples) - std::max(u, 0.0) - std::max(inner, outer - u);
    lags.fine[i] = 0.5 * static_cast<double>(fine);
    lags.coarse[i] = 0.5 * static_cast<double>(coarse);
  }
  return place;
}

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
  // QL leaves them in any order.
  for (int i = 1; i < n; ++i)
    for (int k = i; k > 0 && nodes[k] < nodes[k - 1]; --k) {
      std::swap(nodes[k], nodes[k - 1]);
      std::swap(weights[k], weights[k - 1]);
    }
  for (int i = 0; i < n; ++i) {
    nodes[i] = nodes[i] * size + (size - 1) / 2;
    weights[i] = size * weights[i] * weights[i];
  }
}

Lags covariance_lags(std::span<const std::int64_t> levels, std::int64_t samples, const Smoothness& smooth) {
  Collector collect(samples, smooth);
  std::vector<std::size_t> ends;  // ends of the pieces of each pair
  const auto for_each_pair = [&](auto&& act) {
    for (std::size_t k = 0; k < levels.size(); ++k)
      for (std::size_t j = smooth.diagonal ? k : 0; j <= k; ++j)
        act(std::int64_t{1} << levels[j], std::int64_t{1} << levels[k]);
  };
  for_each_pair([&](std::int64_t fine, std::int64_t coarse) {
    collect.pair(fine, coarse);
    ends.push_back(collect.pieces().size());
  });
  Lags lags;
  for (const Piece& piece : collect.pieces()) lags.size += piece.nodes();
  for (AlignedArray* array : {&lags.fine, &lags.coarse, &lags.lag, &lags.weight}) *array = aligned_array(lags.size);
  if (smooth.alternating) lags.odd.resize(lags.size);
  std::size_t place = 0, pair = 0, first = 0;
  Patterns patterns(lags);
  for_each_pair([&](std::int64_t fine, std::int64_t coarse) {
    lags.starts.push_back(static_cast<std::int64_t>(place));
    const std::span<const Piece> pieces{collect.pieces().data() + first, ends[pair] - first};
    place = write(pieces, fine, coarse, samples, place, lags, patterns);
    first = ends[pair++];
  });
  return lags;
}

}  // namespace gmwm
