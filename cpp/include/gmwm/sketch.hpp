// A histogram of |W| with fixed bins, from which a robust variance is computed without storing the coefficients.
//
// The bin of a value is given by the leading bits of the double: the exponent and the first 7 bits of the mantissa.
// There are 128 bins per octave, 0.4 to 0.8 % wide, the same for every signal. A bin holds the number of its values and
// the sum of their next 24 bits, which gives the mean of the bin with a relative error of 2^-31. All of these are
// integers, so merging sketches by addition gives bit-identical results in any order and grouping.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace gmwm {

// Number of bins in an octave.
inline constexpr std::size_t sketch_octave = 128;
// Number of bits after the bin bits that are added to the sum of the bin.
inline constexpr int sketch_bits = 24;

struct SketchCounts {
  std::uint64_t zeros = 0;   // values below 2^-1029, in bin 0
  std::uint64_t beyond = 0;  // infinite values and NaN
  std::size_t first = 0;     // index of the first octave in counts; octave e holds 2^(e - 1023) <= |w| < 2^(e - 1022)
  std::vector<std::uint64_t> counts;  // all bins of the octaves from `first` on
  std::vector<std::uint64_t> sums;    // sums of (|w| - lower edge) / width of the bin, in units of 2^-24
};

// Sketch of the values of an array.
SketchCounts sketch_values(std::span<const double> values);

// Sketch of the Haar coefficients W_{j,t} of level j at begin <= t < end, t >= 2^j - 1. `sum` is the running sum of the
// whole signal, sum[t + 1] = P_t (haar.hpp); end <= sum.size() - 1.
SketchCounts haar_sketch(std::span<const double> sum, std::size_t level, std::size_t begin, std::size_t end);

}  // namespace gmwm
