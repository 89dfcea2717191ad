// Points of a stream in memory.
#pragma once

#include <cstddef>
#include <functional>
#include <limits>

#include "base/error.h"
#include "builder/points/point_batch.h"

namespace splatvol {

/// Reads points that are left of a stream: all, or until there are more than `enough`.
[[nodiscard]] Result<PointBatch> hold_all(const NextPoints& next, std::size_t attributes,
                                          std::size_t enough = std::numeric_limits<std::size_t>::max());

/// Finds the material of points [begin, end) of all that are held, and appends it to a batch that has these points
/// already.
using AddMaterial = std::function<void(const PointBatch& held, std::size_t begin, std::size_t end, PointBatch& batch)>;

/// A stream that returns these points, some hundred at a time. `add_material`: adds their material, if they have none
/// yet; that of all would take far more memory.
[[nodiscard]] NextPoints stream_of(PointBatch points, AddMaterial add_material = {});

}  // namespace splatvol
