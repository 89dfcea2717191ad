// Packs columns into chunks, and unpacks them (spec/svol-1.md, section 8).
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/math.h"
#include "format/codec.h"
#include "format/layout.h"
#include "splat/shape.h"

namespace splatvol::format {

/// Largest magnitude of a stored value. Differences of such values stay in the range of single precision.
inline constexpr float largest_stored_value = 0x1p126F;

/// Range and occupied bins of stored values. They tell whether a transfer function leaves anything visible.
struct ValueSummary {
  float min = std::numeric_limits<float>::infinity();  // min > max: no present value
  float max = -std::numeric_limits<float>::infinity();
  std::uint64_t occupancy = 0;

  /// Whether this is the range of stored values, or of none (spec 5).
  [[nodiscard]] bool is_valid() const {
    constexpr float none = std::numeric_limits<float>::infinity();
    return (min == none && max == -none) || (-largest_stored_value <= min && min <= max && max <= largest_stored_value);
  }

  void include(const ValueSummary& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
    occupancy |= other.occupancy;
  }
};

/// Returns the range and the bins of a chunk of values.
[[nodiscard]] inline ValueSummary summary_of(const ChunkEntry& entry) {
  return {entry.min, entry.max, entry.occupancy};
}

/// The 64 bins of an attribute's stored values (spec 7).
struct ValueBins {
  double min = 0;
  double max = 0;

  /// Returns the bin of a present value. Requires finite numbers, or min and max both NaN.
  [[nodiscard]] int bin(double stored) const {
    if (!(max > min)) return 0;
    return static_cast<int>(std::clamp((stored - min) / (max - min) * 64, 0.0, 63.0));
  }

  /// Summarizes the present values, which are the finite ones.
  [[nodiscard]] ValueSummary summarize(std::span<const float> stored) const;

  /// Returns the bins from that of `low` to that of `high`, as in an occupancy. Requires low <= high.
  [[nodiscard]] std::uint64_t between(double low, double high) const { return between_bins(bin(low), bin(high)); }

