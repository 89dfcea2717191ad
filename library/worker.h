// A thread that runs calls one after another.
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>
#include <type_traits>

#include "base/clock.h"

namespace splatvol {

/// Runs calls on a thread of its own. What belongs to a thread, as contexts of OpenGL do, stays away from the caller's.
class Worker {
 public:
  /// Runs `call` on the thread and returns its result. Calls from several threads wait for each other. Must not be
  /// called on the thread itself.
  template <class Call>
  auto run(Call call) {
    using R = decltype(call());
    const std::scoped_lock one(one_);
    if constexpr (std::is_void_v<R>) {
      run_task(call);
    } else {
      R result;
      run_task([&] { result = call(); });
      return result;
    }
  }

 private:
  void run_task(const std::function<void()>& task) {
    std::unique_lock lock(mutex_);
    task_ = &task;
    changed_.notify_all();
    changed_.wait_until(lock, no_deadline, [&] { return task_ == nullptr; });
  }

  void work(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (changed_.wait_until(lock, stop, no_deadline, [&] { return task_ != nullptr; })) {
      lock.unlock();
      (*task_)();
      lock.lock();
      task_ = nullptr;
      changed_.notify_all();
    }
  }

  std::mutex one_;
  std::mutex mutex_;
  std::condition_variable_any changed_;
  const std::function<void()>* task_ = nullptr;
  std::jthread thread_{[this](const std::stop_token& stop) { work(stop); }};
};

}  // namespace splatvol
