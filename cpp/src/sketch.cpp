#include "gmwm/sketch.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <memory>
#include <new>

#include "gmwm/bits.hpp"
#include "gmwm/clones.hpp"

namespace gmwm {

namespace {

constexpr std::size_t octaves = 2048, bins = octaves * sketch_octave;
// The mantissa of a double has 52 bits: the first 7 select the bin, and the next 24 are added to its sum.
constexpr int below_bin = 52 - std::countr_zero(sketch_octave), below_sum = below_bin - sketch_bits;
constexpr std::uint64_t rest = (std::uint64_t{1} << sketch_bits) - 1;
// The count (20 bits) and the sum (44 bits) of a bin share a word, so that a value costs one addition.
constexpr int count_at = 44;
constexpr std::uint64_t one = std::uint64_t{1} << count_at;
constexpr std::size_t room = (std::size_t{1} << 20) - 1;
// Number of values in a block, small enough for the first-level cache.
constexpr std::size_t block = 1024;

// The bins of a block of values, the word that each value adds to its bin, and the range of the bins.
struct Keys {
  std::array<std::uint32_t, block> bin;
  std::array<std::uint64_t, block> word;
  // The minimum of bin - 1. For bin 0, which counts zeros, this wraps around to the largest number and does not affect
  // the minimum.
  std::uint32_t below, highest;
};

constexpr std::uint32_t none = std::numeric_limits<std::uint32_t>::max();

GMWM_INLINE void key(double w, std::uint32_t& bin, std::uint64_t& word) {
  const std::uint64_t bits = bit_cast<std::uint64_t>(std::abs(w));
  bin = static_cast<std::uint32_t>(bits >> below_bin);
  word = (bits >> below_sum & rest) | one;
}

GMWM_INLINE void range(std::size_t n, Keys& keys) {
  std::uint32_t below = none, highest = 0;
  for (std::size_t i = 0; i < n; ++i) {
    below = std::min(below, keys.bin[i] - 1);
    highest = std::max(highest, keys.bin[i]);
  }
  keys.below = below;
  keys.highest = highest;
}

GMWM_INLINE void value_keys_inline(const double* w, std::size_t n, Keys* keys) {
  for (std::size_t i = 0; i < n; ++i) key(w[i], keys->bin[i], keys->word[i]);
  range(n, *keys);
}
constexpr Clones<value_keys_inline> value_keys{};

// |p[i] - 2 p[i + h] + p[i + 2 h]|, multiplied by `unit`.
GMWM_INLINE void haar_keys_inline(const double* p, std::size_t h, double unit, std::size_t n, Keys* keys) {
  for (std::size_t i = 0; i < n; ++i)
    key(unit * (p[i] + p[i + 2 * h] - 2.0 * p[i + h]), keys->bin[i], keys->word[i]);
  range(n, *keys);
}
constexpr Clones<haar_keys_inline> haar_keys{};

// Extends the sketch to the octaves first <= e < last.
void widen(SketchCounts& out, std::size_t first, std::size_t last) {
  const std::size_t held = out.counts.size() / sketch_octave;
  const std::size_t begin = held == 0 ? first : std::min(first, out.first);
  const std::size_t end = held == 0 ? last : std::max(last, out.first + held);
  for (auto* values : {&out.counts, &out.sums}) {
    if (held != 0) values->insert(values->begin(), (out.first - begin) * sketch_octave, 0);
    values->resize((end - begin) * sketch_octave, 0);
  }
  out.first = begin;
}

// Two copies of the counts of all possible bins: successive values often share a bin, and with one copy, the second
// addition would wait for the first. Only the pages of octaves that occur are used of the 4 MiB.
class Tally {
 public:
  void add(const Keys& keys, std::size_t n, SketchCounts& out) {
    if (taken_ + n > room) empty(out);
    taken_ += n;
    below_ = std::min(below_, keys.below);
    highest_ = std::max(highest_, keys.highest);
    std::uint64_t* const to = words_.get();
    std::size_t i = 0;
    for (; i + 2 <= n; i += 2) {
      to[2 * std::size_t{keys.bin[i]}] += keys.word[i];
      to[2 * std::size_t{keys.bin[i + 1]} + 1] += keys.word[i + 1];
    }
    for (; i < n; ++i) to[2 * std::size_t{keys.bin[i]}] += keys.word[i];
  }

