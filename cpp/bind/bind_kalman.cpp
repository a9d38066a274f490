#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <stdexcept>
#include <utility>
#include <vector>

#include "gmwm/kalman.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

using Values = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Table = nb::ndarray<const double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;
using Cube = nb::ndarray<const double, nb::ndim<3>, nb::c_contig, nb::device::cpu>;
using Line = nb::ndarray<double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Rows = nb::ndarray<double, nb::ndim<2>, nb::c_contig, nb::device::cpu>;

nb::ndarray<nb::numpy, double, nb::ndim<1>> moved(std::vector<double>&& values) {
  auto* kept = new std::vector<double>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<double>*>(p); });
  return {kept->data(), {kept->size()}, owner};
}

template <class Array>
std::span<const double> span_of(const Array& array) {
  return {array.data(), array.size()};
}

gmwm::System system_of(const Table& F, const Table& Q, const Values& H, double R, const Table& P0) {
  const std::size_t p = H.size();
  for (const Table* m : {&F, &Q, &P0})
    if (m->shape(0) != p || m->shape(1) != p) throw nb::value_error("F, Q and P0 must be (p, p), p the size of H");
  return {p, span_of(F), span_of(Q), span_of(H), span_of(P0), R};
}

gmwm::Series series_of(const Table& series) {
  if (series.shape(0) == 0) throw nb::value_error("series must have a row for the record");
  return {series.shape(0), series.shape(1), span_of(series)};
}

nb::tuple innovations(const Table& F, const Table& Q, const Values& H, double R, const Table& P0, const Table& series,
                      const Line& standardised) {
  const gmwm::System system = system_of(F, Q, H, R, P0);
  const gmwm::Series rows = series_of(series);
  if (standardised.size() != 0 && standardised.size() != rows.length)
    throw nb::value_error("standardised must be empty or have a place for each sample");
  gmwm::Innovations found;
  {
    nb::gil_scoped_release release;
    found = gmwm::innovations(system, rows, {standardised.data(), standardised.size()});
  }
  return nb::make_tuple(!found.singular, found.observed, found.settled, found.log_variances,
                        moved(std::move(found.cross)));
}

nb::tuple score(const Table& F, const Table& Q, const Values& H, double R, const Table& P0, const Cube& dF,
                const Cube& dQ, const Table& dH, const Values& dR, const Cube& dP0, const Table& series) {
  const gmwm::System system = system_of(F, Q, H, R, P0);
  const std::size_t p = system.states, count = dR.size();
  for (const Cube* m : {&dF, &dQ, &dP0})
    if (m->shape(0) != count || m->shape(1) != p || m->shape(2) != p)
      throw nb::value_error("dF, dQ and dP0 must be (count, p, p)");
  if (dH.shape(0) != count || dH.shape(1) != p) throw nb::value_error("dH must be (count, p)");
  if (count > gmwm::most_slopes) throw nb::value_error("too many parameters");
  const gmwm::Slopes slopes{count, span_of(dF), span_of(dQ), span_of(dH), span_of(dP0), span_of(dR)};
  const gmwm::Series rows = series_of(series);
  gmwm::Score found;
  {
    nb::gil_scoped_release release;
    found = gmwm::score(system, slopes, rows);
  }
  return nb::make_tuple(!found.singular, found.observed, found.settled, found.log_variances, found.square,
                        moved(std::move(found.log_slopes)), moved(std::move(found.square_slopes)),
                        moved(std::move(found.information)), moved(std::move(found.cross)),
                        moved(std::move(found.cross_slopes)));
}

bool tracks(const Table& F, const Table& Q, const Values& H, double R, const Table& P0, const Table& series,
            const Table& states, const Table& shares, bool smooth, const Rows& means, const Rows& variances) {
  const gmwm::System system = system_of(F, Q, H, R, P0);
  const gmwm::Series rows = series_of(series);
  const std::size_t g = states.shape(0);
  if (states.shape(1) != system.states || shares.shape(0) != g || shares.shape(1) + 1 != rows.count)
    throw nb::value_error("states must be (g, p) and shares (g, m)");
  for (const Rows* out : {&means, &variances})
    if (out->shape(0) != g + 1 || out->shape(1) != rows.length)
      throw nb::value_error("means and variances must be (g + 1, n)");
  const gmwm::Selection selection{g, span_of(states), span_of(shares)};
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
