#include <nanobind/nanobind.h>
#include <nanobind/stl/pair.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <utility>

#include "arrays.hpp"
#include "gmwm/clones.hpp"
#include "gmwm/haar.hpp"

namespace nb = nanobind;
using namespace gmwm_bind;
using namespace nb::literals;

namespace {

std::size_t checked_levels(std::size_t levels, std::size_t samples) {
  if (levels < 1 || levels > gmwm::max_level || (std::size_t{1} << levels) > samples)
    throw std::invalid_argument("levels must be from 1 to log2 of the number of samples, got " +
                                std::to_string(levels) + " for " + std::to_string(samples) + " samples");
  return levels;
}

double mean(const Vector& x) {
  if (x.shape(0) == 0) throw std::invalid_argument("x must not be empty");
  const nb::gil_scoped_release release;
  return gmwm::mean(view(x)).value;
}

// Buffer of samples, of which the first ones are used. One call checks and copies a small chunk. In Python, the checks
// would take longer than the sums.
class Inbox {
 public:
  explicit Inbox(nb::object buffer) : array_(nb::borrow(buffer.type())), values_(nb::cast<OutVector>(buffer, false)) {}

  std::size_t used() const { return used_; }

  bool append(nb::handle chunk, std::size_t most) {
    Vector x;
    // A subclass of the array can have a mask, and a list is no array.
    if (!chunk.type().is(array_) || !nb::try_cast<Vector>(chunk, x, false)) return false;
    const std::size_t n = x.size();
    if (n == 0 || n > most || n > values_.size() - used_) return false;
    if (reinterpret_cast<std::uintptr_t>(x.data()) % alignof(double) != 0) return false;
    if (!gmwm::copy_finite(view(x), values_.data() + used_)) return false;
    used_ += n;
    return true;
  }

 private:
  nb::object array_;
  OutVector values_;
  std::size_t used_ = 0;
};

Result running_sum(const Vector& x) {
  const std::size_t n = x.shape(0);
  if (n == 0) throw std::invalid_argument("x must not be empty");
  gmwm::AlignedArray sum = gmwm::aligned_array(n + 1);
  {
    const nb::gil_scoped_release release;
    sum[0] = 0.0;
    gmwm::running_sum(view(x), gmwm::mean(view(x)).value, {sum.get(), n + 1});
  }
  return to_numpy(std::move(sum), n + 1);
}

Result haar_sums_of_squares(const Vector& running_sum, std::size_t levels, std::size_t begin, std::size_t end) {
  const std::size_t n = running_sum.shape(0);
  if (n < 2) throw std::invalid_argument("running_sum must have at least 2 values, got " + std::to_string(n));
  checked_levels(levels, n - 1);
  if (begin > end || end > n - 1)
    throw std::invalid_argument("begin and end must satisfy 0 <= begin <= end <= " + std::to_string(n - 1) +
                  ", got " + std::to_string(begin) + " and " + std::to_string(end));
  gmwm::AlignedArray sums = gmwm::aligned_array(levels);
  {
    const nb::gil_scoped_release release;
    for (std::size_t k = 0; k < levels; ++k) sums[k] = 0.0;
    gmwm::haar_sums_of_squares(view(running_sum), begin, end, {sums.get(), levels});
  }
  return to_numpy(std::move(sums), levels);
}

void haar_block_squares(const Vector& running_sum, std::size_t block, const OutMatrix& out) {
  const std::size_t levels = out.shape(1);
  if (levels < 1 || levels > gmwm::max_level || block < 1 ||
      !fits(out.shape(0), block, running_sum.size()) ||
      (std::size_t{1} << levels) > running_sum.size() - out.shape(0) * block)
    throw std::invalid_argument("the last coefficients must end within the running sum");
  const nb::gil_scoped_release release;
  gmwm::haar_block_squares(view(running_sum), block, levels, view(out));
}

std::pair<Result, Result> haar_panel(const Vector& before, const Vector& x, double reference, std::size_t levels,
                                     std::size_t first, std::size_t step) {
  const std::size_t n = x.shape(0);
  if (n == 0 || step == 0) throw std::invalid_argument("x must not be empty, and step must be positive");
  if (levels > 0) checked_levels(levels, before.shape(0) + n);
  const std::size_t count = first > n ? 0 : (n - first) / step + 1;
  gmwm::AlignedArray squares = gmwm::aligned_array(levels), sums = gmwm::aligned_array(count + 1);
  {
    const nb::gil_scoped_release release;
    gmwm::haar_panel(view(before), view(x), reference, {first, step, {sums.get(), count + 1}}, {squares.get(), levels});
  }
  return {to_numpy(std::move(squares), levels), to_numpy(std::move(sums), count + 1)};
}

std::pair<Result, double> haar_variance(const Vector& x, std::size_t levels) {
  checked_levels(levels, x.shape(0));
  gmwm::AlignedArray variance = gmwm::aligned_array(levels);
  double rise = 0.0;
  {
    const nb::gil_scoped_release release;
    rise = gmwm::haar_variance(view(x), {variance.get(), levels});
  }
  return {to_numpy(std::move(variance), levels), rise};
}

}  // namespace

void bind_haar(nb::module_& m) {
  m.def("clone", &gmwm::running_clone, "Return the name of the version of the kernels that runs on this processor.");
  m.def("mean", &mean, "x"_a.noconvert(), "Return the mean of x; NaN if a value is not finite.");
  nb::class_<Inbox>(m, "Inbox", "Buffer of samples, of which the first ones are used.")
      .def(nb::init<nb::object>(), "buffer"_a)
      .def_prop_ro("used", &Inbox::used, "Number of samples that are used.")
      .def("append", &Inbox::append, "chunk"_a.none(), "most"_a,
           "Copy `chunk` after the used samples. Return False, and do nothing, if it is not an array of one to `most` "
           "finite float64 numbers, or if it does not fit.");
  m.def("running_sum", &running_sum, "x"_a.noconvert(),
          "Return the running sum of x - mean(x), N + 1 values that start with 0. If a value is not finite, all "
          "values but the first are NaN.");
  m.def("haar_sums_of_squares", &haar_sums_of_squares, "running_sum"_a.noconvert(), "levels"_a, "begin"_a, "end"_a,
          "Return the sums of the squared Haar coefficients W_{j,t} of the levels j = 1 ... levels, over begin <= t "
          "< end and t >= 2^j - 1.");
  m.def("haar_panel", &haar_panel, "before"_a.noconvert(), "x"_a.noconvert(), "reference"_a, "levels"_a, "first"_a,
          "step"_a, "Return the sums of the squared Haar coefficients of levels 1 ... levels that end in x, which "
          "follows `before`. Return also the sums of the first `first` + k `step` values of x for k = 0, 1, ..., and "
          "of all values. `before` and these sums are relative to `reference`.");
  m.def("haar_block_squares", &haar_block_squares, "running_sum"_a.noconvert(), "block"_a, "out"_a.noconvert(),
          "Write the mean squares (blocks, levels) of the Haar coefficients that begin in each block to out.");
  m.def("haar_variance", &haar_variance, "x"_a.noconvert(), "levels"_a,
          "Return the Haar wavelet variance of x at levels 1 ... levels, and the mean rise per sample. All are NaN "
          "if a value or a sum of values is not finite.");
}
