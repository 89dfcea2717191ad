// All points of a stream in memory.
#pragma once

#include <cstddef>

#include "base/error.h"
#include "builder/points/point_batch.h"

namespace splatvol {

/// Reads all points that are left of a stream.
[[nodiscard]] Result<PointBatch> hold_all(const NextPoints& next, std::size_t attributes);

/// A stream that returns these points all at once.
[[nodiscard]] NextPoints stream_of(PointBatch points);

}  // namespace splatvol
