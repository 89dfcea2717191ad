// Points and splats column by column, as the file stores them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/math.h"
#include "builder/output/stored_splat.h"
#include "format/columns.h"

namespace splatvol {

/// Points that follow each other in a segment, with their splats at one resolution. All arrays have one length, but the
/// arrays of points are empty unless the resolution is the segment's own.
struct SplatColumns {
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
    std::vector<vec3> gradients;  // unit vectors; 0: none
  };
  Splats splats;
  std::vector<SplatValues> splat_values;  // [attribute]
  Points points;
  std::vector<PointValues> point_values;  // [attribute]

  explicit SplatColumns(std::size_t attributes) : splat_values(attributes), point_values(attributes) {}
  [[nodiscard]] std::size_t size() const { return splats.centroids.size(); }

  void reserve(std::size_t size);

  /// Adds a splat; `values` has one for each attribute.
  void add_splat(const StoredSplat& splat, std::span<const StoredValue> values);

  /// Adds the splat's point. Its values follow.
  void add_point(const PointPosition& point);
  void add_point_value(std::size_t attribute, float value, const vec3& gradient);

  /// Appends elements [begin, end) of another.
  void append(const SplatColumns& other, std::size_t begin, std::size_t end);

  /// Keeps the memory.
  void clear();
};

}  // namespace splatvol
