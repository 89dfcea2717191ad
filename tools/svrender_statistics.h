// The statistics that svrender writes, and its summary.
#pragma once

#include <string>

#include "tools/svrender_drawing.h"

namespace splatvol {

/// Returns the statistics as JSON text. Requires timings.frame not to be empty.
[[nodiscard]] std::string statistics_text(const RenderOptions& options, const Drawn& drawn, const Timings& timings);

/// Prints a line about the picture, and one where it is coarser than the options ask for.
void print_summary(const RenderOptions& options, const Drawn& drawn, const Timings& timings);

}  // namespace splatvol
