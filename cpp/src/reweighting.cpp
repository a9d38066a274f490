#include "gmwm/reweighting.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "gmwm/dense.hpp"
#include "gmwm/differences.hpp"
#include "gmwm/exponential.hpp"

namespace gmwm {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();
constexpr double white_decay = 40;         // beyond it, the process is white noise to rounding
constexpr double wandering_decay = 1e-40;  // below it, a random walk, because 1 / decay² would overflow

// Covariances for (-1)^k exp(-decay |k|): a sum of nine terms, without constants that cancel.
void alternating_differences(const Nodes& nodes, std::span<const std::uint8_t> odd, double decay, std::span<double> out) {
  const double phi = -std::exp(-decay), share = decay > 0.5 ? (1 + phi) / (1 - phi) : std::tanh(decay / 2);
  white_differences(nodes, out);
  for (std::size_t i = 0; i < out.size(); ++i) {
    const double h = nodes.fine[i], k = nodes.coarse[i], u = nodes.lag[i];
    const bool at_odd = odd[i] != 0;
    // Even offsets keep the sign and the weights sum to 0, so the constants remain only where both half-scales are 1.
    double total = h == 1 && k == 1 ? (at_odd ? -16 : 16) : 0;
    for (const auto& [a, weight_a] : {std::pair{0.0, 1.0}, {1.0, -2.0}, {2.0, 1.0}})
      for (const auto& [b, weight_b] : {std::pair{0.0, 1.0}, {1.0, -2.0}, {2.0, 1.0}}) {
        const bool flips = std::fmod((at_odd ? 1 : 0) + a * h + b * k, 2) != 0;
        total += weight_a * weight_b * (flips ? -1 : 1) * std::expm1(-decay * std::abs(u - b * k + a * h));
      }
    out[i] = share * out[i] - phi / ((1 - phi) * (1 - phi)) * total;
  }
}

// The factor of the fourth cumulant from coefficients with a common error, of a level with itself.
double excess(double h, double samples) {
  double total = 0;
  for (const auto& [a, weight_a] : {std::pair{0.0, 1.0}, {1.0, 4.0}, {2.0, 1.0}})
    for (const auto& [b, weight_b] : {std::pair{0.0, 1.0}, {1.0, 4.0}, {2.0, 1.0}}) {
      const double lag = b * h - a * h, first = std::max(2 * h - 1, 2 * h - 1 - lag);
      const double last = samples - 1 - std::max(lag, 0.0);
      total += weight_a * weight_b * std::max(last - first + 1, 0.0);
    }
  return total;
}

double largest_change(const std::vector<double>& before, const std::vector<double>& after) {
  double largest = 0;
  for (std::size_t j = 0; j < before.size(); ++j) {
    const double scale = std::max(before[j], after[j]);
    largest = std::max(largest, std::abs(after[j] - before[j]) / (scale > 0 ? scale : 1));
  }
  return largest;
}

}  // namespace

std::vector<double> least_squares(std::vector<std::vector<double>> columns, const std::vector<double>& b, double cutoff) {
  const std::size_t m = columns.size(), n = b.size();
  std::vector<double> turns(m * m, 0.0);  // the product of the rotations, row by row
  for (std::size_t i = 0; i < m; ++i) turns[i * m + i] = 1;
  // One-sided Jacobi: rotations of pairs of columns until all are orthogonal.
  bool turned = true;
  for (int sweep = 0; sweep < 60 && turned; ++sweep) {
    turned = false;
    for (std::size_t p = 0; p < m; ++p)
      for (std::size_t q = p + 1; q < m; ++q) {
        const double *u = columns[p].data(), *v = columns[q].data();
        const double uu = dot(u, u, n), vv = dot(v, v, n), uv = dot(u, v, n);
        if (!(std::abs(uv) > 1e-16 * std::sqrt(uu * vv))) continue;
        turned = true;
        const double zeta = (vv - uu) / (2 * uv);
        const double t = std::copysign(1.0, zeta) / (std::abs(zeta) + std::hypot(1.0, zeta));
        const double c = 1 / std::hypot(1.0, t), s = c * t;
        const auto rotate = [c, s](double& x, double& y) {
          const double old = x;
          x = c * old - s * y, y = s * old + c * y;
        };
        for (std::size_t i = 0; i < n; ++i) rotate(columns[p][i], columns[q][i]);
        for (std::size_t i = 0; i < m; ++i) rotate(turns[i * m + p], turns[i * m + q]);
      }
  }
  double largest = 0;
  std::vector<double> squares(m), x(m, 0.0);
  for (std::size_t k = 0; k < m; ++k) {
    squares[k] = dot(columns[k].data(), columns[k].data(), n);
    largest = std::max(largest, squares[k]);
  }
  for (std::size_t k = 0; k < m; ++k) {
    if (!(squares[k] > cutoff * cutoff * largest)) continue;
    const double along = dot(columns[k].data(), b.data(), n) / squares[k];
    for (std::size_t i = 0; i < m; ++i) x[i] += turns[i * m + k] * along;
  }
  return x;
}

