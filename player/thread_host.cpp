#include "player/thread_host.h"

#include <oneapi/tbb/task_scheduler_observer.h>

#include <cmath>
#include <future>
#include <system_error>

#include "base/low_priority.h"

namespace splatvol {
namespace {

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

class ThreadJob final : public Job {
 public:
  explicit ThreadJob(std::future<void> ended) : ended_(std::move(ended)) {}

  [[nodiscard]] bool wait(double seconds) const override {
    if (std::isfinite(seconds))
      return ended_.wait_for(std::chrono::duration<double>(seconds)) == std::future_status::ready;
    ended_.wait();
    return true;
  }

 private:
  std::future<void> ended_;
};

}  // namespace

std::unique_ptr<Job> ThreadHost::begin(std::function<void()> work, Priority priority) {
  const auto kept = std::make_shared<std::function<void()>>(std::move(work));  // what it captures may be large
  const auto run = [kept, priority] {
    if (priority == Priority::usual) return (*kept)();
    const LowPriority low;
    (*kept)();
  };
  try {
    return std::make_unique<ThreadJob>(std::async(std::launch::async, run));
  } catch (const std::system_error&) {  // no thread starts
    return InlineHost::begin(run, priority);
  }
}

}  // namespace splatvol
