// Decodes chunks to drawing records.
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/math.h"
#include "format/layout.h"
#include "splat/record.h"

namespace splatvol {

/// A chunk as it was read.
struct ChunkBytes {
  format::ChunkEntry entry;
  std::span<const std::byte> packed;
};

/// Decodes the shapes of a row's records from its chunks: `centroid` and `moments`, or `position` and `octant`.
/// Positions stay on the grid of their chunk if it fits into one block; else make_blocks splits them. `cube`: of the
/// file. Errors begin with `what`. Safe on untrusted bytes. Thread-safe.
[[nodiscard]] Result<ShapeRow> decode_shapes(KernelKind kernel, const ChunkBytes& positions, const ChunkBytes& shapes,
                                             std::uint32_t points, const Cube& cube, std::string_view what);

/// The chunks of a row's values.
struct ValueChunks {
  ChunkBytes values;                      // `value_moments`, or `value`
  const ChunkBytes* gradients = nullptr;  // `gradient`, of the kernel octant; null: none
  const ChunkBytes* opacity = nullptr;    // as `values`, of the opacity attribute; null: none
};

/// Decodes the values of a row's records.
[[nodiscard]] Result<ValueRow> decode_values(KernelKind kernel, const ValueChunks& chunks, std::uint32_t points,
                                             std::string_view what);

}  // namespace splatvol
