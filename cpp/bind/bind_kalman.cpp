#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <cstddef>
#include <stdexcept>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/kalman.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

gmwm::System system_of(const Matrix& F, const Matrix& Q, const Vector& H, double R, const Matrix& P0) {
  const std::size_t p = H.size();
  for (const Matrix* m : {&F, &Q, &P0})
    if (m->shape(0) != p || m->shape(1) != p) throw nb::value_error("F, Q and P0 must be (p, p), p the size of H");
  return {p, view(F), view(Q), view(H), view(P0), R};
}

gmwm::Series series_of(const Matrix& series) {
  if (series.shape(0) == 0) throw nb::value_error("series must have a row for the record");
  return {series.shape(0), series.shape(1), view(series)};
}

using InnovationSums = std::tuple<bool, std::size_t, std::size_t, double, Result>;
using ScoreSums = std::tuple<bool, std::size_t, std::size_t, double, double, Result, Result, Result, Result,
                             Result>;

InnovationSums innovations(const Matrix& F, const Matrix& Q, const Vector& H, double R, const Matrix& P0,
                           const Matrix& series, const OutVector& standardised) {
  const gmwm::System system = system_of(F, Q, H, R, P0);
  const gmwm::Series rows = series_of(series);
  if (standardised.size() != 0 && standardised.size() != rows.length)
    throw nb::value_error("standardised must be empty or have a place for each sample");
  gmwm::Innovations found;
  {
    nb::gil_scoped_release release;
    found = gmwm::innovations(system, rows, {standardised.data(), standardised.size()});
  }
  return {!found.singular, found.observed, found.settled, found.log_variances, to_numpy(std::move(found.cross))};
}

ScoreSums score(const Matrix& F, const Matrix& Q, const Vector& H, double R, const Matrix& P0, const Cube& dF,
                const Cube& dQ, const Matrix& dH, const Vector& dR, const Cube& dP0, const Matrix& series) {
  const gmwm::System system = system_of(F, Q, H, R, P0);
  const std::size_t p = system.states, count = dR.size();
  for (const Cube* m : {&dF, &dQ, &dP0})
    if (m->shape(0) != count || m->shape(1) != p || m->shape(2) != p)
      throw nb::value_error("dF, dQ and dP0 must be (count, p, p)");
  if (dH.shape(0) != count || dH.shape(1) != p) throw nb::value_error("dH must be (count, p)");
  if (count > gmwm::most_slopes) throw nb::value_error("too many parameters");
  const gmwm::Slopes slopes{count, view(dF), view(dQ), view(dH), view(dP0), view(dR)};
  const gmwm::Series rows = series_of(series);
  gmwm::Score found;
  {
    nb::gil_scoped_release release;
    found = gmwm::score(system, slopes, rows);
  }
  return {!found.singular, found.observed, found.settled, found.log_variances, found.square,
          to_numpy(std::move(found.log_slopes)), to_numpy(std::move(found.square_slopes)),
          to_numpy(std::move(found.information)), to_numpy(std::move(found.cross)),
          to_numpy(std::move(found.cross_slopes))};
}

bool tracks(const Matrix& F, const Matrix& Q, const Vector& H, double R, const Matrix& P0, const Matrix& series,
            const Matrix& states, const Matrix& shares, bool smooth, const OutMatrix& means,
            const OutMatrix& variances) {
  const gmwm::System system = system_of(F, Q, H, R, P0);
  const gmwm::Series rows = series_of(series);
  const std::size_t g = states.shape(0);
  if (states.shape(1) != system.states || shares.shape(0) != g || shares.shape(1) + 1 != rows.count)
    throw nb::value_error("states must be (g, p) and shares (g, m)");
  for (const OutMatrix* out : {&means, &variances})
    if (out->shape(0) != g + 1 || out->shape(1) != rows.length)
      throw nb::value_error("means and variances must be (g + 1, n)");
  const gmwm::Selection selection{g, view(states), view(shares)};
  nb::gil_scoped_release release;
  return gmwm::tracks(system, rows, selection, smooth, {means.data(), means.size()},
                      {variances.data(), variances.size()});
}

}  // namespace

void bind_kalman(nb::module_& m) {
  m.attr("most_slopes") = gmwm::most_slopes;
  m.def("kalman_innovations", &innovations, "F"_a.noconvert(), "Q"_a.noconvert(), "H"_a.noconvert(), "R"_a,
        "P0"_a.noconvert(), "series"_a.noconvert(), "standardised"_a.noconvert(),
        "Sums of the innovations of a record and its regressors (k, n), and the standardised ones of the record.");
  m.def("kalman_score", &score, "F"_a.noconvert(), "Q"_a.noconvert(), "H"_a.noconvert(), "R"_a, "P0"_a.noconvert(),
        "dF"_a.noconvert(), "dQ"_a.noconvert(), "dH"_a.noconvert(), "dR"_a.noconvert(), "dP0"_a.noconvert(),
        "series"_a.noconvert(), "The same sums with their derivatives, and the information.");
  m.def("kalman_tracks", &tracks, "F"_a.noconvert(), "Q"_a.noconvert(), "H"_a.noconvert(), "R"_a, "P0"_a.noconvert(),
        "series"_a.noconvert(), "states"_a.noconvert(), "shares"_a.noconvert(), "smooth"_a, "means"_a.noconvert(),
        "variances"_a.noconvert(), "Filtered or smoothed sums of states, their means and variances.");
}
