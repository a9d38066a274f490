// The least a test needs: count what fails, say where, and let main() return it.
#pragma once

#include <cmath>
#include <cstdio>

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

// What main() returns.
inline int result(const char* name) {
  std::printf("%s: %s\n", name, failures == 0 ? "passed" : "FAILED");
  return failures == 0 ? 0 : 1;
}

}  // namespace check

#define CHECK(condition) check::that((condition), #condition, __FILE__, __LINE__)
#define CHECK_CLOSE(got, expected, relative) check::close((got), (expected), (relative), #got, __FILE__, __LINE__)
