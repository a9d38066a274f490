#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/exponential.hpp"
#include "gmwm/exponential_search.hpp"
#include "gmwm/reweighting.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

using Indices = Input<std::int64_t, 1>;
using Search = gmwm::ExponentialSearch;
using Found = std::tuple<double, std::vector<std::int64_t>, Result, Result, std::vector<int>>;

void require(bool condition, const char* message) {
  if (!condition) throw nb::value_error(message);
}

bool finite(std::span<const double> numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); });
}

// A shape function at each of the parameters, a row of `out` for each.
template <class Shape>
auto rows_of(Shape shape) {
  return [shape](Vector parameters, Vector half_scales, OutMatrix out) {
    require(out.shape(0) == parameters.size() && out.shape(1) == half_scales.size(),
            "out must have a row for each parameter, and a column for each half-scale");
    // Microseconds: a thread that gave up the lock would wait longer to get it back.
    for (std::size_t i = 0; i < parameters.size(); ++i)
      shape(parameters.data()[i], view(half_scales), out.data() + i * half_scales.size());
  };
}

void bind_shape(nb::module_& m, const char* name, const char* parameter,
                void (*shape)(double, std::span<const double>, double*), const char* words) {
  m.def(name, rows_of(shape), nb::arg(parameter).noconvert(), "half_scales"_a.noconvert(), "out"_a.noconvert(), words);
}

// Rows of `branches`: low, high, bend, least, sign, and whether the process acts as another one at the low and the high
// end. `limits`: gap, table_error, settled, flat, acts_as, followed, polishes, newton_steps.
Search search_of(Vector target, Matrix fixed, Matrix root, double rounding, Vector half_scales, Matrix branches,
                 double rate, bool innovation, Vector limits, Vector widths) {
  const std::size_t dim = target.size();
  require(dim > 0 && fixed.shape(1) == dim && root.shape(0) == dim && root.shape(1) == dim && half_scales.size() == dim,
          "all vectors must have the length of the target");
  require(branches.shape(0) > 0 && branches.shape(1) == 7 && limits.size() == 8 && widths.size() > 0 && rate > 0,
          "a branch has seven numbers, and there are eight limits");
  for (const auto& numbers : {view(target), view(fixed), view(root), view(half_scales), view(branches)})
    require(finite(numbers), "all numbers must be finite");
  std::vector<gmwm::ExponentialBranch> along;
  for (std::size_t b = 0; b < branches.shape(0); ++b) {
    const double* row = branches.data() + 7 * b;
    require(row[0] < row[1] && row[2] > 0, "a branch must ascend");
    along.push_back({row[0], row[1], row[2], row[3], row[4], row[5] != 0, row[6] != 0});
  }
  const double* limit = limits.data();
  const auto whole = [&](int k) { return static_cast<std::size_t>(limit[k] > 0 ? std::min(limit[k], 1e9) : 0.0); };
  return {gmwm::ExponentialCurve(view(half_scales), along, rate, innovation),
          {limit[0], limit[1], limit[2], limit[3], limit[4], limit[5], whole(6), whole(7),
           {widths.data(), widths.data() + widths.size()}},
          view(target), view(fixed), view(root), rounding};
}

std::vector<gmwm::Place> places_of(const Search& search, const Indices& branches, const Vector& coordinates) {
  require(branches.size() == coordinates.size(), "each place has a branch and a coordinate");
  std::vector<gmwm::Place> places;
  for (std::size_t i = 0; i < branches.size(); ++i) {
    const std::int64_t branch = branches.data()[i];
    require(branch >= 0 && branch < static_cast<std::int64_t>(search.curve().branches()), "there is no such branch");
    places.push_back({static_cast<std::size_t>(branch), coordinates.data()[i]});
  }
  return places;
}

Found as_tuple(gmwm::Optimum best, std::vector<int> acts) {
  std::vector<std::int64_t> branches;
  std::vector<double> coordinates;
  for (const gmwm::Place& place : best.places) {
    branches.push_back(static_cast<std::int64_t>(place.branch));
    coordinates.push_back(place.u);
  }
  return {best.objective, std::move(branches), to_numpy(std::move(coordinates)), to_numpy(std::move(best.weights)),
          std::move(acts)};
}

gmwm::WeightedTable table_of(Matrix root, Vector positive, Indices owner, Vector nodes, Vector spacing, Matrix values,
                             Matrix slopes, Matrix middles, double safety, std::size_t neighbours) {
  const std::size_t size = nodes.size(), dim = positive.size();
  require(dim > 0 && root.shape(0) == dim && root.shape(1) == dim && size > 1 && owner.size() == size &&
              spacing.size() == size - 1 && values.shape(0) == size && slopes.shape(0) == size &&
              middles.shape(0) == size - 1 && values.shape(1) == dim && slopes.shape(1) == dim && middles.shape(1) == dim,
          "a table has as many owners, values and slopes as nodes, and one spacing and one middle less");
  require(spacing.data()[0] > 0 && spacing.data()[size - 2] > 0, "a branch has at least two nodes");
  for (std::size_t i = 0; i < size; ++i) {
    const std::int64_t step = owner.data()[i] - (i > 0 ? owner.data()[i - 1] : 0);
    require(step == 0 || (i > 0 && step == 1), "branches must be numbered from 0, one after the other");
  }
  for (const auto& numbers : {view(root), view(values), view(slopes), view(middles), view(positive)})
    require(finite(numbers), "all numbers must be finite");
  return {{view(owner), view(nodes), view(spacing), view(values), view(slopes), view(middles)},
          view(root), view(positive), safety, neighbours};
}

