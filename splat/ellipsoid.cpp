#include "splat/ellipsoid.h"

#include "splat/kernel.h"

namespace splatvol {
namespace {

// The map from the ball to the principal axes: each axis is scaled, after a stretch across the boundary.
struct BallMap {
  dvec3 deviations;  // of the widened material
  dvec3 foot{0};     // of the perpendicular from the centroid on the boundary plane, in these deviations
  dvec3 normal{0};   // of the plane, in the ball
  double stretch = 1;

  BallMap(const SplatShape& shape, double variance) : deviations(shape.deviations) {
    if (variance > 0) deviations = glm::sqrt(deviations * deviations + variance);
    if (!(glm::length(shape.boundary) > 0)) return;
    foot = shape.boundary;
    if (variance > 0) {
      constexpr double least_kept = 1e-3;  // the plane of flat material stays finite
      const dvec3 across = shape.boundary / glm::max(shape.deviations / deviations, least_kept);
      foot = across * (glm::dot(shape.boundary, shape.boundary) / glm::dot(across, across));
    }
    const double distance = glm::length(foot);
    normal = foot / distance;
    stretch = std::sqrt(1 + distance * distance);
  }

  // The stretch by a factor along the normal.
  [[nodiscard]] dmat3 along_normal(double factor) const {
    return dmat3(1) + (factor - 1) * glm::outerProduct(normal, normal);
  }
};

dmat3 from_ball(const dmat3& axes, const BallMap& map) {
  const dvec3& d = map.deviations;
  const dmat3 scale(dvec3(d.x, 0, 0), dvec3(0, d.y, 0), dvec3(0, 0, d.z));
  return moments_half_width * (axes * scale * map.along_normal(map.stretch));
}

}  // namespace

Ellipsoid ellipsoid_of(const dvec3& centroid, const SplatShape& shape, double variance) {
  const BallMap map(shape, variance);
  const dvec3& d = map.deviations;
  if (!(shape.mass > 0 && d.z > 0)) return {};
  const dmat3 axes = glm::mat3_cast(shape.orientation);
  const dmat3 shrink(dvec3(1 / d.x, 0, 0), dvec3(0, 1 / d.y, 0), dvec3(0, 0, 1 / d.z));
  const dmat3 from = from_ball(axes, map);

  Ellipsoid ellipsoid;
  ellipsoid.center = centroid + axes * (d * map.foot);
  ellipsoid.to_ball = (1 / moments_half_width) * (map.along_normal(1 / map.stretch) * shrink * glm::transpose(axes));
  for (int k = 0; k < 3; ++k) ellipsoid.reach[k] = glm::length(dvec3(from[0][k], from[1][k], from[2][k]));
  const double volume = std::pow(moments_half_width, 3) * d.x * d.y * d.z * map.stretch;
  ellipsoid.outward = map.normal;
  ellipsoid.peak = (ellipsoid.has_boundary() ? 2 : 1) * shape.mass * moments_peak / volume;
  return std::isfinite(ellipsoid.peak) ? ellipsoid : Ellipsoid{};
}

dmat3 from_ball(const SplatShape& shape, double variance) {
  return from_ball(glm::mat3_cast(shape.orientation), BallMap(shape, variance));
}

SplatShape with_thickness(SplatShape shape) {
  constexpr double least = 1e-6;  // share of the length
  shape.deviations = glm::max(shape.deviations, dvec3(least * shape.deviations.x));
  return shape;
}

std::optional<Chord> chord_of(const Ellipsoid& ellipsoid, const dvec3& origin, const dvec3& direction) {
  const dvec3 from = ellipsoid.in_ball(origin), along = ellipsoid.to_ball * direction;
  const double square = glm::dot(along, along);
  Chord chord{};
  chord.middle = -glm::dot(from, along) / square;
  const dvec3 miss = from + chord.middle * along;
  const double rest = 1 - glm::dot(miss, miss);
  if (!(rest > 0)) return {};
  chord.half = std::sqrt(rest / square);
  chord.peak = ellipsoid.density(miss);
  chord.begin = chord.middle - chord.half;
  chord.end = chord.middle + chord.half;
  if (ellipsoid.has_boundary()) {
    const double slope = glm::dot(ellipsoid.outward, along), meeting = -glm::dot(ellipsoid.outward, from) / slope;
    if (slope > 0) chord.end = std::min(chord.end, meeting);
    if (slope < 0) chord.begin = std::max(chord.begin, meeting);
    if (slope == 0 && ellipsoid.is_cut_off(from)) return {};
  }
  if (!(chord.begin < chord.end)) return {};
  return chord;
}

LinearField field_of(const dvec3& centroid, const SplatShape& shape, const SplatValue& value, double variance) {
  const dvec3 shares = value.correlation * value.correlation;  // of the value's variance, along each axis
  double left = std::max(1 - shares.x - shares.y - shares.z, 0.0);
  dvec3 slope(0);
  for (int k = 0; k < 3; ++k) {
    const double square = shape.deviations[k] * shape.deviations[k];
    const double kept = square > 0 ? square / (square + variance) : 0;
    if (kept > 0) slope[k] = value.correlation[k] * kept / shape.deviations[k];
    left += shares[k] * (1 - kept);
  }
  return {centroid, value.mean, glm::mat3_cast(shape.orientation) * (value.deviation * slope),
          value.deviation * std::sqrt(left)};
}

}  // namespace splatvol
