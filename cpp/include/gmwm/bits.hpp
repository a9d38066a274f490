// The bits of a number as another type: std::bit_cast, which the libc++ of Clang 13 and emscripten 3.1.6 does not have.
#pragma once

#include <bit>

#include "gmwm/clones.hpp"

namespace gmwm {

#if defined(__cpp_lib_bit_cast)
using std::bit_cast;
#else
template <class To, class From>
GMWM_INLINE constexpr To bit_cast(const From& from) {
  return __builtin_bit_cast(To, from);
}
#endif

}  // namespace gmwm