Mixing::Logarithms Mixing::logarithms(const Estimate& at) const {
  Logarithms found;
  const auto add = [&](std::size_t name, double value) {
    value = std::abs(value);
    if (!(value > 0 && value < infinity)) return;
    found.names.push_back(name);
    found.values.push_back(std::log(value));
  };
  for (std::size_t i = 0; i < at.curved.size(); ++i) {
    add(2 * i, at.curved[i].first);
    add(2 * i + 1, at.curved[i].second);
  }
  for (std::size_t l = 0; l < at.linear.size(); ++l)
    add(2 * at.curved.size() + l, std::pow(at.linear[l], 1 / setting_.powers[l]));
  return found;
}

Estimate Mixing::next(const Estimate& found) {
  const Logarithms now = logarithms(found);
  if (now.names != given_.names)
    pairs_.clear();
  else
    pairs_.emplace_back(given_.values, now.values);
  given_ = now;
  if (pairs_.size() < 2) return found;
  if (pairs_.size() > setting_.options.mixed) pairs_.erase(pairs_.begin());
  const std::size_t size = now.values.size(), last = pairs_.size() - 1;
  const auto residual = [&](std::size_t k, std::size_t i) { return pairs_[k].second[i] - pairs_[k].first[i]; };
  std::vector<std::vector<double>> columns(last, std::vector<double>(size));
  std::vector<double> b(size);
  for (std::size_t i = 0; i < size; ++i) {
    b[i] = residual(last, i);
    for (std::size_t k = 0; k < last; ++k) columns[k][i] = residual(k + 1, i) - residual(k, i);
  }
  const std::vector<double> share = least_squares(std::move(columns), b, setting_.options.cutoff);
  Estimate there = found;
  for (std::size_t i = 0; i < size; ++i) {
    double reach = 0;
    for (std::size_t k = 0; k < last; ++k) reach -= share[k] * (pairs_[k + 1].second[i] - pairs_[k].second[i]);
    const double factor = std::exp(std::clamp(reach, -setting_.options.far, setting_.options.far));
    const std::size_t name = now.names[i], first = 2 * found.curved.size();
    if (name >= first)
      there.linear[name - first] *= std::pow(factor, setting_.powers[name - first]);
    else if (name % 2 == 0)
      there.curved[name / 2].first *= factor;
    else
      there.curved[name / 2].second *= factor;
  }
  // An extrapolated coefficient of an autoregression may not be stationary.
  if (curve_.innovation())
    for (const auto& term : there.curved)
      if (!(std::abs(term.first) < 1)) return found;
  given_ = logarithms(there);
  return there;
}

Reweighting::Reweighting(Setting setting, ExponentialCurve curve, SearchLimits limits)
    : setting_(std::move(setting)), curve_(std::move(curve)), limits_(std::move(limits)) {}

std::vector<double> Reweighting::curve_of(const Estimate& at) const {
  const std::size_t dim = curve_.dim();
  std::vector<double> total(dim, 0.0), shape(dim);
  for (const auto& [parameter, scale] : at.curved) {
    curve_.shape_of(parameter, shape.data());
    for (std::size_t j = 0; j < dim; ++j) total[j] += scale * shape[j];
  }
  for (std::size_t l = 0; l < at.linear.size(); ++l)
    for (std::size_t j = 0; j < dim; ++j) total[j] += at.linear[l] * setting_.shapes[l * dim + j];
  return total;
}

const Lags& Reweighting::lags_of(std::size_t segment, double slowest, double fastest, bool alternating) {
  const auto [found, fresh] = lags_.try_emplace({segment, slowest, fastest, alternating});
  if (fresh) {
    const Segment& own = setting_.segments[segment];
    found->second = covariance_lags(std::span(setting_.levels).first(own.levels), own.samples,
                                    {slowest, fastest, alternating, true, 0});
  }
  return found->second;
}

