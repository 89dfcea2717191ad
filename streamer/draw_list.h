// Draw lists of splats in batches.
#pragma once

#include <span>

#include "streamer/record.h"
#include "streamer/splat.h"

namespace splatvol {

/// Packs the splats of batches, one row for each batch.
[[nodiscard]] DrawList pack_draw_list(SplatSpan splats, std::span<const SplatBatch> batches, const DrawingUnits& units);

/// Gives the ranges of a packed list the weights of its batches. Requires the batches that it was packed from.
void set_weights(DrawList& list, std::span<const SplatBatch> batches);

}  // namespace splatvol
