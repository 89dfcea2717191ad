// Draw lists of splats in batches.
#pragma once

#include <span>

#include "streamer/record.h"
#include "streamer/splat.h"

namespace splatvol {

/// Packs the splats of batches, one row for each batch.
[[nodiscard]] DrawList pack_draw_list(SplatSpan splats, std::span<const SplatBatch> batches, const DrawingUnits& units);

}  // namespace splatvol
