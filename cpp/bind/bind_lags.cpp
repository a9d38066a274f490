#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <algorithm>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/differences.hpp"
#include "gmwm/lags.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;

namespace {

gmwm::Nodes nodes_of(const Vector& fine, const Vector& coarse, const Vector& lag) {
  if (fine.size() != lag.size() || coarse.size() != lag.size())
    throw nb::value_error("fine, coarse and lag must be of one size");
  return {{fine.data(), fine.size()}, {coarse.data(), coarse.size()}, {lag.data(), lag.size()}};
}

template <class Kernel>
Result evaluated(const gmwm::Nodes& nodes, Kernel kernel) {
  const std::size_t size = nodes.lag.size();
  gmwm::AlignedArray out = gmwm::aligned_array(size);
  {
    nb::gil_scoped_release release;
    kernel(nodes, std::span<double>{out.get(), size});
  }
  return to_numpy(std::move(out), size);
}

template <class Kernel>
void define(nb::module_& m, const char* name, Kernel kernel, const char* words) {
  m.def(
      name,
      [kernel](Vector fine, Vector coarse, Vector lag) {
        return evaluated(nodes_of(fine, coarse, lag), kernel);
      },
      nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), words);
}

constexpr std::int64_t samples_most = std::int64_t{1} << 40;

using LagTable = std::tuple<Output<std::int64_t>, Result, Result, Result, Result, Output<std::uint8_t>>;

gmwm::Lags found_lags(Input<std::int64_t, 1> levels, std::int64_t samples, double slowest, double fastest, bool alternating,
              bool diagonal, std::int64_t memory) {
  const std::span<const std::int64_t> wanted{levels.data(), levels.size()};
  for (std::size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i] < 1 || wanted[i] > 60 || (i > 0 && wanted[i] <= wanted[i - 1]) ||
        (std::int64_t{1} << wanted[i]) > samples)
      throw nb::value_error("levels must ascend from 1, and 2^level not exceed samples");
  if (!(slowest >= 0 && fastest >= slowest && (slowest > 0) == (fastest > 0)))
    throw nb::value_error("rates must be positive and ascending, or both zero");
  if (memory < 0 || memory > samples_most) throw nb::value_error("memory must be from 0 to 2^40");
  nb::gil_scoped_release release;
  return gmwm::covariance_lags(wanted, samples, {slowest, fastest, alternating, diagonal, memory});
}

LagTable lags(Input<std::int64_t, 1> levels, std::int64_t samples, double slowest, double fastest, bool alternating,
              bool diagonal, std::int64_t memory) {
  gmwm::Lags found = found_lags(levels, samples, slowest, fastest, alternating, diagonal, memory);
  return {to_numpy(std::move(found.starts)), to_numpy(std::move(found.fine), found.size),
          to_numpy(std::move(found.coarse), found.size), to_numpy(std::move(found.lag), found.size),
          to_numpy(std::move(found.weight), found.size), to_numpy(std::move(found.odd))};
}

using Positions = Output<std::int64_t>;
using PieceTable = std::tuple<Positions, Positions, Positions, Result>;

std::tuple<LagTable, PieceTable> nodes(Input<std::int64_t, 1> levels, std::int64_t samples, double slowest,
                                       double fastest, bool alternating, bool diagonal, std::int64_t memory) {
  gmwm::Lags found = found_lags(levels, samples, slowest, fastest, alternating, diagonal, memory);
  PieceTable pieces{to_numpy(std::move(found.piece_first)), to_numpy(std::move(found.piece_pattern)),
                    to_numpy(std::move(found.pattern_begins)), to_numpy(std::move(found.pattern_offsets))};
  LagTable table{to_numpy(std::move(found.starts)), to_numpy(std::move(found.fine), found.size),
                 to_numpy(std::move(found.coarse), found.size), to_numpy(std::move(found.lag), found.size),
                 to_numpy(std::move(found.weight), found.size), to_numpy(std::move(found.odd))};
  return {std::move(table), std::move(pieces)};
}

using Indices = Input<std::int64_t, 1>;

