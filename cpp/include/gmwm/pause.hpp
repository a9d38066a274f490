// Lets the caller end a long loop: the module sets a function that looks for Ctrl-C and throws.
#pragma once

#include <atomic>
#include <chrono>
#include <cstddef>

namespace gmwm {

using Interruption = void (*)();
inline std::atomic<Interruption> interruption{nullptr};

// Called in each round of a loop. Looks for an interruption every 50 ms, with the clock read every `every` rounds.
class Pause {
 public:
  explicit Pause(std::size_t every) : every_(every), left_(every) {}

  void operator()() {
    if (--left_ != 0) return;
    left_ = every_;
    const auto now = Clock::now();
    if (now - last_ < std::chrono::milliseconds(50)) return;
    last_ = now;
    if (const Interruption interrupted = interruption.load(std::memory_order_relaxed)) interrupted();
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::size_t every_, left_;
  Clock::time_point last_ = Clock::now();
};

}  // namespace gmwm
