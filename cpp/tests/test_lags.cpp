// The Gauss rule on integers, the lags at which covariances are summed, and the covariances there.
#include "gmwm/lags.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "check.hpp"
#include "gmwm/differences.hpp"

namespace {

// Σ_a Σ_b c_a c_b K(u - b + a), c = (1, -2, 1), K the covariance of the running sum.
template <class Covariance>
void compare(const std::vector<double>& got, const gmwm::Nodes& nodes, double tolerance, Covariance running) {
  std::vector<double> expected;
  double largest = 0;
  for (std::size_t i = 0; i < nodes.lag.size(); ++i) {
    double sum = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = 0; b < 3; ++b)
        sum += (a == 1 ? -2 : 1) * (b == 1 ? -2 : 1) *
               running(std::abs(nodes.lag[i] - b * nodes.coarse[i] + a * nodes.fine[i]));
    expected.push_back(sum);
    largest = std::max(largest, std::abs(sum));
  }
  for (std::size_t i = 0; i < expected.size(); ++i) CHECK(std::abs(got[i] - expected[i]) <= tolerance * largest);
}

void covariances_are_nine_terms() {
  for (const auto& [h, hk] : {std::pair{1.0, 1.0}, {1.0, 8.0}, {4.0, 4.0}, {4.0, 32.0}, {64.0, 128.0}}) {
    std::vector<double> fine, coarse, lag;
    for (double u = -3 * h - 20; u <= 3 * hk + 20; ++u) fine.push_back(h), coarse.push_back(hk), lag.push_back(u);
    // A few nodes of another pair of levels at the end: a run that fills no block.
    for (const double u : {-1.0, 0.0, 1.0}) fine.push_back(1), coarse.push_back(2), lag.push_back(u);
    const gmwm::Nodes nodes{fine, coarse, lag};
    std::vector<double> out(lag.size());
    gmwm::white_differences(nodes, out);
    compare(out, nodes, 1e-13, [](double m) { return -m / 2; });
    gmwm::walk_differences(nodes, out);
    compare(out, nodes, 1e-11, [](double m) { return (m * m * m - m) / 12; });
    gmwm::spike_differences(nodes, out);
    compare(out, nodes, 0, [](double m) { return m == 0 ? 1.0 : 0.0; });
    for (const double decay : {0.01, 0.2, 1.5, 30.0}) {
      gmwm::exponential_differences(nodes, decay, out);
      const double half = std::sinh(decay / 2);
      compare(out, nodes, 1e-9, [&](double m) {
        return -0.5 * (m / std::tanh(decay / 2) + 0.5 * std::expm1(-decay * m) / (half * half));
      });
    }
  }
}

// Piece by piece as node by node, relative to the largest covariance of the pair of levels.
void pieces_are_their_nodes() {
  const std::vector<std::int64_t> levels{1, 2, 5, 9, 16};
  for (const bool alternating : {false, true})
    for (const std::int64_t memory : {0, 40}) {
      const gmwm::Lags lags = gmwm::covariance_lags(levels, 100000, {1e-7, 2.0, alternating, false, memory});
      const gmwm::Nodes nodes{{lags.fine.get(), lags.size}, {lags.coarse.get(), lags.size}, {lags.lag.get(), lags.size}};
      const gmwm::Pieces pieces{lags.piece_first, lags.piece_pattern, lags.pattern_begins, lags.pattern_offsets};
      std::vector<double> each(lags.size), together(lags.size);
      for (const double decay : {1e-30, 1e-7, 1e-3, 0.02, 0.4, 2.0, 30.0}) {
        gmwm::exponential_differences(nodes, decay, each);
        gmwm::exponential_differences(nodes, pieces, decay, together);
        for (std::size_t pair = 0; pair < lags.starts.size(); ++pair) {
          const std::size_t start = static_cast<std::size_t>(lags.starts[pair]);
          const std::size_t end = pair + 1 < lags.starts.size() ? static_cast<std::size_t>(lags.starts[pair + 1]) : lags.size;
          double largest = 0, error = 0;
          for (std::size_t i = start; i < end; ++i) {
            largest = std::max(largest, std::abs(each[i]));
            error = std::max(error, std::abs(each[i] - together[i]));
          }
          CHECK(error <= 2e-12 * largest);
        }
      }
    }
}

