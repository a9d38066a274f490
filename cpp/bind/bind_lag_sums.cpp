#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstdint>
#include <numbers>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/hermite_sums.hpp"
#include "gmwm/lag_sums.hpp"
#include "gmwm/lag_table.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;

namespace {

using Process = std::tuple<double, double, Vector, Matrix, Input<std::uint8_t, 1>>;
using Sums = std::tuple<Result, Result>;

std::span<const double> row(const Matrix& exponentials, std::size_t k) {
  return {exponentials.data() + k * exponentials.shape(1), exponentials.shape(1)};
}

gmwm::LagProcess process_of(const Process& given) {
  const auto& [white, walk, spikes, exponentials, bare] = given;
  if (exponentials.shape(0) != 4 || bare.size() != exponentials.shape(1))
    throw nb::value_error("exponentials must have four rows, and bare must be as long as one of them");
  const gmwm::LagProcess process{white, walk, view(spikes), row(exponentials, 0), row(exponentials, 1),
                                 row(exponentials, 2), row(exponentials, 3), view(bare)};
  for (std::size_t p = 0; p < bare.size(); ++p) {
    const double re = process.decay_re[p], im = process.decay_im[p];
    if (!(re >= 0 && im >= 0 && im <= std::numbers::pi && re + im > 0 && re <= 700))
      throw nb::value_error("decays must have a real part from 0 to 700 and an imaginary part from 0 to pi");
  }
  return process;
}

std::span<const std::int64_t> levels_of(const Input<std::int64_t, 1>& levels, std::int64_t samples) {
  const std::span<const std::int64_t> wanted = view(levels);
  for (std::size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i] < 1 || wanted[i] > 60 || (i > 0 && wanted[i] <= wanted[i - 1]) ||
        (std::int64_t{1} << wanted[i]) > samples)
      throw nb::value_error("levels must ascend from 1, and 2^level not exceed samples");
  return wanted;
}

gmwm::LagTable* lag_table(const Input<std::int64_t, 1>& levels, std::int64_t samples, bool diagonal,
                          const Process& given) {
  const std::span<const std::int64_t> wanted = levels_of(levels, samples);
  const gmwm::LagProcess process = process_of(given);
  if (!process.spikes.empty() || std::any_of(process.decay_im.begin(), process.decay_im.end(), [](double im) { return im != 0; }))
    throw nb::value_error("a table needs a process without spikes, and with real decays");
  const nb::gil_scoped_release release;
  return new gmwm::LagTable(wanted, samples, diagonal, process);
}

Sums lag_sums(const Input<std::int64_t, 1>& levels, std::int64_t samples, bool diagonal, const Process& given,
              const std::vector<std::pair<const gmwm::LagTable*, double>>& tables) {
  const std::span<const std::int64_t> wanted = levels_of(levels, samples);
  const std::size_t size = wanted.size(), pairs = diagonal ? size : size * (size + 1) / 2;
  std::vector<double> first(pairs), second(pairs);
  std::vector<gmwm::TableFactor> factors;
  for (const auto& [table, factor] : tables) {
    if (table == nullptr) throw nb::value_error("a table is None");
    const std::vector<std::int64_t>& all = table->levels();
    if (table->samples() != samples || table->diagonal() != diagonal || all.size() < size ||
        !std::equal(wanted.begin(), wanted.end(), all.begin()))
      throw nb::value_error("a table must have the same samples, and these levels as its first ones");
    factors.push_back({table, factor});
  }
  const gmwm::LagProcess process = process_of(given);
  {
    const nb::gil_scoped_release release;
    gmwm::lag_sums(wanted, samples, diagonal, process, factors, {first, second});
  }
  return {to_numpy(std::move(first)), to_numpy(std::move(second))};
}

Sums hermite_sums(const Input<std::int64_t, 1>& levels, std::int64_t samples, bool diagonal, const Process& given,
                  const Vector& weights) {
  const std::span<const std::int64_t> wanted = levels_of(levels, samples);
  const gmwm::LagProcess process = process_of(given);
  if (weights.size() > gmwm::hermite_powers) throw nb::value_error("there are more weights than powers");
  const std::size_t size = wanted.size();
  std::vector<double> variances(size), sums(diagonal ? size : size * (size + 1) / 2);
  {
    const nb::gil_scoped_release release;
    gmwm::hermite_sums(wanted, samples, diagonal, process, view(weights), {variances, sums});
  }
  return {to_numpy(std::move(variances)), to_numpy(std::move(sums))};
}

}  // namespace

void bind_lag_sums(nb::module_& m) {
  nb::class_<gmwm::LagTable>(m, "LagTable",
                             "Covariances of Haar coefficients of one process, for sums of products with other processes.")
      .def(nb::new_(&lag_table), nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("diagonal"),
           nb::arg("process"));
  m.def("lag_sums", &lag_sums, nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("diagonal"),
        nb::arg("process"), nb::arg("tables"),
        "Sums over all lags of the covariances C of Haar coefficients of a process, and of C² + 2 C D, where D are the "
        "tables\ntimes their factors; see `gmwm.theory.processes.exponential_sum`.");
  m.def("hermite_sums", &hermite_sums, nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("diagonal"),
        nb::arg("process"), nb::arg("weights"),
        "The variances of the Haar coefficients of a process, and sums over all lags of the powers 4, 6, … of their "
        "correlations,\nwith weights; see `gmwm.measuring.covariance.gaussian`.");
}
