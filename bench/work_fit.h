// Measures the constants of renderer/work.h.
#pragma once

#include <span>

#include "base/error.h"

namespace splatvol {

/// Draws pictures of each file and scene by the processor, and prints the constants that fit their times best, and how
/// far these are off. `arguments`: FILE SCENE [FILE SCENE...].
[[nodiscard]] Status fit_work(std::span<const char* const> arguments);

}  // namespace splatvol