using PieceArrays = std::tuple<Indices, Indices, Indices, Vector>;

void require_decay(double decay) {
  if (!(decay > 0 && decay <= 700)) throw nb::value_error("decay must be positive, and at most 700");
}

gmwm::Pieces pieces_of(const PieceArrays& table, std::size_t nodes) {
  const auto& [first, pattern, begins, offsets] = table;
  const gmwm::Pieces pieces{view(first), view(pattern), view(begins), view(offsets)};
  const std::int64_t patterns = static_cast<std::int64_t>(begins.size()) - 1;
  bool good = first.size() == pattern.size() && patterns >= 0;
  good = good && pieces.begins.front() == 0 && pieces.begins.back() == static_cast<std::int64_t>(offsets.size());
  for (std::int64_t k = 0; good && k < patterns; ++k) {
    const std::int64_t count = pieces.begins[k + 1] - pieces.begins[k];
    good = count > 0 && count <= static_cast<std::int64_t>(gmwm::piece_nodes);
  }
  std::int64_t next = 0;
  for (std::size_t i = 0; good && i < pieces.first.size(); ++i) {
    const std::int64_t kind = pieces.pattern[i];
    good = kind >= 0 && kind < patterns && pieces.first[i] == next;
    if (good) next += pieces.begins[kind + 1] - pieces.begins[kind];
  }
  if (!good || next != static_cast<std::int64_t>(nodes))
    throw nb::value_error("pieces must be patterns of at most 16 nodes, one after the other");
  return pieces;
}

Result piecewise_exponential(const Vector& fine, const Vector& coarse, const Vector& lag, const PieceArrays& table,
                             double decay) {
  require_decay(decay);
  const gmwm::Pieces pieces = pieces_of(table, lag.size());
  return evaluated(nodes_of(fine, coarse, lag), [&](const gmwm::Nodes& nodes, std::span<double> out) {
    gmwm::exponential_differences(nodes, pieces, decay, out);
  });
}

using Sums = std::tuple<Result, Result>;

Sums summed(const std::vector<Vector>& shapes, const gmwm::Exponentials& exponentials, const Vector& scales,
            const Vector& weight, const Indices& starts) {
  if (shapes.size() + exponentials.decays.size() != scales.size())
    throw nb::value_error("there must be a scale for each shape");
  std::vector<const double*> pointers;
  for (const Vector& shape : shapes) {
    if (shape.size() != weight.size()) throw nb::value_error("shapes must be as long as weight");
    pointers.push_back(shape.data());
  }
  std::int64_t last = 0;
  for (const std::int64_t start : view(starts)) {
    if (start < last || start > static_cast<std::int64_t>(weight.size()))
      throw nb::value_error("starts must ascend within weight");
    last = start;
  }
  std::vector<double> first(starts.size()), second(starts.size());
  {
    nb::gil_scoped_release release;
    gmwm::node_sums(pointers, exponentials, view(scales), view(weight), view(starts), {first, second});
  }
  return {to_numpy(std::move(first)), to_numpy(std::move(second))};
}

Sums sums(const std::vector<Vector>& shapes, Vector scales, Vector weight, Indices starts) {
  return summed(shapes, {}, scales, weight, starts);
}

Sums exponential_sums(const std::vector<Vector>& shapes, Vector decays, Vector scales, Vector weight, Indices starts,
                      Vector fine, Vector coarse, Vector lag, const PieceArrays& table) {
  for (const double decay : view(decays)) require_decay(decay);
  const gmwm::Exponentials exponentials{nodes_of(fine, coarse, lag), pieces_of(table, lag.size()), view(decays)};
  if (weight.size() != lag.size()) throw nb::value_error("weight must be as long as lag");
  const auto& first = exponentials.pieces.first;
  for (const std::int64_t start : view(starts))
    if (start != static_cast<std::int64_t>(lag.size()) && !std::binary_search(first.begin(), first.end(), start))
      throw nb::value_error("a pair of levels must begin with a piece");
  if (starts.size() > 0 ? starts.data()[0] != 0 : lag.size() > 0)
    throw nb::value_error("the first pair of levels must begin with the first node");
  return summed(shapes, exponentials, scales, weight, starts);
}

}  // namespace

