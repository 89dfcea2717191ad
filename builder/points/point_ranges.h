// Bounds of points and of their values, and the cube and the attributes of the file that follow from them.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/math.h"
#include "format/volume_info.h"

namespace splatvol {

/// Bounds of points and their values. Empty at first: low > high.
struct PointRanges {
  Box box;
  std::vector<double> low, high;  // [attribute]
  std::vector<double> least;      // [attribute]: the smallest absolute value that is not 0; infinity: none

  explicit PointRanges(std::size_t attributes);
  void include_value(std::size_t attribute, double value);  // NaN: ignored
  void include(const PointRanges& other);
};

/// The smallest cube round the points; of edge 1 if they all coincide, because a cube needs a size. Fails if the edge
/// is under `least_extent`. Requires coordinates within `largest_coordinate`.
[[nodiscard]] Result<Cube> bounding_cube(const Box& box);

/// An attribute with the values [low, high]; without a range if low > high.
[[nodiscard]] format::Attribute describe_attribute(const std::string& name, double low, double high);

}  // namespace splatvol
