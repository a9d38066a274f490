// Products of two vectors and small systems of linear equations.
#pragma once

#include <cstddef>
#include <vector>

#include "gmwm/clones.hpp"
#include "gmwm/pack.hpp"

namespace gmwm {

// Inlined, for loops that have versions themselves.
GMWM_INLINE double dot_product(const double* a, const double* b, std::size_t n) {
  Pack first = Pack::of(0), second = first;
  std::size_t i = 0;
  for (; i + 2 * Pack::size <= n; i += 2 * Pack::size) {
    first = first + Pack::load(a + i) * Pack::load(b + i);
    second = second + Pack::load(a + i + Pack::size) * Pack::load(b + i + Pack::size);
  }
  for (; i + Pack::size <= n; i += Pack::size) first = first + Pack::load(a + i) * Pack::load(b + i);
  double total = (first + second).total();
  for (; i < n; ++i) total += a[i] * b[i];
  return total;
}

double dot(const double* a, const double* b, std::size_t n);

// Solves the system a x = b (n x n, row by row) by elimination with row exchanges; false if it is singular.
bool solve_linear(std::vector<double>& a, std::vector<double>& b);

}  // namespace gmwm