// K(m) = -m r(0) / 2 - Σ_{0 < k < m} (m - k) r(k).
void short_memory_is_nine_terms() {
  const std::vector<double> r{2.0, -0.7, 0.5, 0.0, 0.3, 0.01, -0.2};
  const auto running = [&](double m) {
    double sum = -m * r[0] / 2;
    for (std::size_t k = 1; k < r.size() && static_cast<double>(k) < m; ++k) sum -= (m - static_cast<double>(k)) * r[k];
    return sum;
  };
  for (const auto& [h, hk] : {std::pair{1.0, 1.0}, {1.0, 4.0}, {2.0, 64.0}, {4.0, 4.0}, {8.0, 8.0}, {8.0, 32.0}, {64.0, 128.0}}) {
    std::vector<double> fine, coarse, lag;
    for (double u = -2 * h - 20; u <= 2 * hk + 20; ++u) fine.push_back(h), coarse.push_back(hk), lag.push_back(u);
    const gmwm::Nodes nodes{fine, coarse, lag};
    std::vector<double> out(lag.size());
    gmwm::short_memory_differences(nodes, r, out);
    compare(out, nodes, 1e-13, running);
  }
  // Far from the kinks lags need not be integers, and all is as for white noise of the same density.
  const std::vector<double> fine{64, 64, 64}, coarse{128, 128, 128}, lag{-100.5, 31.25, 160.75};
  std::vector<double> out(3), white(3);
  gmwm::short_memory_differences({fine, coarse, lag}, r, out);
  gmwm::white_differences({fine, coarse, lag}, white);
  double density = r[0];
  for (std::size_t k = 1; k < r.size(); ++k) density += 2 * r[k];
  for (std::size_t i = 0; i < 3; ++i) CHECK_CLOSE(out[i], density * white[i], 1e-13);
}

// Sums with exponentials that are computed pair by pair, as with their values at all nodes.
void sums_of_exponentials() {
  const std::vector<std::int64_t> levels{1, 2, 5, 9, 16};
  const gmwm::Lags lags = gmwm::covariance_lags(levels, 100000, {1e-4, 0.5, false, false, 0});
  const gmwm::Nodes nodes{{lags.fine.get(), lags.size}, {lags.coarse.get(), lags.size}, {lags.lag.get(), lags.size}};
  const gmwm::Pieces pieces{lags.piece_first, lags.piece_pattern, lags.pattern_begins, lags.pattern_offsets};
  const std::span<const double> weight{lags.weight.get(), lags.size};
  const std::vector<double> decays{0.3, 2e-4}, scales{2.0, 0.7, 5.0};
  std::vector<double> white(lags.size), fast(lags.size), slow(lags.size);
  gmwm::white_differences(nodes, white);
  gmwm::exponential_differences(nodes, pieces, decays[0], fast);
  gmwm::exponential_differences(nodes, pieces, decays[1], slow);
  const std::size_t pairs = lags.starts.size();
  std::vector<double> first(pairs), second(pairs), own_first(pairs), own_second(pairs);
  const std::vector<const double*> every{white.data(), fast.data(), slow.data()}, fixed{white.data()};
  gmwm::node_sums(every, {}, scales, weight, lags.starts, {first, second});
  gmwm::node_sums(fixed, {nodes, pieces, decays}, scales, weight, lags.starts, {own_first, own_second});
  for (std::size_t p = 0; p < pairs; ++p) {
    CHECK_CLOSE(own_first[p], first[p], 1e-14);
    CHECK_CLOSE(own_second[p], second[p], 1e-14);
  }
}

// Sums over the nodes of pairs of any length, against loops.
void test_node_sums() {
  const std::size_t size = 70;
  std::vector<double> a(size), b(size), weight(size);
  for (std::size_t i = 0; i < size; ++i) {
    const double x = static_cast<double>(i);
    a[i] = std::sin(x), b[i] = 1 / (1 + x), weight[i] = 1 + 0.1 * x;
  }
  const std::vector<std::int64_t> starts{0, 3, 35, 51};
  const std::vector<const double*> shapes{a.data(), b.data()};
  const std::vector<double> scales{2.0, -0.5};
  std::vector<double> first(4), second(4);
  gmwm::node_sums(shapes, {}, scales, weight, starts, {first, second});
  for (std::size_t p = 0; p < 4; ++p) {
    double one = 0, two = 0;
    for (std::size_t i = static_cast<std::size_t>(starts[p]); i < (p < 3 ? static_cast<std::size_t>(starts[p + 1]) : size); ++i) {
      const double c = 2 * a[i] - 0.5 * b[i];
      one += weight[i] * c, two += weight[i] * c * c;
    }
    CHECK(std::abs(first[p] - one) < 1e-12 * (1 + std::abs(one)));
    CHECK_CLOSE(second[p], two, 1e-12);
  }
}

