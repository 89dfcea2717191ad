#include "library/python/module/interruptible_call.h"

#include <nanobind/nanobind.h>

#include <chrono>
#include <condition_variable>
#include <exception>
#include <stop_token>
#include <thread>

#include "base/interruption.h"

namespace splatvol::python {
namespace {

namespace nb = nanobind;

constexpr std::chrono::milliseconds look_interval{50};

// A call on a thread of its own.
class Call {
 public:
  explicit Call(const std::function<void()>& call) : thread_([this, &call] { run(call); }) {}

  [[nodiscard]] bool wait_for(std::chrono::milliseconds time) {
    std::unique_lock lock(mutex_);
    return changed_.wait_for(lock, time, [this] { return is_done_; });
  }

  void request_stop() { stop_.request_stop(); }

  // Returns the exception of the call, once it is done; null: none.
  [[nodiscard]] std::exception_ptr thrown() const { return thrown_; }

 private:
  void run(const std::function<void()>& call) {
    try {
      const Interruptible heeds(stop_.get_token());
      call();
    } catch (...) {
      thrown_ = std::current_exception();
    }
    const std::scoped_lock lock(mutex_);
    is_done_ = true;
    changed_.notify_all();
  }

  std::stop_source stop_;
  std::mutex mutex_;
  std::condition_variable changed_;
  bool is_done_ = false;
  std::exception_ptr thrown_;
  std::jthread thread_;  // last: the rest outlives it
};

// Runs handlers of signals, and `look`. Returns what one of them raised.
std::exception_ptr look_around(const WhileCalling& meanwhile) {
  const nb::gil_scoped_acquire gil;
  try {
    if (PyErr_CheckSignals() != 0) nb::raise_python_error();
    if (meanwhile.look) meanwhile.look();
  } catch (...) {
    return std::current_exception();
  }
  return nullptr;
}

// Waits for the end of a call. Returns what ended it early.
std::exception_ptr wait(Call& call, const WhileCalling& meanwhile) {
  std::exception_ptr raised;
  while (!call.wait_for(look_interval)) {
    if (!raised) raised = look_around(meanwhile);
    if (!raised) continue;
    call.request_stop();
    // Again and again: a cancellation before the call has begun ends nothing.
    if (meanwhile.cancel) meanwhile.cancel();
  }
  return raised;
}

}  // namespace

void ProgressBox::put(const std::string& stage, double share) {
  const std::scoped_lock lock(mutex_);
  if (entries_.empty() || entries_.back().first != stage) entries_.emplace_back(stage, share);
  entries_.back().second = share;
}

std::vector<ProgressBox::Entry> ProgressBox::take() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(entries_, {});
}

void run_interruptibly(const std::function<void()>& call, const WhileCalling& meanwhile) {
  std::exception_ptr raised, thrown;
  {
    const nb::gil_scoped_release no_gil;
    Call running(call);
    raised = wait(running, meanwhile);
    thrown = running.thrown();
  }
  if (raised) std::rethrow_exception(raised);
  if (thrown) std::rethrow_exception(thrown);
  if (meanwhile.look) meanwhile.look();
}

}  // namespace splatvol::python
