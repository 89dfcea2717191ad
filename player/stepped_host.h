// A host where nothing may wait.
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <utility>

#include "player/session_host.h"

namespace splatvol {

/// A host without threads, for files whose reads do not wait (ByteSource::waits). Each call of Job::wait
/// tries the job once. Without a limit of time it tries on and on: then the job must have been stopped.
class SteppedHost final : public InlineHost {
 public:
  [[nodiscard]] std::unique_ptr<Job> begin(std::function<bool()> work, Priority /*priority*/) override {
    return std::make_unique<SteppedJob>(std::move(work));
  }

 private:
  class SteppedJob final : public Job {
   public:
    explicit SteppedJob(std::function<bool()> work) : work_(std::move(work)) {}
    [[nodiscard]] bool wait(double seconds) const override {
      do has_ended_ = has_ended_ || work_();
      while (!has_ended_ && seconds == std::numeric_limits<double>::infinity());
      return has_ended_;
    }

   private:
    std::function<bool()> work_;
    mutable bool has_ended_ = false;
  };
};

}  // namespace splatvol
