// What is read of a step of a series before the step is shown.
#pragma once

#include <chrono>
#include <cstddef>
#include <future>
#include <stop_token>
#include <utility>

#include "base/interruption.h"

namespace splatvol {

/// Reads something of a step on a thread of its own. Where no thread starts, take() reads it.
template <class Read>
class StepAhead {
 public:
  /// Calls read() once. A stop interrupts it (base/interruption.h).
  template <class Function>
  StepAhead(std::size_t step, Function read)
      : step_(step),
        read_(std::async(std::launch::async | std::launch::deferred,
                         [read = std::move(read), stop = stop_.get_token()]() mutable {
                           const Interruptible interruptible(stop);
                           return read();
                         })) {}
  StepAhead(const StepAhead&) = delete;
  StepAhead& operator=(const StepAhead&) = delete;

  /// Stops the reading. Waits for its end, and not for a server.
  ~StepAhead() { stop(); }

  [[nodiscard]] std::size_t step() const { return step_; }
  [[nodiscard]] bool is_done() const { return read_.wait_for(std::chrono::seconds(0)) != std::future_status::timeout; }
  void stop() { stop_.request_stop(); }

  /// Waits for the end of the reading. Called once, at the end.
  [[nodiscard]] Read take() { return read_.get(); }

 private:
  std::size_t step_;
  std::stop_source stop_;
  std::future<Read> read_;
};

}  // namespace splatvol
