// Points and splats as the file stores them, and their packing into chunks.
#pragma once

#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/math.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "format/columns.h"
#include "format/volume_info.h"

namespace splatvol {

/// A point's place, and by how much the file may move it (world units).
struct PlacedPoint {
  dvec3 position{0};
  double error = 0;
};

/// A splat at one resolution, but for its values.
struct SplatRow {
  dvec3 centroid{0};
  double error = 0;  // of the centroid
  format::SplatShape shape;
  std::uint64_t number = 0;  // among the splats of its resolution, in Morton order
  std::uint8_t depth = 0;    // of its leaf in the octree over its resolution
  std::uint8_t count = 0;    // points in that leaf, at most 255
};

/// An attribute's values in it, less the attribute's offset.
struct ValueRow {
  format::SplatValue value;
  float min, max;  // of the material; min > max where it has no value
};

/// Rows that follow each other in the file: points of one segment, and their splats at one resolution. Arrays as the
/// columns want them, all of one length, but that those of points are empty where the resolution is not the segment's
/// own.
struct SplatRows {
  struct Splats {
    std::vector<dvec3> centroids;
    std::vector<double> errors;  // of the centroids
    std::vector<format::SplatShape> shapes;
    std::vector<std::uint64_t> numbers;
    std::vector<std::uint8_t> depths, counts;
  };
  struct SplatValues {
    std::vector<format::SplatValue> moments;
    std::vector<float> min, max;
  };
  struct Points {
    std::vector<dvec3> positions;
    std::vector<double> errors;
  };
  struct PointValues {
    std::vector<float> values;    // less the attribute's offset; NaN: missing
    std::vector<vec3> gradients;  // unit vectors, 0 for none
  };
  Splats splats;
  std::vector<SplatValues> splat_values;  // [attribute]
  Points points;
  std::vector<PointValues> point_values;  // [attribute]

  explicit SplatRows(std::size_t attributes) : splat_values(attributes), point_values(attributes) {}
  [[nodiscard]] std::size_t size() const { return splats.centroids.size(); }

  void reserve(std::size_t rows);

  /// Adds a row; `values` has one for each attribute.
  void add_splat(const SplatRow& splat, std::span<const ValueRow> values);

  /// Adds the row's point, whose values follow.
  void add_point(const PlacedPoint& point);
  void add_point_value(std::size_t attribute, float value, const vec3& gradient);

  /// Appends rows from `begin` to `end` of another.
  void append(const SplatRows& other, std::size_t begin, std::size_t end);

  /// Keeps the memory.
  void clear();
};

/// The splat of `moments`, whose shape_of is `shape`, cut at `plane`, about a point at `position`. `point_error`: of
/// the position, for a splat without extent. Depth, count and number are left 0.
[[nodiscard]] SplatRow make_splat_row(const dvec3& position, double point_error, const SpatialMoments& moments,
                                      const format::SplatShape& shape, const BoundaryPlane& plane);
[[nodiscard]] inline SplatRow make_splat_row(const dvec3& position, double point_error, const SpatialMoments& moments,
                                             const BoundaryPlane& plane) {
  return make_splat_row(position, point_error, moments, shape_of(moments), plane);
}

/// What `shape` of all material holds of an attribute with this offset, and between which values.
[[nodiscard]] format::SplatValue stored_value(const ValueMoments& moments, const format::SplatShape& shape,
                                              double offset);
[[nodiscard]] inline std::pair<float, float> stored_range(const ValueMoments& moments, double offset) {
  if (!(moments.mass > 0)) return {std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()};
  return {static_cast<float>(moments.min - offset), static_cast<float>(moments.max - offset)};
}
[[nodiscard]] ValueRow make_value_row(const ValueMoments& moments, const format::SplatShape& shape, double offset);

/// For emplace_back(InPlace{make}): the element is made where it is to be, by make().
template <class Make>
struct InPlace {
  Make make;
  operator std::invoke_result_t<Make>() const { return make(); }
};
template <class Make>
InPlace(Make) -> InPlace<Make>;

/// Fetches memory into the cache that is going to be read, or written.
inline void prefetch_lines(const void* begin, std::size_t bytes) {
  constexpr std::size_t line = 64;
  for (std::size_t at = 0; at < bytes; at += line) __builtin_prefetch(static_cast<const char*>(begin) + at, 1);
}

/// What share of a splat's smallest deviation its centroid, and its point's position, may move by.
inline constexpr double error_per_deviation = 1.0 / 64;

/// The smallest deviation that is not 0, what is too thin for rounding; 0 for no material.
[[nodiscard]] inline double shortest_deviation(const format::SplatShape& shape) {
  const dvec3& d = shape.deviations;
  return d.z > 0 ? d.z : d.y > 0 ? d.y : d.x;
}

/// Bounds what values the material takes whose least is `low` and whose largest `high`, stored values; none where
/// low > high.
[[nodiscard]] format::ValueSummary summarize_range(float low, float high, const format::ValueBins& bins);

/// A chunk for each of `columns`. Thread-safe.
[[nodiscard]] std::vector<format::PackedChunk> pack_rows(const SplatRows& rows,
                                                         const std::vector<format::Column>& columns,
                                                         const std::vector<format::Attribute>& attributes);

}  // namespace splatvol