void require_table(const Search& search, const gmwm::WeightedTable& table, std::size_t count, const Vector& starts) {
  require(table.dim() == search.curve().dim() && table.branches() <= search.curve().branches() && count > 0,
          "the table must have the levels and the branches of the search");
  for (const double s : view(starts))
    require(s >= 0 && s <= static_cast<double>(table.nodes()) - 1, "starts must lie on the curve");
}

// The best positions on the table.
Result tabulated(const Search& search, const gmwm::WeightedTable& table, std::size_t count, std::size_t most,
                 Vector starts) {
  require_table(search, table, count, starts);
  gmwm::Certified found;
  {
    nb::gil_scoped_release release;
    found = search.tabulated(table, count, most, view(starts));
  }
  std::vector<double> positions;
  for (const gmwm::Atom& atom : found.best.front().atoms) positions.push_back(atom.position);
  return to_numpy(std::move(positions));
}

std::tuple<Found, double, double, double, std::size_t> solve(const Search& search, const gmwm::WeightedTable& table,
                                                             std::size_t count, std::size_t most, Vector starts) {
  require_table(search, table, count, starts);
  gmwm::Solved best;
  std::vector<int> acts;
  {
    nb::gil_scoped_release release;
    best = search.solve(table, count, most, view(starts));
    acts = search.acts_as(best);
  }
  return {as_tuple(best, std::move(acts)), best.bound, best.relaxed, best.table, best.nodes};
}

Found follow(const Search& search, Indices branches, Vector coordinates, bool ends) {
  const gmwm::Optimum best = search.followed(places_of(search, branches, coordinates));
  return as_tuple(best, ends ? search.acts_as(best) : std::vector<int>(best.places.size(), 0));
}

template <class T>
std::vector<T> copied(const Input<T, 1>& numbers) {
  return {numbers.data(), numbers.data() + numbers.size()};
}

// Rows of `data`: observed, freedom, counts, added. `segments`: samples, times, number of levels. `kinds`: white (0),
// walk (1), spike (2), drift (3). `options`: loss, rounding, cumulant, prior, fixed, far, cutoff, rounds, hope, mixed.
std::optional<std::tuple<Found, Result, double, double>> reweight(const Search& search, Indices levels, Matrix data,
                                                                  Matrix segments, Indices kinds, Vector powers,
                                                                  Matrix shapes, Vector options,
                                                                  Vector scales, Matrix curved, Indices branches,
                                                                  Vector coordinates) {
  const std::size_t dim = search.curve().dim(), linear = kinds.size();
  require(levels.size() == dim && data.shape(0) == 4 && data.shape(1) == dim && shapes.shape(0) == linear &&
              shapes.shape(1) == dim && powers.size() == linear && scales.size() == linear,
          "data and shapes have a column for each level, and there is a power and a scale for each kind");
  require(segments.shape(0) > 0 && segments.shape(1) == 3 && options.size() == 10 && curved.shape(1) == 2,
          "a segment has three numbers, a curved process two, and there are ten options");
  for (const auto& numbers : {view(data), view(shapes), view(scales), view(curved)})
    require(finite(numbers), "all numbers must be finite");
  gmwm::Setting setting;
  setting.levels = copied(levels);
  const double* row = data.data();
  setting.observed.assign(row, row + dim), setting.freedom.assign(row + dim, row + 2 * dim);
  setting.counts.assign(row + 2 * dim, row + 3 * dim), setting.added.assign(row + 3 * dim, row + 4 * dim);
  for (std::size_t s = 0; s < segments.shape(0); ++s) {
    const double* own = segments.data() + 3 * s;
    require(own[0] >= 1 && own[0] <= 0x1p60 && own[2] >= 1 && own[2] <= static_cast<double>(dim),
            "a segment has samples, and at least one level");
    const gmwm::Segment segment{static_cast<std::int64_t>(own[0]), own[1], static_cast<std::size_t>(own[2])};
    const std::int64_t* level = levels.data();
    for (std::size_t j = 0; j < segment.levels; ++j)
      require(level[j] >= 1 && level[j] <= 60 && (j == 0 || level[j] > level[j - 1]) &&
                  (std::int64_t{1} << level[j]) <= segment.samples,
              "levels must ascend from 1, and 2^level not exceed samples");
    setting.segments.push_back(segment);
  }
  for (const std::int64_t kind : view(kinds)) {
    require(kind >= 0 && kind <= 3, "there is no such kind");
    setting.kinds.push_back(static_cast<gmwm::Elementary>(kind));
  }
  setting.powers = copied(powers);
  setting.shapes.assign(shapes.data(), shapes.data() + shapes.size());
  setting.curved = curved.shape(0);
  const double* option = options.data();
  const auto whole = [&](int k) { return static_cast<std::size_t>(option[k] >= 1 ? std::min(option[k], 1e6) : 1.0); };
  setting.loss = option[0], setting.rounding = option[1];
  setting.options = {option[3], option[4], option[5], option[2], option[6], whole(7), whole(8), whole(9)};
  gmwm::Estimate estimate{copied(scales), {}};
  for (std::size_t i = 0; i < curved.shape(0); ++i)
    estimate.curved.emplace_back(curved.data()[2 * i], curved.data()[2 * i + 1]);
  std::vector<gmwm::Place> places = places_of(search, branches, coordinates);
  std::optional<gmwm::Reweighted> found;
  {
    nb::gil_scoped_release release;
    gmwm::Reweighting iteration(std::move(setting), search.curve(), search.limits());
    found = iteration.run(std::move(estimate), std::move(places));
  }
  if (!found) return std::nullopt;
  const std::vector<int> unknown(found->best.places.size(), 0);
  return std::tuple{as_tuple(std::move(found->best), unknown), to_numpy(std::move(found->weights)), found->change,
                    found->expected};
}

}  // namespace