std::vector<double> Reweighting::variances(const Estimate& at) {
  struct Exponential {
    double variance, sign, decay;
  };
  std::vector<Exponential> present;
  double slowest = infinity, fastest = 0, slope = 0, cumulant = 0;
  bool alternating = false;
  for (const auto& [parameter, scale] : at.curved) {
    if (!(scale > 0)) continue;
    const double decay = curve_.decay(parameter);
    const double sign = curve_.innovation() ? std::copysign(1.0, parameter) : 1.0;
    present.push_back({curve_.innovation() ? scale / -std::expm1(-2 * decay) : scale, sign, decay});
    slowest = std::min(slowest, decay), fastest = std::max(fastest, decay);
    alternating = alternating || sign < 0;
  }
  // Ends of the rates that are rounded outwards serve all iterations.
  slowest = present.empty() ? 0 : std::exp2(std::floor(std::log2(slowest)));
  fastest = present.empty() ? 0 : std::exp2(std::ceil(std::log2(fastest)));
  std::vector<double> total(curve_.dim(), 0.0), covariance, part;
  for (std::size_t l = 0; l < at.linear.size(); ++l) {
    if (setting_.kinds[l] == Elementary::drift) slope += at.linear[l];
    if (setting_.kinds[l] == Elementary::spike) cumulant += setting_.options.cumulant * at.linear[l] * at.linear[l];
  }
  for (std::size_t s = 0; s < setting_.segments.size(); ++s) {
    const Lags& lags = lags_of(s, slowest, fastest, alternating);
    const gmwm::Nodes nodes{{lags.fine.get(), lags.size}, {lags.coarse.get(), lags.size}, {lags.lag.get(), lags.size}};
    const Pieces pieces{lags.piece_first, lags.piece_pattern, lags.pattern_begins, lags.pattern_offsets};
    covariance.assign(lags.size, 0.0);
    part.resize(lags.size);
    const auto add = [&](double scale) {
      for (std::size_t i = 0; i < lags.size; ++i) covariance[i] += scale * part[i];
    };
    for (const auto& [variance, sign, decay] : present) {
      if (sign < 0) {
        alternating_differences(nodes, lags.odd, decay, part);
      } else if (decay > white_decay) {
        white_differences(nodes, part);
      } else if (decay < wandering_decay) {
        walk_differences(nodes, part);
        for (double& value : part) value *= 2 * decay;
      } else {
        exponential_differences(nodes, pieces, decay, part);
      }
      add(variance);
    }
    for (std::size_t l = 0; l < at.linear.size(); ++l) {
      const Elementary kind = setting_.kinds[l];
      if (!(at.linear[l] > 0) || kind == Elementary::drift) continue;
      (kind == Elementary::white ? white_differences : kind == Elementary::walk ? walk_differences : spike_differences)(
          nodes, part);
      add(at.linear[l]);
    }
    const Segment& own = setting_.segments[s];
    for (std::size_t j = 0; j < own.levels; ++j) {
      const auto begin = static_cast<std::size_t>(lags.starts[j]);
      const auto end = j + 1 < own.levels ? static_cast<std::size_t>(lags.starts[j + 1]) : lags.size;
      double first = 0, second = 0;
      for (std::size_t i = begin; i < end; ++i) {
        first += lags.weight[i] * covariance[i];
        second += lags.weight[i] * covariance[i] * covariance[i];
      }
      const double h = curve_.half_scales()[j], scale = 4 * h * h;
      double sum = 2 / (scale * scale) * second;
      if (slope > 0) sum += slope * h * h / scale * first;
      if (cumulant != 0) sum += cumulant * excess(h, static_cast<double>(own.samples)) / (scale * scale);
      total[j] += own.times * sum;
    }
  }
  for (std::size_t j = 0; j < total.size(); ++j) total[j] /= setting_.counts[j] * setting_.counts[j];
  return total;
}

