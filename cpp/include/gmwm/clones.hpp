// Versions of functions for wider instruction sets; each call takes the widest that this processor has.
#pragma once

// Every system with an x86-64 processor, with GCC from 12 on or Clang, which includes clang-cl of Visual Studio. The
// compiler of Microsoft has no attribute for instruction sets and builds the portable code. ARM needs no versions, since
// its vectors of two doubles are in every processor. `target_clones` would need the loader of glibc.
// With "arch=haswell" or "avx2" instead of the levels of the x86-64 psABI, code would lack FMA or its tuning.
// GMWM_PORTABLE disables all versions for tests.
#if !defined(GMWM_PORTABLE) && (defined(__x86_64__) || defined(_M_X64)) && \
    (defined(__clang__) || (defined(__GNUC__) && __GNUC__ >= 12))
#define GMWM_HAS_CLONES 1
#else
#define GMWM_HAS_CLONES 0
#endif

// Functions that a version calls must be inlined into it; otherwise they would use the default instruction set.
#if defined(__GNUC__) || defined(__clang__)
#define GMWM_INLINE inline __attribute__((always_inline))
#else
#define GMWM_INLINE __forceinline
#endif

namespace gmwm {

// The levels of x86-64: 1 is AVX2 with FMA, 2 is AVX-512.
enum class Level { portable, v3, v4 };

// The level of this processor. It is `portable` until static variables have values; tests may lower it.
extern Level level;

// "x86-64-v4", "x86-64-v3" or "portable".
const char* running_clone();

// A function object that calls `f`, an inlined function, built for the level of this processor; `wide` replaces it at
// level v4.
template <auto f, auto wide = f, class Signature = decltype(f)>
struct Clones;

template <auto f, auto wide, class Result, class... Arguments>
struct Clones<f, wide, Result (*)(Arguments...)> {
#if GMWM_HAS_CLONES
  __attribute__((target("arch=x86-64-v4"))) static Result v4(Arguments... arguments) { return wide(arguments...); }
  __attribute__((target("arch=x86-64-v3"))) static Result v3(Arguments... arguments) { return f(arguments...); }

  Result operator()(Arguments... arguments) const {
    if (level == Level::v4) return v4(arguments...);
    if (level == Level::v3) return v3(arguments...);
    return f(arguments...);
  }
#else
  Result operator()(Arguments... arguments) const { return f(arguments...); }
#endif
};

}  // namespace gmwm
