#include "gmwm/whitening.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/pause.hpp"

namespace gmwm {

namespace {

// Several sections of a cascade in one pass over the samples, because each waits for its own last sample.
template <std::size_t n>
void cascade(const double* coefficients, double* state, std::span<double> x) {
  double c[n][5], s1[n], s2[n];
  for (std::size_t k = 0; k < n; ++k) {
    const double* of = coefficients + 6 * k;
    c[k][0] = of[0], c[k][1] = of[1], c[k][2] = of[2], c[k][3] = of[4], c[k][4] = of[5];
    s1[k] = state[2 * k], s2[k] = state[2 * k + 1];
  }
  for (double& value : x)
    for (std::size_t k = 0; k < n; ++k) {
      const double y = c[k][0] * value + s1[k];
      s1[k] = c[k][1] * value - c[k][3] * y + s2[k];
      s2[k] = c[k][2] * value - c[k][4] * y;
      value = y;
    }
  for (std::size_t k = 0; k < n; ++k) state[2 * k] = s1[k], state[2 * k + 1] = s2[k];
}

}  // namespace

void second_order_sections(std::span<const double> sections, std::span<double> state, std::span<double> x) {
  const std::size_t count = sections.size() / 6;
  std::size_t k = 0;
  for (; k + 4 <= count; k += 4) cascade<4>(&sections[6 * k], &state[2 * k], x);
  if (count - k == 3) cascade<3>(&sections[6 * k], &state[2 * k], x);
  if (count - k == 2) cascade<2>(&sections[6 * k], &state[2 * k], x);
  if (count - k == 1) cascade<1>(&sections[6 * k], &state[2 * k], x);
}

namespace {

// The lower factor of a positive definite matrix with its square roots, row by row.
void cholesky(const double* matrix, std::size_t m, double* factor) {
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t j = 0; j <= i; ++j) {
      double sum = matrix[i * m + j];
      for (std::size_t k = 0; k < j; ++k) sum -= factor[i * m + k] * factor[j * m + k];
      factor[i * m + j] = i == j ? std::sqrt(sum) : sum / factor[j * m + j];
    }
}

// y with L y = x.
void forward(const double* factor, std::size_t m, const double* x, std::size_t stride, double* y) {
  for (std::size_t i = 0; i < m; ++i) {
    double sum = x[i * stride];
    for (std::size_t k = 0; k < i; ++k) sum -= factor[i * m + k] * y[k];
    y[i] = sum / factor[i * m + i];
  }
}

std::vector<double> inverse(const std::vector<double>& matrix, std::size_t m) {
  std::vector<double> factor(m * m), columns(m * m), unit(m), out(m * m);
  cholesky(matrix.data(), m, factor.data());
  for (std::size_t i = 0; i < m; ++i) {
    unit.assign(m, 0.0);
    unit[i] = 1.0;
    forward(factor.data(), m, unit.data(), 1, &columns[i * m]);
  }
  for (std::size_t i = 0; i < m; ++i)
    for (std::size_t j = 0; j < m; ++j)
      for (std::size_t k = 0; k < m; ++k) out[i * m + j] += columns[i * m + k] * columns[j * m + k];
  return out;
}

// y = A x for a matrix (n, n).
std::vector<double> product(const std::vector<double>& matrix, const std::vector<double>& x) {
  const std::size_t n = x.size();
  std::vector<double> out(n);
  for (std::size_t i = 0; i < n; ++i)
    for (std::size_t k = 0; k < n; ++k) out[i] += matrix[i * n + k] * x[k];
  return out;
}

GMWM_INLINE void add_multiple_inline(const double* x, std::size_t n, double factor, double* out) {
  for (std::size_t i = 0; i < n; ++i) out[i] += factor * x[i];
}
constexpr Clones<add_multiple_inline> add_multiple{};

// The responses (m, frame) of samples `first` to `last` - 1 of a frame to each component.
void responses_to(std::span<const double> responses, std::size_t p, const std::vector<double>& power, std::size_t first,
                  std::size_t last, std::vector<double>& out) {
  const std::size_t frame = responses.size() / p, m = power.size() / p;
  out.assign(m * frame, 0.0);
  for (std::size_t j = 0; j < m; ++j)
    for (std::size_t k = 0; k < p; ++k)
      add_multiple(&responses[k * frame + first], last - first, power[k * m + j], &out[j * frame + first]);
}

GMWM_INLINE void add_neighbours_inline(double* x, std::size_t n, std::size_t step) {
  for (std::size_t i = 0; i < n; ++i) x[i] += x[i + step];
}
constexpr Clones<add_neighbours_inline> add_neighbours{};

// The entries of a matrix whose column, and if it is square also the row, is kept.
std::vector<double> kept_part(const std::vector<double>& matrix, const std::vector<bool>& kept, bool square) {
  std::vector<double> out;
  const std::size_t columns = kept.size();
  for (std::size_t i = 0; i < matrix.size(); ++i)
    if (kept[i % columns] && (!square || kept[i / columns])) out.push_back(matrix[i]);
  return out;
}

}  // namespace

