// A first run of a reader that may crash, in a process of its own.
#pragma once

#include <functional>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Runs `call` in a copy of this process, waits for it, and drops its output and all its other effects. Fails if a
/// signal ends the copy, or if the copy uses the processor for longer than `seconds`. Call it before other threads run.
[[nodiscard]] Status try_in_child(const std::string& path, unsigned seconds, const std::function<void()>& call);

}  // namespace splatvol
