// Decodes chunks to the form from which splats are made.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <variant>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/layout.h"
#include "format/volume_info.h"
#include "streamer/record.h"

namespace splatvol {

/// The shape of a cluster's material: column `moments`. In DrawingUnits.
struct MaterialShape {
  float mass;                // times density
  vec3 deviations;           // descending
  vec3 orientation;          // as in MomentsSplat
  std::uint32_t boundary;    // as in MomentsSplat
  std::uint32_t turned = 3;  // principal axis about which the file's orientation was turned by 180 degrees; 3: none
};
static_assert(sizeof(MaterialShape) == 36);

/// The values of a cluster's material: column `value_moments`.
struct MaterialValue {
  float mean;
  float deviation;
  std::array<std::int8_t, 4> correlations;  // / 127, along the file's principal axes; then the residual
  float coverage;
};
static_assert(sizeof(MaterialValue) == 16);

/// One element for each point. The type depends on the column: positions and centroids; values, or sizes of splats
/// (column `octant`); gradients as in OctantSplat; `moments`; `value_moments`.
using DecodedChunk = std::variant<std::vector<dvec3>, std::vector<float>, std::vector<std::uint32_t>,
                                  std::vector<MaterialShape>, std::vector<MaterialValue>>;

/// Return the bytes of a decoded chunk, and the bytes that decoding needs besides these and the packed bytes. For
/// budgets.
[[nodiscard]] std::uint64_t decoded_bytes(format::ColumnKind kind, std::uint64_t points);
[[nodiscard]] std::uint64_t decoding_bytes(format::ColumnKind kind, std::uint64_t points, std::uint64_t unpacked_bytes);

/// Returns the most bytes that the payload of a chunk can have.
[[nodiscard]] std::uint64_t largest_payload(format::ColumnKind kind, std::uint64_t points);

/// Checks and decodes a chunk. Fails with unsupported for an unknown kind. `cube`: the file's. Positions stay in
/// world units; other lengths are in units of drawing_length(cube.edge). `what` begins the message of an error. Safe
/// on untrusted bytes. Thread-safe.
[[nodiscard]] Result<DecodedChunk> decode_chunk(format::ColumnKind kind, const format::ChunkEntry& entry,
                                                std::span<const std::byte> packed, std::uint32_t points,
                                                const Cube& cube, std::string_view what);

/// Converts to single precision, in units of `length`. Keeps x, y and z of the quaternion, after turning it by 180
/// degrees about a principal axis if w is under 1/2.
[[nodiscard]] MaterialShape compact(const format::SplatShape& shape, double length = 1);

/// Converts to single precision and bytes; all 0 if no part of the material has a value.
[[nodiscard]] MaterialValue compact(const format::SplatValue& value);

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

/// Decodes the values of a row's records from its chunk `value_moments`, or `value` and, unless it is null, `gradient`.
[[nodiscard]] Result<ValueRow> decode_values(KernelKind kernel, const ChunkBytes& values, const ChunkBytes* gradients,
                                             std::uint32_t points, std::string_view what);

}  // namespace splatvol