void least_squares_innovations(const double* responses, std::size_t stride, double unknown,
                               std::span<double> information, std::span<double> moments, std::span<double> e) {
  const std::size_t m = moments.size();
  std::vector<double> factor(m * m), of_response(m), of_moments(m);
  Pause pause(256);
  for (std::size_t t = 0; t < e.size(); ++t) {
    pause();
    if (m == 1) {  // an unknown level, often for the whole recording
      const double response = responses[t], error = e[t], share = response / information[0];
      e[t] = share * response > unknown ? 0.0 : (error - share * moments[0]) / std::sqrt(1.0 + share * response);
      information[0] += response * response;
      moments[0] += response * error;
      continue;
    }
    const double* g = responses + t;
    cholesky(information.data(), m, factor.data());
    forward(factor.data(), m, g, stride, of_response.data());
    forward(factor.data(), m, moments.data(), 1, of_moments.data());
    double mean = 0, variance = 0;
    for (std::size_t k = 0; k < m; ++k) {
      mean += of_response[k] * of_moments[k];
      variance += of_response[k] * of_response[k];
    }
    const double error = e[t];
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t k = 0; k < m; ++k) information[i * m + k] += g[i * stride] * g[k * stride];
      moments[i] += g[i * stride] * error;
    }
    e[t] = variance > unknown ? 0.0 : (error - mean) / std::sqrt(1.0 + variance);
  }
}

void subtract_initial_state(std::span<const double> responses, std::span<const double> step, double unknown,
                            double negligible, InitialState& state, std::span<double> e) {
  if (state.moments.empty()) return;
  const std::size_t p = state.power.size() / state.moments.size(), frame = responses.size() / p;
  std::vector<double> rows;
  std::size_t first = state.count % frame, known = std::min(frame, first + e.size());
  responses_to(responses, p, state.power, first, known, rows);
  bool whole = first == 0 && known == frame;
  while (!state.moments.empty() && !e.empty()) {
    const std::size_t m = state.moments.size(), n = std::min(e.size(), frame - first);
    least_squares_innovations(rows.data() + first, frame, unknown, state.information, state.moments, e.first(n));
    e = e.subspan(n);
    state.count += n;
    first = state.count % frame;
    if (first != 0) return;
    std::vector<double> power(p * m);
    for (std::size_t i = 0; i < p; ++i)
      for (std::size_t k = 0; k < p; ++k) add_multiple(&state.power[k * m], m, step[i * p + k], &power[i * m]);
    // The effect of a constant level is soon the same in every frame.
    if (!whole || power != state.power) responses_to(responses, p, power, 0, frame, rows);
    whole = true;
    state.power = power;
    const std::vector<double> covariance = inverse(state.information, m), mean = product(covariance, state.moments);
    std::vector<bool> kept(m);
    for (std::size_t k = 0; k < m; ++k) {
      double peak = 0.0;
      for (std::size_t i = 0; i < frame; ++i) peak = std::max(peak, std::abs(rows[k * frame + i]));
      kept[k] = peak * peak * (covariance[k * m + k] + mean[k] * mean[k]) > negligible;
    }
    const auto left = static_cast<std::size_t>(std::count(kept.begin(), kept.end(), true));
    if (left == m) continue;
    state.information = inverse(kept_part(covariance, kept, true), left);
    state.moments = product(state.information, kept_part(mean, kept, false));
    state.power = kept_part(state.power, kept, false);
    responses_to(responses, p, state.power, 0, frame, rows);
  }
}

std::vector<double> block_mean_squares(std::span<const double> sums, std::size_t m, std::size_t length) {
  const std::size_t blocks = sums.size() < m ? 0 : (sums.size() - m + 1) / length, half = m / 2;
  constexpr std::size_t together = 64;  // blocks, which are in the cache of the processor
  std::vector<double> part(together * length + m - 1), out(blocks);
  for (std::size_t first = 0; first < blocks; first += together) {
    const std::size_t count = std::min(together, blocks - first);
    std::size_t n = count * length + m - 1;
    std::copy_n(&sums[first * length], n, part.begin());
    // Sums of 2, then of 4 consecutive entries, by adding neighbours.
    for (std::size_t step = 1; step < half; n -= step, step *= 2) add_neighbours(part.data(), n - step, step);
    for (std::size_t b = 0; b < count; ++b) {
      const double* of = &part[b * length];
      double squares = 0.0;
      for (std::size_t i = 0; i < length; ++i) squares += (of[i + half] - of[i]) * (of[i + half] - of[i]);
      out[first + b] = squares / static_cast<double>(length);
    }
  }
  return out;
}

}  // namespace gmwm
