// Decodes chunks to drawing records.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/math.h"
#include "format/layout.h"
#include "streamer/record.h"

namespace splatvol {

/// A chunk as it was read.
struct ChunkBytes {
  format::ChunkEntry entry;
  std::span<const std::byte> packed;
};

/// Decodes the shapes of a row's records from its chunks: `centroid` and `moments`, or `position` and `octant`.
/// `cube`: of the file. Errors begin with `what`. Safe on untrusted bytes. Thread-safe.
[[nodiscard]] Result<ShapeRow> decode_shapes(KernelKind kernel, const ChunkBytes& positions, const ChunkBytes& shapes,
                                             std::uint32_t points, const Cube& cube, std::string_view what);

/// Decodes the values of a row's records from its chunk `value_moments`, or `value` and, unless it is null, `gradient`.
[[nodiscard]] Result<ValueRow> decode_values(KernelKind kernel, const ChunkBytes& values, const ChunkBytes* gradients,
                                             std::uint32_t points, std::string_view what);

}  // namespace splatvol
