// Columns as the codes of the file (spec/svol-1.md, section 8), for readers that keep codes instead of numbers.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/layout.h"

namespace splatvol::format {

/// Positions or centroids, one code for each point on each axis.
struct PositionCodes {
  bool exact = false;  // codes are the bits of coordinates; otherwise coordinate = origin + quantisation_step code
  dvec3 origin{0};
  double quantisation_step = 0;
  double error = 0;  // that the chunk states, world units
  std::array<std::vector<std::uint64_t>, 3> axes;

  /// Returns the least and the largest coordinate of the points [begin, end) on an axis; +infinity and -infinity if
  /// there are none. Requires finite coordinates, as those of a chunk that was unpacked are.
  [[nodiscard]] std::pair<double, double> range(int axis, std::size_t begin, std::size_t end) const;
};

/// The column `moments`. Log codes mean 0, or scale 2^((code - 65535) / 128).
struct MomentCodes {
  double mass_scale = 0;
  double deviation_scale = 0;
  int component_bits = 0;                                // of an orientation
  std::vector<std::uint16_t> masses;                     // log codes of the mass itself
  std::array<std::vector<std::uint16_t>, 3> deviations;  // log codes, descending
  std::vector<std::uint64_t> orientations;
  std::array<std::vector<std::int16_t>, 3> boundaries;
  std::vector<std::uint8_t> densities;
};

/// The column `value_moments`. Means are numbers, since each depends on those before it.
struct ValueMomentCodes {
  double deviation_scale = 0;
  double least_step = 0;  // of the means; 0: they are exact
  std::vector<double> means;
  std::vector<std::uint16_t> deviations;  // 0, or deviation_scale 2^((1 - code) / 8)
  std::array<std::vector<std::int8_t>, 3> correlations;
  std::vector<std::uint8_t> coverages;
};

/// Unpack a chunk of `points` points into codes; with the same checks, errors and arguments as the functions of
/// columns.h. Memory of `out` is used again. After an error, `out` holds anything. Thread-safe.
[[nodiscard]] Status unpack_position_codes(const ChunkEntry& entry, std::span<const std::byte> packed,
                                           std::size_t points, const Cube& cube, std::string_view what,
                                           PositionCodes& out);
[[nodiscard]] Status unpack_centroid_codes(const ChunkEntry& entry, std::span<const std::byte> packed,
                                           std::size_t points, const Cube& cube, std::string_view what,
                                           PositionCodes& out);
[[nodiscard]] Status unpack_moment_codes(const ChunkEntry& entry, std::span<const std::byte> packed, std::size_t points,
                                         double edge, std::string_view what, MomentCodes& out);
[[nodiscard]] Status unpack_value_moment_codes(const ChunkEntry& entry, std::span<const std::byte> packed,
                                               std::size_t points, std::string_view what, ValueMomentCodes& out);

/// The same for directions: 3 signed bytes / 127 in each number, the lowest first.
[[nodiscard]] Status unpack_gradient_codes(const ChunkEntry& entry, std::span<const std::byte> packed,
                                           std::span<std::uint32_t> out, std::string_view what);

}  // namespace splatvol::format
