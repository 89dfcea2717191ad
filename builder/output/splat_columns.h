// Points and splats column by column, as the file stores them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/output/stored_splat.h"
#include "format/codec.h"
#include "format/columns.h"

namespace splatvol {

/// Points that follow each other in a segment, with their splats at one resolution. All arrays have one length, but the
/// arrays of points are empty unless the resolution is the segment's own.
struct SplatColumns {
  struct Splats {
    std::vector<dvec3> centroids;
    std::vector<SplatShape> shapes;
    std::vector<std::uint8_t> depths, counts;
    double least_error = std::numeric_limits<double>::infinity();  // of the centroids
  };
  struct Points {
    std::vector<dvec3> positions;
    double least_error = std::numeric_limits<double>::infinity();
  };
  struct PointValues {
    std::vector<float> values;    // less the attribute's offset; NaN: missing
    std::vector<vec3> gradients;  // unit vectors; 0: none. Empty if not wanted
  };
  Splats splats;
  std::vector<std::vector<StoredValue>> splat_values;  // [attribute]
  Points points;
  std::vector<PointValues> point_values;  // [attribute]

  explicit SplatColumns(std::size_t attributes) : splat_values(attributes), point_values(attributes) {}
  [[nodiscard]] std::size_t size() const { return splats.centroids.size(); }

  void reserve(std::size_t size);

  /// Adds a splat; `values` has one for each attribute.
  void add_splat(const StoredSplat& splat, std::span<const StoredValue> values);

  /// Adds the splat's point. Its values follow.
  void add_point(const PointPosition& point);
  void add_point_value(std::size_t attribute, float value) { point_values[attribute].values.push_back(value); }
  void add_gradient(std::size_t attribute, const vec3& gradient) {
    point_values[attribute].gradients.push_back(gradient);
  }

  void append(const SplatColumns& other);

  /// Appends all arrays to bytes, for append_from() later on, or in another process of this build.
  void put_into(format::Bytes& bytes) const;

  /// Appends what put_into() wrote at the front of `bytes`. Returns how many bytes that were. Requires as many
  /// attributes.
  std::size_t append_from(std::span<const std::byte> bytes);

  /// Bytes of a splat with its point, about.
  [[nodiscard]] static std::size_t bytes_of_splat(std::size_t attributes, bool gradients);

  /// Keeps the memory.
  void clear();
};

}  // namespace splatvol
