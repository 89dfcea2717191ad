// Columns between memory and chunks (spec/svol-1.md, section 8).
#pragma once

#include <algorithm>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/math.h"
#include "format/codec.h"
#include "format/layout.h"

namespace splatvol::format {

/// Range and occupancy of stored values: what tells whether a transfer function leaves anything visible.
struct ValueSummary {
  float min = std::numeric_limits<float>::infinity();  // no present value: min > max
  float max = -std::numeric_limits<float>::infinity();
  std::uint64_t occupancy = 0;

  void include(const ValueSummary& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
    occupancy |= other.occupancy;
  }
};

/// The 64 bins of an attribute's stored values (spec 7).
struct ValueBins {
  double min = 0;
  double max = 0;

  /// Bin of a present value. Requires finite numbers, or min and max both NaN.
  [[nodiscard]] int bin(double stored) const {
    if (!(max > min)) return 0;
    return static_cast<int>(std::clamp((stored - min) / (max - min) * 64, 0.0, 63.0));
  }

  /// Over the present values: those that are finite.
  [[nodiscard]] ValueSummary summarize(std::span<const float> stored) const;
};

/// Mass and principal axes of a cluster's material, and what drawing it takes: what `moments` holds for a point.
struct SplatShape {
  double mass = 0;                     // volume, >= 0
  dvec3 deviations{0};                 // along the principal axes, descending
  glm::dquat orientation{1, 0, 0, 0};  // unit; turns x, y, z onto the principal axes
  dvec3 boundary{0};  // from the centroid to the foot of the perpendicular on the boundary's plane, in deviations along
                      // the principal axes, under 4; 0: no boundary
  double density = 1;  // factor on the splat's density, 1/16 to 15
};

/// Distribution of a value over a cluster's material: what `value_moments` holds for a point.
struct SplatValue {
  double mean = 0;       // stored value
  double deviation = 0;  // standard deviation
  dvec3 correlation{0};  // with the position along each principal axis, [-1, 1]
  double residual = 0;   // deviation that the linear field leaves, as a share of `deviation`, [0, 1]
  double coverage = 0;   // share of the mass that has a value, [0, 1]; 0: nothing else means anything
};

/// A chunk ready to be written.
struct PackedChunk {
  ChunkEntry entry;
  Bytes bytes;
};

/// Positions on a grid so fine that no coordinate moves by more than `error` (>= 0, world units), or exact where no
/// such grid is cheaper. Requires finite positions, at least one. Thread-safe, as are all functions here.
[[nodiscard]] PackedChunk pack_positions(std::span<const dvec3> positions, double error);

/// Stored values; those that are not finite become missing.
[[nodiscard]] PackedChunk pack_values(std::span<const float> stored, const ValueBins& bins);

/// Octant depths and counts, both of the group's length.
[[nodiscard]] PackedChunk pack_octants(std::span<const std::uint8_t> depths, std::span<const std::uint8_t> counts);

/// Shapes: finite, deviations descending. Mass and deviations come back within a factor 2^(1/256), unless they are
/// under 2^-511 of the largest; orientations so near that the end of each axis moves towards a shorter one by at most
/// 1/16 of that one's deviation, as far as 20 bits reach: for aspect ratios up to 10^4, and any where the axes are
/// those of space.
[[nodiscard]] PackedChunk pack_moments(std::span<const SplatShape> shapes);

/// Means, of single precision's range, within `error` (>= 0) wherever 32 bits and 2^-45 of the largest reach so far,
/// else within twice what they reach; correlations and residuals within 1/254 and 1/510, coverages within 1/255, of
/// which only 0 becomes 0. `summary` bounds what values the material takes; means that rounding has put outside are
/// moved.
[[nodiscard]] PackedChunk pack_value_moments(std::span<const SplatValue> values, double error,
                                             const ValueSummary& summary);

/// Directions of any length, 0 for none; components of the unit vector come back within 1/127.
[[nodiscard]] PackedChunk pack_gradients(std::span<const vec3> directions);

/// Unpack a chunk for as many points as `out` holds, into finite numbers within the ranges above (values: or NaN). Safe
/// on untrusted `packed`, whose hash is checked first; `what` begins the message of an error. A `centroid` column is
/// packed and unpacked as positions.
[[nodiscard]] Status unpack_positions(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                                      std::string_view what);
[[nodiscard]] Status unpack_values(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<float> out,
                                   std::string_view what);
[[nodiscard]] Status unpack_octants(const ChunkEntry& entry, std::span<const std::byte> packed,
                                    std::span<std::uint8_t> depths, std::span<std::uint8_t> counts,
                                    std::string_view what);
[[nodiscard]] Status unpack_moments(const ChunkEntry& entry, std::span<const std::byte> packed,
                                    std::span<SplatShape> out, std::string_view what);
[[nodiscard]] Status unpack_value_moments(const ChunkEntry& entry, std::span<const std::byte> packed,
                                          std::span<SplatValue> out, std::string_view what);
[[nodiscard]] Status unpack_gradients(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<vec3> out,
                                      std::string_view what);

/// The bound on position error that a packed chunk states, world units.
[[nodiscard]] Result<double> stated_position_error(const ChunkEntry& entry, std::span<const std::byte> packed);

}  // namespace splatvol::format
