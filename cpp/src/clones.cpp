#include "gmwm/clones.hpp"

#include <cstdint>

#if GMWM_HAS_CLONES
#include <cpuid.h>
#endif

namespace gmwm {

namespace {

#if GMWM_HAS_CLONES
// Bits of CPUID and of XCR0, as the manuals of Intel and AMD number them. __builtin_cpu_supports would need a library of
// the compiler that not every linker adds.
constexpr std::uint32_t ymm_state = 0x6, zmm_state = 0xe6;
constexpr std::uint32_t fma = 1u << 12, movbe = 1u << 22, osxsave = 1u << 27, f16c = 1u << 29;
constexpr std::uint32_t lzcnt = 1u << 5;
constexpr std::uint32_t bmi1 = 1u << 3, avx2 = 1u << 5, bmi2 = 1u << 8;
constexpr std::uint32_t avx512 = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31;  // f, dq, cd, bw, vl

bool has(std::uint32_t bits, std::uint32_t all) { return (bits & all) == all; }

// What the operating system saves of the registers.
std::uint32_t saved_state() {
  std::uint32_t low, high;
  __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
  return low;
}

Level level_of_processor() {
  unsigned a, b, c, d, extended_b, extended_c;
  if (!__get_cpuid(1, &a, &b, &c, &d) || !has(c, fma | movbe | osxsave | f16c)) return Level::portable;
  if (!__get_cpuid(0x80000001u, &a, &b, &extended_c, &d) || !has(extended_c, lzcnt)) return Level::portable;
  if (!__get_cpuid_count(7, 0, &a, &extended_b, &c, &d) || !has(extended_b, bmi1 | avx2 | bmi2)) return Level::portable;
  const std::uint32_t state = saved_state();
  if (!has(state, ymm_state)) return Level::portable;
  return has(extended_b, avx512) && has(state, zmm_state) ? Level::v4 : Level::v3;
}
#else
Level level_of_processor() { return Level::portable; }
#endif

}  // namespace

Level level = level_of_processor();

const char* running_clone() {
  return level == Level::v4 ? "x86-64-v4" : level == Level::v3 ? "x86-64-v3" : "portable";
}

}  // namespace gmwm
