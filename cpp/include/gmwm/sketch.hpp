// Counts of |W| in absolute bins: what a robust variance needs to know of coefficients that are not kept.
//
// A bin is told by the leading bits of a double, exponent and the first 7 of the mantissa: 128 bins an octave, 0.4 to
// 0.8 % wide, the same for every signal. A bin holds how many values fell in and the sum of their next 24 bits, from
// which the mean of the bin follows to 2^-31. All are integers: sketches merge by addition, in any order and grouping,
// to the same last bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace gmwm {

// Bins of one octave.
inline constexpr std::size_t sketch_octave = 128;
// Bits of a value below its bin that are kept in the sum.
inline constexpr int sketch_bits = 24;

struct SketchCounts {
  std::uint64_t zeros = 0;   // values below 2^-1029, in bin 0
  std::uint64_t beyond = 0;  // infinite ones, and NaN
  std::size_t first = 0;     // number of the first octave in counts; octave e holds 2^(e - 1023) <= |w| < 2^(e - 1022)
  std::vector<std::uint64_t> counts;  // whole octaves from there on
  std::vector<std::uint64_t> sums;    // of (|w| / width of the bin, less its beginning), in units of 2^-24
};

// Of the values of an array.
SketchCounts sketch_values(std::span<const double> values);

// Of the Haar coefficients W_{j,t} of level j at begin <= t < end, t >= 2^j - 1. `sum` is the running sum of the whole
// signal, sum[t + 1] = P_t (haar.hpp); end <= sum.size() - 1.
SketchCounts haar_sketch(std::span<const double> sum, std::size_t level, std::size_t begin, std::size_t end);

}  // namespace gmwm
