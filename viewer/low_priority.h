// Work that gives way to the window.
#pragma once

#include <oneapi/tbb/task_scheduler_observer.h>
#include <sys/resource.h>
#include <unistd.h>

namespace splatvol {

/// While it lives, this thread and the threads of TBB that help it have a low priority, which they keep. Where nothing
/// else wants the processors, they are as fast as without.
class LowPriority : public oneapi::tbb::task_scheduler_observer {
 public:
  LowPriority() {
    lower();
    observe(true);
  }
  ~LowPriority() override { observe(false); }
  LowPriority(const LowPriority&) = delete;
  LowPriority& operator=(const LowPriority&) = delete;

  void on_scheduler_entry(bool is_worker) override {
    if (is_worker) lower();
  }

 private:
  // A refusal costs speed only.
  static void lower() { static_cast<void>(::setpriority(PRIO_PROCESS, static_cast<id_t>(::gettid()), 10)); }
};

}  // namespace splatvol