// 1 / V_jj, with V scaled from the curve to its average with the data.
std::optional<std::vector<double>> Reweighting::weights_of(const Estimate& at) {
  const std::vector<double> curve = curve_of(at);
  std::vector<double> weights = variances(at);
  const bool positive = std::all_of(curve.begin(), curve.end(), [](double v) { return v > 0; });
  for (std::size_t j = 0; j < weights.size(); ++j) {
    double variance = setting_.loss * weights[j];
    if (!setting_.added.empty()) variance += setting_.added[j] * curve[j] * curve[j];
    const double freedom = setting_.freedom[j], prior = setting_.options.prior;
    const double scale = positive ? (freedom * setting_.observed[j] / curve[j] + prior) / (freedom + prior) : 1;
    weights[j] = 1 / (variance * scale * scale);
    if (!std::isfinite(weights[j]) || !(weights[j] > 0)) return std::nullopt;
  }
  return weights;
}

ExponentialSearch Reweighting::search_under(const std::vector<double>& weights, double& unit) const {
  const std::size_t dim = weights.size();
  std::vector<double> root(dim * dim, 0.0), target(dim), fixed(setting_.shapes);
  double largest = 0, square = 0;
  for (std::size_t j = 0; j < dim; ++j) {
    root[j * dim + j] = std::sqrt(weights[j]);
    target[j] = root[j * dim + j] * setting_.observed[j];
    largest = std::max(largest, std::abs(target[j]));
    square += target[j] * target[j];
  }
  unit = largest > 0 ? std::exp2(std::floor(std::log2(largest))) : 1;
  for (double& value : target) value /= unit;
  for (std::size_t l = 0; l < setting_.kinds.size(); ++l) {
    double* row = &fixed[l * dim];
    for (std::size_t j = 0; j < dim; ++j) row[j] *= root[j * dim + j];
    const double size = std::sqrt(dot(row, row, dim));
    for (std::size_t j = 0; j < dim; ++j) row[j] /= size;
  }
  return {curve_, limits_, target, fixed, root, setting_.rounding * std::sqrt(square) / unit};
}

Estimate Reweighting::estimate_of(const Optimum& best, const std::vector<double>& weights, double unit) const {
  const std::size_t dim = weights.size(), linear = setting_.kinds.size();
  const auto scale = [&](const double* shape, double weight) {
    double square = 0;
    for (std::size_t j = 0; j < dim; ++j) square += weights[j] * shape[j] * shape[j];
    return weight * unit / std::sqrt(square);
  };
  Estimate found;
  std::vector<double> shape(dim);
  for (std::size_t l = 0; l < linear; ++l) found.linear.push_back(scale(&setting_.shapes[l * dim], best.weights[l]));
  for (std::size_t i = 0; i < best.places.size(); ++i) {
    const double parameter = curve_.parameter(best.places[i].branch, best.places[i].u);
    curve_.shape_of(parameter, shape.data());
    found.curved.emplace_back(parameter, scale(shape.data(), best.weights[linear + i]));
  }
  // Terms without weight have no place; they get the shortest correlation time.
  while (found.curved.size() < setting_.curved) found.curved.emplace_back(curve_.parameter(0, curve_.branch(0).high), 0.0);
  sort(found);
  return found;
}

void Reweighting::sort(Estimate& estimate) const {
  const auto time = [&](double parameter) { return parameter == 0 ? 0 : 1 / curve_.decay(parameter); };
  std::stable_sort(estimate.curved.begin(), estimate.curved.end(), [&](const auto& a, const auto& b) {
    return std::pair(time(a.first), a.first) < std::pair(time(b.first), b.first);
  });
}

std::optional<Reweighted> Reweighting::run(Estimate estimate, std::vector<Place> places) {
  Reweighted found;
  Mixing mixing(setting_, curve_);
  sort(estimate);
  std::vector<double> implied = curve_of(estimate), history;
  for (std::size_t round = 0; round < setting_.options.rounds; ++round) {
    auto weights = weights_of(mixing.next(estimate));
    if (!weights) return std::nullopt;
    double unit = 1;
    found.best = search_under(*weights, unit).followed(places);
    places = found.best.places;
    estimate = estimate_of(found.best, *weights, unit);
    found.weights = std::move(*weights);
    std::vector<double> after = curve_of(estimate);
    found.change = largest_change(implied, after);
    implied = std::move(after);
    // The steps shrink by at least the last ratio.
    const bool ratio = !history.empty() && history.back() > 0;
    found.expected = ratio ? found.change * std::min(1.0, found.change / history.back()) : found.change;
    history.push_back(found.change);
    const std::size_t hope = setting_.options.hope;
    if (found.expected <= setting_.options.fixed) break;
    if (history.size() > hope && found.change > history[history.size() - hope - 1] / 2) break;
  }
  return found;
}

}  // namespace gmwm
