// The running sum of a process with autocovariances r(0) … r(L) has the covariance K(m) = -S |m| / 2 - T(|m|) up to a
// constant, with S = r(0) + 2 Σ r(k) and T(m) = Σ_{k > m} (k - m) r(k), which is 0 for m >= L. The difference over the
// finer filter, D(m) = K(m) - 2 K(m + h) + K(m + 2h), is that of white noise with the variance S plus a table.
//
// If h <= L, these terms nearly cancel for a slow process. D is then computed from the level below, without a difference:
// D(m) = -r(m + 1) for h = 1, and D(m) + 2 D(m + h) + D(m + 2h) for twice the h.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/differences.hpp"

namespace gmwm {

namespace {

// D at the integers -2h - L … L; it is 0 at all others.
struct Table {
  std::int64_t h = 0, memory = 0;
  std::vector<double> values;

  explicit Table(std::span<const double> r) : h(1), memory(static_cast<std::int64_t>(r.size()) - 1) {
    values.resize(static_cast<std::size_t>(2 * memory + 3));
    for (std::int64_t k = -memory; k <= memory; ++k)
      values[static_cast<std::size_t>(k + 1 + memory)] = -r[static_cast<std::size_t>(std::abs(k))];
  }

  void twice() {
    const std::size_t step = static_cast<std::size_t>(h), size = values.size();
    std::vector<double> wider(size + 2 * step);
    for (std::size_t i = 0; i < size; ++i) {
      wider[i + 2 * step] += values[i];
      wider[i + step] += 2 * values[i];
      wider[i] += values[i];
    }
    values.swap(wider);
    h *= 2;
  }
};

// A place as a whole number; beyond every table if it is no number or too large.
std::int64_t whole(double place) {
  return std::abs(place) < 0x1p60 ? static_cast<std::int64_t>(std::floor(place)) : std::int64_t{1} << 60;
}

// One pair of levels, with h <= L.
void tabulated(const Table& table, const double* lag, std::size_t count, std::int64_t coarse, double* out) {
  const std::int64_t first = 2 * table.h + table.memory, size = static_cast<std::int64_t>(table.values.size());
  const double* values = table.values.data();
  const auto at = [=](std::int64_t m) {
    const std::int64_t place = m + first;
    return place >= 0 && place < size ? values[place] : 0.0;
  };
  for (std::size_t i = 0; i < count; ++i) {
    const std::int64_t u = whole(lag[i]);
    out[i] = at(u) - 2 * at(u - coarse) + at(u - 2 * coarse);
  }
}

// One pair of levels, with h > L: only terms of T at the nearest kink differ from 0.
void separate(std::span<const double> tails, double density, const double* lag, std::size_t count, double h, double hk,
              double* out) {
  const double memory = static_cast<double>(tails.size());
  const double* T = tails.data();
  const auto near = [=](double m) {
    const double size = std::abs(m);
    return size < memory ? T[static_cast<std::int64_t>(size)] : 0.0;
  };
  for (std::size_t i = 0; i < count; ++i) {
    const double u = lag[i];
    double white = 0, table = 0;
    for (int b = 0; b < 3; ++b) {
      const double m = u - b * hk, weight = b == 1 ? -2 : 1;
      white -= weight * std::max(h - std::abs(m + h), 0.0);
      table -= weight * (near(m) - 2 * near(m + h) + near(m + 2 * h));
    }
    out[i] = density * white + table;
  }
}

}  // namespace

void short_memory_differences(const Nodes& nodes, std::span<const double> r, std::span<double> out) {
  // T is the sum of the sums of r from the far end, without cancellation of large numbers.
  std::vector<double> tails(r.size());
  double slope = 0, value = 0;
  for (std::size_t m = r.size() - 1; m-- > 0;) {
    slope += r[m + 1];
    value += slope;
    tails[m] = value;
  }
  const double density = r[0] + 2 * slope;
  const std::size_t n = nodes.lag.size();
  std::vector<Table> tables{Table(r)};
  while (tables.back().h < tables.back().memory) {
    tables.push_back(tables.back());
    tables.back().twice();
  }
  for (std::size_t first = 0, end; first < n; first = end) {
    const double h = nodes.fine[first], hk = nodes.coarse[first];
    for (end = first + 1; end < n && nodes.fine[end] == h && nodes.coarse[end] == hk;) ++end;
    const auto found =
        std::find_if(tables.begin(), tables.end(), [h](const Table& t) { return static_cast<double>(t.h) == h; });
    if (found != tables.end())
      tabulated(*found, &nodes.lag[first], end - first, whole(hk), &out[first]);
    else
      separate(tails, density, &nodes.lag[first], end - first, h, hk, &out[first]);
  }
}

}  // namespace gmwm