  /// The same for the numbers of two bins.
  [[nodiscard]] static std::uint64_t between_bins(int low, int high) {
    const std::uint64_t all = ~std::uint64_t{0};
    return all << low & all >> (63 - high);
  }
};

/// Stored values near the mean of a splat's material, one of which it has (spec R22) unless its variance is too small
/// for double precision. low > high: it has no value.
struct ValueInterval {
  float low = std::numeric_limits<float>::infinity();
  float high = -std::numeric_limits<float>::infinity();
};

/// Counts of values in each of the 64 bins.
using Histogram = std::array<std::uint64_t, 64>;

/// The result of pack_values for the values of a chunk.
struct StoredValues {
  Histogram histogram{};      // of the values as they come back
  std::uint64_t missing = 0;  // values that come back as missing
  double error = 0;           // none differs by more from what comes back
};

/// A chunk ready to be written.
struct PackedChunk {
  ChunkEntry entry;
  Bytes bytes;
};

/// Packs positions on a grid that moves no coordinate by more than `error` (>= 0, world units), or exactly if no such
/// grid is shorter. Requires finite positions, at least one. Sets `stated_error` to the bound that the chunk states,
/// unless it is null. Thread-safe, as are all functions here.
[[nodiscard]] PackedChunk pack_positions(std::span<const dvec3> positions, double error,
                                         double* stated_error = nullptr);

/// Packs centroids in the same way, for a file with this cube. Moves those that are farther outside of the cube than a
/// file may have them.
[[nodiscard]] PackedChunk pack_centroids(std::span<const dvec3> centroids, double error, const Cube& cube);

/// Packs stored values on a grid that moves none by more than `error` (>= 0), or exactly if no such grid is shorter.
/// Values that are not finite, or beyond `largest_stored_value`, become missing. Fills `result` unless it is null.
[[nodiscard]] PackedChunk pack_values(std::span<const float> stored, double error, const ValueBins& bins,
                                      StoredValues* result = nullptr);

/// Packs octant depths and counts. Requires spans of one length.
[[nodiscard]] PackedChunk pack_octants(std::span<const std::uint8_t> depths, std::span<const std::uint8_t> counts);

/// Packs shapes, for a file whose cube has this edge. Requires finite numbers and descending deviations. Cuts off what
/// passes the bounds of a file: deviations at `edge`, and boundaries that lie farther away. The rest comes back:
/// - mass and deviations within a factor 2^(1/256), unless they are under 2^-511 of the largest;
/// - orientations so that the end of each axis moves towards a shorter axis by at most 1/16 of the shorter deviation.
///   20 bits suffice up to aspect ratios of 10^4. If the axes are the coordinate axes, they suffice for any aspect
///   ratio.
[[nodiscard]] PackedChunk pack_moments(std::span<const SplatShape> shapes, double edge);

/// Packs the distributions of a value. `summary` bounds the values of the material. Requires means in the range of
/// single precision. These come back:
/// - means within 0.07 deviations, or within 0.51 least_step (>= 0) if this is more; in single precision if means are
///   too far from each other for such steps. Means outside of `summary`, by rounding, are moved into it first;
/// - deviations within a factor 2^(1/16), unless they are under 2^-8191 of the largest. Those above the length of the
///   range of `summary`, by rounding, become as large as it;
/// - correlations within 1/30. Residuals follow from them;
/// - coverages within 1/255. Only 0 becomes 0.
[[nodiscard]] PackedChunk pack_value_moments(std::span<const SplatValue> values, double least_step,
                                             const ValueSummary& summary);

/// Packs directions of any length; 0 is no direction. The components of the unit vectors come back within 1/127.
[[nodiscard]] PackedChunk pack_gradients(std::span<const vec3> directions);

/// Unpack a chunk of as many points as `out` has. The numbers are finite, within the ranges above, and within the
/// bounds that the specification sets for a file with this cube, or with its edge (R17); a value may also be NaN.
/// `what` begins the message of an error. Safe on untrusted `packed`: its hash is checked first. `entry` is as
/// Volume::read_directory_page returns it.
[[nodiscard]] Status unpack_positions(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                                      const Cube& cube, std::string_view what);
[[nodiscard]] Status unpack_centroids(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                                      const Cube& cube, std::string_view what);
/// The same for vertices of cells, which may be 4 edges outside of the cube.
[[nodiscard]] Status unpack_vertices(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<dvec3> out,
                                     const Cube& cube, std::string_view what);
[[nodiscard]] Status unpack_values(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<float> out,
                                   std::string_view what);
[[nodiscard]] Status unpack_octants(const ChunkEntry& entry, std::span<const std::byte> packed,
                                    std::span<std::uint8_t> depths, std::span<std::uint8_t> counts,
                                    std::string_view what);
[[nodiscard]] Status unpack_moments(const ChunkEntry& entry, std::span<const std::byte> packed,
                                    std::span<SplatShape> out, double edge, std::string_view what);
[[nodiscard]] Status unpack_value_moments(const ChunkEntry& entry, std::span<const std::byte> packed,
                                          std::span<SplatValue> out, std::string_view what);
[[nodiscard]] Status unpack_gradients(const ChunkEntry& entry, std::span<const std::byte> packed, std::span<vec3> out,
                                      std::string_view what);

/// The same for a chunk of value moments, of which it returns only where material is sure to be.
[[nodiscard]] Status unpack_value_intervals(const ChunkEntry& entry, std::span<const std::byte> packed,
                                            std::span<ValueInterval> out, std::string_view what);

/// As unpack_values. Returns the bound on the error of stored values that follows from the chunk's form: 0 if it is
/// exact.
[[nodiscard]] Result<double> unpack_values_and_error(const ChunkEntry& entry, std::span<const std::byte> packed,
                                                     std::span<float> out, std::string_view what);

}  // namespace splatvol::format
