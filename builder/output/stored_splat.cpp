#include "builder/output/stored_splat.h"

namespace splatvol {

StoredSplat make_stored_splat(const dvec3& position, double point_error, const SpatialMoments& moments,
                              const SplatShape& shape, const BoundaryPlane& plane) {
  const double shortest = shortest_deviation(shape);
  StoredSplat splat{.centroid = position + moments.centroid,
                    .error = shortest > 0 ? shortest * error_per_deviation : point_error,
                    .shape = shape};
  if (plane.area != dvec3(0)) splat.shape.boundary = boundary_foot(plane, moments, shape);
  return splat;
}

StoredValue make_stored_value(const ValueMoments& moments, const SplatShape& shape,
                              const format::Attribute& attribute) {
  const auto [low, high] = stored_range(moments, attribute);
  const SplatValue value = value_of(moments, shape);
  return {static_cast<float>(attribute.stored(value.mean)),
          static_cast<float>(value.deviation / attribute.scale),
          vec3(value.correlation),
          static_cast<float>(value.coverage),
          low,
          high};
}

format::ValueSummary summarize_range(float low, float high, const format::ValueBins& bins) {
  if (!(low <= high)) return {};
  return {low, high, bins.between(low, high)};
}

}  // namespace splatvol
