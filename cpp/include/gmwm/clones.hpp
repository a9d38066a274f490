// Versions of functions for wider instruction sets; the loader of the library selects one.
#pragma once

// Only glibc on x86-64 resolves such functions at load time, with GCC from 12 on and Clang from 18 on. Elsewhere there is
// only the portable code, whose Haar kernel takes three times as long on a processor with AVX-512.
// With "arch=haswell", AMD processors would use the default version, and "avx2" does not include FMA, so the
// two levels of the x86-64 psABI are used. GMWM_PORTABLE disables all versions for tests. <cstdlib> defines __GLIBC__.
#include <cstdlib>

#if defined(GMWM_PORTABLE)
#define GMWM_HAS_CLONES 0
#define GMWM_CLONES
#elif defined(__x86_64__) && defined(__GLIBC__) && \
    ((defined(__clang__) && __clang_major__ >= 18) || (!defined(__clang__) && defined(__GNUC__) && __GNUC__ >= 12))
#define GMWM_HAS_CLONES 1
#define GMWM_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define GMWM_HAS_CLONES 0
#define GMWM_CLONES
#endif

// Functions that a clone calls must be inlined into it; otherwise they would use the default instruction set.
#if defined(__GNUC__)
#define GMWM_INLINE inline __attribute__((always_inline))
#else
#define GMWM_INLINE __forceinline
#endif

namespace gmwm {

// The name of the clone that runs on this machine: "x86-64-v4", "x86-64-v3", "default" or "portable".
const char* running_clone();

}  // namespace gmwm
