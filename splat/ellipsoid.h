// What a splat of the kernel `moments` fills, and its value there: the definition, in double precision (docs/design.md,
// "A splat"). The forms of renderer/cpu/ and renderer/gl/ are fast, and are tested against it.
#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "base/math.h"
#include "splat/shape.h"

namespace splatvol {

/// An ellipsoid in which density falls as (1 - |u|^2)^(3/2), or half of it. u = to_ball (x - centre) are the
/// coordinates of a position x in the unit ball.
struct Ellipsoid {
  dvec3 center{0};
  dmat3 to_ball{0};
  dvec3 reach{0};    // half extents of the box round it
  double peak = 0;   // density at the centre; 0: draws nothing
  dvec3 outward{0};  // unit, in the ball: the half on this side of the centre is cut off by a boundary; 0: nothing is

  [[nodiscard]] bool has_boundary() const { return outward != dvec3(0); }
  [[nodiscard]] bool is_cut_off(const dvec3& u) const { return glm::dot(outward, u) > 0; }

  [[nodiscard]] dvec3 in_ball(const dvec3& position) const { return to_ball * (position - center); }

  /// Returns the density as if nothing were cut off.
  [[nodiscard]] double density(const dvec3& u) const {
    const double rest = std::max(1 - glm::dot(u, u), 0.0);
    return peak * rest * std::sqrt(rest);
  }
};

/// Returns the ellipsoid of a splat whose material is widened by a variance along each axis: pixels and voxels cannot
/// show less. Widening does not move the boundary plane. Without mass, or if it stays flat, it draws nothing.
[[nodiscard]] Ellipsoid ellipsoid_of(const dvec3& centroid, const SplatShape& shape, double variance = 0);

/// Returns the inverse of Ellipsoid::to_ball of the same splat.
[[nodiscard]] dmat3 from_ball(const SplatShape& shape, double variance = 0);

/// Returns a shape that is at least 1e-6 of its length thick: planes, rays and positions still meet it.
[[nodiscard]] SplatShape with_thickness(SplatShape shape);

/// A ray's part of an ellipsoid. Distances are in lengths of the ray's direction.
struct Chord {
  double begin, end;    // of the material; of the whole chord unless a boundary cuts it
  double middle, half;  // of the whole chord
  double peak;          // density at `middle`

  /// Returns the density at a distance between begin and end.
  [[nodiscard]] double density(double distance) const {
    const double u = (distance - middle) / half, rest = std::max(1 - u * u, 0.0);
    return peak * rest * std::sqrt(rest);
  }
};

/// Returns the chord of a line; none if it misses the material.
[[nodiscard]] std::optional<Chord> chord_of(const Ellipsoid& ellipsoid, const dvec3& origin, const dvec3& direction);

/// The linear field of a value in a splat's material, and what it leaves.
struct LinearField {
  dvec3 centroid{0};
  double mean = 0;  // at the centroid
  dvec3 slope{0};
  double deviation = 0;  // of the values round the field

  [[nodiscard]] double at(const dvec3& position) const { return mean + glm::dot(slope, position - centroid); }
};

/// Returns the field in material that is widened as in ellipsoid_of: by regression, so it is flatter.
[[nodiscard]] LinearField field_of(const dvec3& centroid, const SplatShape& shape, const SplatValue& value,
                                   double variance = 0);

/// What splats add up to at a place. Material has a density of 1 on average.
struct DensitySums {
  double whole = 0;    // as if boundaries cut nothing off
  double bounded = 0;  // the part of it that splats with a boundary have
  double left = 0;     // the part of `whole` that boundaries leave

  /// `density`: at the place, as if nothing were cut off.
  void add(double density, bool has_boundary, bool is_cut_off) {
    whole += density;
    if (has_boundary) bounded += density;
    if (!is_cut_off) left += density;
  }

  static constexpr double least_whole = 0.3;  // where no splat has a boundary

  /// Returns whether material is there. Ripple must not leave holes. Splats with boundaries are near the material's
  /// edge: there `whole` must be more. `least`: instead of least_whole.
  [[nodiscard]] bool is_material(double least = least_whole) const {
    constexpr double least_of_bounded = 0.5, least_left = 0.3, least_share = 0.5;
    return left > 0 && whole >= least + (least_of_bounded - least) * bounded / whole &&
           left >= std::min(least_left, least_share * whole);
  }
};

}  // namespace splatvol
