// A first run of a reader that may crash, where a crash does no harm.
#pragma once

#include <functional>
#include <string>

#include "base/error.h"

namespace splatvol {

/// Runs `call` in a copy of this process, with what it prints thrown away, and waits for it: fails where that copy is
/// ended by a signal, or uses the processor for longer than `seconds`. Whatever else `call` does is lost. To be called
/// before other threads are at work.
[[nodiscard]] Status try_in_child(const std::string& path, unsigned seconds, const std::function<void()>& call);

}  // namespace splatvol
