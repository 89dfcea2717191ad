// A host of sessions that begins a thread for each job.
#pragma once

#include "player/session_host.h"

namespace splatvol {

class ThreadHost final : public InlineHost {
 public:
  [[nodiscard]] std::unique_ptr<Job> begin(std::function<bool()> work, Priority priority) override;
};

}  // namespace splatvol
