// A host without threads.
#pragma once

#include <chrono>

#include "player/session_host.h"

namespace splatvol {

/// Runs each job at once, on the thread of the call.
class InlineHost : public SessionHost {
 public:
  [[nodiscard]] std::unique_ptr<Job> begin(std::function<void()> work, Priority /*priority*/) override {
    struct Ended final : Job {
      [[nodiscard]] bool wait(double /*seconds*/) const override { return true; }
    };
    work();
    return std::make_unique<Ended>();
  }

  [[nodiscard]] double now() const override {
    return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
  }
};

}  // namespace splatvol
