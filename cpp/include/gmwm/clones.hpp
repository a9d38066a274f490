// Function versions for wider instruction sets, chosen once when the library is loaded.
#pragma once

// Only glibc on x86-64 resolves such functions at load time; elsewhere the portable code stands alone.
// "arch=haswell" would leave AMD with the default, and plain "avx2" has no FMA: hence the two levels
// of the x86-64 psABI. GMWM_PORTABLE leaves all of it out, for tests. <cstdlib> brings __GLIBC__.
#include <cstdlib>

#if defined(GMWM_PORTABLE)
#define GMWM_HAS_CLONES 0
#define GMWM_CLONES
#elif defined(__x86_64__) && defined(__GLIBC__) && defined(__GNUC__) && !defined(__clang__) && __GNUC__ >= 12
#define GMWM_HAS_CLONES 1
#define GMWM_CLONES __attribute__((target_clones("arch=x86-64-v4", "arch=x86-64-v3", "default")))
#else
#define GMWM_HAS_CLONES 0
#define GMWM_CLONES
#endif

// What a clone calls must be inlined into it, or it would run the default's instructions.
#if defined(__GNUC__)
#define GMWM_INLINE inline __attribute__((always_inline))
#else
#define GMWM_INLINE __forceinline
#endif

namespace gmwm {

// The name of the clone that runs on this machine: "x86-64-v4", "x86-64-v3", "default" or "portable".
const char* running_clone();

}  // namespace gmwm
