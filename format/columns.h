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

/// Unpack a chunk for as many points as `out` holds. Safe on untrusted `packed`, whose hash is checked first; `what`
/// begins the message of an error.
[[nodiscard]] Status unpack_positions(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                                      std::string_view what);
[[nodiscard]] Status unpack_values(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<float> out,
                                   std::string_view what);
[[nodiscard]] Status unpack_octants(const ChunkEntry& entry, std::span<const std::byte> packed,
                                    std::span<std::uint8_t> depths, std::span<std::uint8_t> counts,
                                    std::string_view what);

/// The bound on position error that a packed chunk states, world units.
[[nodiscard]] Result<double> stated_position_error(const ChunkEntry& entry, std::span<const std::byte> packed);

}  // namespace splatvol::format
