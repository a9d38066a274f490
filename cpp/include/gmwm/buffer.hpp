// A block of doubles that starts on a cache line, and on huge pages where it is large.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <new>

#if defined(__linux__)
#include <sys/mman.h>
#endif

namespace gmwm {

inline constexpr std::size_t cache_line = 64;
inline constexpr std::size_t huge_page = std::size_t{1} << 21;

struct FreeBlock {
  void* block = nullptr;  // what malloc gave; the array starts at the next aligned address in it
  void operator()(double*) const { std::free(block); }
};

using AlignedArray = std::unique_ptr<double[], FreeBlock>;

// n doubles, not initialised; throws std::bad_alloc where there is no room.
//
// malloc and not an aligned allocation: glibc keeps a freed block of up to 32 MiB for the next call, but not
// one that it had to align, and then every call would pay for fresh pages.
inline AlignedArray aligned_array(std::size_t n) {
  if (n > SIZE_MAX / sizeof(double) - 2 * huge_page) throw std::bad_alloc();
  const bool large = n * sizeof(double) >= 2 * huge_page;
  const std::size_t alignment = large ? huge_page : cache_line;
  const std::size_t bytes = (n * sizeof(double) + alignment - 1) / alignment * alignment;
  void* block = std::malloc(bytes + alignment);
  if (block == nullptr) throw std::bad_alloc();
  const std::uintptr_t start = (reinterpret_cast<std::uintptr_t>(block) / alignment + 1) * alignment;
#if defined(__linux__) && defined(MADV_HUGEPAGE)
  // The first touch of every small page traps into the kernel, which can take longer than the arithmetic.
  // A wish, not a demand: whether it is granted changes nothing but the time.
  if (large) madvise(reinterpret_cast<void*>(start), bytes, MADV_HUGEPAGE);
#endif
  return AlignedArray{reinterpret_cast<double*>(start), FreeBlock{block}};
}

}  // namespace gmwm
