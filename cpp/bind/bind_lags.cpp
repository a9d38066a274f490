#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <utility>

#include "gmwm/differences.hpp"
#include "gmwm/lags.hpp"

namespace nb = nanobind;

namespace {

using Levels = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
using Values = nb::ndarray<const double, nb::ndim<1>, nb::c_contig, nb::device::cpu>;
template <class T>
using Array = nb::ndarray<nb::numpy, T, nb::ndim<1>>;

template <class T>
Array<T> moved(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return {kept->data(), {kept->size()}, owner};
}

Array<double> moved(gmwm::AlignedArray&& values, std::size_t size) {
  auto* kept = new gmwm::AlignedArray(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<gmwm::AlignedArray*>(p); });
  return {kept->get(), {size}, owner};
}

gmwm::Nodes nodes_of(const Values& fine, const Values& coarse, const Values& lag) {
  if (fine.size() != lag.size() || coarse.size() != lag.size())
    throw nb::value_error("fine, coarse and lag must be of one size");
  return {{fine.data(), fine.size()}, {coarse.data(), coarse.size()}, {lag.data(), lag.size()}};
}

template <class Kernel>
Array<double> evaluated(const gmwm::Nodes& nodes, Kernel kernel) {
  const std::size_t size = nodes.lag.size();
  gmwm::AlignedArray out = gmwm::aligned_array(size);
  {
    nb::gil_scoped_release release;
    kernel(nodes, std::span<double>{out.get(), size});
  }
  return moved(std::move(out), size);
}

template <class Kernel>
void define(nb::module_& m, const char* name, Kernel kernel, const char* words) {
  m.def(
      name,
      [kernel](Values fine, Values coarse, Values lag) { return evaluated(nodes_of(fine, coarse, lag), kernel); },
      nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), words);
}

nb::tuple lags(Levels levels, std::int64_t samples, double slowest, double fastest, bool alternating, bool diagonal) {
  const std::span<const std::int64_t> wanted{levels.data(), levels.size()};
  for (std::size_t i = 0; i < wanted.size(); ++i)
    if (wanted[i] < 1 || wanted[i] > 60 || (i > 0 && wanted[i] <= wanted[i - 1]) ||
        (std::int64_t{1} << wanted[i]) > samples)
      throw nb::value_error("levels must ascend from 1, and 2^level not exceed samples");
  if (!(slowest >= 0 && fastest >= slowest && (slowest > 0) == (fastest > 0)))
    throw nb::value_error("rates must be positive and ascending, or both zero");
  gmwm::Lags found;
  {
    nb::gil_scoped_release release;
    found = gmwm::covariance_lags(wanted, samples, {slowest, fastest, alternating, diagonal});
  }
  return nb::make_tuple(moved(std::move(found.starts)), moved(std::move(found.fine), found.size),
                        moved(std::move(found.coarse), found.size), moved(std::move(found.lag), found.size),
                        moved(std::move(found.weight), found.size), moved(std::move(found.odd)));
}

}  // namespace

void bind_lags(nb::module_& m) {
  m.def("covariance_lags", &lags, nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("slowest"),
        nb::arg("fastest"), nb::arg("alternating"), nb::arg("diagonal"),
        "Pairs of levels, lags and weights at which the covariances of the Haar coefficients are to be summed.");
  define(m, "white_differences", gmwm::white_differences, "Covariances of Haar coefficients of white noise.");
  define(m, "walk_differences", gmwm::walk_differences, "Covariances of Haar coefficients of a random walk.");
  define(m, "spike_differences", gmwm::spike_differences, "Covariances of Haar coefficients of rounding errors.");
  m.def(
      "exponential_differences",
      [](Values fine, Values coarse, Values lag, double decay) {
        if (!(decay > 0 && decay <= 700)) throw nb::value_error("decay must be positive, and at most 700");
        return evaluated(nodes_of(fine, coarse, lag), [decay](const gmwm::Nodes& nodes, std::span<double> out) {
          gmwm::exponential_differences(nodes, decay, out);
        });
      },
      nb::arg("fine").noconvert(), nb::arg("coarse").noconvert(), nb::arg("lag").noconvert(), nb::arg("decay"),
      "Covariances of Haar coefficients of an autocovariance exp(-decay |k|).");
}
