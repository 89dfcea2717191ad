// The statistics that svrender writes, and its summary.
#pragma once

#include <array>
#include <string>

#include "tools/svrender_drawing.h"

namespace splatvol {

/// Returns the statistics as JSON text. Requires timings.frame not to be empty.
[[nodiscard]] std::string statistics_text(const RenderOptions& options, const Drawn& drawn, const Timings& timings);

/// Prints a line about the picture, whose file has this size in pixels, and one where it is coarser than the options
/// ask for.
void print_summary(const RenderOptions& options, std::array<int, 2> size, const Drawn& drawn, const Timings& timings);

}  // namespace splatvol
