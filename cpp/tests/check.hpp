// The least a test needs: count what fails, say where, and let main() return it.
#pragma once

#include <cmath>
#include <cstdio>

#include "gmwm/clones.hpp"

namespace check {

inline int failures = 0;

inline void that(bool condition, const char* text, const char* file, int line) {
  if (condition) return;
  ++failures;
  std::printf("%s:%d: not true: %s\n", file, line, text);
}

// |got - expected| <= relative |expected|; false for NaN.
inline void close(double got, double expected, double relative, const char* text, const char* file, int line) {
  if (std::abs(got - expected) <= relative * std::abs(expected)) return;
  ++failures;
  std::printf("%s:%d: %s: got %.17g, expected %.17g within %g relative\n", file, line, text, got, expected, relative);
}

// Runs the tests at each level of this processor; what main() returns.
inline int at_each_level(const char* name, void (*tests)()) {
  const gmwm::Level highest = gmwm::level;
  for (const gmwm::Level level : {gmwm::Level::portable, gmwm::Level::v3, gmwm::Level::v4}) {
    if (level > highest) break;
    gmwm::level = level;
    tests();
    std::printf("%s, %s: %s\n", name, gmwm::running_clone(), failures == 0 ? "passed" : "FAILED");
  }
  return failures == 0 ? 0 : 1;
}

}  // namespace check

#define CHECK(condition) check::that((condition), #condition, __FILE__, __LINE__)
#define CHECK_CLOSE(got, expected, relative) check::close((got), (expected), (relative), #got, __FILE__, __LINE__)
