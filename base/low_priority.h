// Threads that give way to those that somebody waits for.
#pragma once

#include <sys/resource.h>
#include <unistd.h>

namespace splatvol {

/// Gives this thread the lowest priority, for good. Where nothing else wants the processors, it is as fast as before.
/// If the system refuses, that costs the others time only.
inline void lower_thread_priority() {
  constexpr int lowest = 19;
  static_cast<void>(::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), lowest));
}

}  // namespace splatvol
