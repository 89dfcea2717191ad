// Work that gives way to the window.
#pragma once

#include <oneapi/tbb/task_scheduler_observer.h>

#include "base/low_priority.h"

namespace splatvol {

/// While it lives, this thread and the threads of TBB that help it have a low priority, which they keep.
class LowPriority : public oneapi::tbb::task_scheduler_observer {
 public:
  LowPriority() {
    lower_thread_priority();
    observe(true);
  }
  ~LowPriority() override { observe(false); }
  LowPriority(const LowPriority&) = delete;
  LowPriority& operator=(const LowPriority&) = delete;

  void on_scheduler_entry(bool is_worker) override {
    if (is_worker) lower_thread_priority();
  }
};

}  // namespace splatvol
