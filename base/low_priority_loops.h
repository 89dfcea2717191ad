// Loops (base/parallel.h) that give way to those that somebody waits for.
#pragma once

#include <oneapi/tbb/task_scheduler_observer.h>

#include "base/low_priority.h"

namespace splatvol {

/// While it lives, this thread and the threads that help with its loops have a low priority, which they keep.
class LowPriorityLoops : public oneapi::tbb::task_scheduler_observer {
 public:
  LowPriorityLoops() {
    lower_thread_priority();
    observe(true);
  }
  ~LowPriorityLoops() override { observe(false); }
  LowPriorityLoops(const LowPriorityLoops&) = delete;
  LowPriorityLoops& operator=(const LowPriorityLoops&) = delete;

  void on_scheduler_entry(bool is_worker) override {
    if (is_worker) lower_thread_priority();
  }
};

}  // namespace splatvol
