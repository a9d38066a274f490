#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <algorithm>

#include "gmwm/lags.hpp"

namespace nb = nanobind;

namespace {

using Levels = nb::ndarray<const std::int64_t, nb::ndim<1>, nb::c_contig, nb::device::cpu>;

template <class T>
nb::ndarray<nb::numpy, T, nb::ndim<1>> moved(std::vector<T>&& values) {
  auto* kept = new std::vector<T>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<T>*>(p); });
  return {kept->data(), {kept->size()}, owner};
}

}  // namespace

void bind_lags(nb::module_& m) {
  m.def(
      "covariance_lags",
      [](Levels levels, std::int64_t samples, double slowest, double fastest, bool alternating) {
        const std::span<const std::int64_t> wanted{levels.data(), levels.size()};
        for (std::size_t i = 0; i < wanted.size(); ++i)
          if (wanted[i] < 1 || wanted[i] > 60 || (i > 0 && wanted[i] <= wanted[i - 1]) ||
              (std::int64_t{1} << wanted[i]) > samples)
            throw nb::value_error("levels must ascend from 1, and 2^level not exceed samples");
        if (!(slowest >= 0 && fastest >= slowest && (slowest > 0) == (fastest > 0)))
          throw nb::value_error("rates must be positive and ascending, or both zero");
        gmwm::Lags lags;
        {
          nb::gil_scoped_release release;
          lags = gmwm::covariance_lags(wanted, samples, slowest, fastest, alternating);
        }
        return nb::make_tuple(moved(std::move(lags.finer)), moved(std::move(lags.coarser)),
                              moved(std::move(lags.lag)), moved(std::move(lags.weight)), moved(std::move(lags.odd)));
      },
      nb::arg("levels").noconvert(), nb::arg("samples"), nb::arg("slowest"), nb::arg("fastest"),
      nb::arg("alternating"),
      "Pairs of levels, lags and weights at which the covariances of the Haar coefficients are to be summed.");
}
