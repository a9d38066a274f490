#include <nanobind/nanobind.h>
#include <nanobind/stl/tuple.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.hpp"
#include "gmwm/haar.hpp"
#include "gmwm/robust.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

using Values = std::vector<double>;

// Number of Haar coefficients at a level. Throws if there are none.
std::size_t checked_count(const Vector& running_sum, std::size_t level) {
  const std::size_t n = running_sum.shape(0);
  if (level < 1 || level > gmwm::max_level || n <= (std::size_t{1} << level))
    throw std::invalid_argument("level must be from 1 to log2 of the number of samples, got " + std::to_string(level) +
                                " for a running sum of " + std::to_string(n) + " values");
  return n - (std::size_t{1} << level);
}

std::tuple<double, double> biweight_sums(const Vector& values, double limit) {
  if (!(limit > 0.0)) throw std::invalid_argument("limit must be positive, got " + std::to_string(limit));
  const nb::gil_scoped_release release;
  const gmwm::BiweightSums sums = gmwm::biweight_sums(view(values), limit);
  return {sums.cubed, sums.fourth};
}

std::tuple<Result, Result, Result> haar_biweight_sums(const Vector& running_sum, const Vector& limits,
                                                      std::size_t every, std::size_t begin) {
  const std::size_t levels = limits.shape(0);
  checked_count(running_sum, levels);
  if (every < 1) throw std::invalid_argument("every must be at least 1, got 0");
  if (begin >= running_sum.shape(0))
    throw std::invalid_argument("begin must be less than " + std::to_string(running_sum.shape(0)) + ", got " +
                                std::to_string(begin));
  Values cubed(levels), fourth(levels), count(levels);
  {
    const nb::gil_scoped_release release;
    std::vector<gmwm::BiweightSums> sums(levels);
    gmwm::haar_biweight_sums(view(running_sum), view(limits), every, sums, begin);
    for (std::size_t k = 0; k < levels; ++k) {
      cubed[k] = sums[k].cubed;
      fourth[k] = sums[k].fourth;
      count[k] = sums[k].count;
    }
  }
  return {to_numpy(std::move(cubed)), to_numpy(std::move(fourth)), to_numpy(std::move(count))};
}

Result haar_sample(const Vector& running_sum, std::size_t level, std::size_t size) {
  Values out(std::min(size, checked_count(running_sum, level)));
  {
    const nb::gil_scoped_release release;
    gmwm::haar_sample(view(running_sum), level, out);
  }
  return to_numpy(std::move(out));
}

std::tuple<std::size_t, Result> haar_between(const Vector& running_sum, std::size_t level, double low, double high) {
  checked_count(running_sum, level);
  Values between;
  std::size_t below = 0;
  {
    const nb::gil_scoped_release release;
    below = gmwm::haar_between(view(running_sum), level, low, high, between);
  }
  return {below, to_numpy(std::move(between))};
}

}  // namespace

void bind_robust(nb::module_& m) {
  m.def("biweight_sums", &biweight_sums, "values"_a.noconvert(), "limit"_a,
        "Return the sums of v q^3 and v q^4 over the values, with v = min(value^2 / limit, 1) and q = 1 - v.");
  m.def("haar_biweight_sums", &haar_biweight_sums, "running_sum"_a.noconvert(), "limits"_a.noconvert(), "every"_a,
        "begin"_a = 0,
        "Return the sums of `biweight_sums` over the Haar coefficients of each level, and the numbers of "
        "coefficients. Each level has its own limit; levels with the limit 0 are skipped. Only one in `every` tiles "
        "of 4096 samples is read. Coefficients that end before sample `begin` are skipped.");
  m.def("haar_sample", &haar_sample, "running_sum"_a.noconvert(), "level"_a, "size"_a,
        "Return |W_{j,t}| at `size` positions that are spread over the level, or all in order if there are no more.");
  m.def("haar_between", &haar_between, "running_sum"_a.noconvert(), "level"_a, "low"_a, "high"_a,
        "Return the number of |W_{j,t}| <= low, and the values in (low, high].");
}