// Flicker noise and a walk-like power, against second differences of m² ln|m| and |m|^(2+ε)/ε in long double.
void test_powers() {
  const std::vector<double> fine{1, 4, 2, 2, 2}, coarse{1, 8, 2, 16, 64}, lag{0, -3, 5, 200, 1000};
  std::vector<double> out(5);
  for (const double epsilon : {0.0, 0.5}) {
    std::vector<double> falling;
    double product = (2 + epsilon) * (1 + epsilon) / 2;
    for (int k = 2; k <= 16; ++k) {
      product *= (epsilon - (2 * k - 3)) / ((2.0 * k - 1) * 2 * k);
      if (k > 2) product *= epsilon - (2 * k - 4);
      falling.push_back(product);
    }
    gmwm::power_differences({fine, coarse, lag}, epsilon, std::span<const double, 15>(falling), out);
    for (std::size_t i = 0; i < 5; ++i) {
      long double total = 0, largest = 0;
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) {
          const long double m = std::abs(lag[i] - b * coarse[i] + a * fine[i]);
          const long double power = epsilon == 0 ? std::log(m) : std::pow(m, static_cast<long double>(epsilon)) / epsilon;
          const long double q = m > 0 ? m * m * power : 0;
          total += (a == 1 ? -2 : 1) * (b == 1 ? -2 : 1) * q, largest = std::max(largest, std::abs(q));
        }
      CHECK(std::abs(out[i] - static_cast<double>(total)) < 1e-17 * static_cast<double>(largest) + 1e-13 * std::abs(out[i]));
    }
  }
}

}  // namespace

int main() {
  return check::at_each_level("lags", [] {
    test_node_sums();
    test_powers();
    sums_of_exponentials();
    for (const std::int64_t points : {17, 100, 4001}) {
      std::array<double, 8> nodes{}, weights{};
      gmwm::integer_rule(points, nodes, weights);
      const double middle = 0.5 * static_cast<double>(points - 1), size = static_cast<double>(points);
      for (int power = 0; power < 16; ++power) {
        double direct = 0, rule = 0;
        for (std::int64_t i = 0; i < points; ++i) direct += std::pow((static_cast<double>(i) - middle) / size, power);
        for (std::size_t i = 0; i < 8; ++i) rule += weights[i] * std::pow((nodes[i] - middle) / size, power);
        CHECK(std::abs(direct - rule) < 1e-14 * size);
      }
    }
    // The weights of a pair of levels add up to the number of pairs of coefficients.
    const std::vector<std::int64_t> levels{1, 3, 7, 10};
    for (const bool alternating : {false, true})
      for (const auto& [diagonal, memory] : {std::pair{false, 0}, {true, 0}, {false, 5}, {false, 70}, {true, 9000}}) {
        const gmwm::Lags lags = gmwm::covariance_lags(levels, 5000, {1e-4, 0.3, alternating, diagonal, memory});
        CHECK(lags.odd.size() == (alternating ? lags.size : 0));
        std::size_t pair = 0;
        for (std::size_t k = 0; k < levels.size(); ++k)
          for (std::size_t j = diagonal ? k : 0; j <= k; ++j, ++pair) {
            const std::size_t start = static_cast<std::size_t>(lags.starts[pair]);
            const std::size_t end = pair + 1 < lags.starts.size() ? static_cast<std::size_t>(lags.starts[pair + 1]) : lags.size;
            double total = 0;
            for (std::size_t i = start; i < end; ++i) {
              total += lags.weight[i];
              CHECK(lags.fine[i] == std::ldexp(1, static_cast<int>(levels[j]) - 1));
              CHECK(lags.coarse[i] == std::ldexp(1, static_cast<int>(levels[k]) - 1));
            }
            const double fine = 5001 - std::ldexp(1, static_cast<int>(levels[j]));
            const double coarse = 5001 - std::ldexp(1, static_cast<int>(levels[k]));
            CHECK_CLOSE(total, fine * coarse, 1e-12);
          }
        CHECK(pair == lags.starts.size());
      }
    // Within the memory of a kink every lag of the record is a node, without exponentials too.
    for (const double decay : {0.0, 0.01})
      for (const std::int64_t samples : {150, 1000}) {
        const gmwm::Lags lags = gmwm::covariance_lags(std::vector<std::int64_t>{3, 7}, samples, {decay, decay, false, false, 11});
        std::vector<double> nodes(lags.lag.get() + lags.starts[1], lags.lag.get() + lags.starts[2]);
        for (std::int64_t u = 128 - samples; u <= samples - 8; ++u) {
          bool near = false;
          for (const int b : {0, 64, 128})
            for (const int a : {0, 4, 8}) near = near || std::abs(u - b + a) <= 11;
          if (near) CHECK(std::count(nodes.begin(), nodes.end(), static_cast<double>(u)) == 1);
        }
      }
    covariances_are_nine_terms();
    short_memory_is_nine_terms();
    pieces_are_their_nodes();
  });
}
