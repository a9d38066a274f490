// Array types of the Python interface, views of them, and the ownership of returned arrays.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "gmwm/buffer.hpp"

namespace gmwm_bind {

namespace nb = nanobind;

// Contiguous array arguments: `Input` is read-only, `Out` is written to. noconvert() rejects all other arrays.
template <class T, std::size_t Dimensions>
using Input = nb::ndarray<const T, nb::ndim<Dimensions>, nb::c_contig, nb::device::cpu>;
template <class T, std::size_t Dimensions>
using Out = nb::ndarray<T, nb::ndim<Dimensions>, nb::c_contig, nb::device::cpu>;
// A new array that is returned.
template <class T>
using Output = nb::ndarray<nb::numpy, T, nb::ndim<1>>;

using Vector = Input<double, 1>;
using Matrix = Input<double, 2>;
using Cube = Input<double, 3>;
using OutVector = Out<double, 1>;
using OutMatrix = Out<double, 2>;
using OutCube = Out<double, 3>;
using Result = Output<double>;

// Whether `count` parts of `each` values are at most `size` values. The product can be too large for its type.
inline bool fits(std::size_t count, std::size_t each, std::size_t size) { return count == 0 || each <= size / count; }

// A flat view of all values of an array.
template <class T, class... Properties>
std::span<T> view(const nb::ndarray<T, Properties...>& array) {
  return {array.data(), array.size()};
}

// A NumPy array of n values that owns `storage`, which holds them.
template <class T, class Storage>
Output<T> owned(T* data, std::size_t n, std::unique_ptr<Storage> storage) {
  nb::capsule owner(storage.get(), [](void* p) noexcept { delete static_cast<Storage*>(p); });
  storage.release();
  return Output<T>(data, {n}, owner);
}

inline Result to_numpy(gmwm::AlignedArray values, std::size_t n) {
  double* data = values.get();
  return owned<double>(data, n, std::make_unique<gmwm::AlignedArray>(std::move(values)));
}

template <class T>
Output<T> to_numpy(std::vector<T> values) {
  auto kept = std::make_unique<std::vector<T>>(std::move(values));
  T* data = kept->data();  // before `kept` is moved from, because the order of evaluation of arguments is not specified
  const std::size_t n = kept->size();
  return owned<T>(data, n, std::move(kept));
}

}  // namespace gmwm_bind
