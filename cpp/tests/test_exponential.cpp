// Wavelet variances of exponential autocovariances against sums over all lags in long double, and the search against
// data that it can fit exactly.
#include "gmwm/exponential.hpp"

#include <cmath>
#include <cstdint>
#include <vector>

#include "check.hpp"
#include "gmwm/dense.hpp"
#include "gmwm/exponential_search.hpp"
#include "gmwm/reweighting.hpp"

namespace {

// Variance of the difference of the means of two adjacent blocks of h samples, over 4.
double by_sums(double phi, int h) {
  const auto weight = [&](int k) { return k < h ? -0.5L / h : 0.5L / h; };
  long double total = 0;
  for (int a = 0; a < 2 * h; ++a)
    for (int b = 0; b < 2 * h; ++b) total += weight(a) * weight(b) * std::pow(static_cast<long double>(phi), std::abs(a - b));
  return static_cast<double>(total);
}

void test_shapes() {
  const std::vector<double> h{1, 2, 4, 16};
  std::vector<double> out(4), low(4), high(4);
  for (const double phi : {-0.9, -0.3, 0.0, 0.2, 0.7, 0.99}) {
    gmwm::autoregressive_shape(phi, h, out.data());
    for (std::size_t j = 0; j < 4; ++j)
      CHECK_CLOSE(out[j], by_sums(phi, static_cast<int>(h[j])) / (1 - phi * phi), 1e-12);
    gmwm::autoregressive_slope(phi, h, out.data());
    gmwm::autoregressive_shape(phi - 1e-5, h, low.data());
    gmwm::autoregressive_shape(phi + 1e-5, h, high.data());
    for (std::size_t j = 0; j < 4; ++j) CHECK(std::abs(out[j] - (high[j] - low[j]) / 2e-5) < 1e-6 * (1 + std::abs(out[j])));
    if (!(phi > 0)) continue;
    const double lambda = -std::log(phi);
    CHECK_CLOSE(gmwm::log_decay(phi), lambda, 1e-14);
    gmwm::exponential_shape(lambda, h, out.data());
    for (std::size_t j = 0; j < 4; ++j) CHECK_CLOSE(out[j], by_sums(phi, static_cast<int>(h[j])), 1e-12);
    gmwm::exponential_slope(lambda, h, out.data());
    gmwm::exponential_shape(lambda * (1 - 1e-5), h, low.data());
    gmwm::exponential_shape(lambda * (1 + 1e-5), h, high.data());
    for (std::size_t j = 0; j < 4; ++j)
      CHECK(std::abs(out[j] - (high[j] - low[j]) / (2e-5 * lambda)) < 1e-6 * (1 + std::abs(out[j])));
  }
  // Far beyond what direct formulas bear: a random walk, and white noise.
  gmwm::exponential_shape(1e-200, h, out.data());
  CHECK_CLOSE(out[0], 0.5e-200, 1e-12);
  gmwm::exponential_shape(1e6, h, out.data());
  CHECK_CLOSE(out[1], 0.25, 1e-12);
}

// Periods from 40 samples to aliases, nearly undamped and overdamped oscillators.
void test_oscillations() {
  const std::vector<double> h{1, 2, 4, 16};
  std::vector<double> out(4);
  for (const double damping : {1e-6, 1e-3, 0.1, 2.0, 30.0})
    for (const double turn : {1e-5, 0.15, 1.5, 3.0, 4.0}) {
      gmwm::oscillation_shape(damping, turn, h, out.data());
      for (std::size_t j = 0; j < 4; ++j) {
        const int n = static_cast<int>(h[j]);
        long double total = 0;
        for (int a = 0; a < 2 * n; ++a)
          for (int b = 0; b < 2 * n; ++b) {
            const long double k = std::abs(a - b), angle = turn * k;
            const long double r = std::exp(-damping * k) * (std::cos(angle) + damping / turn * std::sin(angle));
            total += ((a < n) == (b < n) ? r : -r) / (4 * n * n);
          }
        CHECK(std::abs(out[j] - static_cast<double>(total)) < 1e-12 * static_cast<double>(total) + 1e-15);
      }
    }
}

void test_linear() {
  std::vector<double> a{0, 2, 1, 1, 1, 0, 3, 0, 1}, b{7, 3, 6};
  CHECK(gmwm::solve_linear(a, b));
  CHECK_CLOSE(b[0], 1, 1e-14);
  CHECK_CLOSE(b[1], 2, 1e-14);
  CHECK_CLOSE(b[2], 3, 1e-14);
  std::vector<double> singular{1, 2, 2, 4}, right{1, 2};
  CHECK(!gmwm::solve_linear(singular, right));
}

// 2 exp(-0.01 |k|) + exp(-0.4 |k|) and white noise at 15 levels, under equal weights of the logarithms.
void test_search() {
  constexpr std::size_t levels = 15;
  std::vector<double> h, observed(levels, 0.0), white, root(levels * levels, 0.0), shape(levels);
  for (std::size_t j = 0; j < levels; ++j) h.push_back(std::ldexp(1.0, static_cast<int>(j)));
  for (const auto& [scale, lambda] : {std::pair{2.0, 0.01}, {1.0, 0.4}}) {
    gmwm::exponential_shape(lambda, h, shape.data());
    for (std::size_t j = 0; j < levels; ++j) observed[j] += scale * shape[j];
  }
  for (std::size_t j = 0; j < levels; ++j) observed[j] += 0.5 / (2 * h[j]);
  double square = 0;
  for (std::size_t j = 0; j < levels; ++j) {
    root[j * levels + j] = 1 / observed[j];
    white.push_back(1 / (2 * h[j]) / observed[j]);
    square += white[j] * white[j];
  }
  for (double& v : white) v /= std::sqrt(square);
  const std::vector<double> target(levels, 1.0);

  const double low = std::log(1e-7), high = std::log(40.0);
  const gmwm::ExponentialBranch branch{low, high, 1e-7, 1e-8, 1, true, true};
  const gmwm::ExponentialCurve curve(h, std::vector{branch}, 1.0, false);
  const gmwm::SearchLimits limits{1e-4, 1e-5, 1e-12, 1e-10, 1e-6, 0.05, 8, 5, {1e-2, 1e-3}};
  const gmwm::ExponentialSearch search(curve, limits, target, white, root, 1e-15);
  const std::size_t cells = 790;
  const double step = (high - low) / static_cast<double>(cells);
  std::vector<std::int64_t> owner(cells + 1, 0);
  std::vector<double> nodes, spacing(cells, step), values((cells + 1) * levels), slopes(values), middles(cells * levels);
  for (std::size_t i = 0; i <= cells; ++i) {
    nodes.push_back(i == cells ? high : low + step * static_cast<double>(i));
    curve.shape(0, nodes[i], &values[i * levels]);
    curve.slope(0, nodes[i], &slopes[i * levels]);
    if (i < cells) curve.shape(0, nodes[i] + step / 2, &middles[i * levels]);
  }
  const std::vector<double> positive(levels, 1.0);
  const gmwm::WeightedTable table({owner, nodes, spacing, values, slopes, middles}, root, positive, 2, 12);
  const gmwm::Solved best = search.solve(table, 2, 2000, std::vector<double>{});
  CHECK(best.places.size() == 2 && best.objective < 1e-24 && best.bound <= best.objective + 1e-12);
  if (best.places.size() != 2) return;
  CHECK_CLOSE(curve.parameter(0, best.places[0].u), 0.01, 1e-9);
  CHECK_CLOSE(curve.parameter(0, best.places[1].u), 0.4, 1e-9);
  for (const int end : search.acts_as(best)) CHECK(end == 0);
  // From nearby, one Newton step leads back.
  const gmwm::Optimum again = search.followed({{0, best.places[0].u + 1e-6}, {0, best.places[1].u - 1e-6}});
  CHECK_CLOSE(again.places[0].u, best.places[0].u, 1e-9);
  CHECK_CLOSE(again.places[1].u, best.places[1].u, 1e-9);
}

void test_least_squares() {
  const std::vector<std::vector<double>> columns{{1, 1, 1, 1}, {0, 1, 2, 3}};
  const std::vector<double> line = gmwm::least_squares(columns, {1, 3, 5, 7}, 1e-6);
  CHECK_CLOSE(line[0], 1, 1e-13);
  CHECK_CLOSE(line[1], 2, 1e-13);
  // Of two equal columns, each has one half.
  const std::vector<double> same = gmwm::least_squares({{1, 2}, {1, 2}}, {2, 4}, 1e-6);
  CHECK_CLOSE(same[0], 1, 1e-13);
  CHECK_CLOSE(same[1], 1, 1e-13);
}

gmwm::Setting white_and_exponential(const std::vector<double>& h) {
  gmwm::Setting setting;
  for (std::size_t j = 0; j < h.size(); ++j) {
    setting.levels.push_back(static_cast<std::int64_t>(j + 1));
    setting.counts.push_back(1000 - 2 * h[j] + 1);
    setting.freedom.push_back(1000 / (2 * h[j]));
    setting.shapes.push_back(1 / (2 * h[j]));
  }
  setting.added.assign(h.size(), 0.0);
  setting.loss = 1;
  setting.segments = {{1000, 1.0, h.size()}};
  setting.kinds = {gmwm::Elementary::white};
  setting.powers = {1};
  setting.curved = 1;
  setting.rounding = 2e-15;
  setting.options = {1000, 1e-11, 0.7, -1.2, 1e-6, 60, 12, 5};
  return setting;
}

// The variances of white noise at two levels are those that the Python documentation states.
void test_weights() {
  const std::vector<double> h{1, 2, 4, 8, 16, 32};
  const double low = std::log(1e-5), high = std::log(40.0);
  const gmwm::ExponentialCurve curve(h, std::vector{gmwm::ExponentialBranch{low, high, 1e-5, 1e-8, 1, true, true}}, 1, false);
  const gmwm::SearchLimits limits{1e-4, 1e-5, 1e-12, 1e-10, 1e-6, 0.05, 8, 5, {1e-2, 1e-3}};
  gmwm::Setting setting = white_and_exponential(h);
  gmwm::Reweighting alone(setting, curve, limits);
  const std::vector<double> white = alone.variances({{1.0}, {{0.1, 0.0}}});
  CHECK_CLOSE(white[0], 0.0007505, 1e-4);
  CHECK_CLOSE(white[1], 0.0002192, 3e-4);
  // An exponential of decay 1000 is white noise too, and so is half of each.
  const std::vector<double> halves = alone.variances({{0.5}, {{1000.0, 0.5}}});
  for (std::size_t j = 0; j < h.size(); ++j) CHECK_CLOSE(halves[j], white[j], 1e-12);

  // Exact data have the truth as their optimum under any weights, so the last weights are those of an estimate near it.
  std::vector<double> shape(h.size());
  curve.shape_of(0.05, shape.data());
  for (std::size_t j = 0; j < h.size(); ++j) setting.observed.push_back(setting.shapes[j] + 0.5 * shape[j]);
  gmwm::Reweighting iteration(setting, curve, limits);
  const auto found = iteration.run({{0.8}, {{0.06, 0.6}}}, {{0, std::log(0.06)}});
  CHECK(found.has_value() && found->best.places.size() == 1 && found->expected <= 1e-11);
  if (!found || found->best.places.empty()) return;
  CHECK_CLOSE(curve.parameter(0, found->best.places[0].u), 0.05, 1e-8);
  const std::vector<double> expected = iteration.variances({{1.0}, {{0.05, 0.5}}});
  for (std::size_t j = 0; j < h.size(); ++j) CHECK_CLOSE(found->weights[j], 1 / expected[j], 1e-3);

  // Without noise at any level there are no weights.
  CHECK(!gmwm::Reweighting(setting, curve, limits).run({{0.0}, {{0.06, 0.0}}}, {}).has_value());
}

}  // namespace

int main() {
  return check::at_each_level("exponential", [] {
    test_shapes();
    test_oscillations();
    test_linear();
    test_search();
    test_least_squares();
    test_weights();
  });
}