  // Adds the counts to `out` and sets them to zero.
  void empty(SketchCounts& out) {
    out.zeros += take(0).count;
    if (highest_ >= infinite)
      for (std::size_t bin = infinite; bin <= highest_; ++bin) out.beyond += take(bin).count;
    if (below_ != none && below_ + 1 < infinite) {
      const std::size_t first = (below_ + 1) / sketch_octave;
      std::size_t last = std::min<std::size_t>(highest_, infinite - 1) / sketch_octave + 1;
      // If there are infinite values, the highest octave of finite values is not known.
      while (highest_ >= infinite && last > first + 1 && is_empty(last - 1)) --last;
      widen(out, first, last);
      for (std::size_t bin = std::max<std::size_t>(first * sketch_octave, 1); bin < last * sketch_octave; ++bin) {
        const Word word = take(bin);
        out.counts[bin - out.first * sketch_octave] += word.count;
        out.sums[bin - out.first * sketch_octave] += word.sum;
      }
    }
    taken_ = 0;
    below_ = none;
    highest_ = 0;
  }

 private:
  struct Word {
    std::uint64_t count, sum;
  };

  static constexpr std::size_t infinite = bins - sketch_octave;

  Word take(std::size_t bin) {
    std::uint64_t* const at = words_.get() + 2 * bin;
    const std::uint64_t a = at[0], b = at[1];
    at[0] = at[1] = 0;
    return {(a >> count_at) + (b >> count_at), (a & (one - 1)) + (b & (one - 1))};
  }

  bool is_empty(std::size_t octave) const {
    const std::uint64_t* const at = words_.get() + 2 * sketch_octave * octave;
    return std::all_of(at, at + 2 * sketch_octave, [](std::uint64_t word) { return word == 0; });
  }

  struct Free {
    void operator()(std::uint64_t* words) const { std::free(words); }
  };

  static std::unique_ptr<std::uint64_t[], Free> blank() {
    // The operating system provides zeroed pages on first access, so clearing the memory costs nothing.
    auto* const words = static_cast<std::uint64_t*>(std::calloc(2 * bins, sizeof(std::uint64_t)));
    if (words == nullptr) throw std::bad_alloc();
    return std::unique_ptr<std::uint64_t[], Free>(words);
  }

  std::unique_ptr<std::uint64_t[], Free> words_ = blank();
  std::size_t taken_ = 0;
  std::uint32_t below_ = none, highest_ = 0;
};

// All counts are zero at the start of a call, because each call sets them to zero at its end.
Tally& tally_of_this_thread() {
  thread_local Tally tally;
  return tally;
}

// Counts n values; keys(k, m, out) computes the bins of the values k … k + m - 1.
template <typename KeysOf>
SketchCounts counted(std::size_t n, KeysOf keys_of) {
  Tally& tally = tally_of_this_thread();
  SketchCounts out;
  Keys keys;
  try {
    for (std::size_t k = 0; k < n; k += block) {
      const std::size_t m = std::min(block, n - k);
      keys_of(k, m, &keys);
      tally.add(keys, m, out);
    }
    tally.empty(out);
  } catch (const std::bad_alloc&) {
    // The counts are only partly set to zero, so the next call must not use them.
    tally = Tally();
    throw;
  }
  return out;
}

}  // namespace

SketchCounts sketch_values(std::span<const double> values) {
  return counted(values.size(),
                 [=](std::size_t k, std::size_t m, Keys* keys) { value_keys(values.data() + k, m, keys); });
}

SketchCounts haar_sketch(std::span<const double> sum, std::size_t level, std::size_t begin, std::size_t end) {
  const std::size_t h = std::size_t{1} << (level - 1), first = std::max(begin, 2 * h - 1);
  const double unit = std::ldexp(1.0, -static_cast<int>(level));
  // P_t is sum[t + 1], P_{t - 2h} therefore sum[t + 1 - 2 h].
  const double* const from = sum.data() + (first + 1 - 2 * h);
  return counted(end > first ? end - first : 0,
                 [=](std::size_t k, std::size_t m, Keys* keys) { haar_keys(from + k, h, unit, m, keys); });
}

}  // namespace gmwm
