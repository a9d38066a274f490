// The array types that cross into Python, views of them, and the one owner of arrays that go out.
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

// Contiguous arrays that come in, `Input` to be read and `Out` to be written to; noconvert() refuses all others.
template <class T, std::size_t Dimensions>
using Input = nb::ndarray<const T, nb::ndim<Dimensions>, nb::c_contig, nb::device::cpu>;
template <class T, std::size_t Dimensions>
using Out = nb::ndarray<T, nb::ndim<Dimensions>, nb::c_contig, nb::device::cpu>;
// A new array that goes out.
template <class T>
using Output = nb::ndarray<nb::numpy, T, nb::ndim<1>>;

using Vector = Input<double, 1>;
using Matrix = Input<double, 2>;
using Cube = Input<double, 3>;
using OutVector = Out<double, 1>;
using OutMatrix = Out<double, 2>;
using OutCube = Out<double, 3>;
using Result = Output<double>;

// All values of an array in a row.
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
  T* data = kept->data();  // before the owner moves: arguments are evaluated in any order
  const std::size_t n = kept->size();
  return owned<T>(data, n, std::move(kept));
}

}  // namespace gmwm_bind
