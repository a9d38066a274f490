#include <nanobind/nanobind.h>

#include <cstddef>
#include <span>
#include <stdexcept>

#include "arrays.hpp"
#include "gmwm/paths.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

std::span<double> all_rows(const OutMatrix& rows) {
  if (rows.shape(1) == 0) throw std::invalid_argument("values must have at least one column");
  return {rows.data(), rows.shape(0) * rows.shape(1)};
}

void autoregress(const OutMatrix& values, double phi, double first, double rest) {
  const std::span<double> all = all_rows(values);
  const nb::gil_scoped_release release;
  gmwm::autoregress(all, values.shape(1), phi, first, rest);
}

void accumulate(const OutMatrix& values, double scale) {
  const std::span<double> all = all_rows(values);
  const nb::gil_scoped_release release;
  gmwm::accumulate(all, values.shape(1), scale);
}

void mix(const OutMatrix& values, const Vector& phi, const Vector& theta, const Matrix& predictors,
         const Vector& deviations, double rest) {
  const std::span<double> all = all_rows(values);
  const std::size_t p = phi.size();
  if (predictors.shape(0) != p || predictors.shape(1) != p || deviations.size() != p)
    throw std::invalid_argument("predictors and deviations must have a row for each coefficient of phi");
  const nb::gil_scoped_release release;
  gmwm::mix(all, values.shape(1), {phi.data(), p}, {theta.data(), theta.size()}, {predictors.data(), p * p},
            {deviations.data(), p}, rest);
}

}  // namespace

void bind_paths(nb::module_& m) {
  m.def("autoregress", &autoregress, "values"_a.noconvert(), "phi"_a, "first"_a, "rest"_a,
          "Turn each row x in place into y_0 = first x_0, y_t = phi y_{t-1} + rest x_t.");
  m.def("accumulate", &accumulate, "values"_a.noconvert(), "scale"_a,
          "Turn each row x in place into y_t = scale (x_0 + ... + x_t).");
  m.def("mix", &mix, "values"_a.noconvert(), "phi"_a.noconvert(), "theta"_a.noconvert(), "predictors"_a.noconvert(),
        "deviations"_a.noconvert(), "rest"_a,
        "Turn each row x in place into an autoregression z driven by rest x, begun by predictors, and that from theta.size() "
        "on into the moving average of z.");
}
