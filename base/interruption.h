// Ends a thread's wait for a server.
#pragma once

#include <chrono>
#include <stop_token>

#include "base/error.h"

namespace splatvol {

/// While it lives, reads of this thread from servers heed a stop: when it is requested, a read in progress ends within
/// a tenth of a second, with an error, and so does each later one at once. Reads from disks do not wait for anybody,
/// and end by themselves. Long work looks at it too, and ends with ErrorCode::cancelled.
class Interruptible {
 public:
  explicit Interruptible(std::stop_token stop);
  Interruptible(const Interruptible&) = delete;
  Interruptible& operator=(const Interruptible&) = delete;
  ~Interruptible();

 private:
  std::stop_token before_;
};

/// Returns whether a stop of this thread's reads has been requested.
[[nodiscard]] bool is_interrupted();

/// Fails with ErrorCode::cancelled if a stop has been requested: for loops of long work.
[[nodiscard]] Status check_interruption();

/// Returns the stop that this thread heeds, for threads that read on its behalf.
[[nodiscard]] std::stop_token stop_of_thread();

/// The longest time for which a read waits without a look at `is_interrupted`.
inline constexpr std::chrono::milliseconds interruption_delay{50};

/// Sleeps for a time, or until a stop is requested.
void sleep_interruptibly(std::chrono::milliseconds time);

}  // namespace splatvol
