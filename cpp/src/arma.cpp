// Built with -ffp-contract=off (CMakeLists.txt), see twofold.hpp.
#include "gmwm/arma.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "gmwm/arma_ring.hpp"

namespace gmwm {

namespace {

constexpr double nothing = std::numeric_limits<double>::quiet_NaN();

// Inputs of a run over rows. A task is a row, or a row with the parameter of a derivative.
struct Run {
  const ArmaOrders& orders;
  const double* parameters;
  const double* odd;
  std::size_t reach;  // length of `odd`; 0 for the Haar filter
  std::size_t levels;
  std::size_t directions;  // 0 for values
  double* out;
};

template <std::size_t W>
GMWM_INLINE void seed(Twofold<W>& to, std::size_t l, double value, bool) {
  to.high[l] = value, to.low[l] = 0.0;
}

template <std::size_t W>
GMWM_INLINE void seed(Sloped<W>& to, std::size_t l, double value, bool along) {
  seed(to.value, l, value, false);
  seed(to.slope, l, along ? 1.0 : 0.0, false);
}

// ν_j² = D_h/(2h²), D_h = Var(sum of h) − Cov(adjacent sums of h), and D_2h = 2 D_h + L(z S² (1 − u)(3 + u)) with
// u = z^h and S = 1 + z + … + z^(h−1). For a slowly varying process all terms are positive, so nothing cancels. v is 1
// − u.
template <class T, class Store>
GMWM_INLINE void haar(ArmaRing<T>& ring, std::size_t levels, T* S, T* v, T* a, T* b, Store store) {
  const std::size_t m = ring.m;
  ring.constant(1.0, S);
  ring.constant(1.0, a);
  ring.shift(a);
  ring.constant(1.0, v);
  for (std::size_t n = 0; n < m; ++n) v[n] = v[n] - a[n];
  T D = ring.r[0] - ring.r[1];
  for (std::size_t j = 1; j <= levels; ++j) {
    store(j, std::ldexp(1.0, 1 - 2 * static_cast<int>(j)) * D);
    if (j == levels) break;
    ring.product(S, v, a);
    for (std::size_t n = 0; n < m; ++n) b[n] = 4.0 * S[n] - a[n];
    D = 2.0 * D + ring.later(a, b);
    for (std::size_t n = 0; n < m; ++n) S[n] = 2.0 * S[n] - a[n];
    ring.product(v, v, a);
    for (std::size_t n = 0; n < m; ++n) v[n] = 2.0 * v[n] - a[n];
  }
}

// The covariance c(k) of the scaling coefficients at every 2^j-th sample, computed from level to level: as values at
// lags below `from`, and as L(x Z^(k − from)), Z = z^(2^j), beyond. The autocorrelation of an orthonormal scaling
// filter is 1/2 at lag 0 and 0 at other even lags. For the wavelet filter, the signs at odd lags are reversed. These
// relations hold exactly, in spite of rounded filter taps, because `odd` is scaled to a sum of 1/4 in double-double
// arithmetic.
template <class T, class Store>
GMWM_INLINE void filtered(ArmaRing<T>& ring, const Run& run, T* x, T* Z, T* next, Store store) {
  const std::size_t m = ring.m, reach = 2 * run.reach - 1, most = 4 * reach + 4;
  std::vector<T> known(2 * most), taps(run.reach);
  T *c = known.data(), *near = c + most, total = T::of(0.0);
  for (std::size_t i = 0; i < run.reach; ++i) total = total + T::of(run.odd[i]);
  const T scale = 0.25 * total.inverse();
  for (std::size_t i = 0; i < run.reach; ++i) taps[i] = T::of(run.odd[i]) * scale;
  std::size_t from = 0;
  ring.constant(1.0, x);
  ring.constant(1.0, Z);
  ring.shift(Z);
  for (std::size_t j = 1; j <= run.levels; ++j) {
    const std::size_t then = (from + reach + 1) / 2, top = 2 * then + reach;
    for (std::size_t n = 0; n < m; ++n) next[n] = T::of(0.0);
    for (std::size_t k = from; k <= top; ++k) {
      c[k] = ring.at(x);
      const std::size_t lag = k < 2 * then ? 2 * then - k : k - 2 * then;
      if (lag % 2 == 1 && lag <= reach)
        for (std::size_t n = 0; n < m; ++n) next[n] = next[n] + taps[lag / 2] * x[n];
      else if (lag == 0)
        for (std::size_t n = 0; n < m; ++n) next[n] = next[n] + 0.5 * x[n];
      ring.product(x, Z, x);
    }
    T sum = 0.5 * c[0];
    for (std::size_t i = 0; i < run.reach; ++i) sum = sum - 2.0 * (taps[i] * c[2 * i + 1]);
    store(j, sum);
    for (std::size_t k = 0; k < then; ++k) {
      T value = 0.5 * c[2 * k];
      for (std::size_t i = 0; i < run.reach; ++i) {
        const std::size_t n = 2 * i + 1, before = 2 * k > n ? 2 * k - n : n - 2 * k;
        value = value + taps[i] * (c[before] + c[2 * k + n]);
      }
      near[k] = value;
    }
    std::copy_n(near, then, c);
    std::copy_n(next, m, x);
    ring.product(Z, Z, Z);
    from = then;
  }
}

template <class T>
GMWM_INLINE void tasks(const Run& run, std::size_t begin, std::size_t end) {
  constexpr std::size_t W = T::lanes;
  const std::size_t many = run.orders.parameters();
  ArmaRing<T> ring(run.orders);
  std::vector<T> scratch(many + 4 * ring.m);
  T *parameters = scratch.data(), *elements = parameters + many;
  for (std::size_t first = begin; first < end; first += W) {
    bool stationary[W];
    for (std::size_t l = 0; l < W; ++l) {
      const std::size_t task = std::min(first + l, end - 1);
      const std::size_t row = run.directions ? task / run.directions : task;
      for (std::size_t k = 0; k < many; ++k)
        seed(parameters[k], l, run.parameters[row * many + k], run.directions && k == task % run.directions);
      stationary[l] = true;
    }
    ring.multiply_out(parameters);
    ring.covariances(stationary);
    const auto store = [&](std::size_t level, const T& variance) {
      for (std::size_t l = 0; l < W && first + l < end; ++l)
        run.out[(first + l) * run.levels + level - 1] = stationary[l] ? variance.shown(l) : nothing;
    };
    const std::size_t m = ring.m;
    if (run.reach == 0)
      haar(ring, run.levels, elements, elements + m, elements + 2 * m, elements + 3 * m, store);
    else
      filtered(ring, run, elements, elements + m, elements + 2 * m, store);
  }
}

// Eight rows or derivatives at once; one by one if there are few rows.
constexpr std::size_t wide = 8;

constexpr Clones<tasks<Twofold<wide>>> wide_values{};
constexpr Clones<tasks<Sloped<wide>>> wide_slopes{};
constexpr Clones<tasks<Twofold<1>>> single_values{};

GMWM_INLINE void coordinates_of_inline(const double* coefficients, std::size_t p, std::size_t rows, double* out) {
  using T = Twofold<1>;
  ArmaOrders orders;
  orders.ar = p;
  ArmaRing<T> ring(orders);
  std::vector<T> given(p + 1);
  for (std::size_t row = 0; row < rows; ++row) {
    for (std::size_t i = 1; i <= p; ++i) given[i] = T::of(coefficients[row * p + i - 1]);
    bool stationary = true;
    ring.step_down(given.data(), p, &stationary);
    for (std::size_t i = 1; i <= p; ++i) {
      const T k = ring.partial[i], above = T::of(1.0) + k, below = T::of(1.0) - k;
      // 2k/(1 − k) is accurate for small k.
      const double small = std::abs(k.high[0]) < 0.5 ? 0.5 * std::log1p(2.0 * k.high[0] / below.high[0])
                                                     : 0.5 * std::log((above * below.inverse()).high[0]);
      out[row * p + i - 1] = stationary ? small : nothing;
    }
  }
}
constexpr Clones<coordinates_of_inline> coordinates_of{};

}  // namespace

void arma_shapes(const ArmaOrders& orders, std::span<const double> parameters, std::size_t rows,
                 std::span<const double> odd, std::size_t levels, std::span<double> out) {
  const Run run{orders, parameters.data(), odd.data(), odd.size(), levels, 0, out.data()};
  rows < 3 ? single_values(run, 0, rows) : wide_values(run, 0, rows);
}

void arma_slopes(const ArmaOrders& orders, std::span<const double> parameters, std::size_t rows,
                 std::span<const double> odd, std::size_t levels, std::span<double> out) {
  const Run run{orders, parameters.data(), odd.data(), odd.size(), levels, orders.parameters(), out.data()};
  wide_slopes(run, 0, rows * orders.parameters());
}

void arma_coordinates(std::span<const double> coefficients, std::size_t p, std::span<double> out) {
  coordinates_of(coefficients.data(), p, coefficients.size() / p, out.data());
}

}  // namespace gmwm
