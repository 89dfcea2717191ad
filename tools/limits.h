// Limits that the system sets to a program: address space and threads.
#pragma once

#include "base/error.h"

namespace splatvol {

/// Makes do with what the system allows: fewer threads, smaller stacks and fewer pools of memory. `most_threads`: of
/// the program's work; 0: as many as there are cores. Fails, with what is needed, if the program would end in the
/// middle of its work. Call it once, before other threads start.
[[nodiscard]] Status heed_limits(unsigned most_threads);

}  // namespace splatvol