void bind_lags(nb::module_& m) {
  m.def("covariance_lags", &lags, nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("slowest"),
        nb::arg("fastest"), nb::arg("alternating"), nb::arg("diagonal"), nb::arg("memory"),
        "Pairs of levels, lags and weights at which the covariances of the Haar coefficients are to be summed.");
  m.def("covariance_nodes", &nodes, nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("slowest"),
        nb::arg("fastest"), nb::arg("alternating"), nb::arg("diagonal"), nb::arg("memory"),
        "As `covariance_lags`, with the pieces of the nodes: first nodes, patterns, and begins and offsets of these.");
  m.def("node_sums", &sums, nb::arg("shapes"), nb::arg("scales").noconvert(), nb::arg("weight").noconvert(),
        nb::arg("starts").noconvert(),
        "Sums over the nodes of each pair of levels: Σ weight c and Σ weight c² of c = Σ scale shape.");
  m.def("exponential_node_sums", &exponential_sums, nb::arg("shapes"), nb::arg("decays").noconvert(),
        nb::arg("scales").noconvert(), nb::arg("weight").noconvert(), nb::arg("starts").noconvert(),
        nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), nb::arg("pieces"),
        "As `node_sums`, with an autocovariance exp(-decay |k|) for each decay, whose scales follow those of the shapes.");
  m.def("piecewise_exponential_differences", &piecewise_exponential, nb::arg("fine").noconvert(),
        nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), nb::arg("pieces"), nb::arg("decay"),
        "As `exponential_differences`, with the exponentials of a piece in common.");
  define(m, "white_differences", gmwm::white_differences, "Covariances of Haar coefficients of white noise.");
  define(m, "walk_differences", gmwm::walk_differences, "Covariances of Haar coefficients of a random walk.");
  define(m, "spike_differences", gmwm::spike_differences, "Covariances of Haar coefficients of rounding errors.");
  m.def(
      "exponential_differences",
      [](Vector fine, Vector coarse, Vector lag, double decay) {
        if (!(decay > 0 && decay <= 700)) throw nb::value_error("decay must be positive, and at most 700");
        return evaluated(nodes_of(fine, coarse, lag), [decay](const gmwm::Nodes& nodes, std::span<double> out) {
          gmwm::exponential_differences(nodes, decay, out);
        });
      },
      nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), nb::arg("decay"),
      "Covariances of Haar coefficients of an autocovariance exp(-decay |k|).");
  m.def(
      "power_differences",
      [](Vector fine, Vector coarse, Vector lag, double epsilon, Vector falling) {
        if (falling.size() != gmwm::power_terms) throw nb::value_error("there must be 15 coefficients");
        const std::span<const double, gmwm::power_terms> terms{falling.data(), gmwm::power_terms};
        return evaluated(nodes_of(fine, coarse, lag), [epsilon, terms](const gmwm::Nodes& nodes, std::span<double> out) {
          gmwm::power_differences(nodes, epsilon, terms, out);
        });
      },
      nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), nb::arg("epsilon"),
      nb::arg("falling").noconvert(),
      "Covariances of Haar coefficients of a running sum with the covariance m² (|m|^epsilon - 1)/epsilon.");
  m.def(
      "short_memory_differences",
      [](Vector fine, Vector coarse, Vector lag, Vector autocovariance) {
        if (autocovariance.size() == 0) throw nb::value_error("there must be an autocovariance at lag 0");
        const std::span<const double> known{autocovariance.data(), autocovariance.size()};
        return evaluated(nodes_of(fine, coarse, lag), [known](const gmwm::Nodes& nodes, std::span<double> out) {
          gmwm::short_memory_differences(nodes, known, out);
        });
      },
      nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(),
      nb::arg("autocovariance").noconvert(),
      "Covariances of Haar coefficients of a process with these autocovariances at lags 0, 1, … and none beyond.");
}
