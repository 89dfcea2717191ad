// The next file of a series of files, opened on a thread of its own.
#pragma once

#include <chrono>
#include <cstddef>
#include <future>
#include <memory>
#include <stop_token>

#include "base/interruption.h"
#include "format/steps.h"

namespace splatvol {

/// Opens the file of a step. Its destruction does not wait for a server. Where no thread starts, volume() opens it.
class StepAhead {
 public:
  StepAhead(const format::Steps& steps, std::size_t step)
      : step_(step),
        volume_(std::async(std::launch::async | std::launch::deferred, [steps, step, stop = stop_.get_token()] {
          const Interruptible interruptible(stop);
          return steps.volume(step);
        })) {}
  StepAhead(const StepAhead&) = delete;
  StepAhead& operator=(const StepAhead&) = delete;
  ~StepAhead() { stop_.request_stop(); }

  [[nodiscard]] std::size_t step() const { return step_; }
  [[nodiscard]] bool is_done() const {
    return volume_.wait_for(std::chrono::seconds(0)) != std::future_status::timeout;
  }

  /// Waits for it. Called once, at the end.
  [[nodiscard]] Result<std::shared_ptr<const format::Volume>> volume() { return volume_.get(); }

 private:
  std::size_t step_;
  std::stop_source stop_;
  std::future<Result<std::shared_ptr<const format::Volume>>> volume_;
};

}  // namespace splatvol
