// How long something took, or may take.
#pragma once

#include <chrono>

namespace splatvol {

using Clock = std::chrono::steady_clock;

/// For `wait_until` of a condition variable. Its `wait` is a function of the library since GCC 12: a program that calls
/// it does not run with those of earlier compilers.
inline constexpr Clock::time_point no_deadline = Clock::time_point::max();

[[nodiscard]] inline double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

}  // namespace splatvol
