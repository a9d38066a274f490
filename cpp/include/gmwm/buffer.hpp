// A block of doubles that is aligned to a cache line, and uses huge pages if it is large.
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
  void* block = nullptr;  // the block from malloc; the array starts at its first aligned address
  void operator()(double*) const { std::free(block); }
};

using AlignedArray = std::unique_ptr<double[], FreeBlock>;

// n doubles, not initialised; throws std::bad_alloc if memory is exhausted.
//
// This uses malloc instead of an aligned allocation: glibc reuses a freed block of up to 32 MiB for the next call, but
// not an aligned one, so that each call would have to map new pages.
inline AlignedArray aligned_array(std::size_t n) {
  if (n > SIZE_MAX / sizeof(double) - 2 * huge_page) throw std::bad_alloc();
  const bool large = n * sizeof(double) >= 2 * huge_page;
  const std::size_t alignment = large ? huge_page : cache_line;
  const std::size_t bytes = (n * sizeof(double) + alignment - 1) / alignment * alignment;
  void* block = std::malloc(bytes + alignment);
  if (block == nullptr) throw std::bad_alloc();
  const std::uintptr_t start = (reinterpret_cast<std::uintptr_t>(block) / alignment + 1) * alignment;
#if defined(__linux__) && defined(MADV_HUGEPAGE)
  // The first access to each small page causes a page fault, and all of them together can take longer than the
  // arithmetic. This is only a hint: it affects the speed and not the result.
  if (large) madvise(reinterpret_cast<void*>(start), bytes, MADV_HUGEPAGE);
#endif
  return AlignedArray{reinterpret_cast<double*>(start), FreeBlock{block}};
}

}  // namespace gmwm