void bind_exponential(nb::module_& m) {
  bind_shape(m, "exponential_shapes", "decays", gmwm::exponential_shape,
             "Write the Haar wavelet variances of autocovariances exp(-decay |k|) to out.");
  bind_shape(m, "exponential_slopes", "decays", gmwm::exponential_slope,
             "Write the derivatives of `exponential_shapes` with respect to the decay to out.");
  bind_shape(m, "autoregressive_shapes", "coefficients", gmwm::autoregressive_shape,
             "Write the Haar wavelet variances of autoregressions of order 1 with innovation variance 1 to out.");
  bind_shape(m, "autoregressive_slopes", "coefficients", gmwm::autoregressive_slope,
             "Write the derivatives of `autoregressive_shapes` with respect to the coefficient to out.");
  m.def(
      "oscillation_shapes",
      [](Vector damping, Vector turn, Vector half_scales, OutMatrix out) {
        require(turn.size() == damping.size(), "there must be a damping for each turn");
        require(out.shape(0) == turn.size() && out.shape(1) == half_scales.size(),
                "out must have a row for each turn, and a column for each half-scale");
        for (std::size_t i = 0; i < turn.size(); ++i)
          gmwm::oscillation_shape(damping.data()[i], turn.data()[i], view(half_scales),
                                  out.data() + i * half_scales.size());
      },
      "damping"_a.noconvert(), "turn"_a.noconvert(), "half_scales"_a.noconvert(), "out"_a.noconvert(),
      "Write the Haar wavelet variances of damped oscillators, whose phases turn by `turn` per sample, to out.");

  nb::class_<gmwm::WeightedTable>(m, "WeightedTable",
                                  "The table of processes with exponential autocovariances under weights, which the "
                                  "searches for several models share.")
      .def(nb::new_(&table_of), "root"_a.noconvert(), "positive"_a.noconvert(), "owner"_a.noconvert(),
           "nodes"_a.noconvert(), "spacing"_a.noconvert(), "values"_a.noconvert(), "slopes"_a.noconvert(),
           "middles"_a.noconvert(), "safety"_a, "neighbours"_a);
  nb::class_<Search>(m, "ExponentialSearch",
                     "The search for processes with exponential autocovariances in a sum with fixed processes.")
      .def(nb::new_(&search_of), "target"_a.noconvert(), "fixed"_a.noconvert(), "root"_a.noconvert(), "rounding"_a,
           "half_scales"_a.noconvert(), "branches"_a.noconvert(), "rate"_a, "innovation"_a, "limits"_a.noconvert(),
           "widths"_a.noconvert())
      .def("solve", &solve, "table"_a, "count"_a, "most"_a, "starts"_a.noconvert(),
           "Find the global optimum: its objective, branches and coordinates of the places, weights, and ends as which "
           "they act; then the lower bounds of the search and of the relaxation, the objective on the table, and the "
           "number of nodes.")
      .def("tabulated", &tabulated, "table"_a, "count"_a, "most"_a, "starts"_a.noconvert(),
           "Find the places of the global optimum on the table, as positions in cells.")
      .def("follow", &follow, "branches"_a.noconvert(), "coordinates"_a.noconvert(), "ends"_a,
           "Find the local optimum next to places; if `ends`, also the ends as which they act.")
      .def("reweight", &reweight, "levels"_a.noconvert(), "data"_a.noconvert(), "segments"_a.noconvert(),
           "kinds"_a.noconvert(), "powers"_a.noconvert(), "shapes"_a.noconvert(), "options"_a.noconvert(),
           "scales"_a.noconvert(), "curved"_a.noconvert(), "branches"_a.noconvert(), "coordinates"_a.noconvert(),
           "Iterate estimate and diagonal weights: the optimum, the weights, and the last and the next change of the "
           "curve; None if the model has no noise at some level.");
}
