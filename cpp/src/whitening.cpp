#include "gmwm/whitening.hpp"

#include <cmath>
#include <vector>

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
  for (; k < count; ++k) cascade<1>(&sections[6 * k], &state[2 * k], x);
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
void forward(const double* factor, std::size_t m, const double* x, double* y) {
  for (std::size_t i = 0; i < m; ++i) {
    double sum = x[i];
    for (std::size_t k = 0; k < i; ++k) sum -= factor[i * m + k] * y[k];
    y[i] = sum / factor[i * m + i];
  }
}

}  // namespace

void least_squares_innovations(std::span<const double> responses, double unknown, std::span<double> information,
                               std::span<double> moments, std::span<double> e) {
  const std::size_t m = moments.size();
  std::vector<double> factor(m * m), of_response(m), of_moments(m);
  Pause pause(256);
  for (std::size_t t = 0; t < e.size(); ++t) {
    pause();
    const double* g = responses.data() + t * m;
    cholesky(information.data(), m, factor.data());
    forward(factor.data(), m, g, of_response.data());
    forward(factor.data(), m, moments.data(), of_moments.data());
    double mean = 0, variance = 0;
    for (std::size_t k = 0; k < m; ++k) {
      mean += of_response[k] * of_moments[k];
      variance += of_response[k] * of_response[k];
    }
    const double error = e[t];
    for (std::size_t i = 0; i < m; ++i) {
      for (std::size_t k = 0; k < m; ++k) information[i * m + k] += g[i] * g[k];
      moments[i] += g[i] * error;
    }
    e[t] = variance > unknown ? 0.0 : (error - mean) / std::sqrt(1.0 + variance);
  }
}

}  // namespace gmwm
