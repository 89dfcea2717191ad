#include "player/thread_host.h"

#include <cmath>
#include <future>
#include <optional>
#include <system_error>

#include "base/low_priority_loops.h"

namespace splatvol {
namespace {

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

std::unique_ptr<Job> ThreadHost::begin(std::function<bool()> work, Priority priority) {
  const auto kept = std::make_shared<std::function<bool()>>(std::move(work));  // what it captures may be large
  const auto run = [kept, priority] {
    std::optional<LowPriorityLoops> low;
    if (priority == Priority::low) low.emplace();
    while (!(*kept)()) {
    }
  };
  try {
    return std::make_unique<ThreadJob>(std::async(std::launch::async, run));
  } catch (const std::system_error&) {  // no thread starts
    const auto run_once = [run] {
      run();
      return true;
    };
    return InlineHost::begin(run_once, priority);
  }
}

}  // namespace splatvol
