// Threads that give way to those that somebody waits for.
#pragma once

#include <sys/resource.h>
#include <unistd.h>

namespace splatvol {

/// Gives this thread a low priority, for good. Where nothing else wants the processors, it is as fast as before. If the
/// system refuses, that costs the others time only.
inline void lower_thread_priority() {
  // A tenth of the usual share. With the lowest, 19, pictures would take minutes beside a simulation on all processors.
  constexpr int nice = 10;
  static_cast<void>(::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), nice));
}

}  // namespace splatvol
