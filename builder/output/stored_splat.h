// A splat as the file stores it.
#pragma once

#include <cstdint>
#include <limits>
#include <type_traits>
#include <utility>

#include "base/math.h"
#include "builder/mesh/boundary.h"
#include "builder/mesh/moments.h"
#include "format/columns.h"
#include "format/stored_value.h"
#include "format/volume_info.h"

namespace splatvol {

/// A point's position, and how far the file may move it (world units).
struct PointPosition {
  dvec3 position{0};
  double error = 0;
};

using format::StoredValue;

/// A splat at one resolution, without its values.
struct StoredSplat {
  dvec3 centroid{0};
  double error = 0;  // how far the file may move the centroid
  SplatShape shape;
  std::uint8_t depth = 0;  // of its leaf in the octree over its resolution
  std::uint8_t count = 0;  // points in that leaf, at most 255
};

/// Makes the splat of `moments`, whose shape_of is `shape`, cut at `plane`, about a point at `position`. `point_error`:
/// error of the position, for a splat without extent. Leaves depth and count 0.
[[nodiscard]] StoredSplat make_stored_splat(const dvec3& position, double point_error, const SpatialMoments& moments,
                                            const SplatShape& shape, const BoundaryPlane& plane);
[[nodiscard]] inline StoredSplat make_stored_splat(const dvec3& position, double point_error,
                                                   const SpatialMoments& moments, const BoundaryPlane& plane) {
  return make_stored_splat(position, point_error, moments, shape_of(moments), plane);
}

/// Least and largest stored value of the material; first > second if it has no value.
[[nodiscard]] inline std::pair<float, float> stored_range(const ValueMoments& moments,
                                                          const format::Attribute& attribute) {
  if (!(moments.mass > 0)) return {std::numeric_limits<float>::infinity(), -std::numeric_limits<float>::infinity()};
  return {static_cast<float>(attribute.stored(moments.min)), static_cast<float>(attribute.stored(moments.max))};
}

/// Returns the distribution of an attribute's stored values in the splat `shape` of all material, and their range.
[[nodiscard]] StoredValue make_stored_value(const ValueMoments& moments, const SplatShape& shape,
                                            const format::Attribute& attribute);

/// For emplace_back(MadeBy{make}) and construct_at: make() makes the element in its memory, so that nothing is copied.
template <class Make>
struct MadeBy {
  Make make;
  operator std::invoke_result_t<Make>() const { return make(); }
};
template <class Make>
MadeBy(Make) -> MadeBy<Make>;

/// The file may move a splat's centroid, and its point, by this share of the splat's smallest deviation.
inline constexpr double error_per_deviation = 1.0 / 64;

/// The smallest deviation that is not 0: a deviation too small for rounding is 0. Returns 0 for a splat without extent.
[[nodiscard]] inline double shortest_deviation(const SplatShape& shape) {
  const dvec3& d = shape.deviations;
  return d.z > 0 ? d.z : d.y > 0 ? d.y : d.x;
}

/// Summary of material whose stored values span [low, high]: its range and occupied bins. Empty if low > high.
[[nodiscard]] format::ValueSummary summarize_range(float low, float high, const format::ValueBins& bins);

}  // namespace splatvol
