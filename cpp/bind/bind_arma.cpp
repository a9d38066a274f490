#include <nanobind/nanobind.h>
#include <nanobind/stl/array.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>

#include "arrays.hpp"
#include "gmwm/arma.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

using Orders = std::array<std::size_t, 5>;
using Lags = Input<std::int64_t, 1>;

void require(bool fits, const char* what) {
  if (!fits) throw std::invalid_argument(what);
}

gmwm::ArmaOrders orders_of(const Orders& given, std::size_t parameters) {
  const gmwm::ArmaOrders orders{given[0], given[1], given[2], given[3], given[4]};
  // 2^24 coefficients take 128 MB. A season of a day has 2^24 samples at 194 Hz.
  constexpr std::size_t most = std::size_t{1} << 24;
  require(orders.period >= 1 && std::all_of(given.begin(), given.end(), [](std::size_t n) { return n <= most; }) &&
              fits(std::max(given[2], given[3]) + 1, orders.period, most),
          "the period must be at least 1, and the polynomials have at most 2^24 coefficients");
  require(parameters == orders.parameters(), "there must be as many parameters as orders");
  return orders;
}

void shapes(const Orders& given, const Matrix& parameters, const Vector& odd, const OutMatrix& out) {
  const gmwm::ArmaOrders orders = orders_of(given, parameters.shape(1));
  require(out.shape(0) == parameters.shape(0), "out must have a row for each row of parameters");
  const nb::gil_scoped_release release;
  gmwm::arma_shapes(orders, view(parameters), parameters.shape(0), view(odd), out.shape(1), view(out));
}

void slopes(const Orders& given, const Matrix& parameters, const Vector& odd, const OutCube& out) {
  const gmwm::ArmaOrders orders = orders_of(given, parameters.shape(1));
  require(out.shape(0) == parameters.shape(0) && out.shape(1) == parameters.shape(1),
          "out must have a row for each parameter of each row");
  const nb::gil_scoped_release release;
  gmwm::arma_slopes(orders, view(parameters), parameters.shape(0), view(odd), out.shape(2), view(out));
}

void coordinates(const Matrix& coefficients, const OutMatrix& out) {
  require(coefficients.shape(1) >= 1, "coefficients must have at least one column");
  require(out.shape(0) == coefficients.shape(0) && out.shape(1) == coefficients.shape(1),
          "out must have the shape of coefficients");
  gmwm::arma_coordinates(view(coefficients), coefficients.shape(1), view(out));
}

std::span<const std::int64_t> ascending(const Lags& lags, const OutVector& out) {
  require(lags.size() == out.size(), "out must be as long as the lags");
  for (std::size_t k = 0; k < lags.size(); ++k)
    require(lags.data()[k] >= (k == 0 ? 0 : lags.data()[k - 1]), "lags must ascend from 0 or more");
  return {lags.data(), lags.size()};
}

void autocovariance(const Orders& given, const Vector& parameters, const Lags& lags, bool from_zero,
                    const OutVector& out) {
  const gmwm::ArmaOrders orders = orders_of(given, parameters.size());
  gmwm::arma_autocovariance(orders, view(parameters), ascending(lags, out), from_zero, view(out));
}

void without(const Orders& given, const Vector& parameters, const Matrix& roots, const OutMatrix& exponentials,
             const OutVector& out) {
  const gmwm::ArmaOrders orders = orders_of(given, parameters.size());
  const std::size_t count = roots.shape(1);
  require(roots.shape(0) == 2 && exponentials.shape(0) == 4 && exponentials.shape(1) == count,
          "roots must have two rows, and exponentials four rows of the same length");
  require(count <= orders.full_ar(), "there are no more roots than the order");
  const auto row = [count](auto* data, std::size_t k) { return std::span{data + k * count, count}; };
  double* found = exponentials.data();
  gmwm::arma_without(orders, view(parameters), {row(roots.data(), 0), row(roots.data(), 1)},
                     {row(found, 0), row(found, 1), row(found, 2), row(found, 3)}, view(out));
}

void block_variance(const Orders& given, const Vector& parameters, const Lags& sizes, const OutVector& out) {
  const gmwm::ArmaOrders orders = orders_of(given, parameters.size());
  gmwm::arma_block_variance(orders, view(parameters), ascending(sizes, out), view(out));
}

void recursion(const Orders& given, const Vector& parameters, const OutVector& phi, const OutVector& theta,
               const OutMatrix& predictors, const OutVector& deviations) {
  const gmwm::ArmaOrders orders = orders_of(given, parameters.size());
  const std::size_t p = orders.full_ar();
  require(phi.size() == p && theta.size() == orders.full_ma(), "phi and theta must be as long as the polynomials");
  require(predictors.shape(0) == p && predictors.shape(1) == p && deviations.size() == p,
          "predictors and deviations must have a row for each coefficient of phi");
  gmwm::arma_recursion(orders, view(parameters), view(phi), view(theta), view(predictors), view(deviations));
}

}  // namespace

void bind_arma(nb::module_& m) {
  m.def("arma_shapes", &shapes, "orders"_a, "parameters"_a.noconvert(), "odd"_a.noconvert(), "out"_a.noconvert(),
        "Write the wavelet variances (rows, levels) of ARMA processes of rows of parameters to out.");
  m.def("arma_slopes", &slopes, "orders"_a, "parameters"_a.noconvert(), "odd"_a.noconvert(), "out"_a.noconvert(),
        "Write their derivatives (rows, parameters, levels) to out.");
  m.def("arma_coordinates", &coordinates, "coefficients"_a.noconvert(), "out"_a.noconvert(),
        "Write artanh of the partial autocorrelations of each row to out; NaN where it is not stationary.");
  m.def("arma_autocovariance", &autocovariance, "orders"_a, "parameters"_a.noconvert(), "lags"_a.noconvert(),
        "from_zero"_a, "out"_a.noconvert(), "Write the autocovariance at ascending lags, less that at 0 if wanted.");
  m.def("arma_without", &without, "orders"_a, "parameters"_a.noconvert(), "roots"_a.noconvert(),
        "exponentials"_a.noconvert(), "out"_a.noconvert(),
        "Write the autocovariance at lags 0, 1, … without the exponentials of some roots (real parts, imaginary parts),\n"
        "and the real and imaginary parts of their amplitudes and decays.");
  m.def("arma_block_variance", &block_variance, "orders"_a, "parameters"_a.noconvert(), "sizes"_a.noconvert(),
        "out"_a.noconvert(), "Write the variances of sums of ascending numbers of samples to out.");
  m.def("arma_recursion", &recursion, "orders"_a, "parameters"_a.noconvert(), "phi"_a.noconvert(),
        "theta"_a.noconvert(), "predictors"_a.noconvert(), "deviations"_a.noconvert(),
        "Write the full polynomials, and the predictors and their errors that paths start by.");
}
